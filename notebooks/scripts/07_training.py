# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 7 · Your agent learns to fly
#
# This is the network of notebook 5 before it has learned anything. Each grey arrow is the action
# that it thinks best in that cell. **After about a minute of training it will collect nearly
# everything and come home, by a loop that you have written.**

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
from uavdh_lite.course.live import Live
from uavdh_lite.environment import Environment, Rewards, State
from uavdh_lite.one_file import VILLAGE, CentredMap, QNetwork  # of notebooks 4 and 5
from uavdh_lite.one_file import Settings, double_target, softmax_policy  # and of notebook 6

torch.set_num_threads(1)  # quickest for a small network
environment = Environment(load_city("village"))
see, missions = CentredMap(environment), VILLAGE.sample(environment, 6, np.random.default_rng(3))

def q_values_of(network):
    def q_values(state):
        with torch.no_grad():
            return network(*see(state)).numpy()
    return q_values

torch.manual_seed(2)
figure, ax = plt.subplots(figsize=(4, 4.2), layout="constrained")
Live(Settings(), environment, missions).draw_mission(ax, q_values_of(QNetwork(see.side)));

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Write memory, update and loop, train your agent live, and turn knobs while it learns |
# | **What you'll learn** | The training loop, validation, what the curves say, five ways to spoil it |
# | **What you'll need** | Notebooks 3 to 6. 40 minutes to read, 60 seconds to run; 60 minutes of exercises |
#
# The village has 8 × 8 cells and one or two devices, and the UAV has 20 to 35 units of time. From
# the earlier notebooks come the centred map (`see`), `QNetwork`, `double_target` and
# `softmax_policy`, which now also draws the action; `VILLAGE.sample` draws missions.
#
# ## 7.1 The memory
#
# Sixteen UAVs fly side by side. Their steps go into a *ring*: when it is full, the newest steps
# take the place of the oldest. It stores states, a few numbers each; maps are made anew for each
# minibatch. If the steps are numbered from the newest one back, a minibatch takes 0 to 15, the
# newest of each UAV (**combined replay**, III-B), and draws the others from all older ones:
#
# ```text
#   ring   │ … │ 32 … 47 │ 16 … 31 │ 0 … 15 │ oldest │ …
#                                           ▲ the next 16 steps go here
# ```
#
# With 64 drawn for 16 new ones, a step is learned from about four times on average, however large
# the memory is.

# %%
class Memory:
    def __init__(self, capacity, uavs):
        self.capacity, self.uavs, self.stored, self.ring = capacity, uavs, 0, []

    def __len__(self):
        return min(self.stored, self.capacity)

    def add(self, state, action, reward, after):
        step = [*vars(state).values(), action, reward, *vars(after).values()]
        if not self.ring:
            self.ring = [np.zeros((self.capacity, *part.shape[1:]), part.dtype) for part in step]
        place = self.stored % self.capacity
        for ring, part in zip(self.ring, step):
            ring[place : place + self.uavs] = part
        self.stored += self.uavs

    def sample(self, count, generator):
        others = generator.choice(len(self) - self.uavs, count - self.uavs, replace=False)
        numbers = np.r_[: self.uavs, self.uavs + others]  # 0 to 15, and those drawn
        ago, uav = np.divmod(numbers, self.uavs)
        places = (self.stored - (ago + 1) * self.uavs + uav) % self.capacity
        drawn = [ring[places] for ring in self.ring]
        state, (action, reward), after = drawn[:7], drawn[7:9], drawn[9:]  # a state has 7 fields
        return State(*state), torch.tensor(action), torch.tensor(reward), State(*after)

# %% [markdown]
# Try it: 125 random steps of the 16 UAVs. `after` is stored as the step left it, *before* a new
# mission takes the place of one that has ended. Otherwise no step in the memory would end a flight,
# and landing would seem to lead to a new mission.

# %% tags=["hide-input"]
def random_steps(memory, rounds, generator):
    state = VILLAGE.sample(environment, 16, generator)
    for _ in range(rounds):
        action = generator.integers(0, 6, 16)
        after, outcome = environment.step(state, action, generator)
        memory.add(state, action, Rewards(crash=-5.0)(outcome), after)
        ended = np.flatnonzero(after.ended)
        state = after.with_rows(ended, VILLAGE.sample(environment, len(ended), generator))
    return memory

memory = random_steps(Memory(40_000, 16), 125, np.random.default_rng(0))
state, action, reward, after = memory.sample(64, np.random.default_rng(0))
print(f"{len(memory):,} steps; of 64 drawn, {after.ended.sum()} end a flight; rewards", reward[:4])

# %% [markdown]
# ## 7.2 One update
#
# The target $y$ of the double network (eq. 8), a step downhill on the squared error (eq. 7), and
# the target network follows:

# %%
def update(online, target, optimiser, batch, settings):
    state, action, reward, after = batch
    with torch.no_grad():
        ended, seen = torch.tensor(after.ended), see(after)
        y = double_target(reward, ended, settings.discount, online(*seen), target(*seen))
    q = online(*see(state)).gather(1, action[:, None])[:, 0]
    loss = nn.functional.mse_loss(q, y)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        for old, new in zip(target.parameters(), online.parameters()):
            old.lerp_(new, settings.target_rate)
    return loss.item()

def beginners(learning_rate=2e-3):
    torch.manual_seed(0)
    online = QNetwork(see.side)
    optimiser = torch.optim.Adam(
        online.parameters(), learning_rate, eps=1e-7, amsgrad=True, fused=True)
    return online, copy.deepcopy(online), optimiser

# %% [markdown]
# Without `ended` every flight would seem to go on after its last step, and landing would seem to be
# no more than a pause. (Adam's `eps` and `amsgrad` are those of the authors' code.)
#
# ## 7.3 How good is it?
#
# In a **validation** the agent flies missions that are always the same and always takes the action
# with the highest Q-value (eq. 9); in training it explores, and missions are drawn anew. Watch
# *collected and landed*, the share of the data that came home.

# %%
def evaluate(network, missions=100):
    generator = np.random.default_rng(7)
    state = VILLAGE.sample(environment, missions, generator)
    while not state.ended.all():
        best = q_values_of(network)(state).argmax(axis=1)
        state, _ = environment.step(state, best, generator)
    return state.landed.mean(), (state.collected * state.landed).mean()

print("untrained: landed {:.0%}, collected and landed {:.0%}".format(*evaluate(beginners()[0])))

# %% [markdown]
# Three sets of missions are kept apart: those of training, those of validation, by which one
# chooses which version of an agent to keep, and those of the *test*, for what one reports, because
# the best of many validations is partly luck, like the maximum in 6.5.
#
# ## 7.4 The loop
#
# The agent makes its own data: a bad agent learns from bad flights.
#
# ```text
#   act (eq. 10) ──▶ step ──▶ remember ──▶ draw a minibatch ──▶ update ──┐
#    ▲                                                                   │
#    └──────────────── the network now knows a little more ◀────────────┘
# ```
#
# What the knobs turn is in `settings`, which each round reads anew, so they act at once (only a
# memory that was made smaller stays small). One of the departures from the authors' code matters
# a lot: **the price of a crash** grows from 5 to 20, whereas there it is 150 (by default).

# %%
async def training(settings, live, seed=0):
    generator = np.random.default_rng(seed)
    online, target, optimiser = beginners()
    memory = Memory(settings.memory, settings.uavs)
    state = VILLAGE.sample(environment, settings.uavs, generator)
    for step in range(0, settings.steps, settings.uavs):
        learning = step >= settings.prefill
        # Act, at random at first
        action = generator.integers(0, 6, settings.uavs)
        if learning:
            q = torch.from_numpy(q_values_of(online)(state))
            action = softmax_policy(q, settings.temperature, generator)
        # Step, all at once
        after, outcome = environment.step(state, action, generator)
        reward = Rewards(crash=-settings.crash(step))(outcome)
        # Remember, and begin new missions where one has ended
        memory.capacity = min(memory.capacity, settings.memory)  # what it forgot is gone
        memory.add(state, action, reward, after)
        ended = np.flatnonzero(after.ended)
        state = after.with_rows(ended, VILLAGE.sample(environment, len(ended), generator))
        # Learn
        if learning:
            optimiser.param_groups[0]["lr"] = settings.learning_rate * (1 - step / settings.steps)
            update(online, target, optimiser, memory.sample(settings.batch, generator), settings)
        # Show
        shares = evaluate(online) if (step + settings.uavs) % 6000 == 0 else ()
        await live.show(step + settings.uavs, q_values_of(online), *shares)
    return online

# %%
settings = Settings(steps=72_000)
print(settings)
live = Live(settings, environment, missions)
yours = await training(settings, live)

# %% [markdown]
# The left side is the curve: each point is 100 missions without exploring. The right side is one
# mission, flown by the agent of that moment; the grey marks show what it would do at its start in
# each free cell.
#
# It is *your agent*, and it comes along to notebook 9:

# %%
from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import save_agent
from uavdh_lite.evaluation import fly
from uavdh_lite.observation import Observation
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.recipe import SMALL

agent = Agent(yours, Observation(environment), SMALL, VILLAGE, {"made in": "notebook 7"})
save_agent("my_agent.safetensors", agent)

generator = np.random.default_rng(7)
rule = fly(environment, Greedy(environment), VILLAGE.sample(environment, 100, generator), generator)
print(f"greedy brings home {(rule.end.collected * rule.end.landed).mean():.0%}")

# %%
flights = fly(environment, agent, missions, np.random.default_rng(3))
play(environment, flights.trajectory(0))

# %% [markdown]
# ## 7.5 Predict, turn, see
#
# Run the training cell again, and turn one knob at a time, the sooner the better. (Knobs act while
# a cell runs if the kernel passes their messages on, as ipykernel 7.4 does. If not, add a line to
# the cell, below its first, such as `settings.temperature = 1000`.) **Write your guess down
# first.**
#
# 1. *Price of a crash: 150.* What will `landed` do, and what the other curve?
# 2. *Price of a crash: 0.* Will it still come home?
# 3. *Target network: frozen.* How much can it learn from a judge that never learns?
# 4. *Memory: 320*, the last twenty steps of each UAV. What does it lack?
# 5. *Temperature: 1000*. Now it flies at random. Does it still learn?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("huge_penalty")

# %% [markdown]
# Here are three runs of each, with the knob turned from the start (dotted: landed; solid: collected
# and landed):

# %% tags=["hide-input"]
from uavdh_lite.plotting import BLUE, ORANGE
from uavdh_lite.storage import data_folder, read_table

knobs = read_table(data_folder() / "runs/knobs-village.csv.gz")
figure, axes = plt.subplots(2, 3, figsize=(9, 4.2), sharex=True, sharey=True, layout="constrained")
for ax, variant in zip(axes.flat, dict.fromkeys(knobs["variant"])):
    for seed in range(3):
        rows = (knobs["variant"] == variant) & (knobs["seed"] == seed)
        for name, style, colour in (("landed", ":", ORANGE), ("collected_and_landed", "-", BLUE)):
            ax.plot(knobs["steps"][rows] / 1000, knobs[name][rows], style, color=colour, lw=1.2)
    ax.set(title=variant.replace("_", " "), ylim=(-0.03, 1.03))
figure.supxlabel("thousand environment steps", fontsize="medium")
figure.supylabel("share", fontsize="medium");

# %% [markdown]
# With a **price of 150** it learns to land, and leaves more than half of the data behind. **Without
# a price** it learns to collect, but in the end is still in the air in a sixth to half of the
# missions when time is up. From a **frozen** judge it can learn one step ahead and no more, so news
# does not spread. With a **small memory**, all minibatches come from the latest few dozen flights:
# one run stayed timid, two collected and never learned to land. **At random** it still learns, because
# Q-learning is off-policy (6.1) and the curve shows it without exploring; but random flights rarely
# get far.
#
# Why does a high price do harm? Landing at once costs nothing, and at first most flights far from
# home end in a crash; an agent that sees that may conclude that it is best to stay near home. Such
# a **lazy agent** is a common failure. Why is a low price not enough? Ten steps ahead a price of 5
# counts only $5\cdot0.95^{10}\approx3$, less than any device holds at first. So the price is low
# at first and grows.
#
# And why does the agent without a price so often stay out, although hardly anything is left to
# collect? Landing now instead of hovering until the end saves 0.2 units a step, so then going home
# *is* best. But such differences are small, and are easily lost in the network's errors (4.2).
#
# ## 7.6 Reading the curves of a long run
#
# Over Manhattan training takes longer. Here are the curves of one run of the recipe `lite`:
# the loss, and means over training flights, in which the agent explores:

# %% tags=["hide-input"]
table = read_table(data_folder() / "runs/ddqn-manhattan-training.csv.gz")
run = {name: column[table["seed"] == 0] for name, column in table.items()}
figure, axes = plt.subplots(1, 4, figsize=(10, 2.3), layout="constrained")
for ax, name in zip(axes, ("landed", "collected", "return", "loss")):
    ax.plot(run["steps"] / 1e6, run[name], lw=0.8)
    ax.set(title=name, xlabel="million steps")

# %% [markdown]
# The first flights are random and mostly land, with little data. Then **collected** rises while
# **landed** and the **return** fall: the agent rarely comes home in time. Later both recover.
#
# Many people look at the **loss** first, but it tells little: the targets move with the network,
# so it may rise while the agent gets better, and its size depends on that of the rewards. Look at
# *landed* and *collected* together, and at other seeds, because a single dip may be chance. If the
# Q-values are far above what then comes in, they may be diverging (6.3). [My agent does not
# learn](../docs/tutorials/does_not_learn.md) is a checklist.
#
# `lite` strengthens the method for such a city. Three changes show the idea: 32 UAVs side by side;
# a price of a crash that grows from 10 to 150; and targets with three rewards before the Q-value, a
# *three-step return*, so that news spreads faster (though the second and third reward may be what
# an older policy earned):
#
# $$y=r_t+\gamma r_{t+1}+\gamma^2r_{t+2}+\gamma^3\,Q_{\bar\theta}\big(s_{t+3},\arg\max_{a'}Q_\theta(s_{t+3},a')\big)$$
#
# The recipe `plain` is the paper's method with nothing added but a network that a processor can
# afford and a learning rate that suits it.
#
# ## 7.7 All of it in one file
#
# What learns stands in `uavdh_lite/one_file.py`, 250 lines; a project or a thesis can start from a
# copy.
#
# | name | what it is | section | paper |
# | --- | --- | --- | --- |
# | `CentredMap` | what the network sees | 4.3 | III-C |
# | `QNetwork` | what each action is worth | 5.7 | Fig. 2 |
# | `softmax_policy` | draws actions | 6.4 | eq. 10 |
# | `double_target` | what the network should have said | 6.5 | eq. 8 |
# | `Memory` | what happened | 7.1 | III-B |
# | `update` | a step of Adam; the target network follows | 6.3, 7.2 | eq. 7 |
# | `evaluate` | missions without exploring | 7.3 | eq. 9 |
# | `train` | the loop | 7.4 | III |
#
# ## Recap
#
# - Training is a loop: act, step, remember, draw, update. The agent makes its own data.
# - With a price of a crash that is large from the start our agents collected little; without one
#   they stayed out too often.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/07_training/07_training.ipynb) change your loop: a
# dueling head, three-step returns, bugs to find.
#
# Further reading: Henderson et al., *Deep Reinforcement Learning that Matters*, 2018.
