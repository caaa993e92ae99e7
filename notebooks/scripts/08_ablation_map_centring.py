# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 8 · Ablation: map centring
#
# Notebook 4 put the UAV in the middle of its map, and notebook 5 showed in an example why that
# might help. **Does centring help an agent to fly?** To find out, take the centring away and train
# again. Such an experiment is called an **ablation**. Here it is over Manhattan, with two recipes:
# `plain`, the paper's method with a smaller network, and our strengthened `lite`. Each line is one
# training run.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions
from os import chdir

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    chdir(f"{project[0]}/notebooks")

# %% tags=["hide-input"]
# %matplotlib inline
import numpy as np
from matplotlib import pyplot as plt

from uavdh_lite.storage import data_folder, read_table

METRIC, ARMS = "collected_and_landed", {"centred": "C0o-", "non_centred": "C1s--"}
NAMES = {"centred": "centred", "non_centred": "in place"}

def draw_runs(ax, table, title):
    for variant, style in ARMS.items():
        for seed in np.unique(table["seed"]):
            rows = (table["variant"] == variant) & (table["seed"] == seed)
            ax.plot(table["steps"][rows] / 1000, table[METRIC][rows], style, ms=3, lw=1,
                    label=NAMES[variant] if seed == 0 else None)
    ax.set(title=title, xlabel="thousand steps", ylim=(-0.03, 1.03))

recorded = {name: read_table(data_folder() / f"runs/centring{name}.csv.gz")
            for name in ("_plain-manhattan", "_lite-manhattan", "-village")}
figure, axes = plt.subplots(1, 2, figsize=(8.5, 3.2), sharey=True, layout="constrained")
draw_runs(axes[0], recorded["_plain-manhattan"], "plain")
draw_runs(axes[1], recorded["_lite-manhattan"], "lite")
axes[0].set_ylabel("collected and landed")
axes[0].legend();

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Train both arms of the paper's experiment, try a guess, and say how sure you can be |
# | **What you'll learn** | Ablations, how much seeds differ, Student's interval, pairing, and what an agent knows by heart |
# | **What you'll need** | Notebooks 4, 5 and 7. 40 minutes to read, 60 seconds to run; 31 minutes of exercises |
#
# With `plain` the two arms are far apart: with the map *in place* (`non_centred`) the agent brings
# home less than a third of the data. With `lite` the gap nearly closes. Let us do the experiment
# ourselves first.
#
# ## 8.1 One thing changed
#
# An ablation tells us something only if all else is equal. Here is one state, and the same state
# with the UAV two cells further east and three further south, as both arms see its buildings:

# %%
from dataclasses import replace

from uavdh_lite.environment import Environment
from uavdh_lite.city import load_city
from uavdh_lite.observation import Observation
from uavdh_lite.one_file import VILLAGE
from uavdh_lite.plotting import draw_maps
from uavdh_lite.streams import Use, stream

village = Environment(load_city("village"))
state = VILLAGE.sample(village, 1, stream(Use.LAB))
later = replace(state, uav_cell=state.uav_cell + 3 * 8 + 2)
pictures = {}
for when, seen in (("before", state), ("later", later)):
    maps = {arm: Observation(village, arm)(seen)[0][0] for arm in ARMS}
    pictures |= {f"{NAMES[arm]}, {when}": layers[2] for arm, layers in maps.items()}
    pictures[f"its UAV, {when}"] = maps["non_centred"][5]  # of the arm without centring
draw_maps(pictures)

# %% [markdown]
# In the centred map everything moves when the UAV moves, and what is one cell east of the UAV is
# always in the same place of the picture. Without centring the city stays where it is, and one more
# layer has a single 1 in the UAV's cell. Both maps hold the same information; what may differ is
# how hard it is to use: to know what is *near*, the second network must find that 1 and look around
# it. (The city in place stands in a frame of the same size, so the second network has only the
# weights of that layer more.)
#
# ## 8.2 Train both arms
#
# This is the loop of notebook 7 with the recipe `small`. First your guess: how far apart will the
# two be after 36,000 steps?

# %%
import torch

from uavdh_lite.recipe import SMALL
from uavdh_lite.training import Trainer

torch.set_num_threads(1)

def learn(name, **changes):
    recipe = replace(SMALL, steps=36_000, validation_interval=6_000, validation_episodes=100,
                     **changes)
    trainer = Trainer(VILLAGE, recipe, seed=0)
    while not trainer.finished:
        if trainer.advance():
            print(f"\r{name}: {trainer.steps:,} steps", end="", flush=True)
    print(f", {METRIC} {trainer.validation_rows[-1][METRIC]:.0%}")
    return trainer

# %%
trained = {"centred": learn("centred"),
           "in place": learn("in place", observation="non_centred")}

# %% tags=["hide-input"]
def draw_trained():
    figure, ax = plt.subplots(figsize=(5.5, 2.8), layout="constrained")
    for (name, trainer), style in zip(trained.items(), ("C0o-", "C1s--", "C2^:")):
        rows = trainer.validation_rows
        ax.plot([r["steps"] for r in rows], [r[METRIC] for r in rows], style, ms=4, label=name)
    ax.set(xlabel="environment steps", ylabel="collected and landed", ylim=(-0.03, 1.03))
    ax.legend()

draw_trained()

# %% [markdown]
# One run of each arm, and short: the centred one has not finished learning, and the other has
# hardly begun. With three seeds and 144,000 steps, the village says this:

# %% tags=["hide-input"]
figure, ax = plt.subplots(figsize=(5.5, 2.8), layout="constrained")
draw_runs(ax, recorded["-village"], "the village, recipe small")
ax.legend();

# %% [markdown]
# ### A guess, tried
#
# Why does the second arm learn less? A guess: the network's inputs are data of up to 15 units and
# times of up to 35, and they drown the single 1 that shows the UAV. Then smaller numbers should
# help. Divide the data by 20 and the time by 10, as `lite` does:

# %%
trained["in place, scaled"] = learn("scaled", observation="non_centred", data_scale=20.0,
                                       time_scale=10.0)
draw_trained()

# %% [markdown]
# If the scaled arm ends higher in your run, was the guess right? It is one short run of each, and
# in the village's figure three runs of one arm end between 65 and 77 %, though only chance differs.
# A guess that sounds right is still a guess. How much would persuade you?
#
# ## 8.3 How sure can you be?
#
# Train again with another **seed**, and all chance in training is different: the first weights, the
# missions, the fading, every action that is drawn. How much do seeds differ? Take the last
# validation of each run:

# %%
def last(table, arm, steps=10**9):
    table = {name: column[table["steps"] <= steps] for name, column in table.items()}
    rows = (table["variant"] == arm) & (table["steps"] == table["steps"].max())
    return table[METRIC][rows]

for name, table in recorded.items():
    for arm in ARMS:
        values = last(table, arm)
        print(f"{name[1:]:<18}{arm:<13}", " ".join(f"{value:6.1%}" for value in values),
              f"  standard deviation {values.std(ddof=1):5.1%}")

# %% [markdown]
# Three runs make a mean, and the mean has an error: the **standard error**, the standard deviation
# $s$ of the runs divided by $\sqrt n$. For the gap between two arms the errors add as squares,
# $\sqrt{s_1^2/n+s_2^2/n}$. A **95 % confidence interval** extends $m$ of them to either side:
#
# | runs of each arm | 3 | 5 | 8 | 30 |
# | --- | --- | --- | --- | --- |
# | $m$, equal spread | 2.8 | 2.3 | 2.1 | 2.0 |
# | $m$, if one arm spreads much more | 4.3 | 2.8 | 2.4 | 2.05 |
#
# With few runs $m$ is large, because three values may lie close together by chance, and then $s$ is
# too small (**Student's t distribution**). If all runs were made again and again, 95 % of such
# intervals or more would contain the true gap, if the runs are roughly normally distributed.

# %%
def gap(table, steps=10**9, m=4.3):
    one, other = last(table, "centred", steps), last(table, "non_centred", steps)
    error = np.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    return one.mean() - other.mean(), m * error

gaps = {"plain, at the end": gap(recorded["_plain-manhattan"]),
        "lite, 300,000 steps": gap(recorded["_lite-manhattan"], 300_000),
        "lite, at the end": gap(recorded["_lite-manhattan"]), "village": gap(recorded["-village"])}
figure, ax = plt.subplots(figsize=(6.5, 2.2), layout="constrained")
for name, (middle, width) in gaps.items():
    ax.errorbar(100 * middle, name, xerr=100 * width, fmt="C0o", capsize=4)
ax.axvline(0, color="black")
ax.set(xlabel="lead of the centred map, percentage points", ylim=(3.5, -0.5));

# %% [markdown]
# A bar to the right of 0 says that the centred map is ahead in runs like these. At the end of
# `lite` the bar just contains 0: by this measure the runs do not say which arm is better there. (By
# *return* they do: the same interval is 0.5 to 3.5 units.)
#
# **Pairing helps where a pair shares its luck.** Runs with the same seed begin with the same
# missions, but soon after the first updates they have flown apart, so pairing *them* buys hardly
# anything. *Missions* are another matter: a mission that is hard for one pilot is often hard for
# others. Here are greedy and the DDQN agent on the same 1000 missions:

# %%
flights = read_table(data_folder() / "runs/comparison-manhattan.csv.gz")
pilots = "manhattan_ddqn", "greedy"
agent, greedy = (flights[METRIC][flights["policy"] == name] for name in pilots)
apart = 1.96 * np.sqrt((agent.var(ddof=1) + greedy.var(ddof=1)) / len(agent))
paired = 1.96 * (agent - greedy).std(ddof=1) / np.sqrt(len(agent))
print(f"agent minus greedy: {100 * (agent - greedy).mean():+.2f} percentage points")
print(f"as if each flew its own: ± {100 * apart:.2f}; mission by mission: ± {100 * paired:.2f}")

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("more_missions")

# %% [markdown]
# Mission by mission, the interval is narrower. But another seed gives another agent, and this
# interval says nothing of that. [Before you believe a surprise](../docs/tutorials/surprises.md) has
# more tools.
#
# ## 8.4 Why do `plain` and `lite` disagree?
#
# `lite` differs from `plain` in its length and in eight of the nine things [listed
# here](../docs/project/differences_from_the_paper.md#the-recipe-lite). After 300,000 steps even
# `lite` is far behind in place (the second bar above), and then nearly catches up, whereas `plain`
# does not within a million steps. So that map has the information, and learning to use it takes longer.
#
# Which of the things helps? Undo them one by one, in both arms, and look. Here are [such
# runs](../docs/results/recipe.md), each of 300,000 steps, one dot a run. (They are of an earlier
# `lite`, with four things more.) A *leaky* ReLU
# keeps a tenth of what is below 0, and a *layer norm* brings the neurons of a layer to a common
# scale:

# %% tags=["hide-input"]
parts = read_table(data_folder() / "runs/pilots-manhattan.csv.gz")
ends = parts["steps"] == parts["steps"].max()
done = list(dict.fromkeys(name.split("_", 1)[1] if name.startswith("centred") else name[9:]
                          for name in parts["variant"]))  # without the arm, "centred" or "in_place"
figure, ax = plt.subplots(figsize=(7, 1 + 0.27 * len(done)), layout="constrained")
for arm, style, shift in (("centred", "C0o", -0.12), ("in_place", "C1s", 0.12)):
    for place, part in enumerate(done):
        values = parts[METRIC][ends & (parts["variant"] == f"{arm}_{part}")]
        ax.plot(values, np.full(len(values), place + shift), style, ms=5, alpha=0.8)
    ax.plot([], [], style, label=arm.replace("_", " "))
ax.set_yticks(range(len(done)), [part.replace("_", " ") for part in done])
ax.set(xlabel="collected and landed", xlim=(-0.03, 1.03), ylim=(len(done) - 0.5, -0.5))
figure.legend(loc="outside right upper");

# %% [markdown]
# A dot says what *one* run did, and 8.3 shows how far runs differ by chance. (*These three* are
# amsgrad off, the movement reward and the exploring starts, undone together; the last row was flown
# centred alone.) Look for a part that takes the dots of one arm down and leaves the other arm where
# it was. Five nearly do so: the input scales, the layer norm, the leaky ReLUs, the larger memory
# (*replay*) and the Huber loss. Without any one of them, agents in place lose a quarter or more of
# what they brought home, whereas centred ones lose about five percentage points at most, on
# average. (Without the *temperature*, one dot in place stays where it was.) So **probably no single
# part explains the disagreement**: `plain` has none of the five, and in place each matters.
# Centring makes each nearly unnecessary, perhaps because the network need not first find out where
# the UAV is.
#
# ## 8.5 What has it learned by heart?
#
# An ablation changes the agent. One can also change the *world* and see whether the agent's
# knowledge still holds. Let us move both landing zones of Manhattan by two cells, and let the DDQN
# agent and greedy fly. Predict first: in how many missions will the agent land?

# %%
from dataclasses import replace

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

pilot = load_agent("manhattan_ddqn")
rows, cols = np.nonzero(pilot.city.landing)
landing = np.zeros_like(pilot.city.landing)
landing[np.where(rows < 8, rows + 2, rows - 2), cols] = True  # both zones, towards the middle

# %%
moved = Environment(replace(pilot.city, name="zones moved", landing=landing))
for name, one in {"greedy": Greedy(moved), "agent": pilot.over(moved.city)}.items():
    end = evaluate(moved, one, pilot.scenario, 500, seed=0).end
    print(f"{name:<7} landed {end.landed.mean():.0%}, collected {end.collected.mean():.0%}")
over_old_zone = pilot.city.landing.flat[end.uav_cell[~end.landed]]
print(f"of the agent's crashes, {over_old_zone.mean():.0%} were over an old zone")

# %% [markdown]
# Greedy flies as well as before, because it looks up the way home in the map, wherever home is. But
# the agent is lost in nearly all missions, although the layer with the landing zones was moved, too. In
# training the zones were always in the same two corners, so "towards the corner" earned as much as
# "towards the landing zone", and nothing made the agent tell the two apart. **Part of its knowledge
# consists of places learned by heart.** This is overfitting again, this time to a city.
#
# ## 8.6 What is left of the claim
#
# | question | what these runs say, by *collected and landed* |
# | --- | --- |
# | Does an agent learn faster with the centred map? | Yes, in all three experiments |
# | Is it better at the end of these runs? | With `plain` and in the village, yes. With `lite` over Manhattan the interval at the end contains 0 |
# | Is the paper right? | Its claim holds for its own method: with `plain` the gap is wide. With `lite` only the faster learning is clear |
# | Does centring make an agent independent of the place? | No: moved landing zones confuse it (8.5) |
#
# ## Recap
#
# - Change one thing, keep the rest fixed, and use several seeds. A guess is tried, not believed.
# - Report a gap with Student's interval over the runs. If it contains 0, the question is open.
# - Compare pilots mission by mission on the same missions; pairing by seed buys hardly anything.
#
# ## Exercises
#
# The [exercises of this
# notebook](exercises/08_ablation_map_centring/08_ablation_map_centring.ipynb) come with checks and
# hints.
#
# Further reading: Agarwal et al., *Deep Reinforcement Learning at the Edge of the Statistical
# Precipice*, 2021.
