# %% [markdown]
# # 0 · First flight
#
# A UAV (unmanned aerial vehicle, a drone) collects data from devices on the ground. An *agent* flies it: a program that
# chooses one action after another. Inside is a neural *network*, a formula with many adjustable numbers. It was *trained*:
# it flew one random mission after the other, and its numbers were adjusted until they predicted well how much each
# action brings in the end. That took about an hour on one processor core. Here is one of its flights:

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
import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.beyond.genie import Genie

from uavdh_lite.player import play
from uavdh_lite.plotting import add_legend, draw_trajectory
from uavdh_lite.missions import place

torch.set_num_threads(1)  # the network is small
agent = load_agent("manhattan")
environment = Environment(agent.city)

# %%
def show(flights, episode=0):  # flights are lists; here each has one entry, number 0
    trajectory = flights.trajectory(episode)
    figure = Figure(figsize=(6.5, 8), layout="constrained")
    draw_trajectory(figure.subplots(), environment, trajectory)
    add_legend(figure, int((trajectory.start.data_initial > 0).sum()))
    return figure

flights = evaluate(environment, agent, agent.scenario, episodes=1, seed=1)
show(flights)

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Fly a trained agent through one mission, read the picture, then set missions of your own |
# | **What you'll learn** | What the task is, what the agent knows and does not know, how to read a flight |
# | **What you'll need** | Python. 19 minutes to read, 10 seconds to run; 9 minutes of exercises |
#
# ## 0.1 Reading the picture
#
# The map shows a city from above; each cell is 10 m wide.
#
# - The white **triangle** is where the UAV starts, the **diamond** where it lands. Both are in the blue
#   zones, the only places where it may start and land.
# - Each **cross** is a device on the ground; the number next to it is how much data it has to send.
# - An **arrow** is one unit of flying time. Its colour says which device sent the most during it. Black means that none
#   did. Arrows lie a little to one side of the cells' middle, so that there and back do not cover each other.
#   A **ring** is hovering.
# - The **width** of an arrow says how much data was sent, in four sizes. The thinnest stands for everything up to a
#   quarter of the most, even for a thousandth of a unit, as from far away or round a corner.
# - **Violet** cells lie in the radio shadow of buildings, deeper for more devices.
#
# Below the map you can read how much of its time the UAV used (landing takes one unit, too) and how much data it
# collected.
#
# Now watch the same flight step by step. Play it, or drag the slider:

# %%
play(environment, flights.trajectory(0))

# %% [markdown]
# Here the width of an arrow, and of the line from the device, says how much is sent. The number next to a
# device is its name. White cells see the device that is sending, and violet ones do not: point at a device to see
# its shadow alone.
#
# The flight in numbers:

# %%
for name, values in flights.records().items():
    print(f"{name:<28}{values[0]:.2f}")

# %% [markdown]
# `collected_and_landed`, **CRAL** for short, is the score to watch: the collected share of the data, or 0 if
# the UAV ran out of time in the air. (Figures call it *collected and landed*, or *brought home*.) A *reward* is what one action earns: data, less a price for time (notebook 3);
# `return` is their sum. `time_used` is a share, here 31 of 45 units. `safety_interventions` counts moves that
# the *safety controller* refused: into a tall building or a no-fly zone, off the map, or a landing elsewhere.
#
# What does the agent know? The city, where it is itself, where the devices stand, how much data each has left and has sent,
# and the time left. It does not know the channel's formulae, the shadows drawn here in violet, or the luck of the
# radio link, called *fading*. It learned what they do.
#
# Several agents are shipped with the library, and fly in these notebooks. *The paper* is always Bayerlein and others, 2020
# (at the end of this page); the library rebuilds its method. A *recipe* is the list of all settings of a training.
#
# | agent | how it was made | in notebooks |
# | --- | --- | --- |
# | `manhattan` | beyond the paper (notebook 12), for this city | 0, 10, 12, 13 |
# | `manhattan_ddqn`, `open_field_ddqn` | by the paper's method with our faster recipe, taught in notebooks 3 to 8 | 4 to 10, 12 |
# | `manhattan_ddqn_early` | the same, stopped early | 6, 9 |
# | `any_city` | as `manhattan`, over two thousand cities | 10, 13 |
#
# ## 0.2 One agent, any mission
#
# The same network flies with two to five devices, wherever they stand, with 5 to 20 data units each and 35
# to 70 units of time: that is what it was trained on. Nothing is retrained. Put three devices where you
# like. Places are (row, column), counted from the top left:

# %%
def mission(devices, data, flying_time, start=(0, 0), seed=0):
    state = place(agent.city, start, devices, data, flying_time, agent.scenario.max_devices)
    return fly(environment, agent, state, np.random.default_rng(seed))

show(mission(devices=[(0, 12), (8, 1), (12, 14)], data=[12, 15, 18], flying_time=70))

# %% [markdown]
# It collects everything, and lands with time to spare. This is not the shortest route: the UAV leaves device 0 (orange) half
# full and comes back to it later. (It chooses action by action, without a plan.) Now give it half of the time, 35
# units: less than that flight took. Predict before you run the cell after this one:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("half_the_time")

# %%
short = mission(devices=[(0, 12), (8, 1), (12, 14)], data=[12, 15, 18], flying_time=35)
show(short)

# %% [markdown]
# Now it has to choose. It empties two devices and is home with its last unit of time. How much did the third one
# send, along the green arrows on the way home? And what would the *genie* do, a program that knows the channel's
# formulae and plans ahead (notebook 8)?

# %%
start = short.trajectory(0).start
planned = fly(environment, Genie(environment), start, np.random.default_rng(0))
for name, flight in (("agent", short), ("genie", planned)):
    left = flight.trajectory(0).data_left[-1]
    print(name, "collected", ", ".join(f"{d - x:.3f} of {d:.0f}" for d, x in zip((12, 15, 18), left)))

# %% [markdown]
# The third device sent a few thousandths of a unit: its arrows have colour, but next to no data. No rule says which device
# to leave. The agent's choice comes from training, and here it is not the best: the genie flies on to the far landing
# zone and brings home more. (Notebook 8 compares agents with the genie over 1000 missions.)
#
# That the agent gets home is not left to learning: a rule, the *failsafe*, replaces each action after which the time left
# would not suffice for the way home (notebook 12). The safety controller is another rule, which does not look
# at the clock. The paper's agent has only that one, and must learn to land.
#
# Move the devices, their data and the time with the sliders (with a running kernel):

# %%
import ipywidgets

from uavdh_lite.labs.widgets import explore

def own_mission(row, column, data, flying_time):
    return show(mission([(row, column), (11, 8)], [data, 10], flying_time))

def slider(name, value, low, high):
    return ipywidgets.IntSlider(value=value, min=low, max=high, description=name,
                                continuous_update=False)

explore(own_mission, row=slider("row", 4, 0, 15), column=slider("column", 8, 0, 15),
        data=slider("data", 10, 1, 20), flying_time=slider("time", 50, 10, 70))

# %%
own_mission(4, 8, 10, 50)

# %% [markdown]
# (A device cannot stand in a building or in the landing zone. If you put one there, the message says
# so.)
#
# ## 0.3 How good is it?
#
# One flight proves nothing. Over 200 random missions that were never used in training:

# %%
flights = evaluate(environment, agent, agent.scenario, episodes=200, seed=0)
for name in ("landed", "collected", "collected_and_landed"):
    mean, low, high = flights.metrics()[name]
    print(f"{name:<28}{mean:.1%}  (95 % interval {low:.1%} to {high:.1%})")

# %% [markdown]
# The interval says how far the mean may be off because of which missions were drawn (notebook 8). More
# missions make it narrower. All flights landed: that is the failsafe. How much they brought home is the agent's work, for the
# most part (section 12.1 measures what the failsafe does for a random pilot, 12.9 what it does for training).
#
# ## Recap
#
# - The task: collect as much as you can from devices on the ground, and land in time.
# - One network does it for all missions on this map. It sees the city, where the UAV and the devices are, the data that each device has left and has sent,
#   and the time, and no more.
# - A claim about an agent is a mean over many missions, with an interval.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/00_first_flight`](exercises/00_first_flight/00_first_flight.ipynb).
#
# **1.** How much time does the agent need to empty one device at (8, 1) with 15 data units, starting in
# the corner (0, 0)? Find the shortest flying time with which it collects all and lands.

# %%
def collects_all(flying_time):
    end = mission([(8, 1)], [15], flying_time).end
    return bool(end.landed[0] and end.collected[0] > 0.999)

# %%
succeeds = {time: collects_all(time) for time in range(5, 71)}
needed = next(time for time in succeeds if succeeds[time])
assert needed < 20
print(needed, "units of time; longer ones that fail:", [t for t in succeeds if t > needed and not succeeds[t]])

# %% [markdown]
# Nine moves to the device, seven back to the nearest cell of the landing zone, one to land: 17. Fewer are
# enough, because the UAV need not go all the way: the link reaches down the street. Another draw
# of the fading may shift the answer by one.
#
# **2.** Does luck matter? Fly one mission with 20 seeds (only the fading differs) and print the least and
# the most that is collected.

# %%
crowded = [(4, 8), (11, 8), (7, 14), (8, 1), (0, 12)]
ratios = [mission(crowded, [20] * 5, 45, seed=seed).end.collected[0] for seed in range(20)]
assert len(set(ratios)) > 1
print(f"from {min(ratios):.0%} to {max(ratios):.0%}; all:", *(f"{100 * ratio:.0f}" for ratio in sorted(ratios)))

# %% [markdown]
# Nearly all of the flights lie within four points. A unit of time has four *slots*, short times in which one device
# sends; each has a draw of its own, a flight has more than a hundred, and most of their luck averages out. Now and
# then it does not: small differences lead the agent another way, and it collects far more.
#
# ## Further reading, and where to go from here
#
# - **1 · City and channel**: why it is so dark behind a corner.
# - **3 · Environment**: fly it yourself with buttons.
# - **4 · Map centring**: what the agent sees.
# - Bayerlein, Theile, Caccamo, Gesbert: *UAV Path Planning for Wireless Data Harvesting: A Deep
#   Reinforcement Learning Approach*, Globecom 2020, [arXiv 2007.00544](https://arxiv.org/abs/2007.00544).
