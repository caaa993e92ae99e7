# %% [markdown]
# # 5 · DDQN
#
# DDQN is short for *double deep Q-network*: Q-learning with a network ("deep"), and with two copies of it
# ("double"). The agent acts by *Q-values*: for each action, the reward to come if it takes this action now and the
# best ones afterwards, later rewards counted less. This notebook goes from a table of 36 such numbers to the paper's network of 2.3 million weights, and measures on the
# way what each part of the method is good for.
#
# The figure below shows what such numbers are worth. Each point is one of 500 test missions of a trained agent. Its
# height is the largest Q-value at the start, so what the agent expects. Its place from left to right is what
# the flight then earns. Section 5.5 comes back to it.

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
import numpy as np
import torch
from matplotlib.figure import Figure
from torch import nn

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import ACTIONS, Environment, Outcome, Rewards, State
from uavdh_lite.evaluation import bootstrap_interval, evaluate, mean_interval
from uavdh_lite.plotting import BLUE, GREEN, ORANGE, VERMILION

torch.set_num_threads(1)  # the networks here are small

# %%
agent = load_agent("manhattan_ddqn")
flights = evaluate(Environment(agent.city), agent, agent.scenario, 500, seed=0, record=True)
expected = agent.q_values(flights.start).amax(1).numpy()
own_rewards, earned = agent.recipe.rewards_at(agent.training["steps"]), 0.0
for flown in reversed(flights.history):  # the discounted sum of rewards, from the last step back to the first
    earned = own_rewards(flown.outcome) + agent.recipe.discount * earned

# %%
figure = Figure(figsize=(5, 4), layout="constrained")
ax = figure.subplots()
ax.plot(earned, expected, ".", color=BLUE, alpha=0.5, label="one flight")
ax.axline((0, 0), slope=1, color="black", lw=1, label="earned = expected")
ax.set(xlabel="discounted reward earned in the flight", ylabel="largest Q-value at its start")
ax.legend()
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Learn a table of Q-values, replace it by a network, compare three ways to use a memory, make a memory too large and too small, measure the maximisation bias, slow down the targets, turn the temperature, open the paper's network, and ask a trained one about shadows |
# | **What you'll learn** | Q-learning, function approximation, combined experience replay, double Q-learning, soft targets, the softmax policy, probing a network |
# | **What you'll need** | Notebooks 3 and 4; means, variances, gradients, the idea of a neural network. 75 minutes to read, 45 seconds to run; 10 minutes of exercises |
#
# ## 5.1 Q-learning in a table
#
# We begin in a street of six cells. The landing zone is cell 0. A device in cell 5 holds 10 data units, all of which
# are uploaded when the UAV gets there. The flying time is unlimited, the rewards are the paper's: 1 for a data unit,
# −0.2 for each step, −1 more for an action that is refused, such as landing outside the zone.

# %%
WEST, EAST, LAND = range(3)

def step(cell, full, action, device=5, end=5):
    after = np.clip(cell + (action == EAST) - (action == WEST), 0, end)
    landed, refused = (action == LAND) & (cell == 0), (action == LAND) & (cell > 0)
    uploads = full & (after == device) & ~landed
    outcome = Outcome(None, 10 * uploads[:, None], refused, landed, crashed=False, flew=True)
    return after, full & ~uploads, Rewards()(outcome), 0.95 * ~landed

# %% [markdown]
# A state is the cell and whether the device is still `full`: 12 states with 3 actions. The right Q-value of an
# action is the reward now, plus $\gamma$ times the best Q-value of the next state, with the *discount*
# $\gamma = 0.95$, or 0 if the episode is over. That is the *Bellman equation*,
# $Q(s,a) = \mathbb{E}[r + \gamma \max_{a'} Q(s',a')]$. *Q-learning* makes a rule of it: after each step, move
# $Q(s,a)$ a part $\alpha$ of the way to the *target* $y$,
#
# $$Q(s,a) \leftarrow Q(s,a) + \alpha\,\big(y - Q(s,a)\big), \qquad y = r + \gamma \max_{a'} Q(s',a')$$
#
# The library has no code for tables and needs none. A table is a linear layer whose input is 1 for the present state
# and 0 for all others. With $y$ taken as a number (it is not differentiated, though it depends on $Q$) the gradient of
# $(Q - y)^2$ is $2\,(Q - y)$, so gradient descent at the rate $\alpha/2$ is the rule. `DDQN` keeps two copies of the
# Q-values: *online*, which learns, and *target*, which follows it at a rate $\tau$ and helps to compute $y$. Sections
# 5.4 and 5.6 say why. With $\tau = 1$ the copies are equal, and this is plain Q-learning.

# %%
from uavdh_lite.ddqn import DDQN, ddqn_target, draw_actions, softmax_policy

def row(number, rows):
    return (nn.functional.one_hot(torch.tensor(number).long(), rows).float(),)

def q_table(rows, alpha, batch=1, tau=1.0, actions=3):
    table = nn.Linear(rows, actions, bias=False)
    nn.init.zeros_(table.weight)
    rate = alpha * batch / 2  # the loss is the mean over the batch
    return DDQN(table, torch.optim.SGD(table.parameters(), rate), tau)

def tensors(action, reward, discount):
    return torch.as_tensor(action), *(torch.tensor(x, dtype=torch.float32) for x in (reward, discount))

# %% [markdown]
# To learn from some steps takes two lines: the targets $y$, then a move towards them.

# %%
def learn_from(learner, now, action, reward, discount, then):
    y = learner.targets(reward, discount, then)
    learner.update(now, action, y)

# %% [markdown]
# Now eight steps at a time, from states and with actions drawn at random:

# %%
learner, generator = q_table(12, alpha=0.5, batch=8), np.random.default_rng(0)
for _ in range(800):
    cell, full, action = generator.integers((6, 2, 3), size=(8, 3)).T
    after, left, reward, discount = step(cell, full == 1, action)
    learn_from(learner, row(cell + 6 * full, 12), *tensors(action, reward, discount), row(after + 6 * left, 12))

# %%
q = learner.online.weight.detach()  # (actions, states)
for title, part in (("data waiting", q[:, 6:]), ("data collected", q[:, :6])):
    print(f"{title:<14} ", *(f"cell {c}" for c in range(6)))
    for name, values in zip(("west", "east", "land"), part.tolist()):
        print(f"{name:>14} ", *(f"{value:6.2f}" for value in values))

# %% [markdown]
# While the data waits, "east" is best everywhere, also in the landing zone, where "land" would end the episode with
# nothing. (In cell 5 the UAV hits the end of the street, stays and collects; "land" is refused there, but collects
# too.) Check one: "east" in cell 4 earns 10 − 0.2 now, then $0.95 \cdot (-0.90)$, the best of cell 5 without data,
# together 8.94. Afterwards "west" is best until cell 0, and there "land". Nobody flew like that: states and actions
# were random. The target has the maximum in it and not the action flown next, so the best policy is learned from any
# steps, as long as every action is tried in every state again and again. This is called *off-policy*, and it allows
# learning from a memory.
#
# Is the table right? It is if the Bellman equation holds in all 36 places: with $\gamma < 1$ it has only one
# solution. Its right side is the library's target function, with the same Q-values as online and as target:

# %%
cell, full, action = np.indices((6, 2, 3)).reshape(3, -1)
after, left, reward, discount = step(cell, full == 1, action)
_, reward, discount = tensors(action, reward, discount)
y = ddqn_target(reward, discount, q.T[after + 6 * left], q.T[after + 6 * left])
print(f"largest error of the Bellman equation: {(y - q.T[cell + 6 * full, action]).abs().max():.4f}")

# %% [markdown]
# ### What the discount does
#
# A reward that comes $k$ steps later counts $\gamma^k$ of what it would count now:

# %%
print("steps ahead ", *(f"{k:>7}" for k in (1, 10, 20, 40, 70)), "   1/(1−γ)")
for gamma in (0.9, 0.95, 0.97, 0.99):
    print(f"γ = {gamma:<8}", *(f"{gamma**k:>7.1%}" for k in (1, 10, 20, 40, 70)), f"{1 / (1 - gamma):>9.0f}")
print(f"a crash, −150, 40 steps ahead, γ = 0.95: {-150 * 0.95**40:.0f} now")

# %% [markdown]
# The *horizon* $1/(1-\gamma)$ is how far ahead an agent looks, in round numbers: beyond two or three times of that,
# nothing counts. With 0.95 even a crash fades: 40 steps ahead it weighs as much as a detour of a hundred steps at
# −0.2. A device 20 steps away counts a third of its data. So why not 0.99? Values of far steps are sums of many uncertain
# terms, and harder to learn.
#
# ### Where an episode ends
#
# After a landing nothing follows, so there $y = r$; in `step` above the discount is 0. Forget that flag, and learn the
# same table once more:

# %%
def landing_values(remember):
    learner, generator = q_table(12, alpha=0.5, batch=8), np.random.default_rng(0)
    for _ in range(800):
        cell, full, action = generator.integers((6, 2, 3), size=(8, 3)).T
        after, left, reward, discount = step(cell, full == 1, action)
        discount = discount if remember else np.full(8, 0.95)
        learn_from(learner, row(cell + 6 * full, 12), *tensors(action, reward, discount), row(after + 6 * left, 12))
    return learner.online.weight.detach()[:, 6]  # cell 0, with data waiting

for remember in (True, False):
    values = zip(("west", "east", "land"), landing_values(remember).tolist())
    print(f"{'with' if remember else 'without'} the flag:", ", ".join(f"{name} {value:.2f}" for name, value in values))

# %% [markdown]
# Without the flag, "land" with the data still waiting is worth 0.95 of the best that cell 0 has to offer, as if the flight
# went on after the landing. In training the errors of a network then suffice to make the UAV land at once.
#
# The same holds for *n-step targets*, which sum $n$ rewards before they ask the network. Four steps of an episode with the
# rewards −0.2, 3.8, −0.2 and 0, the last one a landing, and $n = 3$, $\gamma = 0.9$. By hand: from the first step
# $y = -0.2 + 0.9 \cdot 3.8 + 0.81 \cdot (-0.2) + 0.729\,Q = 3.058 + 0.729\,Q$ of the fourth state; from the second,
# $3.8 + 0.9 \cdot (-0.2) + 0.81 \cdot 0 = 3.62$ and no $Q$, since the episode ends within the three steps. The library's
# memory, asked for as many transitions as it needs to show each once:

# %%
from uavdh_lite.replay import Replay

def stored(number):
    nothing = np.zeros((len(number), 1))
    return State(number, 0 * number, nothing, nothing, nothing, number < 0)

memory = Replay(capacity=10, environments=1, max_devices=1)
for t, r in enumerate((-0.2, 3.8, -0.2, 0.0)):
    memory.add(stored(np.array([t])), action=0, reward=r, terminal=t == 3, next_state=stored(np.array([t + 1])))
batch = memory.sample(100, np.random.default_rng(0), discount=0.9, steps=3)
for t in range(4):
    (k, *_) = np.flatnonzero(batch.state.uav_cell == t)
    print(f"step {t}: y = {batch.reward[k]:6.3f} + {batch.discount[k]:.3f} Q(step {batch.next_state.uav_cell[k]})")

# %% [markdown]
# ## 5.2 From the table to a function
#
# How many rows has a table for the paper's city, with five devices that hold up to 20 whole data units?

# %%
from math import comb

cells, places = int((~agent.city.no_fly).sum()), comb(len(agent.city.device_cells), 5)
print(f"{cells} cells × 70 times × {places:.1e} places × 21⁵ amounts = {cells * 70 * places * 21**5:.0e} rows")

# %% [markdown]
# Nobody visits them all. A new state must be treated like similar ones, and a table knows no similarity: a row never
# visited is never changed. A network treats states alike whose inputs are alike. A test: a street of 12 cells, the
# device in any of them. A network learns from five of its places. We ask in how many states its largest Q-value
# belongs to a best action, with the device in these places and in the other seven. First every step that is possible
# in this street: 12 cells, data waiting or not, 12 places of the device, 3 actions.

# %%
from typing import NamedTuple

class Steps(NamedTuple):
    """Steps of the street; each field is a tensor with one entry for each step."""
    action: torch.Tensor
    reward: torch.Tensor
    discount: torch.Tensor
    cell: torch.Tensor  # the state before the step
    full: torch.Tensor
    device: torch.Tensor
    after: torch.Tensor  # cell and data after it
    left: torch.Tensor

    def rows(self, chosen):
        return Steps(*(field[chosen] for field in self))

# %%
cell, full, device, action = np.indices((12, 2, 12, 3)).reshape(4, -1)
after, left, reward, discount = step(cell, full == 1, action, device, end=11)
every_step = Steps(*tensors(action, reward, discount), *map(torch.from_numpy, (cell, full, device, after, left)))
every_state = every_step.rows(slice(None, None, 3))  # each state is there three times, once for each action

# %% [markdown]
# The right values of all 288 states come from repeating the target until nothing changes any more. This is called
# *value iteration*:

# %%
best, following = torch.zeros(288, 3), (after * 2 + left) * 12 + device  # `following`: the number of the next state
for _ in range(300):
    best = ddqn_target(every_step.reward, every_step.discount, best[following], best[following]).view(288, 3)

# %% [markdown]
# The network gets how far and on which side the device is, how far the landing zone is, and whether there is data
# left.

# %%
def inputs(cell, full, device):
    return (torch.stack([(device - cell) / 12, cell / 12, full.float()], 1),)

def small_network():
    return nn.Sequential(nn.Linear(3, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))

# %%
def learn_steps(learner, chosen, inputs):
    s = every_step.rows(chosen)
    then = inputs(s.after, s.left, s.device)
    learn_from(learner, inputs(s.cell, s.full, s.device), s.action, s.reward, s.discount, then)

@torch.no_grad()
def right_and_error(network, inputs):
    q = network(*inputs(every_state.cell, every_state.full, every_state.device))
    value = best.gather(1, q.argmax(1, keepdim=True)).squeeze(1)  # of the action that the network takes
    return (value > best.amax(1) - 1e-4).numpy(), (q - best).abs().mean(1).numpy()

# %%
def five_places(tau, seed):
    torch.manual_seed(seed)
    network, generator = small_network(), np.random.default_rng(seed)
    learner = DDQN(network, torch.optim.Adam(network.parameters(), 0.03), tau)
    places = generator.permutation(12)[:5]
    known = np.flatnonzero(np.isin(every_step.device, places))
    for _ in range(1000):
        learn_steps(learner, generator.choice(known, 64), inputs)
    right, error = right_and_error(network, inputs)
    at_known = np.isin(every_state.device, places)
    return right[at_known].mean(), right[~at_known].mean(), float(error.mean())

# %%
networks = [five_places(tau=0.1, seed=seed) for seed in range(3)]
for known, new, _ in networks:
    print(f"best action in {known:.0%} of the states with known places, {new:.0%} with new ones")
print(f"guessing: {(best > best.amax(1, keepdim=True) - 1e-4).float().mean():.0%}")

# %% [markdown]
# Each of the three seeds knows a different five places. The network is about as good in new places as in known ones, where
# a table would have to guess, one in three. It owes that to inputs that are *relative*, like the centred map of
# notebook 4. The price: an update of a table changes one value, an update of a network all of them, and with them
# the next targets. Much of what follows is there to keep that in check.
#
# ## 5.3 Replay, and combined replay
#
# Consecutive steps of a flight resemble each other. *Experience replay* keeps the last steps in a memory and learns
# from a *minibatch* drawn from it at random: each step is used several times, mixed with others. In *combined*
# experience replay (Zhang and Sutton, 2017), which the paper uses, the newest step is always in the minibatch. The
# library's `sample` does that. (Of the environment's state, the street needs one field, for the row of its table.)

# %%
memory = Replay(capacity=50, environments=1, max_devices=1)
for t in np.arange(100):
    memory.add(stored(t[None]), action=0, reward=0, terminal=False, next_state=stored(t[None] + 1))
minibatches = [memory.sample(6, generator, discount=0.95).state.uav_cell for _ in range(3)]

# %%
figure, steps = Figure(figsize=(8, 2.3), layout="constrained"), np.arange(40, 100)
ax = figure.subplots()
for k, drawn in enumerate(minibatches):
    colour = np.where(steps < 50, "white", "0.85").astype(object)
    colour[np.isin(steps, drawn)], colour[steps == drawn[0]] = BLUE, ORANGE  # the newest comes first in a minibatch
    ax.bar(steps, 0.7, 0.9, bottom=k, color=colour, edgecolor="0.6", lw=0.5)
for label, colour in (("forgotten", "white"), ("in the memory", "0.85"), ("drawn", BLUE), ("the newest", ORANGE)):
    ax.bar(0, 0, color=colour, edgecolor="0.6", label=label)  # for the legend
ax.set(xlabel="number of the step", xlim=(39, 100), ylabel="minibatch", ylim=(2.85, -0.15))
ax.set_yticks([0.35, 1.35, 2.35], ["1st", "2nd", "3rd"])
figure.legend(loc="outside upper center", ncols=4, frameon=False)
figure

# %% [markdown]
# Three minibatches of six. The newest step is in each, and the first in it; the others are drawn from the last 50. So all
# *but* the first are a minibatch of plain replay, and three learners can be compared: *newest only*, *plain* and
# *combined*, the last two with four steps in a minibatch.
#
# To repeat everything 20 times at the price of one run, 20 streets of 8 cells lie side by side in one table. Each has 16
# rows of its own, 8 with and 8 without data. The memory holds the steps of all streets, and a minibatch has the
# newest step of each street first. So *plain* draws five steps a street and leaves out the newest. (The others are
# drawn from all streets together, so four a street is an average.)
#
# First the memory is filled by flying at random, then learning begins, with actions from the softmax policy of 5.7.
# In two of three worlds the way is closed behind cell 4 while the memory is filled, and nobody gets to the device in
# cell 7; then it opens.

# %%
STREETS = 20
DRAWN = {"newest only": 1, "plain": 5, "combined": 4}  # steps in a minibatch, for each street
LEFT_OUT = {"newest only": 0, "plain": 1, "combined": 0}  # of these

def row_in_table(cell, full):
    return 16 * np.arange(STREETS) + 8 * full + cell

def learn_minibatch(learner, batch, out):
    now, then = (row(state.uav_cell[out:], 16 * STREETS) for state in (batch.state, batch.next_state))
    learn_from(learner, now, *tensors(batch.action[out:], batch.reward[out:], batch.discount[out:]), then)

# %%
def learn(mode, capacity, filled, end=7, steps=1500, seed=0):
    drawn, out = STREETS * DRAWN[mode], STREETS * LEFT_OUT[mode]
    generator, history = np.random.default_rng(seed), []
    learner, memory = q_table(16 * STREETS, 0.3, drawn - out), Replay(capacity * STREETS, STREETS, 1)
    cell, full = np.zeros(STREETS, int), np.ones(STREETS, bool)
    for t in range(filled + steps):
        now, action = row_in_table(cell, full), generator.integers(0, 3, STREETS)
        if t >= filled:
            action = draw_actions(softmax_policy(learner.online.weight.detach().T[now], 0.5), generator)
        cell, full, reward, discount = step(cell, full, action, 7, end if t < filled else 7)
        memory.add(stored(now), action, reward, discount == 0, stored(row_in_table(cell, full)))
        cell, full = np.where(discount == 0, 0, cell), full | (discount == 0)  # a new flight after a landing
        if t >= filled:
            history.append(reward)
            learn_minibatch(learner, memory.sample(drawn, generator, 0.95), out)
    return np.reshape(history, (15, -1, STREETS)).mean(1)

# %%
worlds = {"nothing changes": {"capacity": 20_000, "filled": 500},
          "way opens, memory of 500": {"capacity": 500, "filled": 5000, "end": 4},
          "way opens, memory of 20,000": {"capacity": 20_000, "filled": 5000, "end": 4}}

# %%
curves = {world: {mode: learn(mode, **given) for mode in DRAWN} for world, given in worlds.items()}

# %%
figure, x = Figure(figsize=(10.5, 3.5), layout="constrained"), range(50, 1500, 100)
for ax, (world, by_mode) in zip(figure.subplots(1, 3, sharey=True), curves.items()):
    for (mode, values), style, colour in zip(by_mode.items(), (":", "--", "-"), (GREEN, VERMILION, BLUE)):
        middle, error = values.mean(1), 2 * values.std(1) / np.sqrt(STREETS)
        ax.plot(x, middle, style, color=colour, label=mode)
        ax.fill_between(x, middle - error, middle + error, color=colour, alpha=0.2, lw=0)
        print(f"{world:<28}{mode:<12}first 500 steps {values[:5].mean():+.2f}, last 500 {values[-5:].mean():+.2f}")
    ax.set(title=world, xlabel="steps of learning", ylabel="reward per step")
figure.axes[0].legend()
figure

# %% [markdown]
# Lines are means over the 20 streets, bands two standard errors.
#
# - **Nothing changes.** Replay needs less than half the steps of the newest step alone (and learns from four rows
#   a step, not one). Combined is a little ahead of plain at first, while the memory holds mostly random flights;
#   later they are alike.
# - **A way opens, memory of 500.** Old steps are soon overwritten. Combined replay recovers sooner than plain.
# - **A way opens, memory of 20,000.** Of four rows drawn from more than 5000 steps, on average less than one is new,
#   and the old ones say that the street ends in cell 4. Plain replay has not recovered after 1500 steps, combined
#   replay in part. Here, after the first few hundred steps, learning without a memory is best. (It is the same
#   curve as in the middle: without a memory, its size does not matter.)
#
# So combined replay gains little by itself. It is a remedy for a memory that is too large, and Zhang and Sutton
# present it as that. And the paper's memory? It holds 50,000 steps, and an update draws 128: a new step waits 390
# updates, on average, for its first draw. In a run of a million that is short, so expect little; but it costs
# nothing either. (With N environments side by side, as in recipe `lite`, the library puts in the newest N.)
#
# ### A memory that is too small
#
# A table forgets nothing: what it learns in one row leaves the others alone. A network does forget, and the memory is
# what reminds it. Take the street of 5.2, where missions differ by the device's place. A network learns for 1000 updates
# from all of them. Then the missions change: for 300 updates, devices stand only in the first four cells, and every
# update comes with eight new steps. What becomes of the other missions, of which none is flown? (This network sees places
# as *one-hot* inputs, a 1 for the cell and zeros for all others. So one place says little about the next; the relative
# inputs of 5.2 say more.)

# %%
def one_hot_inputs(cell, full, device):
    places = [nn.functional.one_hot(place, 12) for place in (cell, device)]
    return (torch.cat([*places, full[:, None]], 1).float(),)

# %%
near_steps = np.flatnonzero(every_step.device < 4)
far_states = (every_state.device >= 4).numpy()

# %%
def learn_all_missions(seed):
    torch.manual_seed(seed)
    network = nn.Sequential(nn.Linear(25, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))
    learner, generator = DDQN(network, torch.optim.Adam(network.parameters(), 0.01), 0.1), np.random.default_rng(seed)
    flown = generator.integers(0, len(every_step.action), 8000)
    for _ in range(1000):
        learn_steps(learner, generator.choice(flown, 64), one_hot_inputs)
    return learner, flown

# %%
from copy import deepcopy

def missions_change(learner, flown, capacity, seed):
    learner, generator, errors = deepcopy(learner), np.random.default_rng(seed), []
    for t in range(300):
        if t % 10 == 0:
            errors.append(right_and_error(learner.online, one_hot_inputs)[1][far_states].mean())
        flown = np.r_[flown, generator.choice(near_steps, 8)]
        learn_steps(learner, generator.choice(flown[-capacity:], 64), one_hot_inputs)
    return np.array(errors)

# %%
sizes, errors = {"memory of 500 steps": 500, "memory of all steps": 10_400}, {}
for seed in range(3):
    learner, flown = learn_all_missions(seed)
    for name, size in sizes.items():
        errors[name, seed] = missions_change(learner, flown, size, seed)

# %%
figure = Figure(figsize=(6.5, 3.4), layout="constrained")
ax = figure.subplots()
for (name, seed), values in errors.items():
    style = {"color": VERMILION} if sizes[name] == 500 else {"color": BLUE, "linestyle": "--"}
    ax.plot(range(0, 300, 10), values, **style, label=name if seed == 0 else None)
    print(f"{name}, seed {seed}: error {values[0]:.2f} before the change, {values[-5:].mean():.2f} at the end")
ax.set(xlabel="updates since the missions changed", ylabel="mean error of Q-values,\nmissions no longer flown", ylim=0)
ax.legend(fontsize="small")
figure

# %% [markdown]
# Each line is a seed; both memories begin with the same network. The large memory still holds the old missions, and the
# network goes on learning from them. The small one holds none of them any more after 63 updates, and from then on
# nothing mends what the new steps spoil. The seeds differ, so compare the memories seed by seed.
#
# In training, each mission is drawn at random, so a memory is too small if it holds only a few missions. One that is too
# large holds steps of a policy or a world that are gone. Nobody knows the right size beforehand; it is a knob.
#
# ## 5.4 The maximisation bias
#
# Q-values are estimates and have errors. What does that do to their maximum?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("whose_maximum")

# %% [markdown]
# Take actions that are all worth the same, as they seem to be early in training, say 0, and estimates with
# errors of standard deviation 1. The maximum of several estimates is, on average, too high:

# %%
torch.manual_seed(0)
zero, one = torch.zeros(100_000), torch.ones(100_000)
for actions in (2, 6, 20):
    q, other = torch.randn(2, 100_000, actions)
    single, double = ddqn_target(zero, one, q, q), ddqn_target(zero, one, q, other)
    print(f"{actions:>2} actions: maximum {single.mean():+.2f}, double {double.mean():+.2f}")

# %% [markdown]
# The maximum asks the same estimates two questions: which action is best, and what is it worth? *Double* Q-learning
# puts the second one to other estimates. If their errors are independent, they know nothing of the luck that chose
# the action, and the bias *upwards* is gone. (Where one action really is better, the judge is sometimes asked
# about a wrong one, and double is a little too low.) In the paper (eq. 10) the *online* network, with weights
# $\theta$, chooses and the *target* network, with weights $\bar\theta$, judges; in the library that is two lines,
# the ones that made the numbers above:
#
# $$y = r + \gamma\, Q_{\bar\theta}\big(s', \arg\max_{a'} Q_\theta(s', a')\big)$$

# %%
import inspect

print("".join(inspect.getsourcelines(ddqn_target)[0][-2:]))

# %% [markdown]
# Does learning average the errors away? In state A the UAV can land, which is worth 0, or fly on to state B. There,
# each of six actions ends the episode with a random reward of mean −0.2 and standard deviation 1. So flying on is
# worth $0.95 \cdot (-0.2) = -0.19$. Four learners with $\alpha = 0.1$, 100 repetitions of each side by side:
#
# - *single*: Q-learning as in 5.1.
# - *slow target*: one table, and the maximum of a target table that follows slowly ($\tau = 0.005$, section 5.6).
# - *DDQN*: the same, but the table chooses and the slow target judges.
# - *double*: two tables, each the other's judge; a coin decides which of them learns from a step. (In the library the
#   judge is a learner's `target`. So each learner gets the other's table as its target, with $\tau = 0$, so that
#   nothing else moves it.)

# %%
N = 100
A, B = row(np.arange(N), 2 * N)[0], row(N + np.arange(N), 2 * N)[0]

def flying_on(*learners, steps=1500, seed=0):
    generator, values = np.random.default_rng(seed), []
    for _ in range(steps):
        action = np.r_[np.full(N, EAST), generator.integers(0, 6, N)]
        reward = np.r_[np.zeros(N), generator.normal(-0.2, 1, N)]
        learner = learners[generator.integers(len(learners))]
        learn_from(learner, (torch.cat([A, B]),), *tensors(action, reward, np.repeat([0.95, 0], N)),
                   (torch.cat([B, B]),))
        values.append(learners[0].online.weight[EAST, :N].tolist())
    return np.array(values)

# %%
def flying_on_slow_target(steps=1500, seed=0):
    generator, q, target, values = np.random.default_rng(seed), np.zeros((2, N, 6)), np.zeros((2, N, 6)), []
    for _ in range(steps):
        action, reward = generator.integers(0, 6, N), generator.normal(-0.2, 1, N)
        q[0, :, EAST] += 0.1 * (0.95 * target[1].max(1) - q[0, :, EAST])  # the target chooses and judges
        q[1, np.arange(N), action] += 0.1 * (reward - q[1, np.arange(N), action])
        target += 0.005 * (q - target)
        values.append(q[0, :, EAST].copy())
    return np.array(values)

# %%
first, second, single, ddqn = (q_table(2 * N, 0.1, 2 * N, tau, 6) for tau in (0.0, 0.0, 1.0, 0.005))
first.target, second.target = second.online, first.online  # each table judges for the other
learned = {"single": flying_on(single), "slow target": flying_on_slow_target(),
           "DDQN": flying_on(ddqn), "double": flying_on(first, second)}

# %%
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
for (name, values), style, colour in zip(learned.items(), (":", "-.", "-", "--"), (VERMILION, ORANGE, BLUE, GREEN)):
    ax.plot(values.mean(1), style, color=colour, label=name)
    last = values[-500:].mean(0)
    print(f"{name:<12}{last.mean():+.3f} ± {2 * last.std() / np.sqrt(N):.3f} in the last 500 updates")
ax.axhline(-0.19, color="black", lw=1, label="true value")
ax.set(xlabel="updates", ylabel="Q-value of flying on from A", ylim=(-0.23, 0.23))
ax.legend(ncols=3, loc="upper right")
figure

# %% [markdown]
# (Means over the repetitions, ± two standard errors.) Q-learning believes that flying on is worth more than landing,
# and more updates do not cure it: with a constant $\alpha$ the errors never vanish. A slow target is calmer, so its
# maximum is less too high: that alone removes half of the bias. To let it judge what the table has chosen removes
# another quarter; not all, since the judge is an older copy of the same table, and their errors are related. Two
# tables get it right, but need a second learner.
#
# ## 5.5 What the DDQN agent expects, and what it earns
#
# An agent with such a bias expects more than it gets. In the figure at the top each point is a mission: the largest
# Q-value at its start, and the sum of its rewards, that of step $t$ times $\gamma^t$. The rewards are those that it
# learned from when it was kept, which are not quite the paper's:

# %%
print(own_rewards)
for name, values in (("expected", expected), ("earned", earned), ("difference", expected - earned)):
    print(f"{name:<11}mean {{:+.2f}}, 95 % from {{:+.2f}} to {{:+.2f}}".format(*bootstrap_interval(values)))
print(f"standard deviation of the difference: {(expected - earned).std():.2f}")
assert abs((expected - earned).mean()) < 0.05 * earned.mean()

# %% [markdown]
# On average the agent earns what it expects, to within 5 %. Single flights differ by more, since the network is not
# exact. (Notebook 8 looks at those that go wrong.) So no bias of note is left. That double estimation is the reason, this does not
# show: it would take an agent trained without.
#
# ## 5.6 Soft targets
#
# After each update the target network moves a little towards the online network:
#
# $$\bar\theta \leftarrow (1 - \tau)\,\bar\theta + \tau\,\theta$$
#
# Let an online weight jump from 0 to 1 and stay there. After $k$ updates $(1-\tau)^k$ of the distance is left. The
# *half-life* is the $k$ after which that is one half:

# %%
from uavdh_lite.ddqn import soft_update

def follow_jump(tau, updates=500):
    online, target = nn.Linear(1, 1, bias=False), nn.Linear(1, 1, bias=False)
    nn.init.ones_(online.weight)
    nn.init.zeros_(target.weight)
    path = []
    for _ in range(updates + 1):
        path.append(target.weight.item())
        soft_update(target, online, tau)
    return path

# %%
figure = Figure(figsize=(6.5, 3.2), layout="constrained")
ax = figure.subplots()
ax.plot([-50, 0, 0, 500], [0, 0, 1, 1], color="0.6", label="online weight")
for tau, colour in ((0.05, ORANGE), (0.005, BLUE)):
    half_life = np.log(0.5) / np.log(1 - tau)
    ax.plot(follow_jump(tau), color=colour, label=f"target weight, τ = {tau}")
    ax.plot([half_life, half_life], [0, 0.5], ":", color=colour)
    ax.plot(half_life, 0.5, "o", color=colour, label=f"half-life: {half_life:.0f} updates")
ax.set(xlabel="updates after the jump", ylabel="weight")
ax.legend(loc="lower right", fontsize="small")
figure

# %% [markdown]
# So $\bar\theta$ is about the mean of $\theta$ over the last $1/\tau$ updates, an *exponential moving average*: late,
# but calm. The Q-value of one action with a noisy reward shows both. The mean of the reward goes from 0 to 2 after 750
# updates:

# %%
def follow(tau):
    learner, generator, path = q_table(1, 0.1, tau=tau, actions=1), np.random.default_rng(0), []
    for t in range(1500):
        learn_from(learner, row([0], 1), *tensors([0], generator.normal(2 * (t >= 750), 1, 1), [0]), row([0], 1))
        path.append([learner.online.weight.item(), learner.target.weight.item()])
    return np.transpose(path)

# %%
figure = Figure(figsize=(6.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.plot(follow(1.0)[0], color="0.75", lw=0.8, label="online")
for tau, colour in ((0.05, ORANGE), (0.005, BLUE)):
    ax.plot(follow(tau)[1], color=colour, label=f"target, τ = {tau}")
ax.set(xlabel="updates", ylabel="Q-value")
ax.legend()
figure

# %% [markdown]
# Does that help to learn? The network of section 5.2 with three rates, and the mean error of all its Q-values:

# %%
by_rate = {tau: [five_places(tau, seed) for seed in range(3)] for tau in (1.0, 0.003)}
for tau, runs in sorted({**by_rate, 0.1: networks}.items()):
    print(f"τ = {tau:<6} errors after 1000 updates, three seeds: "
          + ", ".join(f"{error:.2g}" for _, _, error in runs))

# %% [markdown]
# Too fast and too slow are both bad, in each of the seeds. With $\tau = 1$ the network chases targets that each of its own
# updates moves. (With some other seeds its errors even grow without bound.) With $\tau = 0.003$ the targets are so late that 1000
# updates are too few. The paper's 0.005 belongs to a run of a million.
#
# ## 5.7 The softmax policy and its temperature
#
# Who always takes the best action never learns that another is better. In training the agent draws its actions, good
# ones more often (eq. 12):
#
# $$\pi(a \mid s) = \frac{\exp(Q(s,a)/\beta)}{\sum_{a'} \exp(Q(s,a')/\beta)}$$
#
# Two actions' probabilities have the ratio $\exp\big((Q(s,a) - Q(s,a'))/\beta\big)$: what counts is the *gap*
# between Q-values in units of $\beta$.

# %%
Quiz("cold_policy")

# %% [markdown]
# Heat the DDQN agent, in many states along its flights, and in the one
# among them with the median gap between the best two actions:

# %%
states = State.concatenate([flown.state[~flown.state.ended] for flown in flights.history[5:31:5]])
many = agent.q_values(states)
gaps = -many.topk(2).values.diff().squeeze(1)  # best minus second best
one_state = many[gaps.argsort()[len(gaps) // 2]][None]
betas = np.logspace(-2, 2, 60)
taken = [softmax_policy(many, beta).amax(1).mean().item() for beta in betas]
print("Q-values in one state:", {a: round(v, 2) for a, v in zip(ACTIONS, one_state[0].tolist())})
for beta in (0.1, 2.0):
    share = softmax_policy(many, beta).amax(1).mean()
    print(f"β = {beta}: the best action in {share:.0%} of all draws, mean over {len(many)} states")

# %%
def draw_policy(temperature):
    figure = Figure(figsize=(9, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.bar(ACTIONS, softmax_policy(one_state, temperature)[0].numpy(), color=BLUE)
    left.set(ylim=(0, 1), ylabel="probability", title=f"one state, β = {temperature:.2g}")
    right.semilogx(betas, taken, color=BLUE)
    right.axvline(temperature, color="black", linestyle=":")
    right.set(xlabel="temperature β", ylabel="probability", ylim=(0, 1), title="the best action, mean over all states")
    return figure

# %%
import ipywidgets

from uavdh_lite.labs.widgets import explore

slider = ipywidgets.FloatLogSlider(value=0.5, min=-2, max=2, step=0.05, description="β")
explore(draw_policy, temperature=slider)

# %%
draw_policy(0.5)

# %% [markdown]
# Cold, the policy is greedy; hot, it is uniform, one in six for each action. The paper's $\beta = 0.1$ explores only
# among actions that seem nearly equal, and takes the best one in most draws. That suffices when Q-values are about
# right. While they are still wrong it may not, so the recipe `lite` starts at 2 and cools to 0.1. In tests the agent
# takes the best action.
#
# ## 5.8 The paper's network
#
# What remains is to replace the table by the paper's network, and the row by the map of notebook 4. The rest stays
# as it is. (Notebook 6 puts it together.) The whole method, and where the library has each line:
#
# | for every step | in the library |
# | --- | --- |
# | draw $a$ from $\pi(\cdot \mid s)$, the softmax of $Q_\theta(s, \cdot)/\beta$ | `softmax_policy`, `draw_actions` |
# | fly: $s, a \to r, s'$ | `environment.step` |
# | put $(s, a, r, s')$ into the memory | `replay.add` |
# | draw a minibatch, the newest among it | `replay.sample` |
# | $y = r + \gamma\, Q_{\bar\theta}(s', \arg\max_{a'} Q_\theta(s', a'))$, or $y = r$ at the end | `learner.targets` |
# | one gradient step on $(Q_\theta(s, a) - y)^2$ | `learner.update` |
# | $\bar\theta \leftarrow (1 - \tau)\,\bar\theta + \tau\,\theta$ | the same, its last line |
#
# And the network itself. *Hooks* note the shape of what comes out of each layer when a state goes through:

# %%
from uavdh_lite.agent import build
from uavdh_lite.recipe import PAPER

observation, network = build(PAPER, agent.city)
layers = [layer for layer in network.modules() if isinstance(layer, (nn.Conv2d, nn.Flatten, nn.Linear))]
shapes = []
hooks = [layer.register_forward_hook(lambda layer, given, out: shapes.append(tuple(out.shape[1:]))) for layer in layers]

# %%
maps, time = observation(flights.start[:1])
network(maps, time)
for hook in hooks:
    hook.remove()

# %%
from matplotlib.patches import Rectangle

def draw_shape(ax, x, shape, colour):
    """Maps as a stack of squares, a list of numbers as a bar; returns the x after it."""
    if len(shape) == 1:
        height = 4 * np.log2(shape[0])
        ax.add_patch(Rectangle((x, -height / 2), 3, height, fc=colour, ec="white"))
        return x + 3
    count, side, _ = shape
    for k in range(count):
        corner = x + 0.9 * k, 0.9 * k - side / 2
        ax.add_patch(Rectangle(corner, side, side, fc=colour, ec="white", lw=0.5, zorder=-k))
    return x + side + 0.9 * count

# %%
kinds = {nn.Conv2d: ("convolution", BLUE), nn.Flatten: ("flattened", GREEN), nn.Linear: ("fully\nconnected", GREEN)}
drawn = [("maps", ORANGE), *(kinds[type(layer)] for layer in layers[:-1]), ("Q-values", VERMILION)]
figure, x = Figure(figsize=(8, 2.9), layout="constrained"), 0
ax = figure.subplots()
for (name, colour), shape in zip(drawn, [tuple(maps[0].shape[1:]), *shapes]):
    end, numbers = draw_shape(ax, x, shape, colour), "×".join(map(str, shape))
    if name == "flattened":  # the flying time joins here
        ax.add_patch(Rectangle((x, 27), 3, 3, fc=ORANGE))
        ax.text(x + 1.5, 32, f"+ {time.shape[1]}: time", ha="center", fontsize="small")
    ax.text((x + end) / 2, -32, f"{numbers}\n{name}", ha="center", va="top", fontsize="small")
    x = end + (12 if len(shape) == 3 else 22)
ax.set(xlim=(-5, x - 5), ylim=(-52, 38), aspect="equal")
ax.axis("off")
figure

# %% [markdown]
# Each square is one map, each bar a list of numbers. The weights:

# %%
for layer in network.head:
    weights = sum(p.numel() for p in layer.parameters())
    print(f"{type(layer).__name__:<8}{weights:>9,} weights" if weights else type(layer).__name__)
print(f"{sum(p.numel() for p in network.parameters()):,} weights in all")

# %% [markdown]
# Kernels are 5×5; the two convolutions have 8432 weights. Nearly all weights, 94 %, are in the first fully connected
# layer, which takes all numbers of the flattened maps and the flying time.
#
# ## 5.9 What the network knows of shadows
#
# A building between the UAV and a device takes most of the signal (notebook 1). No input says so: the network sees
# buildings and devices, and learns from rewards alone. Has it found out? First a *probe*: fit a linear model that reads
# from the last hidden layer whether the UAV sees the device. If the probe is right about states that it was not fitted to,
# the layer holds that knowledge.
#
# Near devices are seen more often than far ones, so distance alone would be a good guess. To rule that out, each
# example in which the device is seen gets a partner at the same distance in which it is not.

# %%
from dataclasses import replace

from matplotlib.colors import to_rgb

environment, city = Environment(agent.city), agent.city
generator = np.random.default_rng(0)

# %%
def one_device(count):
    """States on the way, with data at one device only."""
    state = agent.scenario.sample_anywhere(city, count, generator, spare_time=5)
    data = np.zeros_like(state.data_left)
    data[:, 0] = 20
    return replace(state, data_initial=data, data_left=data)

def to_device(state):  # rows south and columns east, from the UAV to the device
    row, col = np.divmod(state.device_cells[:, 0].astype(int), city.size)
    uav_row, uav_col = np.divmod(state.uav_cell.astype(int), city.size)
    return row - uav_row, col - uav_col

# %%
state = one_device(12_000)
seen = environment.line_of_sight[state.device_cells[:, 0], state.uav_cell]
distance = np.hypot(*to_device(state))
pairs = []
for d in np.unique(distance):
    with_sight, without = np.flatnonzero((distance == d) & seen), np.flatnonzero((distance == d) & ~seen)
    pairs += list(zip(with_sight, without))  # as many of one as of the other
chosen = np.ravel(pairs)
state, seen, distance = state[chosen], seen[chosen], distance[chosen]

# %% [markdown]
# The probe is fitted where the device stands in an even cell, and tested where it stands in an odd one, so it has not met
# those places. Next to the trained network it gets the distance alone, and a network of the same shape without any
# training:

# %%
@torch.no_grad()
def last_hidden(network):
    kept = []
    hook = network.head[-1].register_forward_hook(lambda layer, given, out: kept.append(given[0]))
    for start in range(0, len(state), 256):
        network(*agent.observation(state[start : start + 256]))
    hook.remove()
    return torch.cat(kept).numpy()

# %%
def probe(x):
    fitted = state.device_cells[:, 0] % 2 == 0
    x = (x - x[fitted].mean(0)) / (x[fitted].std(0) + 1e-6)
    y = np.where(seen, 1.0, -1.0)
    weights = np.linalg.solve(x[fitted].T @ x[fitted] + 30 * np.eye(x.shape[1]), x[fitted].T @ y[fitted])
    return np.sign(x[~fitted] @ weights) == y[~fitted]

# %%
torch.manual_seed(0)
_, untrained = build(agent.recipe, city)
right = {"distance alone": probe(distance[:, None]), "untrained network": probe(last_hidden(untrained)),
         "trained network": probe(last_hidden(agent.network))}
assert right["trained network"].mean() > right["untrained network"].mean() + 0.05

# %%
figure = Figure(figsize=(6, 2.4), layout="constrained")
ax = figure.subplots()
for k, (name, correct) in enumerate(right.items()):
    mean, low, high = mean_interval(correct)
    ax.barh(k, mean, color=(GREEN, ORANGE, BLUE)[k])
    ax.plot([low, high], [k, k], color="black")
    ax.text(0.02, k, f"{name}: {mean:.0%}", va="center", color="white" if k != 1 else "black")
ax.axvline(0.5, color="black", linestyle=":")
ax.set(xlim=(0, 1), yticks=[], xlabel=f"right about line of sight, {len(correct)} held-out states")
ax.invert_yaxis()
figure

# %% [markdown]
# The dotted line is guessing, the black lines are 95 % intervals. The distance says nothing, by construction. An
# untrained network mixes the picture at random, and a little can be read from the mixture. Training puts much
# more there. But what can be read need not be used. And the network has seen one city only: it may
# know the dark corners by heart.
#
# So change the picture. Take states in which a device near by is hidden and little time is left, and wipe out the
# buildings between the UAV and the device. For comparison, wipe out those of the equal area on the *other* side of
# the UAV. Only the layer "buildings" changes; where one may fly stays as it is.

# %%
state = one_device(20_000)
state = replace(state, time_left=(city.landing_distance.ravel()[state.uav_cell] + 6).astype(np.int16))
hidden = ~environment.line_of_sight[state.device_cells[:, 0], state.uav_cell]
state = state[hidden & (np.hypot(*to_device(state)) <= 5)]

# %%
def between(state):
    """The cells of the map between the UAV, in its middle, and the device."""
    cells = np.arange(1 - city.size, city.size)
    down, right = (offset[:, None] for offset in to_device(state))
    rows, cols = ((np.minimum(d, 0) <= cells) & (cells <= np.maximum(d, 0)) for d in (down, right))
    return torch.from_numpy(rows[:, :, None] & cols[:, None, :])

# %%
maps, time = agent.observation.full_map(state), agent.observation.time(state)
in_between = between(state)
opposite = in_between.flip(1, 2)
enough = (maps[:, 2] * opposite).sum((1, 2)) >= (maps[:, 2] * in_between).sum((1, 2))

# %%
@torch.no_grad()
def value(removed):
    edited = maps[enough].clone()
    edited[:, 2] *= ~removed[enough]
    return agent.network([edited], time[enough]).amax(1).numpy()

as_it_is = value(torch.zeros_like(in_between))
gains = {"between UAV and device": value(in_between) - as_it_is, "on the other side": value(opposite) - as_it_is}

# %%
colour = {"between UAV and device": VERMILION, "on the other side": GREEN}

def draw_removed(ax, example):
    buildings = maps[example, 2].numpy() > 0
    picture = np.where(buildings[..., None], 0.5, 1.0) * np.ones(3)
    for c, part in zip(colour.values(), (in_between, opposite)):
        picture[part[example].numpy() & buildings] = to_rgb(c)
    down, right = to_device(state[[example]])
    ax.imshow(picture, extent=(-15.5, 15.5, 15.5, -15.5))
    ax.plot(0, 0, "^", color="white", mec="black", ms=8)
    ax.plot(right, down, "X", color=ORANGE, mec="black", ms=8)
    ax.set(xlim=(-6.5, 6.5), ylim=(6.5, -6.5), xticks=[], yticks=[], title="one example")

# %%
figure = Figure(figsize=(7, 2.9), layout="constrained")
drawing, ax = figure.subplots(1, 2, width_ratios=(1, 1.5))
draw_removed(drawing, example=np.flatnonzero(enough)[0])
for k, (name, gain) in enumerate(gains.items()):
    mean, low, high = mean_interval(gain)
    ax.barh(k, mean, color=colour[name])
    ax.plot([low, high], [k, k], color="black")
ax.set(xlabel=f"largest Q-value goes up by, {len(gain)} states", ylim=(1.5, -0.5))
ax.set_yticks([0, 1], [f"removed\n{name}" for name in gains])
figure

# %%
more = gains["between UAV and device"] - gains["on the other side"]
mean, low, high = mean_interval(more)
print(f"difference {mean:+.2f}, 95 % from {low:+.2f} to {high:+.2f}; above 0 in {(more > 0).mean():.0%} of the states")
print(f"mean value of these states {as_it_is.mean():.1f}")
assert mean > 0.1

# %% [markdown]
# White triangle: the UAV; orange cross: the device; grey and coloured: buildings. On average the largest Q-value goes up a
# little whatever building is wiped out. It goes up more if it is one in the way. So the network has learned from
# rewards that buildings *between* it and a device cost something, and it looks at them.
#
# It is no ray tracer: the gain is small next to the value, and in some states it is the other way round. And a city with a
# missing building is new to this network, so such a test shows what it looks at, not how well it would fly there.
#
# ## Recap
#
# - Q-learning moves Q-values towards $r + \gamma \max Q$ of the next state, whatever policy has flown.
# - A network carries over to new states, if its inputs make them similar to known ones.
# - Replay uses steps several times. Combined replay costs nothing and helps when a large memory is out of date. With a
#   small one a network forgets missions that it no longer flies.
# - The maximum of noisy estimates is too high. A slow target removes half of the bias, as a judge most of it.
# - Soft targets are calm and late. The softmax policy explores where gaps are small compared with $\beta$.
# - A probe says what a hidden layer knows; a change of the input says what the network uses.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/05_ddqn`](exercises/05_ddqn/05_ddqn.ipynb).
#
# **1.** One action is worth `gap` more than each of the five others. At which temperature is it taken 99 times in
# 100?

# %%
def temperature_for(gap):
    return gap / np.log(5 * 99)

# %%
for gap in (0.5, 2.0):
    policy = softmax_policy(torch.tensor([[gap, 0, 0, 0, 0, 0]]), temperature_for(gap))
    assert abs(policy[0, 0].item() - 0.99) < 1e-4
    print(f"gap {gap}: β = {temperature_for(gap):.3f}")

# %% [markdown]
# **2.** Let the judge's errors have the correlation $\rho$ with the chooser's. What is the bias with six actions, if
# the maximum alone has 1.267? Predict it, then measure it. (Such a judge is $\rho$ times the chooser, plus errors of
# its own of size $\sqrt{1-\rho^2}$, so that its standard deviation is 1 again.)

# %%
def predicted_bias(rho):
    return 1.267 * rho

# %%
chooser, own = torch.randn(2, 100_000, 6)
for rho in (0.0, 0.5, 0.9):
    bias = ddqn_target(zero, one, chooser, rho * chooser + np.sqrt(1 - rho**2) * own).mean().item()
    assert abs(bias - predicted_bias(rho)) < 0.02
    print(f"correlation {rho}: predicted {predicted_bias(rho):+.2f}, measured {bias:+.2f}")

# %% [markdown]
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section III.
# - Sutton and Barto: *Reinforcement Learning*, sections 6.5 and 6.7, on Q-learning and the maximisation bias.
# - Zhang and Sutton: *A Deeper Look at Experience Replay*, 2017.
# - van Hasselt, Guez, Silver: *Deep Reinforcement Learning with Double Q-learning*, AAAI 2016.
# - **6 · Training**, where such a network learns to fly.
