# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 6 · From Q-learning to DDQN
#
# These exercises go with notebook `06_ddqn`. They change what you saw there: another target, another
# way to explore, a memory that prefers surprises, and an update with bugs in it.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check
# says whether the answer is right, and if not, what is probably wrong. The check looks at what your
# code *does*, not at how it is written. Hints are folded away below each task. Your code runs
# inside this notebook. If it never finishes, interrupt the kernel with the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it,
# and write your own from memory. Solutions are in the folder `solutions`, beside `exercises`,
# unless somebody handed you a copy of the course without them. Most of the PyTorch that you need is
# in the table of section 5.3.

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
from matplotlib import pyplot as plt
from torch import nn

from uavdh_lite.course import checks

torch.set_num_threads(1)  # quickest for small networks

# %% [markdown]
# ## 6.1 · A target that explores, too (2 points, 10 minutes)
#
# Q-learning asks what the *best* next action is worth, although the agent, while it explores, does
# not always take it. **Expected SARSA** asks what the next state is worth to the agent as it is: it
# weights each next Q-value with the probability that the softmax policy gives to its action.
#
# $$y = r + \gamma \sum_{a'} \pi(a' \mid s')\, Q(s', a'), \qquad \pi(a' \mid s') = \frac{\exp(Q(s',a')/\beta)}{\sum_{b}\exp(Q(s',b)/\beta)}$$
#
# - `reward`: floats of shape $(B,)$; `ended`: bools of shape $(B,)$; `gamma`, `beta`: numbers
# - `q_next`: floats of shape $(B, 6)$, the Q-values of the next state
#
# Return the targets, a tensor of shape $(B,)$. Where the episode ended, $y=r$. The Q-values may be
# large; you may use `torch.softmax`.
#
# <details><summary>Hint</summary>
#
# A mean with weights is a sum of products, row by row. Which dimension is summed over?
# </details>
#
# <details><summary>Another hint</summary>
#
# `torch.softmax(q_next / beta, dim=1)` has the shape of `q_next`. Multiply the two and sum over
# dim=1. `~ended` counts as 1 where the episode goes on.
# </details>

# %%
def expected_target(reward, ended, gamma, q_next, beta):
    """The target of expected SARSA for each transition, (B,)."""
    ### BEGIN SOLUTION
    chances = torch.softmax(q_next / beta, dim=1)
    return reward + gamma * ~ended * (chances * q_next).sum(dim=1)
    ### END SOLUTION

# %%
checks.expected_target(expected_target)

# %% [markdown]
# This target learns what the present policy is worth. It asks only the policy, not the flight, for
# the next action, so it is right for old steps from the memory, too.
#
# ## 6.2 · ε-greedy (2 points, 10 minutes)
#
# With probability $\varepsilon$ an ε-greedy agent draws one of *all* actions at random, each equally
# likely, and otherwise takes the best one. Return the probabilities of all actions as a tensor of the
# shape of `q`, $(B, A)$. (The check has no rows with two best actions.)
#
# <details><summary>Hint</summary>
#
# The best action can be drawn in two ways. What is its probability with ε = 1?
# </details>
#
# <details><summary>Another hint</summary>
#
# Begin with ε / A everywhere, and add 1 − ε at the best action: `nn.functional.one_hot(columns, A)`
# makes rows of zeros with a 1 in these columns.
# </details>

# %%
def epsilon_greedy(q, epsilon):
    """The probabilities of all actions in each state, (B, A)."""
    ### BEGIN SOLUTION
    chances = torch.full(q.shape, epsilon / q.shape[1])
    chances[torch.arange(len(q)), q.argmax(dim=1)] += 1 - epsilon
    return chances
    ### END SOLUTION

# %%
checks.epsilon_greedy(epsilon_greedy)

# %%
values = [3.0, 2.9, 2.0, 1.0, 0.0, -4.0]
q = torch.tensor([values])
for k, (name, chances) in enumerate(
    {"ε = 0.3": epsilon_greedy(q, 0.3), "softmax, β = 1": torch.softmax(q, dim=1)}.items()
):
    plt.bar(np.arange(6) + 0.4 * (k - 0.5), chances[0].tolist(), 0.4, label=name)
plt.xticks(range(6), values)
plt.xlabel("Q-value of an action")
plt.ylabel("probability")
plt.legend();

# %% [markdown]
# The figure compares the two. Which one more often tries the action that is nearly as good, and
# which one the action that seems worst?
#
# ## 6.3 · A memory that prefers surprises (2 points, 15 minutes)
#
# A plain replay memory draws all steps with equal chances, also those long understood. A
# **prioritised** memory prefers steps with a large TD error $y-Q(s,a)$. Give each step a weight by
# its *rank*: the step with the largest error, in absolute value, has the weight 1, the next 1/2, the
# third 1/3, and so on. Return the probabilities, the weights divided by their sum.
#
# - `errors`: an array of $N$ TD errors, no two of the same size; leave it as it is
#
# For the errors 0.5, −3, 1 the weights are 1/3, 1, 1/2, and the probabilities 0.18, 0.55, 0.27.
#
# <details><summary>Hint</summary>
#
# `np.argsort` gives the places of the smallest, the second smallest, … value. You need the
# opposite: for each place its rank.
# </details>
#
# <details><summary>Another hint</summary>
#
# `order = np.argsort(-np.abs(errors))` are the places in the order of surprise. Write 1, 1/2, 1/3, …
# *into* these places: `weights[order] = …`.
# </details>

# %%
def by_surprise(errors):
    """The probability with which each step is drawn, (N,)."""
    ### BEGIN SOLUTION
    order = np.argsort(-np.abs(errors))
    weights = np.empty(len(errors))
    weights[order] = 1 / np.arange(1, len(errors) + 1)
    return weights / weights.sum()
    ### END SOLUTION

# %%
checks.by_surprise(by_surprise)

# %% [markdown]
# Drawing surprises more often also shifts the mean over good and bad luck; exercise 11.2 shows how
# that is put right.
#
# ## 6.4 · Four bugs in an update (3 points, 25 minutes)
#
# The function below should be the update of notebook 6 with a target network, and it has four bugs.
# None of them raises an error, and that is the trouble with such bugs. Find and mend them.
#
# ```python
# def update(online, target, optimiser, batch, gamma, tau):
#     cell, action, reward, after, ended = batch
#     y = reward + gamma * (1 - ended) * online(after).amax(1, keepdim=True)
#     q = online(cell).amax(1, keepdim=True)
#     loss = ((y - q) ** 2).mean()
#     loss.backward()
#     optimiser.step()
#     with torch.no_grad():
#         for old, new in zip(target.parameters(), online.parameters()):
#             old = (1 - tau) * old + tau * new
# ```
#
# - `online`, `target`: networks from cells, $(B, 2)$, to Q-values, $(B, 4)$; `optimiser`: of the
#   online network
# - `batch`: five tensors: `cell` and `after`, $(B, 2)$; `action`, whole numbers, $(B, 1)$; `reward` and
#   `ended` (1 or 0), $(B, 1)$
#
# The function returns nothing; it changes both networks. The check compares both of them with the
# right ones.
#
# <details><summary>Hint</summary>
#
# Ask of every line what it should do. Who makes y? Which Q-value moves? What is in the slopes
# when `backward` is called for the second time? What is different in the target network afterwards?
# </details>
#
# <details><summary>Another hint</summary>
#
# y: made by the target network, and inside `torch.no_grad()` as a number to reach. q: that of the action taken, by `gather`. `zero_grad` is missing. And `old = …` gives the
# name `old` to a new tensor, while the network keeps its own: change it in place, `old.lerp_(new,
# tau)`.
# </details>

# %%
def update(online, target, optimiser, batch, gamma, tau):
    """One step of gradient descent, and one soft update."""
    ### BEGIN SOLUTION
    cell, action, reward, after, ended = batch
    with torch.no_grad():
        y = reward + gamma * (1 - ended) * target(after).amax(1, keepdim=True)
    q = online(cell).gather(1, action)
    loss = ((y - q) ** 2).mean()
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        for old, new in zip(target.parameters(), online.parameters()):
            old.lerp_(new, tau)
    ### END SOLUTION

# %%
checks.mended_update(update)
