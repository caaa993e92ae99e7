# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 4 · What the network sees
#
# These exercises go with notebook `04_map_centring`. You need to know how numpy arrays are indexed.
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
# ## 4.1 · Centre a layer (2 points, 12 minutes)
#
# Centre one layer of the map, for one UAV. Use numpy as you like, but try to do without the
# library's `Observation`, because doing its work yourself is the point of the exercise.
#
# - `layer`: an array of numbers or Booleans, of shape (M, M), indexed `[row, col]`
# - `uav`: a pair `(row, col)`, the cell that the UAV is over
# - `outside`: the value of all places outside the city. It is 1 for the no-fly layer and 0 for the
#   other layers, but your function must work for any number
#
# Return the centred map, a new array of shape (2M − 1, 2M − 1): the layer, shifted so that the
# UAV's cell is in the middle, and `outside` everywhere else. Fractions must not be lost, either in
# the layer (there may be 7.5 data units left) or in `outside`.
#
# <details><summary>Hint</summary>
#
# Begin with a map that has the value `outside` everywhere. Where does the city's corner (0, 0) end
# up if the UAV's cell is in the middle?
# </details>
#
# <details><summary>Another hint</summary>
#
# The city's cell (0, 0) goes to (M − 1 − uav[0], M − 1 − uav[1]). From there the layer fills M rows
# southwards and M columns eastwards. Or surround the layer with a border that is M − 1 cells wide
# and has the value `outside` (np.pad), and cut out 2M − 1 rows, starting with row uav[0], and as
# many columns, starting with column uav[1].
# </details>

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
# ## 4.2 · The devices on the map (2 points, 12 minutes)
#
# Make the centred layer "data left" directly from a list of devices.
#
# - `size`: M, the number of cells on each side of the city
# - `uav`: a pair `(row, col)`, the cell that the UAV is over
# - `devices`: a list of such pairs, one for each device, no two of them equal; the list may be
#   empty
# - `data`: an array with the data that each device has left
#
# Return an array of shape (2M − 1, 2M − 1) that holds the data of each device at the device's place
# *as seen from the UAV*, which is in the middle, and 0 everywhere else.
#
# How does the shape of your array depend on the number of devices? The answer is the point of the
# exercise.
#
# <details><summary>Hint</summary>
#
# A device in the UAV's own cell lies in the middle, at (M − 1, M − 1). Where does a device one row
# south of the UAV lie?
# </details>
#
# <details><summary>Another hint</summary>
#
# row − uav[0] says how many rows south of the UAV the device is; this number may be negative. Add M
# − 1 to it to get the row in the array. Columns work in the same way.
# </details>

# %%
def data_layer(size, uav, devices, data):
    """The centred layer "data left", (2M − 1, 2M − 1)."""
    ### BEGIN SOLUTION
    layer = np.zeros((2 * size - 1, 2 * size - 1))
    for k in range(len(devices)):
        row, col = devices[k]
        layer[row - uav[0] + size - 1, col - uav[1] + size - 1] = data[k]
    return layer
    ### END SOLUTION

# %%
checks.data_layer(data_layer)
