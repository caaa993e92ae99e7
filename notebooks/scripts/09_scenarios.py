# %% [markdown]
# # 9 · Scenarios
#
# The paper shows its agents in a handful of missions, drawn as arrows on the map. This notebook draws the
# same kinds of missions with ours, and asks of each: what did it do, and why? Each map has one agent, and nothing is
# trained again.

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

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import ACTIONS, LAND, Environment
from uavdh_lite.evaluation import fly
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.plotting import BLUE, ORANGE, add_legend, draw_trajectory
from uavdh_lite.missions import place

torch.set_num_threads(1)  # the networks here are small
agents = {city: load_agent(f"{city}_ddqn") for city in ("manhattan", "open_field")}
environments = {city: Environment(agent.city) for city, agent in agents.items()}

# %%
def mission(city, devices, data, flying_time, start, copies=1, seed=0, policy=None):
    """One mission, flown as often as `copies` says; only the fading differs."""
    agent = agents[city]
    state = place(agent.city, start, devices, data, flying_time, agent.scenario.max_devices)
    generator = np.random.default_rng(seed)
    return fly(environments[city], policy or agent, state[np.zeros(copies, int)], generator)

# %%
def brought_home(flights):
    return flights.end.collected * flights.end.landed

def show(city, missions, titles, height=6.8):
    figure = Figure(figsize=(5.2 * len(missions), height), layout="constrained")
    for ax, flights, title in zip(np.ravel(figure.subplots(1, len(missions))), missions, titles):
        draw_trajectory(ax, environments[city], flights.trajectory(0))
        ax.set_title(title)
    add_legend(figure, max(int((m.start.data_initial > 0).sum()) for m in missions))
    return figure

# %%
PLACES = [(4, 8), (11, 8), (7, 14), (8, 1), (0, 12)]
flights = [mission("manhattan", PLACES[:k], [12] * k, 65, (0, 0)) for k in (3, 5)]
show("manhattan", flights, ["three devices", "five devices"])

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Fly the paper's missions, change one thing at a time, and read the agent's Q-values on the way |
# | **What you'll learn** | How one policy trades data for time, what it does when there is too little of it, and what luck changes |
# | **What you'll need** | Notebooks 0, 3 and 5. 27 minutes to read, 20 seconds to run; 11 minutes of exercises |
#
# ## 9.1 Open field: equal data, and a quarter at one device
#
# Two devices, one near in the open, one further away in the street between the houses. On the left both
# have the same data. On the right the far one has only a quarter of that (the paper's figure shows an
# agent that serves the small device in passing):

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("one_quarter")

# %%
DEVICES, START = [(6, 3), (10, 12)], (14, 1)
equal = mission("open_field", DEVICES, [20, 20], 45, START)
quarter = mission("open_field", DEVICES, [20, 5], 45, START)
show("open_field", [equal, quarter], ["equal data", "a quarter at the far device"])

# %% [markdown]
# The same network, the same places, the same time. Both times it empties the near device first, and then flies towards
# the far one until it hears it well enough. With a quarter of the data there it turns back earlier. Is that the
# luck of this flight? Fly both 20 times, each time with other fading:

# %%
for name, data in (("equal", [20, 20]), ("quarter", [20, 5])):
    flights = mission("open_field", DEVICES, data, 45, START, copies=20)
    print(f"{name:<8} flew {flights.steps.min()} to {flights.steps.max()} of 45 units, "
          f"brought home {brought_home(flights).min():.0%} to {brought_home(flights).max():.0%}")

# %% [markdown]
# With a quarter the flights are shorter, most of them by more than the one drawn, and still bring home nearly all.

# %% [markdown]
# ## 9.2 Manhattan with two to five devices
#
# The number of devices is not an input of the network: they are cells in a map, and a map can have any
# number of them. The two missions at the top have 12 data units at each device.
#
# With three devices it flies down the avenue and turns east on the way. With five it goes down the west side first, because
# one of the new devices stands there, and adds a loop in the north. So a new device does not only add a detour: the whole
# route changes. How long do such flights take?

# %%
for k in (2, 3, 4, 5):
    flights = mission("manhattan", PLACES[:k], [12] * k, 65, (0, 0), copies=20)
    print(f"{k} devices: mean {flights.steps.mean():.0f} of 65 units, all 65 in {(flights.steps == 65).sum()} of 20, "
          f"brought home {brought_home(flights).mean():.1%}")

# %% [markdown]
# It brings home all of the data or nearly all, but these flights are not the shortest. With two devices they take longer than with three.
# And with five, many of them last until the time is up: the agent lingers next to a device that is empty.
#
# ## 9.3 A device in the no-fly zone
#
# A device may stand where the UAV must not fly. It has to be served from outside:

# %%
inside = mission("manhattan", [(11, 2), (4, 8)], [10, 10], 60, (0, 0))
show("manhattan", [inside], ["one device in the no-fly zone"])

# %% [markdown]
# It served the other device on its way, heard this one from the street that ends at the zone, and turned east
# at the end for what the other had left. That takes far less than the 52 units of time it used. Its arrows lie on top of
# each other, so the picture hides where the time went. Play the flight, or step through it:

# %%
play(environments["manhattan"], inside.trajectory(0))

# %% [markdown]
# It flew back and forth in that street, between the same cells. With little data left, the best actions are worth nearly
# the same, and small errors of the Q-values decide. And a step costs only 0.1 in the reward that it was trained with: it
# learned that wasted steps are cheap. Other luck tips it the other way:

# %%
flights = mission("manhattan", [(11, 2), (4, 8)], [10, 10], 60, (0, 0), copies=20)
print(f"flew {flights.steps.min()} to {flights.steps.max()} of 60 units, "
      f"brought home {brought_home(flights).min():.0%} to {brought_home(flights).max():.0%}")

# %% [markdown]
# Some of these flights are half as long, and some leave about a tenth of the data.
#
# ## 9.4 Too little time
#
# The mission with three devices, with less and less flying time. Each point is the mean of 20 flights with other fading, each
# band goes from the worst to the best of them:

# %%
times, greedy = range(6, 71, 4), Greedy(environments["manhattan"])
shares = {name: np.array([brought_home(mission("manhattan", PLACES[:3], [12] * 3, t, (0, 0), copies=20, policy=policy))
                          for t in times])
          for name, policy in (("agent", None), ("greedy", greedy))}

# %%
figure = Figure(figsize=(6.5, 3.6), layout="constrained")
ax = figure.subplots()
ax.axvspan(35, 70, color="0.93", label="trained on")
for (name, share), colour in zip(shares.items(), (BLUE, ORANGE)):
    ax.fill_between(times, share.min(1), share.max(1), color=colour, alpha=0.3, lw=0)
    ax.plot(times, share.mean(1), "o-", ms=4, color=colour, label=name)
ax.set(xlabel="flying time at the start, units", ylabel="collected and landed")
ax.legend()
figure

# %% [markdown]
# Within the times that it was trained on, it collects all or nearly all, like the greedy planner. Shorter missions are new to
# it. At 30 it does better than greedy. But at 14 and 18 it brings home nothing at all, where greedy still brings a tenth and a
# quarter. Between these and 30, agent and greedy are level. What does the agent do when time is short?

# %%
for t in (14, 18, 22):
    short = mission("manhattan", PLACES[:3], [12] * 3, t, (0, 0), copies=20)
    print(f"{t} units of time: landed in {short.end.landed.sum()} of 20; steps flown, mean {short.steps.mean():.0f}")

# %% [markdown]
# It does not crash: with so little time it lands at once, or after a few steps, although there is data within reach.
#
# ## 9.5 The same mission with other luck
#
# Only the fading differs. The agent sees it only through the data that is left, and reacts to that:

# %%
two = {f"draw {seed}": mission("manhattan", PLACES, [18] * 5, 60, (0, 0), seed=seed).trajectory(0) for seed in (1, 2)}
play(environments["manhattan"], two)

# %%
flights = mission("manhattan", PLACES, [18] * 5, 60, (0, 0), copies=100)
print(f"over 100 draws: brought home {brought_home(flights).min():.1%} to {brought_home(flights).max():.1%}, "
      f"in {flights.steps.min()} to {flights.steps.max()} units of time")

# %% [markdown]
# The two flights are the same at first, and part here in the east: a little more or less data left at a device may tip
# a decision. Over a hundred draws luck changes little of what is brought home: a flight is some
# two hundred slots, and most of their luck averages out.
#
# ## 9.6 Q-values along a flight
#
# The network says for each action what it expects to earn from here. Rewards that come later count less:
# each step of delay costs 5 % (the discount 0.95 of notebook 5). Along one flight:

# %%
agent = agents["manhattan"]
flown = mission("manhattan", PLACES[:3], [12] * 3, 60, (0, 0))
q = np.array([agent.q_values(step.state).numpy()[0] for step in flown.history])
figure = Figure(figsize=(8, 3.8), layout="constrained")
ax = figure.subplots()
for action, name in enumerate(ACTIONS):
    ax.plot(q[:, action], label=name, lw=2 if name == "land" else 1)
ax.set(xlabel="step", ylabel="Q-value, data units")
ax.legend(ncols=3)
figure

# %% [markdown]
# The values rise while the data comes nearer, and fall as it is collected: they are about the *future*.
# The curves of the moves lie apart by a few units while there is data to collect, and close together at the end, where
# a wrong step costs only time. The best two of them are often nearly equal: two ways to the same place. Outside the zone
# `land` is refused: it is `hover` and a penalty of 1. The network puts it much lower than that for most of the flight.
#
# Can the values be trusted? Compare the largest Q-value with what was really earned from there on, with
# the rewards and the discount that the agent was trained with:

# %%
rewards = agent.recipe.rewards_at(agent.training["steps"])
earned, returns = 0.0, []
for step in reversed(flown.history):
    earned = float(rewards(step.outcome)[0]) + agent.recipe.discount * earned
    returns.append(earned)
error = q.max(axis=1) - np.array(returns[::-1])
print(f"mean error {error.mean():+.2f}, largest {np.abs(error).max():.2f}, of values up to {q.max():.1f}")

# %% [markdown]
# In this flight the value of the best action is wrong by a data unit or two at most. But that is the action that was
# flown. What of the others? We know the true value of one of them: in the landing zone `land` ends the flight and earns
# nothing, so there it is worth exactly 0. Here is what two agents say of it, over the starts of 200 missions:

# %%
starts = agent.scenario.sample(agent.environment, 200, np.random.default_rng(0))
for name in ("manhattan_ddqn_early", "manhattan_ddqn"):
    said = load_agent(name).q_values(starts).numpy()
    print(f"{name:<21}land {said[:, LAND].mean():5.1f}, the best action {said.max(axis=1).mean():5.1f}")
print(f"after this flight, in the zone again: land {q[-1, LAND]:.2f}")

# %% [markdown]
# At the start it is far off, and further in the agent that trained longer. At the end of the flight, where `land` is
# what it does, it is right. The reason may be this: late in training the policy hardly explores. With its last
# temperature of 0.1, an action that lies 5 below the best is chosen with the chance $e^{-50}$. So `land` is hardly
# ever tried at a start, and what is not tried is not corrected. But the network goes on changing, and while the value
# of the moves rises, it carries `land` along. It does no harm as long as `land` stays below the best: to choose an action,
# only the order counts. In the short missions of 9.4 it does not stay below, and there the agent lands too soon. An
# overvalued `land` may be the reason.
#
# ## Recap
#
# - One policy reacts to devices, data and time, because these are in the state. Of luck it sees only the data that is left.
# - When there is too little time it leaves data, and not always the data that pays least: its behaviour is learned, and not
#   exact.
# - Q-values can be read, and checked against what follows.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/09_scenarios`](exercises/09_scenarios/09_scenarios.ipynb).
#
# **1.** How much must the far device of 9.1 hold for the agent to serve it? Print the collected share of it
# for 1 to 20 data units, as the mean of 20 flights each.

# %%
def far_share(data):
    left = mission("open_field", DEVICES, [20, data], 45, START, copies=20).end.data_left[:, 1]  # of the second device
    return 1 - float(left.mean()) / data

# %%
shares = {data: round(far_share(data), 2) for data in range(1, 21)}
assert shares[20] > 0.9
print(shares)

# %% [markdown]
# Even for a single unit it comes near enough: there is time for it, and a step costs a tenth of a unit in the
# reward that it was trained with. But there is no clear limit: of some small amounts it leaves a part, of smaller ones
# nothing. The behaviour is learned, not computed, and need not be steady in the amount.
#
# **2.** Which step of the flight in 9.6 was the hardest to decide? (The smallest gap between the best and
# the second-best action.)

# %%
ordered = np.sort(q, axis=1)
gap = ordered[:, -1] - ordered[:, -2]
hardest = int(gap.argmin())
best, second = np.argsort(q[hardest])[:-3:-1]
assert np.isclose(q[hardest, best] - q[hardest, second], gap[hardest])
print(f"step {hardest}: {ACTIONS[best]} before {ACTIONS[second]} by {gap[hardest]:.3f}")

# %% [markdown]
# The hardest step need not be an important one: the gap is small, too, where two ways are equally good.

# %% [markdown]
# ## Further reading
#
# - Bayerlein et al., Globecom 2020, section IV and its figures of trajectories.
# - **6 · Training** and **7 · Ablation**, how such an agent comes about.
