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
# and (11, 11). Dark blue stands for large numbers and white for zero. The UAV itself is not in the
# pictures that the network gets, because it is always in the middle; we have marked the place with
# a small triangle.

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
# | **What you'll do** | Look through the agent's eyes, stop its clock, and move the world around the UAV |
# | **What you'll learn** | The layers of the map, map centring, and why the input has this form and no other |
# | **What you'll need** | Notebooks 0 to 3. 40 minutes to read, 30 seconds to run; 24 minutes of exercises |
#
# ## 4.1 The layers
#
# Each picture is a **layer** of the map. Three show the city: where to land, where not to fly, and
# what blocks radio signals. Two show the data: how much each device still has, and how much the UAV
# has collected from it. (If two devices shared a cell, these layers could show only the sum of
# their data.) The last picture is empty because the flight has not begun. None of the five shows
# the fading, the rate of a link or the shadows of notebook 2. Whatever the agent knows about
# shadows, it must therefore work out from the layer of buildings or, if it flies in a single city,
# learn by heart.
#
# The UAV is always in the middle of the *frame*, the square that each picture fills. This is called
# **map centring** (paper, section III-C), the paper's second idea, after the map itself.

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("frame_size")

# %% [markdown]
# A city with $M$ cells on each side needs a frame that is $2M-1$ cells wide. When the UAV is at one
# edge of the city, the opposite edge is $M-1$ cells away. The UAV can be at any edge, so the frame
# has $M-1$ cells on each side of the UAV's own cell, and the whole city is in the picture wherever
# the UAV is. (Section 5.7 asks whether a network reads all of the picture.) Outside the city the
# layer "no-fly zone" is 1, because leaving the city is refused just as entering a no-fly zone is.
# All other layers are 0 there.
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
for units in (50, 15, 14):
    print(units, "units left:", ACTIONS[agent.act(at_time(street, units))[0]])

# %% [markdown]
# One device is far to the north, the other is nearer, in the west, and the nearest landing zone is
# in the south-east. The five pictures are the same each time, but the agent's actions are not. With
# 50 or 15 units of time left, the agent makes for the near device. With 14 it turns for home in
# time: from the next cell to the west, the way home would take 14 units, with 13 left. From the
# pictures alone the agent could not tell these cases apart.
#
# To see how much the time matters, let the agent fly 200 missions with a **stopped clock**. The
# agent sees the true pictures, but the time it is shown never changes. The true time runs out
# nevertheless.

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
# With 5 units on the clock, most UAVs never leave the landing zone. More than half of all UAVs
# land, but with little data. Nearly all the others stay over the zone until the true time is up,
# because on a clock that stands still the moment to land never comes.
#
# With 20 to 40 units the UAVs collect most of the data, but a third to a half of them are still in
# the air when the true time is up, and with 50 or 60 units most are. Most of those that crash have
# nothing left to collect. Flying home at once would then give the highest return, because each step
# costs something. But one more step changes the Q-value by no more than the step's price, which was
# 0.1 in training, and such a small difference is easily lost in the network's errors. A stopped
# clock never warns them, so none gives a score (orange) near that of the true clock (black).
#
# Without the time, the agent's **observation**, all that it sees, would not be a **Markov** state,
# because the future would depend on something that the agent could not see. The problem would be
# *partially observable*, a **POMDP** (3.2). With the time it is not a POMDP, because map and time
# together hold all of the state that matters (if the network reads all of it; see 5.7).
#
# The layer "data left" is there for the same reason. Without this layer the agent would not see a
# device until some of its data had come in, and even then it would not see how much was left, so it
# could not tell when to fly on. The layer "data collected" could be left out, because the future
# does not depend on it; it is there because the paper has it.
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
# The world moves around the UAV. Without centring, the city would stay **in place**, and the UAV
# would need a layer of its own, in which a single 1 moves. The centred and the fixed frame hold the
# same facts, but a place in the picture means something different in each. In the centred frame it
# stands for a *relative* position, such as "three cells north of me". In the fixed frame it stands
# for an *absolute* position, such as "cell (4, 7)". Most of what a pilot has to know is relative: a
# wall just to the north stops the UAV in any street. Notebook 5 shows with a small example what the
# centred frame is worth, and notebook 8 asks whether it helps an agent to fly.
#
# Why not simply *roll* the layer, so that what leaves the picture on one side comes in again on the
# other? Then the picture would need only $M$ cells on each side, about a quarter as many in all.
# But rolling misrepresents distances: a device at the far eastern edge would appear just west of a
# UAV at the western edge. The frame of $2M-1$ cells is the smallest in which every *displacement*
# from the UAV has a place of its own.
#
# A centred picture can also be rotated in steps of 90° and mirrored, as long as the action is
# changed with it (north becomes west, say). A single step of a flight thus gives eight examples to
# learn from, four directions and their mirror images. This *data augmentation* is allowed because
# neither the radio nor the moves favour any direction; with wind, or with an antenna that points
# north, it would be wrong. The agents of notebooks 9 and 12 that learn by copying are trained in
# this way, but the DDQN agent of this course is not.
#
# ## 4.4 Why pictures?
#
# A mission could be described by far fewer numbers than five pictures hold: the UAV's cell, and for
# each device its cell and its data. Three arguments nevertheless favour pictures.
#
# - **The number of devices may vary.** A list for five devices has no room for a sixth, and with
#   only two devices, three of its entries mean nothing. A map has room for any number of devices,
#   so neither the size of the input nor the network **depends on how many there are**. The same
#   agent flies missions with two devices and with five. It would accept twenty devices, too, but
#   may fly badly with them: in training it never saw such full maps or such large returns, and a
#   network can be trusted only with inputs like those it has learned from.
# - **The order does not matter.** In a list, "device 1 here, device 2 there" and "device 2 here,
#   device 1 there" look different, although they are the same mission, and a network would have to
#   learn both. On the map they are the same picture.
# - **The city can be seen together with the devices.** A device behind a building forms a pattern
#   in the picture. In a list of numbers the building does not appear, so everything about the city
#   would have to be learned by heart.
#
# The price of pictures is size: 4805 numbers instead of about twenty. A network with a separate
# adjustable number, a *weight*, for each of them would have to learn the same pattern again for
# each place in the picture. Therefore the agent's network begins with *convolutions* (notebook 5),
# which look for the same pattern in many places. (If a convolution moves on by several cells at a
# time, by a *stride* of three, say, it recognises a pattern that has moved only if it has moved by
# three, six or nine cells.)
#
# When the *task* changes, it often suffices to add or remove a layer. Take two other tasks, and
# decide for each what you would change in the state, the reward and the network's input, before you
# read on.
#
# **Parcels.** Instead of collecting data, the UAV delivers parcels, one at a time, and fetches each
# from the landing zone. *The state* now says whether a parcel is on board, and the layer "data
# left" becomes "parcels expected here". *The reward* is for each delivery. *The input* loses the
# layer of buildings, which says what blocks radio signals; the no-fly layer stays. But the same
# picture calls for one action with a parcel on board and for another without one, so "on board"
# becomes one more input number beside the time. That is enough if any parcel will do at any place.
# If each parcel has an address, the map must show where the parcel on board has to go, or the
# problem is a POMDP.
#
# **Devices that move.** They roam the streets while the UAV flies. The reward stays. The next state
# now also depends on where the devices happen to go. If each of their steps is independent of the
# one before, their present places are enough for the state, and the layers stay as they are. If
# they keep their direction, one picture does not show this direction, and the task is a POMDP.
# There are three remedies: a layer that shows the directions, the last few pictures together
# (**frame stacking**), or a network with a memory (a **recurrent** network).
#
# Six more tasks, from a battery that is swapped to two UAVs, are on the page [Other
# tasks](../docs/tutorials/other_tasks.md).
#
# ## Recap
#
# - The agent sees five layers and the time left. With a stopped clock the agent does not know when
#   to go home.
# - Centring puts the UAV in the middle of a frame that is $2M-1$ cells wide, so that a place in the
#   picture stands for a position relative to the UAV.
# - A map has room for any number of devices, does not depend on their order, and shows the city
#   together with them.
# - An observation that holds everything that matters is a Markov state. If something is missing,
#   the problem is a POMDP.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/04_map_centring/04_map_centring.ipynb) come with checks
# and hints.
