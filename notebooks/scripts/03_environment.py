# %% [markdown]
# # 3 · The environment
#
# **How does a flight become numbers that a program can learn from?**
#
# Below, the greedy pilot of notebook 0 flies a mission with two devices. It leaves a good part of the data behind. At the
# end of this notebook you will fly the same mission by hand, and beat greedy.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    # %cd -q {project[0]}/notebooks

# %%
# %matplotlib inline
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.plotting import trajectory_figure
from uavdh_lite.policies import find_policy

environment = environment_of("manhattan")
mission = Mission(environment.city, (1, 1), ((4, 7), (15, 0)), (12, 18), flying_time=35)
flights = mission.fly(environment, find_policy("greedy", environment))
trajectory_figure(environment, flights.trajectory(0))

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Step through an episode, keep its ledger, trigger the safety controller, follow four slots, fly by hand |
# | **What you'll learn** | State, action, reward and end: the Markov decision process of the paper |
# | **What you'll need** | Notebooks 1 and 2. 45 minutes to read, 10 seconds to run; 35 minutes of exercises |
#
# ## 3.1 The state
#
# One flight from start to end is an *episode*. One action is one *step*, and takes one unit of flying time. Every step
# goes once round this loop:
#
# ```text
#              action
#      ┌─────────────────────▶┐
#   policy               environment
#      └◀─────────────────────┘
#        reward, next state
# ```
#
# The *state* holds all that matters for what comes next. Here it is at the start:

# %%
state = mission.state
for name, value in vars(state).items():
    print(f"{name:<13} {value.tolist()}")

# %% [markdown]
# A cell is one number here, row · 16 + column, so 17 is row 1, column 1. There is room for five devices, and this episode
# uses two. The outer brackets are there because the library flies many episodes at once, a *batch*. `city` is 0, because there is only one.
#
# Why is the time left in the state? With 40 units left, flying on may be best. In the same place with only 5, it is not.
#
# ## 3.2 Actions and one step
#
# There are six actions: four moves, hovering and landing. A rule that picks an action from a state is a *policy*.
#
# A step has two parts. First the luck: the fading of notebook 1 is drawn. Then a *pure function*, one without luck or
# memory, computes the rest. State, action and fading go in, the next state and the outcome come out. So where the UAV
# goes is certain, and only how much data comes in is luck.

# %%
import numpy as np

from uavdh_lite.environment import ACTIONS, EAST, HOVER, NORTH, Rewards

# mission.fading is a random generator, always a new one that draws the same numbers
fading = environment.draw_fading(state, mission.fading)
after, outcome = environment.transition(state, np.array([EAST]), fading)
print("one step east: cell", after.uav_cell[0], "time left", after.time_left[0])

# %% [markdown]
# In symbols, the next state is drawn
# from a distribution
#
# $$s_{t+1} \sim p(\,\cdot \mid s_t, a_t)$$
#
# The sign ~ means “is drawn from”, and the dot stands for the next state. The distribution depends on the present state
# $s_t$ and the action $a_t$ alone, and not on how the UAV came to be there. A world with this property is a **Markov decision
# process**, MDP. Ours has it because fading is drawn anew in every slot. If good luck came in runs, the luck of the past would say something about
# the future, and the state would have to hold it. The time left is there for the same reason: it decides when the episode
# ends. If an agent sees only a part of such a state, its problem is a *partially observable* one, a **POMDP**, and much harder, because
# it has to remember.
#
# ## 3.3 What a step earns
#
# Nobody tells an agent which action is right. It gets a *reward* for each step. Learning means changing the policy so
# that the sum of the rewards, the *return*, becomes larger. The reward has four parts (paper, section III):
#
# $$r_t = \text{data uploaded} + r_\mathrm{mov} + r_\mathrm{sc} + r_\mathrm{crash}$$
#
# | part | value | when |
# | --- | --- | --- |
# | data | 1 for each data unit | data is uploaded |
# | $r_\mathrm{mov}$ | −0.2 | in every step but the landing |
# | $r_\mathrm{sc}$ | −1 | the safety controller intervenes |
# | $r_\mathrm{crash}$ | −150 | time is up and the UAV has not landed |
#
# The paper prints no values. These are defaults of the authors' code. The agent learned with
# two other values: −0.1 per step, and a crash that cost little at first and 150 later. Notebook 7 says why. Here is the
# ledger of greedy's flight:

# %%
from matplotlib.figure import Figure

rewards = np.array([step.reward[0] for step in flights.history])
steps = np.arange(1, len(rewards) + 1)
figure = Figure(figsize=(7, 3), layout="constrained")
ax = figure.subplots()
ax.bar(steps, rewards, label="reward of the step")
ax.step(steps, np.cumsum(rewards), "k", where="mid", label="sum so far")
ax.set(xlabel="step", ylabel="reward, data units")
ax.legend()
figure

# %% [markdown]
# Follow the black line. It falls on the way to a device and rises near it. Its last value is the return. An agent that
# looked no further than the next reward would land at once in this mission, because that costs nothing. It has to learn
# that a step which costs now may earn much later. Which of forty steps deserves the praise for the data at the end? This question is called
# **credit assignment**, and notebook 6 is about it.
#
# Is 0.2 a good cost? At 0 there would be no reason to land before the last moment. At 5, most flights would cost more
# than they bring. At 0.2, a detour of ten steps pays if it brings more than two data units.
#
# ## 3.4 The safety controller
#
# What happens if the agent picks a forbidden action?

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("off_the_grid")

# %%
flight = HandFlight(environment, mission)
for action in (NORTH, NORTH):
    outcome = flight.step(action)
    print(f"in cell {flight.state.uav_cell[0]}, reward {Rewards()(outcome)[0]:.1f}")

# %% [markdown]
# The first move is a normal one. The second would leave the map, so the UAV hovers in its cell and pays 1 more. A little
# data comes in both times. The same happens at a tall building, at a no-fly zone, and when it tries to land outside the
# landing zones.
#
# Why does a wrong move not end the episode? A beginner makes one every few steps, and would hardly ever collect much.
#
# One could also take the forbidden actions out of the choice, which is called **masking**. Then nobody would have to learn from penalties where the
# walls are. The paper lets the agent try and pay, so that it has to read the map. Notebook 6 comes back to it.
#
# One disaster remains: no time left, and still in the air.

# %%
Quiz("the_last_step")

# %%
late = Mission(environment.city, (4, 7), ((4, 7),), (12,), flying_time=1)
outcome = HandFlight(environment, late).step(HOVER)
print(f"uploaded {outcome.uploaded.sum():.1f}, reward {Rewards()(outcome)[0]:.1f}")

# %% [markdown]
# Nothing is uploaded in the step that ends an episode, whether a crash or a landing. The paper leaves this open, so this
# library had to choose.
#
# From here one can see that **even a perfect pilot stays below 100 %**. A mission is drawn without anybody asking whether it can be done. Five devices in
# far corners and 35 units of time may be too much for any route, a device in a courtyard may cost more than it holds, and fading is luck. So compare
# a pilot with the best that is possible, and not with 100 %.
#
# ## 3.5 Who may send: four slots per step
#
# Each step has four communication slots, because much can change within a move of 10 m: the UAV may come round a
# corner, and the fading changes. In each slot *one* device sends: of those with data left, the loudest, that is, the one with the
# best SNR. Sharing a channel by taking turns is called **time division multiple access**, TDMA (paper, eq. 3). The data that a step brings is the sum
# over its slots (eq. 4).
#
# Why is the fading drawn for each slot and not once for each step, or once for each flight? A single draw for the whole flight would make some missions
# lucky from start to end, and there would be something to find out by measuring. Four draws a step let the luck average out, so what remains is mostly
# geometry.
#
# In the next figure the UAV hovers between three devices, all two cells away. Device 2 has only 1.5 units of data. Fading
# is drawn for every slot and every device:

# %%
from uavdh_lite.plotting import device_colour, draw_city

between = Mission(environment.city, (4, 8), ((4, 6), (4, 10), (6, 8)), (12, 12, 1.5), 30).state
fading = environment.draw_fading(between, np.random.default_rng(19))
after, outcome = environment.transition(between, np.array([HOVER]), fading)
snr_db = environment.snr_db(between, after.uav_cell, fading)[0]

# %%
figure = Figure(figsize=(6, 2.6), layout="constrained")
ax = figure.subplots()
for slot, device in np.ndindex(4, 3):
    ax.text(slot + 1, device + 0.1, f"{snr_db[slot, device]:z.1f} dB", ha="center")
for slot, device in enumerate(outcome.served[0]):
    ax.barh(device, 0.95, left=slot + 0.525, color=device_colour(device), alpha=0.6)
    ax.text(slot + 1, device - 0.3, f"sends {outcome.uploaded[0, slot]:.2f}", ha="center")
ax.set(xlabel="communication slot", ylabel="device", xticks=range(1, 5), yticks=range(3))
figure

# %% [markdown]
# Each column is a slot, and its coloured box is the device that sends. In the first two slots device 2 is the loudest, by
# luck. In the second it can send only what it has left. Then it is empty, and another one sends.
#
# The rule looks at neither amounts nor fairness. The loudest has the whole slot even for 0.1 units, and a device that is never the loudest never sends. So it is a cheap
# schedule and not the best one.
#
# Why is "serve device 2" not an action of the agent? It would have to learn what a simple rule does well. And it still
# has a say: where it flies decides who is loudest.
#
# In each slot the UAV has moved on a little: in slot $i$ it has flown $i$ quarters of the way. Here it flies east,
# round the corner of a building, without fading:

# %%
corner = Mission(environment.city, (4, 2), ((5, 4),), (50,), 30).state
_, outcome = environment.transition(corner, np.array([EAST]), 0 * fading)
figure = Figure(figsize=(7, 3), layout="constrained")
left, right = figure.subplots(1, 2)
draw_city(left, environment.city).set(xlim=(1.5, 4.5), ylim=(5.5, 3.5), yticks=(4, 5))
left.plot(4, 5, "X", ms=13)
left.plot([2.25, 2.5, 2.75, 3], 4 * [4], "ko")
right.bar(range(1, 5), outcome.uploaded[0])
right.set(xlabel="communication slot", ylabel="data units uploaded", xticks=range(1, 5))
figure

# %% [markdown]
# The dots are the UAV in the four slots, the cross is the device. In slot 1 the building is in the way. From slot 2 on
# the device is in sight, and each slot carries a little more. Notebook 2 has one answer for each *cell*, whereas the UAV is now
# between two of them. So the nearest cell decides whether the UAV is in sight. Half-way, in slot 2, both are equally near; then the one it is
# entering counts.
#
# ## 3.6 Fly it yourself
#
# Back to the mission in the first picture. Look for the white cells there: from them the UAV sees both devices. The
# device in the middle need not be visited, because you can see it along its street from the west.
#
# Here is a plan. Change it, run the cell, and try to do better:

# %%
plan = "south south south east east east hover west west west west".split()
plan += 9 * ["south"] + 12 * ["north"] + ["land"]
flight = HandFlight(environment, mission)
for action in plan:
    flight.step(ACTIONS.index(action))
trajectory_figure(environment, flight.flights().trajectory(0))

# %%
flown = {"by hand": flight.flights()}
for name in ("manhattan_ddqn", "greedy", "random"):
    flown[name] = mission.fly(environment, find_policy(name, environment))
for name, each in flown.items():
    print(f"{name:<15}collected {each.end.collected[0]:4.0%}, return {each.returns[0]:6.1f}")
assert flown["by hand"].returns > flown["greedy"].returns + 5

# %% [markdown]
# The plan brings everything home, and greedy does not. Greedy flies towards the first device until it is empty, and from there it is a long way to
# the second. You had a map of shadows. The agent has none, and still it brings everything home, too.
#
# One mission says little about a pilot. But this one shows that a good rule leaves something to gain. In the lab *Fly*
# (`python -m uavdh_lite app`) you fly with the arrow keys.
#
# ## Recap
#
# - The state holds the places, the data and the time left.
# - A step is a pure function of state, action and fading. What comes next depends on the present state and the action, not
#   on the past: a Markov decision process.
# - The reward pays for data and charges for steps, interventions and a crash.
# - In each of four slots the loudest device with data left sends.
# - The return is the sum of all rewards. Learning means raising it.
#
# ## Exercises
#
# The exercises of this notebook, with checks and hints, are in
# [`exercises/03_environment`](exercises/03_environment/03_environment.ipynb).
#
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, sections II and III.
# - Sutton and Barto: *Reinforcement Learning*, chapter 3, on Markov decision processes.
