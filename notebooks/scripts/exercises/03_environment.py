# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 3 · The environment
#
# These exercises go with notebook `03_environment`. You need arithmetic, Boolean arrays and a
# little numpy.
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
from uavdh_lite.channel import rate

# %% [markdown]
# ## 3.1 · Who gets the slot? (1 point, 10 minutes)
#
# In a communication slot one device sends: the one with the highest SNR among those that have data
# left. It uploads as much as the slot carries, `rate(snr_db)` data units, but no more than it has
# left. There are K ≥ 1 devices.
#
# - `snr_db`: array of shape (K,), the SNR of each device in this slot, in dB; it is often negative,
#   and no two devices have the same SNR
# - `data_left`: array of shape (K,), the data units that each device has left, 0 or more
#
# Return two numbers: the device that is served, an index from 0 to K − 1, and the data units that
# it uploads. If no device has data left, return −1 and 0. Leave the two arrays as they are.
#
# <details><summary>Hint</summary>
#
# First rule out the devices without data. Then find the one with the highest SNR among the rest,
# and return its index among all devices. Which two amounts limit how much data it uploads?
# </details>
#
# <details><summary>Another hint</summary>
#
# Leave the empty devices in the array, but give them an SNR that never wins, so that all devices
# keep their indices. Would 0 dB be low enough? What if all devices are empty? The winner uploads
# the smaller of two amounts.
# </details>

# %%
def slot(snr_db, data_left):
    """The device that has the slot (-1 for none) and the data units it uploads."""
    ### BEGIN SOLUTION
    if not (data_left > 0).any():
        return -1, 0.0
    device = int(np.where(data_left > 0, snr_db, -np.inf).argmax())
    return device, min(rate(snr_db[device]), data_left[device])
    ### END SOLUTION

# %%
checks.tdma_slot(slot)

# %% [markdown]
# ## 3.2 · Rewards by hand (2 points, 10 minutes)
#
# Here are two short flights, the first with two devices and the second with one. The reward is 1
# for each data unit uploaded, −0.2 for each step in which the UAV does not land, −1 if the safety
# controller intervenes, and −150 if the flying time runs out without a landing. If several of these
# terms apply to a step, add them up. The column "the link could carry" says how many data units
# could be uploaded in the four slots of the step, and from which device; a device cannot upload
# more than it has left. In the step that ends an episode, be it a landing or a crash, nothing is
# uploaded.
#
# **Flight A.** At the start device 0 has 4.0 data units and device 1 has 3.0.
#
# | step | time left before the step | action | what happens | the link could carry |
# | --- | --- | --- | --- | --- |
# | 1 | 6 | south | flies south | 0.0 (device 0) |
# | 2 | 5 | east | there is a tall building: hovers instead | 0.5 (device 0) |
# | 3 | 4 | south | flies south | 2.5 (device 0) |
# | 4 | 3 | hover | hovers | 2.5 (device 0) |
# | 5 | 2 | west | flies west, to the landing zone | 0.5 (device 1) |
# | 6 | 1 | land | lands | 2.0 (device 1) |
#
# **Flight B.** At the start the only device has 6.0 data units.
#
# | step | time left before the step | action | what happens | the link could carry |
# | --- | --- | --- | --- | --- |
# | 1 | 3 | north | flies north | 1.8 |
# | 2 | 2 | land | not in the landing zone: hovers instead | 1.0 |
# | 3 | 1 | land | not in the landing zone: hovers instead | 1.5 |
#
# Work out the reward of each step with pencil and paper. Return two lists: six numbers for flight
# A, and three for flight B.
#
# <details><summary>Hint</summary>
#
# Ask four questions about each step. What was uploaded? Did the UAV land? Did the controller
# intervene? Did the time run out without a landing? More than one term may apply to a step.
# </details>
#
# <details><summary>Another hint</summary>
#
# Keep track of how much data each device has left, because a device uploads no more than it has,
# and nothing is uploaded in the step that ends a flight. Every step except a landing costs 0.2, and
# the reward of flight B's last step has three terms.
# </details>

# %%
def rewards_by_hand():
    """The rewards of the steps of flight A and of flight B: two lists of numbers."""
    ### BEGIN SOLUTION
    return [-0.2, -0.7, 2.3, 0.8, 0.3, 0], [1.6, -0.2, -151.2]
    ### END SOLUTION

# %%
checks.rewards_by_hand(rewards_by_hand)

# %% [markdown]
# ## 3.3 · The safety controller (3 points, 15 minutes)
#
# The UAV is over the cell `cell`, a pair `(row, col)`, in a city with M×M cells, and wants to take
# the action `action`, a number: 0 north (row − 1), 1 east (col + 1), 2 south (row + 1), 3 west (col
# − 1), 4 hover, 5 land. The safety controller replaces the action with hovering
#
# - if it is a move that leaves the grid or enters a cell in which the UAV may not fly;
# - if it is `land`, and the UAV is not over the landing zone.
#
# A UAV that hovers or lands stays in its cell. The number M is `city.size`, and the city has three
# Boolean layers of shape (M, M), indexed `[row, col]`:
#
# - `city.landing`: the landing zone
# - `city.no_fly`: where the UAV may not fly, that is, no-fly zones and tall buildings
# - `city.buildings`: what blocks radio links, that is, tall and low buildings; low ones may be
#   flown over
#
# Return two things: the cell that the UAV is over after the step, a pair `(row, col)`, and whether
# the controller intervened, `True` or `False`.
#
# <details><summary>Hint</summary>
#
# There are three kinds of action. Hovering is always allowed, landing depends on one layer, and
# for a move you have to ask two questions about the target cell, in the right order.
# </details>
#
# <details><summary>Another hint</summary>
#
# Work out the target's row and column. First ask whether both are in the grid, that is, from 0 to M
# − 1, and only if they are, ask what city.no_fly says about the target cell. If the target is
# outside or forbidden, the UAV stays in its old cell, and that counts as an intervention.
# </details>

# %%
def safe_step(city, cell, action):
    """The cell after the step, (row, col), and whether the safety controller intervened."""
    ### BEGIN SOLUTION
    if action == 4:
        return cell, False
    if action == 5:
        return cell, not city.landing[cell]
    row = cell[0] + (-1, 0, 1, 0)[action]
    col = cell[1] + (0, 1, 0, -1)[action]
    inside = 0 <= row < city.size and 0 <= col < city.size
    if not inside or city.no_fly[row, col]:
        return cell, True
    return (row, col), False
    ### END SOLUTION

# %%
checks.safe_step(safe_step)
