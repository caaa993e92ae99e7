# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 13 · Any city
#
# These exercises go with notebook `13_any_city`. You need numpy and the standard error of a mean.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook. If it
# never finishes, interrupt the kernel with the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it, and write your own from
# memory. Solutions are in the folder `solutions`, beside `exercises`, unless somebody handed you a copy of the course without
# them.

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
# ## 13.1 · Turn the map, turn the action (2 points, 10 minutes)
#
# Every city is eight cities at no cost: it can be turned in four ways, and so can its mirror image. If the map is turned, the
# best action turns with it. You are given
#
# - `layers`: a map, of shape $(C, W, W)$, north at the top,
# - `action`: the number of an action: north 0, east 1, south 2, west 3, hover 4, land 5,
# - `turns`: how many quarter turns to the left, 0 to 3,
# - `mirrored`: whether left and right are swapped before the turns.
#
# Return the new map and the number that the action has on it.
#
# An example: `np.rot90(layers, 1, axes=(1, 2))` is the map turned to the left once. What was north of the UAV is now west of it, so the
# action 0, north, becomes 3, west.
#
# <details><summary>Hint</summary>
#
# Write down for each of the four moves where it points after one turn, and where it points in a mirror. Which two actions never change?
# </details>
#
# <details><summary>Another hint</summary>
#
# layers[:, :, ::-1] is the mirror image. A turn takes 1 from the number of a move, and % 4 brings −1 back to 3. The mirror swaps
# 1 and 3.
# </details>

# %%
def view(layers, action, turns, mirrored):
    """The map, mirrored and turned, and the action's number on it."""
    ### BEGIN SOLUTION
    if mirrored:
        layers = layers[:, :, ::-1]
    seen = np.rot90(layers, turns, axes=(1, 2))
    if action < 4:
        move = [0, 3, 2, 1][action] if mirrored else action
        action = (move - turns) % 4
    return seen, action
    ### END SOLUTION

# %%
checks.view(view)

# %% [markdown]
# ## 13.2 · How sure are you if missions share a city? (2 points, 12 minutes)
#
# An agent flew $N$ missions in $C$ random cities, and you want the mean over *all* cities that the generator could draw. Some cities
# are harder than others, so missions in one city tend to be good or bad together. The half-width of a 95 % interval of
# the mean $\bar x$ is then
#
# $$t\;\frac{1}{N}\,\sqrt{\frac{C}{C-1}\;\sum_{\text{cities}}\Big(\sum_{i \text{ in the city}} (x_i - \bar x)\Big)^2}$$
#
# The reason is that the cities, not the missions, were drawn independently, so the sum of each city is *one* random
# number, and the spread of these sums says how far off the mean may be. But a few sums say little about their own spread,
# so the factor $t$ is not 1.96. It is *Student's*, for $C-1$ degrees of freedom: 12.71 for two cities, 4.30 for three,
# 2.57 for six, 1.98 for a hundred. (With 1.96, the interval from two equally large cities would contain the true mean in
# only 70 % of cases.)
#
# - `values`: array of shape $(N,)$, $x_i$ of each mission: floats, whole numbers or Booleans,
# - `city`: array of shape $(N,)$, the number of each mission's city. The numbers are only names: any ints, in any order. There are at
#   least two cities, and they may have different numbers of missions,
# - `t`: Student's factor, a number.
#
# Return the half-width, one number.
#
# An example: values 4, 6, 1, 1 in the cities 0, 0, 1, 1. The mean is 3, and the differences from it are 1, 3, −2, −2. Their
# sums are 4 in city 0 and −4 in city 1. The half-width is 12.71/4 · √(2/1 · (16 + 16)) = 12.71 · 8/4 = 25.4: from two cities you
# know next to nothing about cities. If the four missions were treated as independent, it would be 3.18 · √6/√4 = 3.90.
#
# The limiting case: if each mission has a city of its own, then $C = N$ and each sum is a single difference. The formula
# becomes $t\, s/\sqrt{N}$ with $s^2 = \frac{1}{N-1}\sum_i (x_i - \bar x)^2$, the usual half-width.
#
# <details><summary>Hint</summary>
#
# Do the example by hand: the mean, the differences from it, one sum for each city. How does Python find the
# missions of one city?
# </details>
#
# <details><summary>Another hint</summary>
#
# off = values − values.mean(). For each `one` in np.unique(city) the sum is off[city == one].sum(); C is the number of sums.
# </details>

# %%
def half_width(values, city, t):
    """Half the width of the 95 % interval of the mean, if cities are drawn at random."""
    ### BEGIN SOLUTION
    off = values - values.mean()
    sums = np.array([off[city == one].sum() for one in np.unique(city)])
    count = len(sums)
    return t * np.sqrt(count / (count - 1) * (sums**2).sum()) / len(values)
    ### END SOLUTION

# %%
checks.clustered_half_width(half_width)

# %% [markdown]
# Try your function with a hundred cities and 1, 10 and 100 missions in each; then $t$ is 1.98. When does another mission in the same city no longer help?
