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

from uavdh_lite import checks

# %% [markdown]
# ## 5.1 · A softmax that does not overflow (2 points, 8 minutes)
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
# rows of a batch. A float32 overflows above $\exp(88)$. Use `torch.exp`, and neither `torch.softmax` nor its relatives:
# they solve the problem in the way that you are to find.

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
# ## 5.2 · A ring buffer with combined replay (3 points, 15 minutes)
#
# Write a replay memory. It stores the last `capacity` items; a sample of it always has the newest item.
#
# - `Ring(capacity)`: an empty memory for `capacity` ≥ 1 items.
# - `add(item)`: stores an item. Is the memory full, it takes the place of the oldest one.
# - `sample(size, generator)`: a list of `size` ≥ 1 items in any order. One is the newest. Each of the other `size` − 1 is
#   drawn from *all* stored items, the newest included, all equally likely and independent of each other, so that an item
#   may come more than once. `generator` is a `numpy.random.Generator`; all chance must come from it, for example by
#   `generator.integers(0, n, count)`: `count` whole numbers from 0 to `n` − 1. `sample` is never called on an empty memory.
#
# An item is a tuple of any content; give back the very tuples that were added. Adding must not get slower when the memory
# is large: do not shift all items by a place.

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
# ## 5.3 · The double-DQN target (2 points, 10 minutes)
#
# Compute the targets $y$ of a minibatch of $B$ transitions from a state to the next state $s'$:
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
# $y = r$. Give back a new tensor of shape $(B,)$, without a loop and without the library's own function.

# %%
def target(reward, terminal, discount, online_next, target_next):
    """The double-DQN target of each transition, (B,)."""
    ### BEGIN SOLUTION
    best = online_next.argmax(dim=1, keepdim=True)
    value = target_next.gather(1, best).squeeze(1)
    return reward + discount * ~terminal * value
    ### END SOLUTION

# %%
checks.double_target(target)

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
