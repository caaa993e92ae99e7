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
# | **What you'll do** | Step through a flight, trigger the safety controller, and fly by hand |
# | **What you'll learn** | State, action, reward and end: the paper's Markov decision process |
# | **What you'll need** | Notebooks 1 and 2. 35 minutes to read, 10 seconds to run; 35 minutes of exercises |
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
# The *state* holds everything that matters for what comes next. At the start of the mission it is
# this:

# %%
state = mission.state
for name, value in vars(state).items():
    print(f"{name:<13} {value.tolist()}")

# %% [markdown]
# Here a cell is given by one number, row · 16 + column, so 17 is row 1, column 1. There is room for
# five devices; this episode has two. The outer brackets are there because the library can fly many
# episodes together, as a *batch*.
#
# ## 3.2 Actions and one step
#
# A rule that picks one of the six actions in each state is a *policy*.
#
# A step has two parts. The first is luck: the fading of notebook 1 is drawn. The second is a *pure
# function*, without luck or memory: state, action and fading go in, and the next state and the
# outcome of the step come out.

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
# world with this property is a **Markov decision process** (MDP). It has five parts: the states,
# the actions, the distribution $p$, the reward (3.3), and a discount, which says how strongly later
# rewards count (notebook 6). Our world is an MDP because fading is drawn anew in every slot, and
# because the state contains the time left, which decides when the flight must end. If an agent sees
# only part of what matters, the process is *partially observable*, a **POMDP**.
#
# ## 3.3 What a step earns
#
# Nobody tells the DDQN agent which action is right. Instead, it gets a *reward* for each step, and
# learning means changing the policy so that the sum of the rewards, the *return*, grows. The reward
# has four parts (paper, section II-B):
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
# The paper does not state these values; they are the defaults in the authors' code. Here are the
# rewards of greedy's flight, step by step:

# %% tags=["hide-input"]
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
# Until the landing, the black line falls in a step that brings less than 0.2 units of data, and
# rises in one that brings more. Its last value is the return. An agent that looked no further than
# the next reward would land at once here, because landing costs nothing; it has to learn that a
# costly step may pay for itself later. When data comes in after thirty steps, which of those steps
# deserve the credit? This is the problem of **credit assignment**.
#
# Why pay for data when it comes in, and not on landing, when the score counts it? Because a reward
# paid at once goes to the step that brought the data. The drawback is that without the penalty for
# a crash an agent too often stays out with its data (notebook 7).
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
# The first move costs 0.2, but brings in 0.1 data units. The second move would take the UAV off the
# map, so it hovers instead, at an extra cost of 1. The DDQN agent learned from the action that it
# chose, not from the hovering, because it is the choice that has to be discouraged. (If the flight
# ended with the first wrong move, a beginner would hardly see anything of the city.)
#
# The controller is part of the UAV, not of the training: even the trained agent makes a few wrong
# moves in a hundred missions. One could also remove the forbidden actions from its choices,
# which is called **masking**; the paper lets the agent try them and pay.
#
# One disaster remains: the time is up, and the UAV is still in the air.

# %%
Quiz("the_last_step")

# %%
late = Mission(environment.city, (4, 7), ((4, 7),), (12,), flying_time=1)
outcome = HandFlight(environment, late).step(HOVER)
print(f"uploaded {outcome.uploaded.sum():.1f}, reward {Rewards()(outcome)[0]:.1f}")

# %% [markdown]
# On average, **even a perfect pilot collects less than 100 % of the data**: missions are drawn at
# random, and nobody checks whether all of their data can be collected. So compare a pilot with the
# best possible one, not with 100 %.
#
# ## 3.5 Who may send: four slots per step
#
# Each step has four communication slots, because much can change within a move of 10 m. In each
# slot at most *one* device sends: the loudest of those with data left, the one with the best SNR.
# Sharing a channel by taking turns is called **time division multiple access**, or TDMA (paper, eq.
# 3). The data that a step brings in is the sum over its slots (eq. 4).
#
# In the next figure the UAV hovers between three devices, two cells from each. Device 2 has only
# 1.5 units left:

# %%
from uavdh_lite.plotting import device_colour, draw_city

between = Mission(environment.city, (4, 8), ((4, 6), (4, 10), (6, 8)), (12, 12, 1.5), 30).state
fading = environment.draw_fading(between, np.random.default_rng(19))
after, outcome = environment.transition(between, np.array([HOVER]), fading)
snr_db = environment.snr_db(between, after.uav_cell, fading)[0]

# %% tags=["hide-input"]
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
# Each column is a slot, and the coloured box in it marks the device that sends. In slot 2 device 2
# is the loudest, but can send only the little data that it still has. Then it is empty, and the
# loudest of the others sends.
#
# Choosing the loudest uses luck: the more devices compete, the likelier it is that one of them is
# lucky. With five links of 0 dB in sight the loudest carries 1.31 units in a slot on average,
# and a single one 1.02. This is **multi-user diversity**. But the rule takes no account of how much
# data a device has, or of fairness: a device that is never the loudest never sends.
#
# In slot $i$ the UAV has flown $i/4$ of its move. In the next figure it flies east, towards the
# corner of a building. Fading is left out:

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
# The dots show where the UAV is in the four slots. By the table of notebook 2 the building is in
# the way in slot 1 only: the table has one answer for each *cell*; between two cells the nearer one
# decides, and halfway, in slot 2, the cell ahead.
#
# ## 3.6 Fly it yourself
#
# Now go back to the mission in the first picture. From the two white cells in the west the UAV sees
# both devices. Here is a plan. Try to do better:

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
# The plan brings all the data home, but greedy does not: it empties the nearer device, and from
# there it is a long way to the other. You had a map of the shadows to plan with. The agent has
# none, yet it, too, brings everything home.
#
# ## Recap
#
# - The state holds the positions, the data and the time left.
# - A step is a pure function of state, action and fading. The distribution of the next state
#   depends on the present state and the action alone, so our world is a Markov decision process.
# - The reward pays for data and charges for steps, interventions and a crash.
# - At most one device sends in a slot: the loudest of those with data left.
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
