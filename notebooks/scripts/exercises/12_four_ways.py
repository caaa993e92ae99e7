# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 12 · Four ways to knowledge
#
# These exercises go with notebook `12_four_ways`. You need numpy: indexing with arrays, and **broadcasting**, which makes a
# table out of a row and a column.
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
# ## 12.1 · The failsafe's mask (2 points, 12 minutes)
#
# Which actions leave enough time to land? Cells are numbered from 0, and actions from 0 to 5: north, east, south, west,
# hover, land. You are given
#
# - `distance`: whole numbers, of shape (cells,), the moves from each cell to the landing zone: 0 in the zone, −1 where there is no way,
# - `next_cell`: array of shape (cells, 6), the cell of the UAV after each action; after a refused action it is the same cell,
# - `cell` and `time_left`: arrays of shape $(B,)$, where $B$ UAVs are and how many units of time they have left, at least 1.
#
# Every action takes one unit of time, landing included. Landing is possible only in the landing zone, and ends the flight.
# Elsewhere it is refused, and takes one unit of time, like hovering.
#
# Return a new array of Booleans, of shape $(B, 6)$: for each UAV and each action, whether the UAV can still land in time if it takes this
# action now. The time needed is that of the action itself, of the moves home after it, and of the landing. Landing at once, in the zone,
# always fits. (If nothing fits for a UAV, its row is all False. The library then lets the pilot do what it likes.)
#
# An example: the UAV is two moves from the zone and four units of time are left. It may fly home (one move, then one more and
# the landing), and it may hover once. It must not fly further away from the zone.
#
# <details><summary>Hint</summary>
#
# Look at the cell that each action leads to. How many units of time are left when the UAV is there, and how
# many does it take from there to fly home and land?
# </details>
#
# <details><summary>Another hint</summary>
#
# distance[next_cell[cell]] has shape (B, 6): the moves home after each action. One unit more for landing must fit into time_left − 1.
# Then there are two special cases: −1, and landing at once.
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
# This is the whole guarantee: a pilot that always takes an action that fits never crashes, because after such an action there
# is again one that fits.

# %% [markdown]
# ## 12.2 · What a cell really brings (2 points, 15 minutes)
#
# The layer *expected data* of notebook 12, section 12.2, is an estimate: it gives all four slots of a step to one device. What
# does a step bring by the rule of notebook 3, section 3.5, if the UAV hovers over a cell and there is no fading? In every slot,
# of the devices that have data left, the loudest sends. It sends what the slot carries, its rate, but no more than it has left.
# When it is empty, the next slot goes to another device.
#
# - `rate`: array of shape (K, M, M), the rate without fading of each device to a UAV over each cell, data units a slot, above 0;
#   no two are equal over the same cell
# - `left`: array of shape (K,), the data units that each device has left at the start of the step
#
# Return the layer, an array of shape (M, M): for each cell the data of the four slots together, if the UAV spends the step there. Leave
# the arrays as they are.
#
# An example with one cell: the rates are 3 and 2, and the devices have 4 and 9 units left. The
# slots bring 3, 1, 2 and 2, together 8. The told layer says $\max(\min(12, 4), \min(8, 9)) = 8$,
# too. But if the first device has 5 units left, the layer still says 8, whereas the slots bring 9.
#
# <details><summary>Hint</summary>
#
# Do one cell first, slot by slot, and keep account of what each device has left. Which devices must never be chosen?
# </details>
#
# <details><summary>Another hint</summary>
#
# For each cell begin with a copy of `left`. Four times: set the rate of empty devices to −infinity, take the largest, send the smaller of
# that rate and what the device has left, and subtract this amount.
# </details>

# %%
def brings(rate, left):
    """The data units of a step over each cell, (M, M), without fading."""
    ### BEGIN SOLUTION
    layer = np.zeros(rate.shape[1:])
    for row, col in np.ndindex(layer.shape):
        rest = left.astype(float)
        for _ in range(4):
            heard = np.where(rest > 0, rate[:, row, col], -np.inf)
            device = heard.argmax()
            sent = min(rate[device, row, col], rest[device])
            rest[device] -= sent
            layer[row, col] += sent
    return layer
    ### END SOLUTION

# %%
checks.data_of_a_step(brings)

# %% [markdown]
# Why is the agent told the estimate? Because it takes one line of code for a whole batch of cities, and is close to the truth
# wherever one device is much louder than the others.
