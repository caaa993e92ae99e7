# %% [markdown]
# # 0 · First flight
#
# **Five devices have data to send. A drone has 64 units of time to collect it and get home. Who decides where it
# flies?**
#
# Here a neural network does. Nobody told it a route. The code below loads it, gives it a mission, and plays the flight.
# Run it, then press play or drag the slider.

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
import torch

from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.player import play
from uavdh_lite.policies import find_policy

torch.set_num_threads(1)  # quickest for a small network
environment = environment_of("manhattan")
agent = find_policy("manhattan_ddqn", environment)
mission = Mission.draw(agent.scenario, environment.city, seed=91)
flights = mission.fly(environment, agent)
play(environment, flights.trajectory(0))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Watch a trained agent fly, set missions of your own, and race it against two simple pilots |
# | **What you'll learn** | What the task is, how to read a flight, and six numbers that say how good a pilot is |
# | **What you'll need** | Python. 40 minutes to read, 20 seconds to run; 25 minutes of exercises |
#
# ## 0.1 The task
#
# The drone is a *UAV*, an unmanned aerial vehicle. It flies 10 m above a city. Sensors on the ground, the *devices*, hold
# data and send it to the UAV by radio. Buildings block the radio.
#
# The UAV starts in a landing zone with a limited *flying time*. It has six actions: fly one cell north, east, south or
# west, hover, or land. Each takes one unit of time. The aim is to collect as much data as possible and to land before
# the time runs out. If it runs out in the air, the UAV *crashes*.
#
# Flying up to every device wastes time, because radio reaches far down an open street. Waiting at a distance wastes time
# too, because a distant link is slow. The best route lies in between, and it is different for every mission.
#
# A program that chooses one action after another is called an *agent*. The one above chooses with a neural network, a
# formula with hundreds of thousands of adjustable numbers. These numbers were *trained*: the agent flew random missions,
# 3.6 million steps in all, and the numbers were adjusted to predict what each action will bring, with later rewards
# counting less. That took less than an hour on one processor core.
#
# Its full name is `manhattan_ddqn`. In this course it is simply **the agent**. The library has others. We use this one
# because it was trained with the method that the course teaches, from an article by Bayerlein and others, 2020, which we
# call *the paper*.
#
# ## 0.2 Reading a flight
#
# Here is the same flight as a still picture. All flights in this course are drawn like this:

# %%
from uavdh_lite.plotting import trajectory_figure

trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# The map shows the city from above. Each cell is 10 m wide.
#
# - The white **triangle** is the start, the **diamond** the landing. Both lie in the blue landing zones.
# - Each **cross** is a device. The number beside it is the data it holds at the start. In the player above, the number
#   on a device is its name.
# - Each **arrow** is one unit of time. Its colour names the device that sent most during that step. Black means that
#   no device sent. A **ring** marks hovering.
# - A **thick** arrow means a lot of data, a thin one only a little.
# - **Violet** cells lie in the radio shadow of buildings. The deeper the violet, the more devices are hidden there.
#
# Follow the arrows. The agent empties device 3, the pink one, from a distance: it turns round four rows before it gets there.
# It lands in the other zone, because the last of the data lies that way.
#
# The flight in numbers:

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
# | `collected_and_landed` | the product of these two |
# | `return` | the sum of all rewards: data collected, minus a price for each step, minus penalties |
# | `time_used` | the share of the flying time that was used |
# | `safety_interventions` | how often a forbidden action was refused |
#
# The score to watch is `collected_and_landed`. Data that goes down with the UAV counts for nothing. The return would not
# be a fair score: it is large whenever a mission offers a lot of data, and it depends on penalties that people chose.
#
# The UAV may not leave the map, enter a tall building or a no-fly zone, or land outside the landing zones. If it tries,
# the *safety controller* makes it hover instead. Notebook 3 comes back to it, and to the rewards.
#
# ## 0.3 Set a mission yourself
#
# A mission over this city has two to five devices and 35 to 70 units of time. Each device holds 5 to 20 data units. All
# of this is drawn at random, and so are the places of the devices and the start, one of the eight landing cells. The
# agent flies any such mission without more training.
#
# Put three devices where you like. A place is a pair, row and column, counted from the top left corner:

# %%
devices, data = ((0, 12), (8, 1), (12, 14)), (12, 15, 18)
relaxed = Mission(environment.city, (0, 0), devices, data, flying_time=70)
flights = relaxed.fly(environment, agent)
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# The agent collects everything and has time to spare. It serves the blue device first, and turns round as soon as that
# device is empty, without ever flying over it.
#
# Now halve the time. Make your prediction before you run the next cell:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("half_the_time")

# %%
from dataclasses import replace

hurried = replace(relaxed, flying_time=35)
flights = hurried.fly(environment, agent)
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# This is a new route, not the old one cut short. The agent empties the blue and the green device and lands in the far
# corner in time. It gives up on the orange one: the few orange arrows are thin, and hardly any data comes in there.
# Nobody wrote a rule for that. The time left is one of the things it sees, and training has taught it what to do when
# there is little.
#
# Change the devices, the data or the time in the cells above and run them again.
#
# ## 0.4 Two pilots for comparison
#
# Is that good? A number alone means little. So two simple pilots fly beside the agent throughout the course.
#
# - **greedy** flies to the nearest device that still has data. When it has just enough time to get home, it turns back.
#   It does not learn. It was given a street map and this rule.
# - **random** picks one of the six actions at random, again and again.
#
# All three fly the hurried mission. Press play:

# %%
names = ("manhattan_ddqn", "greedy", "random")
pilots = {name: find_policy(name, environment) for name in names}
flown = {name: hurried.fly(environment, pilot) for name, pilot in pilots.items()}
play(environment, {name: each.trajectory(0) for name, each in flown.items()})

# %%
for name, each in flown.items():
    print(f"{name:<16}collected {each.end.collected[0]:.0%} in {each.steps[0]} steps")
assert flown["manhattan_ddqn"].end.collected > flown["greedy"].end.collected + 0.05

# %% [markdown]
# Greedy flies to the blue device, back, and on to the orange one. Then its rule sends it home, and the green device is
# never visited. The agent's route suits the time better. The random pilot lands almost at once.
#
# One flight proves nothing, though. We picked this mission, and in others greedy wins. A fair race needs many missions,
# drawn at random and the same for all three.
#
# ## 0.5 Two thousand missions
#
# First a guess:

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
# Notebook 7 flies other missions, so its numbers differ a little. Read the columns from right to left.
#
# **Random** lands in most missions, and yet it is useless: it lands with hardly any data. A high `landed` alone says
# little. `collected_and_landed` shows it.
#
# **Greedy** never crashes, because its rule forbids it, and it collects nearly everything. In this city it is a strong
# rival. Good rules often are.
#
# **The agent** comes close to greedy. Think of what each of them was told. Greedy was given the street map, the shortest
# routes home, and a rule. The agent started with random numbers in its network. It found out from rewards that being near
# a device brings data, what the landing zones are for, and when to turn back.
#
# If greedy is this good, why train a network? Because a network can also learn where nobody knows a good rule.
#
# Nothing forces the agent to land. A few of these two thousand flights crash. This is the saddest of them,
# the crash with the largest share of the data on board:

# %%
own = scores["manhattan_ddqn"]
saddest = (own["collected"] - own["collected_and_landed"]).argmax()
trajectory_figure(environment, flown["manhattan_ddqn"].trajectory(saddest))

# %% [markdown]
# The red star marks the crash. The caption says how much data the agent had, and still the score of this flight is 0.
# The agent flew back for more data and stayed too long to get home in time. Then it tried to land outside the zone, and
# hovered. We do not know why.
#
# ## 0.6 What the agent knows
#
# It sees the map of the city, its own place, the places of the devices, how much data each still has and has already
# sent, and the time left. It does not see the violet shadows. It found out about them in training, because little
# reward comes in behind a building. It does not know the formulas of the radio channel. It makes no plan: at every step
# it asks again which of the six actions looks most promising.
#
# The course follows from this. Notebooks 1 and 2 show what the radio channel does. Notebook 3 says what a step is and
# what it earns. Notebooks 4 to 7 show how a network looks at a map, how it learns, and what can go wrong.
#
# You can also fly against the agent yourself, with the arrow keys: start the labs (`python -m uavdh_lite app`) and choose
# the tool *Fly*.
#
# ## Recap
#
# - The task: collect as much data as possible, and land before the flying time runs out.
# - An arrow has the colour of the device that sends. Violet cells are in the radio shadow.
# - One network flies every mission on this map, and changes its route when the time is short.
# - `collected_and_landed` is the score: data counts only if the UAV lands.
# - A comparison needs rivals and many missions. Greedy is a strong rival, random a weak one.
#
# ## Exercises
#
# The exercises of this notebook, with checks and hints, are in
# [`exercises/00_first_flight`](exercises/00_first_flight/00_first_flight.ipynb).
#
# ## Further reading
#
# Bayerlein, Theile, Caccamo, Gesbert: *UAV Path Planning for Wireless Data Harvesting: A Deep Reinforcement Learning
# Approach*, Globecom 2020, [arXiv 2007.00544](https://arxiv.org/abs/2007.00544).
