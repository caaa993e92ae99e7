# %% [markdown]
# # 5 · A network by hand
#
# The agent's network turns the five pictures of notebook 4 into six numbers, one for each action. **How can a formula look at a
# picture, and how does it learn what to look for?** Here is the whole
# of it, from the map to the six numbers:

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
from IPython.display import SVG

SVG("../data/figures/network.svg")

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Build a neuron, train it by hand, follow a slope backwards, and let three networks answer one question |
# | **What you'll learn** | Neuron, loss, gradient descent, backpropagation, convolution, stride, receptive field, PyTorch's training loop |
# | **What you'll need** | Notebook 4, the derivative of a function. 50 minutes to read, 60 seconds to run; 42 minutes of exercises |
#
# If you have trained networks before, 5.5 and 5.6 will do.
#
# ## 5.1 A neuron
#
# A network is made of **neurons**. Each multiplies its inputs by **weights** and adds up the products and a constant, the
# *bias*:
#
# $$\text{output}=w_1x_1+w_2x_2+\dots+w_nx_n+w_0$$
#
# Nine inputs, arranged as a picture, nine weights, and their products:

# %%
import numpy as np
import torch

from uavdh_lite.plotting import draw_maps

torch.set_num_threads(1)  # small networks
inputs = np.array([[0, 1, 1], [0, 1, 1], [0, 0, 1]])
weights = np.array([[-1, 0, 1]] * 3)
draw_maps({"inputs": inputs, "weights": weights, "products": inputs * weights}, numbers=True)

# %% [markdown]
# With a bias of 0, the output is the sum of the right picture, 3. It is large because something is on the right and nothing on the left: a neuron is a
# question, and its weights say which.
#
# Neurons with the same inputs form a **layer** of the network. (A layer of the *map* is a picture.) A layer is
# **fully connected**, or *dense*, if each of its neurons has a weight for every input.
#
# What does a second layer gain us? Nothing yet. A neuron's output is a straight line, and a weighted sum of straight lines is one again, so two layers can do no more than one. Something has to bend the line in
# between. The usual choice is the **ReLU**, the *rectified linear unit*, which makes 0 of each negative number. Three
# bent lines together:

# %%
from matplotlib import pyplot as plt

x = np.linspace(-1, 4, 200)
parts = [1.0 * np.maximum(x, 0), -2.0 * np.maximum(x - 1, 0), 2.5 * np.maximum(x - 2.5, 0)]
figure, ax = plt.subplots(figsize=(5, 2.6), layout="constrained")
ax.plot(x, np.transpose(parts), "--", lw=1)
ax.plot(x, sum(parts), "k", label="their sum")
ax.set(xlabel="input", ylabel="output")
ax.legend();

# %% [markdown]
# Each neuron puts in one kink. With enough of them the sum can follow any curve.
#
# ## 5.2 Going downhill
#
# At first all weights are random numbers. A **loss** measures how wrong the output is: it is 0 for the right answer, and the larger it is, the worse the output.
# Its *slope* with respect to a weight says whether the loss grows or shrinks when the weight grows. So the weight takes a step in the
# direction in which the loss shrinks: minus the slope times a small number, the **learning rate**. This is **gradient descent**. The
# *gradient* is
# nothing but the list of all slopes.
#
# One neuron, one weight: the input is 3 and the output should be 6, so the weight should become 2.

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
# The steps get shorter as the slope gets flatter, and the weight settles at the bottom. With a learning rate of 0.2 each step would jump
# across the valley and land higher up on the other side; with 0.0002 it would hardly move. The slope in the code has the input, 3, as a factor. So an input of 70 beside inputs of
# 0 and 1 would take far longer steps than they do, and jump where they crawl. That is why data and time are scaled to a size near 1. A number like this one, which is chosen before the
# learning and not learned, is called a **hyperparameter**.
#
# With the squared error, one error of 150 pulls as hard as 150 errors of 1. The **Huber loss**, a parabola near 0 and a straight line further out, lets no single error
# pull too hard. Our agents learn with it.
#
# ## 5.3 Backpropagation
#
# Only the last layer touches the loss. How does a weight in the first one learn which way is down? By the chain rule. Take the smallest network with two layers: input $x=3$, a first weight $w_1=0.5$, a ReLU, a second weight $w_2=2$. The output
# should be 6.
#
# ```text
#  forward      x = 3  ──×w₁──▶  h = 1.5  ──ReLU──▶  1.5  ──×w₂──▶  y = 3  ──▶  loss (y−6)² = 9
#
#  slopes of
#  the loss            −36 at w₁  ◀──×3──  −12 at h  ◀──×w₂──   −6 at y: 2·(y−6)
#                                                └──×1.5──▶   −9 at w₂
# ```
#
# Go through it from right to left. If $y$ grows by a little, the loss changes by $-6$ times as much. If $w_2$ grows, $y$ grows $h=1.5$ times as
# much, so the slope at $w_2$ is $-6\cdot1.5=-9$. If $h$ grows, $y$ grows $w_2=2$ times as much: $-12$. And $h$ grows $x=3$ times as much as $w_1$:
# $-36$. Each slope is the one to its right times a number that the forward pass has already computed. So one backward
# pass gives the slopes of *all* weights, at the cost of one or two forward passes, whether there are two weights or two million. This is **backpropagation**. Where a ReLU gave 0, the slope is 0, and the weights that feed into it learn
# nothing from this example.
#
# PyTorch does it for you:

# %%
w1, w2 = torch.tensor([0.5, 2.0], requires_grad=True)  # remember what is computed with these
loss = (w2 * torch.relu(w1 * 3) - 6) ** 2
slopes = torch.autograd.grad(loss, (w1, w2))
print("loss", loss.item(), "slopes", [slope.item() for slope in slopes])
assert [slope.item() for slope in slopes] == [-36, -9]

# %% [markdown]
# ## 5.4 Five lines of PyTorch
#
# This function trains any network. Every program that trains one has these five lines.

# %%
from torch import nn

def train(model, x, y, updates=400):
    optimiser = torch.optim.Adam(model.parameters(), lr=0.002)
    for _ in range(updates):
        rows = torch.randint(len(x), (128,))  # a minibatch: 128 examples drawn at random
        loss = ((model(x[rows])[:, 0] - y[rows]) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

# %% [markdown]
# | line | what it does |
# | --- | --- |
# | `optimiser = …` | The optimiser keeps the weights and knows the learning rate, `lr`. **Adam** adapts the size of the step to each weight: if its slopes keep their sign, the steps become longer; if the sign keeps flipping, they become shorter |
# | `loss = …` | The forward pass. PyTorch notes each operation. The loss is a mean over a **minibatch**: all examples would be slower, a single one too noisy |
# | `optimiser.zero_grad()` | Forget the last slopes: PyTorch adds new ones to them |
# | `loss.backward()` | Backpropagation: the slope of the loss for every weight |
# | `optimiser.step()` | A step downhill with every weight |
#
# ## 5.5 A window that moves
#
# Take the neuron of 5.1, with its nine weights, and move it across a larger picture like a window. At each place write down its output. That is a
# **convolution** (an engineer would mirror it), and its weights are a *kernel*.

# %%
picture = np.pad(np.ones((4, 2)), ((1, 1), (2, 2)))  # a building
one, kernel = (torch.tensor(x, dtype=torch.float32)[None, None] for x in (picture, weights))
result = torch.nn.functional.conv2d(one, kernel)[0, 0]
draw_maps({"picture": picture, "kernel": weights, "what comes out": result}, numbers=True)

# %% [markdown]
# Blue marks the building's western edge, red its eastern one. The window fits in only four positions along each side, so the
# result is smaller than the picture. What nine weights learn in one place they know in all others.
#
# The agent's kernels read all five layers of the map at once: each has 5 × 5 weights for every layer, and adds up all the products.
# One kernel makes one new picture. The network has 16 kernels, so it makes 16 pictures, and the second convolution reads those.
#
# If the window moves by more than one cell at a time, that is a **stride**. With a stride of 3 the result has a third as many cells a side.
# That saves work and weights, at the cost of precision.
#
# ### What a unit can see
#
# A number in the second convolution's output depends on 5 × 5 numbers of the first one's, and each of those on 5 × 5 cells of the map. So how much
# of the map can it see? Slopes answer that, too. A cell that the number does not depend on has slope 0:

# %%
from uavdh_lite.checkpoint import load_agent

agent = load_agent("manhattan_ddqn")
maps = torch.rand(1, *agent.observation.map_shape, requires_grad=True)
pictures = agent.network.convolutions[:-1](maps)  # without the last step, which makes a list
pictures[0, :, 2, 2].sum().backward()  # the unit in the middle of each picture
seen = (maps.grad[0].abs().sum(0) > 0).int()

# %%
assert seen.any(dim=0).sum() == 17
draw_maps({"what it sees": seen}, uav=(15, 15))

# %% [markdown]
# This is the unit's **receptive field**, 17 of 31 cells a side. (Off centre, because with stride 3 two rows and columns are left over.) You can count it by hand. A unit of the second convolution sees 5 of the first one's, which lie 3 cells
# apart because of the stride, and each of these sees 5 cells: $5+4\cdot3=17$. In the paper's network both strides are 1, so a unit sees
# only $5+4=9$ cells. A building and a device that are further apart than that meet for the first time in the fully connected layers
# that follow, which see everything but have to learn each place separately.
#
# ## 5.6 One question, three networks
#
# A question to test the parts with: **is a device near the UAV?** Near means within three rows and three columns. The answer should be
# +1 if so and −1 if not. Half of our 8000 pairs are near. Every other one is for learning, the rest for the test. *In place*, a map has two layers: a 1 at the device, a 1 at the UAV. *Centred*, it has one, with a 1 where the device is as seen from the UAV.

# %%
from uavdh_lite.course.near_far import near_pairs

in_place, centred, y = near_pairs()

# %% [markdown]
# Three networks answer: a dense one in place, one with two convolutions in place, and a dense one that sees the centred map. Which ones will do?

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
# The **dense network in place** does well in training and poorly in the test. It has learned its pairs by heart, and guesses at new ones. This is **overfitting**: it fits its examples better than the world that they come from. A weight of its first layer belongs
# to an absolute place, such as "device at (4, 7)". Whether that is near depends on the UAV, and nothing that it learns about one pair tells
# it anything about the next.
#
# The **convolutions** repair that. Their window sees device and UAV *together*, wherever both may be, so what a kernel learns about one place holds
# everywhere. And **centred**, even the dense network is nearly perfect, because the question has become trivial: the answer is whether the
# device lies in a certain square of the picture.
#
# So what does centring add? A convolution compares only what lies within its window. "Near"
# fits into one; "can I reach the landing zone in the time that I have left?" does not, because the zone may be a whole
# city away. In the centred
# frame every displacement from the UAV is a single place in the picture, and a single weight can ask for it. (How long the way around walls is, the dense layers still have to learn.) Whether that helps
# an agent that has convolutions anyway is a question for an experiment: notebook 8.
#
# ## 5.7 The whole network
#
# Go back to the drawing at the top. The last layer has six neurons without a ReLU, because a Q-value may be negative. Why six? The action could also be an input and the
# Q-value the only output, but then it would take six passes to find the best action. With six outputs one pass gives all, and they share what they know about the picture.
#
# | layer | the network of the recipe `paper` (authors' code) gives | the agent's gives |
# | --- | --- | --- |
# | the map | 5×31×31 | 5×31×31 |
# | convolution, 16 kernels 5×5 | 16×27×27 | 16×9×9, with stride 3 |
# | convolution, 16 kernels 5×5 | 16×23×23 | 16×5×5 |
# | as a list, and the time | 8465 | 401 |
# | three fully connected layers | 256 each | 256 each, with **layer normalisation** before the ReLU (512 weights more in each) |
# | output | 6 | 6 |
# | weights in all | 2,308,854 | 246,006 |
#
# Layer normalisation shifts and scales the 256 sums to mean 0 and spread 1, so that none is far too large for the next layer. The time comes in behind the convolutions because it has no place in the city:
# as a layer it would be 961 times the same number, and as one number it still has a weight in each neuron.
#
# Nearly all of the paper's weights are in the first dense layer, 256 neurons with 8465 inputs. So the size of the *city* is built into the network. The number of devices is not.
#
# ## Recap
#
# - A neuron is a weighted sum, and a ReLU puts a kink in the line. Many kinks make any curve.
# - Gradient descent moves each weight downhill. Backpropagation computes all slopes in one pass from back to front.
# - A convolution moves one neuron across a picture.
# - A dense network in place overfits; with convolutions or the centred frame, what is learned in one place holds in others.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/05_network_by_hand/05_network_by_hand.ipynb) come with checks and hints.
#
# Further reading: Nielsen, [*Neural Networks and Deep Learning*](http://neuralnetworksanddeeplearning.com), chapters 1 and 2.
