# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 5 · A network by hand
#
# These exercises go with notebook `05_network_by_hand`. You need a little numpy, the slope of a
# function, and an idea of what a convolution does.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check
# says whether the answer is right, and if not, what is probably wrong. Hints are folded away below
# each task. Your code runs inside this notebook. If it never finishes, interrupt the kernel with
# the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it,
# and write your own from memory. Solutions are in the folder `solutions`, beside `exercises`,
# unless somebody handed you a copy of the course without them.

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
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 5.1 · A neuron that learns (3 points, 15 minutes)
#
# Train a single neuron, without PyTorch. It has one input, so it computes $w x + b$. Its loss is
# the mean of the squared errors over all examples,
#
# $$L(w, b) = \frac{1}{n} \sum_{k=1}^{n} (w x_k + b - y_k)^2.$$
#
# - `x`, `y`: arrays of $n$ inputs and of the $n$ right outputs
# - `rate`: the learning rate
# - `steps`: the number of steps of gradient descent, each of which uses all examples
#
# Both $w$ and $b$ begin at 0, and in each step both move downhill at the same time. Return the pair
# $w$, $b$.
#
# <details><summary>Hint</summary>
#
# You need two slopes, one for $w$ and one for $b$. Keep the error $w x_k + b - y_k$ of each example
# in an array. How does the square of the error change if $w$ grows a little? How does it change if
# $b$ grows a little?
# </details>
#
# <details><summary>Another hint</summary>
#
# The slope for $w$ is the mean of 2 · error · x, and the slope for $b$ is the mean of 2 · error.
# Compute both slopes before you change $w$ or $b$.
# </details>

# %%
def fit(x, y, rate, steps):
    """The weight and the bias of a neuron after so many steps downhill."""
    ### BEGIN SOLUTION
    w, b = 0.0, 0.0
    for _ in range(steps):
        error = w * x + b - y
        slope_w, slope_b = (2 * error * x).mean(), (2 * error).mean()
        w -= rate * slope_w
        b -= rate * slope_b
    return w, b
    ### END SOLUTION

# %%
checks.fitted_line(fit)

# %% [markdown]
# ## 5.2 · A kernel moves over a map (2 points, 12 minutes)
#
# A convolution moves a small window over the map. Compute the output of one kernel for one layer of
# the map, without padding and with stride 1.
#
# - `layer`: an array of numbers, of shape (rows, columns)
# - `kernel`: an array of numbers, not larger than the layer; it need not be square
# - `bias`: a number
#
# At each place where the kernel lies wholly inside the layer, multiply window and kernel cell by
# cell, add up the products, and add the bias. Then apply ReLU: a number below 0 becomes 0. Return
# the array of these values. For example, the kernel [[1, −1]] fits at two places in the layer [[1,
# 2], [3, 4]]. With a bias of 0 both sums are −1, so ReLU gives [[0], [0]].
#
# <details><summary>Hint</summary>
#
# Do one place first: lay the kernel over a corner, multiply cell by cell, add up the products, and
# add the bias. How many places are there along each side?
# </details>
#
# <details><summary>Another hint</summary>
#
# A kernel of h rows and w columns fits at rows − h + 1 places from top to bottom, and at columns −
# w + 1 places from left to right. At (i, j) the window is layer[i : i + h, j : j + w]; the output
# there is (window * kernel).sum() + bias, or 0 if that is negative.
# </details>

# %%
def convolve(layer, kernel, bias):
    """The values of one kernel at all places of a layer, after ReLU."""
    ### BEGIN SOLUTION
    height, width = kernel.shape
    rows, cols = layer.shape[0] - height + 1, layer.shape[1] - width + 1
    result = np.zeros((rows, cols))
    for i in range(rows):
        for j in range(cols):
            window = layer[i : i + height, j : j + width]
            result[i, j] = max((window * kernel).sum() + bias, 0)
    return result
    ### END SOLUTION

# %%
checks.convolve(convolve)

# %% [markdown]
# ## 5.3 · How many weights? (3 points, 15 minutes)
#
# The Q-network takes the centred map of a city with M×M cells, and the remaining flying time. It
# gives one Q-value for each of the six actions. These are the network's parts, in order:
#
# - convolutions, one for each number in `strides`, each with `kernels` kernels of
#   `kernel_size`×`kernel_size` cells. A kernel sees all the layers that its convolution is given.
#   The first convolution is given the layers of the map; a later one is given one layer for each
#   kernel of the convolution before it. There is no padding: a kernel is placed only where it lies
#   wholly inside these layers. The kernel starts in the north-western corner and moves on by one
#   stride each time, along the rows and the columns, as long as it fits.
# - flattening into a list, to which the flying time is appended as one more number.
# - fully connected layers, one for each number in `hidden`, with that many neurons.
# - a fully connected output layer.
#
# Each kernel and each neuron, including those of the output, has a bias. How many numbers does the
# network learn, weights and biases together?
#
# - `layers`: the number of layers of the map, 5 in the paper
# - `size`: M, the number of cells along each side of the *city*; the map is larger
# - `kernels`, `kernel_size`: whole numbers, 16 and 5 in the recipe `paper`
# - `strides`: one stride for each convolution, `(1, 1)` in `paper`; there may be any number of convolutions, but at least one
# - `hidden`: the number of neurons of each hidden layer, `(256, 256, 256)` in `paper`; again, there is at least one such layer
#
# An example, counted by hand: M = 2, so the map has 3×3 cells; we give it 2 layers. There is one
# convolution, with 3 kernels of 2×2 cells and stride 1. Each kernel sees both layers, so it has 2 ·
# 2 · 2 = 8 weights and a bias, which makes 3 · 9 = 27 numbers for the convolution. A kernel fits at
# 2×2 places, so each kernel makes a layer of 2×2 numbers, and there are 3 such layers. Flattened,
# these are 12 numbers, or 13 with the flying time. A hidden layer of 4 neurons then has 4 ·
# (13+1) = 56 learned numbers, and the output has 6 · (4+1) = 30. In all, `weights(2, 2, 3, 2, (1,),
# (4,))` is 27 + 56 + 30 = 113. If there were a second convolution, it would see these 3 layers, not
# the 2 of the map.
#
# Try to count with plain arithmetic, without torch, because counting is the point of the exercise.
# For the recipe `paper` in a city with M = 16 the result is 2,308,854.
#
# <details><summary>Hint</summary>
#
# Follow the numbers through the network, and write down their shape at each point in a table:
# before and after each convolution, the number of layers and the side of a layer; then the length
# of the list; then the number of neurons of each fully connected layer. Each kernel and each neuron
# has a bias.
# </details>
#
# <details><summary>Another hint</summary>
#
# A convolution has c·k·k weights and one bias for each kernel, where c is the number of layers that
# the convolution is given and k the kernel's side; it leaves (side − k) // stride + 1 cells along
# each side. The list has kernels · side² numbers and one more for the flying time. A fully
# connected layer from n to m neurons has n·m + m numbers. The output has 6 neurons.
# </details>

# %%
def weights(layers, size, kernels, kernel_size, strides, hidden):
    """The number of weights and biases of the Q-network."""
    ### BEGIN SOLUTION
    side, total = 2 * size - 1, 0
    for stride in strides:
        total += kernels * (layers * kernel_size**2 + 1)
        side = (side - kernel_size) // stride + 1
        layers = kernels
    width = layers * side**2 + 1
    for neurons in (*hidden, 6):
        total += neurons * (width + 1)
        width = neurons
    return total
    ### END SOLUTION

# %%
checks.network_weights(weights)

# %% [markdown]
# Print how many of the learned numbers belong to the first fully connected layer, with strides of 1
# and with strides of 2. This is the layer that grows with the map.
