# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 4 · What the network sees
#
# The agent looks at its mission and picks one of six actions. **What does it look at?** It gets
# five pictures and one number, the remaining flying time.
#
# Here are the pictures for a UAV over cell (8, 4), at the start of a mission with devices at (4, 7)
# and (11, 11). Dark blue stands for large numbers. The UAV itself is not in the pictures, because
# it is always in the middle; we have marked the place with a small triangle.

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

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.missions import Mission
from uavdh_lite.observation import LAYERS, Observation
from uavdh_lite.plotting import draw_maps

torch.set_num_threads(1)  # small networks
agent = load_agent("manhattan_ddqn")
city, centred = agent.city, Observation(agent.environment)
maps, time = centred(Mission(city, (8, 4), [(4, 7), (11, 11)], [15, 10], 50).state)
draw_maps(dict(zip(LAYERS, maps[0])), uav=(15, 15))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Look through the agent's eyes, stop its clock, and move the world around it |
# | **What you'll learn** | The layers of the map, map centring, and why the input has this form |
# | **What you'll need** | Notebooks 0 to 3. 35 minutes to read, 30 seconds to run; 24 minutes of exercises |
#
# ## 4.1 The layers
#
# Each picture is a **layer** of the map. Three show the city: where to land, where not to fly, and
# what blocks radio signals. Two show the data: how much each device still has, and how much the UAV
# has collected from it. The last picture is empty because the flight has not begun. None of the
# five shows the fading, the rate of a link or the shadows of notebook 2. Whatever the agent knows
# about shadows, it must therefore work out from the buildings or, if it flies in a single city,
# learn by heart.
#
# The UAV is always in the middle of the *frame*, the square that each picture fills. This is called
# **map centring** (paper, section III-C).

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("frame_size")

# %% [markdown]
# A city with $M$ cells on each side needs a frame that is $2M-1$ cells wide. When the UAV is at one
# edge of the city, the opposite edge is $M-1$ cells away. So with $M-1$ cells on each side of the
# UAV's own, the whole city is in the picture wherever the UAV is. (A network need not read
# all of it: 5.7.) Outside the city the layer "no-fly zone" is 1, because leaving the city is
# refused just as entering a no-fly zone is.
#
# ## 4.2 The stopped clock
#
# Why does the network need to know the time left? We leave the pictures as they are and change only
# the time:

# %%
from dataclasses import replace

import numpy as np

from uavdh_lite.environment import ACTIONS

# %%
def at_time(state, units):
    return replace(state, time_left=np.full_like(state.time_left, units))

# %%
street = Mission(city, (8, 8), [(0, 8), (8, 4)], [15, 10], 50).state
for units in (50, 17, 16):
    print(units, "units left:", ACTIONS[agent.act(at_time(street, units))[0]])

# %% [markdown]
# One device is far to the north, the other is nearer, in the west, and the nearest landing zone is
# in the south-east, 13 units of time away, landing included. With 50 or 17 units left, the agent's
# next step is west, towards the near device. With 16 it turns for home, although such a step would
# still leave it a unit more than the way home takes. From the pictures alone it could not tell these
# cases apart.
#
# Now let the agent fly 200 missions with a **stopped clock**: it sees the true pictures, but the
# time it is shown never changes.

# %%
from uavdh_lite.evaluation import FunctionPolicy, evaluate

def fly(policy):
    return evaluate(agent.environment, policy, agent.scenario, 200, seed=0).metrics()

def fly_with_clock_at(units):
    return fly(FunctionPolicy(lambda state: agent.act(at_time(state, units))))

# %%
times = (5, 10, 20, 30, 40, 50, 60)
stopped, running = [fly_with_clock_at(units) for units in times], fly(agent)

# %%
from matplotlib import pyplot as plt

figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
for name, style in (("landed", "C2o:"), ("collected", "C0s--"), ("collected_and_landed", "C1^-")):
    ax.plot(times, [flights[name].mean for flights in stopped], style, label=name.replace("_", " "))
ax.axhline(running["collected_and_landed"].mean, c="k", label="collected and landed,\ntrue time")
ax.set(xlabel="units of time on the stopped clock", ylabel="share")
figure.legend(loc="outside right upper", fontsize="small");

# %% [markdown]
# With 5 units on the clock, nearly all UAVs land, but with hardly any data. With 30 to 50 units they
# collect nearly everything, but up to a quarter of them are still in the air when the true time is
# up; with 60, more than half. Many of those that crash have nothing left to collect, so flying home
# would be best, because each step costs something. But one step more changes the Q-value by 0.2 at
# most, and so small a difference is easily lost in the network's errors. No stopped clock gives a
# score (orange) near that of the true clock (black).
#
# Without the time, the agent's **observation**, all that it sees, would not be a **Markov** state,
# because the future would depend on something that the agent could not see: a **POMDP** (3.2). With
# the time, map and time together hold all of the state that matters (if the network reads all of
# it).
#
# The layer "data left" is there for the same reason: without it the agent could not tell when to
# fly on. The layer "data collected" could be left out, because the future does not depend on it; it
# is there because the paper has it.
#
# ## 4.3 Two frames
#
# How is the map centred? Every layer is shifted so that the UAV's cell lies in the middle of the
# frame, and the places beyond the city's border are filled with zeros or ones (exercise 4.1). Here
# are the buildings (dark) and all other cells of the no-fly layer (pale) as the network sees them
# for three positions of the UAV:

# %%
def seen_from(uav):
    layers = centred(Mission(city, uav, [(4, 7)], [15], 50).state)[0][0]
    return 0.3 * layers[1] + 0.7 * layers[2]

draw_maps({f"UAV at {uav}": seen_from(uav) for uav in ((0, 0), (8, 4), (15, 15))}, uav=(15, 15))

# %% [markdown]
# The world moves around the UAV. Without centring, the city stays **in place**, and the UAV
# gets a layer of its own, in which a single 1 moves. The centred and the fixed frame hold the
# same facts, but a place in the picture means something different in each. In the centred frame it
# stands for a *relative* position, such as "three cells north of me". In the fixed frame it stands
# for an *absolute* position, such as "cell (4, 7)". Much of what a pilot has to know is relative: a
# wall just to the north stops the UAV in any street.
#
# Why not simply *roll* the layer, so that what leaves the picture on one side comes in again on the
# other? Because a device at the far eastern edge would appear just west of a UAV at the western
# edge. The frame of $2M-1$ cells is the smallest in which every *displacement* from the UAV has a
# place of its own.
#
# A centred picture can also be rotated in steps of 90° and mirrored, as long as the action is
# changed with it (north becomes west, say). A single step thus gives eight examples (**data
# augmentation**), because neither the radio nor the moves favour any direction. The agents that
# learn by copying (notebook 9) are trained in this way; the DDQN agent is not:

# %% tags=["hide-input"]
seen = seen_from((8, 4))
views = {"as it is": seen, "a quarter turn": torch.rot90(seen), "mirrored": torch.fliplr(seen)}
draw_maps(views, uav=(15, 15))

# %% [markdown]
# ## 4.4 Why pictures?
#
# Apart from its time, a mission could be described by far fewer numbers than five pictures hold: the
# UAV's cell, and for each device its cell and its data. Why pictures?
#
# - **The number of devices may vary.** A list for five devices has no room for a sixth. A map has
#   room for one in each cell, so neither the size of the input nor the network **depends on how
#   many there are**. It would accept twenty devices, too, but may fly badly with them: a network
#   can be trusted only with inputs like those it has learned from.
# - **The order does not matter.** In a list, "device 1 here, device 2 there" and the reverse look
#   different, although they are the same mission, and most networks would have to learn both:

# %%
for places, data in (([(4, 7), (11, 11)], [15, 10]), ([(11, 11), (4, 7)], [10, 15])):
    seen = centred(Mission(city, (8, 4), places, data, 50).state)[0]
    print(places, data, "the same map:", bool((seen == maps).all()))

# %% [markdown]
# **The city can be seen together with the devices.** A device behind a building forms a pattern in
# the picture. In such a list the building does not appear.
#
# The price of pictures is size: 4805 numbers instead of about twenty. A network with a separate
# adjustable number, a *weight*, for each of them would have to learn the same pattern again for
# each place in the picture. Therefore the agent's network begins with *convolutions* (notebook 5),
# which look for the same pattern in many places.
#
# When the *task* changes, it may suffice to add or remove a layer. Say the **devices move**
# through the streets while the UAV flies. What would you change in the state, the reward and the
# network's input? Decide before you read on.
#
# The reward stays. If each of their steps is independent of the one before, their present places
# are enough for the state, and the layers stay as they are. If they keep their direction, one
# picture does not show it, and the task is a POMDP. Three remedies are common: a layer that shows
# the directions, the last few pictures together (**frame stacking**), or a network with a memory (a
# **recurrent** network).
#
# Other tasks, from parcels to two UAVs, are on [a page of their
# own](../docs/tutorials/other_tasks.md).
#
# ## Recap
#
# - The agent sees five layers and the time left. With a stopped clock the agent does not know when
#   to go home.
# - Centring puts the UAV in the middle of a frame that is $2M-1$ cells wide, so that a place in the
#   picture stands for a position relative to the UAV.
# - A map has room for a device in each cell, does not depend on their order, and shows the city
#   together with them.
# - An observation that holds everything that matters is a Markov state. If something is missing,
#   the problem is a POMDP.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/04_map_centring/04_map_centring.ipynb) come with checks
# and hints.
