# %% [markdown]
# # 4 · What the network sees
#
# The agent looks at its mission and picks one of six actions. **What does it look at?** It gets one number, the flying
# time that is left, and five pictures.
#
# Here they are for a UAV over cell (8, 4), at the start of a mission with devices at (4, 7) and (11, 11). Dark blue is large and
# white is zero. The UAV itself is in no picture, because it is always in the middle, where the small triangle is.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    # %cd -q {project[0]}/notebooks

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
# Each picture is a **layer** of the map. Three show the city: where to land, where not to fly, and what blocks the radio. Two show
# the data: what each device still has, and what the UAV has collected from it. The last one is empty because the flight has not
# begun. The fading, the rate of a link and the shadows of notebook 2 are in none of them. So what the agent knows about shadows, it has to work out from the
# layer of buildings, or, in a single city, learn by heart.
#
# The UAV is always in the middle. This is **map centring**, the paper's main idea (section III-C).

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("frame_size")

# %% [markdown]
# A city with $M$ cells on each side needs a frame of $2M-1$, so that all of it is in the picture wherever the UAV is. Outside the
# city the layer "no-fly zone" is 1, because leaving the city is refused just as entering a no-fly zone is. All other layers are 0
# there.
#
# ## 4.2 The stopped clock
#
# Why does the network need the time? Keep the picture and change the time:

# %%
from dataclasses import replace

import numpy as np

from uavdh_lite.environment import ACTIONS

# %%
def at_time(state, units):
    return replace(state, time_left=np.full_like(state.time_left, units))

# %%
street = Mission(city, (11, 8), [(4, 7), (11, 11)], [15, 10], 50).state
for units in (50, 14, 10):
    print(units, "units left:", ACTIONS[agent.act(at_time(street, units))[0]])

# %% [markdown]
# One device is far in the north, the other near in the east, and home is in the south-east. The five pictures are the same each time, and
# the answers are not. With 50 units left, and with 14, the agent makes for the near device. With 10 it turns for home, because nine moves
# and the landing take just that long. From the pictures alone it would have to do the same in all three cases.
#
# To see what the time is worth, let the agent fly 200 missions with a **stopped clock**. It sees the true picture, but always the
# same time. The true time runs out all the same.

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
# A clock that shows little time sends about half of the UAVs home with little data; the others are still in the air when the true time is up. A
# clock in the middle of its range lets them collect nearly everything, but many come home too late. A clock that shows a lot of time
# keeps them in the air even when nothing is left to collect, because an agent that believes in 60 more units sees no hurry. No orange
# point comes near the black line.
#
# In the words of notebook 3: without the time the observation is not a **Markov** state, because the future depends on something
# that cannot be seen. A problem in which the agent sees only a part of the state is called a *partially observable* Markov decision
# process, a **POMDP**. With the time, ours is none: map and time together hold all of the state that matters.
#
# The layer "data left" is there for the same reason. Without it a full device and an empty one look the same, and the agent would go on circling above the empty one. What has
# been *collected*, the future does not need; that layer is a convenience of the paper.
#
# ## 4.3 Two frames
#
# How is the map centred? Every layer is shifted by as many cells as the UAV is away from the middle, and what is beyond the city's border is filled in. Exercise 4.1 asks
# you to write that. Here are the buildings, the dark ones, and the no-fly zone, the pale one, as the network sees them
# from three places.

# %%
def seen_from(uav):
    layers = centred(Mission(city, uav, [(4, 7)], [15], 50).state)[0][0]
    return 0.3 * layers[1] + 0.7 * layers[2]

draw_maps({f"UAV at {uav}": seen_from(uav) for uav in ((0, 0), (8, 4), (15, 15))}, uav=(15, 15))

# %% [markdown]
# The world moves around the UAV. Without centring, the city would stay **in place**, and the UAV would need a layer of its own with a
# single 1 that moves. Both frames hold the same facts. What differs is what a place in the picture stands for. In the centred
# frame a place of the picture is a *relative* one, "three cells north of me". In the fixed frame it is an *absolute* one, "cell (4,
# 7)". Most of what a pilot has to know is relative: a wall to the north is a wall to the north in any street. Notebook 5 shows in a
# small example what that is worth, and notebook 8 asks whether it helps an agent to fly.
#
# Why not simply *roll* the layer, so that what leaves the picture on one side comes in again on the other? The picture would need
# only $M$ cells a side, a quarter of the work. But a roll lies about distance: a device at the far eastern edge would appear just west
# of a UAV at the western edge, as if the world were a doughnut. The frame of $2M-1$ cells is the smallest in which every
# *displacement* from the UAV has a place of its own.
#
# Another thing may be done to a centred picture: turn it by a right angle, or mirror it. The same step, turned eight ways, is eight examples, as long as
# the actions turn with it (north becomes west). It is allowed because neither radio nor moves prefer a direction. With wind, or with an antenna that points north, it would not
# be.
#
# ## 4.4 Why pictures?
#
# The mission could be told in fewer numbers: the UAV's cell, and for each device its cell and its data. Three things speak for
# pictures.
#
# - **The number of devices may vary.** A list for five devices has no room for a sixth, and with two devices three of its entries mean
#   nothing. On a map any number of devices fits, so the size of the input **does not depend on the number of devices**, and neither
#   does the network. One agent flies missions with two devices and with five.
# - **The order does not matter.** In a list "device 1 here, device 2 there" and "device 2 here, device 1 there" look different, though
#   they are the same mission, and a network would have to learn each. On the map they are one picture.
# - **The city can be seen beside the devices.** That a device lies behind a building is a pattern in the picture. In a list of numbers
#   the building is not there at all, so everything about the city would have to be learned by heart.
#
# The price is size: 4805 numbers instead of a few. A fully connected network could hardly make use of them, and that is why the agent's
# network begins with convolutions. They are the subject of the next notebook.
#
# Because the map is made anew from the state at each step, changing the *task* often means adding or taking away a layer. Five tasks to think
# about before you go on. What would you change in the state, in the reward, and in what the network sees?
#
# - **Parcels.** The UAV delivers parcels instead of collecting data, one at a time, and fetches each in the landing zone.
# - **A battery that is swapped.** Landing does not end the mission: on the ground the UAV gets a full battery, for three units of time.
# - **Buffers that refill.** Every device gets new data in each step, and loses what does not fit into its memory.
# - **Two UAVs** share the devices.
# - **Landing anywhere.** And what if there were no action `land`, and touching the zone ended the flight?
#
# <details><summary>One answer to each</summary>
#
# *Parcels:* the state says whether a parcel is on board, and the layer "data left" becomes "parcels expected here". The reward is for
# a delivery. The layer of buildings, which says what blocks the radio, can go; the no-fly layer stays. With or without a parcel the same picture asks for different actions, so "on board"
# goes in as one more number beside the time. That is enough if any parcel will do at any place. If each has an address, the map must show the place of the one on board, or the problem is a
# POMDP.
#
# *Swapped battery:* there are two times now, that of the battery and that of the mission. Both belong to the state and to the input. A
# crash now means an empty battery; `land` ends an episode only when the mission's time is up, and before that it costs three units.
#
# *Refilling buffers:* an episode no longer has an amount of data that can be "all collected", so *collected and landed* must be replaced, for
# example by data per unit of time, or by what was lost. "Data left" stays as a layer. If the devices fill at different rates that cannot be
# seen, the task becomes a POMDP: give the rates as a layer, or the agent has to guess them.
#
# *Two UAVs:* the state holds both places and both times. Each network gets one more layer, where the other one is. The reward is shared, or each competes; the safety controller stops two UAVs that
# want the same cell. While the other one learns, the world changes, so old steps in its memory are wrong ([a map of the field](../docs/tutorials/map_of_the_field.md)).
#
# *Landing anywhere:* the landing layer says nothing any more, and nobody has to turn back. At every step the only question is whether more data pays the next 0.2. *No `land`:* a UAV
# could not fly through the zone, and could hardly start there.
# </details>
#
# ## Recap
#
# - The agent sees five layers and the time that is left. With a stopped clock it does not know when to go home.
# - Centring puts the UAV in the middle of a frame of $2M-1$ cells, so that a place in the picture is relative to the UAV.
# - A map takes any number of devices in any order, and shows the city beside them.
# - If the observation holds all that matters, it is a Markov state. If not, the problem is a POMDP.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/04_map_centring/04_map_centring.ipynb) come with checks and hints.
