# %% [markdown]
# # 3 · The environment
#
# Reinforcement learning needs a world to act in. Ours has a UAV with limited flying time, a few devices with data,
# and a rule that says what an action earns. This notebook plays one episode by hand, opens up every
# number in it, and ends with two hundred flights of a pilot who knows nothing.

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
from matplotlib.figure import Figure

from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment, Rewards
from uavdh_lite.evaluation import fly
from uavdh_lite.planners import Greedy
from uavdh_lite.plotting import add_legend, draw_trajectory
from uavdh_lite.missions import place
from uavdh_lite.scenario import find_scenario

environment = Environment(City.load("manhattan"))
start = place(environment.city, uav=(1, 1), devices=[(4, 7), (15, 0)], data=[12, 18],
              flying_time=35, max_devices=5)

# %%
def draw(trajectory, devices=2):
    figure = Figure(figsize=(6, 7), layout="constrained")
    draw_trajectory(figure.subplots(), environment, trajectory)
    add_legend(figure, devices)
    return figure

generator = np.random.default_rng(0)
flights = fly(environment, Greedy(environment), start, generator)
draw(flights.trajectory(0))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Fly an episode action by action, take each reward apart, provoke the safety controller, follow the devices' slots, fly with buttons |
# | **What you'll learn** | The Markov decision process of the paper: state, actions, transition, reward, end; the scheduler |
# | **What you'll need** | Notebooks 1 and 2. 39 minutes to read, 20 seconds to run; 13 minutes of exercises. An appendix, 4 minutes more, steps a thousand episodes at once |
#
# The flight above is by a simple planner that always goes to the nearest device with data left. Here that is
# a bad idea: it has to leave a third of the data. We shall do better than it, and worse.
#
# ## 3.1 The state
#
# One flight from start to end is an *episode*, elsewhere also a mission or a flight. One action is one *step*, and takes one
# unit of flying time. A few arrays hold all that can change in an episode. A cell is a number, `row * 16 + column`:

# %%
for name, value in vars(start).items():
    print(f"{name:<13} {value.tolist()}")

# %% [markdown]
# Every array has an outer list of length 1: this is a *batch* of one episode. There are five places for
# devices; the three that this episode does not use hold no data. The agent never sees this list: it
# sees the map of notebook 4, which is drawn from it.
#
# ## 3.2 Actions and one step
#
# There are six actions. Each costs one unit of flying time. In a *Markov decision process* the chances of what comes
# next depend only on the present state and the action. A rule that picks an action from a state is a *policy*.
#
# The only chance here is the fading. It is not part of the state, and need not be: it is drawn anew in every slot, so the fading
# of the past says nothing about the next. If good moments came in runs, the last ones would say something, and
# the state would have to hold them. The time left must be part of it: with 40 units left another action may be best in the same place than with 5.

# %%
print(dict(enumerate(ACTIONS)))
EAST, SOUTH = ACTIONS.index("east"), ACTIONS.index("south")

def step(state, action):
    return environment.step(state, np.array([action]), generator)

generator = np.random.default_rng(1)
state, outcome = step(start, EAST)
print("cell", divmod(int(state.uav_cell[0]), 16), "time left", state.time_left[0])

# %% [markdown]
# `environment.step` does two things. It draws the fading, then it calls `environment.transition`, a pure
# function: state, action and fading in, new state and outcome out. Nothing is hidden inside an object, so
# `start` is still what it was, and the same fading gives the same step again. In symbols,
# $s_{t+1} \sim p(\cdot \mid s_t, a_t)$: the next state is drawn from a distribution that depends on the present state $s_t$ and
# the action $a_t$ alone. All the chance is in that one draw.

# %%
print("start is unchanged:", divmod(int(start.uav_cell[0]), 16), start.time_left[0])

# %% [markdown]
# ## 3.3 What a step earns
#
# The reward (paper, eq. 9) is the sum of four terms: the data uploaded, a small price for every step but
# the landing, a penalty when the safety controller has to step in, and a large one for running out of time.

# %%
rewards = Rewards()
print(rewards)

# %%
state = start
for action in 3 * [EAST] + 3 * [SOUTH] + 2 * [EAST]:
    state, outcome = step(state, action)
    terms = {name: round(float(value[0]), 2) for name, value in rewards.terms(outcome).items()}
    print(f"{ACTIONS[action]:<6}", divmod(int(state.uav_cell[0]), 16), terms)

# %% [markdown]
# The first steps bring next to nothing. As the UAV comes into the device's street, data comes in. The agent's
# problem is all here: pay now, earn later, and be home in time.
#
# ### Learning by reward
#
# Nobody tells an agent which action is right. It sees a *state*, its *policy* picks an *action*, the world answers with
# a *reward* and the next state, and so on to the end of the episode. What counts is the sum of all rewards, the
# *return*. An agent learns by reward when it changes its policy so that the mean return rises:

# %%
figure = Figure(figsize=(7, 1.9), layout="constrained")
ax = figure.subplots()
boxes = {"policy": (0.12, "Which action here?"), "world": (0.88, "city, channel, luck")}
for name, (x, text) in boxes.items():
    ax.text(x, 0.5, f"{name}\n{text}", ha="center", va="center", bbox={"boxstyle": "round", "fc": "0.92", "ec": "0.4"})
for y, (begin, end), text in ((0.72, (0.26, 0.76), "action"), (0.28, (0.76, 0.26), "reward and next state")):
    ax.annotate("", (end, y), (begin, y), arrowprops={"arrowstyle": "->", "lw": 1.5})
    ax.text(0.51, y + 0.06, text, ha="center")
ax.set(xlim=(0, 1), ylim=(0, 1))
ax.axis("off")
figure

# %% [markdown]
# The ledger of the flight at the top, by the simple planner. Bars are the rewards of single steps, the line is their
# sum so far; where it ends is the return.

# %%
ledger = [rewards.terms(flown.outcome) for flown in flights.history]
data, price = (np.array([terms[name][0] for terms in ledger]) for name in ("data", "movement"))
figure = Figure(figsize=(8, 3), layout="constrained")
ax = figure.subplots()
ax.bar(range(1, len(data) + 1), data, label="data uploaded in the step")
ax.bar(range(1, len(data) + 1), price, label="price of the step")
ax.step(range(1, len(data) + 1), np.cumsum(data + price), "k", where="mid", label="sum so far")
ax.set(xlabel="step", ylabel="reward, data units")
ax.legend()
print(f"return {(data + price).sum():.2f} = data {data.sum():.2f}, price of {(price < 0).sum()} steps {price.sum():.2f}")
figure

# %% [markdown]
# On the way to the second device the sum falls, step by step. An agent that looked no further than the next reward would never
# set out. It has to learn that a step which costs now is worth what comes much later: notebook 5 is about that.
#
# ## 3.4 The safety controller
#
# What does the city do with a move that it does not allow?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("off_the_grid")

# %% [markdown]
# From cell (1, 2), south is a tall building. The controller replaces the action by hovering. That costs a unit of time like any step, and 1 more in reward:

# %%
below = place(environment.city, uav=(1, 2), devices=[(4, 7)], data=[12], flying_time=45, max_devices=5)
after, outcome = step(below, SOUTH)
print("stayed at", divmod(int(after.uav_cell[0]), 16), "intervened:", outcome.intervened[0])
print({name: round(float(value[0]), 2) for name, value in rewards.terms(outcome).items()})

# %% [markdown]
# Without this penalty a refused move would earn exactly what hovering earns. The agent could not tell them apart, and would
# learn only from the lost time not to fly against walls.
#
# Landing outside the landing zone is replaced the same way. There is no collision in this world, only
# wasted time. Why does a wrong move not end the episode? A beginner makes one every few steps, and would hardly ever get far
# enough to see a device. Replaced, it costs a little, and the flight goes on. Another way is to let the
# agent choose among allowed actions only (a *mask*): then nothing need be learned about walls. The agents of notebook 12 do
# that, and actions that leave no time for the way home are not allowed either. (The
# controller's hovering is like any other: data comes in meanwhile.)
#
# The one disaster left is the last one: a flying time of 0 in the air.

# %%
Quiz("the_last_step")

# %%
late = place(environment.city, (8, 8), [(4, 7)], [12], 1, 5)
after, outcome = step(late, EAST)
print("crashed:", outcome.crashed[0], "reward", rewards(outcome)[0])

# %% [markdown]
# Nothing is uploaded in the step that ends an episode, be it a landing or a crash. So `land` never collects. With data still
# coming in, one more `hover` pays if it brings more than its price of 0.2, and if a unit of time is left to land afterwards.
#
# (The paper gives no number for the crash; −150 is from the authors' code. This notebook prints these values throughout. Our
# own *recipe* for training is called `lite`. In it a step costs half as much, so that a far device with little data is not
# left behind, and a crash costs less at first; notebook 6 shows why.)
#
# Is 0.2 a good price for a step? At 0, a long route is as good as a short one, and there is no reason to land before the last
# moment. At 5, a flight of 20 steps costs 100, as much as five full devices hold: it is usually best to land soon. A step near a
# device brings several data units, one far away hardly any. At 0.2 a detour of ten steps pays if it brings more than 2 units.
#
# ## 3.5 Who may send: four slots a step
#
# While the UAV moves from one cell to the next there are four communication slots. In each, *one*
# device sends: the one with the best SNR among those with data left. (Devices take turns in time: *time division
# multiple access*, TDMA. The rule is a *max-rate scheduler*.)
# The fading is drawn again for every slot and device, so luck can change who it is:

# %%
between = place(environment.city, (4, 8), [(4, 6), (4, 10), (6, 8)], [12, 12, 1.5], 30, 5)
fading = environment.draw_fading(between, np.random.default_rng(19))
after, outcome = environment.transition(between, np.array([ACTIONS.index("hover")]), fading)
snr_db = environment.snr_db(between, after.uav_cell, fading)[0]
left = between.data_left[0].copy()

# %%
from uavdh_lite.plotting import BLUE, VERMILION, device_colour, draw_city

figure = Figure(figsize=(6, 2.6), layout="constrained")
ax = figure.subplots()
for slot, device in np.ndindex(4, 3):
    served = outcome.served[0, slot] == device
    words = f"{snr_db[slot, device]:z.1f} dB" if left[device] > 0 else "empty"
    words += f"\nsends {outcome.uploaded[0, slot]:.2f}" if served else ""
    colour = device_colour(device) if served else "0.95"
    ax.barh(device, 1, 0.9, left=slot + 0.5, color=colour, alpha=0.6, edgecolor="white")
    ax.text(slot + 1, device, words, ha="center", va="center", fontweight="bold" if served else None)
    left[device] -= served * outcome.uploaded[0, slot]
ax.set(xticks=range(1, 5), yticks=range(3), yticklabels=[f"device {k}" for k in range(3)])
ax.set(xlabel="communication slot", xlim=(0.5, 4.5), ylim=(2.5, -0.5))
ax.tick_params(length=0)
figure

# %% [markdown]
# Each box has the SNR of a device. The one that sends has its colour, and the data units that it sends. All three are
# equally far from the UAV, so luck decides. Device 2 gets the first two slots. The second carries only what
# it has left, and then it makes way.
#
# Why is "serve device 2" not an action of the agent? Then there would be one for each device, their number changes, and the
# agent would have to learn what a rule can do. It still has its say: where it flies decides who is loudest. The rule
# mostly does it well: the loudest device sends the most, and with fading drawn for each, the loudest of several is
# louder on average than any one of them. But it never asks how much is left: in slot 2 above, device 0 would have sent
# more than the rest of device 2. Nor does it think ahead: if the UAV passes device
# A only now and will be near B for long, it should serve A now, even if B is a little louder.
#
# The UAV is a little further in every slot. Where it is decides the distance and whether it sees the
# device. Here it flies east, round the corner of a building, without fading:

# %%
corner = place(environment.city, (4, 2), [(5, 4)], [50], 30, 5)
quiet = np.zeros_like(environment.draw_fading(corner, generator))
_, outcome = environment.transition(corner, np.array([EAST]), quiet)
share = np.arange(1, 5) / 4  # of the way, in each slot
nearest = np.where(share < 0.5, 2, 3)  # the column; half-way counts as the cell that it enters
sight = environment.sight[0][5 * 16 + 4, 4 * 16 + nearest]

# %%
figure = Figure(figsize=(7, 3), layout="constrained")
left, right = figure.subplots(1, 2)
draw_city(left, environment.city).set(xlim=(1.5, 4.5), ylim=(5.5, 3.5), xticks=range(2, 5), yticks=(4, 5))
left.plot(4, 5, "X", color=device_colour(0), mec="black", ms=13)
left.annotate("", (3, 4), (2, 4), arrowprops={"arrowstyle": "->"})
for slot, (part, seen) in enumerate(zip(share, sight), 1):
    left.plot(2 + part, 4, "o", color=BLUE if seen else VERMILION, ms=8)
    left.text(2 + part, 3.8, slot, ha="center")
right.bar(range(1, 5), outcome.uploaded[0], color=[BLUE if seen else VERMILION for seen in sight])
right.set(xlabel="communication slot", ylabel="data units uploaded", xticks=range(1, 5))
figure

# %% [markdown]
# In slot 1 the UAV is a quarter of the way, in slot 4 at its goal. In each slot the line of sight is that of the nearest
# cell. Half-way, in slot 2, both are equally near: then the cell that the UAV is entering counts. So only slot 1
# (red) is in the shadow. From then on the device is seen (blue), and each slot carries a little more because the
# UAV comes nearer. The same by hand, with the channel of notebook 1:

# %%
from uavdh_lite.channel import rate

squared_m2 = 100 * ((2 - share) ** 2 + 1**2 + 1)  # cells of 10 m, flying 10 m high
by_hand = rate(environment.channel.transmit_snr_db(16) - environment.channel.path_loss_db(squared_m2, sight))
assert np.allclose(by_hand, outcome.uploaded[0], atol=1e-4)
print(by_hand.round(2).tolist())

# %% [markdown]
# ## 3.6 Fly it yourself
#
# With a running kernel the buttons below move the UAV; the figure under them shows the start.

# %%
def mark_devices(ax, state):
    for device in np.flatnonzero(state.data_initial[0]):
        row, col = divmod(int(state.device_cells[0, device]), 16)
        ax.plot(col, row, "X", color=device_colour(device), mec="white", ms=12)
        ax.annotate(f"{state.data_left[0, device]:.1f}", (col + 0.4, row - 0.4))
    collected = state.collected[0]
    ax.set_title(f"time left {state.time_left[0]}, collected {collected:.0%}"
                 + (", landed" if state.landed[0] else ""))

# %%
def draw_state(states):
    history = [divmod(int(s.uav_cell[0]), 16) for s in states]
    figure = Figure(figsize=(5.2, 5.2), layout="constrained")
    ax = draw_city(figure.subplots(), environment.city)
    ax.plot([c for _, c in history], [r for r, _ in history], "-", color="black", lw=1)
    ax.plot(history[-1][1], history[-1][0], "^", color="white", mec="black", ms=11)
    mark_devices(ax, states[-1])
    return figure

# %%
import ipywidgets

from uavdh_lite.labs.widgets import png

states = [start]
picture = ipywidgets.Image(value=png(draw_state(states)), format="png")

def press(button):
    if not states[-1].ended[0]:
        states.append(step(states[-1], ACTIONS.index(button.description))[0])
        picture.value = png(draw_state(states))

buttons = [ipywidgets.Button(description=action) for action in ACTIONS]
for button in buttons:
    button.on_click(press)
ipywidgets.VBox([ipywidgets.HBox(buttons), picture])

# %%
draw_state([start])

# %% [markdown]
# How much did you collect, and did you land? Beat the first two of these on the same start:

# %%
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.planners import Random

names = ("landed", "collected", "return", "time_used", "safety_interventions")
print(" " * 22, "random  greedy   genie")
policies = (Random(0), Greedy(environment), Genie(environment))
flown = [fly(environment, policy, start, np.random.default_rng(0)).records() for policy in policies]
for name in names:
    print(f"{name:<22}", *(f"{records[name][0]:7.2f}" for records in flown))

# %% [markdown]
# Greedy took the long way and ran short of time. The genie, a search that knows where the shadows are, shows
# that all the data can be collected in the same 35 units. (If you are stuck: where do the white cells of the
# figure at the top lie? From there the UAV sees both devices.)
#
# Here the random policy landed after three steps, with next to nothing: in the landing zone, one action in six is a
# landing. Other draws fly longer, but most end like that, as 200 missions show:

# %%
from uavdh_lite.evaluation import FunctionPolicy, evaluate

clueless = evaluate(environment, Random(0), find_scenario("manhattan"), 200, seed=0)
for name, values in clueless.records().items():
    print(f"{name:<28} {values.mean():.3f}")

# %% [markdown]
# It lands in most missions, but brings home little of the data. Training begins with such flights (notebook 6). An untrained
# *network*, left alone, is another thing: mostly it repeats one action, until the time is over or by landing at once.
#
# ## Recap
#
# - The state is six arrays; a step is a pure function of state, action and fading.
# - The reward pays for data and charges for time, interventions and crashes.
# - In each of four slots the device with the best SNR sends, if it has data left.
# - A pilot who draws actions at random lands soon, with little data.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/03_environment`](exercises/03_environment/03_environment.ipynb).
#
# **1.** The *return* of an episode is the sum of its rewards (not discounted here; training weighs later
# rewards less, notebook 5). Fly the greedy planner from `start` and compute it from the trajectory. What
# would the same flight earn without any data?

# %%
trajectory = fly(environment, Greedy(environment), start, np.random.default_rng(0))
total = trajectory.trajectory(0).reward.sum()
assert np.isclose(total, trajectory.returns[0], atol=1e-3)
print(f"{total:.2f}; without data {total - 30 * trajectory.end.collected[0]:.2f}")

# %% [markdown]
# (34 steps, of which the landing is free: 33 × 0.2 = 6.60.)
#
# **2.** Write a policy that hovers at the start and lands with its last unit of time; every mission
# starts in a landing zone. (A policy gets a batch of states and returns a batch of actions.) What does
# it collect over 200 scenarios? (`FunctionPolicy` makes a policy from a function.)

# %%
def wait(state):
    last = state.time_left == 1
    return np.where(last, ACTIONS.index("land"), ACTIONS.index("hover"))

# %%
records = evaluate(environment, FunctionPolicy(wait), find_scenario("manhattan"), 200, seed=0).records()
assert records["landed"].all() and (records["time_used"] == 1).all()
ratio = records["collected"]
print(f"it collects {ratio.mean():.1%} on average, less than 5 % in {(ratio < 0.05).mean():.0%} of missions")

# %% [markdown]
# About a quarter of the data by patience alone: what stands in line with the landing zone trickles through.
#
# ## Appendix: a thousand at once
#
# One step of one episode is a handful of array operations, and almost all the time goes into calling
# them. With many episodes in the same arrays, the same calls cost hardly more, until the arrays are so
# large that the arithmetic counts and the curve bends:

# %%
import time

def steps_per_second(batch, seconds=1.0):
    scenario, generator = find_scenario("manhattan"), np.random.default_rng(0)
    state = scenario.sample(environment, batch, generator)
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        action = generator.integers(0, 5, batch)
        environment.step(state, action, generator)
        steps += batch
    return steps / seconds

# %%
batches = (1, 8, 64, 512, 4096)
speed = [steps_per_second(batch) for batch in batches]
figure = Figure(figsize=(5.5, 3.4), layout="constrained")
ax = figure.subplots()
ax.loglog(batches, speed, "o-")
ax.set(xlabel="episodes in the batch", ylabel="steps a second")
print(f"{speed[-1] / speed[0]:.0f} times as many steps a second as one by one")
figure

# %% [markdown]
# That is why one core is enough for this project: training makes about a thousand steps a second (notebook 6), and
# flying takes a small part of that time.
#
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, sections II and III.
# - Sutton and Barto: *Reinforcement Learning*, chapter 3, on Markov decision processes.
# - **4 · Map centring**, what the agent sees of all this.
