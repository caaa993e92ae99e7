# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 10 · Evaluation
#
# In 1000 missions the agent brings home 96 % of the data. **Is that good? How sure can you be? And what does a mean hide?** The picture
# gives part of the answer. It shows the agent beside a simple rule and a search that knows the channel, each with a 95 % interval.

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

# %% jupyter={"source_hidden": true} tags=["hide-input"]
# %matplotlib inline
from matplotlib.figure import Figure

from uavdh_lite.evaluation import mean_interval
from uavdh_lite.plotting import BLUE
from uavdh_lite.storage import data_folder, read_table

figure = Figure(figsize=(8, 2.2), layout="constrained")
for ax, city in zip(figure.subplots(1, 2, sharey=True), ("manhattan", "open_field")):
    table = read_table(data_folder() / f"runs/comparison-{city}.csv.gz")
    for policy in ("genie_data", "greedy", f"{city}_ddqn"):
        mean, low, high = mean_interval(table["collected_and_landed"][table["policy"] == policy])
        name = {"genie_data": "genie", "greedy": "greedy"}.get(policy, "DDQN agent")
        ax.errorbar(mean, name, xerr=[[mean - low], [high - mean]], fmt="o", capsize=4, color=BLUE)
    ax.set(title=city, xlabel="collected and landed", xlim=(0.915, 1))
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Compare the agent with the paper's and, on the same 1000 missions, with a random pilot and two planners; find the missions in which the agent falls behind; fly one mission again with different luck |
# | **What you'll learn** | Random streams, Wilson's interval, why the best checkpoint looks too good, how many missions a claim needs |
# | **What you'll need** | Notebooks 3, 7 and 8. 55 minutes to read, 20 seconds to run; 24 minutes of exercises |
#
# ## 10.1 Where the numbers come from
#
# Most of the flights in this notebook were recorded beforehand. Four policies flew the same 1000
# missions over each of two cities, with the same fading:
#
# | policy | what it knows |
# | --- | --- |
# | the DDQN agent, *the agent* for short | the map, the devices, their data and the time left. It learned what to do with a strengthened form of the paper's method |
# | greedy | the same. A person wrote its rule: fly to the nearest device with data, and be home in time |
# | genie | the same, plus the rate without fading between every cell and every device. It searches among whole flights for the one that brings home the most data |
# | random | nothing. It picks its actions at random |
#
# Each city has a DDQN agent of its own: `manhattan_ddqn`, which you know from the course, and
# `open_field_ddqn`.

# %%
import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.evaluation import bootstrap_interval, evaluate, mean_interval, wilson_interval
from uavdh_lite.storage import data_folder, read_table

torch.set_num_threads(1)  # the networks are small
BOTH = "collected_and_landed"

def recorded(city):
    table = read_table(data_folder() / f"runs/comparison-{city}.csv.gz")
    names = {"agent": f"{city}_ddqn", "greedy": "greedy", "genie": "genie_data", "random": "random"}
    rows = {name: table["policy"] == own for name, own in names.items()}
    return {name: {k: v[own] for k, v in table.items()} for name, own in rows.items()}

cities = {city: recorded(city) for city in ("manhattan", "open_field")}

# %% [markdown]
# The score is *collected and landed*: the share of the data that a flight brings home, or 0 after a
# crash. Unlike the *return*, it does not depend on penalties that somebody chose, such as the 0.2
# for a step and the 150 for a crash in notebook 3.
#
# ### Random numbers
#
# A test is worth nothing if its missions were seen in training, so training, validation and test each need random numbers of their own. A
# common habit is to seed them with `seed`, `seed + 1` and `seed + 2`. Compare the validation numbers of seed 0 with the training numbers of
# seed 1, drawn first in this way and then with our `stream`:

# %%
from uavdh_lite.streams import Use, stream

def habit(use, seed):
    return np.random.default_rng(seed + use)

for way in (habit, stream):
    validation, training = way(Use.VALIDATION, 0), way(Use.TRAINING, 1)
    equal = np.array_equal(validation.random(9), training.random(9))
    print(f"{way.__name__:<7} equal numbers: {equal}")

# %% [markdown]
# With this habit, the run with seed 1 draws its training missions from the very numbers from which
# the missions that choose the agent of seed 0 are drawn, and two runs that should be independent
# may share their luck.
#
# The library makes the generators for training, validation and test with `stream(use, seed)`. The use and the seed go into numpy's `SeedSequence` as two
# separate numbers and are never added, so no two of these uses share a stream, whatever the seeds.
#
# A second mistake is subtler. If a policy drew its actions from the generator that also draws the
# missions, a long flight would use up more numbers than a short one, so the next mission would depend
# on the flight before it. That is why all missions here are drawn beforehand, and why the fading is
# drawn for every mission in every step, whatever the policy does.
#
# ## 10.2 The paper's table
#
# The paper flies 1000 random missions with each agent and reports three shares. Here are ours with 95 % intervals, beside the
# paper's:

# %%
from uavdh_lite.paper import RESULTS

for city, results in cities.items():
    for metric, paper in RESULTS[city].items():
        mean, low, high = mean_interval(results["agent"][metric])
        print(f"{city:<11}{metric:<21}{mean:7.1%} ({low:.1%} to {high:.1%})  paper {paper:.1%}")

# %% [markdown]
# Our shares are above the paper's, except that our agent lands a little less often over the open field. Are our agents better?
# The table cannot say, because the paper's maps were never published as files. Ours, redrawn from the paper's text, may be easier than the
# originals. What the table does say is that, on maps that fit the same description, a strengthened form of the
# method reaches the paper's level.
#
# ### What the three shares tell you
#
# Take the paper's numbers for Manhattan: 99.5 % landed, 94.8 % collected, 94.6 % both. The
# difference between the last two is data that was collected and then lost in a crash. Divide this difference by the share of flights that
# crashed:

# %%
landed, collected, both = RESULTS["manhattan"].values()
print(f"the flights that crashed had collected {(collected - both) / (1 - landed):.0%}")
print(f"the flights that landed had collected  {both / landed:.0%}")

# %% [markdown]
# In the paper's own test, the flights that crashed had collected about 40 % of their data. The
# paper does not report this number, and it is rough: with shares rounded to a tenth of a percent,
# anything from 18 to 67 % is possible. Even so, it is far below the 95 % of the other flights, so
# staying out for the last bit of data cannot explain all of those crashes.
#
# ### If all of them land
#
# A few flights of each agent crashed. Suppose that none had. What could you conclude from 1000
# landings in a row?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("all_landed")

# %% [markdown]
# For a share $p$ of $n$ missions, the simple interval, called the **Wald interval**, is $p$ plus or
# minus 1.96 standard errors $\sqrt{p(1-p)/n}$. At $p = 1$ the standard error is 0, so this interval
# says that a crash is impossible. *Wilson's* interval asks instead: for which true shares would
# this result be no surprise? With $z = 1.96$ the answer is
#
# $$\frac{p + z^2/2n \pm z\sqrt{p(1-p)/n + z^2/4n^2}}{1 + z^2/n}$$
#
# Here are both intervals for three results:

# %%
for count in (995, 999, 1000):
    share, low, high = wilson_interval(np.arange(1000) < count)
    error = 1.96 * np.sqrt(share * (1 - share) / 1000)
    simple = f"{share - error:.2%} to {share + error:.2%}"
    print(f"{count:>4} landed: simple {simple:<19} Wilson {low:.2%} to {high:.2%}")

# %% [markdown]
# The simple interval goes past 100 % in the second line and shrinks to a point in the third. Wilson's does neither: after 1000
# landings it says that the share is at least 99.6 %.
#
# Scores that are more than a yes or no, such as *collected*, get their intervals from the **bootstrap** (drawing results again, with replacement). Both kinds of interval allow
# for luck in the missions, but not for luck in training. For a claim about a *method*, the sample has to consist of training runs.
#
# ## 10.3 Next to the planners
#
# Is 96 % good? Compare the agent with a simple policy and with one that is close to the best
# possible.

# %%
for city, results in cities.items():
    for policy, one in results.items():
        means = [f"{metric} {one[metric].mean():6.1%}" for metric in ("landed", "collected", BOTH)]
        print(f"{city:<11}{policy:<8}", *means, f"return {one['return'].mean():6.2f}", sep="  ")

# %% [markdown]
# Greedy does about as well as the trained network. A paper without such a baseline does not show
# that its agent was worth the training. Which of the two is ahead? The paired differences answer
# that:

# %%
for city, results in cities.items():
    for metric in (BOTH, "return"):
        lead = results["agent"][metric] - results["greedy"][metric]
        mean, low, high = bootstrap_interval(lead)
        print(f"{city:<11}{metric:<21}agent - greedy {mean:+.3f} ({low:+.3f} to {high:+.3f})")

# %% [markdown]
# Over Manhattan, greedy is ahead on both scores, and neither interval contains 0. (In 10,000 other
# missions, seeds 1 to 10, its lead is 1.28 points in the share brought home, and 0.72 units in
# return.) Over the open field, greedy brings home three percentage points more, but by return these
# missions do not say who is ahead: the agent crashes now and then, but wastes less time, whereas
# greedy stays for the last unit of data at any cost. Which of them is better therefore depends on
# the question.
#
# ## 10.4 The best of many checkpoints
#
# While an agent learns, it is validated again and again. The network as it stands at such a moment
# is called a *checkpoint*, and the best checkpoint is kept. But its validation score flatters it.
# To see why, imagine 20 equally good checkpoints. Each flies missions of its own, drawn from the
# 1000 above, and you report the best of the 20 scores. Repeat that 300 times:

# %%
values = cities["manhattan"]["agent"][BOTH]
generator = np.random.default_rng(0)
for missions in (200, 1000):
    scores = generator.choice(values, (300, 20, missions)).mean(2)
    print(f"{missions:>4} missions: true mean {values.mean():.1%}, best {scores.max(1).mean():.1%}")

# %% [markdown]
# All checkpoints are equally good, and yet the best one seems better than it is, because it was
# chosen for its luck. With 200 missions this illusion, a **selection bias**, amounts to more than a
# percentage point here. More missions shrink it, but do not remove it. What helps is another set of
# missions, one that had no say in the choice. That is why validation and test are two different
# streams.
#
# ## 10.5 Which missions go badly?
#
# Split the missions by their flying time or by their number of devices, and see how far the agent
# is behind the genie and behind greedy in each group:

# %%
from uavdh_lite.experiments.comparison import breakdown
from uavdh_lite.plotting import BLUE, ORANGE

city = cities["manhattan"]
figure = Figure(figsize=(8, 3), layout="constrained")
for ax, by in zip(figure.subplots(1, 2, sharey=True), ("flying_time", "devices")):
    for reference, colour in (("genie", BLUE), ("greedy", ORANGE)):
        behind = 100 * (city[reference][BOTH] - city["agent"][BOTH])
        for label, _, (mean, low, high) in breakdown(behind, city["agent"][by]):
            ax.errorbar(label, mean, [[mean - low], [high - mean]], fmt="o", color=colour)
    ax.axhline(0, color="black", lw=1)
    ax.set(xlabel=by.replace("_", " "))
figure.axes[0].set_ylabel("points behind\ngenie (blue), greedy (orange)")
figure

# %% [markdown]
# On the left, the agent is furthest behind the genie where the flying time is short. Greedy has the
# same trouble: the orange points do not fall from left to right as the blue ones do. A likely reason
# is that, when time is short, a detour to the wrong device cannot be made up for, and only the genie
# knows beforehand what a device will yield.
#
# On the right, the agent is behind greedy by one to two points, however many devices there are. The
# intervals overlap, so this split explains nothing.
#
# ## 10.6 Failures, one by one
#
# To see *what* goes wrong, fly the worst missions again, those in which the agent is furthest behind the genie:

# %%
from uavdh_lite.checkpoint import load_agent

agent = load_agent("manhattan_ddqn")
flights = evaluate(agent.environment, agent, agent.scenario, 1000, seed=0)
lost = city["genie"][BOTH] - city["agent"][BOTH]
worst = np.argsort(-lost)[[0, 2]]

# %%
from uavdh_lite.plotting import add_legend, draw_trajectory

figure = Figure(figsize=(10, 7), layout="constrained")
for ax, mission in zip(figure.subplots(1, 2), worst):
    draw_trajectory(ax, agent.environment, flights.trajectory(mission))
    ax.set_title(f"{lost[mission]:.0%} lost")
add_legend(figure, 3)
figure

# %% [markdown]
# On the left is one of the two crashes in a thousand missions. The UAV empties all of its five
# devices, but turns for home too late. On the right the UAV serves two devices near the corner where
# it started and goes home, although there is time left for the others, which hold most of the data.
# Watch the crash step by step. In row 14, column 5, the UAV has 10 units of time left, just enough
# for the way home. But it flies one cell further south, for the last data of the blue device, and
# from there the way home takes 10 units, too:

# %%
from uavdh_lite.player import play

play(agent.environment, flights.trajectory(worst[0]))

# %% [markdown]
# How much do such flights matter?

# %%
lead = np.sort(city["greedy"][BOTH] - city["agent"][BOTH])
print(f"greedy's lead: {lead.mean():.2%}")
print(f"without the twenty missions where it is largest: {lead[:-20].mean():.2%}")

# %% [markdown]
# A mean of 96 % does not stand for a thousand flights that bring home 96 % each: without twenty of
# them, greedy's lead would be less than half as large.
#
# ## 10.7 How many missions does a claim need?
#
# An interval shrinks with the square root of the number of missions, so halving it takes four times as many missions. If $\sigma$ is the
# standard deviation over missions, the half-width is $1.96\,\sigma/\sqrt{n}$, so a half-width of $h$ requires $n = (1.96\,\sigma/h)^2$
# missions. Say you want to know greedy's lead over the agent to within half a percentage point:

# %%
for name, results in cities.items():
    greedy, own = results["greedy"][BOTH], results["agent"][BOTH]
    apart, paired = greedy.var() + own.var(), (greedy - own).var()
    needed = [(1.96 / 0.005) ** 2 * variance for variance in (apart, paired)]
    print(f"{name:<11}missions of their own {needed[0]:5.0f}, the same missions {needed[1]:5.0f}")

# %% [markdown]
# Flying both policies on the same missions saves more than half of them, because what is hard for
# one policy is hard for the other, and this cancels out in the difference.
#
# Is a half-width of half a point enough to *find* a lead of half a point? Only in half of all
# tries. The measured lead falls below the true one as often as above it, and whenever it falls
# below, the interval contains 0. To find such a lead in eight out of ten tries, that is, with a
# **power** of 80 %, takes twice as many missions.
#
# ## 10.8 The same mission with different luck
#
# Fading is luck, too. How much of a result is due to it? Here is one mission with five devices, flown with 40 draws of the fading:

# %%
from dataclasses import replace

from uavdh_lite.missions import Mission

def with_luck(mission, pilot, draws):
    flown = [replace(mission, seed=seed).fly(pilot.environment, pilot) for seed in range(draws)]
    home = [float(flight.end.collected[0] * flight.end.landed[0]) for flight in flown]
    steps = [int(flight.steps[0]) for flight in flown]
    print(f"brought home {min(home):.0%} to {max(home):.0%} in {min(steps)} to {max(steps)} steps")
    return flown

places = ((4, 8), (11, 8), (7, 14), (8, 1), (0, 12))
first, second, *_ = with_luck(Mission(agent.city, (0, 0), places, (18,) * 5, 60), agent, 40)

# %%
play(agent.environment, {"one draw": first.trajectory(0), "another": second.trajectory(0)})

# %% [markdown]
# These two flights part after a third of their time, and the 40 draws give 32 different paths. Yet luck makes little difference to what is brought
# home here, because the time is long enough. With 50 units of time instead of 60, four of the first 20 draws end in a crash, and the others bring
# home up to 98 %.
#
# ## 10.9 One thing changed
#
# The paper shows its open-field agent in two missions that differ in only one thing. In the first, both devices hold the same
# amount of data. In the second, the far one holds only a quarter of that. Guess how the flight changes:

# %%
Quiz("one_quarter")

# %%
pilot = load_agent("open_field_ddqn")
equal = Mission(pilot.city, (14, 1), ((6, 3), (10, 12)), (20, 20), 45, max_devices=2)
missions = {"equal data": equal, "a quarter at the far device": equal.fill(1, 5)}
flown = {name: with_luck(mission, pilot, 20) for name, mission in missions.items()}

# %%
figure = Figure(figsize=(10, 7), layout="constrained")
for ax, (name, draws) in zip(figure.subplots(1, 2), flown.items()):
    draw_trajectory(ax, pilot.environment, draws[0].trajectory(0)).set_title(name)
add_legend(figure, 2)
figure

# %% [markdown]
# Both times the UAV empties the near device first. With equal data it then flies right up to the far
# one; with only a quarter of the data there, it takes what it hears on the way and goes home. In all
# 20 draws, the flight with a quarter of the data is the shorter one.
#
# More: [Before you believe a surprise](../docs/tutorials/surprises.md).
#
# ## Recap
#
# - A result is a mean with an interval, over missions that were not used before.
# - Training, validation and test each draw their missions from a separate stream of random numbers.
# - Compare your agent with something simple and with something nearly perfect, on the same
#   missions.
# - The best of many checkpoints looks better than it is.
# - A mean does not say what goes wrong. Fly the failures again and look.
#
# ## Exercises
#
# The exercises of this notebook are in [`exercises/10_evaluation`](exercises/10_evaluation/10_evaluation.ipynb).
#
# ## Further reading
#
# - Agarwal et al.: *Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.
# - Efron and Tibshirani: *An Introduction to the Bootstrap*, 1993.
