# %% [markdown]
# # 4 · What the network sees
#
# The agent looks at its mission and picks one of six actions. **What does it look at?** It gets one number, the flying
# time that is left, and five pictures.
#
# Here they are for a UAV over cell (8, 4) and devices at (4, 7) and (11, 11). Dark blue is large and white is zero.

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

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.missions import Mission
from uavdh_lite.observation import LAYERS, Observation
from uavdh_lite.plotting import draw_maps

torch.set_num_threads(1)  # small networks
agent = load_agent("manhattan_ddqn")
city, centred = agent.city, Observation(agent.environment)
maps, time = centred(Mission(city, (8, 4), [(4, 7), (11, 11)], [15, 10], 50).state)
draw_maps(dict(zip(LAYERS, maps[0])))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Look through the agent's eyes, stop its clock, build a small network |
# | **What you'll learn** | The layers of the map, map centring, neurons, gradient descent, convolutions |
# | **What you'll need** | Notebooks 0 to 3. 45 minutes to read, 30 seconds to run; 39 minutes of exercises |
#
# ## 4.1 The layers
#
# Each picture is a **layer** of the map. Three show the city. Two show the data: what each device still has, and what
# the UAV has collected. The last one is empty because the flight has not begun.
#
# The UAV is always in the middle. This is **map centring**, the paper's main idea.

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("frame_size")

# %% [markdown]
# A city with $M$ cells on each side needs a frame of $2M-1$. Outside the city the layer "no-fly zone" is 1, because
# leaving the city is refused just as entering a no-fly zone is. All others are 0 there.
#
# ## 4.2 The stopped clock
#
# Why does it need the time? Keep the picture and change the time:

# %%
from dataclasses import replace

import numpy as np

from uavdh_lite.environment import ACTIONS

def at_time(state, units):
    return replace(state, time_left=np.full_like(state.time_left, units))

# %%
street = Mission(city, (11, 8), [(4, 7), (11, 11)], [15, 10], 50).state
for units in (50, 14, 10):
    print(units, "units left:", ACTIONS[agent.act(at_time(street, units))[0]])

# %% [markdown]
# One device is far in the north, the other near in the east, and home is in the south-east. With plenty of time the
# agent goes for the far device. With less time it goes for the near one. With just enough it flies home another way,
# and not well: the way past the near device is as short and brings more. From the picture alone it would have to do the
# same each time.
#
# The agent flies 200 missions with a **stopped clock**. It sees the true picture, but always the same time. The true
# time runs out all the same.

# %%
from uavdh_lite.evaluation import FunctionPolicy, evaluate

def fly(policy):
    return evaluate(agent.environment, policy, agent.scenario, 200, seed=0).metrics()

def fly_with_clock_at(units):
    return fly(FunctionPolicy(lambda state: agent.act(at_time(state, units))))

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
# A clock that shows little time sends most UAVs home with little data. The others wait in the air. In the middle, UAVs collect nearly everything, but many are late. With a clock that shows a lot of time they do
# not land even when nothing is left to collect. No orange point comes near the black line.
#
# ## 4.3 Two frames
#
# To centre a layer, put a wide border around it, then cut out the window with the UAV in its middle.

# %%
def centre(layer, row, col, outside):
    wide = np.pad(layer.astype(float), len(layer) - 1, constant_values=outside)
    size = 2 * len(layer) - 1
    # the border has moved everything, so the window begins at the UAV's own row and column
    return wide[row : row + size, col : col + size]

# %% [markdown]
# Tall buildings are dark, low ones mid-blue, and the no-fly zone is pale.

# %%
world = 0.3 * city.no_fly + 0.7 * city.buildings
draw_maps({f"UAV at {uav}": centre(world, *uav, 0.3) for uav in ((0, 0), (8, 7), (15, 15))})

# %% [markdown]
# The world moves around the UAV. Without centring, the city stays **in place**, and the UAV needs a layer of its own
# with a single 1 that moves. Both frames hold the same facts.
#
# ## 4.4 What a network computes
#
# A network is made of **neurons**. Each multiplies its inputs by **weights** and adds up the products and a constant, the
# *bias*:
#
# $$\text{output}=w_1x_1+w_2x_2+\dots+w_nx_n+w_0$$
#
# Here the bias is 0.

# %%
inputs = np.array([[0, 1, 1], [0, 1, 1], [0, 0, 1]])
weights = np.array([[-1, 0, 1]] * 3)
draw_maps({"inputs": inputs, "weights": weights, "products": inputs * weights}, numbers=True)

# %% [markdown]
# The output is 3. It is large because something is on the right and nothing on the left.
#
# Now move this neuron across a larger picture, like a window, and write down its output at each place. That is a
# **convolution**, and its weights are a *kernel*. It finds the western edge of a building anywhere in the city.

# %%
picture = np.pad(np.ones((4, 2)), ((1, 1), (2, 2)))  # a building
windows = np.lib.stride_tricks.sliding_window_view(picture, (3, 3))
result = (windows * weights).sum(axis=(2, 3))
draw_maps({"picture": picture, "kernel": weights, "what comes out": result}, numbers=True)

# %% [markdown]
# Blue marks western edges and red eastern ones. The window fits in only four positions along each side, so the result is
# smaller.
#
# The agent's kernels read all five pictures at once. Each has 5 × 5 weights for every picture and adds up all the
# products. So one kernel makes one new picture, and 16 kernels make 16.
#
# Neurons with the same inputs are a **layer** of the network. A layer of the *map* is a picture. A layer is
# **fully connected** if each neuron has a weight for every input. Plotted against an input, a neuron's output is a
# straight line, and sums of straight lines are straight. So two such layers in a row could do no more than one. A
# **ReLU** between them bends the line: it replaces each negative number by 0. Sums of bent lines can follow any curve.
#
# ## 4.5 How it learns
#
# At first all weights are random. A **loss** measures how wrong the output is. Its *slope* says which way is down, and
# the weight takes a step that way: the slope times a small number, the **learning rate**. This is **gradient descent**.
# Here the input is 3 and the output should be 6, so the weight should become 2.

# %%
w = [0.0]
for _ in range(8):
    slope = 2 * 3 * (3 * w[-1] - 6)  # of the loss (3w − 6)²
    w.append(w[-1] - 0.02 * slope)  # 0.02 is the learning rate

# %%
line = np.linspace(-0.2, 4.2)
figure, ax = plt.subplots(figsize=(5, 2.6), layout="constrained")
ax.plot(line, (3 * line - 6) ** 2, "-", w, (3 * np.array(w) - 6) ** 2, "o")
ax.set(xlabel="weight", ylabel="loss");

# %% [markdown]
# The steps get shorter as the slope gets flatter, and the weight settles at the bottom. A million weights learn in the
# same way. The library PyTorch computes their slopes. Its optimiser **Adam** adapts the step size to each weight.

# %%
from torch import nn

def network(inputs):
    # 32 neurons, a ReLU behind each, and one neuron that adds up what they give
    return nn.Sequential(nn.Linear(inputs, 32), nn.ReLU(), nn.Linear(32, 1))

def train(model, x, y, steps=100):
    # it changes the model's weights; lr is the learning rate
    optimiser = torch.optim.Adam(model.parameters(), lr=0.02)
    for _ in range(steps):
        # how far the outputs are from y: squared, then the mean over all examples
        loss = ((model(x)[:, 0] - y) ** 2).mean()
        optimiser.zero_grad()  # forget the last slopes: PyTorch adds new ones to the old
        loss.backward()  # the slope of the loss for every weight
        optimiser.step()  # a step downhill with every weight

# %% [markdown]
# ## 4.6 The square of weights
#
# Which frame makes this question easier: **is a device near?** Near means within three rows and three columns. The answer
# should be +1 if so and −1 if not.

# %%
Quiz("linear_model")

# %% [markdown]
# Half of our pairs of places are near. The centred frame has a 1 at
# the device's place *as seen from the UAV*. The other frame has two pictures: a 1 at the device's place in the city,
# and a 1 at the UAV's.

# %%
def one_at(cells):
    # a picture of 31 × 31 cells, written as a list: cell (r, c) is number 31 r + c of it
    return nn.functional.one_hot(torch.tensor(cells @ (31, 1)), 31 * 31).float()

uav, device = np.random.default_rng(0).integers(16, size=(2, 40_000, 2))
near = abs(uav - device).max(axis=1) <= 3
# 4000 pairs of each kind, the near ones first
pairs = np.r_[np.flatnonzero(near)[:4000], np.flatnonzero(~near)[:4000]]
uav, device, y = uav[pairs], device[pairs], torch.tensor(2 * near[pairs] - 1)

# %% [markdown]
# On each frame we first train a single neuron, then a network of 33 neurons.

# %%
torch.manual_seed(0)
neurons = {}
# centred: the UAV is in the middle, at (15, 15); in place: the city's cell (0, 0) is at (7, 7)
for frame, x in (("centred", one_at(device - uav + 15)),
                 ("in place", torch.cat([one_at(device + 7), one_at(uav + 7)], 1))):
    neurons[frame] = nn.Linear(x.shape[1], 1)
    for model in (neurons[frame], network(x.shape[1])):
        train(model, x[::2], y[::2])  # every other pair; the rest is for the test
        right = (torch.sign(model(x)[:, 0]) == y).float()
        print(f"{frame}: {right[::2].mean():.0%} in training, {right[1::2].mean():.0%} in the test")

# %% [markdown]
# Centred, even the single neuron, printed first, is nearly always right. In place it is little better than a guess.
# There the network has memorised its training pairs, and fails on many new ones. The weights of the two neurons show
# why.

# %%
# a picture of 31 × 31 weights for each picture that the neuron sees
relative, absolute = (neuron.weight.detach().view(-1, 31, 31) for neuron in neurons.values())
draw_maps({"centred": relative[0], "device in place": absolute[0], "UAV in place": absolute[1]})

# %% [markdown]
# The left picture is the answer itself: **a square of weights**, three cells to each side of the UAV. White places never
# occurred in training. The others show no square, only more blue in the middle of the city, where more pairs are near. A
# weight of the centred frame belongs to a *relative* place, such as "three cells to the north". It means the same
# wherever the UAV is.
#
# A weight of the other frame belongs to an *absolute* place, such as "cell (4, 7)". Whether a device there is near
# depends on the UAV's place, and a sum of one weight for each cannot ask about both together. A network can, but has to
# learn it pair by pair. Notebook 7 asks whether this helps an agent to *fly*.
#
# ## Recap
#
# - The agent sees five layers and the time that is left. With a stopped clock it does not know when to go
#   home.
# - Centring puts the UAV in the middle of a frame of $2M-1$ cells.
# - A neuron is a weighted sum. A convolution moves it across pictures. A ReLU puts a kink in the line.
# - Gradient descent moves each weight downhill, by the learning rate times the slope of the loss.
# - Weights of the centred frame stand for relative places, so one weighted sum can tell what is near.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/04_map_centring/04_map_centring.ipynb) come with checks and hints.
