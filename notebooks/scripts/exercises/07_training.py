# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 7 · Your agent learns to fly
#
# These exercises go with notebook `07_training`. They change its network, its target and its loop,
# and ask what is wrong with an agent.
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
import torch
from torch import nn

from uavdh_lite.course import checks
from uavdh_lite.course.given import RUNS
from uavdh_lite.environment import Rewards

# %% [markdown]
# ## 7.1 · A dueling head (3 points, 20 minutes)
#
# In many states it hardly matters which action the UAV takes. A **dueling** network says so: one
# part of it computes what the *state* is worth, $V(s)$, and another how much better each *action*
# is than the mean of all actions, the advantage $A(s, a)$:
#
# $$Q(s, a) = V(s) + A(s, a) - \frac{1}{6}\sum_{a'} A(s, a')$$
#
# Write it as a class. `Head(inputs)` has two layers, `self.value`, with one output, and
# `self.advantage`, with six; both are `nn.Linear` and get the same features. Called with features
# of shape $(B, \text{inputs})$, it gives Q-values of shape $(B, 6)$.
#
# <details><summary>Hint</summary>
#
# `super().__init__()` comes first in `__init__`; `forward(self, features)` runs when the head is
# called. Why is the mean taken away? Add 5 to V and take 5 from each A: what does Q say of it?
# </details>
#
# <details><summary>Another hint</summary>
#
# V has the shape (B, 1) and A the shape (B, 6), so their sum is (B, 6). `A.mean(dim=1,
# keepdim=True)` is a column.
# </details>

# %%
class Head(nn.Module):
    """Q-values, (B, 6), from features, (B, inputs): a value and six advantages."""

    def __init__(self, inputs):
        ### BEGIN SOLUTION
        super().__init__()
        self.value, self.advantage = nn.Linear(inputs, 1), nn.Linear(inputs, 6)
        ### END SOLUTION

    def forward(self, features):
        ### BEGIN SOLUTION
        value, advantage = self.value(features), self.advantage(features)
        return value + advantage - advantage.mean(dim=1, keepdim=True)
        ### END SOLUTION

# %%
checks.dueling_head(Head)

# %% [markdown]
# To try it in notebook 7, replace the last layer of the network, `online.head[-1] = Head(128)` in
# `beginners`, and train with three seeds each way.
#
# ## 7.2 · What is wrong with this agent? (1 point, 5 minutes)
#
# A validation gives three shares between 0 and 1, each a mean over many missions: `landed`,
# `collected` (the collected data divided by all data, whether the UAV landed or not) and
# `time_used` (the flying time used divided by the flying time given). The cell below shows nine
# such validations, from training runs over Manhattan: one is of an agent trained with the whole
# recipe from which `lite` was chosen (`as_it_is`); the others are of agents for which one part of
# it was changed (`data/runs/pilots-manhattan.csv.gz`). Each name ends with the training seed and
# the number of steps, in thousands, after which the agent was validated.

# %%
for name, shares in RUNS.items():
    print("{:<40}landed {:.3f}, collected {:.3f}, time_used {:.3f}".format(name, *shares))

# %% [markdown]
# Write a function that says what is wrong with an agent, if anything. The agent
#
# 1. is `"lazy"` if it uses less than 25 % of the flying time, whatever its other shares are;
# 2. otherwise it `"crashes"` if it lands in fewer than 90 % of its missions;
# 3. otherwise it is `"good"` if it collects at least 80 % of the data;
# 4. otherwise it `"wanders"`: it flies about but collects too little.
#
# <details><summary>Hint</summary>
#
# The four terms are defined one after the other, each only for agents to which none of the earlier
# ones applies. Which number, then, must you look at first?
# </details>
#
# <details><summary>Another hint</summary>
#
# First ask whether `time_used < 0.25`, and then whether `landed < 0.9`. If neither holds, look at
# `collected`: at 0.8 or above the agent is "good"; below 0.8 it "wanders".
# </details>

# %%
def diagnose(landed, collected, time_used):
    """One of "lazy", "crashes", "good" and "wanders"."""
    ### BEGIN SOLUTION
    if time_used < 0.25:
        return "lazy"
    if landed < 0.9:
        return "crashes"
    return "good" if collected >= 0.8 else "wanders"
    ### END SOLUTION

# %%
checks.diagnosis(diagnose)

# %%
for name, shares in RUNS.items():
    print(f"{name:<40}{diagnose(*shares)}")

# %% [markdown]
# With the crash reward of `paper`, −150 from the start, the agent of seed 0 is lazy after 100,000
# steps. After 300,000 steps it uses more of its time, but collects less than a fifth of the data.

# %% [markdown]
# ## 7.3 · The n-step return (2 points, 15 minutes)
#
# An agent with the recipe `lite` learns from 3-step returns: the rewards of three steps and the
# value of the state after them. Here you compute such a return, as a target, for any number of
# steps. A memory holds $T$ consecutive steps of one UAV. Compute the target for the first state,
# $s_0$, over up to $n$ steps:
#
# $$y = r_0 + \gamma r_1 + \dots + \gamma^{m-1} r_{m-1} + \gamma^m V(s_m)$$
#
# - `rewards`: array of $T$ floats; `rewards[k]` is $r_k$, earned in the step from $s_k$ to
#   $s_{k+1}$
# - `terminals`: array of $T$ bools; `terminals[k]` says whether that step ended the episode; a step
#   that is stored after a terminal one belongs to the next episode
# - `values`: array of $T + 1$ floats; `values[k]` is $V(s_k)$, the value of the state $s_k$
# - `n`: whole number, at least 1; `discount`: $\gamma$
#
# Here $m = n$, or $m = T$ if fewer than $n$ steps are stored. If one of these $m$ steps is
# terminal, the sum ends with the reward of the first such step, and no value is added. Return the
# number $y$; leave the arrays as they are.
#
# <details><summary>Hint</summary>
#
# Write the sum down for n = 1 and n = 2, then for n = 2 with the first step terminal. After m
# rewards, which state's value is added, and with which power of γ?
# </details>
#
# <details><summary>Another hint</summary>
#
# Keep a sum, at first 0, and a factor, at first 1. For each step k, add factor · rewards[k] to the
# sum and multiply the factor by γ; if terminals[k] is true, return the sum at once. After m =
# min(n, T) steps, add factor · values[m] and return the sum.
# </details>

# %%
def n_step(rewards, terminals, values, n, discount):
    """The target of the first state over up to n steps."""
    ### BEGIN SOLUTION
    total, factor = 0.0, 1.0
    steps = min(n, len(rewards))
    for k in range(steps):
        total += factor * rewards[k]
        factor *= discount
        if terminals[k]:
            return total
    return total + factor * values[steps]
    ### END SOLUTION

# %%
checks.n_step_return(n_step)

# %% [markdown]
# ## 7.4 · The loop that never lands (3 points, 20 minutes)
#
# An agent trained with the round below brings hardly any data home. The function should make
# one round of the loop of notebook 7: step, remember, and put new missions in the place of flights
# that have ended. It has three bugs. Mend them.
#
# ```python
# def one_round(environment, state, action, memory, begin, generator):
#     after, outcome = environment.step(state, action, generator)
#     over = np.flatnonzero(after.landed)
#     after = after.with_rows(over, begin(len(over)))
#     memory.append((state, action, Rewards(crash=-20.0)(outcome), after))
#     return state
# ```
#
# - `state`: the state of some UAVs, none of which has ended; `action`: an action for each
# - `memory`: a list; the round appends **one** tuple $(s, a, r, s')$ with the whole batches
# - `begin(count)`: gives the states of so many new missions; call it once
#
# Return the state with which the next round begins.
#
# <details><summary>Hint</summary>
#
# What does the memory need to know about a flight that ended? When does a flight end, apart from
# landing? And with which state does the next round go on?
# </details>
#
# <details><summary>Another hint</summary>
#
# The memory needs the state as `step` gave it, so append *before* `with_rows`. `after.ended` is
# true for landed and for crashed UAVs.
# </details>

# %%
def one_round(environment, state, action, memory, begin, generator):
    """The state with which the next round begins."""
    ### BEGIN SOLUTION
    after, outcome = environment.step(state, action, generator)
    memory.append((state, action, Rewards(crash=-20.0)(outcome), after))
    over = np.flatnonzero(after.ended)
    return after.with_rows(over, begin(len(over)))
    ### END SOLUTION

# %%
checks.mended_round(one_round)
