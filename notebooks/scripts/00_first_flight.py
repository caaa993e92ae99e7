# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 0 · First flight
#
# **Five devices hold data. A drone has 67 units of time to collect their data and get home. Who
# decides where it flies?**
#
# Here a neural network does. Nobody gave it a route. The picture below shows one of its flights;
# section 0.2 explains how to read it.

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
import torch

from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import trajectory_figure
from uavdh_lite.policies import find_policy

torch.set_num_threads(1)  # quickest for a small network
environment = environment_of("manhattan")
agent = find_policy("manhattan_ddqn", environment)
mission = Mission.draw(agent.scenario, environment.city, seed=91)
flights = mission.fly(environment, agent)
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Watch an agent fly, set missions, and race it against two simple pilots |
# | **What you'll learn** | The task, how to read a flight, how good a pilot is, and why one would train one |
# | **What you'll need** | Python. 40 minutes to read, 20 seconds to run; 25 minutes of exercises |
#
# ## 0.1 The task
#
# The drone is a *UAV*, an unmanned aerial vehicle. It flies 10 m above the ground, over a city of
# square cells. Sensors on the ground, the *devices*, hold data and send it to the UAV by radio.
# Buildings weaken the signal.
#
# The UAV starts in a landing zone and has a limited *flying time*. Its six actions are to move one
# cell north, east, south or west, to hover, and to land; each takes one unit of time. The aim is to
# collect as much data as possible and to land before the time runs out; otherwise the UAV
# *crashes*.
#
# Flying right up to every device wastes time, because a radio signal carries far along an open
# street. Waiting at a distance wastes time, too, because from there the data comes in slowly. The
# best compromise depends on the *mission*: a mission says where the devices are and how much data
# they hold, where the UAV starts, and how much flying time it has.
#
# A program that chooses one action after another is called an *agent*. This one chooses with a
# neural network, a formula with hundreds of thousands of adjustable numbers, its **weights**. They
# were *trained*: the agent flew random missions, two million steps in all, and after each step
# received a *reward*, large if a lot of data came in, slightly negative if it flew on without any,
# and strongly negative if the UAV crashed. The weights were adjusted to predict how much reward
# each action would lead to. Learning of this kind, by trial and error, is called **reinforcement
# learning**.
#
# This agent, `manhattan_ddqn`, was trained with the method that the course teaches, the *double
# deep Q-network*, or **DDQN**, so we call it the **DDQN agent**. The method is that of a 2020
# article by Bayerlein and others, *the paper*, strengthened (notebook 7).
#
# ## 0.2 Reading a flight
#
# Now watch the same flight. Press play or drag the slider:

# %%
from uavdh_lite.player import play

play(environment, flights.trajectory(0))

# %% [markdown]
# Go back to the still picture at the top. It shows the city from above. Each cell is 10 m wide.
#
# - The white **triangle** marks the start, and the **diamond** marks the landing. Both lie in blue
#   landing zones.
# - Each **cross** is a device. The number beside it says how many data units the device holds at
#   the start. (In the player, the number on a device is its name.)
# - Each **arrow** is one step, which takes one unit of time. Its colour shows which device sent the
#   most data during that step; black means that no device sent anything. A **ring** marks hovering.
# - A **thick** arrow means a lot of data.
# - **Violet** cells lie in the radio shadow of buildings. The deeper the violet, the more devices
#   are hidden from the cell.
#
# Follow the arrows. Does the agent fly over every device, or does it empty some in passing, from a
# distance? Where does it turn back?
#
# Here is the same flight in numbers:

# %%
for name, values in flights.records().items():
    print(f"{name:<22}{values[0]:8.2f}")

# %% [markdown]
# These six *metrics* describe every flight in this course.
#
# | metric | meaning |
# | --- | --- |
# | `landed` | 1 if the UAV landed in time, else 0 |
# | `collected` | the collected share of all data, from 0 to 1 |
# | `collected_and_landed` | `landed` times `collected` |
# | `return` | the sum of all rewards: data collected, minus 0.2 for each step except the landing, minus penalties |
# | `time_used` | the share of the flying time that was used |
# | `safety_interventions` | how often a forbidden action was refused |
#
# The score to watch is `collected_and_landed`, because data that goes down with the UAV counts for
# nothing.
#
# If the UAV tries to leave the map, to fly into a tall building or a no-fly zone, or to land
# outside the landing zones, the *safety controller* makes it hover instead (notebook 3).
#
# ## 0.3 Set a mission yourself
#
# A mission over this city has two to five devices, each with 5 to 20 data units (notebook 1 defines
# the unit), and 35 to 70 units of time. Everything is drawn at random, also the start, which is one
# of the eight landing cells. The agent flies any such mission without further training.
#
# Put three devices in any three cells, except on buildings and in landing zones. A position is a
# row and a column, counted from 0 at the top left corner:

# %%
devices, data = ((0, 12), (8, 1), (12, 14)), (12, 15, 18)
relaxed = Mission(environment.city, (0, 0), devices, data, flying_time=70)
flights = relaxed.fly(environment, agent)
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# Now we halve the flying time. Make your prediction before you fly the mission:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("half_the_time")

# %%
from dataclasses import replace

hurried = replace(relaxed, flying_time=35)
flights = hurried.fly(environment, agent)
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# The route begins like the old one, but it is not merely cut short: it continues along different
# streets and ends in the other landing zone. Which device does the agent give up? Look for the
# colour whose arrows are all thin. Nobody wrote a rule for this. The time left is one of the things
# that the agent sees, and training has taught it what to do when time is short.
#
# ## 0.4 Two pilots for comparison
#
# Was that a good flight? A score means little without a comparison, so in this course two simple
# pilots fly the same missions as the agent.
#
# - **greedy** flies to the nearest device that still has data. When none has, or time just suffices
#   to get home, it turns back. It does not learn; it was given a street map and this rule.
# - **random** picks one of the six actions at random.
#
# Now all three pilots fly the hurried mission. Press play:

# %%
names = ("manhattan_ddqn", "greedy", "random")
pilots = {name: find_policy(name, environment) for name in names}
flown = {name: hurried.fly(environment, pilot) for name, pilot in pilots.items()}
play(environment, {name: each.trajectory(0) for name, each in flown.items()})

# %%
for name, each in flown.items():
    print(f"{name:<16}collected {each.end.collected[0]:.0%} in {each.steps[0]} steps")

# %% [markdown]
# Greedy's order of visits hardly depends on the flying time. The random pilot lands as soon as it
# happens to draw `land` in the right place.
#
# One flight proves nothing, though: in other missions, greedy beats the agent. A fair race needs
# many missions, the same for all three pilots.
#
# ## 0.5 Two thousand missions
#
# First make a guess:

# %%
Quiz("random_lands")

# %%
from uavdh_lite.evaluation import evaluate

flown = {
    name: evaluate(environment, pilot, agent.scenario, episodes=2000, seed=0)
    for name, pilot in pilots.items()
}

# %%
scores = {name: each.records() for name, each in flown.items()}
print(" " * 22, *(f"{name:>14}" for name in scores))
for metric in scores["random"]:
    print(f"{metric:<22}", *(f"{each[metric].mean():14.3f}" for each in scores.values()))

# %% [markdown]
# Read the columns of this table from right to left.
#
# **The random pilot** lands in most missions, and yet it is useless: it lands with hardly any data.
#
# **Greedy** never crashes, because its rule takes it home in time, and it collects nearly
# everything.
#
# **The DDQN agent** comes close to greedy but does not overtake it. (In the 1000 missions of
# notebook 8 it does worse than here; 8.3 says how far to trust such a result.) But greedy was
# given the shortest routes, and a rule that a person had thought up. Nobody told the agent what the
# map means. Its network started with random weights, and from rewards alone it has learned to fly
# to data, to turn back and to land, in *this* city.
#
# A simple rule, then, beats a network that took two million steps to train. **Why learn at all?**
# Keep this question in mind until section 9.5.
#
# A mean hides a lot, so look at single flights, too. This is the first that brought nothing home:

# %%
worst = scores["manhattan_ddqn"]["collected_and_landed"].argmin()
trajectory_figure(environment, flown["manhattan_ddqn"].trajectory(worst))

# %% [markdown]
# The agent collects three quarters of the data. Then it tries again and again to leave the map in
# the east, which the safety controller refuses, until the time is up and the UAV crashes. Nobody
# can read off the network why. Seven of the two thousand flights ended in a crash.
#
# What if there had been none? That would not have proved that the agent always lands. By the **rule
# of three**, after $n$ missions without a crash, the true share of crashes may still be as large as
# $3/n$ (at 95 % confidence), 0.15 % here.
#
# ## 0.6 What the agent knows
#
# The agent sees the map of the city, its own position, the devices, their data and the time left.
# It does not see the violet shadows, nor does it know the formulas of the radio channel. It makes
# no plan: at every step it asks afresh which action looks most promising.
#
# For each action its network gives a number, the **Q-value**: the sum of the rewards that it
# expects from now on if the agent takes that action and flies well afterwards. Later rewards count
# less in this sum. Here are the Q-values at the start of the first mission:

# %%
from uavdh_lite.environment import ACTIONS

q_values = agent.q_values(mission.state)[0]
for action, value in zip(ACTIONS, q_values):
    print(f"{action:<6}{value:7.1f}", "  ◀ taken" if value == q_values.max() else "")

# %% [markdown]
# These six numbers are the network's whole output. Notebook 6 is about how it learns them.
#
# In the *labs*, interactive pages that `python -m
# uavdh_lite app` opens in a browser, you can fly against the agent with the arrow keys.
#
# ## Recap
#
# - The task is to collect as much data as possible and to land before the flying time runs out.
# - One network flies every mission over this city, and may change its route when time is short.
# - `collected_and_landed` is the score: data counts only if the UAV lands.
# - A comparison needs rivals and many missions.
#
# ## Exercises
#
# The exercises of this notebook, with checks and hints, are in
# [`exercises/00_first_flight`](exercises/00_first_flight/00_first_flight.ipynb).
#
# ## Further reading
#
# Bayerlein, Theile, Caccamo, Gesbert: *UAV Path Planning for Wireless Data Harvesting: A Deep
# Reinforcement Learning Approach*, Globecom 2020,
# [arXiv 2007.00544](https://arxiv.org/abs/2007.00544).
