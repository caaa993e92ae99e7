# %% [markdown]
# # 9 · Scenarios
#
# The paper shows its agents in a handful of missions, drawn as arrows on the map. This notebook draws the
# same kinds of missions with ours, and asks of each: what did it do, and why? One agent a map, nothing is
# retrained.

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.evaluation import fly
from uavdh_lite.plotting import add_legend, draw_trajectory
from uavdh_lite.scenario import place

agents = {city: load_agent(city) for city in ("manhattan", "open_field")}
environments = {city: Environment(agent.city) for city, agent in agents.items()}

# %%
def mission(city, devices, data, flying_time, start, seed=0):
    agent = agents[city]
    state = place(agent.city, start, devices, data, flying_time, agent.scenario.max_devices)
    return fly(environments[city], agent, state, np.random.default_rng(seed), record=True)

def show(city, missions, titles, height=6.8):
    figure = Figure(figsize=(5.2 * len(missions), height), layout="constrained")
    for ax, flights, title in zip(np.ravel(figure.subplots(1, len(missions))), missions, titles):
        draw_trajectory(ax, environments[city], flights.trajectory(0))
        ax.set_title(title)
    add_legend(figure, max(int((m.start.data_initial > 0).sum()) for m in missions))
    return figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Fly the paper's missions, change one thing at a time, and read the agent's Q-values on the way |
# | **What you'll learn** | How one policy trades data for time, what it does when there is too little of it, and what luck changes |
# | **What you'll need** | Notebooks 0 and 3. 15 minutes to read, 20 seconds to run |
#
# ## 9.1 Open field: equal data, and a quarter at one device
#
# Two devices, one in the open and one far away. On the left both have the same data. On the right the
# far one has only a quarter of that:

# %%
DEVICES, START = [(6, 3), (10, 12)], (14, 1)
equal = mission("open_field", DEVICES, [20, 20], 45, START)
quarter = mission("open_field", DEVICES, [20, 5], 45, START)
show("open_field", [equal, quarter], ["equal data", "a quarter at the far device"])

# %% [markdown]
# The same network, the same places, the same time. What changes is what the detour is worth. In numbers:

# %%
for name, flights in (("equal", equal), ("quarter", quarter)):
    left = flights.end.data_left[0]
    print(f"{name:<8} flew {flights.steps[0]} of 45, left {left.astype(float).round(1).tolist()}, "
          f"landed {flights.end.landed[0]}")

# %% [markdown]
# ## 9.2 Manhattan with two to five devices
#
# The number of devices is not an input of the network: they are bright cells in a map, and a map can
# have any number of them.

# %%
PLACES = [(4, 8), (11, 8), (7, 14), (8, 1), (0, 12)]
flights = [mission("manhattan", PLACES[:k], [12] * k, 65, (0, 0)) for k in (2, 3)]
show("manhattan", flights, ["two devices", "three devices"])

# %%
flights = [mission("manhattan", PLACES[:k], [12] * k, 65, (0, 0)) for k in (4, 5)]
show("manhattan", flights, ["four devices", "five devices"])

# %% [markdown]
# ## 9.3 A device in the no-fly zone
#
# A device may stand where the UAV must not fly. It has to be served from outside:

# %%
inside = mission("manhattan", [(11, 2), (4, 8)], [10, 10], 60, (0, 0))
show("manhattan", [inside], ["one device in the no-fly zone"])

# %% [markdown]
# ## 9.4 Too little time
#
# The same mission with less and less flying time. Below some point the sensible thing is not to go:

# %%
times = (60, 35, 20)
flights = [mission("manhattan", PLACES[:3], [12] * 3, time, (0, 0)) for time in times]
show("manhattan", flights, [f"{time} units of time" for time in times], height=6.5)

# %%
times = range(6, 71, 4)
runs = [mission("manhattan", PLACES[:3], [12] * 3, time, (0, 0)) for time in times]
figure = Figure(figsize=(6, 3.4), layout="constrained")
ax = figure.subplots()
ax.plot(times, [r.end.collection_ratio[0] for r in runs], "o-", label="collected")
ax.plot(times, [r.end.landed[0] for r in runs], "s:", label="landed")
ax.set(xlabel="flying time at the start", ylabel="share")
ax.legend()
figure

# %% [markdown]
# ## 9.5 The same mission with other luck
#
# Only the fading differs. The agent sees it only through the data that is left, and reacts to that:

# %%
flights = [mission("manhattan", PLACES, [18] * 5, 60, (0, 0), seed) for seed in (1, 2)]
show("manhattan", flights, ["one draw of the fading", "another"])

# %%
many = [mission("manhattan", PLACES, [18] * 5, 60, (0, 0), seed) for seed in range(30)]
ratio = [m.end.collection_ratio[0] for m in many]
print(f"over 30 draws: collected {min(ratio):.1%} to {max(ratio):.1%}")
print("landed:", sum(bool(m.end.landed[0]) for m in many), "of 30")

# %% [markdown]
# ## 9.6 Q-values along a flight
#
# The network says for each action what it expects to earn from here, discounted. Along one flight:

# %%
agent = agents["manhattan"]
flown = mission("manhattan", PLACES[:3], [12] * 3, 60, (0, 0))
q = np.array([agent.q_values(state).numpy()[0] for state, *_ in flown.history])
figure = Figure(figsize=(8, 3.8), layout="constrained")
ax = figure.subplots()
for action, name in enumerate(ACTIONS):
    ax.plot(q[:, action], label=name, lw=2 if name == "land" else 1)
ax.set(xlabel="step", ylabel="Q-value")
ax.legend(ncols=3)
figure

# %% [markdown]
# The values fall as data is collected: they are about the *future*. The curves of the moves lie close
# together, because a wrong step can be undone in two. `land` is far below while there is something to
# collect, and rises above the others at the end.
#
# Can the values be trusted? Compare the largest Q-value with what was really earned from there on, with
# the rewards and the discount that the agent was trained with:

# %%
rewards = agent.recipe.rewards
earned, returns = 0.0, []
for _, _, outcome, _ in reversed(flown.history):
    earned = float(rewards(outcome)[0]) + agent.recipe.discount * earned
    returns.append(earned)
error = q.max(axis=1) - np.array(returns[::-1])
print(f"mean error {error.mean():+.2f}, largest {np.abs(error).max():.2f}, of values up to {q.max():.1f}")

# %% [markdown]
# ## Recap
#
# - One policy answers to devices, data, time and luck, because all of them are in the state.
# - What it leaves is what does not pay within the time and the reward it was trained with.
# - Q-values can be read, and checked against what follows.
#
# ## Exercises
#
# **1.** Find the least data at the far device of 9.1 for which the agent still goes there (collects more
# than half of it). Try 1 to 20.

# %%
def goes_far(data):
    flights = mission("open_field", DEVICES, [20, data], 45, START)
    return flights.end.data_left[0, 1] < data / 2

# %%
went = {data: bool(goes_far(data)) for data in (1, 2, 5, 10, 20)}
print(went)

# %% [markdown]
# **2.** Which step of the flight in 9.6 was the hardest to decide? (The smallest gap between the best and
# the second-best action.)

# %%
ordered = np.sort(q, axis=1)
gap = ordered[:, -1] - ordered[:, -2]
hardest = int(gap.argmin())
assert gap[hardest] >= 0
print(f"step {hardest}: {ACTIONS[q[hardest].argmax()]} by {gap[hardest]:.3f}")

# %% [markdown]
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section IV and its figures of trajectories.
# - **6 · Training** and **7 · Ablation**, how such an agent comes about.
