# %% [markdown]
# # 4 · Map centring
#
# The agent does not get a list of coordinates. It gets a picture of the city, as a stack of layers,
# and the paper's main idea is *how that picture is framed*: moved so that the UAV is always in the
# middle. This notebook shows both frames, and why one of them is easier to learn from.

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
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.missions import place
from uavdh_lite.observation import LAYERS, Observation

torch.set_num_threads(1)  # the networks here are small

# %%
city = City.load("manhattan")
state = place(city, uav=(8, 4), devices=[(4, 7), (11, 11)], data=[15, 10], flying_time=50,
              max_devices=5)
environment = Environment(city)
centred, in_place = Observation(environment, "centred"), Observation(environment, "non_centred")

# %%
def show(layers, names):
    figure = Figure(figsize=(3 * len(names), 3.3), layout="constrained")
    for ax, layer, name in zip(figure.subplots(1, len(names)), layers, names):
        ax.imshow(layer, cmap="magma_r", vmin=0, vmax=max(1, layer.max()))
        ax.plot(15, 15, "+", color="#0072B2", ms=11)  # the UAV
        ax.set(title=f"{name}: up to {layer.max():.0f}", xticks=[], yticks=[])
    return figure

maps, time = centred(state)  # the first axis of both counts episodes
show(maps[0], LAYERS)

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Look through the agent's eyes, stop its clock, move the UAV and watch the frame move, count the weights that each frame costs, and look at the border |
# | **What you'll learn** | What the five layers hold, why the flying time goes with them, why padding outside the city is a no-fly zone, and what a neuron after flattening means in either frame |
# | **What you'll need** | Notebook 1; what a neural network is. 47 minutes to read, 15 seconds to run; 10 minutes of exercises |
#
# ## 4.1 The layers
#
# The picture above is the whole input, apart from one number, the remaining flying time:

# %%
print("map", tuple(maps.shape), "time", tuple(time.shape))

# %% [markdown]
# One episode, five layers, 31×31 cells. The first three are the city's own (notebook 1), the last two
# say how much data each device still has, and how much has been collected from it. (What can still be earned depends on what
# is left, not on what has been collected. So the last layer is not needed, and the authors' code leaves it out. The
# paper has it.) Yes is 1 and no is 0; data is in
# data units, here 15 and 10 in the cells of the two devices, and 0 in all others. (Training may divide it by a constant
# to get smaller numbers.) Dark is large. "Data collected" is empty because the flight has not begun. The blue cross
# is the middle of the frame, where the UAV is.

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("frame_size")

# %% [markdown]
# Why 31? The city has 16 cells a side. If the UAV is in one corner, the opposite corner is 15 cells
# away: 15 cells on either side and the UAV's own, $2 \cdot 15 + 1 = 31$. The whole city is always in the
# frame.
#
# What is outside the city? No landing zone, no building, no device, but a no-fly zone: the safety
# controller treats the border as one, so the picture says the same.
#
# ### Why the flying time is an input
#
# The picture alone does not say what to do. Here is one picture at three times, and the action that a trained agent
# takes. The agent is `manhattan_ddqn`, which has learned by itself to land in time (notebook 6).

# %%
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import ACTIONS

agent = load_agent("manhattan_ddqn")

# %%
over_street = place(city, (11, 8), [(4, 7), (11, 11)], [15, 10], flying_time=50, max_devices=5)

def at_time(state, units):
    return replace(state, time_left=np.full_like(state.time_left, units))

for units in (50, 14, 10):
    print(f"{units} units of time left: {ACTIONS[agent.act(at_time(over_street, units))[0]]}")

# %% [markdown]
# One device is far in the north, the other near in the east, and the nearest landing zone is in the south-east. With
# much time the UAV flies to the far device first, with less to the near one, and with just enough for the way home it
# flies home. A policy that sees only the picture has to do the same thing all three times.
#
# What does that cost? Let the same agent fly test missions with a stopped clock: it sees the true maps, but always
# the same time. Whatever it believes, the true time runs out.

# %%
from uavdh_lite.evaluation import FunctionPolicy, evaluate

RECORDS = {"landed": "landed", "collected": "collected",
           "collected and landed": "collected_and_landed"}

# %%
def fly_missions(policy):
    metrics = evaluate(environment, policy, agent.scenario, 200, seed=0).metrics()
    return [metrics[name].mean for name in RECORDS.values()]

# %%
times = (5, 10, 20, 30, 40, 50, 60)

def with_clock_at(units):
    return FunctionPolicy(lambda state: agent.act(at_time(state, units)))

stopped = np.array([fly_missions(with_clock_at(t)) for t in times])
running = fly_missions(agent)

# %%
from uavdh_lite.plotting import BLUE, GREEN, ORANGE

figure = Figure(figsize=(7, 3.4), layout="constrained")
left, right = figure.subplots(1, 2, sharey=True, width_ratios=(6, 1))
for k, (name, colour, mark) in enumerate(zip(RECORDS, (BLUE, ORANGE, GREEN), "os^")):
    left.plot(times, stopped[:, k], mark + "-", color=colour, label=name)
    right.plot(0.1 * k, running[k], mark, color=colour)
left.set(xlabel="units of time that the stopped clock shows", ylabel="share, 200 missions", ylim=(-0.03, 1.05))
right.set(xlabel="true time", xlim=(-0.3, 0.5), xticks=[])
left.legend(loc="lower center", fontsize="small")
figure

# %%
assert running[2] > stopped[:, 2].max() + 0.2
print(f"collected and landed: {running[2]:.0%} with the true time, {stopped[:, 2].max():.0%} with the best stopped clock")

# %% [markdown]
# A clock that shows 5 or 10 sends most UAVs home, with little data. From 20 on they collect most of it, but about a third of
# them or more crash, and at 60 all. The best stopped clock is far from what the agent does with the true time.
#
# Why does about one in five crash even with a clock that shows 5? Look at their last six steps:

# %%
flights = evaluate(environment, with_clock_at(5), agent.scenario, 200, seed=0)
crashed = [flights.trajectory(k) for k in np.flatnonzero(~flights.end.landed)]
stuck = [len(set(flight.uav_cell[-6:].tolist())) <= 2 for flight in crashed]
print(f"{len(crashed)} crashes, {sum(stuck)} of them after hovering, or going to and fro between two cells")

# %% [markdown]
# Where it hovers and hardly any data arrives, it sees the same picture and the same time again, so it hovers again,
# until the true time is over. Going to and fro is the same with two pictures. With a running clock the input changes,
# and so can the action. (To stop a trained agent's clock is not the same as to train one without the time: that one
# could learn a compromise, such as to go home early.)
#
# ## 4.2 Two frames
#
# The UAV is always in the middle of the centred map, so its position need not be given. In the non-centred map the city
# stays where it is, and a sixth layer has a 1 where the UAV is: without that layer the network could not know. (The map would fit into
# 16×16 cells. The library fills it up with no-fly cells to the same 31×31, so that the networks can be compared.)

# %%
(fixed,), _ = in_place(state)
print("map", tuple(fixed.shape), "no-fly share of the frame:", f"{fixed[0, 1].mean().item():.0%}")
print("a 1 in the layer of the position at", np.argwhere(fixed[0, 5].numpy()).tolist())

# %% [markdown]
# That is cell (8, 4) of the city, which begins at (7, 7) of this frame. Move the UAV. In the upper frame the world
# moves, in the lower one the UAV does. The upper numbers count cells from the UAV, the lower ones are the city's rows
# and columns. Orange: a device; blue: the landing zone; grey: a building; pink: a no-fly zone, or outside the city.

# %%
def colours(layers):
    landing, no_fly, buildings, left = (layers[i, ..., None] for i in range(4))
    picture = np.ones((*layers.shape[1:], 3))
    for layer, colour in ((no_fly, (0.95, 0.8, 0.8)), (buildings, (0.3, 0.3, 0.3)),
                          (landing, (0.6, 0.75, 0.9)), (left > 0, (0.9, 0.62, 0))):
        picture = np.where(layer > 0, colour, picture)
    return picture

# %%
def draw_frame(ax, observation, cell, uav, title):
    maps, _ = observation(place(city, cell, [(4, 7), (11, 11)], [15, 10], 50, 5))
    ax.imshow(colours(maps[0].numpy()), interpolation="nearest")
    ax.plot(*uav, "^", color="white", mec="black", ms=9)
    grid = {0: -15, 15: 0, 30: 15} if observation is centred else {7: 0, 22: 15}  # in the frame: its label
    ax.set(title=title, xticks=list(grid), xticklabels=grid.values(), yticks=list(grid), yticklabels=grid.values())

# %%
def both(*cells):
    figure = Figure(figsize=(3.2 * len(cells), 6.6), layout="constrained")
    for (upper, lower), (row, col) in zip(figure.subplots(2, len(cells), squeeze=False).T, cells):
        draw_frame(upper, centred, (row, col), (15, 15), f"centred, UAV over ({row}, {col})")
        # In the non-centred frame the city begins at (7, 7).
        draw_frame(lower, in_place, (row, col), (col + 7, row + 7), "not centred")
    return figure

# %%
import ipywidgets

from uavdh_lite.labs.widgets import explore

cells = [(f"row {row}, column {col}", (row, col)) for row, col in
         ((0, 0), (4, 0), (8, 4), (8, 7), (11, 8), (14, 8), (15, 15))]
slider = ipywidgets.SelectionSlider(options=cells, index=2, description="UAV over")
explore(lambda cell: both(cell), cell=slider)

# %%
both((0, 0), (8, 7), (15, 15))

# %% [markdown]
# ### Centring in three lines
#
# The layer is laid into a wide one, with 15 cells of something around it, and a window of 31×31 is cut
# out that begins, in the wide layer, at the UAV's own row and column. The padding has moved the UAV 15 cells further down
# and right: to the window's middle.

# %%
def centre(layer, row, col, outside):
    wide = np.pad(layer.astype(float), len(layer) - 1, constant_values=outside)
    return wide[row : row + 2 * len(layer) - 1, col : col + 2 * len(layer) - 1]

row, col = 4, 13
maps, _ = centred(place(city, (row, col), [(4, 7), (11, 11)], [15, 10], 50, 5))
assert (centre(city.no_fly, row, col, outside=1) == maps[0, 1].numpy()).all()

# %% [markdown]
# Two other ways look right and are not. `np.roll` shifts the layer and needs no wider one, but what leaves on one side
# comes back on the other. And zeros around the city say that one may fly there:

# %%
rolled = np.roll(city.no_fly, (8 - row, 8 - col), axis=(0, 1))
figure = Figure(figsize=(9.5, 3.4), layout="constrained")
pictures = {"centred": centre(city.no_fly, row, col, 1), "np.roll, 16×16": rolled,
            "zeros around it": centre(city.no_fly, row, col, 0)}
for ax, (title, picture) in zip(figure.subplots(1, 3), pictures.items()):
    ax.imshow(picture, cmap="magma_r", vmin=0, vmax=1)
    middle = len(picture) // 2
    ax.plot(middle, middle, "+", color="#0072B2", ms=11)
    ax.set(title=f"no-fly zone, {title}", xticks=[], yticks=[])
figure

# %% [markdown]
# The UAV is two columns from the eastern edge of the city. On the left, all is dark beyond it. In the middle picture
# the western side of the city begins there, as if the UAV could fly on into it. On the right, the border cannot be
# seen.
#
# ### Centre late, store little
#
# To learn, the agent keeps thousands of past steps in a *replay memory* (notebook 5), each with the state before and
# the state after. Keep the centred maps there? They are made from a few numbers: the cells of the UAV and the devices, data
# and time. The library keeps those, and draws maps only for the steps that are being learned from, 128 at a time. For
# 50,000 steps:

# %%
from uavdh_lite.replay import Replay

for name, cells in (("centred", 31**2), ("in place", 16**2)):
    print(f"{name:<9} 5 layers × {cells} cells × 4 bytes × 2 states: {5 * cells * 4 * 2 * 50_000 / 1e6:7.1f} MB")
stored = sum(array.nbytes for array in Replay(50_000, 1, 5, discount=0.95).state_dict().values())
print(f"the library's states: {stored / 1e6:.1f} MB")

# %% [markdown]
# Centred maps take 3.75 times the memory of maps in place ($31^2 / 16^2$), and hundreds of times that of the numbers that
# they are made from. (In place the UAV's position needs no layer in the memory: it is one number.)
#
# ## 4.3 What a neuron can know
#
# One output of a network's layer, a *neuron*, is a weighted sum of its inputs plus a constant. (A layer of the network is not a
# layer of the map.) In a *convolution* the inputs are one small square of the picture, through all its layers, and the same
# weights, its *kernel*, are used at every place: so it treats all places alike. (There is no *padding*: nothing is added around
# the picture, so it shrinks.) In a *fully connected* layer each output has a weight of its own for every input. In between stands a step that looks harmless, to *flatten*: the picture is written as a list, row
# after row. Each place in it becomes an input of its own to the first
# fully connected layer, with its own weights. Those weights are where the frames differ.
#
# - **Not centred**: a weight belongs to an *absolute* place, such as "a device at (4, 7)". Whether that
#   is good news depends on where the UAV is, so the network must learn the combination of every
#   device place with every UAV place: 186 × 186 = 34,596 pairs (186 cells for devices and, by chance, as many
#   over which the UAV may fly).
# - **Centred**: a weight belongs to a *relative* place, such as "a device three cells north". That is
#   the same news wherever the UAV is: fly north, unless a wall or the clock forbids it. What is learned in
#   one street helps in the others.
#
# A small experiment makes this concrete. Ask a *linear* model, one weight a place, whether a device is within three
# rows and three columns of the UAV. (The question is made for the centred frame: it shows what a sum of weights can
# say, not that one learns to fly.) It gets the layer "data left" alone, without centring also the position. Half of the
# examples are near, half are not, so guessing gives 50 %. First the examples:

# %%
Quiz("linear_model")

# %%
from uavdh_lite.scenario import find_scenario

generator = np.random.default_rng(0)

def one_device(count):
    state = find_scenario("manhattan").sample_anywhere(environment, count, generator, spare_time=5)
    data = np.zeros_like(state.data_left)
    data[:, 0] = 1
    return replace(state, data_initial=data, data_left=data)

# %%
def examples(observation, count=20_000):
    state = one_device(count)
    row, col = np.divmod(state.device_cells[:, 0], 16)
    uav_row, uav_col = np.divmod(state.uav_cell, 16)
    near = np.maximum(abs(row - uav_row), abs(col - uav_col)) <= 3
    far = generator.choice(np.flatnonzero(~near), near.sum(), replace=False)
    maps, _ = observation(state[np.concatenate([np.flatnonzero(near), far])])
    inputs = torch.cat([maps[:, 3:4], maps[:, 5:]], 1).flatten(1).numpy()
    return inputs, np.repeat([1.0, -1.0], near.sum())

# %% [markdown]
# Then the model, fitted by *least squares*: the weights with the smallest sum of squared errors (plus a *ridge*, the
# sum of the squared weights, so that there is one solution). The right answer is +1 for near and −1 for far, and a column of
# ones gives the model a constant. The sum is smallest where its gradient is 0: that is a system of linear equations. The
# model is tested on new examples:

# %%
fitted = {}
for name, observation in (("centred", centred), ("not centred", in_place)):
    (x, y), (x_test, y_test) = examples(observation), examples(observation)
    x, x_test = np.c_[x, np.ones(len(x))], np.c_[x_test, np.ones(len(x_test))]
    weights = np.linalg.solve(x.T @ x + np.eye(x.shape[1]), x.T @ y)
    fitted[name] = weights[: 31 * 31].reshape(31, 31)
    print(f"{name:<12} {(np.sign(x_test @ weights) == y_test).mean():.1%} right")

# %%
figure = Figure(figsize=(8, 3.6), layout="constrained")
for ax, (name, weights) in zip(figure.subplots(1, 2), fitted.items()):
    most = abs(weights).max()
    picture = ax.imshow(weights, cmap="RdBu_r", vmin=-most, vmax=most)
    ax.set(title=f"weights of 'data left', {name}", xticks=[], yticks=[])
    figure.colorbar(picture, ax=ax, label="weight")
figure

# %% [markdown]
# From the centred map the answer is a weighted sum: the weights draw the square of three cells around the middle. From
# the other it depends on the device's place and the UAV's place *together*. A sum of one weight for each cannot say
# that, however many examples it gets. (Its weights look larger in the middle of the city, where more cells are near,
# and negative in the south-west: that may be why it is a little better than guessing.) A deep network can (several layers with a bend between
# them are more than one weighted sum, notebook 5), but it has to learn it for every pair of places. The ablation of notebook 7 measures what that costs.
#
# ## 4.4 What it costs
#
# Both maps have the same size, so both networks have nearly the same shape, and the comparison is about the frame alone:

# %%
from uavdh_lite.recipe import LITE, PAPER

for recipe in (PAPER, LITE):
    for kind in ("centred", "non_centred"):
        of_kind = replace(recipe, observation=kind)
        network = of_kind.network_for(of_kind.observation_for(environment))
        count = sum(p.numel() for p in network.parameters())
        print(f"{recipe.name:<6}{kind:<12}{count:>10,} weights")

# %% [markdown]
# `PAPER` and `LITE` are two *recipes*: all constants of a network and its training, the paper's and ours (notebook 6). The
# difference between the kinds is the sixth layer: both networks begin with 16 kernels, each with 5×5 weights for every layer of
# the map, so it adds 16 × 5 × 5 = 400. The difference between the recipes is the
# stride: `lite` lets its convolutions skip cells, and the flattened picture is much smaller. How small, one can
# count. Without padding, a kernel of $k$ cells on a side fits into $n$ cells at $n - k + 1$ places, and with a *stride* of $s$ only every
# $s$-th of them is used:

# %%
def places(n, k, stride):
    return (n - k) // stride + 1

for recipe in (PAPER, LITE):
    sides = [31]
    for stride in recipe.strides:
        sides.append(places(sides[-1], recipe.kernel_size, stride))
    numbers = recipe.kernels * sides[-1] ** 2
    network = recipe.network_for(recipe.observation_for(environment))
    assert network.head[0].in_features == numbers + 1  # and the flying time
    print(f"{recipe.name:<6}", " → ".join(map(str, sides)), f"cells on a side, {numbers} numbers after flattening")

# %% [markdown]
# Each of these numbers, and the flying time, has a weight to each of the 256 outputs of the first fully connected layer. So in
# `PAPER` this layer alone has $8465 \cdot 256 + 256$ weights, nearly all of the network. (The last 256 are the *biases*: a number
# that each output adds.) What if the city is larger?

# %%
for size in (16, 32, 50):
    side = places(places(2 * size - 1, 5, 1), 5, 1)  # after two convolutions of `PAPER`
    print(f"M = {size}: map {2 * size - 1}², flattened 16·{side}² = {16 * side**2:,}, "
          f"first fully connected layer {(16 * side**2 + 1) * 256 + 256:,} weights")

# %% [markdown]
# The convolutions stay as they are: their kernels do not know how large the map is. The first fully connected layer grows
# about as $M^2$. (The appendix has the cure.)
#
# ## 4.5 At the border
#
# Wherever the UAV is, $1 - 256/961 = 73\,\%$ of the frame lie outside the city; with the UAV in a corner they lie on
# two sides. The no-fly layer has a 1 there, as in the city's own no-fly cells. The UAV's own cell is in the middle of
# each layer, whatever happens:

# %%
corner = place(city, (0, 0), [(15, 13)], [10], 50, 5)
maps, _ = centred(corner)
print("landing zone under the UAV:", maps[0, 0, 15, 15].item())
print("no-fly share of the frame:", f"{maps[0, 1].mean().item():.0%}")
print("the far device is at", np.argwhere(maps[0, 3].numpy() > 0).tolist())

# %% [markdown]
# The device is at (30, 28) of the frame: 15 rows south and 13 columns east of the middle. (With the city's own 70 no-fly cells
# and the 705 outside, 81 % of the layer are 1.)
#
# ## Recap
#
# - The input is five layers and the flying time. Without the time, the same picture asks for different actions.
# - Outside the city everything is no-fly zone.
# - Centring turns absolute places into relative ones. Notebook 7 tests whether an agent learns sooner with them.
# - It costs a map of $2M - 1$ cells a side for a city of $M$. For large cities, global and local maps cut that.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/04_map_centring`](exercises/04_map_centring/04_map_centring.ipynb).
#
# **1.** Where in the centred frame is a device at `device` when the UAV is at `uav`? Write it.

# %%
def in_frame(device, uav, size=16):
    return device[0] - uav[0] + size - 1, device[1] - uav[1] + size - 1

# %%
for uav, device in (((8, 4), (4, 7)), ((0, 0), (15, 13)), ((15, 15), (0, 2))):
    maps, _ = centred(place(city, uav, [device], [10], 50, 5))
    assert maps[0, 3][in_frame(device, uav)] == 10

# %% [markdown]
# **2.** Show that the city can be read back from the centred frame: cut out the 16×16 cells that are
# the city, for any place of the UAV.

# %%
def city_in_frame(layer, uav, size=16):
    row, col = size - 1 - uav[0], size - 1 - uav[1]
    return layer[row : row + size, col : col + size]

# %%
maps, _ = centred(state)
assert (city_in_frame(maps[0, 2].numpy(), (8, 4)) == city.buildings).all()
assert (city_in_frame(maps[0, 1].numpy(), (8, 4)) == city.no_fly).all()

# %% [markdown]
# ## Appendix: larger cities, global and local maps
#
# At 50×50 cells the centred map has 99×99. The authors' later papers give the network two smaller maps
# instead: the whole surroundings, averaged over blocks of `pooling` cells a side, and the middle,
# `local_size` cells a side, in full detail. The first no longer says in which of its nine cells a device is, or a wall: a
# layer of 0s and 1s becomes one of shares. The second sees no further than eight cells. So many numbers are left:

# %%
layers, side, _ = Observation(Environment(City.load("metropolis"))).map_shape
for name, sides in (("one map", [side]), ("two maps", [side // 3, 17])):
    print(f"{name:<10}", sides, "cells on a side,", f"{sum(layers * s**2 for s in sides):,} numbers")

# %% [markdown]
# The coarse map still grows with the city, but a ninth as fast, and the fine one does not grow at all.
#
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section III-C, and its Fig. 2.
# - Theile et al.: *UAV Path Planning using Global and Local Map Information with Deep Reinforcement
#   Learning*, ICAR 2021.
# - **5 · DDQN**, where a network learns from these maps.
