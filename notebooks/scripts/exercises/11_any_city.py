# %% [markdown]
# # Exercises 11 · Any city
#
# They go with notebook `11_any_city`. You need numpy and the standard error of a mean.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. An answer runs in this notebook: if it
# never ends, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 11.1 · Turn the map, turn the actions back (3 points, 15 minutes)
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
#
# <details><summary>Hint</summary>
#
# Take one turn only, np.rot90(layers, 1, axes=(1, 2)). What was north of the UAV: where is it now? Which of the
# six Q-values of that map belongs to north?
# </details>
#
# <details><summary>Another hint</summary>
#
# After one turn to the left, the Q-values of north, east, south, west are found at [3, 0, 1, 2]; after k turns
# at np.roll([0, 1, 2, 3], k). If the map is mirrored before that, layers[:, :, ::-1], swap what is found for
# east and for west.
# </details>

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
# ## 11.2 · How sure, if missions share a city? (2 points, 12 minutes)
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
#
# <details><summary>Hint</summary>
#
# Do the example by hand: the mean, the differences from it, one sum for each city. How does Python find the
# missions of one city?
# </details>
#
# <details><summary>Another hint</summary>
#
# off = values − values.mean(). For each `one` in np.unique(city) the sum is off[city == one].sum(); C is how
# many sums there are.
# </details>

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
