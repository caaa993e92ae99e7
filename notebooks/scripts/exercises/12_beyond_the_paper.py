# %% [markdown]
# # Exercises 12 · Beyond the paper
#
# They go with notebook `12_beyond_the_paper`. You need numpy: indexing with arrays, and tables made of a row and a column.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the answer is
# right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.failsafe_mask.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
import numpy as np

from uavdh_lite.course import checks

# %% [markdown]
# ## 12.1 · The failsafe's mask (2 points, 15 minutes)
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
# ## 12.2 · The quantile Huber loss (3 points, 15 minutes)
#
# `theta` are $N$ quantiles, `y` any number of samples of the return, `kappa` the $\kappa$ above which Huber's loss is linear.
# Return the number
#
# $$\sum_{i=1}^{N} \operatorname{mean}_j\; \big|\hat\tau_i - \mathbb{1}\{u_{ij} < 0\}\big|\; L_\kappa(u_{ij}), \qquad u_{ij} = y_j - \theta_i, \quad \hat\tau_i = \frac{i - 1/2}{N}$$
#
# with $L_\kappa(u) = u^2/2$ where $|u| \le \kappa$, and $\kappa\,(|u| - \kappa/2)$ elsewhere. $\mathbb{1}\{\cdot\}$ is 1 where
# the condition holds, and 0 elsewhere. Try to do without a loop, and without the library's own function.

# %%
def quantile_loss(theta, y, kappa):
    """The quantile Huber loss, one number."""
    ### BEGIN SOLUTION
    levels = (np.arange(len(theta)) + 0.5) / len(theta)
    u = y[None, :] - theta[:, None]
    huber = np.where(np.abs(u) <= kappa, u**2 / 2, kappa * (np.abs(u) - kappa / 2))
    weight = np.abs(levels[:, None] - (u < 0))
    return (weight * huber).mean(axis=1).sum()
    ### END SOLUTION

# %%
checks.quantile_loss(quantile_loss)

# %% [markdown]
# With $\kappa$ above all errors it is a weighted squared error. Its minima are *expectiles*, which lie closer to the mean than
# quantiles do.

# %% [markdown]
# ## 12.3 · The target of advantage learning (2 points, 10 minutes)
#
# Change the targets of a minibatch of $B$ transitions so that the gaps between actions get wider:
#
# $$y' = y - \alpha\,\big(\max_b Q(s,b) - Q(s,a)\big)$$
#
# - `y`: $(B,)$, the targets so far,
# - `q_values`: $(B, 6)$, the Q-values of the state $s$ by the target network; they may all be negative,
# - `allowed`: $(B, 6)$ Booleans, the actions that the failsafe allows in $s$, at least one in each row; the maximum is over these only,
# - `action`: $(B,)$, the number of the action $a$ that was taken, an allowed one,
# - `alpha`: $\alpha$, from 0 to less than 1.
#
# Return a new array, $(B,)$.

# %%
def target(y, q_values, allowed, action, alpha):
    """The targets with wider gaps, (B,)."""
    ### BEGIN SOLUTION
    best = np.where(allowed, q_values, -np.inf).max(axis=1)
    taken = q_values[np.arange(len(action)), action]
    return y - alpha * (best - taken)
    ### END SOLUTION

# %%
checks.advantage_target(target)

# %% [markdown]
# ## 12.4 · How far does a discount reach? (2 points, 12 minutes)
#
# The UAV is in the landing zone, and $w$ moves away there is a device with `data` units. All of it is uploaded in the move
# that gets there, the last of the $w$. Then the UAV flies $w$ moves back and lands. Each of the $2w$ moves costs `cost` > 0; landing is free, and so is to
# land at once. A reward in step $t$ counts $\gamma^t$, where the first move is step 0 and $\gamma$ is `discount`, from above 0 to 1.
#
# A way *pays* if the sum of all that is above 0. The sum falls with $w$. Return the largest $w$ that pays, a whole number; 0 if not even
# $w = 1$ pays.

# %%
def longest_way(data, discount, cost):
    """The most moves to a device that pay."""
    ### BEGIN SOLUTION
    way = 0
    while True:
        further = way + 1
        costs = cost * sum(discount**t for t in range(2 * further))
        if discount ** (further - 1) * data - costs <= 0:
            return way
        way = further
    ### END SOLUTION

# %%
checks.longest_way(longest_way)

# %% [markdown]
# Try it: with `cost` 0.1, how far do 0.95 and 0.97 fly for five units, and how far without a discount?
