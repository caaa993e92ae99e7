# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 2 · Shadow ray tracing
#
# These exercises go with notebook `02_shadow_ray_tracing`. You need the equation of a line, loops
# and Boolean arrays.
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
from uavdh_lite.city import City
from uavdh_lite.course.given import blocked
from uavdh_lite.shadowing import line_of_sight

# %% [markdown]
# ## 2.1 · Does the ray cross the cell? (1 point, 10 minutes)
#
# A cell is given by a pair `(row, col)` of whole numbers. It is a square of side 1 whose centre has
# these two numbers as coordinates. Its *open interior* is the square without its edges and corners.
# Write a function that says whether the straight segment between the centres of the cells `start`
# and `end` crosses the open interior of `cell`.
#
# The notebook gives the condition for a segment from (0, 0) to another cell $(R, C)$: a cell
# $(r, c)$ in the rectangle between these two cells is crossed if and only if
#
# $$2\,|R\,c - C\,r| < |R| + |C|.$$
#
# Turn this condition into a function that works for any `start`, `end` and `cell`. The cells
# `start` and `end` themselves count as crossed. They may also be the same cell, and then the
# segment is a single point. The segments can be a million cells long and go in any direction. Make
# sure that no rounding can spoil the answer. Try to do without the library's `crossed_cells`,
# because writing the test yourself is the point of the exercise.
#
# <details><summary>Hint</summary>
#
# The notebook's segment begins at (0, 0): shift yours, and the cell with it, so that it begins
# there, too. Which numbers may then be negative, and which rectangle must the cell lie in? What
# does the condition say if R = C = 0?
# </details>
#
# <details><summary>Another hint</summary>
#
# (R, C) is end minus start, and (r, c) is cell minus start, component by component. The cell is in
# the rectangle if min(R, 0) <= r <= max(R, 0), and likewise for c and C. If R = C = 0, the
# rectangle is one cell, and the condition, 0 < 0, is false although that cell is crossed; so treat
# this case separately.
# </details>

# %%
def crosses(start, end, cell):
    """Whether the segment from start to end crosses the open interior of the cell: True or False."""
    ### BEGIN SOLUTION
    rows, cols = end[0] - start[0], end[1] - start[1]
    r, c = cell[0] - start[0], cell[1] - start[1]
    between = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    if rows == cols == 0:
        return between
    return between and 2 * abs(rows * c - cols * r) < abs(rows) + abs(cols)
    ### END SOLUTION

# %%
checks.crosses(crosses)

# %% [markdown]
# ## 2.2 · A shadow map (2 points, 10 minutes)
#
# A city has M×M cells; `buildings` is a Boolean array of shape (M, M), indexed `[row, col]`. A
# device stands in the cell `device`, a pair `(row, col)`. The function `blocked(buildings, device,
# cell)` says whether the link between the device and a UAV over `cell` is blocked, by the rules of
# the notebook.
#
# Make the shadow map of the device: a new Boolean array of shape (M, M) that is True in each cell
# where the link is blocked.
#
# <details><summary>Hint</summary>
#
# Begin with an array that is False everywhere. For each place in the array, which cell must
# `blocked` be given?
# </details>
#
# <details><summary>Another hint</summary>
#
# Loop over all rows and columns. For each cell call blocked(buildings, device, cell), and write the
# answer into the array at that cell's row and column.
# </details>

# %%
print(blocked(City.load("village").buildings, (0, 7), (7, 0)))

# %%
def shadow_map(buildings, device):
    """Where the link to the device is blocked; (M, M) bool, indexed [row, col]."""
    ### BEGIN SOLUTION
    shadow = np.zeros(buildings.shape, bool)
    for row in range(len(buildings)):
        for col in range(len(buildings)):
            shadow[row, col] = blocked(buildings, device, (row, col))
    return shadow
    ### END SOLUTION

# %%
checks.shadow_map(shadow_map)

# %% [markdown]
# ## 2.3 · How asymmetric is a table? (2 points, 10 minutes)
#
# `line_of_sight(buildings)` gives a Boolean array of shape (M, M, M, M), indexed `[device_row,
# device_col, uav_row, uav_col]`: an entry is True if a device in the cell of the first two indices
# and a UAV over the cell of the last two see each other. Take two different cells, A and B, in no
# particular order (an *unordered pair*). The pair is *asymmetric* if it matters which of the two
# cells holds the device, that is, if "device in A, UAV over B" is True and "device in B, UAV over
# A" is False, or the other way round.
#
# What share of all unordered pairs of different cells is asymmetric? Write a function that takes
# such an array (made by any method, for any M > 1) and returns this share, a number from 0 to 1.
#
# <details><summary>Hint</summary>
#
# Turn the table into a square matrix with one row and one column for each cell. Where does this
# matrix differ from its transpose? How many unordered pairs are there?
# </details>
#
# <details><summary>Another hint</summary>
#
# With n = M² cells, reshape the array to (n, n) and compare the result with its transpose, .T: each
# asymmetric pair shows up twice. There are n(n − 1)/2 unordered pairs of different cells.
# </details>

# %%
def asymmetric_share(sight):
    """The share of the unordered pairs of different cells whose line of sight depends on the direction."""
    ### BEGIN SOLUTION
    cells = len(sight) ** 2
    pairs = sight.reshape(cells, cells)
    return (pairs != pairs.T).sum() / (cells * (cells - 1))
    ### END SOLUTION

# %%
checks.asymmetric_share(asymmetric_share)

# %% [markdown]
# Try your function on the city of the notebook, `City.load("manhattan").buildings`, once with the
# table that `line_of_sight` makes and once with the table that you get from `bresenham_fans` in
# `uavdh_lite.course.bresenham`, which notebook 13 explains. The first table must give 0. A share
# above 0 is a sure sign that a method is not exact, but a share of 0 does not prove that a method
# is exact: a rule can be symmetric and still be wrong.
