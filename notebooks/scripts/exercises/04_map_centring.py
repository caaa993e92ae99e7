# %% [markdown]
# # Exercises 4 · Map centring
#
# They go with notebook `04_map_centring`. You need indexing of numpy arrays, and what a convolution and a fully
# connected layer are.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the
# answer is right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.city_cell.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 4.1 · From the map back to the city (1 point, 8 minutes)
#
# The tutorial asked where a cell of the city appears in the centred map. Now the way back. A city has M×M cells, and
# its centred map has (2M − 1)×(2M − 1) places; rows and columns of both are counted from 0. The cell over which the
# UAV is appears in the middle of the map.
#
# - `place`: a pair `(row, col)`, a place in the centred map
# - `uav`: a pair `(row, col)`, the cell of the city over which the UAV is
# - `size`: M, the cells a side of the city
#
# Which cell of the city is at this place? Give back the pair `(row, col)`, or `None` if the place is outside the city.

# %%
def city_cell(place, uav, size):
    """The city's cell (row, col) at this place of the centred map, or None outside the city."""
    ### BEGIN SOLUTION
    row = uav[0] + place[0] - (size - 1)
    col = uav[1] + place[1] - (size - 1)
    inside = 0 <= row < size and 0 <= col < size
    return (row, col) if inside else None
    ### END SOLUTION

# %%
checks.city_cell(city_cell)

# %% [markdown]
# ## 4.2 · Centre a layer (2 points, 14 minutes)
#
# Now the whole map, for one layer and one UAV. Use numpy as you like, but try to do without the
# library's `Observation`, that is the point of the exercise.
#
# - `layer`: an array (M, M) of numbers or Booleans, indexed `[row, col]`
# - `uav`: a pair `(row, col)`, the cell over which the UAV is
# - `outside`: the value of all places outside the city, 1 for the no-fly zone and 0 for the other layers, or any
#   other number
#
# Give back the centred map, a new array (2M − 1, 2M − 1): the layer, shifted so that the UAV's cell is in the middle,
# and `outside` everywhere else. Fractions must survive, in the layer (there may be 7.5 data units left) and in `outside`.

# %%
def centre(layer, uav, outside):
    """The centred map of this layer, (2M − 1, 2M − 1)."""
    ### BEGIN SOLUTION
    size = len(layer)
    centred = np.full((2 * size - 1, 2 * size - 1), outside, float)
    row, col = size - 1 - uav[0], size - 1 - uav[1]
    centred[row : row + size, col : col + size] = layer
    return centred
    ### END SOLUTION

# %%
checks.centre(centre)

# %% [markdown]
# ## 4.3 · How many weights? (3 points, 25 minutes)
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
