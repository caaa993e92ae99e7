# %% [markdown]
# # 8 · Evaluation
#
# How good is an agent? Is it better than the paper's, or than a simple rule? How far is it from the best that can be done? And how
# sure are we? This notebook regenerates the paper's table, with what it lacks: intervals, planners to
# compare with, and a look at the missions that go badly.

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
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.experiments.comparison import breakdown, share
from uavdh_lite.evaluation import bootstrap_interval, mean_interval, wilson_interval
from uavdh_lite.storage import read_table

RUNS = Path("../data/runs")
POLICIES = ("ddqn", "random", "greedy", "genie", "genie_data")

# %%
def policies(city):
    table = read_table(RUNS / f"comparison-{city}.csv.gz")
    rows = {p: table["policy"] == (f"{city}_ddqn" if p == "ddqn" else p) for p in POLICIES}
    return {p: {k: v[rows[p]] for k, v in table.items()} for p in POLICIES}

cities = {city: policies(city) for city in ("manhattan", "open_field")}
METRIC = "collected_and_landed"

# %%
shown = [policy for policy in POLICIES if policy != "random"]
figure = Figure(figsize=(9, 3), layout="constrained")
for ax, (city, results) in zip(figure.subplots(1, 2, sharex=True, sharey=True), cities.items()):
    for y, policy in enumerate(reversed(shown)):
        mean, low, high = mean_interval(results[policy][METRIC])
        ax.errorbar(mean, y, xerr=[[mean - low], [high - mean]], fmt="o", ms=4, capsize=4, color="#0072B2")
    chance = results["random"][METRIC].mean()
    ax.set(yticks=range(4), yticklabels=shown[::-1], title=f"{city} (random: {chance:.0%})")
    ax.set(xlabel="collected and landed, mean and 95 % interval")
    ax.locator_params(axis="x", nbins=5)
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Compare an agent with the paper, with chance and with three planners on the same 1000 missions, find the missions in which it falls behind, and work out what a claim needs |
# | **What you'll learn** | Random streams, Wilson's and bootstrap intervals, tests for two agents, why the best checkpoint looks too good, paired comparisons |
# | **What you'll need** | Notebooks 0 and 3, means and quantiles. 52 minutes to read, 15 seconds to run; 5 minutes of exercises |
#
# Above: the agents of two cities next to a simple rule, `greedy`, and a search that knows the channel, `genie`.
# Section 8.1 says what each of them knows.
#
# ## 8.1 Where the numbers come from
#
# Every policy flew the same 1000 missions, drawn from a random stream that training never sees, and met
# the same fading. One command made the tables:

# %%
for city in cities:
    about = json.loads((RUNS / f"comparison-{city}.json").read_text())
    print(about["command"], "#", about["machine"], f"{about['seconds']:.0f} s")

# %% [markdown]
# | policy | what it knows |
# | --- | --- |
# | `ddqn`, *the agent* below | (trained by the paper's method with recipe `lite`: `manhattan_ddqn` and `open_field_ddqn`) the map, the devices, their data and the remaining time, through its network; it has learned what to do |
# | `random` | nothing |
# | `greedy` | the same as the agent; a person wrote its rule: to the nearest device with data, and home in time |
# | `genie` | also the channel's mean rate at every cell; it searches over whole flights for the highest return |
# | `genie_data` | the same, but it searches for the most data and hardly minds the time |
#
# (The commands name one agent more, `manhattan` and `open_field`: those of notebook 12, which are left out here.)
#
# `greedy` will be met again and again, so here are the lines that decide:

# %%
import inspect

from uavdh_lite.planners import Greedy

print(inspect.getsource(Greedy.act))

# %% [markdown]
# `goals` are the devices' cells, or the nearest cells over which the UAV may fly; `landing_distance` is the number of moves
# home.
#
# The score of this notebook is CRAL, and not the return, for two reasons. It is a share, so missions with much and with little data
# count alike. And no constants have to be chosen for it: a crash costs all data, and time costs nothing. It is the mean of the missions' shares: 10 of 10 and 20 of 40 units make 75 %. The *pooled* share, 30 of 50, is
# 60 %: there each data unit counts alike, and missions with much data, which are harder, weigh more.
#
# The *return* is the sum of a flight's rewards with the paper's constants (−0.2 a step, −150 for a crash),
# not discounted. The agent was trained with other constants (notebook 6), and with a discount.
#
# ### Random numbers
#
# "The same missions" takes care. It is tempting to give the uses of a run the seeds `seed`, `seed + 1`, `seed + 2`, say
# for training, validation and test. Then one use of seed 1 has the numbers of another use of seed 0:

# %%
from uavdh_lite.streams import Use, stream

def habit(use, seed):
    return np.random.default_rng(seed + use)

for generators in (habit, stream):
    validation_0, training_1 = generators(Use.VALIDATION, 0), generators(Use.TRAINING, 1)
    print(f"{generators.__name__:<7} equal: {np.array_equal(validation_0.random(9), training_1.random(9))}")

# %% [markdown]
# So the run of seed 1 would train on the missions that choose the agent of seed 0, and the "independent" runs would
# share their luck. The library makes each generator in one place (`uavdh_lite/streams.py`), from
# `SeedSequence(seed, spawn_key=(use,))`. The *spawn key* keeps the uses apart: seed and use go in as two numbers, not as
# their sum, and each pair begins a stream of its own. So no two uses share numbers, whatever the seeds.
#
# In a test, a policy that draws its actions must not share a generator with the missions, either. How many numbers it takes
# depends on the policy: a greedy one takes none, a long flight more than a short one. Then the next mission is another:

# %%
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.scenario import find_scenario

def second_mission(explored):
    shared, scenario = stream(Use.EXERCISE), find_scenario("manhattan")
    environment = Environment(City.load("manhattan"))
    scenario.sample(environment, 1, shared)
    shared.random(explored)  # what the policy takes on its first flight
    return scenario.sample(environment, 1, shared).time_left[0]

print("flying time of the second mission:", *(second_mission(explored) for explored in (0, 30, 40)))

# %% [markdown]
# Two such policies would be judged by different missions. Here all missions are drawn first, the fading is drawn for
# every mission and step whatever the policy does, and `random` has a stream of its own.
#
# | in a comparison of two ways to train | |
# | --- | --- |
# | held equal | the number of training steps, the validation and test missions, their fading, the list of seeds |
# | varied | the training seed, three times at least: first weights, training missions, exploration |
# | not to be matched | the training flights, step by step. They part as soon as the policies differ, even with a stream for each use. (In training the library does not try: a run has one stream for missions, fading and exploration) |
#
# Why equal missions? Then both ways get the same easy ones and the same hard ones. This luck cancels in the *difference*, and
# its interval gets narrower (8.6). The luck of training does not cancel, and should not: it is what the seeds are for.
#
# ## 8.2 The paper's table
#
# The paper evaluates each agent on 1000 random missions (its Table II). Ours, with 95 % intervals. (Such an interval is made by
# a rule. In 95 of 100 tests like this one, it contains the mean over all missions, of this one agent.)

# %%
from uavdh_lite.paper import RESULTS

for city, results in cities.items():
    print(city)
    for metric, paper in RESULTS[city].items():
        mean, low, high = mean_interval(results["ddqn"][metric])
        print(f"  {metric:<28}{mean:6.1%}  ({low:.1%} to {high:.1%})   paper {paper:.1%}")

# %% [markdown]
# The paper's maps were never published, and a map may be easier than another. So the table says that our agents reach
# the paper's level on maps of the same description, not that they are better. (And the paper's figures come from 1000 missions, too, so they
# have intervals of about the same width.)
#
# Three shares say more than each alone. From the paper's Manhattan column one can work out what the flights that did
# not land had collected:

# %%
landed, collected, both = (RESULTS["manhattan"][name] for name in ("landed", "collected", METRIC))
print(f"collected by those that did not land: {(collected - both) / (1 - landed):.0%}, by the others {both / landed:.0%}")
print(f"product of the two means {landed * collected:.1%}, mean of the products {both:.1%}")

# %% [markdown]
# In the paper's test the five or so flights that did not land had collected less. (With rounded shares, the figure is rough:
# anything from 20 to 70 %.) So landing and collecting go together there, and the mean of the products is above the product of
# the means. It need not be so: the one crash of our agent had collected everything (8.5).
#
# The table's intervals are of two kinds. A question about the open field's first row:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("all_landed")

# %% [markdown]
# Shares of ones, such as *has landed*, have Wilson's interval. All other means have the bootstrap's (below). For a share $p$ of
# $n$, with $z = 1.96$, Wilson's is
#
# $$\frac{p + z^2/2n \pm z\sqrt{p(1-p)/n + z^2/4n^2}}{1 + z^2/n}$$
#
# Say 995 of 1000 landed. Then $p = 0.995$, $z^2/2n = 0.0019$, the root is $\sqrt{0.000\,005 + 0.000\,001} = 0.0024$,
# and the interval goes from $(0.9969 - 0.0048)/1.0038 = 98.8\,\%$ to 99.8 %. The simple one, $p$ plus and minus 1.96
# *standard errors* $\sqrt{p(1-p)/n}$, is symmetric, and after 1000 of 1000 it says that there cannot be any crash:

# %%
for landed in (995, 999, 1000):
    share_of, low, high = wilson_interval(np.arange(1000) < landed)
    error = np.sqrt(share_of * (1 - share_of) / 1000)
    print(f"{landed} of 1000: standard error {error:.2%}, simple {share_of - 1.96 * error:.2%} to "
          f"{share_of + 1.96 * error:.2%}, Wilson {low:.2%} to {high:.2%}")

# %% [markdown]
# One agent landed in 995 of 1000 missions, another in 999 of 1000 others. Is it safer? Two tests. The first compares
# the difference with its standard error. The second is exact: six missions failed. If the agents were alike, how likely
# would it be that one agent has five of the six, or all of them?

# %%
from math import comb

z = (0.999 - 0.995) / np.sqrt(2 * 0.997 * 0.003 / 1000)  # 0.997: the share of both together
chance = np.array([comb(1000, k) * comb(1000, 6 - k) / comb(2000, 6) for k in range(7)])
p = chance[chance <= chance[5] + 1e-12].sum()
print(f"z = {z:.2f} (needs 1.96); exact p = {p:.2f} (needs 0.05)")
assert z < 1.96 and p > 0.05

# %% [markdown]
# Neither is significant. With so few failures trust the exact one (Fisher's).
#
# ### What the interval says
#
# The *bootstrap* draws 1000 missions from our 1000, with replacement, and takes the mean; again and
# again. The middle 95 % of these means are the interval. By hand:

# %%
values = cities["manhattan"]["ddqn"][METRIC]
generator = np.random.default_rng(0)
means = [values[generator.integers(0, 1000, 1000)].mean() for _ in range(2000)]
print(np.quantile(means, [0.025, 0.975]).round(4))
print(bootstrap_interval(values))

# %% [markdown]
# It covers the luck of *which missions* were drawn. It does not cover the luck of *training*: another seed gives
# another agent. That is a different question, and needs several trainings (notebook 7).
#
# ### The best of many checkpoints
#
# A run is validated again and again. What it has learned up to then is a *checkpoint*, and the one with the best validation is
# kept. Its validation figure is too high.
# To see why, take 20 checkpoints that are all *equally* good. Each gets its own luck: the results of missions drawn
# from the 1000 above. We report the best of the 20, and repeat it 500 times:

# %%
for missions in (200, 1000):
    validations = np.array([values[generator.integers(0, 1000, (20, missions))].mean(1) for _ in range(500)])
    print(f"{missions:>4} missions: all checkpoints {validations.mean():.1%}, the best {validations.max(1).mean():.1%}")
runs = read_table(RUNS / "agents.csv.gz")
best = runs[METRIC][runs["agent"] == "manhattan_ddqn"].max()
print(f"the recorded run of the DDQN agent: best validation {best:.1%}, test {values.mean():.1%}")

# %% [markdown]
# All are equal, yet the best seems better than it is: it was chosen for its luck. That the missions are random does not
# help, since the choice was made on *these*, and fits them. Only on other missions is the figure independent of the choice. So
# the test has missions of its own. (In a real run all checkpoints fly
# the same missions, so part of the luck is common; and of the last line's difference, part is simply other missions.)
#
# ## 8.3 Next to the planners
#
# All on the same missions. (*Both* is the mean of the product, landed times collected, mission by mission. An average of
# the two shares would give half a point to a flight that collects all and crashes, and half a point to one that lands at
# once with nothing.)

# %%
for city, results in cities.items():
    print(f"{city:<12}{'landed':>8}{'collected':>11}{'both':>8}{'return':>8}")
    for policy in POLICIES:
        one = results[policy]
        print(f"  {policy:<10}{one['landed'].mean():>8.1%}{one['collected'].mean():>11.1%}"
              f"{one[METRIC].mean():>8.1%}{one['return'].mean():>8.2f}")

# %% [markdown]
# There are three lessons in it.
#
# - A simple rule is strong: on Manhattan `greedy` collects significantly more than our agent (8.6), on the open field no
#   difference is to be seen. (That is about these two agents. Another training seed may give another half point.) A learner has to be very good to be worth its training, and a paper without such a baseline does not
#   show that it is.
# - More data is not always more *return*: `greedy` flies to the last unit of data whatever that costs in time. On the
#   open field the agent collects no more, but has the higher return; on Manhattan `greedy` has more of both. (The next
#   cell has the intervals.)
# - On the open field the `genie` of highest return collects *less* than `genie_data`. What is best depends
#   on what is asked for. The agent was trained with a reward, and judged by data: two different questions.
#
# (`random` lands so often because it starts in the landing zone and soon draws *land*.)

# %%
for city, results in cities.items():
    more = results["ddqn"]["return"] - results["greedy"]["return"]
    print(f"{city:<12}agent's return minus greedy's {{:+.2f}} ({{:+.2f}} to {{:+.2f}})".format(*bootstrap_interval(more)))

# %% [markdown]
# As a share of the best known: the agent's mean over the genie's, with missions resampled in pairs:

# %%
for city, results in cities.items():
    for metric, reference in ((METRIC, "genie_data"), ("return", "genie")):
        mean, low, high = share(results["ddqn"][metric], results[reference][metric])
        print(f"{city:<12}{metric:<29}{mean:6.1%} of {reference}  ({low:.1%} to {high:.1%})")

# %% [markdown]
# The genie is not an optimum. It plans with the mean channel and a limited search, so luck can let
# another policy beat it on a mission. But it is a reference that does not depend on learning.
#
# ## 8.4 Which missions go badly?
#
# A mean hides where it comes from. Split the missions by what was drawn:

# %%
results = cities["manhattan"]
BY = {"devices": "devices", "flying_time": "flying time", "data": "data, data units"}
figure = Figure(figsize=(10, 3.6), layout="constrained")
for ax, (by, label) in zip(figure.subplots(1, 3, sharey=True), BY.items()):
    for shift, policy in zip((-0.08, 0, 0.08), ("ddqn", "greedy", "genie_data")):
        names, _, means = zip(*breakdown(results[policy][METRIC], results[policy][by].round()))
        mean, low, high = np.array(means).T
        ax.errorbar(np.arange(len(mean)) + shift, mean, [mean - low, high - mean], fmt="o-", ms=4, label=policy)
    ax.set(xlabel=label, xticks=range(len(names)), xticklabels=names)
figure.axes[0].set_ylabel("collected and landed")
ax.legend()
figure

# %% [markdown]
# (The axis starts near 0.9.) How much does the agent lose against the genie, and how much against `greedy`?

# %%
for by, label in BY.items():
    print(f"\n{label:<24}against genie_data        against greedy")
    parts = (breakdown(results[reference][METRIC] - results["ddqn"][METRIC], results["ddqn"][by].round())
             for reference in ("genie_data", "greedy"))
    for (name, _, genie), (*_, greedy) in zip(*parts):
        print(f"{name:>22}", *(f"{i.mean:+z7.1%} ({i.low:+z.1%} to {i.high:+z.1%})" for i in (genie, greedy)))

# %% [markdown]
# Against the genie the agent loses most in the shortest missions, and least in long ones; the number of devices and the data make a
# difference of a point or two, which is about what the intervals allow. Against `greedy` it falls behind where `greedy` is
# next to perfect: with two devices, or little data. By flying time the groups differ no more than luck would have it. So
# what is hard is hard for both, and in easy missions the agent could do better. (Many groups are compared here: take a single
# one as a hint.)
#
# ## 8.5 Failures, one by one
#
# Take the missions in which the agent lost most against the genie, and fly them again:

# %%
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.plotting import add_legend, draw_trajectory

# %%
torch.set_num_threads(1)  # the network is small
agent = load_agent("manhattan_ddqn")
environment = Environment(agent.city)
flights = evaluate(environment, agent, agent.scenario, 1000, seed=0)
assert (flights.start.time_left == results["ddqn"]["flying_time"]).all()  # the missions of the table
lost = results["genie_data"][METRIC] - results["ddqn"][METRIC]
worst = np.argsort(lost)[::-1]
print([f"mission {m}: {lost[m]:.0%} lost" for m in worst[:5]])

# %%
figure = Figure(figsize=(11, 7.5), layout="constrained")
for ax, mission in zip(figure.subplots(1, 2), worst[:2]):
    draw_trajectory(ax, environment, flights.trajectory(int(mission)))
    ax.set_title(f"mission {mission}")
add_legend(figure, 3)  # devices
figure

# %% [markdown]
# Left, a crash. The flight collected everything, but turned for home too late. At the ring it tries to land outside the zone,
# which is refused. The two units of time that are then left do not suffice for the way and the landing. Right, one that served the near device and
# went home, though there was plenty of time for the far ones. Neither comes often. How is the loss made up over all
# missions?

# %%
landed = flights.end.landed
parts = {"crashes": ~landed, "landed, 30 points or more lost": landed & (lost >= 0.3),
         "landed, less lost": landed & (lost < 0.3) & (lost > 0), "nothing lost": landed & (lost <= 0)}
for name, own in parts.items():
    print(f"{name:<32}{own.sum():>4} missions, {lost[own].sum() / lost.sum():>z4.0%} of the loss")

# %% [markdown]
# Few missions, one in forty, make more than a third of the loss. The rest is spread over one mission in four, and in most
# missions nothing is lost. The crash, step by step:

# %%
from uavdh_lite.player import play

play(environment, flights.trajectory(int(worst[0])))

# %% [markdown]
# Watch the last data come in: by then the way home is longer than the time that is left.
#
# ## 8.6 How many missions does a claim need?
#
# The interval's half width shrinks like $1.96\,\sigma/\sqrt{N}$, where $\sigma$ is the standard deviation over
# missions:

# %%
needed = (1.96 * values.std() / 0.01) ** 2
print(f"for ± 1 point: {needed:.0f} missions, for ± half a point four times as many: {4 * needed:.0f}")

# %% [markdown]
# Two policies that fly the *same* missions can be compared in pairs. The interval of the difference is then
# narrower by as much as the two results go up and down together, their *correlation* $\rho$: the variance of a difference is
# $\sigma_1^2 + \sigma_2^2 - 2\rho\,\sigma_1\sigma_2$, and without pairs the last term is missing.

# %%
for city, results in cities.items():
    greedy, ddqn = results["greedy"][METRIC], results["ddqn"][METRIC]
    difference = greedy - ddqn
    unpaired = 1.96 * np.sqrt((greedy.var() + ddqn.var()) / 1000)
    paired = 1.96 * np.sqrt(difference.var() / 1000)
    print(f"{city:<12}greedy ahead by {difference.mean():+.4f}: unpaired ± {unpaired:.4f}, paired ± {paired:.4f}",
          "(contains 0)" if abs(difference.mean()) < paired else "(without 0)",
          f"correlation {np.corrcoef(greedy, ddqn)[0, 1]:.2f}")

# %% [markdown]
# Which collects more? Where the paired interval of the difference contains 0, these missions do not tell. Would more
# missions? Say the true lead is half a point, 0.005. There are two questions:

# %%
for city, results in cities.items():
    spread = (results["greedy"][METRIC] - results["ddqn"][METRIC]).std()
    narrow, found = (((z * spread) / 0.005) ** 2 for z in (1.96, 1.96 + 0.84))
    print(f"{city:<12}interval of ± half a point: {narrow:.0f} missions; lead found in 8 of 10 tries: {found:.0f}")

# %% [markdown]
# With the first number the interval reaches half a point to either side. That is not enough to *find* a lead of half a
# point: the measured lead falls below the true one in half of all tries, and then the interval contains 0. The chance to
# find a lead that is there is called the *power*, here 50 %. For a power of 80 % the true lead must be 1.96 + 0.84
# standard errors, since a normal variable is above −0.84 with a chance of 80 %. That takes twice the missions.

# %% [markdown]
# ## Recap
#
# - A result is a mean with an interval, over missions that neither training nor the choice of the agent saw.
# - Training, validation and test draw from streams of their own, and policies are compared on equal missions and fading.
# - Compare with something simple and with something near the optimum, on the same missions.
# - The interval over missions says nothing about another training run.
# - Fly the failures again and look. A mean does not say what went wrong.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/08_evaluation`](exercises/08_evaluation/08_evaluation.ipynb).
#
# **1.** All of 1000 missions landed. With which confidence can you say that at least 99.7 % of all missions
# do? (If the true share were 99.7 %, how likely were 1000 landings in a row?)

# %%
probability = 0.997**1000
assert np.isclose(probability, 0.0496, atol=1e-3)
print(f"such luck has a chance of {probability:.1%}, so with {1 - probability:.0%} confidence")

# %% [markdown]
# **2.** Somebody waits for *one* UAV, and needs at least half of the data. Which policy of the three, `ddqn`,
# `greedy`, `genie`, fails them how often? Does the mean tell?

# %%
fails = {p: cities["manhattan"][p][METRIC] < 0.5 for p in ("ddqn", "greedy", "genie")}
assert fails["genie"].sum() < fails["ddqn"].sum()
for p, failed in fails.items():
    share_of, low, high = mean_interval(failed.astype(float))
    print(f"{p:<8}{failed.sum()} of 1000: {share_of:.1%}  ({low:.1%} to {high:.1%})")
for other in ("greedy", "genie"):
    print(f"only the agent fails: {(fails['ddqn'] & ~fails[other]).sum()}, only {other}: {(fails[other] & ~fails['ddqn']).sum()}")

# %% [markdown]
# The mean cannot tell: such missions are too rare to move it. A thousand missions hardly tell either. The missions are the same
# for all, so what counts are those in which one fails and the other does not. Agent and greedy share them almost evenly, as a
# fair coin would. The genie fails once and the agent seven times; a coin is as uneven as that in one of fourteen tries. To know
# how often something rare happens takes many missions.

# %% [markdown]
# ## Further reading
#
# - Agarwal et al.: *Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.
# - Efron and Tibshirani: *An Introduction to the Bootstrap*, 1993.
# - Bayerlein et al., Globecom 2020, Table II.
