# %% [markdown]
# # Exercises 5 · From Q-learning to DDQN
#
# They go with notebook `05_ddqn`. You need the formulas of the notebook, numpy and torch tensors.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. An answer runs in this notebook: if it
# never ends, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import numpy as np
import torch

from uavdh_lite.course import checks

# %% [markdown]
# ## 5.1 · One step of Q-learning (2 points, 10 minutes)
#
# A table has a row for each state and a column for each action. One step of Q-learning moves one entry towards its target,
#
# $$Q(s, a) \leftarrow Q(s, a) + \alpha\,(y - Q(s, a)), \qquad y = r + \gamma \max_{a'} Q(s', a'),$$
#
# and $y = r$ if the episode ended with this step.
#
# - `q`: an array (states, actions)
# - `state`, `action`, `next_state`: whole numbers, $s$, $a$ and $s'$
# - `reward`: $r$; `terminal`: whether the episode ended; if so, `next_state` means nothing
# - `alpha`: $\alpha$, from 0 to 1; `discount`: $\gamma$
#
# Give back the new table, and leave the old one as it is.
#
# <details><summary>Hint</summary>
#
# What is y if the episode goes on? What if it has ended? Then only one number of the table changes.
# </details>
#
# <details><summary>Another hint</summary>
#
# y = reward, plus discount · q[next_state].max() unless terminal. In a copy of the table, q[state, action] +=
# alpha * (y − q[state, action]).
# </details>

# %%
def update(q, state, action, reward, next_state, terminal, alpha, discount):
    """The table after one step of Q-learning."""
    ### BEGIN SOLUTION
    target = reward
    if not terminal:
        target += discount * q[next_state].max()
    new = q.copy()
    new[state, action] += alpha * (target - new[state, action])
    return new
    ### END SOLUTION

# %%
checks.q_update(update)

# %% [markdown]
# ## 5.2 · A softmax that does not overflow (2 points, 10 minutes)
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
#
# <details><summary>Hint</summary>
#
# exp(10 000) is infinite. But the probabilities depend on the gaps between a state's Q-values only: what may
# you subtract from all of them?
# </details>
#
# <details><summary>Another hint</summary>
#
# A factor that all exponentials of a row share cancels when you divide by their sum; exp(−c/β) is such a
# factor, and makes exp((Q − c)/β) of exp(Q/β). Which c, another one in each row, leaves no exponent above 0,
# and one that is exactly 0?
# </details>

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
# ## 5.3 · The double-DQN target (2 points, 10 minutes)
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
# An example with $\gamma = 0.9$ and three actions: $r = 1$, the online Q-values of $s'$ are 2, 5, 3 and the target network's 4, 2, 6.
# The best action is the second, and the target network says that it is worth 2: $y = 1 + 0.9 \cdot 2 = 2.8$.
#
# <details><summary>Hint</summary>
#
# One network is asked which action is best in the next state, the other what that action is worth. And what is
# a next state worth after the episode has ended?
# </details>
#
# <details><summary>Another hint</summary>
#
# The wrong function lets one network do both. argmax says which action is best; with the number of that action
# in each row, look up its worth. And a Boolean counts as 0 or 1 in a product: which of the two terms falls away
# at the end?
# </details>

# %%
def target(reward, terminal, discount, online_next, target_next):
    """The double-DQN target of each transition, (B,)."""
    ### BEGIN SOLUTION
    best = online_next.argmax(dim=1)
    value = target_next[torch.arange(len(best)), best]
    return reward + discount * ~terminal * value
    ### END SOLUTION

# %%
checks.double_target(target)
