# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 5 · A network by hand
#
# The agent's network turns the five pictures of notebook 4 and the time into six numbers, one for
# each action. **How can a formula look at a picture, and how does it learn what to look for?** Here
# is the paper's network, sized as in the authors' code; you will build a smaller one:

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
from IPython.display import SVG

from uavdh_lite.storage import data_folder

SVG(data_folder() / "figures/network.svg")

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Build a neuron, train it, and write the network of your agent |
# | **What you'll learn** | Loss, gradient descent, backpropagation, convolution, PyTorch's training loop |
# | **What you'll need** | Notebook 4 and derivatives. 40 minutes to read, 40 seconds to run; 42 minutes of exercises |
#
# ## 5.1 A neuron
#
# A network is made of **neurons**. Each multiplies its inputs by **weights**, then adds up the
# products and a constant, the *bias* $w_0$:
#
# $$\text{output}=w_1x_1+w_2x_2+\dots+w_nx_n+w_0$$
#
# Nine inputs, nine weights and their products:

# %%
import numpy as np
import torch

from uavdh_lite.plotting import draw_maps

torch.set_num_threads(1)  # small networks
inputs = np.array([[0, 1, 1], [0, 1, 1], [0, 0, 1]])
weights = np.array([[-1, 0, 1]] * 3)
draw_maps({"inputs": inputs, "weights": weights, "products": inputs * weights}, numbers=True)

# %% [markdown]
# With a bias of 0, the output is 3, the sum of the numbers on the right. This neuron asks whether
# something is on the right and nothing on the left.
#
# Neurons side by side form a **layer**, which is **fully connected**, or *dense*, if each has a
# weight for every input. Two such layers in a row can do no more than one, because a weighted sum
# of straight lines is again a straight line. So between them, something has to bend the lines, such
# as the **ReLU** (*rectified linear unit*), which turns negative numbers into 0 and keeps all
# others. Three bent lines and their sum:

# %% tags=["hide-input"]
from matplotlib import pyplot as plt

x = np.linspace(-1, 4, 200)
parts = [1.0 * np.maximum(x, 0), -2.0 * np.maximum(x - 1, 0), 2.5 * np.maximum(x - 2.5, 0)]
figure, ax = plt.subplots(figsize=(5, 2.6), layout="constrained")
ax.plot(x, np.transpose(parts), "--", lw=1)
ax.plot(x, sum(parts), "k", label="their sum")
ax.set(xlabel="input", ylabel="output")
ax.legend();

# %% [markdown]
# Each neuron adds one kink. With enough kinks, the sum can closely follow any continuous curve
# between two given inputs.
#
# ## 5.2 Going downhill
#
# At first the weights are random (those of no input may be 0), because neurons that start alike
# would learn the same thing. A **loss** measures how wrong the output is, and its *slope* with
# respect to a weight says whether it grows or shrinks when the weight grows. To step downhill,
# change the weight by minus the slope times a small number, the **learning rate**. This is
# **gradient descent**; the *gradient* is the list of all slopes.
#
# Take a neuron with one weight and no bias. The input is 3 and the output should be 6.

# %%
w = [0.0]
for _ in range(8):
    slope = 2 * 3 * (3 * w[-1] - 6)  # of the loss (3w − 6)²
    w.append(w[-1] - 0.02 * slope)  # 0.02 is the learning rate

# %% tags=["hide-input"]
line = np.linspace(-0.2, 4.2)
figure, ax = plt.subplots(figsize=(5, 2.6), layout="constrained")
ax.plot(line, (3 * line - 6) ** 2, "-", w, (3 * np.array(w) - 6) ** 2, "o")
ax.set(xlabel="weight", ylabel="loss");

# %% [markdown]
# The weight nears the bottom. Now break it: with a learning rate of 0.2 each step jumps across
# the valley and lands higher up on the other side, and with 0.0002 the weight hardly moves. A
# number like this one, chosen rather than learned, is a **hyperparameter**.
#
# The slope has the input, 3, as a factor, so a weight with a large input takes large steps, one
# reason why many recipes scale data and time to small numbers. It also grows with the error, so one
# error of 150 pulls as hard as 150 errors of 1; the **Huber loss**, a straight line further out,
# limits that.
#
# ## 5.3 Backpropagation
#
# How does a weight in the first layer learn which way is down? By the chain rule. Take the
# smallest two-layer network, with $w_1=0.5$ and $w_2=2$. Its output $y$ should be 6.
#
# ```text
#  forward      x = 3  ──×w₁──▶  h = 1.5  ──ReLU──▶  1.5  ──×w₂──▶  y = 3  ──▶  loss (y−6)² = 9
#
#  slopes of
#  the loss            −36 at w₁  ◀──×3──  −12 at h  ◀──×w₂──   −6 at y: 2·(y−6)
#                                          −9 at w₂  ◀──×1.5──┘
# ```
#
# If $y$ grows a little, the loss changes by $-6$ times as much. If $w_2$ grows, $y$ grows $h=1.5$
# times as much: the slope at $w_2$ is $-6\cdot1.5=-9$. If $h$ grows, $y$ grows $w_2=2$ times as
# much: the slope at $h$ is $-12$. (Where a ReLU gives 0, its slope is 0, and the weights before it
# learn nothing. Where a number feeds several neurons or examples, its slopes add up.) If $w_1$
# grows, $h$ grows $x=3$ times as much: the slope at $w_1$ is $-36$. Each further slope is one to
# its right times a number from the forward pass, so one backward pass gives the slopes of *all*
# weights. This is **backpropagation**.
#
# (To check a slope, move the weight by 0.001 to either side: the loss changes by about 0.002
# times it.)
#
# PyTorch does the same. Its arrays, **tensors**, can remember how they were computed:

# %%
w1, w2 = torch.tensor([0.5, 2.0], requires_grad=True)  # note all operations on these
loss = (w2 * torch.relu(w1 * 3) - 6) ** 2
slopes = torch.autograd.grad(loss, (w1, w2))
print("loss", loss.item(), "slopes", [slope.item() for slope in slopes])

# %% [markdown]
# ### PyTorch, as much as the course needs
#
# | what it does | a line of code |
# | --- | --- |
# | 4 neurons, each with 2 inputs | `layer = nn.Linear(2, 4)` |
# | layers one after the other | `net = nn.Sequential(nn.Linear(2, 64), nn.ReLU(), nn.Linear(64, 4))` |
# | ask it about 5 examples, one a row; gives (5, 4) | `q = net(torch.rand(5, 2))` |
# | the entry in column `a[k]` of each row k; gives (5,) | `a = torch.tensor([0, 3, 1, 1, 2]); q.gather(1, a[:, None])[:, 0]` |
# | the largest number of each row, and its column; (5,) each | `q.amax(1), q.argmax(1)` |
# | the same as columns, (5, 1) | `q.amax(1, keepdim=True)` |
# | compute without remembering: no slope will flow | `with torch.no_grad(): y = net(torch.rand(5, 2))` |
# | a second network with the same weights | `other = copy.deepcopy(net)` |
#
# Mind the shapes: a column (5, 1) minus a list (5,) is a table of 5 × 5, and nothing warns you.
#
# ## 5.4 Five lines of PyTorch
#
# This function trains a network on examples `x` with the right answers `y`:

# %%
from torch import nn

def train(model, x, y, updates=400):
    optimiser = torch.optim.Adam(model.parameters(), lr=0.002)  # of all its weights
    for _ in range(updates):
        rows = torch.randint(len(x), (128,))  # a minibatch: 128 examples drawn at random
        # [:, 0]: the network gives a column of numbers, (128, 1), whereas y is a list, (128,)
        loss = ((model(x[rows])[:, 0] - y[rows]) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

# %% [markdown]
# - **Adam** divides each weight's steps by the usual size of its slopes, so that all weights take
#   steps of similar length.
# - The loss is a mean over a **minibatch**: all examples would take longer, a single one would be
#   noisier.
# - `zero_grad` forgets the old slopes, `backward` is backpropagation, and `step` moves the weights.
#
# ## 5.5 A window that moves
#
# Move the neuron of 5.1 like a window across a picture, and note its output at each place. This is
# a **convolution**, and the weights are its *kernel*. (Signal theory calls it
# *cross-correlation*: the kernel is not turned round.)

# %%
picture = np.pad(np.ones((4, 2)), ((1, 1), (2, 2)))  # a building
# conv2d takes batches of pictures with several layers: here one picture with one layer
one, kernel = (torch.tensor(x, dtype=torch.float32)[None, None] for x in (picture, weights))
result = torch.nn.functional.conv2d(one, kernel)[0, 0]
draw_maps({"picture": picture, "kernel": weights, "what comes out": result}, numbers=True)

# %% [markdown]
# On the right, blue marks the building's western edge; red, its eastern one. The same nine weights
# are used everywhere (**weight sharing**), so what they learn in one place holds in all others: if
# the building moves one cell east, so does the result (**translation equivariance**). A kernel $k$
# cells wide turns $n$ cells into $n-k+1$; a rim of zeros (**padding**) can keep the size.
#
# The number of cells by which the window moves each time is the **stride** $s$. It leaves
# $\lfloor(n-k)/s\rfloor+1$ cells along each side. But with a stride of 2 the result moves along with
# the picture only if that moves by a multiple of 2.
#
# ## 5.6 One question, three networks
#
# We ask three networks one question: **is a device near the UAV**, within three rows and three
# columns? The answer is +1 for yes and −1 for no. In half of our 8000 examples it is near; every
# other example is kept for the test. A map *in place* has two layers, one with a 1 in the device's
# cell and one with a 1 in the UAV's. A *centred* map has one layer, with a 1 at the device's
# position relative to the UAV.

# %%
from uavdh_lite.course.near_far import near_pairs

in_place, centred, y = near_pairs()

# %% [markdown]
# Two networks see the map in place, one with convolutions; another dense one sees the centred map.
# Which will succeed?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("linear_model")

# %%
def dense(inputs):
    return nn.Sequential(nn.Flatten(), nn.Linear(inputs, 32), nn.ReLU(), nn.Linear(32, 1))

torch.manual_seed(0)
convolutions = nn.Sequential(nn.Conv2d(2, 8, 5), nn.ReLU(), nn.Conv2d(8, 8, 5), nn.ReLU())
networks = {"dense, in place": (dense(2 * 16 * 16), in_place),
            "convolutions, in place": (convolutions.extend(dense(8 * 8 * 8)), in_place),
            "dense, centred": (dense(31 * 31), centred)}
test = {}
for name, (model, maps) in networks.items():
    train(model, maps[::2], y[::2])
    right = (torch.sign(model(maps)[:, 0]) == y).float()
    test[name] = right[1::2].mean()
    print(f"{name:<23} {right[::2].mean():4.0%} in training, {test[name]:4.0%} in the test")
assert test["dense, in place"] < 0.8 < 0.9 < min(list(test.values())[1:])

# %% [markdown]
# The **dense network in place** has learned many training pairs by heart, and does little better
# than guessing on new ones: **overfitting**. Its weights belong to absolute places, such as "device
# at (4, 7)", and whether that is near depends on where the UAV is.
#
# The **convolutions** avoid this: one window sees the UAV and a nearby device *together*, anywhere.
# With the **centred** map even the dense network is nearly perfect, because the question has become
# trivial: is the device in a certain square of the picture?
#
# ## 5.7 The network of your agent
#
# Now write the network that you will train in notebook 7. It sees the centred map of the village, a
# city of 8 × 8 cells: $2\cdot8-1=15$ cells on a side. Two convolutions with 8 kernels each look for
# what is near, and each kernel makes a new picture, a **feature map**. The flying time joins the
# list after them. The last layer has six neurons without a ReLU, because a Q-value may be negative:
# **one forward pass gives all six Q-values** (paper, Fig. 2).

# %%
class QNetwork(nn.Module):
    def __init__(self, side):
        super().__init__()  # first, so that PyTorch finds the layers
        self.convolutions = nn.Sequential(
            nn.Conv2d(5, 8, 3, 2), nn.ReLU(), nn.Conv2d(8, 8, 3, 2), nn.ReLU(), nn.Flatten())
        inputs = 8 * ((side - 3) // 4) ** 2 + 1  # 15 → 7 → 3 cells a side, and the time
        self.head = nn.Sequential(
            nn.Linear(inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 6))

    def forward(self, maps, time):  # what happens when the network is called
        return self.head(torch.cat([self.convolutions(maps), time], dim=1))

# %% [markdown]
# `nn.Conv2d(5, 8, 3, 2)` reads 5 layers with 8 kernels of 3 × 3 that move by 2 cells. With a bias
# each, these are $8\,(5\cdot9+1)=368$ weights. Ask it about four missions:

# %%
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.one_file import VILLAGE, CentredMap  # the map of notebook 4, for many states

environment = Environment(load_city("village"))
see = CentredMap(environment)
state = VILLAGE.sample(environment, 4, np.random.default_rng(0))
maps, time = see(state)
network = QNetwork(see.side)
print("map", tuple(maps.shape), "time", tuple(time.shape), "→", tuple(network(maps, time).shape))
print(f"{sum(weights.numel() for weights in network.parameters()):,} weights")

# %% [markdown]
# Each number in a layer's output is a *unit*, and what it sees of the map is its **receptive
# field**. A unit of the second convolution sees 3 units of the first along each side, whose windows
# are 3 cells wide and 2 apart: $3+2\cdot2=7$ cells. Together the units read all of your map. Where
# windows do not come out even, the last rows and columns are never read, unless the map is first
# made larger. (A *recipe* is the library's word for all constants of a training; `paper` has the
# authors'.)
#
# | layer | recipe `paper`, a city of 16 × 16 | yours |
# | --- | --- | --- |
# | the map | 5×31×31 | 5×15×15 |
# | first convolution | 16×27×27, kernels 5×5 | 8×7×7, kernels 3×3, stride 2 |
# | second convolution | 16×23×23 | 8×3×3 |
# | as a list, with the time | 8465 | 73 |
# | fully connected | 256, 256, 256 | 128, 128 |
# | weights in all | 2,308,854 | 27,710 |
#
# Of the weights of `paper`, 94 % are in its first dense layer, whose inputs grow with the map.
# (Many networks have **pooling**: of each small window they keep one number, such as the largest.
# Ours has none, because pooling blurs *where* things are.)
#
# ## Recap
#
# - Gradient descent moves each weight downhill; backpropagation finds all slopes at once.
# - A convolution moves one neuron across a picture, so what it learns in one place holds in all
#   others. With centred maps, what even a dense network learns holds wherever the UAV is.
# - Your agent's network is written. What it should say is the subject of [notebook
#   6](06_ddqn.ipynb).
#
# ## Exercises
#
# The [exercises of this notebook](exercises/05_network_by_hand/05_network_by_hand.ipynb) come with
# checks and hints.
#
# Further reading: Nielsen, [*Neural Networks and Deep
# Learning*](http://neuralnetworksanddeeplearning.com), chapters 1 and 2.
