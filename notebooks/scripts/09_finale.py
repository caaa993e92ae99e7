# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 9 · The finale
#
# A rule of a few lines has been ahead of our agents since notebook 0, and notebook 8 showed that
# they know some places by heart. **Can an agent beat the rule, and can it fly over a city that it
# has never seen?** Each point is the mean return of one pilot over the same 1000 missions over
# Manhattan; the dotted line is the rule.

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

# %% tags=["remove-cell"]
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.evaluation import bootstrap_interval
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.storage import data_folder, read_table

TITLES = {
    "random": "random",
    "manhattan_ddqn": "DDQN agent: reward alone",
    "greedy": "greedy: the rule",
    "agent": "imitation agent: all four gifts",
    "genie": "genie: knows rates without fading",
}
table = read_table(data_folder() / "runs/comparison-manhattan.csv.gz")
returns = {
    TITLES.get(name, name): table["return"][table["policy"] == name]
    for name in sorted(set(table["policy"]) - {"genie_data"})
}
ladder = dict(sorted(returns.items(), key=lambda row: row[1].mean()))
rule = ladder["greedy: the rule"]

# %% tags=["hide-input"]
def draw_ladder(ax, rows):
    for name, values in rows.items():
        mean, low, high = bootstrap_interval(values)
        colour = VERMILION if values is rule else BLUE
        ax.errorbar(mean, name, xerr=[[mean - low], [high - mean]], fmt="o", color=colour)
    ax.axvline(rule.mean(), color="grey", ls=":")
    ax.set(xlabel="return, mean of 1000 missions with its 95 % interval")

figure = Figure(figsize=(7.5, 0.9 + 0.4 * len(ladder)), layout="constrained")
draw_ladder(figure.subplots(), {k: v for k, v in ladder.items() if k != "random"})
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Give your agent a failsafe and a told layer, train again, and fly the last flight |
# | **What you'll learn** | Guarantee, tell, copy, learn: four ways to get knowledge into an agent |
# | **What you'll need** | Notebooks 0 to 8. 40 minutes to read, 60 seconds to run; the project takes an afternoon |
#
# The *DDQN agent* learned from reward alone. It brings home a little less than the rule. But we
# know where home is, and how the channel works. So let us give an agent what we know, one gift at a
# time, and begin with **yours**. (If you have not trained one, a trained one of the same kind flies
# in its place.)

# %%
import os

import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import FunctionPolicy, evaluate, fly
from uavdh_lite.one_file import VILLAGE, CentredMap, Settings, train
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.player import play
from uavdh_lite.plotting import draw_maps, draw_trajectory

torch.set_num_threads(1)
village, own = load_city("village"), "my_agent.safetensors"
shipped = data_folder() / "labs/village.safetensors"
yours = load_agent(own if os.path.exists(own) else shipped)
flown = evaluate(yours.environment, yours, VILLAGE, 1000, seed=0)
whose = "your agent" if os.path.exists(own) else "not yours, but the one that ships"
print(f"{whose}: landed {flown.end.landed.mean():.1%}, return {flown.returns.mean():.1f}")

# %% [markdown]
# ## 9.1 Guarantee
#
# Your agent learned from crashes how to land. A rule can do without them. From the map one can
# count the moves from each cell to the landing zone (`time_to_land`: these moves, **and one unit
# for landing itself**). An action is *too late* if, after it, that is more than the time left:

# %%
class Safe(Environment):
    def step(self, state, action, generator):
        return super().step(state, self.in_time(state, action), generator)

    def in_time(self, state, action):
        after = self.next_cell[state.city, state.uav_cell, action]
        too_late = self.time_to_land[state.city, after] > state.time_left - 1
        home = self.way_home[state.city, state.uav_cell]  # the first action of the shortest way
        return np.where(too_late, home, action)

# %% [markdown]
# Many drones have such a **failsafe**, also called a **shield**. Try it with a random pilot, and
# break it: forget the unit that landing takes.

# %%
from dataclasses import replace

class Forgetful(Safe):
    def in_time(self, state, action):
        return super().in_time(replace(state, time_left=state.time_left + 1), action)

for world in (Environment(village), Forgetful(village), Safe(village)):
    landed = evaluate(world, Random(0), VILLAGE, 500, seed=0).end.landed
    print(f"random in {type(world).__name__:<12} landed {landed.mean():6.1%}")
assert landed.all()

# %% [markdown]
# One forgotten unit, and flights crash over their own landing zone. With the right rule every
# flight lands, as long as the map is right and no wind slows the UAV. With it landing is no
# achievement, so we look at the return.
#
# Now give it to your agent. The left flight is the one of its thousand with the lowest return; on
# the right, the same mission with the failsafe:

# %% tags=["hide-input"]
def draw_flights(flights):
    figure = Figure(figsize=(8.8, 4.9), layout="constrained")
    for ax, (title, (world, flight)) in zip(figure.subplots(1, 2), flights.items()):
        draw_trajectory(ax, world, flight).set_title(title, fontsize="medium")
    return figure

safe, worst = Safe(village), flown.returns.argmin()
guarded = evaluate(safe, yours, VILLAGE, 1000, seed=0)
print(f"with the failsafe: return {guarded.returns.mean():.1f}")
draw_flights({"your agent": (yours.environment, flown.trajectory(worst)),
              "with the failsafe": (safe, guarded.trajectory(worst))})

# %% [markdown]
# ## 9.2 Tell
#
# The network sees buildings, and has to find out from reward what they do to radio signals. But
# with the equations of notebook 1 one can compute how much data a unit of time over each cell would
# bring: four slots at the rate without fading, and no more than the device has left. That is a
# picture, and a network that reads five pictures can read a sixth:

# %%
class ToldMap(CentredMap):
    def __init__(self, environment):
        super().__init__(environment)
        self.layers, cells = 6, range(self.size**2)
        self.data = 4 * np.stack([environment.rate_map(cell) for cell in cells])  # [device, UAV]

    def told(self, state):
        offered = np.minimum(self.data[state.device_cells], state.data_left[:, :, None, None])
        return offered.max(axis=1)  # (B, M, M): what the best device would send

    def __call__(self, state):
        maps, time = super().__call__(state)
        layer = np.zeros((len(state), 1, self.side, self.side))
        for k, (told, cell) in enumerate(zip(self.told(state), state.uav_cell)):
            row, col = (self.size - 1 - place for place in divmod(int(cell), self.size))
            layer[k, 0, row : row + self.size, col : col + self.size] = told
        return torch.cat([maps, torch.tensor(layer, dtype=torch.float32)], dim=1), time

# %%
told = ToldMap(safe)
missions = VILLAGE.sample(safe, 5, np.random.default_rng(12))
maps, _ = told(missions)
draw_maps({"buildings": maps[0, 2], "data left": maps[0, 3], "told": maps[0, 5]}, uav=(7, 7))

# %% [markdown]
# The told picture is darkest around the device, and almost white in the shadows of notebook 2. Now
# two new networks learn with your loop, for less than half the steps of your agent: one with the
# failsafe alone, one with both gifts. Predict: which curve rises faster, and will either beat the
# rule?

# %%
def best_actions(network, see):
    return FunctionPolicy(lambda state: network(*see(state)).detach().argmax(1).numpy())

def learn(see, steps=32_000):
    returns = []
    for step, network in train(Settings(steps=steps), see):
        if step % 4_000 == 0:
            flights = evaluate(see.environment, best_actions(network, see), VILLAGE, 200, seed=1)
            returns.append((step, flights.returns.mean()))
            print(f"\r{step:,} steps", end="", flush=True)
    return network, returns

pilots = {"failsafe": CentredMap(safe), "failsafe and told": told}
learned = {name: learn(see) for name, see in pilots.items()}

# %% tags=["hide-input"]
figure = Figure(figsize=(6, 3), layout="constrained")
ax = figure.subplots()
for name, one, style in (("greedy", Greedy(safe), ":"), ("your agent", yours, "-.")):
    ax.axhline(evaluate(safe, one, VILLAGE, 200, seed=1).returns.mean(), color="grey", ls=style,
               label=f"{name}, with the failsafe")
for (name, (_, returns)), style in zip(learned.items(), ("C1s--", "C0o-")):
    ax.plot(*zip(*returns), style, ms=4, label=name)
ax.set(xlabel="environment steps", ylabel="return")
ax.legend()
figure

# %% [markdown]
# Both rise, and from the start no flight crashes, but neither has reached the rule, nor your
# agent with the failsafe, which has learned for longer. (One run each: see 8.3 before you say which
# is better.) The agent with both gifts, beside greedy:

# %% tags=["hide-input"]
def beside_greedy(world):
    """A mission, flown by the agent with both gifts and by greedy."""
    best = best_actions(learned["failsafe and told"][0], ToldMap(world))
    mission = VILLAGE.sample(world, 5, np.random.default_rng(12))[[0]]
    flights = {name: fly(world, one, mission, np.random.default_rng(7)).trajectory(0)
               for name, one in (("failsafe and told", best), ("greedy", Greedy(world)))}
    return draw_flights({name: (world, flight) for name, flight in flights.items()})

beside_greedy(safe)

# %% [markdown]
# Compare the times below the two maps: with no crash to fear, going home saves only 0.2 units a
# step, perhaps too little for the network to notice (7.5).
#
# ### A second city
#
# The same two networks, over a city of the same size that they have never seen, without training:

# %% tags=["hide-input"]
other = City.from_text("hamlet", """
    . . . . B B . .
    . B . . B B . .
    . B . . . . . .
    . . . N . . B .
    . . . N . . B .
    B B . . . . . .
    . . . . . . L L
    . . B B . . L L
""")
# %% tags=["hide-input"]
bars = {}
for city in (village, other):
    world = Safe(city)
    flown = {"random": evaluate(world, Random(0), VILLAGE, 300, seed=2)}
    for name, see in pilots.items():
        act = best_actions(learned[name][0], type(see)(world))
        flown[name] = evaluate(world, act, VILLAGE, 300, seed=2)
    flown["greedy"] = evaluate(world, Greedy(world), VILLAGE, 300, seed=2)
    bars[city.name] = {name: flights.returns.mean() for name, flights in flown.items()}
    refused = {name: f"{flights.records()['safety_interventions'].mean():.1f}"
               for name, flights in flown.items()}
    print(f"actions refused in a mission over the {city.name}:", refused)

# %% tags=["hide-input"]
figure = Figure(figsize=(7.5, 2.6), layout="constrained")
for ax, (city, means) in zip(figure.subplots(1, 2, sharex=True), bars.items()):
    ax.barh(list(means), list(means.values()), color=["0.7", "C1", "C0", "grey"])
    ax.set(title=city, xlabel="return, 300 missions")
    ax.invert_yaxis()
figure

# %%
beside_greedy(Safe(other))

# %% [markdown]
# Over the village about half a minute of learning takes an agent most of the way from chance to the
# rule. Over the hamlet both are lost, although they see the map: they have only ever seen one city,
# and what they know by heart (8.5) is of no use there. What is *told* is right there, too, and yet
# that agent does worst of all, because it tries again and again what is refused.
# **Many cities** to learn in may help: see 9.5.
#
# ### The last flight
#
# Your agent with both gifts, greedy, and your agent of notebook 7: who brings home more, and who
# is home first? Change the number of the mission and fly again:

# %%
mission, best = missions[[2]], best_actions(learned["failsafe and told"][0], told)
last = {"failsafe and told": best, "greedy": Greedy(safe), "your agent of 7": yours}
flown = {name: fly(safe, one, mission, np.random.default_rng(7)) for name, one in last.items()}
play(safe, {name: flights.trajectory(0) for name, flights in flown.items()})

# %% [markdown]
# ## 9.3 Copy
#
# Two gifts are left, and they take longer. The *genie* is a planner that searches over whole
# flights and knows the rate of every link without fading. It is better than the agents at the top,
# but has to search anew for each mission.
#
# Can a network do at a glance what the genie does after a search? Train it on states and the
# genie's actions in them, with the **cross-entropy**, which is large where the genie's action
# seemed unlikely:
#
# $$L=-\log\pi(a_\text{genie}\mid s)$$
#
# This is **imitation learning**; the network is shown no rewards.
#
# ## 9.4 Learn on
#
# A copy makes small mistakes, which take it to states where it rarely saw the genie act (so ours
# also asks the genie in such states, notebook 12), and the genie plans without fading. Reward can
# teach some of the rest.
#
# The agent flies each mission several times. How much better is a flight than the mean of the
# others? That is its **advantage** $A$ (exercise 7.1 had an action's). If two flights return 30
# and 20, the first has $A=+10$, and its actions become more likely; the second has $A=-10$, and they
# become less likely.
#
# In essence, the loss is that of 9.3, weighted by $A$:
#
# $$L=-A\,\log\pi(a\mid s)$$
#
# Why not weight by the return itself? Then both flights would count as good. The mean is a
# **baseline**: it takes away luck that the flights share, and changes nothing on average.
#
# This is a **policy gradient** method (PPO is one, too). Ours is on-policy (6.1): after a few
# updates it needs new flights, whereas DDQN learns from a stored step again and again.
#
# The picture at the top shows the result over Manhattan, and this table the lead over the rule:

# %% tags=["hide-input"]
print(f"{'':<34}{'return':>8}{'ahead of greedy':>18}{'95 % interval':>20}")
for name, values in ladder.items():
    mean, low, high = bootstrap_interval(values - rule)
    interval = "" if values is rule else f"{low:+.2f} to {high:+.2f}"
    print(f"{name:<34}{values.mean():8.2f}{mean:+18.2f}{interval:>20}")

# %% [markdown]
# The *imitation agent* was given all four gifts and is **ahead of the rule**. ([The
# ladder](../docs/results/ladder.md) has several training runs of each agent.) Every gift has its
# price:
#
# | gift | what somebody had to know | what it cannot do |
# | --- | --- | --- |
# | guarantee | the map, and that it is right | collect data; it only lands |
# | tell | the map and the constants of the channel | say what to do |
# | copy | a planner: all equations and a search | be expected to beat its teacher |
# | learn on | nothing but the reward | give a good start |
#
# So *a comparison is fair only between pilots that were told the same things*.
#
# ## 9.5 A city that you have just typed
#
# What if an agent learns in *thousands* of cities, one of them drawn for each mission? The agent
# `any_city` did, with the four gifts. Type in a city. `L` is a landing zone, `N` a no-fly zone, `B`
# a building, and a dot a free cell:

# %%
any_city = load_agent("any_city")
mine = City.from_text("mine", """
    L L . . . . . . . .
    . . . B B . B B B .
    . . . B B . . . B .
    . B . . . . B . B .
    . B . B B . B . . .
    . . . B . . B B B .
    . N N . . . . . . .
    . N N . B B B . B .
    . . . . B . . . B .
    . . . . B B B . . .
""")

# %%
pilot = any_city.over(mine)
pilots = {"any_city": pilot, "greedy": Greedy(pilot.environment)}
flown = {}
for name, one in pilots.items():
    flown[name] = evaluate(pilot.environment, one, any_city.scenario, 300, seed=5)
    print(f"{name:<9} return {flown[name].returns.mean():5.1f} over 300 missions", flush=True)
play(pilot.environment, {name: each.trajectory(0) for name, each in flown.items()})

# %% [markdown]
# Nobody trained the agent for this city. A wall just north of the UAV is in the same place in the
# centred map of any city, and what it is told is computed from your map. In a single city either
# may win ([notebook 13](13_any_city.ipynb)).
#
# Could it fly a real UAV? Ours knows its exact position, the map and the data left, and meets no
# wind: the **sim-to-real gap**. One would put such errors into the evaluation, and train with the
# worst of them drawn at random (**domain randomisation**).
#
# ### Why learn at all?
#
# Over Manhattan, learning has gained little: whoever knows the channel and has time for the genie
# should let it fly. Learning may pay where a model of the channel, a good rule or the time to
# search is missing. Without a model this genie cannot plan, but an agent can still learn from
# reward; where a search takes too long, an agent pays for it beforehand, **for all missions**, and
# then decides quickly.
#
# ## 9.6 Your turn
#
# The course ends with your own [project](project/project.ipynb): choose a city or a reward, write
# down what you expect, train with three seeds, and report a paired interval against greedy on one
# page.
#
# And there is a **challenge**: a file with a function `policy(environment, state)` that gives an
# action for each state, a rule, a planner or your agent (with `--scenario village`), flies a
# *practice set* that is the same for everybody:
#
# ```text
# python -m uavdh_lite challenge score my_policy.py greedy --leaderboard board.json
# python -m uavdh_lite challenge score my_agent.safetensors greedy --scenario village
# python -m uavdh_lite challenge show board.json
# ```
#
# ## Recap
#
# - A rule that always holds need not be learned; what can be computed can be told to the agent; a
#   planner can be copied; reward teaches some of the rest.
# - An agent that learned in one city knows that city; one that learned in thousands could fly over
#   a new one.
# - Say what a pilot was told before you compare it, and give greedy's result beside every number.
#
# ## Exercises
#
# The [project](project/project.ipynb) is the exercise. [What you can do
# now](../docs/tutorials/what_you_can_do.md) has twelve questions for a self-test.
#
# Going further, in any order: [evaluation](10_evaluation.ipynb), [replay](11_replay.ipynb), [four
# ways to knowledge](12_four_ways.ipynb), then [any city](13_any_city.ipynb) and [a real
# city](14_a_real_city.ipynb).
