# %% [markdown]
# # 8 · Evaluation
#
# How good is an agent? Better than the paper's, than a simple rule, than anything could be? And how
# sure are we? This notebook regenerates the paper's table, with what it lacks: intervals, planners to
# compare with, and a look at who is left behind.

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
from matplotlib.figure import Figure

from uavdh_lite.comparison import breakdown, share
from uavdh_lite.evaluation import bootstrap_interval
from uavdh_lite.tables import read_table

RUNS = Path("../data/runs")
POLICIES = ("agent", "random", "greedy", "genie", "genie_data")

# %%
def policies(city):
    table = read_table(RUNS / f"comparison-{city}.csv.gz")
    return {p: {k: v[table["policy"] == p] for k, v in table.items()} for p in POLICIES}

cities = {city: policies(city) for city in ("manhattan", "open_field")}
METRIC = "collection_ratio_and_landed"
figure = Figure(figsize=(9, 3.4), layout="constrained")
for ax, (city, results) in zip(figure.subplots(1, 2, sharex=True), cities.items()):
    means = [bootstrap_interval(results[p][METRIC]) for p in POLICIES]
    for y, (mean, low, high) in enumerate(means):
        ax.plot([low, high], [y, y], color="#0072B2", lw=3)
        ax.plot(mean, y, "o", color="#0072B2")
    ax.set(yticks=range(5), yticklabels=POLICIES, title=city, xlabel="collected and landed")
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Compare an agent with the paper and with three planners on the same 1000 missions, find whom it leaves behind, and work out how many missions a claim needs |
# | **What you'll learn** | Monte Carlo means, bootstrap intervals, paired comparisons, and what a reference without an optimum is worth |
# | **What you'll need** | Notebooks 0 and 3, means and quantiles. 20 minutes to read, 15 seconds to run; 5 minutes of exercises |
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
# | `agent` | the maps and the remaining time, through its network |
# | `random` | nothing |
# | `greedy` | the map, and where the nearest device with data is |
# | `genie` | also the channel's mean rate at every cell; it searches over whole flights for the highest return |
# | `genie_data` | the same, but it searches for the most data and hardly minds the time |
#
# ## 8.2 The paper's table
#
# The paper evaluates each agent on 1000 random missions (its Table II). Ours, with the interval that
# holds the true mean with 95 % confidence:

# %%
from uavdh_lite.__main__ import PAPER_RESULTS

for city, results in cities.items():
    print(city)
    for metric, paper in PAPER_RESULTS[city].items():
        mean, low, high = bootstrap_interval(results["agent"][metric])
        print(f"  {metric:<28}{mean:6.1%}  ({low:.1%} to {high:.1%})   paper {paper:.1%}")

# %% [markdown]
# The paper's maps were never published, so this compares like with similar, not like with like: both
# are solutions of the same kind of task.
#
# ### What the interval says
#
# The *bootstrap* draws 1000 missions from our 1000, with replacement, and takes the mean; again and
# again. The middle 95 % of these means are the interval. By hand:

# %%
values = cities["manhattan"]["agent"][METRIC]
generator = np.random.default_rng(0)
means = [values[generator.integers(0, 1000, 1000)].mean() for _ in range(2000)]
print(np.quantile(means, [0.025, 0.975]).round(4))
print(bootstrap_interval(values))

# %% [markdown]
# It covers the luck of *which missions* were drawn. It does not cover the luck of *training*: another
# seed gives another agent. That is a different question, and needs several trainings.
#
# ## 8.3 Beside the planners
#
# All on the same missions:

# %%
for city, results in cities.items():
    print(f"{city:<12}{'landed':>8}{'collected':>11}{'both':>8}{'return':>8}")
    for policy in POLICIES:
        one = results[policy]
        print(f"  {policy:<10}{one['has_landed'].mean():>8.1%}{one['collection_ratio'].mean():>11.1%}"
              f"{one[METRIC].mean():>8.1%}{one['cumulative_reward'].mean():>8.2f}")

# %% [markdown]
# Read it slowly, it holds three lessons.
#
# - A simple rule that knows the map is strong: on both maps `greedy` collects more than our agent, which
#   beats the paper's. A learner has to be very good to be worth its training, and a paper without such a
#   baseline does not show that it is.
# - `greedy` collects much but its *return* is lower than its share of data suggests: it flies to the last
#   unit of data whatever that costs in time.
# - The `genie` of highest return collects *less* than `genie_data`. What is best depends on what is asked
#   for. The agent was trained with a reward, and judged by data: two different questions.
#
# As a share of the best known, mission by mission:

# %%
for city, results in cities.items():
    for metric, reference in ((METRIC, "genie_data"), ("cumulative_reward", "genie")):
        mean, low, high = share(results["agent"][metric], results[reference][metric])
        print(f"{city:<12}{metric:<29}{mean:6.1%} of {reference}  ({low:.1%} to {high:.1%})")

# %% [markdown]
# The genie is not an optimum. It plans with the mean channel and a limited search, so luck can let
# another policy beat it on a mission. But it is a reference that does not depend on learning.
#
# ## 8.4 Who is left behind?
#
# A mean hides who pays for it. Split the missions by what was drawn:

# %%
results = cities["manhattan"]
figure = Figure(figsize=(10, 3.4), layout="constrained")
for ax, by in zip(figure.subplots(1, 3, sharey=True), ("devices", "flying_time", "data")):
    for policy, marker in (("agent", "o"), ("greedy", "s"), ("genie_data", "^")):
        groups = breakdown(results[policy][METRIC], results[policy][by])
        ax.plot([label for label, _, _ in groups], [mean.mean for _, _, mean in groups],
                marker + "-", label=policy)
    ax.set(xlabel=by.replace("_", " "))
    ax.tick_params(axis="x", labelsize="small", rotation=20)
ax.legend()
figure.axes[0].set_ylabel("collected and landed")
figure

# %% [markdown]
# Short missions with many devices are hard for everyone, also for the genie: there is not enough time.
# What counts for the agent is the distance to the genie.
#
# ## 8.5 Failures, one by one
#
# Take the missions in which the agent lost most against the genie, and fly the worst again:

# %%
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.plotting import add_legend, draw_trajectory

agent = load_agent("manhattan")
environment = Environment(agent.city)
flights = evaluate(environment, agent, agent.scenario, 1000, seed=0, record=True)
lost = results["genie_data"][METRIC] - results["agent"][METRIC]
worst = np.argsort(lost)[::-1]
print([f"mission {m}: {lost[m]:.0%} lost" for m in worst[:5]])

# %%
figure = Figure(figsize=(11, 7.5), layout="constrained")
for ax, mission in zip(figure.subplots(1, 2), worst[:2]):
    draw_trajectory(ax, environment, flights.trajectory(int(mission)))
    ax.set_title(f"mission {mission}")
add_legend(figure, 5)
figure

# %% [markdown]
# What do you see? Is it a crash, a device that was never approached, or a device left half full? The
# next cell counts them over all missions:

# %%
landed = flights.end.landed
left = flights.end.data_left / np.maximum(flights.end.data_initial, 1e-6)
used = flights.end.data_initial > 0
print("crashed:", int((~landed).sum()), "of 1000 missions")
print(f"devices left untouched (under 5 % collected): {(left[used] > 0.95).mean():.1%}")
print(f"devices left partly full: {((left[used] > 0.05) & (left[used] <= 0.95)).mean():.1%}")

# %% [markdown]
# ## 8.6 How many missions does a claim need?
#
# The interval's half width shrinks like $1.96\,\sigma/\sqrt{N}$, where $\sigma$ is the standard deviation over
# missions:

# %%
sizes = np.array([30, 100, 300, 1000])
half = [np.ptp(bootstrap_interval(values[:n])[1:]) / 2 for n in sizes]
figure = Figure(figsize=(5.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.loglog(sizes, half, "o", label="bootstrap")
ax.loglog(sizes, 1.96 * values.std() / np.sqrt(sizes), label="1.96 σ / √N")
ax.set(xlabel="missions", ylabel="half width of the interval")
ax.legend()
needed = (1.96 * values.std() / 0.01) ** 2
print(f"for ± 1 point: {needed:.0f} missions")
figure

# %% [markdown]
# So two agents that differ by half a point on 1000 missions are not shown to differ, unless they flew
# the *same* missions. Pairing takes the luck of the draw out:

# %%
difference = results["greedy"][METRIC] - results["agent"][METRIC]
print("paired:  ", [round(float(x), 4) for x in bootstrap_interval(difference)])
spread = np.sqrt(results["greedy"][METRIC].var() + values.var()) * 1.96 / np.sqrt(1000)
print(f"unpaired: ± {spread:.4f} around the same mean")

# %% [markdown]
# ## Recap
#
# - A result is a mean with an interval, over missions that training never saw.
# - Compare with something simple and with something near the optimum, on the same missions.
# - The interval over missions says nothing about another training run.
#
# ## Exercises
#
# **1.** All of 1000 missions landed. With which confidence can you say that at least 99.7 % of all missions
# do? (If the true share were 99.7 %, how likely were 1000 landings in a row?)

# %%
probability = 0.997**1000
assert np.isclose(probability, 0.0496, atol=1e-3)
print(f"such luck has a chance of {probability:.1%}, so with {1 - probability:.0%} confidence")

# %% [markdown]
# **2.** Which policy has the largest spread over missions, and why is a large spread bad news for
# somebody who waits for *one* UAV?

# %%
spread = {p: float(cities["manhattan"][p][METRIC].std()) for p in POLICIES}
assert max(spread, key=spread.get) != "genie_data"
print({p: round(s, 3) for p, s in spread.items()})

# %% [markdown]
# ## Further reading
#
# - Agarwal et al.: *Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.
# - Efron and Tibshirani: *An Introduction to the Bootstrap*, 1993.
# - Bayerlein et al., Globecom 2020, Table II.
