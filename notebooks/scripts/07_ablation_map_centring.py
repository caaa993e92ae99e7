# %% [markdown]
# # 7 · Ablation: map centring
#
# An ablation takes one part out and trains again. The paper takes out its main idea, the centred map,
# and finds that the agent then learns far less. This notebook regenerates that figure from recorded runs
# with our recipe, where the difference is smaller, repeats it small and live, and asks what such an
# experiment shows, and what it does not.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: find the project's folder and install it from there.
from glob import glob
from importlib.metadata import distributions

project = [path for path in ("..", ".", *glob("*")) if glob(f"{path}/uavdh_lite/city.py")]
assert project, "the project's folder is not here: clone or upload it, then run this cell again"
# %cd -q {project[0]}/notebooks
if not any(distributions(name="uavdh_lite")):
    print("installing uavdh_lite from its folder")
    # %pip install -q .. ipywidgets

# %%
# %matplotlib inline
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.plotting import draw_study
from uavdh_lite.storage import read_table

torch.set_num_threads(1)
STUDY = "../data/runs/centring-manhattan"

# %%
training = read_table(f"{STUDY}-training.csv.gz")
figure = Figure(figsize=(10, 3.8), layout="constrained")
draw_study(figure, training)
figure.axes[0].set_ylim(-60, 40)
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Regenerate the paper's ablation figure, look at each seed, run a small ablation live, and list what three runs show and what they do not |
# | **What you'll learn** | How an ablation is set up so that it says something: same steps, same scenarios, several seeds, one thing changed |
# | **What you'll need** | Notebooks 4 and 6. 35 minutes to read, 60 seconds to run; 5 minutes of exercises |
#
# ## 7.1 The set-up
#
# Six training runs: two kinds of map, three seeds each. All else is equal: the recipe, the number of steps,
# the validation missions, and the distribution that training missions are drawn from (the draws themselves
# part as soon as the policies differ). One command makes such a study:

# %%
about = json.loads(Path(f"{STUDY}.json").read_text())
print(about["commands"][0])

# %% [markdown]
# The runs are of version 0.1.0. The loop is a little different now, so the same command gives other runs of the same
# kind.
#
# What is changed is one field of the recipe:

# %%
from uavdh_lite.experiments.study import centring
from uavdh_lite.recipe import LITE

for name, recipe in centring(LITE).items():
    print(name, {k: v for k, v in recipe.as_json().items() if v != LITE.as_json()[k]})

# %% [markdown]
# The non-centred network sees as large a map with one more layer, in which a single 1 marks the UAV
# (notebook 4). The weights:

# %%
from uavdh_lite.city import City
from uavdh_lite.environment import Environment

for name, recipe in centring(LITE).items():
    network = recipe.network_for(recipe.observation_for(Environment(City.load("manhattan"))))
    print(f"{name:<14}{sum(p.numel() for p in network.parameters()):>8} weights")

# %% [markdown]
# ## 7.2 The paper's figure
#
# The first figure above has the form of the paper's: the cumulative reward, and the data collected and landed, of the
# training episodes in bins of 5000 steps. The line is the mean over three runs, the thin band the 99 % quantiles. (The
# reward's axis is cut at −60.) What does such a band say?

# %%
validation = read_table(f"{STUDY}.csv.gz")
METRIC = "collected_and_landed"
COLOURS = {"centred": "C0", "non_centred": "C1"}

def one_run(table, variant, seed):
    own = (table["variant"] == variant) & (table["seed"] == seed)
    return {name: column[own] for name, column in table.items()}

three = np.array([one_run(training, "centred", seed)[METRIC][-1] for seed in range(3)])
print("last bin, three runs:", three.round(4), " 99 % quantiles:", np.quantile(three, [0.005, 0.995]).round(4))
print(f"episodes in a bin: about {training['episodes'].mean():.0f}")

# %% [markdown]
# Of three values the 99 % quantiles are practically the smallest and the largest. They hold 99 % of nothing but these
# three: a fourth run has an even chance to fall outside (exercise 1). So the band says roughly how far three runs lie
# apart. And each point is a mean over so few episodes that part of its jags is the luck of missions, not of training.
#
# Left, between 100,000 and 300,000 steps, the centred agent earns *less*, right it brings home more:

# %%
between = (training["steps"] > 100_000) & (training["steps"] <= 300_000)
for variant in ("centred", "non_centred"):
    rows = between & (training["variant"] == variant)
    reward, landed, collected, both = (training[name][rows].mean() for name in (
        "return", "landed", "collected", METRIC))
    print(f"{variant:<12} reward {reward:5.1f}, landed {landed:.0%}, collected {collected:.0%}, both {both:.0%}")

# %% [markdown]
# It flies farther, collects more and crashes more often, at 150 each: two measures, two stories.
#
# Training episodes still explore; flown greedily the centred agent is far ahead after 200,000 steps already:

# %%
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
for variant, colour in COLOURS.items():
    for seed in range(3):
        run = one_run(validation, variant, seed)
        ax.plot(run["steps"], run[METRIC], color=colour, label=variant if seed == 0 else None)
ax.set(xlabel="environment steps", ylabel="collected and landed, greedy")
ax.legend()
figure

# %%
for at, when in ((-2, "last but one"), (-1, "last")):
    for variant in ("centred", "non_centred"):
        ends = np.array([one_run(validation, variant, seed)[METRIC][at] for seed in range(3)])
        print(f"{when:<13}{variant:<14}" + "  ".join(f"{end:.1%}" for end in ends) + f"   mean {ends.mean():.1%}")

# %% [markdown]
# How many steps does each need to reach a given quality?

# %%
def steps_to(variant, seed, quality):
    run = one_run(validation, variant, seed)
    reached = run[METRIC] >= quality
    return int(run["steps"][reached.argmax()]) if reached.any() else None

for quality in (0.8, 0.9, 0.95):
    for variant in ("centred", "non_centred"):
        print(f"{quality:.0%}  {variant:<14}", [steps_to(variant, seed, quality) for seed in range(3)])

# %% [markdown]
# With the centred map the agent needs about 60 % of the steps to reach 80 and 90 %, and three quarters to reach 95 %
# (validations are 100,000 steps apart, so this is coarse). At the end it is ahead by 0.8 points in the mean. Every
# centred run is above every non-centred one there, but the closest two differ by a tenth of a point, and one
# validation earlier they were not in this order. On the way the curves cross more than once. So this recipe gets a good
# agent out of either map, sooner out of the centred one, and perhaps one that is a little better (7.4). The paper's
# figure shows a far larger gap. The recipes differ in many things; one that may matter here is that ours starts half of
# its training episodes anywhere in the city (`exploring_starts`), so that a network without centring sees every place
# from the beginning. (The centred one does not need that here, notebook 6.) Which of the differences it is, these runs do
# not say.
#
# ## 7.3 One seed, and six
#
# The same ablation in a village of 8×8 cells, small enough to run here: one seed, ten seconds a run:

# %%
from uavdh_lite.recipe import find_recipe
from uavdh_lite.experiments.runs import train
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer

village, missions = City.load("village"), find_scenario("village")
live = {}
for name, recipe in centring(replace(find_recipe("small"), steps=16_000, validation_interval=4000)).items():
    with tempfile.TemporaryDirectory() as folder:
        live[name] = Trainer(missions, recipe, seed=0, city=village)
        train(live[name], folder, show_progress=False)

# %%
figure = Figure(figsize=(6.5, 3.4), layout="constrained")
ax = figure.subplots()
for name, trainer in live.items():
    rows = trainer.validation_rows
    ax.plot([r["steps"] for r in rows], [r[METRIC] for r in rows], "o-", color=COLOURS[name], label=name)
ax.set(xlabel="environment steps", ylabel="collected and landed, greedy")
ax.legend()
figure

# %% [markdown]
# Which of the two is ahead? Before you believe this figure, look at six of its kind. The same two runs are recorded with the
# seeds 0 to 5. (On another machine even the same seed gives other curves, so yours may differ from those recorded.)

# %%
SIX = "../data/runs/centring-village"
print(json.loads(Path(f"{SIX}.json").read_text())["commands"][0])
village_runs = read_table(f"{SIX}.csv.gz")

# %%
figure = Figure(figsize=(9, 4.6), layout="constrained")
for seed, ax in enumerate(figure.subplots(2, 3, sharex=True, sharey=True).flat):
    for name, colour in COLOURS.items():
        run = one_run(village_runs, name, seed)
        ax.plot(run["steps"] / 1000, run[METRIC], "o-", ms=4, color=colour, label=name if seed == 0 else None)
    ax.set_title(f"seed {seed}", fontsize="medium")
figure.supxlabel("thousand environment steps")
figure.supylabel("collected and landed, greedy")
figure.legend(loc="outside upper center", ncols=2)
figure

# %%
last = {name: np.array([one_run(village_runs, name, seed)[METRIC][-1] for seed in range(6)]) for name in COLOURS}
for name, shares in last.items():
    print(f"{name:<12} at the end: {' '.join(f'{share:.0%}' for share in shares)}, mean {shares.mean():.0%}")
gap = last["centred"].mean() - last["non_centred"].mean()
error = np.sqrt(sum(shares.var(ddof=1) / 6 for shares in last.values()))
print(f"centred ahead by {100 * gap:.0f} points, standard error {100 * error:.0f} points")

# %% [markdown]
# With one seed you could have shown anything: that the centred map is far better (seed 4), that it makes no difference
# (seed 3), or that it is far worse (seed 5). The mean gap of all six is no larger than its standard error. So in runs this
# short, in this village, the six seeds do not tell which map is better. Nor can a curve that is cut off tell
# whether one agent is better in the end, or only sooner.
#
# ## 7.4 What the evidence shows, and what it does not
#
# There are three seeds of each kind. How far does that carry?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("three_seeds")

# %% [markdown]
# A gap says little without the spread: how much do seeds of one kind differ? The measure here is the standard deviation
# of the three results of a kind, and of the two kinds the larger one. A gap of "3.3 spreads" is 3.3 times as large
# (exercise 2 computes it). Could more test missions stand in for more runs?

# %%
ends = np.array([one_run(validation, "centred", seed)[METRIC][-1] for seed in range(3)])
flights = read_table("../data/runs/comparison-manhattan.csv.gz")
of_missions = flights[METRIC][flights["policy"] == "manhattan_ddqn"].std()
print(f"standard deviation between runs {ends.std(ddof=1):.2%}, between missions {of_missions:.1%}")

# %%
for runs, missions in ((1, 1000), (1, 10_000), (3, 1000), (3, 10_000), (10, 1000)):
    error = np.sqrt((ends.var(ddof=1) + of_missions**2 / missions) / runs)
    print(f"{runs:>2} runs, {missions:>6,} missions of its own for each: standard error of the mean {error:.2%}")

# %% [markdown]
# Ten times the missions help a little: they say more precisely how good *these agents* are. What another seed would
# give, they cannot say, so the part between runs stays. For a claim on a way to train, the runs are the sample. (In our
# studies all runs fly the *same* missions. Then the part of the missions does not shrink with the number of runs, but in the
# difference of two kinds most of it cancels.)
#
# | question | answered? |
# | --- | --- |
# | Does the agent learn faster with the centred map, in this city, with this recipe? | Very likely: after 300,000 steps it is 37 points ahead, which is 3.3 spreads (after 200,000 it was a little more), and every centred run reaches 80 and 90 % before every non-centred one. (The order alone would not do: it comes about by chance in 10 % of cases) |
# | Is the agent better in the end? | Perhaps a little: by 0.8 points at the last validation, 1.3 spreads. In the mean of 3000 test missions the agents kept are 1.4 points apart, and all centred ones ahead (`docs/results/training.md`, on the site under Results). Three runs do not settle it, and longer ones might end level |
# | Is the paper's larger gap wrong? | These runs cannot say: it was measured with another recipe and other maps |
# | Is the recipe fair to both? | Not quite: it was tuned with the centred map |
# | Is it the centring, or the missing position layer? | Not separated: centring also removes the layer that holds the position |
# | Does it hold in other cities? | For a single other city that is open: only a village was tried, with short runs in which the seeds differ more than the maps (7.3); the paper tried one city. For one agent over many cities the gap after 200,000 steps is about as wide as here, and does not close within them (notebook 13) |
#
# An ablation answers one question. Write it down beforehand, and also which result would mean *no*. That is most of the
# work.

# %% [markdown]
# ## Recap
#
# - Same recipe, same steps, missions drawn alike, several seeds: only then can a difference mean something, and it must still
#   be large next to the spread between seeds.
# - Here, in runs of two million steps, an agent with the centred map needs 60 to 75 % of the steps that it needs with the
#   other. Whether it is also better in the end, three runs leave open.
# - A band over three seeds is a range. A fourth run may well lie outside. More test missions do not replace runs.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/07_ablation_map_centring`](exercises/07_ablation_map_centring/07_ablation_map_centring.ipynb).
#
# **1.** How likely does a fourth run fall outside the range of three? And after how many runs does the next one fall
# inside with a chance of 90 %? (Of $n + 1$ runs alike, each is as likely as any other to be the highest, or the
# lowest.)

# %%
def outside(runs):
    return 2 / (runs + 1)

drawn = np.random.default_rng(0).normal(size=(100_000, 4))
new, others = drawn[:, 0], drawn[:, 1:]
measured = ((new < others.min(1)) | (new > others.max(1))).mean()
assert outside(3) == 0.5 and abs(measured - 0.5) < 0.01 and np.isclose(outside(19), 0.1)
print(f"three runs: {outside(3):.0%}, measured {measured:.0%}; 19 runs: {outside(19):.0%}")

# %% [markdown]
# **2.** Compute the gap after 300,000 steps, half way and at the end, each time divided by the larger standard deviation
# between seeds, and by its own standard error. (The second is the $t$ of *Welch's test*, which allows the two kinds to
# spread differently.) Of which of the differences are you sure?

# %%
def compare(at):
    centred, other = ([one_run(validation, v, s)[METRIC][at] for s in range(3)] for v in ("centred", "non_centred"))
    gap, spreads = np.mean(centred) - np.mean(other), np.std([centred, other], axis=1, ddof=1)
    return gap, gap / spreads.max(), gap / np.sqrt((spreads**2 / 3).sum())

# %%
assert compare(2)[1] > 3
for name, at in (("300,000 steps", 2), ("half way", 9), ("the end", -1)):
    print("{}: gap {:.3f}, {:.1f} spreads, t {:.1f}".format(name, *compare(at)))

# %% [markdown]
# Of the first only. Half way and at the end the gap is about as large as the spread, although the one gap is 5 points
# and the other 0.8. (With three runs of each, chance alone brings $t$ above 2.8 or below −2.8 in one of twenty tries, if both
# kinds spread alike and results are normally distributed; if one kind does nearly all of the spreading, as after 300,000
# steps, in one of ten. The 5.7 there comes in about one of forty, and we chose the moment after we had seen the
# curves. Exercise 7.2 of the sheet has a test that needs no normal distribution.) And the spread itself is known from three
# runs only.
#
# **3.** The non-centred network has a layer more, because without it it could not know where it is. But a
# single 1 among 961 cells may be hard to read. Design the ablation that separates *centring* from *how the
# position is given*. (One answer: a third kind, not centred, with the position as two numbers next to the
# flying time. If it is as fast as the centred map, the frame was not what mattered.)
#
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section V-C: the figure and its discussion.
# - Meyes et al.: *Ablation Studies in Artificial Neural Networks*, 2019.
# - Agarwal et al.: *Deep RL at the Edge of the Statistical Precipice*, NeurIPS 2021: few seeds, done well.
