# %% [markdown]
# # Exercises 9 · Replay
#
# They go with notebook `09_replay`. You need Python classes.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. An answer runs in this notebook: if it
# never ends, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 9.1 · A ring buffer with combined replay (3 points, 15 minutes)
#
# Write a replay memory. It stores the last `capacity` items; a sample of it always has the newest item.
#
# - `Ring(capacity)`: an empty memory for `capacity` ≥ 1 items.
# - `add(item)`: stores an item. If the memory is full, it takes the place of the oldest one.
# - `sample(size, generator)`: a list of `size` ≥ 1 items in any order. One is the newest. Each of the other `size` − 1 is
#   drawn from *all* stored items, the newest included, all equally likely and independent of each other, so that an item
#   may come more than once. `generator` is a `numpy.random.Generator`; all chance must come from it, for example by
#   `generator.integers(0, n, count)`: `count` whole numbers from 0 to `n` − 1. `sample` is never called on an empty memory.
#
# An item is a tuple of any content; give back the very tuples that were added. Adding should not get slower when the
# memory is large: try to do without shifting all items by a place (as `pop(0)` does), that is the point of a ring.
#
# <details><summary>Hint</summary>
#
# Keep two things apart: how many places are filled, and where the newest item is. The places are used in a
# circle: which operator takes the last one back to the first?
# </details>
#
# <details><summary>Another hint</summary>
#
# The remainder of a division by the capacity runs in such a circle. While the memory is not full, only the
# places filled so far may be drawn; draw places, not items. And of the size items one is the newest, drawn or
# not.
# </details>

# %%
class Ring:
    """The last `capacity` items; the newest is in every sample."""

    def __init__(self, capacity):
        ### BEGIN SOLUTION
        self.capacity = capacity
        self.items = []
        self.newest = -1
        ### END SOLUTION

    def add(self, item):
        """Store an item; the oldest makes room."""
        ### BEGIN SOLUTION
        self.newest = (self.newest + 1) % self.capacity
        if len(self.items) < self.capacity:
            self.items.append(item)
        else:
            self.items[self.newest] = item
        ### END SOLUTION

    def sample(self, size, generator):
        """A list of `size` items: the newest, the others drawn uniformly from all stored."""
        ### BEGIN SOLUTION
        places = generator.integers(0, len(self.items), size - 1)
        return [self.items[self.newest], *(self.items[place] for place in places)]
        ### END SOLUTION

# %%
checks.ring_buffer(Ring)

# %% [markdown]
# ## 9.2 · What a memory still holds (1 point, 8 minutes)
#
# A city changes while an agent is being trained in it: buildings are torn down. From then on the memory holds steps from the old city
# beside those from the new one. How large is the share of the old ones?
#
# - `capacity`: how many items the ring holds at most
# - `before`: how many items were added before the change, at least 1
# - `after`: how many were added since, 0 or more
#
# Give back the share of the items in the memory that come from before the change, a number from 0 to 1. The ring overwrites its oldest item.
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
