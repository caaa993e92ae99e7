# %% [markdown]
# # Exercises 5 · A network by hand
#
# These exercises go with notebook `05_network_by_hand`. You need numpy, slopes, and what a convolution is.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook. If it
# never finishes, interrupt the kernel with the stop button.

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
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 5.1 · A neuron that learns (3 points, 15 minutes)
#
# Train a single neuron, without PyTorch. It has one input, so it computes $w x + b$. Its loss is the mean of the squared errors over all
# examples,
#
# $$L(w, b) = \frac{1}{n} \sum_{k=1}^{n} (w x_k + b - y_k)^2.$$
#
# - `x`, `y`: arrays of $n$ inputs and of the $n$ outputs that belong to them
# - `rate`: the learning rate
# - `steps`: how many steps of gradient descent, each with all examples
#
# Both numbers begin at 0. In each step both move downhill at the same time. Return the pair $w$, $b$.
#
# <details><summary>Hint</summary>
#
# You need two slopes. Keep the error $w x_k + b - y_k$ of each example in an array. How does its square change if $w$ grows a little, and how
# if $b$ does?
# </details>
#
# <details><summary>Another hint</summary>
#
# The slope for $w$ is the mean of 2 · error · x, the slope for $b$ the mean of 2 · error. Compute both before you change either.
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
# A convolution moves a small window over the map. Compute what one kernel makes of one layer, without padding and with stride 1.
#
# - `layer`: an array (rows, columns) of numbers
# - `kernel`: an array of numbers, not larger than the layer; it need not be square
# - `bias`: a number
#
# At each place where the kernel lies wholly inside the layer, multiply window and kernel cell by cell, add up the products, and add the
# bias. Then apply ReLU: a number below 0 becomes 0. Return the array of these values. An example: the layer [[1, 2], [3, 4]] with the
# kernel [[1, −1]] and the bias 0 has two places. The sums are −1 and −1, so ReLU gives [[0], [0]].
#
# <details><summary>Hint</summary>
#
# Do one place first: lay the kernel on the corner, multiply cell by cell, add up, add the bias. How many places
# are there along a side?
# </details>
#
# <details><summary>Another hint</summary>
#
# There are rows − k + 1 places along the rows. At (i, j) the window is layer[i : i + k, j : j + k]; its value
# is (window * kernel).sum() + bias, or 0 if that is negative.
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
# The Q-network takes the centred map of a city with M×M cells, and the flying time that is left. It gives one Q-value
# for each of the six actions. Its parts, in order:
#
# - convolutions, one for each number in `strides`, each with `kernels` kernels of `kernel_size`×`kernel_size` cells.
#   A kernel sees all the layers that its convolution is given: first those of the map, then one for each kernel of
#   the convolution before. There is no padding: a kernel is only put where it lies wholly inside its input, first in
#   the corner, then each time `stride` cells further, along the rows and the columns, as long as it fits;
# - flattening into a list, to which the flying time is appended as one more number;
# - fully connected layers, one for each number in `hidden`, with that many neurons;
# - a fully connected output layer.
#
# Each kernel and each neuron, also those of the output, has a bias. How many numbers does the network learn, weights
# and biases together?
#
# - `layers`: the layers of the map, 5 in the paper
# - `size`: M, the cells a side of the *city*; the map is larger
# - `kernels`, `kernel_size`: whole numbers, 16 and 5 in the paper
# - `strides`: one stride for each convolution, `(1, 1)` in the paper; may have any length from 1 on
# - `hidden`: the neurons of each hidden layer, `(256, 256, 256)` in the paper; any length from 1 on
#
# An example, counted by hand: M = 2, so that the map has 3×3 cells, and 2 layers. One convolution has 3 kernels of
# 2×2 cells, with stride 1. Each of them sees both layers, so it has 2 · 2 · 2 = 8 weights and a bias: 3 · 9 = 27
# numbers. A kernel fits at 2×2 places and makes one layer of 2×2 of them, so there are 3 layers of 2×2. As a list these
# are 12 numbers, 13 with the flying time. A hidden layer of 4 neurons has 4 · (13 + 1) = 56 numbers, the output
# 6 · (4 + 1) = 30. That makes 27 + 56 + 30 = 113 for `weights(2, 2, 3, 2, (1,), (4,))`. A second convolution
# would see these 3 layers, not the 2 of the map.
#
# Try to do it with plain arithmetic, without torch, that is the point of the exercise. For the paper's network in a city
# with M = 16 it is 2,308,854.
#
# <details><summary>Hint</summary>
#
# Follow the shape of the map through the network, as in a table: layers and side before and after each
# convolution, then the length of the list, then layer by layer. Each kernel and each neuron has a bias.
# </details>
#
# <details><summary>Another hint</summary>
#
# A convolution has c·k·k weights and one bias a kernel, where c is the number of layers that it gets, and
# leaves (side − k) // stride + 1 cells a side. The list has kernels · side² numbers and the flying time. From n
# to m neurons: n·m + m. The output has 6.
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
# Print how many of them are in the first fully connected layer, with strides of 1 and of 2. That is where the size of
# the map is paid for.
