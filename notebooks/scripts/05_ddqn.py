# %% [markdown]
# # 5 · From Q-learning to DDQN
#
# The agent is over cell (11, 8) and decides by the six numbers below. Each is a **Q-value**: the reward that it expects
# from now on if it takes this action and acts well afterwards. It takes the action with the largest one. **How can one
# number know about the rewards of the next twenty steps?**

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: find the project's folder and install it from there.
from glob import glob
from importlib.metadata import distributions

project = [path for path in ("..", ".", *glob("*")) if glob(f"{path}/uavdh_lite/city.py")]
assert project, "the project's folder is not here: clone or upload it, then run this cell again"
# %cd -q {project[0]}/notebooks
if not any(distributions(name="uavdh_lite")):
    print("installing uavdh_lite from its folder")
    # %pip install -q .. ipywidgets

# %%
# %matplotlib inline
import torch
from matplotlib import pyplot as plt

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.missions import Mission

torch.set_num_threads(1)  # small networks
agent = load_agent("manhattan_ddqn")
q_now = agent.q_values(Mission(agent.city, (11, 8), [(4, 7), (11, 11)], [15, 10], 50).state)
figure, ax = plt.subplots(figsize=(6, 2.4), layout="constrained")
ax.set(ylabel="Q-value")
ax.bar(("north", "east", "south", "west", "hover", "land"), q_now[0]);

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Learn a table, put a network in its place, watch it explode, and fix it |
# | **What you'll learn** | Q-learning, discount, replay, target networks, the softmax policy, double Q-learning |
# | **What you'll need** | Notebooks 3 and 4. 50 minutes to read, 30 seconds to run; 30 minutes of exercises |
#
# ## 5.1 A table
#
# We begin with a city of four by four cells. The UAV starts in the south-west. In the north-east corner stands a device
# with 10 units of data, and there the episode ends. Each step costs 0.2.

# %%
import numpy as np

MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))  # north, east, south, west

def step(cell, action):
    after = tuple(np.clip(np.add(cell, MOVES[action]), 0, 3).tolist())
    at_device = after == (0, 3)
    return after, 10 * at_device - 0.2, at_device

# %% [markdown]
# We keep a table $Q$ with a number for each cell $s$ and action $a$, all 0 at first. A step earns the reward $r$ and
# leads to the cell $s'$. Together they give a better idea of what the action was worth, the **target**, with the discount
# $\gamma=0.95$ that is explained below:
#
# $$y=r+\gamma\max_{a'}Q(s',a')$$
#
# The old number moves a fraction $\alpha$ of the way there:
#
# $$Q(s,a)\leftarrow Q(s,a)+\alpha\,\big(y-Q(s,a)\big)$$
#
# This is **Q-learning**. The UAV may fly at random meanwhile, because the target asks for the *best* next action and not
# for the one that comes next.

# %%
def fly(flights, gamma=0.95, alpha=0.5, seed=0):
    generator, q, memory = np.random.default_rng(seed), np.zeros((4, 4, 4)), []
    for _ in range(flights):
        cell, ended = (3, 0), False
        while not ended:
            action = generator.integers(4)
            after, reward, ended = step(cell, action)
            y = reward if ended else reward + gamma * q[after].max()
            q[cell][action] += alpha * (y - q[cell][action])
            memory.append((*cell, action, reward, *after, ended))
            cell = after
    return q.max(axis=2), torch.tensor(memory).float()

# %%
from uavdh_lite.plotting import draw_maps

draw_maps({f"flights: {n}": fly(n)[0] for n in (1, 3, 100)}, numbers=True)

# %% [markdown]
# Each picture shows every cell's largest Q-value. After one flight only the last cell before the device knows that
# something good is near; actions not yet tried are still at 0. Each further flight spreads the news. So a number knows
# the far future because its neighbours do.
#
# ### The discount
#
# A reward $k$ steps ahead counts $\gamma^k$ of what it would count now.

# %%
draw_maps({f"γ = {gamma}": fly(300, gamma)[0] for gamma in (0.5, 0.95, 1.0)}, numbers=True)

# %% [markdown]
# With $\gamma=0.5$ the far corner hardly sees the device. With $\gamma=1$ it counts in full. The agent uses 0.95: it
# looks about $1/(1-\gamma)=20$ steps ahead. A crash that costs 150 and is 60 steps ahead counts only
# $150\cdot0.95^{60}\approx7$.
#
# Nothing comes after the end of an episode, so the target is $y=r$ alone.
#
# ## 5.2 A network instead of the table
#
# A table for the paper's city would need a row for every combination of places, times and amounts of data: for five
# devices more than $10^{13}$, even without the amounts. A network computes the Q-values from its inputs, here the row
# and the column, so it answers even for cells that it never saw. The loss is $(y-Q)^2$, and instead of $\alpha$ a step
# of gradient descent moves the weights $\theta$.
#
# The steps of one flight look much the same, and a network that learns from them in order learns worse: it forgets.
# So all steps go into a **replay memory**, and the network learns from a *minibatch* drawn at random. The paper's **combined replay** always adds the newest step.
#
# Our memory holds 100 random flights. Cell (1, 1) is left out, as a test for later.

# %%
from torch import nn

from uavdh_lite.ddqn import soft_update

_, memory = fly(100)
START = torch.tensor([3.0, 0.0])
memory = memory[~((memory[:, :2] == 1).all(1) | (memory[:, 4:6] == 1).all(1))]

def network():
    return nn.Sequential(nn.Linear(2, 64), nn.ReLU(), nn.Linear(64, 4))

# %% [markdown]
# `amax` takes the largest Q-value of each row. `detach` makes $y$ a fixed number: $Q$ moves towards $y$, and not $y$
# towards $Q$. `gather` picks the Q-value of the action that was taken.

# %%
def loss_of(online, target):
    batch = memory[torch.randint(len(memory), (32,))]
    cell, action, reward, after, ended = batch.split([2, 1, 1, 2, 1], dim=1)  # its columns
    y = reward + 0.95 * (1 - ended) * target(after).amax(1, keepdim=True).detach()
    return ((y - online(cell).gather(1, action.long())) ** 2).mean()

# %%
def learn(tau, seed):
    torch.manual_seed(seed)
    online, target, path = network(), network(), []
    target.load_state_dict(online.state_dict())  # equal weights at the start
    optimiser = torch.optim.Adam(online.parameters(), lr=0.01)
    for _ in range(1500):
        loss = loss_of(online, target)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        soft_update(target, online, tau)
        path.append(online(START).max().item())
    return online, path

# %% [markdown]
# For now `target` is a copy of the same network: $\tau=1$. Three networks learn, from different random weights. The value
# of the start cell should become 6.7.

# %%
copies = [learn(tau=1.0, seed=seed) for seed in range(3)]
print("value of the start cell:", *(f"{path[-1]:,.0f}" for _, path in copies))

# %% [markdown]
# All three networks have exploded.
#
# ## 5.3 The target network
#
# An update that raises $Q(s,a)$ also raises the Q-values of cells that look alike, and $s'$ is one of them. If the
# largest of those rises by more than $1/\gamma$ times as much, the target runs ahead of $Q$, and the network chases its
# own tail. In a table, changing one entry leaves the others alone.
#
# So a second network, the **target network** $\bar\theta$, computes $y$. It follows the **online network** $\theta$
# slowly, after each step by a fraction $\tau$ of the way:
#
# $$\bar\theta\leftarrow(1-\tau)\,\bar\theta+\tau\,\theta$$
#
# This is `soft_update`. Now with $\tau=0.05$:

# %%
calm = [learn(tau=0.05, seed=seed) for seed in range(3)]
figure, ax = plt.subplots(figsize=(6, 3), layout="constrained")
for runs, style in ((copies, "C1"), (calm, "C0")):
    ax.plot(np.transpose([path for _, path in runs]), style, lw=1)
ax.set(xlabel="updates", ylabel="value of the start cell", yscale="symlog",
       title="orange: τ = 1; blue: τ = 0.05; three runs each")
assert min(path[-1] for _, path in copies) > 100 > max(path[-1] for _, path in calm)

# %% [markdown]
# The scale is linear up to 2 and logarithmic above. With $\tau=1$ all three runs climb. With 0.05 all three settle. At
# the right values?

# %%
cells = torch.cartesian_prod(torch.arange(4.0), torch.arange(4.0))
values = [online(cells).detach().amax(1).view(4, 4) for online, _ in calm]
draw_maps({"table": fly(300)[0], "network": values[0], "another": values[1]}, numbers=True)

# %% [markdown]
# Nearly, even in cell (1, 1), which the networks never saw. Only the device's own cell is far off: no step starts there,
# so no target asks for it.
#
# ## 5.4 Exploring
#
# In a large city random flights rarely get far, so the agent should use what it has learned. But if it always takes the
# action that seems best, it may never find out that another is better. The paper draws from a **softmax policy** with
# the **temperature** $\beta$:
#
# $$\pi(a\mid s)=\frac{\exp(Q(s,a)/\beta)}{\sum_{a'}\exp(Q(s,a')/\beta)}$$

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("cold_policy")

# %% [markdown]
# Here is the policy for the Q-values at the top:

# %%
from uavdh_lite.ddqn import softmax_policy

figure, axes = plt.subplots(1, 3, figsize=(7, 2.2), sharey=True, layout="constrained")
for ax, beta in zip(axes, (0.1, 1, 10)):
    ax.bar(list("NESWHL"), softmax_policy(q_now, beta)[0])
    ax.set(title=f"probabilities, β = {beta}", ylim=(0, 1))

# %% [markdown]
# At β = 1 it often tries actions that seem almost as good as the best. At β = 10 it flies nearly at random.
#
# ## 5.5 Double Q-learning
#
# Q-values are estimates, so each has some error. In the first picture, landing is refused and costs 1, so its bar
# should be 1 below that of hovering, not 7. What do errors do to the largest Q-value?

# %%
Quiz("whose_maximum")

# %% [markdown]
# The maximum asks the same estimates two questions: *which* action is best, and *what* is it worth? The luckiest error
# answers both. In **double Q-learning** one set of estimates chooses and another one judges. In the paper's target these
# are the online and the target network:
#
# $$y=r+\gamma\,Q_{\bar\theta}\big(s',\arg\max_{a'}Q_\theta(s',a')\big)$$

# %%
import inspect

from uavdh_lite.ddqn import ddqn_target

print("".join(inspect.getsource(ddqn_target).splitlines(True)[-2:]))

# %% [markdown]
# Where the episode ended, `discount` is 0. Let six actions all be worth 0, and give the estimates random errors:

# %%
chooser, own = torch.randn(2, 20_000, 6)
for name, share in (("the chooser itself", 1.0), ("a related judge", 0.7), ("a stranger", 0.0)):
    # share is the correlation with the chooser's errors: 1 for equal ones, 0 for unrelated ones
    judge = share * chooser + (1 - share**2) ** 0.5 * own
    y = ddqn_target(torch.zeros(20_000), torch.ones(20_000), chooser, judge)
    print(f"{name:<19} mean target {y.mean():5.2f}")

# %% [markdown]
# The right target is 0. The chooser flatters itself; a stranger does not flatter it. The target network, an older copy,
# is a closely related judge: it reduces the bias a little.
#
# **DDQN** means *double deep Q-network*: a deep network instead of the table, a chooser and a judge.
#
# ## 5.6 The paper's network
#
# All that is missing is a larger network that turns the map and the time of notebook 4 into six Q-values.
#
# | layer | what comes out |
# | --- | --- |
# | the map | 5×31×31 |
# | convolution with 16 kernels 5×5, ReLU: two cells are lost on each side | 16×27×27 |
# | the same again | 16×23×23 |
# | written as a list, and the time | 8465 |
# | three fully connected layers, ReLU | 256 each |
# | a fully connected layer | 6 |
#
# A convolution treats all places alike. The list behind it does not: each of its weights belongs to one place.
#
# That makes 2,308,854 weights, nearly all in the first fully connected layer: 256 neurons with 8465 inputs each. The
# agent's first convolution moves three cells at a time, so its network has only 246,006.
#
# ## Recap
#
# - Q-learning moves $Q(s,a)$ towards $r+\gamma\max Q(s',a')$, so the news of a reward spreads backwards.
# - The softmax policy explores where Q-values lie close together compared with $\beta$.
# - A slow target network keeps learning calm. In DDQN it judges what the online network chooses.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/05_ddqn/05_ddqn.ipynb) come with checks and hints.
#
# Further reading: Sutton and Barto, *Reinforcement Learning*, sections 6.5 and 6.7; van Hasselt et al., 2016.
