# %% [markdown]
# # Exercises 5 · DDQN
#
# They go with notebook `05_ddqn`. You need its formulae, torch tensors, and for the second exercise Python classes.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the
# answer is right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.stable_policy.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
import torch

from uavdh_lite.course import checks

# %% [markdown]
# ## 5.1 · A softmax that does not overflow (2 points, 12 minutes)
#
# The softmax policy takes action $a$ in state $s$ with the probability
#
# $$\pi(a \mid s) = \frac{\exp(Q(s,a)/\beta)}{\sum_{a'} \exp(Q(s,a')/\beta)}$$
#
# Compute it for a batch of $B$ states: `q_values` is a float tensor of shape $(B, 6)$ with a row for each state and a
# column for each action, `temperature` is the number $\beta > 0$. Give back the probabilities as a new tensor of the same
# shape; leave `q_values` as it is.
#
# The Q-values may be near 1000 or −1000 and the temperature may be 0.1, also with very different values in different
# rows of a batch. A float32 overflows above $\exp(88)$. Use `torch.exp`, and try to do without `torch.softmax` and its
# relatives: they solve the problem in the way that you are to find, and that is the point of the exercise.
#
# A reminder: `x.amax(dim=1)` is the largest number of each row of `x`. For `x` = `[[1., 5.], [3., 2.]]` it is `[5., 3.]`,
# of shape `(2,)`. With `keepdim=True` the dimension stays, with length 1: `x.amax(dim=1, keepdim=True)` is
# `[[5.], [3.]]`, a column of shape `(2, 1)`, and in a sum or a quotient with `x` each row meets its own number. `x.sum`
# takes the same arguments.

# %%
def policy(q_values, temperature):
    """The probabilities of all actions in each state, (B, 6)."""
    ### BEGIN SOLUTION
    gaps = q_values - q_values.amax(dim=1, keepdim=True)
    powers = torch.exp(gaps / temperature)
    return powers / powers.sum(dim=1, keepdim=True)
    ### END SOLUTION

# %%
checks.stable_policy(policy)

# %% [markdown]
# ## 5.2 · A ring buffer with combined replay (3 points, 20 minutes)
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
# ## 5.3 · The double-DQN target (2 points, 12 minutes)
#
# The function below is wrong in two ways. Mend it. It is to compute the targets $y$ of a minibatch of $B$ transitions
# from a state to the next state $s'$:
#
# - `reward`: $(B,)$ floats, the reward $r$ of the transition
# - `terminal`: $(B,)$ bools, whether the episode ended with it; there is no next state then, and the Q-values given for it
#   mean nothing
# - `discount`: the number $\gamma$
# - `online_next`, `target_next`: $(B, 6)$ floats, the Q-values of $s'$ by the online and by the target network
#
# $$y = r + \gamma\, Q_{\bar\theta}\big(s', \arg\max_{a'} Q_\theta(s', a')\big)$$
#
# where $\theta$ are the weights of the online and $\bar\theta$ those of the target network. At a terminal transition
# $y = r$. This is the wrong function:
#
# ```python
# def target(reward, terminal, discount, online_next, target_next):
#     value = target_next.amax(dim=1)
#     return reward + discount * value
# ```
#
# First compute the right target of each of these two transitions by hand, with $\gamma = 0.9$ and, to be short, three
# actions: `by_hand`, a list of the two numbers. What does the wrong function give for both?
#
# | $r$ | terminal | Q-values of $s'$, online | Q-values of $s'$, target | $y$ |
# | --- | --- | --- | --- | --- |
# | 1.0 | no | 2.0, 5.0, 3.0 | 4.0, 2.0, 6.0 | ? |
# | −0.2 | yes | 1.0, 0.0, 4.0 | 3.0, 5.0, 2.0 | ? |
#
# Then write the right function. It gives back a new tensor of shape $(B,)$. Try to do without a loop and without the
# library's own function: that is the point of the exercise. The opposite of a Boolean tensor is `~terminal`; `1 - terminal`
# is an error. In a product True counts as 1 and False as 0. To take one entry from each row of a tensor `x` of shape $(B, 6)$, index
# it with two tensors of length $B$, the rows and the columns: `x[torch.arange(B), columns]` has the entries
# `x[0, columns[0]]`, `x[1, columns[1]]` and so on; its shape is $(B,)$.

# %%
# Replace the line below by the two numbers: by_hand = [..., ...]
### BEGIN SOLUTION
by_hand = [1.0 + 0.9 * 2.0, -0.2]
### END SOLUTION

def target(reward, terminal, discount, online_next, target_next):
    """The double-DQN target of each transition, (B,)."""
    ### BEGIN SOLUTION
    best = online_next.argmax(dim=1)
    value = target_next[torch.arange(len(best)), best]
    return reward + discount * ~terminal * value
    ### END SOLUTION

# %%
checks.double_target((target, by_hand))

# %% [markdown]
# The library has no `terminal` here: its memory hands over a discount for each transition, which is 0 where the episode
# ended. That is the same product, computed once.

# %% [markdown]
# ## 5.4 · The soft update, in place (2 points, 8 minutes)
#
# `target` and `online` are lists of equally many float tensors: the weights $\bar\theta$ and $\theta$, layer by layer.
# Tensors at the same place have the same shape. Move the target weights towards the online weights,
#
# $$\bar\theta \leftarrow (1 - \tau)\,\bar\theta + \tau\,\theta$$
#
# with $\tau$ = `rate`, from 0 to 1. The target network goes on using the tensors that it has, so *these* must get the new
# values: do not put other tensors in their place. The online weights stay as they are. The function need not give
# anything back.

# %%
def soft_update(target, online, rate):
    """Move each target tensor the share `rate` of the way to the online one, in place."""
    ### BEGIN SOLUTION
    for slow, fast in zip(target, online, strict=True):
        slow.mul_(1 - rate).add_(rate * fast)
    ### END SOLUTION

# %%
checks.soft_update_in_place(soft_update)

# %% [markdown]
# Outside of such lists, a network's own weights record what is done with them for the gradient. The library's
# `soft_update` therefore begins with `@torch.no_grad()`.
