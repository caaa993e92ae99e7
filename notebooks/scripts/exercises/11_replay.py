# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 11 · Replay
#
# These exercises go with notebook `11_replay`. You need the memory of 7.1, and numpy.
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
# ## 11.1 · What a memory still holds (1 point, 8 minutes)
#
# A city changes while an agent is being trained in it: buildings are torn down. From then on the
# memory holds steps from the old city beside those from the new one. How large is the share of old
# steps in it?
#
# - `capacity`: how many items the ring holds at most
# - `before`: how many items were added before the change, at least 1
# - `after`: how many have been added since, 0 or more
#
# Return the share of the items in the memory that come from before the change, a number from 0 to 1. The ring overwrites its oldest item.
#
# <details><summary>Hint</summary>
#
# How many items does the memory hold in all? How many of them came after the change?
# </details>
#
# <details><summary>Another hint</summary>
#
# The memory holds the newest items, min(capacity, before + after) in all. Of these, min(capacity, after) are new, and the rest
# are old.
# </details>

# %%
def old_share(capacity, before, after):
    """The share of a ring's items that are from before the change."""
    ### BEGIN SOLUTION
    stored = min(capacity, before + after)
    new = min(capacity, after)
    return (stored - new) / stored
    ### END SOLUTION

# %%
checks.old_share(old_share)

# %% [markdown]
# In a ring of 40,000 places, as in the recipe `small`, nothing from the old city is left after
# 40,000 steps. A smaller memory forgets the old city sooner, but it also forgets everything that
# happens only rarely.

# %% [markdown]
# ## 11.2 · Prioritised replay (2 points, 12 minutes)
#
# A step whose Q-value is far from its target has more to teach than one whose value is known already. **Prioritised
# replay** draws the steps with large errors more often than others. But then strokes of luck are seen more often than
# they happen, and the mean that Q should learn is shifted. To make up for this, the loss of each drawn step gets a weight.
# Compute both the probabilities and the weights.
#
# - `error`: array of shape $(N,)$, target minus Q-value of each step in the memory, of either sign
# - `floor`: a number above 0, so that a step without an error is drawn now and then, too
#
# A step is to be drawn with a probability proportional to the sum of `floor` and the absolute value
# of its error. Its weight is to undo that: over many draws, each step must count as much as any
# other. Scale the weights so that the largest is 1, because larger ones would make the gradient
# steps too long.
#
# Return two arrays of shape $(N,)$: the probabilities, which add up to 1, and the weights. Leave `error` as it is.
#
# For example, with the errors 3, −1 and 0 and a floor of 1, the steps are drawn in the proportion 4
# : 2 : 1, and their weights are 0.25, 0.5 and 1.
#
# <details><summary>Hint</summary>
#
# What must probability times weight be if each step is to count as much as any other?
# </details>
#
# <details><summary>Another hint</summary>
#
# np.abs(error) + floor, divided by its sum, gives the probabilities. For the weights, take 1 over
# each probability, and divide by the largest of the results.
# </details>

# %%
def prioritised(error, floor):
    """The probability with which each step is drawn, and the weight of its loss."""
    ### BEGIN SOLUTION
    size = np.abs(error) + floor
    probability = size / size.sum()
    return probability, probability.min() / probability
    ### END SOLUTION

# %%
checks.prioritised(prioritised)

# %% [markdown]
# Try prioritised replay with the ring: `generator.choice(n, 64, p=probability)` draws the places. Does it help in the village?
# It is one of the parts of *Rainbow*, an agent that combines six improvements to DQN, but it is also one more thing that can
# go wrong in your own agent.
