# %% [markdown]
# # 5 · DDQN
#
# DDQN is short for *double deep Q-network*: Q-learning with a network ("deep"), and with two copies of it ("double").
# The agent acts by *Q-values*: for each action, the reward to come if it takes this action now and the best ones
# afterwards, later rewards counted less. This notebook goes from a table of 36 such numbers to the paper's network of
# 2.3 million weights, and measures on the way what each part of the method is good for.
#
# The figure below shows what such numbers are worth. Each point is one of 500 test missions of a trained agent. Upwards: the
# largest Q-value at the start, which is what the agent expects. To the right: what the flight then earned. The cells before
# it only draw it; section 5.5 explains them.

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
flights = evaluate(Environment(agent.city), agent, agent.scenario, 500, seed=0)
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
# | **What you'll do** | Learn a table of Q-values, replace it by a network, compare three ways to use a memory, measure the maximisation bias, slow down the targets, explore in two ways, and open the paper's network |
# | **What you'll learn** | Q-learning, function approximation, combined experience replay, double Q-learning, soft targets, the softmax policy and ε-greedy |
# | **What you'll need** | Notebooks 3 and 4; means, variances, gradients, the idea of a neural network. 90 minutes to read, 45 seconds to run; 10 minutes of exercises. Two sittings are better than one: the second begins with 5.4. An appendix, 20 minutes more, asks what the network knows of shadows |
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
    outcome = Outcome(None, uploaded=10 * uploads[:, None], intervened=refused, landed=landed, crashed=False, flew=True)
    return after, full & ~uploads, Rewards()(outcome), 0.95 * ~landed  # next cell, data left?, reward, discount

# %% [markdown]
# A state is the cell and whether the device is still `full`: 12 states with 3 actions. The right Q-value of an action
# is the reward now, plus $\gamma$ times the best Q-value of the next state, with the *discount* $\gamma = 0.95$, or 0
# if the episode is over. That is the *Bellman equation*, $Q(s,a) = \mathbb{E}[r + \gamma \max_{a'} Q(s',a')]$, where $s'$ is the next state, $a'$
# any action there, and $\mathbb{E}$ the mean over chance. (In this street there is none.)
# *Q-learning* turns it into a rule: after each step, move $Q(s,a)$ a part $\alpha$ of the way to the *target* $y$,
#
# $$Q(s,a) \leftarrow Q(s,a) + \alpha\,\big(y - Q(s,a)\big), \qquad y = r + \gamma \max_{a'} Q(s',a')$$
#
# A network learns such values by *gradient descent*. A *loss* says how wrong it is, here $(Q - y)^2$, and each weight moves a
# little against its slope: $w \leftarrow w - \text{rate} \cdot \partial\,\text{loss}/\partial w$. torch computes the slopes.
# `SGD`, *stochastic* gradient descent, makes the move; stochastic, since the loss is that of a few drawn steps. Some words of torch:
#
# | | |
# | --- | --- |
# | a *tensor* | a numpy array that can also compute gradients |
# | `nn.Linear(n, m)` | a matrix of weights that makes `m` weighted sums of `n` inputs |
# | `one_hot(2, 4)` | `[0, 0, 1, 0]` |
# | `x.amax(1)`, `x.gather(1, i)` | the largest number of each row; from each row `k` the number in column `i[k]` |
# | `.detach()`, `no_grad()` | take the numbers, compute no gradients |
#
# So the library needs no code for tables. A table is a linear layer whose input is 1 for the present state and 0 for all
# others. With $y$ taken as a number (it is not differentiated, though it depends on $Q$) the slope of $(Q - y)^2$ is
# $2\,(Q - y)$, so gradient descent at the rate $\alpha/2$ is the rule above.
#
# `DDQN` keeps two copies of the Q-values. The *online* copy learns. The *target* copy is named after its use: it helps to
# compute the target $y$, and moves towards the online copy by a share $\tau$ after each update. Sections 5.4 and 5.6 say why.
# Until then $\tau$ is 1 in the tables: both copies are equal, and you may forget the second one.

# %%
from uavdh_lite.ddqn import DDQN, ddqn_target, draw_actions, softmax_policy
from uavdh_lite.replay import Batch

def row(number, rows):  # a tuple, since a network may have several inputs
    return (nn.functional.one_hot(torch.tensor(number).long(), rows).float(),)

def q_table(rows, alpha, batch=1, tau=1.0, actions=3):
    table = nn.Linear(rows, actions, bias=False)
    nn.init.zeros_(table.weight)
    rate = alpha * batch / 2  # the loss is the mean over the batch
    return DDQN(as_it_is, table, torch.optim.SGD(table.parameters(), rate), tau)

def tensors(action, reward, discount):
    return torch.as_tensor(action), *(torch.tensor(x, dtype=torch.float32) for x in (reward, discount))

def as_it_is(state):  # what the table sees of a state: here states are its inputs already
    return state

# %% [markdown]
# To learn from some steps takes two lines: the targets $y$, then a move towards them.

# %%
def learn_from(learner, now, action, reward, discount, then):
    learner.update(Batch(now, action.numpy(), reward.numpy(), discount.numpy(), then))

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
# nothing. (No flight comes to cell 5 and still has the data waiting, but random states do. There every action
# but "west" collects the data.) Check one: "east" in cell 4 earns 10 − 0.2 now, then $0.95 \cdot (-0.90)$, the best of cell 5 without data,
# together 8.94. Afterwards "west" is best until cell 0, and there "land". Nobody flew like that: states and actions
# were random. The target has the maximum in it and not the action flown next, so any steps will do, as long as every
# action is tried in every state again and again. Such learning is called *off-policy*, and it allows learning from a
# memory.
#
# Is the table right? It is if the Bellman equation holds in all 36 places: with $\gamma < 1$ it has only one
# solution. The library's target function computes the right side, if it gets the same Q-values twice, as online and as target:

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

# %%
print(f"γ = 0.95, counted now: a crash, −150, 40 steps ahead {-150 * 0.95**40:.1f},")
print(f"a hundred steps of −0.2 {-0.2 * sum(0.95**k for k in range(100)):.2f}, steps without end {-0.2 / (1 - 0.95):.2f}")

# %% [markdown]
# The *horizon* $1/(1-\gamma)$ is how far ahead an agent looks, in round numbers: what lies three horizons ahead counts
# less than 5 %. A device 20 steps away counts a third of its data. The crash is felt only because 150 is so much: at 40
# steps it has faded to 19. A detour fades, too. A hundred steps of −0.2 cost 20 if you just add them up, but
# $0.2\,(1-0.95^{100})/(1-0.95)=3.98$ discounted, and no detour can cost more than $0.2/0.05 = 4$. So the far crash
# weighs five times the longest of all detours.
#
# Notebook 8 judges agents by the data that they bring home, and there a late unit counts like an early one. A $\gamma$
# of 0.99 would be closer to that. But then values are sums of more uncertain terms, and harder to learn.
#
# ### Where an episode ends
#
# After a landing nothing follows, so there $y = r$; in `step` above the discount is 0. If you forget that, the target
# of "land" in cell 0 with the data still waiting is $0.95 \cdot 6.54 = 6.21$ instead of 0, as if the flight went on
# after the landing, and "land" is no longer far from the best action there.
#
# ## 5.2 From the table to a function
#
# How many rows would a table need for the paper's city, with five devices that hold up to 20 data units each (whole numbers
# only)?

# %%
from math import comb

cells, places = int((~agent.city.no_fly).sum()), comb(len(agent.city.device_cells), 5)
print(f"{cells} cells × 70 times × {places:.1e} places × 21⁵ amounts = {cells * 70 * places * 21**5:.0e} rows")

# %% [markdown]
# Nobody visits them all, and a row of a table that is never visited is never changed. A network treats states alike
# whose inputs are alike. A test: a street of 12 cells, the device in any of them. A network learns from five of its
# places. In what share of the states is the action with its largest Q-value a best one: with the device in one of
# these five places, and in one of the other seven? First every step that is possible: 12 cells, data waiting or not, 12 places of the device, 3 actions.

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
# There are 12 · 2 · 12 = 288 states (cell, data, device), numbered in this order, with three steps each, one for each action.
# The right values of all of them come from repeating the target until nothing changes any more. This is called
# *value iteration*:

# %%
best, following = torch.zeros(288, 3), (after * 2 + left) * 12 + device  # `following`: the number of the next state
for _ in range(300):
    best = ddqn_target(every_step.reward, every_step.discount, best[following], best[following]).view(288, 3)

# %% [markdown]
# The network gets how far and on which side the device is, how far the landing zone is, and whether there is data left.
# For comparison, another one gets the two cells by their numbers, *one-hot*: a 1 for the cell and zeros for all others,
# so that one place says nothing about the next. Between two linear layers stands a *ReLU*, which replaces every
# negative number by 0: without such a bend, two linear layers would be no more than one. After the last layer there is none, since
# Q-values may be negative.

# %%
def relative(cell, full, device):
    return (torch.stack([(device - cell) / 12, cell / 12, full.float()], 1),)

def one_hot(cell, full, device):
    places = [nn.functional.one_hot(place, 12) for place in (cell, device)]
    return (torch.cat([*places, full[:, None]], 1).float(),)

def small_network(numbers):
    return nn.Sequential(nn.Linear(numbers, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))

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
def five_places(inputs, tau, seed):
    torch.manual_seed(seed)
    network, generator = small_network(3 if inputs is relative else 25), np.random.default_rng(seed)
    learner = DDQN(as_it_is, network, torch.optim.Adam(network.parameters(), 0.01), tau)
    places = generator.permutation(12)[:5]
    known = np.flatnonzero(np.isin(every_step.device, places))
    for _ in range(1000):
        learn_steps(learner, generator.choice(known, 64), inputs)
    right, error = right_and_error(network, inputs)
    at_known = np.isin(every_state.device, places)
    return right[at_known].mean(), right[~at_known].mean(), float(error.mean())

# %%
networks = {inputs: [five_places(inputs, tau=0.1, seed=seed) for seed in range(3)] for inputs in (relative, one_hot)}
for inputs, runs in networks.items():
    for known, new, _ in runs:
        print(f"{inputs.__name__:<9} best action in {known:4.0%} of the states with known places, {new:.0%} with new ones")
print(f"guessing: {(best > best.amax(1, keepdim=True) - 1e-4).float().mean():.0%}")

# %% [markdown]
# Each of the three seeds knows a different five places. With relative inputs the network is nearly as good in new
# places as in known ones, where a table would have to guess, one in three. With one-hot inputs it knows the five by
# heart, and is wrong in many of the new states, here in about a quarter. So inputs decide which states are alike to a network. The
# centred map of notebook 4 makes them relative, too. The price: an update of a table changes one value, an update of a
# network all of them, and with them the next targets. Much of what follows is there to keep that in check. (`Adam` is
# gradient descent with a step size of its own for each weight.)
#
# ## 5.3 Replay, and combined replay
#
# Consecutive steps of a flight resemble each other. *Experience replay* keeps the last steps in a memory and learns
# from a *minibatch* drawn from it at random: each step is used several times, mixed with others. In *combined*
# experience replay (Zhang and Sutton, 2017), which the paper uses, the newest step is always in the minibatch. The
# library's `sample` does that. To see which steps it draws, let each state hold only its number, in the UAV's place:

# %%
from uavdh_lite.replay import Replay

def stored(number):
    nothing = np.zeros((len(number), 1))
    # Its time goes on, so that no episode ends
    return State(number, number + 1, nothing, nothing, nothing, number < 0, 0 * number)

# %%
memory = Replay(capacity=50, environments=1, max_devices=1, discount=0.95)
for t in np.arange(100):
    memory.add(stored(t[None]), action=0, reward=0, next_state=stored(t[None] + 1))
minibatches = [memory.sample(6, generator).state.uav_cell for _ in range(3)]

# %%
figure = Figure(figsize=(8, 2.1), layout="constrained")
ax = figure.subplots()
ax.axvspan(-0.5, 49.5, color="0.85", label="forgotten")
ax.axvspan(49.5, 99.5, color=BLUE, alpha=0.15, label="in the memory")
for k, numbers in enumerate(minibatches):
    ax.plot(numbers[1:], [k] * 5, "o", color=BLUE, label="drawn at random" if k == 0 else None)
    ax.plot(numbers[0], k, "D", color=VERMILION, label="the newest" if k == 0 else None)
ax.set(xlabel="number of the step", xlim=(-0.5, 100.5), ylim=(2.5, -0.5))
ax.set_yticks(range(3), [f"minibatch {k + 1}" for k in range(3)])
ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small")
print("minibatch 1:", *minibatches[0])
figure

# %% [markdown]
# The memory holds 50 of 100 steps. The newest, 99, is in each minibatch, and the first in it; the others are drawn from
# the last 50. Three ways to choose the steps to learn from can now be compared, with at most four of them in a minibatch:

# %%
MODES = {
    "newest only": lambda newest, drawn: newest,
    "plain": lambda newest, drawn: drawn,
    "combined": lambda newest, drawn: np.concatenate([newest, drawn[1:]]),
}

# %% [markdown]
# First the memory is *prefilled* by flying at random, as in the paper, where that is half of the memory. Otherwise the
# first minibatches would be drawn from a few steps of one flight. They would be nearly the same, and the network would
# memorise them. And random flights try every action, also those that an untrained policy never takes. Then learning
# begins, with actions from the softmax policy, which draws actions with larger Q-values more often (5.7). (While all Q-values are 0, it draws at random.) In the second of
# two worlds the way is closed behind cell 4 while the memory is filled, and nobody gets to the device in cell 7; then it
# opens.
#
# Twenty streets of eight cells are flown at once, so that the means have an interval. Each has its own table and its own
# memory: the last axis of every array is the street. In each round every street flies one step and stores it. After the first
# `filled` rounds it also learns: `choose` names the numbers of the stored steps to learn from. The rule is that of 5.1. (You may
# skip the code.)

# %%
STREETS = np.arange(20)

def learn_step(q, cell, full, action, reward, discount, after, left):
    cell, full, action, after, left = (x.astype(int) for x in (cell, full, action, after, left))
    y = reward + discount * q[STREETS, after, left].max(1)
    q[STREETS, cell, full, action] += 0.3 * (y - q[STREETS, cell, full, action])

# %%
def learn(choose, filled, end=7, steps=1500, seed=0):
    generator, q, rewards = np.random.default_rng(seed), np.zeros((20, 8, 2, 3)), []
    cell, full, memory = np.zeros(20, int), np.ones(20, int), np.zeros((filled + steps, 7, 20))
    for t in range(filled + steps):
        action = draw_actions(softmax_policy(torch.from_numpy(q[STREETS, cell, full]), 0.5), generator)
        after, left, reward, discount = step(cell, full == 1, action, 7, end if t < filled else 7)
        memory[t] = cell, full, action, reward, discount, after, left
        cell, full = np.where(discount, (after, left), [[0], [1]])  # a new flight after a landing
        if t >= filled:
            rewards.append(reward)
            for number in choose(np.full((1, 20), t), generator.integers(0, t + 1, (4, 20))):
                learn_step(q, *memory[number, :, STREETS].T)
    return np.reshape(rewards, (15, 100, 20)).mean(1)  # mean reward of each hundred steps

# %%
worlds = {"nothing changes": {"filled": 500}, "the way opens": {"filled": 5000, "end": 4}}
curves = {world: {mode: learn(choose, **given) for mode, choose in MODES.items()} for world, given in worlds.items()}

# %%
figure, x = Figure(figsize=(9, 3.5), layout="constrained"), range(50, 1500, 100)
for ax, (world, by_mode) in zip(figure.subplots(1, 2, sharey=True), curves.items()):
    for (mode, values), style, colour in zip(by_mode.items(), (":", "--", "-"), (GREEN, VERMILION, BLUE)):
        middle, error = values.mean(1), 2 * values.std(1) / np.sqrt(len(STREETS))
        ax.plot(x, middle, style, color=colour, label=mode)
        ax.fill_between(x, middle - error, middle + error, color=colour, alpha=0.2, lw=0)
        print(f"{world:<17}{mode:<12}first 500 steps {values[:5].mean():+.2f}, last 500 {values[-5:].mean():+.2f}")
    ax.set(title=world, xlabel="steps of learning", ylabel="reward per step")
figure.axes[0].legend()
figure

# %% [markdown]
# Lines are means over the 20 streets, bands two standard errors to either side. (The *standard error* is by how much a mean
# of 20 typically misses: the standard deviation of the 20, divided by $\sqrt{20}$.)
#
# - **Nothing changes.** Replay needs less than half as many steps as learning from the newest one alone (and learns four times a step,
#   not once). Combined is at most a little ahead of plain, and at the end they are alike.
# - **The way opens.** Of four steps drawn from more than 5000 steps, on average less than one is new, and the old ones
#   say that the street ends in cell 4. Plain replay has not recovered after 1500 steps, combined replay in part. In the
#   last 500 steps, learning without a memory is ahead of both.
#
# What to take home: replay learns more from each step, unless the memory is full of a past that is over. Zhang and Sutton
# propose combined replay for a memory that is too large. The paper's
# holds 50,000 steps, and an update draws 128. With *plain* replay and one update for each step, a step is drawn 128 times on average before it is forgotten, and
# waits $50{,}000/128 = 390$ updates, on average, for the first time. With *combined* replay it is in the very next
# minibatch. In a run of a million steps 390 are few, so expect little. It costs one place of 128. (With N environments
# side by side, the library puts in the newest N. In recipe `lite` these are 32 of 128, a quarter of the minibatch.)
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
# the action, and the bias *upwards* is gone. (If one action really is better, the chooser sometimes takes another by
# mistake. The judge then gives the lower value of that one, so double estimates are a little too low on average.) In the paper (eq. 10) the *online* network, with weights
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
# - *slow target*: a second table, which after each update goes $\tau = 0.5\,\%$ of the way to the first (5.6). It is asked
#   both questions: which action, and what it is worth.
# - *DDQN*: the table chooses, the slow one judges.
# - *double*: two tables, each the other's judge; a coin decides which of them learns from a step. (In the library the
#   judge is a learner's `target`. So each learner gets the other's table as its target, with $\tau = 0$, so that
#   nothing else moves it.)

# %%
N = 100
A, B = row(np.arange(N), 2 * N)[0], row(N + np.arange(N), 2 * N)[0]

def flying_on(*learners, chooser="online", steps=1500, seed=0):
    generator, values, after = np.random.default_rng(seed), [], torch.cat([B, B])
    for _ in range(steps):
        action = np.r_[np.full(N, EAST), generator.integers(0, 6, N)]
        reward = np.r_[np.zeros(N), generator.normal(-0.2, 1, N)]
        action, reward, discount = tensors(action, reward, np.repeat([0.95, 0], N))
        learner = learners[generator.integers(len(learners))]
        chooses, judges = getattr(learner, chooser)(after).detach(), learner.target(after).detach()
        now = Batch((torch.cat([A, B]),), action.numpy(), reward.numpy(), discount.numpy(), None)
        learner.fit(now, ddqn_target(reward, discount, chooses, judges))
        values.append(learners[0].online.weight[EAST, :N].tolist())
    return np.array(values)

# %%
single, slow, ddqn, first, second = (q_table(2 * N, 0.1, 2 * N, tau, 6) for tau in (1.0, 0.005, 0.005, 0.0, 0.0))
first.target, second.target = second.online, first.online  # each table judges for the other
learned = {"single": flying_on(single), "slow target": flying_on(slow, chooser="target"),
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
# maximum is less too high: here that alone removes half of the bias. If the table chooses and the slow one only judges,
# another quarter goes; not all, since the judge is an older copy of the same table, and their errors are related. Two
# tables get it right, but need a second learner. (How much each removes depends on $\alpha$, $\tau$ and the noise.)
#
# ## 5.5 What the DDQN agent expects, and what it earns
#
# An agent with such a bias expects more than it gets. In the figure at the top each point is a mission: the largest
# Q-value at its start, and the sum of its rewards, that of step $t$ times $\gamma^t$. The rewards are those of the
# moment in its training at which this agent was kept. They are not quite the paper's:

# %%
print(own_rewards)
for name, values in (("expected", expected), ("earned", earned), ("difference", expected - earned)):
    print(f"{name:<11}mean {{:+.2f}}, 95 % from {{:+.2f}} to {{:+.2f}}".format(*bootstrap_interval(values)))
print(f"standard deviation of the difference: {(expected - earned).std():.2f}")
assert abs((expected - earned).mean()) < 0.05 * earned.mean()

# %% [markdown]
# On average the agent expects a little less than it earns, here by less than one percent. (With other missions it is up to
# two. Notebook 8 says how the intervals are made.) Single flights differ by more, since the network is not exact. So the
# value of the action that it *flies* at the start has no bias upwards. Of the actions that it does not fly this says nothing: notebook 9 finds one, `land`, valued far too
# high. Nor does it show that double estimation is the reason: that would take an agent trained without.
#
# ## 5.6 Soft targets
#
# After each update the target network moves a little towards the online network:
#
# $$\bar\theta \leftarrow (1 - \tau)\,\bar\theta + \tau\,\theta$$
#
# With an online weight of 4 and a target weight of 2, one update moves the target by $\tau \cdot 2$. While the online
# weight stays where it is, $(1-\tau)^k$ of the distance is left after $k$ updates. The *half-life* is the $k$ after
# which that is one half:

# %%
from uavdh_lite.ddqn import soft_update

def weight(value):
    layer = nn.Linear(1, 1, bias=False)
    nn.init.constant_(layer.weight, value)
    return layer

for tau in (0.05, 0.005):
    target = weight(2.0)
    soft_update(target, weight(4.0), tau)
    half_life = np.log(0.5) / np.log(1 - tau)
    print(f"τ = {tau:<5}  2 becomes {target.weight.item():.2f}, half-life {half_life:.0f} updates")

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
# Does that help to learn? The network of section 5.2 with three rates, and the mean error of all its Q-values, for six
# seeds:

# %%
by_rate = {tau: np.array([five_places(relative, tau, seed)[2] for seed in range(6)]) for tau in (0.003, 0.1, 1.0)}
for tau, errors in by_rate.items():
    print(f"τ = {tau:<6} mean error {errors.mean():.2f}, six seeds from {errors.min():.2f} to {errors.max():.2f}")

# %% [markdown]
# With $\tau = 0.003$ the targets are so late that 1000 updates are too few, in every seed. (The paper's 0.005 belongs to
# a run of a million.) With $\tau = 1$ the network chases targets that each of its own updates moves: on average that is
# worse than $\tau = 0.1$; single seeds may say otherwise.
#
# ## 5.7 Exploring: the softmax policy and its temperature
#
# An agent that always takes the action that seems best never finds out that another one is better. In training it draws
# its actions, good ones more often (eq. 12):
#
# $$\pi(a \mid s) = \frac{\exp(Q(s,a)/\beta)}{\sum_{a'} \exp(Q(s,a')/\beta)}$$
#
# Two actions' probabilities have the ratio $\exp\big((Q(s,a) - Q(s,a'))/\beta\big)$: what counts is the *gap*
# between Q-values in units of $\beta$. This also shows how to compute the formula, which fails if it is typed in as it stands: at
# $\beta = 0.1$ a Q-value of 100 asks for $e^{1000}$, more than a floating-point number holds. Subtract the largest
# Q-value first. The gaps stay, and no exponent is above 0. `softmax_policy` does that, too, inside torch:

# %%
q = np.array([100.0, 99.9, 90.0])

def typed(q):
    weights = np.exp(q / 0.1)
    return weights / weights.sum()

with np.errstate(over="ignore", invalid="ignore"):
    print("as it stands      ", typed(q))
print("largest subtracted", typed(q - q.max()).round(3))
print("softmax_policy    ", softmax_policy(torch.tensor(q[None]), 0.1)[0].numpy().round(3))

# %%
Quiz("cold_policy")

# %% [markdown]
# The DDQN agent's policy at several temperatures, in many states along its flights, and in the one among them with the
# median gap between the best two actions:

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
# Cold, the policy is *greedy*: it takes the best action. Hot, it is uniform, one in six for each action. The paper's
# $\beta = 0.1$ explores only among actions that seem nearly equal. That suffices when Q-values are about right. While
# they are still wrong it may not, so the recipe `lite` starts at 2 and cools to 0.1. In tests the agent is greedy: we
# want to know what it has learned, not what exploring costs it.
#
# $\beta$ is in units of reward. Multiply all rewards by ten, and so all Q-values, and the same $\beta$ hardly explores:

# %%
q = torch.tensor([[1.0, 0.9, 0.5]])
for scale in (1, 10):
    print(f"rewards × {scale:<3}", *(f"{share:7.2%}" for share in softmax_policy(scale * q, 0.1)[0]))

# %% [markdown]
# Most deep Q-learning explores in another way, *ε-greedy*: with probability $\varepsilon$ it takes an action at random,
# each with the same chance, otherwise the best. We give it an $\varepsilon$ with which it takes the best action as
# often as the softmax at $\beta = 0.1$. What does a step of exploring cost, in the agent's own Q-values?

# %%
soft = softmax_policy(many, 0.1)
epsilon = 6 / 5 * (1 - soft.amax(1).mean())  # one random action in six is the best one
greedy = nn.functional.one_hot(many.argmax(1), 6)
loss = many.amax(1, keepdim=True) - many  # what each action gives away
spare = states.time_left - agent.city.landing_distance.ravel()[states.uav_cell]

# %%
for name, chosen in (("all states", spare < 99), ("at most 3 steps to spare", spare <= 3)):
    costs = [(policy * loss)[chosen].sum(1).mean() for policy in (soft, (1 - epsilon) * greedy + epsilon / 6)]
    print(f"{name:<25}{chosen.sum():>5}: softmax {costs[0]:.3f}, ε-greedy {costs[1]:.3f} (ε = {epsilon:.2f})")

# %% [markdown]
# The two deviate equally often. But ε-greedy takes a costly action, such as one into the no-fly zone, or away from home
# with little time left, with the same chance as a harmless one, and everywhere. The softmax hardly takes it, once the
# Q-values say what it costs. In return, the softmax does not explore where *wrong* Q-values lie far apart; ε-greedy
# does.
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
from uavdh_lite.plotting import draw_layers
from uavdh_lite.recipe import PAPER

observation = PAPER.observation_for(agent.environment)
network = PAPER.network_for(observation)
layers = [layer for layer in network.modules() if isinstance(layer, (nn.Conv2d, nn.Flatten, nn.Linear))]
shapes = []
hooks = [layer.register_forward_hook(lambda layer, given, out: shapes.append(tuple(out.shape[1:]))) for layer in layers]
network(*observation(flights.start[:1]))
for hook in hooks:
    hook.remove()

# %%
kinds = {nn.Conv2d: ("convolution", BLUE), nn.Flatten: ("flattened,\n+ the time", GREEN), nn.Linear: ("fully\nconnected", GREEN)}
names = [kinds[type(layer)] for layer in layers[:-1]] + [("Q-values", VERMILION)]
figure = Figure(figsize=(8, 2.9), layout="constrained")
draw_layers(figure.subplots(), [("map", observation.map_shape, ORANGE),
                                *((name, shape, colour) for (name, colour), shape in zip(names, shapes))])
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
# ## Recap
#
# - Q-learning moves Q-values towards $r + \gamma \max Q$ of the next state, whatever policy has flown.
# - A network carries over to new states, if its inputs make them similar to known ones.
# - Replay uses steps several times. Combined replay costs little and helps when a large memory is out of date. A random
#   policy fills the memory before learning begins.
# - The maximum of noisy estimates is too high. A slow target, and more so a slow target as judge, removes part of the
#   bias.
# - Soft targets are calm and late.
# - The softmax policy explores where gaps are small compared with $\beta$; ε-greedy explores alike everywhere.
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
# ## Appendix: what the network knows of shadows
#
# A building between the UAV and a device takes most of the signal (notebook 1). No input says so: the network sees
# buildings and devices, and learns from rewards alone. Has it found out? First a *probe*: fit a linear model that reads
# from the last hidden layer, the 256 numbers from which the Q-values are computed, whether the UAV sees the device. If the probe is right about states that it was not fitted to,
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
    state = agent.scenario.sample_anywhere(environment, count, generator, spare_time=5)
    data = np.zeros_like(state.data_left)
    data[:, 0] = 20
    return replace(state, data_initial=data, data_left=data)

def to_device(state):  # rows south and columns east, from the UAV to the device
    row, col = np.divmod(state.device_cells[:, 0].astype(int), city.size)
    uav_row, uav_col = np.divmod(state.uav_cell.astype(int), city.size)
    return row - uav_row, col - uav_col

# %%
state = one_device(12_000)
seen = environment.sight[0][state.device_cells[:, 0], state.uav_cell]
distance = np.hypot(*to_device(state))
pairs = []
for d in np.unique(distance):
    with_sight, without = np.flatnonzero((distance == d) & seen), np.flatnonzero((distance == d) & ~seen)
    pairs += list(zip(with_sight, without))  # as many of one as of the other
chosen = np.ravel(pairs)
state, seen, distance = state[chosen], seen[chosen], distance[chosen]

# %% [markdown]
# The probe is fitted where the device stands in a cell with an even number, and tested where the number is odd. So it has met
# the neighbours of those places, but not the places. Next to the trained network it gets the distance alone, and a network of
# the same shape without any training:

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
untrained = agent.recipe.network_for(agent.observation)
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
# the UAV, in states where there are at least as many. Only the layer "buildings" changes; where one may fly stays as it is.

# %%
state = one_device(20_000)
state = replace(state, time_left=(city.landing_distance.ravel()[state.uav_cell] + 6).astype(np.int16))
hidden = ~environment.sight[0][state.device_cells[:, 0], state.uav_cell]
state = state[hidden & (np.hypot(*to_device(state)) <= 5)]

# %%
def between(state):
    """The cells of the map between the UAV, in its middle, and the device."""
    cells = np.arange(1 - city.size, city.size)
    down, right = (offset[:, None] for offset in to_device(state))
    rows, cols = ((np.minimum(d, 0) <= cells) & (cells <= np.maximum(d, 0)) for d in (down, right))
    return torch.from_numpy(rows[:, :, None] & cols[:, None, :])

# %%
maps, time = agent.observation(state)
in_between = between(state)
opposite = in_between.flip(1, 2)
enough = (maps[:, 2] * opposite).sum((1, 2)) >= (maps[:, 2] * in_between).sum((1, 2))

# %%
@torch.no_grad()
def value(removed):
    edited = maps[enough].clone()
    edited[:, 2] *= ~removed[enough]
    return agent.network(edited, time[enough]).amax(1).numpy()

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
# little, whichever buildings are wiped out. It goes up more if it is one in the way. So the network has learned from
# rewards that buildings *between* it and a device cost something, and it looks at them.
#
# It is no ray tracer: the gain is small next to the value, and in some states it is the other way round. And a city with a
# missing building is new to this network, so such a test shows what it looks at, not how well it would fly there.

# %% [markdown]
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section III.
# - Sutton and Barto: *Reinforcement Learning*, sections 6.5 and 6.7, on Q-learning and the maximisation bias.
# - Zhang and Sutton: *A Deeper Look at Experience Replay*, 2017.
# - van Hasselt, Guez, Silver: *Deep Reinforcement Learning with Double Q-learning*, AAAI 2016.
# - **6 · Training**, where such a network learns to fly.
