# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 6 · From Q-learning to DDQN
#
# Near a corner of the village stands a device. Nobody has told the UAV where, and only the very last
# step earns anything. Yet flights *at random* can teach every cell that they pass the way; here is
# what there is to learn:

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

# %% tags=["hide-input"]
# %matplotlib inline
import copy

import numpy as np
import torch
from matplotlib import pyplot as plt
from torch import nn

from uavdh_lite.city import load_city
from uavdh_lite.course.live import draw_actions
from uavdh_lite.plotting import draw_city

torch.set_num_threads(1)  # small networks
village, generator = load_city("village"), np.random.default_rng(0)
START, DEVICE, MOVES = (0, 0), (6, 7), ((-1, 0), (0, 1), (1, 0), (0, -1))

def draw_values(values, titles):
    size = 3 * len(values), 3.2
    figure, axes = plt.subplots(1, len(values), figsize=size, layout="constrained")
    for ax, q, title in zip(np.ravel(axes), values, titles):
        draw_city(ax, village).set_title(title, fontsize="medium")
        ax.imshow(np.where(village.no_fly, np.nan, q.max(2)), "YlGn", vmin=-1, vmax=10, zorder=1.5)
        draw_actions(ax, village, q.argmax(2).ravel())
        ax.plot(DEVICE[1], DEVICE[0], "X", color="C1", mec="white", ms=11, zorder=6)

def far_sighted():  # solves the Bellman equation of 6.1
    q = np.zeros((8, 8, 4))
    for _ in range(100):
        for cell in np.argwhere(~village.no_fly):
            for action, (down, right) in enumerate(MOVES):
                after = tuple(np.clip(cell + (down, right), 0, 7))
                after = tuple(cell) if village.no_fly[after] else after
                q[*cell, action] = 9.8 if after == DEVICE else -0.2 + 0.95 * q[after].max()
    return q

right_values = far_sighted()
draw_values([right_values], [""])

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Write Q-learning as a table, put a network in its place, watch it explode, and calm it |
# | **What you'll learn** | The Bellman equation, discount, replay, target network, exploration, double Q-learning |
# | **What you'll need** | Notebooks 3 to 5. 40 minutes to read, 40 seconds to run; 60 minutes of exercises |
#
# The greener a cell, the more it is worth; an arrow shows a best move. **How can a number in one
# corner know about a reward thirteen steps away?**
#
# ## 6.1 A table
#
# The four actions are moves north, east, south and west. Reaching the device brings 10 units of
# data and ends the flight; each step costs 0.2; a forbidden move leaves the UAV where it is.

# %%
def step(cell, action):
    after = tuple(np.clip(np.add(cell, MOVES[action]), 0, 7).tolist())
    after = cell if village.no_fly[after] else after
    ended = after == DEVICE
    return after, 10 * ended - 0.2, ended  # the next cell, the reward, whether the flight is over

step((0, 0), 0), step((5, 7), 2)

# %% [markdown]
# Imagine a table $Q$ with a number for each cell $s$ and action $a$, a **Q-value**: what you earn
# from that cell on if you take that action and fly well afterwards. The last step brings
# $10-0.2=9.8$. The step before it costs 0.2 and leads to a cell from which 9.8 can be earned. In
# general, a Q-value is the reward $r$ of its own step plus the best Q-value of the next cell $s'$,
# times a factor $\gamma$ a little below 1, the *discount*, so that what comes later counts a little
# less:
#
# $$Q(s,a)=r+\gamma\max_{a'}Q(s',a')$$
#
# This is the **Bellman equation** (the maximum is what the cell is worth, its *value* $V(s')$), and
# the answer to the question: no number has to know about
# thirteen steps. Each only has to agree with its neighbour, and the neighbour with the next. Nobody
# gives us the table, so we start with zeros. Each step tells us $r$ and $s'$, and so what the right
# side says *now*, the **target** $y$. The entry moves a fraction $\alpha$ of the way to $y$:
#
# $$Q(s,a)\leftarrow Q(s,a)+\alpha\,\big(y-Q(s,a)\big),\qquad y=r+\gamma\max_{a'}Q(s',a')$$

# %%
def learn_table(flights, worth=np.max, gamma=0.95, alpha=0.5):
    q = np.zeros((8, 8, 4))
    for _ in range(flights):
        cell, ended = START, False
        while not ended:
            action = generator.integers(4)  # at random!
            after, reward, ended = step(cell, action)
            y = reward if ended else reward + gamma * worth(q[after])
            q[cell][action] += alpha * (y - q[cell][action])
            cell = after
    return q

# %%
draw_values([learn_table(n) for n in (1, 4, 40)], ["1 flight", "4 flights", "40 flights"])

# %% [markdown]
# After one flight only the cell before the device knows that something good is near. Each further
# flight carries the news back, until all cells agree with their neighbours. (The corner beyond the
# device stays pale, because no flight goes on to it.)
#
# The method is **Q-learning**, and the gap $y-Q(s,a)$ is the **TD error** (*temporal difference*).
# It is *model-free*: it needs steps, and not notebook 3's distribution $p$. In a world with chance,
# the right-hand side of the Bellman equation is a mean over what may come next, and a small
# $\alpha$ averages good and bad luck. A table becomes right if every action is tried in every cell
# again and again, and $\alpha$ falls slowly to 0.
#
# Now break it. The UAV flew at random, and yet learned what *good* flying is worth, because the
# target asks for the best next action, $\max$. What if it asks for the mean of all four?

# %%
draw_values([right_values, learn_table(40, worth=np.mean)], ["the largest", "the mean"])

# %% [markdown]
# Now the table knows what flying *at random* is worth: far from the device, hardly anything but the
# cost of the steps, though most arrows still point the right way. A method that learns about good
# flying from the flights of another policy is **off-policy**; one that learns what its own flying
# is worth, like *SARSA*, is **on-policy**. An off-policy method may learn from old flights again
# and again.
#
# **The last step.** If the flight ended, $y$ is $r$ alone, or rewards would seem to go on after a
# crash. A mission whose time is up is over, a **termination**. If a simulation merely stops after
# 1000 steps, that is a **truncation**: more would have followed, and $y$ keeps its second part.
#
# **The discount.** A reward $k$ steps ahead counts $\gamma^k$ times its size (paper, eq. 5 and 6):
#
# $$Q(s_t,a_t)=\mathbb{E}\left[\sum_{k}\gamma^k\,r_{t+k}\right]$$
#
# Why not $\gamma=1$? Each value is estimated from the next, so errors travel; with $\gamma<1$ each
# round *contracts* them. The price is short-sightedness: the factors add up to $1/(1-\gamma)$, the
# **horizon**, 20 steps for 0.95. A crash that costs 150 and is 60 steps ahead counts only
# $150\cdot0.95^{60}\approx7$.
#
# ## 6.2 A network in the table's place
#
# A table for Manhattan would need a row for every combination of positions, times and amounts of
# data, more than $10^{13}$. A network computes the Q-values from its inputs instead, here row and
# column, and answers for cells that it has never seen (**generalisation**). Its weights $\theta$
# take a step downhill on the squared error (eq. 7):
#
# $$L(\theta)=\mathbb{E}\big[(y-Q_\theta(s,a))^2\big]$$
#
# A table may learn from the steps of a flight in order. A network should not: successive steps are
# alike, gradient descent works best with independent examples, and because the same weights serve
# all places, fitting the latest steps makes it **forget** the rest. So all steps go into a **replay
# memory**, and the network learns from a *minibatch* drawn from it at random. Here is a memory:

# %%
rows = []
for _ in range(20):  # flights
    cell, ended = START, False
    while not ended:
        action = generator.integers(4)
        after, reward, ended = step(cell, action)
        rows.append((*cell, action, reward, *after, ended))
        cell = after
memory = torch.tensor(rows, dtype=torch.float32)
print(f"{len(memory):,} steps; the last one: {memory[-1].tolist()}")

# %% [markdown]
# Of the 50,000 steps in the authors' memory, their minibatch of 128 would hold the newest about
# once in 390 times. The paper's **combined experience replay** puts it into every minibatch.
# ([Notebook 11](11_replay.ipynb) asks how large a memory should be.)
#
# ## 6.3 It explodes
#
# One update. Which network makes the target is left open for now: `judge`.

# %%
def update(online, judge, optimiser):
    batch = memory[torch.randint(len(memory), (32,))]
    cell, action, reward, after, ended = batch.split([2, 1, 1, 2, 1], dim=1)
    with torch.no_grad():  # y is a number to reach: it must not move towards Q
        y = reward + 0.95 * (1 - ended) * judge(after).amax(1, keepdim=True)
    q = online(cell).gather(1, action.long())  # of the action taken
    loss = ((y - q) ** 2).mean()  # eq. 7
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()

def network_and_optimiser(seed):
    torch.manual_seed(seed)
    online = nn.Sequential(nn.Linear(2, 64), nn.ReLU(), nn.Linear(64, 4))
    return online, torch.optim.Adam(online.parameters(), lr=0.01)

# %% [markdown]
# The obvious judge is the network itself. The start is worth about 3.5:

# %%
def value(network):
    return network(torch.tensor([START]).float()).max().item()

exploding = []
for seed in range(3):
    online, optimiser = network_and_optimiser(seed)
    path = []
    for _ in range(1500):
        update(online, online, optimiser)
        path.append(value(online))
    exploding.append(path)
print("value of the start:", *(f"{path[-1]:,.0f}" for path in exploding))
assert min(path[-1] for path in exploding) > 100

# %% [markdown]
# All three have exploded. Why, when a table does not? Say an update raises $Q(s,a)$ towards $y$. In
# a table nothing else changes. In the network the same weights also make the values of neighbouring
# cells, so those tend to rise, too, and *the next cell $s'$ is a neighbour*. But $y$ is computed
# from the values of $s'$: by moving towards the target, the network has pushed the target away, and
# the chase goes on.
#
# ```text
#            ┌──────── y = r + γ max Q(s') ◀────────┐
#            ▼                                       │  the same weights:
#   Q(s) rises towards y  ────────────────────▶  Q(s') rises, too
# ```
#
# Three things come together: a network that generalises, targets made from its own estimates
# (**bootstrapping**), and learning off-policy. With this *deadly triad*, learning may diverge.
#
# ### The target network
#
# The cure: do not let the target move at once. A second network, the **target network** with the
# weights $\bar\theta$, makes $y$. It begins as a copy of the one that learns, the **online
# network**, and after each update moves a small fraction $\tau$ of the way (a **soft update**):
#
# $$\bar\theta\leftarrow(1-\tau)\,\bar\theta+\tau\,\theta$$

# %%
def follow(target, online, tau):
    with torch.no_grad():
        for old, new in zip(target.parameters(), online.parameters()):
            old.lerp_(new, tau)  # in place; `old = ...` would only give a name to another tensor

calm, networks = [], []
for seed in range(3):
    online, optimiser = network_and_optimiser(seed)
    target, path = copy.deepcopy(online), []
    for _ in range(3000):
        update(online, target, optimiser)
        follow(target, online, tau=0.05)
        path.append(value(online))
    calm.append(path)
    networks.append(online)
assert max(path[-1] for path in calm) < 20

# %% tags=["hide-input"]
figure, ax = plt.subplots(figsize=(6, 2.8), layout="constrained")
ax.plot(np.transpose(exploding), "C1", lw=1)
ax.plot(np.transpose(calm), "C0", lw=1)
ax.set(xlabel="updates", ylabel="value of the start", yscale="symlog",
       title="orange: its own judge; blue: a target network; three runs each")

# %% [markdown]
# While the online network takes a step, the targets hardly move, so it can catch up. The target
# network lags about $1/\tau$ updates behind: 20 here, 200 with the authors' $\tau=0.005$. Are the
# calm values right?

# %% tags=["hide-input"]
def arrivals(q):
    """From how many cells the best actions lead to the device."""
    count = 0
    for cell in np.argwhere(~village.no_fly).tolist():
        cell, steps = tuple(cell), 0
        while cell != DEVICE and steps < 64:
            cell, steps = step(cell, q[cell].argmax())[0], steps + 1
        count += 0 < steps and cell == DEVICE
    return count

cells = torch.cartesian_prod(torch.arange(8.0), torch.arange(8.0))
learned = [online(cells).detach().view(8, 8, 4).numpy() for online in networks]
print("cells from which it arrives: table", arrivals(right_values),
      " networks", *map(arrivals, learned))
draw_values([right_values, *learned[:2]], ["table", "network", "another"])

# %% [markdown]
# Nearly: on average they are too low by about 1, and from about three quarters of the cells, or
# more, the best actions lead to the device. Neighbouring cells differ by about half a unit, so a
# small error can turn an arrow. Unlike this network, your agent's sees the buildings.
#
# ## 6.4 Exploring
#
# Random flights find a device in a village. In a large city they rarely get far, so the agent
# should use what it has learned (**exploitation**). But if it always takes what seems best, it may
# never find out that another action is better (**exploration**). The paper draws actions from a
# **softmax policy** with the **temperature** $\beta$ (eq. 10):
#
# $$\pi(a\mid s)=\frac{\exp(Q(s,a)/\beta)}{\sum_{a'}\exp(Q(s,a')/\beta)}$$

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("cold_policy")

# %%
def softmax_policy(q, beta):
    powers = torch.exp(q / beta)
    return powers / powers.sum(dim=1, keepdim=True)

q_start = torch.tensor(right_values[START][None])
figure, axes = plt.subplots(1, 3, figsize=(7, 2), sharey=True, layout="constrained")
for ax, beta in zip(axes, (0.1, 1, 10)):
    ax.bar(list("NESW"), softmax_policy(q_start, beta)[0])
    ax.set(title=f"β = {beta}", ylim=(0, 1))
axes[0].set_ylabel("probability");

# %% [markdown]
# With a low β the UAV nearly always takes one of the best moves; with a high β, any. (Only the gaps
# between the Q-values matter, so `torch.softmax` subtracts the row's largest first, before $\exp$
# overflows.) After training, the agent follows the **greedy policy** (eq. 9) and always takes the
# best action.
#
# The best-known alternative is **ε-greedy**: a random action with probability ε, else the best. It
# tries the worst action as often as the second best; but β must fit the size of the Q-values.
#
# ## 6.5 Double Q-learning
#
# Q-values are estimates, so each has some error. What do the errors do to the largest one?

# %%
Quiz("whose_maximum")

# %% [markdown]
# The maximum asks the same estimates two questions: *which* action is best, and *what* is it worth?
# The one with the luckiest error answers both, so the value comes out too high: a **maximisation
# bias**. In **double Q-learning** one set of estimates chooses, and another judges; in the paper,
# the online network chooses and the target network judges (eq. 8):
#
# $$y=r+\gamma\,Q_{\bar\theta}\big(s',\arg\max_{a'}Q_\theta(s',a')\big)$$

# %%
def double_target(reward, ended, gamma, online_next, target_next):  # ended: True or False
    best = online_next.argmax(dim=1, keepdim=True)  # the online network chooses,
    return reward + gamma * ~ended * target_next.gather(1, best)[:, 0]  # the target one judges

# %% [markdown]
# Try it: six actions are all worth 0, and their estimates have random errors. The judge's errors
# are the chooser's own (the plain maximum), related to them, or a stranger's.

# %%
chooser, own = torch.randn(2, 20_000, 6)
zeros, no = torch.zeros(20_000), torch.zeros(20_000, dtype=bool)
for name, share in (("the chooser itself", 1.0), ("a related judge", 0.7), ("a stranger", 0.0)):
    judge = share * chooser + (1 - share**2) ** 0.5 * own  # share: the correlation of their errors
    print(f"{name:<19} mean target {double_target(zeros, no, 1.0, chooser, judge).mean():5.2f}")

# %% [markdown]
# The right target is 0, and only the stranger finds it. The target network, which lags behind the
# online one, is a related judge, so it removes part of the bias.
#
# All this together is a *double deep Q-network*, a **DDQN**.
#
# ## Recap
#
# - The Bellman equation ties each Q-value to those of the next state, so news spreads backwards.
# - A replay memory makes a minibatch's examples less alike.
# - A network that makes its own targets may explode; a slow target network can calm it.
# - The online network chooses, the target network judges.
#
# You have now written the main parts of the algorithm ([the whole on one
# page](../docs/tutorials/pseudocode.md)). In [notebook 7](07_training.ipynb) they run together for
# the first time.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/06_ddqn/06_ddqn.ipynb) vary what you wrote: another
# target, another exploration, a memory that prefers surprises.
#
# Further reading: Sutton and Barto, *Reinforcement Learning*, sections 6.5, 6.7 and 11.3; Mnih et
# al., 2015; van Hasselt et al., 2016.
