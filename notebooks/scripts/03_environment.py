# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 3 · The environment
#
# **How does a flight become numbers that a program can learn from?**
#
# Below, the greedy pilot from notebook 0 flies a mission with two devices. Greedy leaves a good
# part of the data behind. At the end of this notebook you will fly the same mission by hand, and
# beat greedy.

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
# | **What you'll do** | Step through a flight, add up its rewards, trigger the safety controller, follow four slots, and fly by hand |
# | **What you'll learn** | State, action, reward and end: the Markov decision process of the paper |
# | **What you'll need** | Notebooks 1 and 2. 45 minutes to read, 10 seconds to run; 35 minutes of exercises |
#
# ## 3.1 The state
#
# One flight from start to end is an *episode*. One action is one *step* and takes one unit of
# flying time. Each step goes once round this loop:
#
# ```text
#              action
#      ┌─────────────────────▶┐
#   policy               environment
#      └◀─────────────────────┘
#        reward, next state
# ```
#
# The *state* holds everything that matters for what comes next. Here is the state at the start of
# the mission:

# %%
state = mission.state
for name, value in vars(state).items():
    print(f"{name:<13} {value.tolist()}")

# %% [markdown]
# Here a cell is given by one number, row · 16 + column, so 17 is row 1, column 1. The state has
# room for five devices, but this episode uses only two. The outer brackets are there because the
# library can fly many episodes together, as a *batch*.
#
# Why does the state contain the time left? With 40 units of time left, flying on may be best. In
# the same place with only 5 units, the UAV may have to land.
#
# ## 3.2 Actions and one step
#
# There are six actions: four moves, hovering and landing. A rule that picks an action in each state
# is a *policy*.
#
# A step has two parts. The first is luck: the fading of notebook 1 is drawn at random. The second
# is a *pure function*, that is, a function without luck or memory. State, action and fading go in,
# and the next state and the outcome of the step come out. Fading does not change where the UAV
# goes, so luck decides only which device sends, and how much.

# %%
import numpy as np

from uavdh_lite.environment import ACTIONS, EAST, HOVER, NORTH, Rewards

# mission.fading is a random generator, always a new one that draws the same numbers
fading = environment.draw_fading(state, mission.fading)
after, outcome = environment.transition(state, np.array([EAST]), fading)
print("one step east: cell", after.uav_cell[0], "time left", after.time_left[0])

# %% [markdown]
# In symbols, the next state is drawn from a distribution:
#
# $$s_{t+1} \sim p(\,\cdot \mid s_t, a_t)$$
#
# The sign ~ means “is drawn from”, and the dot stands for the next state. The distribution depends
# only on the present state $s_t$ and the action $a_t$, not on how the UAV reached this state. A
# world with this property is a **Markov decision process** (MDP). An MDP has five parts: the
# states, the actions, the distribution $p$, the reward (3.3), and a discount, which says how
# strongly later rewards count (notebook 6). Our world is an MDP because fading is drawn anew in
# every slot; if good luck came in runs, the state would have to include past luck. The time left,
# too, has to be in the state, because it decides when the episode ends. If an agent sees only part
# of the state, the process is *partially observable*, and the problem is called a **POMDP**.
#
# ## 3.3 What a step earns
#
# Nobody tells an agent which action is right. Instead, it gets a *reward* for each step. Learning
# means changing the policy so that the sum of the rewards, the *return*, grows. The reward has four
# parts (paper, section II-B):
#
# $$r_t = \text{data uploaded} + r_\mathrm{mov} + r_\mathrm{sc} + r_\mathrm{crash}$$
#
# | part | value | when |
# | --- | --- | --- |
# | data | 1 for each data unit | data is uploaded |
# | $r_\mathrm{mov}$ | −0.2 | in every step except the landing |
# | $r_\mathrm{sc}$ | −1 | the safety controller intervenes |
# | $r_\mathrm{crash}$ | −150 | time is up and the UAV has not landed |
#
# The paper does not state these values; they are the defaults in the authors' code. For our agent
# two of them were different: a step cost 0.1, and a crash cost little at first and 150 at the end
# of training (notebook 7). Here are the rewards of greedy's flight, step by step:

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
# The black line falls in a step that brings less than 0.2 units of data, and rises in one that
# brings more. Its last value is the return. An agent that looked no further than the next reward
# would land at once in this mission, because landing costs nothing. An agent therefore has to learn
# that a costly step may pay for itself later. When data comes in after thirty steps, which of those
# steps deserve the credit? This is the problem of **credit assignment**, and notebook 6 is about
# it.
#
# Why is data paid for when it comes in, and not on landing, when the score counts it? Because a
# reward paid on landing could come dozens of steps after the move that earned it. A reward paid at
# once goes to the step that brought in the data. The drawback is that return and score differ, and
# that it is mainly the penalty for a crash that makes the agent bring its data home (notebook 7).
#
# Is 0.2 a good price for a step? At a price of 0 there would be no reason to land before the last
# moment. At 5, most flights would cost more than they brought in. At 0.2, a detour of ten steps
# pays if it brings in more than two data units.
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
# The first move is ordinary: it costs 0.2, but brings in 0.1 data units. The second move would take
# the UAV off the map, so it hovers instead, at an extra cost of 1. The same happens when the UAV
# tries to enter a tall building or a no-fly zone, or to land outside the landing zones. The agent
# of notebook 6 learns from the action that it chose, not from the hovering, because it is the
# choice that has to be discouraged.
#
# Why does a wrong move not end the episode? An untrained agent makes a wrong move every few steps,
# so its episodes would rarely last long enough for much data to come in.
#
# The controller is part of the UAV, not of the training. The trained agent still needs the
# controller, because the agent makes a few wrong moves in every hundred missions, some of them into
# a wall.
#
# One could also remove the forbidden actions from the agent's choices, which is called **masking**.
# The paper lets the agent try such actions and pay for them, so it must learn where the walls are.
#
# One disaster remains: the time is up, and the UAV is still in the air. Nothing is uploaded in a
# step that ends an episode, whether by a crash or by a landing.

# %%
Quiz("the_last_step")

# %%
late = Mission(environment.city, (4, 7), ((4, 7),), (12,), flying_time=1)
outcome = HandFlight(environment, late).step(HOVER)
print(f"uploaded {outcome.uploaded.sum():.1f}, reward {Rewards()(outcome)[0]:.1f}")

# %% [markdown]
# On average, **even a perfect pilot collects less than 100 % of the data**. Missions are drawn at
# random, and nobody checks whether all of their data can be collected. Five devices in far corners
# may be too many for any route of 35 units of time, and fading may bring bad luck. So compare a
# pilot with the best possible one, not with 100 %.
#
# ## 3.5 Who may send: four slots per step
#
# Each step has four communication slots, because much can change within a move of 10 m: for
# example, the UAV may come round a corner. In each slot *one* device sends: the loudest of those
# with data left, that is, the one with the best SNR. Sharing a channel by taking turns in time is
# called **time division multiple access**, or TDMA (paper, eq. 3). The data that a step brings in
# is the sum over its slots (eq. 4).
#
# In the next figure the UAV hovers between three devices, each of them two cells away. Device 2 has
# only 1.5 units of data left:

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
# Each column is a slot, and the coloured box in it marks the device that sends. In the first two
# slots device 2 happens to be the loudest. In slot 2 it can send only the little data that it still
# has. Then it is empty, and the loudest of the others sends.
#
# Choosing the loudest uses luck: each device has its own fading, and the more devices compete, the
# likelier it is that one of them is lucky. With five equally strong links of 0 dB the loudest
# carries 1.31 units in a slot on average, and a single one 1.02. This is called **multi-user
# diversity**.
#
# But the rule takes no account of how much data a device has, or of fairness. The loudest device
# gets the whole slot, even if it has only 0.1 units left to send, and a device that is never the
# loudest never sends. The rule therefore need not give the best schedule.
#
# Why is "serve device 2" not one of the agent's actions? If it were, the agent would have to learn
# what a simple rule already does well.
#
# From slot to slot the UAV moves on: in slot $i$ it has flown $i/4$ of its move. In the next figure
# it flies east, past the corner of a building. Fading is left out:

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
# The dots show where the UAV is in the four slots, and the cross is the device. In slot 1 the
# building is in the way. From slot 2 on, the device is in sight, and each slot carries a little
# more data than the one before. How does the program know what is in sight? The table of notebook 2
# has one answer for each *cell*, whereas the UAV is now between two cells, so the nearer cell
# decides whether the device is in sight. Halfway, in slot 2, the two cells are equally near, and
# then the cell ahead counts.
#
# ## 3.6 Fly it yourself
#
# Now go back to the mission in the first picture. From the two white cells in the west the UAV sees
# both devices, one along the street and the other along the edge of the city.
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
# The plan brings all the data home, but greedy does not. Greedy flies towards the nearer device
# until that device is empty, and from there it is a long way to the other. You had a map of the
# shadows to plan with. The agent has no such map, yet it, too, brings everything home.
#
# In the lab *Fly* you can fly many more missions, with the arrow keys.
#
# ## Recap
#
# - The state holds the positions, the data and the time left.
# - A step is a pure function of state, action and fading. The next state depends on the present
#   state and the action, not on the past, so our world is a Markov decision process.
# - The reward pays for data and charges for steps, interventions and a crash.
# - In each of the four slots of a step, the loudest of the devices with data left sends.
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
