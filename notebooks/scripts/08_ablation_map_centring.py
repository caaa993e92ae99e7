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
# again. Such an experiment is called an **ablation**. Here are the first 600,000 steps of six
# training runs: three with the centred map, and three with the city in place.

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

# %%
# %matplotlib inline
from matplotlib import pyplot as plt

from uavdh_lite.plotting import draw_study
from uavdh_lite.storage import data_folder, read_table

figure = plt.figure(figsize=(9, 3.6), layout="constrained")
draw_study(figure, read_table(data_folder() / "runs/centring_lite-manhattan-training.csv.gz"))
for ax in figure.axes:
    ax.set(xlim=(0, 600_000), xticks=(0, 200_000, 400_000, 600_000))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Read the paper's figure on centring, look at single runs, compute what they prove, and move the landing zones |
# | **What you'll learn** | Ablations, baselines, paired differences, intervals over runs, and why one seed proves nothing |
# | **What you'll need** | Notebooks 4, 5 and 7. 50 minutes to read, 20 seconds to run; 31 minutes of exercises |
#
# ## 8.1 One thing changed
#
# An ablation tells us something only if all else is equal. Both kinds of run have the same number
# of steps, missions drawn in the same way, and the same missions for validation. Only one field of
# the recipe differs:

# %%
from uavdh_lite.experiments.study import centring
from uavdh_lite.recipe import LITE

for name, recipe in centring(LITE).items():
    print(name, {k: v for k, v in recipe.as_json().items() if v != LITE.as_json()[k]})

# %% [markdown]
# Both networks see 31 × 31 cells, because the city in place gets a rim of no-fly cells. The one
# with the centred map has 246,006 weights, the other only 400 more, because the city in place needs
# one more layer to show the UAV.
#
# Chance differs, too: a **seed** determines the first weights, the missions, the fading and every
# action that is drawn. Each kind of run has three seeds.
#
# ## 8.2 The paper's figure
#
# The figure at the top has the same form as the paper's. But each of our points is a mean over 5000
# steps of training flights, in which the agent explores, whereas the paper's agent always took the
# action that it rated highest. Each line is the mean of three runs. The pale band runs from the
# 0.5th to the 99.5th percentile of the three values, which is almost their whole range.
#
# The two pictures do not agree. On the left, by return, the centred agents do *worse* much
# of the time, but on the right, by *collected and landed*, they do better. They collect more,
# but from 75,000 to about 350,000 steps they also crash more often, and each crash costs 150 units.
# Always say which measure you mean.
#
# Exploring hides part of what an agent can do. Here are the validations of the same six runs, in
# which the agents do not explore:

# %%
METRIC = "collected_and_landed"
KINDS = {"centred": "C0o-", "non_centred": "C1s--"}

def draw_runs(ax, table, seeds):
    for variant, style in KINDS.items():
        for seed in seeds:
            rows = (table["variant"] == variant) & (table["seed"] == seed)
            ax.plot(table["steps"][rows] / 1000, table[METRIC][rows], style, ms=3,
                    label=variant.replace("_", " ") if seed == seeds[0] else None)

# %%
manhattan = read_table(data_folder() / "runs/centring_lite-manhattan.csv.gz")
figure, ax = plt.subplots(figsize=(6.5, 3.4), layout="constrained")
draw_runs(ax, manhattan, range(3))
ax.set(xlabel="thousand steps", ylabel="collected and landed")
ax.legend();

# %% [markdown]
# After 200,000 and 300,000 steps all centred runs are far ahead of the others. Later, apart from
# two dips at a million steps, the gap shrinks to half a percentage point, and at the end the lowest
# centred run is level with the highest of the others. The paper's gap is larger. With `plain`, the
# paper's method with a smaller network, it stays wide: after a million steps centred runs collect
# and land 92 to 94 % of the data, the others 25 to 32 %.
#
# ## 8.3 One seed, and six
#
# Let us repeat the ablation in the village, with runs of 16,000 steps. Here is one run of each
# kind:

# %%
village = read_table(data_folder() / "runs/centring-village.csv.gz")
figure, ax = plt.subplots(figsize=(4.5, 3), layout="constrained")
draw_runs(ax, village, [2])
ax.set(xlabel="thousand steps", ylabel="collected and landed", ylim=(-0.02, 0.82))
ax.legend();

# %% [markdown]
# The centred map seems to win by far. Here are the runs with six seeds; the two above had seed 2.

# %%
figure, axes = plt.subplots(2, 3, figsize=(8, 4.4), sharex=True, sharey=True,
                            layout="constrained")
for seed, ax in enumerate(axes.flat):
    draw_runs(ax, village, [seed])
    ax.set_title(f"seed {seed}", fontsize="medium")
figure.supxlabel("thousand steps")
figure.supylabel("collected and landed");

# %% [markdown]
# **One seed can show a lead of almost any size**: at the end the lead is 46 percentage points with
# seed 2, 5 with seed 3 and 1 with seed 5. Report all seeds, because the best of several results
# owes more to luck than the others do.
#
# ## 8.4 How sure can you be?
#
# Three other seeds would show a different lead. How different? Take the runs in pairs, one for each
# seed, so that each seed gives one difference. The **standard error** of the mean difference is the
# standard deviation $s$ of the differences divided by the square root of their number $n$, so four
# times as many pairs halve the error. A **95 % confidence interval** extends $m$ standard errors to
# either side of the mean:
#
# $$\text{mean}\pm m\,\frac{s}{\sqrt{n}}$$
#
# | $n$ | 3 | 6 | 17 | 1000 |
# | --- | --- | --- | --- | --- |
# | $m$ | 4.3 | 2.6 | 2.1 | 1.96 |
#
# Three differences may lie close together by chance; then $s$ is too small, and the large $m$ makes
# up for this. (The values of $m$ come from *Student's t distribution*.) If all runs were made again
# and again, 95 % of such intervals would contain the true lead, provided that the differences are
# roughly normally distributed.

# %%
import numpy as np

def gap(table, steps):
    rows = table["steps"] == table["steps"][table["steps"] >= steps].min()
    one, other = (table[METRIC][rows & (table["variant"] == kind)] for kind in KINDS)
    ahead = one - other  # a difference for each seed
    # ddof=1 divides by n - 1, because the mean comes from the same few differences
    error = ahead.std(ddof=1) / np.sqrt(len(ahead))
    return ahead.mean(), {3: 4.3, 6: 2.6}[len(ahead)] * error

# %%
gaps = {"Manhattan, 300,000 steps": gap(manhattan, 300_000),
        "Manhattan, at the end": gap(manhattan, 2_000_000), "village": gap(village, 16_000)}
figure, ax = plt.subplots(figsize=(6.5, 2), layout="constrained")
for name, (middle, width) in gaps.items():
    ax.errorbar(100 * middle, name, xerr=100 * width, fmt="C0o", capsize=4)
ax.axvline(0, color="black")
ax.set(xlabel="lead of the centred map, percentage points", ylim=(2.5, -0.5));

# %% [markdown]
# After 300,000 steps the whole bar lies on one side of 0: the centred agents seem to learn
# **faster**. (We chose the mark of 300,000 steps after seeing the curves, so this gap is less
# certain than it looks.) At the end of the long runs the interval contains 0, so by this measure
# these runs do not say which kind is **better in the end**. In the village the bar just reaches 0,
# although there are six pairs: the leads differ too much, from 1 to 46 points.
#
# ### Baselines
#
# Our agent brought home 97 % of the data in notebook 0. Is that good? The paper's agent brought
# home 94.6 %, but over another map, so we need *baselines*, other pilots that fly the same
# missions. Here is what `random`, `greedy` and the agent brought home in another 1000 missions:

# %%
from uavdh_lite.evaluation import bootstrap_interval

flights = read_table(data_folder() / "runs/comparison-manhattan.csv.gz")
share = {name: flights[METRIC][flights["policy"] == name]
         for name in ("random", "greedy", "manhattan_ddqn")}
for name, values in share.items():
    print("{:<15} {:6.1%}, from {:.1%} to {:.1%}".format(name, *bootstrap_interval(values)))

# %% [markdown]
# These intervals show the luck of the missions, not that of the training. They come from the
# **bootstrap**, which draws 1000 results from the 1000 recorded ones *with replacement* (some
# twice, some not at all) and takes the mean. The bootstrap repeats this many times, and records how
# much the mean varies. For a share $p$ of yes-or-no results, such as `landed`, $s$ is
# $\sqrt{p(1-p)}$: 97 % in 1000 missions means 97 ± 1.1 %.
#
# ### Paired differences
#
# Do the agent and greedy differ at all? Look at the interval for the difference. One can combine
# the standard errors of both pilots as if they had flown different missions,
# $\sqrt{s_1^2/n+s_2^2/n}$. Or one can subtract mission by mission, because both flew the *same*
# missions: a hard mission is hard for both, and much of the luck therefore cancels.

# %%
agent, greedy = share["manhattan_ddqn"], share["greedy"]
apart = 1.96 * np.sqrt((agent.var() + greedy.var()) / len(agent))
mean, low, high = bootstrap_interval(agent - greedy)

# %%
print(f"agent minus greedy: {100 * mean:+.2f} percentage points")
print(f"not paired: from {100 * (mean - apart):+.2f} to {100 * (mean + apart):+.2f}")
print(f"paired:     from {100 * low:+.2f} to {100 * high:+.2f}")
assert high < 0 and high - low < 1.5 * apart

# %% [markdown]
# Neither interval contains 0: `greedy` is ahead, here by 1.3 points. In 10,000 other missions
# (seeds 1 to 10) greedy is ahead by only 0.65 points (0.49 to 0.84), and the agent brings home 96.9
# % (96.7 to 97.1), so the 1000 missions above suit the agent badly. Because errors add as squares,
# the error of the difference is smaller than the sum of the two pilots' errors. The difference can
# therefore be clear even if the pilots' own intervals overlap a little: **overlapping intervals do
# not mean “no difference”**. Pairing makes the interval narrower still, here by about as much as
# doubling the number of missions would.

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("more_missions")

# %% [markdown]
# ## Before you believe a surprise
#
# **Could luck alone have caused the gap?** After 300,000 steps every centred run was above every
# run of the other kind.

# %%
Quiz("three_seeds")

# %% [markdown]
# Look only at the ranks of the six runs. If the methods were equally good, each of the 20 ways to
# give three of the six ranks to the first method would be equally likely, and in two of the 20
# ways, or 10 %, one method has the three best ranks. This share is called a **p-value**, and going
# through all the ways of dealing out the results is a **permutation test**. With three runs of each
# kind its p-value can never fall below 10 %. In the village, with six runs of each kind, only 10 of
# the 924 ways, or 1 %, give so large a gap: there probably is a lead.
#
# A difference with a p-value below 5 % is often called **statistically significant**. That does not
# make it large, and one that is not significant has not been shown to be 0. Nor is the
# p-value the probability that the methods are equally good.
#
# **How many things did you compare?** Suppose that five parts of a recipe are taken away, each on
# its own, and that none of them matters. Then in nearly one such study in five, at least one
# comparison has a p-value below 5 %. So name the main comparison beforehand,
# or ask for p-values below 5 % divided by the number of comparisons (**Bonferroni**), or repeat the
# surprising comparison with new seeds.
#
# **Were there enough runs?** To detect, at the 5 % level and in four studies out of five, a gap as
# large as the standard deviation of the runs, you need about 17 runs of each kind. With three runs,
# only a far larger gap is likely to show.
#
# ## 8.5 What has it learned?
#
# An ablation changes the agent. One can also change the *world* and see whether the agent's
# knowledge still holds. Let us move both landing zones by two cells, and let the agent and greedy
# fly. Predict first: in how many missions will the agent land?

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
# the agent is lost in most missions, although the layer with the landing zones is in its input and
# was moved, too. In training the zones were always in the same two corners. A network that learns
# "towards the corner" earns as much as one that learns "towards the landing zone", so nothing made
# our agent tell the two apart. **Part of the agent's knowledge consists of places learned by
# heart.** This is overfitting again, this time to a city.
#
# ## 8.6 What the evidence shows
#
# | question | what these runs say |
# | --- | --- |
# | Does an agent learn faster with the centred map? | Probably, judged by *collected and landed*, in this city and with this recipe |
# | Is it better in the end? | Open: the interval at the end contains 0 by *collected and landed*, but not by return (0.6 to 1.1 units) |
# | Is the paper's larger gap wrong? | These runs do not say so: with `plain` the gap is large after a million steps, with `lite` small after two (8.2) |
# | Is the recipe fair to both kinds? | Not quite: we tuned the recipe with the centred map |
# | Is the gap due to the centring alone? | Open: the city in place shows the UAV's position differently, as a single 1, and there the strip that neither network reads (5.5) contains only rim |
#
# ## Recap
#
# - Change one thing, keep the rest fixed, and use several seeds.
# - One seed is a sample of one.
# - Report every gap with its interval. If 0 is well inside the interval, the question is open; if 0
#   is near one end, neither answer is safe.
# - Put baselines next to every number, and compare mission by mission on the same missions.
#
# ## Exercises
#
# The [exercises of this
# notebook](exercises/08_ablation_map_centring/08_ablation_map_centring.ipynb) come with checks and
# hints.
#
# Further reading: Agarwal et al., *Deep RL at the Edge of the Statistical Precipice*, 2021.
