# %% [markdown]
# # Exercises 11 · Replay
#
# These exercises go with notebook `11_replay`. You need the ring of exercise 6.3.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook.
# If it never finishes, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
from uavdh_lite.course import checks

# %% [markdown]
# ## 11.1 · What a memory still holds (1 point, 8 minutes)
#
# A city changes while an agent is being trained in it: buildings are torn down. From then on the memory holds steps from the old city
# beside those from the new one. How large is the share of the old ones?
#
# - `capacity`: how many items the ring holds at most
# - `before`: how many items were added before the change, at least 1
# - `after`: how many were added since, 0 or more
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
# It holds min(capacity, before + after) items, the newest. min(capacity, after) of them are new. The rest is
# old.
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
# Of 100,000 places, as in our recipes, nothing is old any more after 100,000 steps. A small memory forgets the old city sooner, and
# with it all else that is rare.
