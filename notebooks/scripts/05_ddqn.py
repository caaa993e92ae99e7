# %% [markdown]
# # 5 · DDQN
#
# DDQN is short for *double deep Q-network*: Q-learning with a network ("deep"), and with two copies of it
# ("double"). The agent acts by *Q-values*: for each action, the reward to come if it takes this action now and the
# best ones afterwards, later rewards counted less. This notebook goes from a table of 36 such numbers to the paper's network of 2.3 million weights, and measures on the
# way what each part of the method is good for.

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
from uavdh_lite.evaluation import bootstrap_interval, evaluate

torch.set_num_threads(1)  # the networks here are small

# %%
agent = load_agent("manhattan_ddqn")
flights = evaluate(Environment(agent.city), agent, agent.scenario, 500, seed=0, record=True)
expected = agent.q_values(flights.start).amax(1).numpy()
own_rewards, earned = agent.recipe.rewards_at(agent.training["steps"]), 0.0
for flown in reversed(flights.history):
    earned = own_rewards(flown.outcome) + agent.recipe.discount * earned

# %%
figure = Figure(figsize=(5, 4), layout="constrained")
ax = figure.subplots()
ax.plot(earned, expected, ".", alpha=0.5, label="one flight")
ax.axline((0, 0), slope=1, color="black", lw=1, label="earned = expected")
ax.set(xlabel="discounted reward earned in the flight", ylabel="largest Q-value at its start")
ax.legend()
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Learn a table of Q-values, replace it by a network, compare three ways to use a memory, measure the maximisation bias, slow down the targets, turn the temperature, and open the paper's network |
# | **What you'll learn** | Q-learning, function approximation, combined experience replay, double Q-learning, soft targets, the softmax policy |
# | **What you'll need** | Notebooks 3 and 4; means, variances, gradients, the idea of a neural network. 65 minutes to read, 30 seconds to run; 10 minutes of exercises |
#
# Above: 500 test missions of the shipped DDQN agent, what its network expects at the start and what the flight then
# earns. Section 5.5 comes back to it.
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
# belongs to a best action, with the device in these places and in the other seven. First all states; their right
# values come from repeating the target:

# %%
cell, full, device, action = np.indices((12, 2, 12, 3)).reshape(4, -1)
after, left, reward, discount = step(cell, full == 1, action, device, end=11)
ALL = (*tensors(action, reward, discount), *map(torch.from_numpy, (cell, full, device, after, left)))
best, following = torch.zeros(288, 3), (after * 2 + left) * 12 + device
for _ in range(300):  # value iteration
    best = ddqn_target(ALL[1], ALL[2], best[following], best[following]).view(288, 3)

# %% [markdown]
# The network gets how far and on which side the device is, how far the landing zone is, and whether there is data
# left.

# %%
def inputs(cell, full, device):
    return (torch.stack([(device - cell) / 12, cell / 12, full.float()], 1),)

def small_network():
    return nn.Sequential(nn.Linear(3, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))

# %%
def five_places(tau, seed):
    torch.manual_seed(seed)
    network, generator = small_network(), np.random.default_rng(seed)
    learner = DDQN(network, torch.optim.Adam(network.parameters(), 0.01), tau)
    known = np.isin(ALL[5], generator.permutation(12)[:5])
    for _ in range(1000):
        some = generator.choice(np.flatnonzero(known), 64)
        action, reward, discount, cell, full, device, after, left = (x[some] for x in ALL)
        learn_from(learner, inputs(cell, full, device), action, reward, discount, inputs(after, left, device))
    with torch.no_grad():
        q = network(*inputs(*ALL[3:6]))[::3]  # each state is there once for each action
    chosen = best.gather(1, q.argmax(1, keepdim=True)).squeeze(1)
    right, known = (chosen > best.amax(1) - 1e-4).numpy(), known[::3]
    return right[known].mean(), right[~known].mean(), (q - best).abs().mean().item()

# %%
networks = [five_places(tau=0.1, seed=seed) for seed in range(3)]
for known, new, _ in networks:
    print(f"best action in {known:.0%} of the states with known places, {new:.0%} with new ones")
print(f"guessing: {(best > best.amax(1, keepdim=True) - 1e-4).float().mean():.0%}")

# %% [markdown]
# Each of the three seeds knows a different five places. The network is nearly as good in new places as in known ones, where
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
print(*(memory.sample(6, generator, discount=0.95).state.uav_cell for _ in range(3)))

# %% [markdown]
# Step 99 comes first in each minibatch; the others are drawn from the last 50. So all rows *but* the first are a
# minibatch of plain replay, and three learners can be compared: *newest only*, *plain* and *combined*, the last
# two with four rows. Each learns in 20 streets of 8 cells side by side, with 16 rows for each street in one table:
# 20 repetitions. (Rows are drawn from all streets together, so four a street is an average.)
#
# First the memory is filled by flying at random, then learning begins, with actions from the softmax policy of 5.7.
# In two of three worlds the way is closed behind cell 4 while the memory is filled, and nobody gets to the device in
# cell 7; then it opens.

# %%
STREETS, MODES = 20, {"newest only": (1, 0), "plain": (5, 1), "combined": (4, 0)}  # rows drawn, left out

def learn(mode, capacity, filled, end=7, steps=1500, seed=0):
    drawn, out = (STREETS * rows for rows in MODES[mode])
    generator, own, history = np.random.default_rng(seed), 16 * np.arange(STREETS), []
    learner, memory = q_table(320, 0.3, drawn - out), Replay(capacity * STREETS, STREETS, 1)
    cell, full = np.zeros(STREETS, int), np.ones(STREETS, bool)
    for t in range(filled + steps):
        now, action = own + cell + 8 * full, generator.integers(0, 3, STREETS)
        if t >= filled:
            action = draw_actions(softmax_policy(learner.online.weight.detach().T[now], 0.5), generator)
        cell, full, reward, discount = step(cell, full, action, 7, end if t < filled else 7)
        memory.add(stored(now), action, reward, discount == 0, stored(own + cell + 8 * full))
        cell, full = np.where(discount == 0, 0, cell), full | (discount == 0)
        if t >= filled:
            history.append(reward)
            learn_from(learner, *minibatch(memory.sample(drawn, generator, 0.95), out))
    return np.reshape(history, (15, -1, STREETS)).mean(1)

# %%
def minibatch(batch, out):
    now, then = (row(state.uav_cell[out:], 320) for state in (batch.state, batch.next_state))
    return now, *tensors(batch.action[out:], batch.reward[out:], batch.discount[out:]), then

worlds = {"nothing changes": (20_000, 500), "way opens, memory of 500": (500, 5000, 4),
          "way opens, memory of 20,000": (20_000, 5000, 4)}
curves = {world: {mode: learn(mode, *given) for mode in MODES} for world, given in worlds.items()}

# %%
figure, x = Figure(figsize=(10.5, 3.5), layout="constrained"), range(50, 1500, 100)
for ax, (world, by_mode) in zip(figure.subplots(1, 3, sharey=True), curves.items()):
    for (mode, values), style in zip(by_mode.items(), (":", "--", "-")):
        middle, error = values.mean(1), 2 * values.std(1) / np.sqrt(STREETS)
        ax.plot(x, middle, style, label=mode)
        ax.fill_between(x, middle - error, middle + error, alpha=0.2, lw=0)
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
# - *double*: two tables, each the other's judge; a coin decides which of them learns from a step.

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
for (name, values), style in zip(learned.items(), (":", "-.", "-", "--")):
    ax.plot(values.mean(1), style, label=name)
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
# If $\theta$ stood still, $(1-\tau)^k$ of the distance would be left after $k$ updates; with $\tau = 0.005$, half of
# it after 138. So $\bar\theta$ is about the mean of $\theta$ over the last $1/\tau$ updates: calmer, and late. Here
# it is for the Q-value of one action with a noisy reward, whose mean goes from 0 to 2 after 750 updates:

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
for tau in (0.05, 0.005):
    ax.plot(follow(tau)[1], label=f"target, τ = {tau}")
ax.set(xlabel="updates", ylabel="Q-value")
ax.legend()
figure

# %% [markdown]
# Does that help to learn? The network of section 5.2 with three rates, and the mean error of all its Q-values:

# %%
by_rate = {tau: [five_places(tau, seed) for seed in range(3)] for tau in (1.0, 0.003)}
for tau, runs in sorted({**by_rate, 0.1: networks}.items()):
    print(f"τ = {tau:<6} errors after 1000 updates, three seeds: {[round(run[2], 2) for run in runs]}")

# %% [markdown]
# Too fast and too slow are both bad. With $\tau = 1$ the network chases targets that each of its own updates moves;
# with $\tau = 0.003$ they are so late that 1000 updates are too few. The paper's 0.005 belongs to a run of a
# million.
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
    left.bar(ACTIONS, softmax_policy(one_state, temperature)[0].numpy())
    left.set(ylim=(0, 1), ylabel="probability", title=f"one state, β = {temperature:.2g}")
    right.semilogx(betas, taken)
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
# The network, layer by layer:

# %%
from uavdh_lite.agent import build
from uavdh_lite.recipe import PAPER

observation, network = build(PAPER, agent.city)
(maps,), time = observation(flights.start[:1])
print(f"input   {tuple(maps.shape)}, and the flying time")
for layer in network.convolutions[0]:
    maps = layer(maps)
    print(f"{type(layer).__name__:<8}{tuple(maps.shape)}")

# %%
for layer in network.head:
    weights = sum(p.numel() for p in layer.parameters())
    print(f"{type(layer).__name__:<8}{weights:>9,} weights" if weights else type(layer).__name__)
print(f"{sum(p.numel() for p in network.parameters()):,} weights in all")

# %% [markdown]
# Kernels are 5×5; the two convolutions have 8432 weights. Nearly all weights, 94 %, are in the first fully connected
# layer, which takes the 8464 numbers of the flattened maps and the flying time. The last layer gives the six Q-values.
#
# ## Recap
#
# - Q-learning moves Q-values towards $r + \gamma \max Q$ of the next state, whatever policy has flown.
# - A network carries over to new states, if its inputs make them similar to known ones.
# - Replay uses steps several times. Combined replay costs nothing and helps when a large memory is out of date.
# - The maximum of noisy estimates is too high. A slow target removes half of the bias, as a judge most of it.
# - Soft targets are calm and late. The softmax policy explores where gaps are small compared with $\beta$.
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
