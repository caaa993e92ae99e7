# %% [markdown]
# # Exercises 13 · Any city
#
# They go with notebook `13_any_city`. You need numpy: slices, and indexing with lists and Booleans. The last exercise needs the
# standard error of a mean.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the answer is
# right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.small_city_map.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 13.1 · A small city in a large map (2 points, 12 minutes)
#
# The network's maps have one size. A smaller city lies in them like an island in no-fly cells. You are given
#
# - `layers`: $(3, m, m)$ Booleans, the city's layers in the order landing zone, no-fly zone, buildings,
# - `uav`: the UAV's cell in the city, (row, col), counted from 0,
# - `size`: $M$, the largest city that the network can see, $M \ge m$.
#
# Return the centred map, a new array of Booleans, $(3, 2M-1, 2M-1)$: the UAV's cell is in the middle, at $(M-1, M-1)$, and the
# rest of the city lies around it as before. Outside the city no-fly is True, and the other two layers are False.
#
# An example: $m = 2$, $M = 3$, and the UAV is at (0, 1). The map has five cells on a side, and its cell (2, 2) shows the UAV's. The
# city's cell (0, 0), to the west of it, is at (2, 1), and the whole city is in rows 2 and 3, columns 1 and 2.

# %%
def centred_map(layers, uav, size):
    """The map of a city of any size, the UAV in the middle, (3, 2M - 1, 2M - 1) bool."""
    ### BEGIN SOLUTION
    _, m, _ = layers.shape
    seen = np.zeros((3, 2 * size - 1, 2 * size - 1), bool)
    seen[1] = True
    row, col = size - 1 - uav[0], size - 1 - uav[1]
    seen[:, row : row + m, col : col + m] = layers
    return seen
    ### END SOLUTION

# %%
checks.small_city_map(centred_map)

# %% [markdown]
# The check also compares your map with the library's own, `Observation(city, size=M)`, for a random city.

# %% [markdown]
# ## 13.2 · Turn the map, turn the actions back (3 points, 20 minutes)
#
# A square has eight symmetries: four turns (by 0, 90, 180 and 270 degrees), and the same four after swapping left and right. If a
# whole city is turned, the best flight turns with it. A network knows this only roughly. So ask it about all eight maps,
# and average what it says. You are given
#
# - `q_of`: a function that takes a stack of maps, $(n, C, W, W)$ with any $n$, and returns their Q-values, $(n, 6)$,
# - `layers`: one map, $(C, W, W)$, north at the top, the UAV in the middle.
#
# The actions are, in this order, north, east, south, west, hover, land. Return the mean Q-values of the six actions, $(6,)$. Each
# Q-value must count for the right action: the one that, in the map *as it was given*, leads to the same cell.
#
# An example: `np.rot90(layers, 1, axes=(1, 2))` is the map turned to the left by 90 degrees. What was north of the UAV is now west
# of it. So the Q-value of *west* in the turned map counts for *north*. Hover and land stay what they are.
#
# | in the given map | north | east | south | west | hover | land |
# | --- | --- | --- | --- | --- | --- | --- |
# | in the map turned to the left | west | north | east | south | hover | land |
# | number of that action | 3 | 0 | 1 | 2 | 4 | 5 |

# %%
def mean_q(q_of, layers):
    """The Q-values averaged over the eight symmetries of the square, (6,)."""
    ### BEGIN SOLUTION
    total = np.zeros(6)
    for turns in range(4):
        north, east, south, west = np.roll([0, 1, 2, 3], turns)
        (q,) = q_of(np.rot90(layers, turns, axes=(1, 2))[None])
        total += q[[north, east, south, west, 4, 5]]
        (q,) = q_of(np.rot90(layers[:, :, ::-1], turns, axes=(1, 2))[None])
        total += q[[north, west, south, east, 4, 5]]
    return total / 8
    ### END SOLUTION

# %%
checks.symmetric_q(mean_q)

# %% [markdown]
# Now it is exact: turn the map, and the mean Q-values of the four moves change places, and nothing else happens.

# %% [markdown]
# ## 13.3 · How sure, if missions share a city? (2 points, 12 minutes)
#
# An agent flew $N$ missions in $C$ random cities, and you want the mean over *all* cities that the generator could draw. Some cities
# are harder than others, so missions in one city tend to be good or bad together. The half-width of a 95 % interval of the
# mean $\bar x$ is then
#
# $$1.96\;\frac{1}{N}\,\sqrt{\frac{C}{C-1}\;\sum_{\text{cities}}\Big(\sum_{i \text{ in the city}} (x_i - \bar x)\Big)^2}$$
#
# Why: the cities are what was drawn independently, so the sum of each city is *one* random number, and the spread of these sums says how
# far off the mean may be.
#
# - `values`: $(N,)$, $x_i$ of each mission: floats, whole numbers or Booleans,
# - `city`: $(N,)$, the number of each mission's city. Numbers are names: any ints, in any order. There are at least two cities, and they may have
#   different numbers of missions.
#
# Return the half-width, one number.
#
# An example: values 4, 6, 1, 1 in the cities 0, 0, 1, 1. The mean is 3, the differences from it are 1, 3, −2, −2. Their sums are 4 in city 0
# and −4 in city 1. The half-width is 1.96/4 · √(2/1 · (16 + 16)) = 1.96 · 8/4 = 3.92. As if the four missions were independent, it would
# be 1.96 · √6/√4 = 2.40: too sure.
#
# The limit case: if each mission has a city of its own, then $C = N$ and each sum is a single difference. The formula becomes
# $1.96\, s/\sqrt{N}$ with $s^2 = \frac{1}{N-1}\sum_i (x_i - \bar x)^2$, the usual half-width.

# %%
def half_width(values, city):
    """Half the width of the 95 % interval of the mean, if cities are drawn at random."""
    ### BEGIN SOLUTION
    off = values - values.mean()
    sums = np.array([off[city == one].sum() for one in np.unique(city)])
    count = len(sums)
    return 1.96 * np.sqrt(count / (count - 1) * (sums**2).sum()) / len(values)
    ### END SOLUTION

# %%
checks.clustered_half_width(half_width)

# %% [markdown]
# Try it: a hundred cities, with 1, 10 and 100 missions each. When does another mission in the same city no longer help?
