# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 11 · Replay
#
# The agent learns from a memory of steps, some of which it flew long ago. What if it remembered
# only the last few flights? And once the flights are forgotten, what is left of them in the
# network? The picture shows twelve training runs in the village, a city of 8×8 cells. The runs
# differ only in their seeds and in the size of the memory.

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

# %% jupyter={"source_hidden": true} tags=["hide-input"]
# %matplotlib inline
from matplotlib.figure import Figure

from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder, read_table
from uavdh_lite.streams import Use

BOTH = "collected_and_landed"
table = read_table(data_folder() / "runs/replay-village.csv.gz")
table = {name: column[table["steps"] == table["steps"].max()] for name, column in table.items()}
SIZES = {f"replay_capacity={size}": size for size in (250, 1000, 4000)} | {"as_it_is": 40_000}
figure = Figure(figsize=(6, 2.8), layout="constrained")
ax = figure.subplots()
for place, variant in enumerate(SIZES):
    ax.plot([place] * 3, table[BOTH][table["variant"] == variant], "o", color=BLUE, alpha=0.7)
village = Environment(load_city("village"))
for name, policy, style in (("greedy", Greedy(village), "--"), ("random", Random(), ":")):
    flown = evaluate(village, policy, find_scenario("village"), 200, seed=0, use=Use.VALIDATION)
    ax.axhline(flown.records()[BOTH].mean(), color="black", ls=style, label=name)
ax.set(xticks=range(4), xticklabels=[f"{size:,}" for size in SIZES.values()], ylim=(-0.03, 1.03))
ax.set(xlabel="steps in the memory", ylabel="collected and landed")
ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Compare memories of four sizes, watch a small network forget, and wipe buildings out of a trained network's map |
# | **What you'll learn** | Why a small memory forgets earlier missions and a large one is slow to change; how to ask a network what it looks at |
# | **What you'll need** | Notebooks 1, 4, 6 and 8. 50 minutes to read, 40 seconds to run; 20 minutes of exercises |
#
# ## 11.1 Four sizes of memory
#
# The runs in the picture learn as `lite` does, with the small network of the village, except that learning begins after 250 steps. Each run lasts 48,000 steps, and there are three seeds for each size. The
# recipe's own memory holds 40,000 steps. The cell that drew the picture has already read the runs' final results into a table, which is printed here:

# %%
for variant, size in SIZES.items():
    ends = table[BOTH][table["variant"] == variant]
    print(f"memory of {size:>6,} steps:", " ".join(f"{end:4.0%}" for end in ends))

# %% [markdown]
# In the picture, the dashed line is greedy and the dotted one random. With 40,000 steps in the
# memory, the three runs bring home 90 to 96 % of the data, whereas greedy brings home 98 %. With
# 4,000 steps, and even with 1,000, most runs are only a little behind those three, and the ranges
# of the three sizes overlap. With 250 steps, the runs bring home 46 to 81 % of the data: two of
# them end far below all others, and the third does only about as well as the worst of the runs with
# 4,000 steps.
#
# All runs make the same number of updates, and each update draws the same number of steps. What, then, does a small memory lack?
#
# ## 11.2 How old are the drawn steps?
#
# A replay memory is a *ring buffer*: when it is full, the newest step takes the place of the oldest. The recipe has 16 UAVs, which fly
# their missions side by side. Whenever all 16 have taken a step, one update draws 64 steps from the memory, so once the memory is full, a
# new step is drawn $64/16 = 4$ times on average before it is forgotten. That holds for a full memory of any size, because a larger one
# keeps a step longer but draws it less often.
#
# What the size does change is how *old* the drawn steps are. A memory of 250 steps holds about the
# last 16 steps of each of the 16 UAVs, which is about one flight. A memory of 40,000 steps holds
# the last 2500 steps of each UAV, more than a thousand flights in all.
#
# Is it good or bad to learn from old steps? It is both, as a tiny example shows.
#
# ## 11.3 A small memory forgets
#
# Take a street of twelve cells, with the landing zone in cell 0 and one device somewhere along it. The device holds 10 units of data,
# which are uploaded when the UAV gets there. A step costs 0.2 and a refused `land` costs 1 more, as in notebook 3. There are so few
# possible steps in this world that all of them fit into arrays:

# %%
import numpy as np

WEST, EAST, LAND = range(3)
cell, full, device, action = np.indices((12, 2, 12, 3)).reshape(4, -1)
print(f"{len(cell)} steps, from {len(cell) // 3} states")

# %%
after = (cell + (action == EAST) - (action == WEST)).clip(0, 11)
landed = (action == LAND) & (cell == 0)
uploads = (full == 1) & (after == device) & ~landed
reward = 10 * uploads - 0.2 * ~landed - ((action == LAND) & (cell > 0))

# %% [markdown]
# Each step has a number from 0 to 863, so a memory is just a list of numbers. The right Q-values
# come from the target of notebook 6, which is computed again and again until nothing changes any
# more (**value iteration**):

# %%
following = np.ravel_multi_index((after, full * ~uploads, device), (12, 2, 12))  # next states
best = np.zeros((288, 3))
for _ in range(300):
    best = (reward + 0.95 * ~landed * best[following].max(1)).reshape(288, 3)

# %% [markdown]
# Now let a network learn these values. Its inputs name the UAV's cell and the device's cell, each
# as a 1 in one of twelve places (a **one-hot** vector), and say whether the device still has its
# data. An update moves the Q-values of the drawn steps towards their targets:

# %%
import torch
from torch import nn

torch.set_num_threads(1)  # the networks are small
states = torch.tensor(np.c_[np.eye(12)[cell[::3]], np.eye(12)[device[::3]], full[::3]]).float()
rewards, discounts = torch.tensor(np.stack([reward, 0.95 * ~landed]), dtype=torch.float32)

# %%
def update(network, optimizer, drawn):
    with torch.no_grad():
        y = rewards[drawn] + discounts[drawn] * network(states[following[drawn]]).amax(1)
    q = network(states[drawn // 3])[range(len(drawn)), action[drawn]]
    optimizer.zero_grad()
    ((q - y) ** 2).mean().backward()
    optimizer.step()

# %% [markdown]
# Halfway through training, the missions change. For the first 1000 updates the device is *near*, in
# one of cells 1 to 5. After that it is *far*, in one of cells 7 to 11. Before each update, 16
# random steps of the current kind of mission go into the memory. Every 50 updates we ask in what
# share of the states the network's best action is a right one, separately for near devices and for
# far ones.

# %%
kinds = {"near": (1 <= device) & (device <= 5), "far": device >= 7}

def right(network):
    good = best[range(288), network(states).argmax(1)] > best.max(1) - 1e-4
    return [good[kind[::3]].mean() for kind in kinds.values()]

# %%
def learn(capacity, seed):
    torch.manual_seed(seed)
    layers = nn.Linear(25, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3)
    network, generator = nn.Sequential(*layers), np.random.default_rng(seed)
    optimizer = torch.optim.Adam(network.parameters(), 0.003)
    memory, shares = np.empty(0, int), []
    for t in range(2000):
        possible = np.flatnonzero(kinds["near" if t < 1000 else "far"])
        memory = np.append(memory, generator.choice(possible, 16))[-capacity:]
        update(network, optimizer, generator.choice(memory, 64))
        if t % 50 == 49:
            shares.append(right(network))
    return shares

# %% [markdown]
# A memory of 32,000 steps holds every step that ever goes into it here, whereas one of 200 steps holds
# only the steps of the last twelve updates. There are five runs with each memory. Thin lines are runs,
# bold lines are means, and the missions change at the dotted line:

# %%
runs = {size: np.array([learn(size, seed) for seed in range(5)]) for size in (200, 32_000)}

# %%
figure, updates = Figure(figsize=(9, 3.2), layout="constrained"), np.arange(50, 2001, 50)
axes = figure.subplots(1, 2, sharey=True)
for (size, curves), colour in zip(runs.items(), (VERMILION, BLUE)):
    for ax, shares in zip(axes, curves.transpose(2, 1, 0)):
        ax.plot(updates, shares, color=colour, lw=0.7, alpha=0.5)
        ax.plot(updates, shares.mean(1), color=colour, lw=2.5, label=f"memory of {size:,}")
for ax, kind in zip(axes, kinds):
    ax.axvline(1000, color="black", ls=":")
    ax.set(title=f"device {kind}", xlabel="updates", ylabel="states with a right action")
ax.legend()
figure

# %% [markdown]
# Look at the left side first. In the first half, the networks learn the near missions with either memory. Then the missions change. With a
# memory of 200 steps, the share of right actions drops steeply in every run, on average from nine states in ten to about four. Nothing was wrong
# with what the network knew, but it was overwritten: an update for one state moves weights that other states use as well, and the memory no
# longer holds a step that would change them back. This is called **catastrophic forgetting**. Later the share recovers in part, probably because
# far and near missions have much in common, such as the way home.
#
# With the large memory, hardly anything is lost. Near missions are no longer flown, but their steps
# are still drawn, so the network has to stay right about them.
#
# Now look at the right side. By the end the small memory is ahead on average, though some runs overlap. It holds only steps of far
# missions, whereas, even at the end, half of the steps drawn from the large one come from near missions. With a large memory, therefore,
# a network remembers what is no longer flown, but may adapt more slowly when the world changes. **Combined replay**, which puts the
# newest step into every minibatch, is meant to shorten this delay.
#
# **Prioritised replay** goes further, and draws steps with a large error more often than others. But a Q-value
# is a mean over good and bad luck, and if lucky steps, for example, are drawn too often, that mean shifts.
# Therefore each step's loss is divided by how much more often the step is drawn than it would be with equal
# chances (**importance weights**; exercise 11.2).
#
# In the village the missions do not change halfway through. But a memory of 250 steps holds only
# the flights that are in progress at the time and the ones just before them. As one flight follows
# another, the network
# is pulled from one handful of missions to the next, and forgets. That is the likely reason why the
# runs with this memory fell behind in 11.1.
#
# Try it here: *memory of 64* lets two networks learn side by side in your browser, one with the usual
# memory and one that keeps only the last four steps of each of its 16 UAVs.

# %%
from uavdh_lite.labs import Lab

Lab(tool="train", city="village")

# %% [markdown]
# ## 11.4 What the network knows of shadows
#
# When training is over, the memory is thrown away, and only the network is kept. What does the
# network still know from all the flights? One thing worth knowing is that a building in the way
# takes away most of the signal (notebook 1), but no input says so. The network sees buildings in
# one layer and data in another, and it has learned from rewards alone. Has it found out how the two
# layers are related?
#
# Let us ask it. Take states in which a device is close but hidden, and wipe out the buildings
# between the UAV and the device, without touching the layer that says where the UAV may fly. If the
# network knows what walls do, it must now expect more reward.
#
# First we need the states. In each of them, data is left at only one device, which is at most five cells away and out of sight, and
# there are five units of time to spare:

# %%
from dataclasses import replace

def to_device(state, size):  # rows south and columns east, from the UAV
    cells = np.stack([state.device_cells[:, 0], state.uav_cell]).astype(int)
    return [place[0] - place[1] for place in np.divmod(cells, size)]

# %%
def hidden_devices(agent, generator):
    environment = agent.environment
    state = agent.scenario.sample_anywhere(environment, 20_000, generator, spare_time=5)
    data = 20 * np.eye(1, state.data_left.shape[1], dtype=np.float32).repeat(20_000, axis=0)
    time_left = environment.time_to_land[state.city, state.uav_cell] + 5
    state = replace(state, data_initial=data, data_left=data, time_left=time_left)
    hidden = ~environment.sight[0, state.device_cells[:, 0], state.uav_cell]
    return state[hidden & (np.hypot(*to_device(state, environment.size)) <= 5)]

# %% [markdown]
# Which buildings lie between the UAV and the device? Let us take those in the rectangle with the
# UAV at one corner and the device at the opposite one. In the centred map the UAV is in the middle:

# %%
def between(state, size):
    cells = np.arange(1 - size, size)
    offsets = [offset[:, None] for offset in to_device(state, size)]
    rows, cols = ((np.minimum(o, 0) <= cells) & (cells <= np.maximum(o, 0)) for o in offsets)
    return torch.from_numpy(rows[:, :, None] & cols[:, None, :])

# %% [markdown]
# A hole in the map may change the Q-values wherever it is, just because it is unusual. We therefore need a **control**: the same rectangle
# on the *other* side of the UAV. We count only states that have at least as many buildings there as in the first rectangle. Here is an
# example:

# %%
from uavdh_lite.checkpoint import load_agent

def question(agent):
    state = hidden_devices(agent, np.random.default_rng(0))
    (maps, time), near = agent.observation(state), between(state, agent.environment.size)
    other = near.flip(1, 2)
    enough = (maps[:, 2] * other).sum((1, 2)) >= (maps[:, 2] * near).sum((1, 2))
    return maps[enough], time[enough], near[enough], other[enough]

# %%
maps, time, near, other = question(load_agent("manhattan_ddqn"))

# %%
from matplotlib.colors import ListedColormap

colours = ListedColormap(["white", "silver", VERMILION, "#009E73"])

# %%
figure = Figure(figsize=(3.4, 3.4), layout="constrained")
ax = figure.subplots()
ax.imshow(maps[0, 2] * (1 + near[0] + 2 * other[0]), cmap=colours, vmin=0, vmax=3)
ax.plot(15, 15, "^", color="white", mec="black", ms=10)
ax.plot(*maps[0, 3].nonzero()[0].flip(0), "X", color=BLUE, mec="white", ms=11)
ax.set(xlim=(8.5, 21.5), ylim=(21.5, 8.5), xticks=range(9, 22, 3), yticks=range(9, 22, 3))
figure

# %% [markdown]
# The triangle is the UAV, and the blue cross is the device. Wiping out the orange buildings clears
# the way between the two, whereas wiping out the green ones changes nothing between them. By how
# much does the network's largest Q-value rise in each case?
#
# We ask two agents, one for Manhattan and one for the open field, and, for comparison with each, an untrained network with the same
# layers.

# %%
from uavdh_lite.evaluation import bootstrap_interval

def value(network, maps, time, removed):
    edited = maps.clone()
    edited[:, 2] *= ~removed
    with torch.no_grad():
        return network(edited, time).amax(1).numpy()

# %%
for name in ("manhattan_ddqn", "open_field_ddqn"):
    agent = load_agent(name)
    maps, time, near, other = question(agent)
    torch.manual_seed(0)
    untrained = agent.recipe.network_for(agent.observation)
    for kind, network in (("trained", agent.network), ("untrained", untrained)):
        before = value(network, maps, time, near & False)
        gains = [value(network, maps, time, removed) - before for removed in (near, other)]
        more = "{:+.2f} ({:+.2f} to {:+.2f})".format(*bootstrap_interval(gains[0] - gains[1]))
        print(f"{name} {kind}, worth {before.mean():.1f}: orange {gains[0].mean():+.2f},",
              f"green {gains[1].mean():+.2f}, difference {more},",
              f"above 0 in {(gains[0] > gains[1]).mean():.0%}")

# %% [markdown]
# The untrained networks hardly react. Both trained ones expect more reward when any buildings disappear, and the rise is clearly larger
# when those buildings were in the way. The networks have therefore learned from rewards that buildings *between* the UAV and a device cost
# data, and they look for such buildings. One doubt is left: the control lies not only on the other side of the UAV, but also farther from
# the *device* than the orange rectangle. If the networks value open space around a device for some reason other than shadows, that could
# explain part of the difference.
#
# Neither network has become a ray tracer. The difference is small next to what these states are
# worth: 3 % of their value over Manhattan and 15 % over the open field. In three or four states out
# of ten, there is no difference, or it goes the other way. Also, a city with a missing building is
# new to such a network. The test shows what the network looks at, but not how well it would fly
# there.
#
# This way of asking, a **perturbation analysis**, works for any network and for many questions: change one
# thing in the input that should matter, change something similar that should not, and compare the effects.
#
# ## Recap
#
# - With replay, an agent learns from each step several times, and from the steps of many flights at
#   once.
# - A small memory holds only the latest one or two flights of each UAV, so the network overwrites what it knew about other missions.
# - With a large memory, a network remembers earlier missions, but may adapt more slowly when the world
#   changes.
# - A network can learn what no input says, such as that walls cost data.
# - To see what a network looks at, change its input, and compare the effect with that of a control.
#
# ## Exercises
#
# The exercises of this notebook are in [`exercises/11_replay`](exercises/11_replay/11_replay.ipynb).
#
# ## Further reading
#
# - Lin: *Self-Improving Reactive Agents Based on Reinforcement Learning, Planning and Teaching*, Machine Learning 1992: where replay comes from.
# - Zhang and Sutton: *A Deeper Look at Experience Replay*, 2017: memories that are too large.
# - Schaul, Quan, Antonoglou, Silver: *Prioritized Experience Replay*, ICLR 2016.
# - Kirkpatrick et al.: *Overcoming Catastrophic Forgetting in Neural Networks*, PNAS 2017.
