# %% [markdown]
# # Exercises 12 · Four ways past the paper
#
# These exercises go with notebook `12_four_ways`. You need numpy: indexing with arrays, and tables made of a row and a column.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook.
# If it never finishes, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 12.1 · The failsafe's mask (2 points, 12 minutes)
#
# Which actions leave enough time to land? Cells have numbers from 0 on, actions the numbers 0 to 5: north, east, south, west, hover,
# land. You are given
#
# - `distance`: (cells,) whole numbers, the moves from each cell to the landing zone: 0 in the zone, −1 where there is no way,
# - `next_cell`: (cells, 6), the cell of the UAV after each action; after a refused action it is the same cell,
# - `cell` and `time_left`: $(B,)$ each, where $B$ UAVs are and how many units of time they have left, at least 1.
#
# Every action takes one unit of time, landing included. Landing is possible in the landing zone only, and ends the flight.
# Elsewhere it is refused, and takes its unit of time like hovering.
#
# Return a new array of Booleans, $(B, 6)$: whether the UAV can still land in time if it takes this action now. That counts the action
# itself, the moves home after it, and the landing. To land at once, in the zone, always fits. (If nothing fits, a row is all False. The library
# then lets the pilot do what it likes.)
#
# An example: the UAV is two moves from the zone and four units of time are left. It may fly home (one move, then one more and
# the landing), and it may hover once. It must not fly off.
#
# <details><summary>Hint</summary>
#
# Look at the cell that each action leads to. How many units of time are left when the UAV is there, and how
# many does it take from there to be on the ground?
# </details>
#
# <details><summary>Another hint</summary>
#
# distance[next_cell[cell]] is (B, 6): moves home after each action. One unit more for landing must fit into
# time_left − 1. Then two special cases: −1, and landing at once.
# </details>

# %%
def fits(distance, next_cell, cell, time_left):
    """Whether each action leaves time to land, (B, 6) bool."""
    ### BEGIN SOLUTION
    home = np.where(distance < 0, np.inf, distance)
    in_time = home[next_cell[cell]] + 1 <= time_left[:, None] - 1
    in_time[:, 5] |= distance[cell] == 0
    return in_time
    ### END SOLUTION

# %%
checks.failsafe_mask(fits)

# %% [markdown]
# This is the whole guarantee: who always takes an action that fits never crashes, because after such an action there is again
# one that fits.

# %% [markdown]
# ## 12.2 · What a cell has to offer (2 points, 10 minutes)
#
# A network can be told what can be computed. Such a layer says of every cell how much data a step over it is expected to bring. A step has
# four communication slots. In them one device sends: the one that can send most. It sends four times its mean rate, but no more than it
# has left.
#
# - `rate`: (K, M, M), the mean rate of each device to a UAV over each cell, data units a slot
# - `left`: (K,), the data units that each device has left
#
# Return the layer, (M, M): for each cell the most data units that one device sends in a step there. Leave the arrays as they are.
#
# <details><summary>Hint</summary>
#
# What could one device send in the four slots of a step, if nobody else sent? What limits it? Only one device
# sends at a time.
# </details>
#
# <details><summary>Another hint</summary>
#
# np.minimum(4 * rate, left[:, None, None]) is (K, M, M): left becomes a column for the map. Then the largest
# over the devices, axis 0.
# </details>

# %%
def told(rate, left):
    """The data units that the best device sends in a step over each cell, (M, M)."""
    ### BEGIN SOLUTION
    return np.minimum(4 * rate, left[:, None, None]).max(axis=0)
    ### END SOLUTION

# %%
checks.expected_data(told)
