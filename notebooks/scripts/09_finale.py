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
# A rule of a few lines has been ahead of our agents since notebook 0, and notebook 8 showed that they
# know some places by heart. **Can an agent beat the rule, and can it fly over a city that it has never
# seen?** Each point is the mean return of one pilot over the same 1000 missions over Manhattan; the
# grey line is the rule.

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
# | **What you'll do** | Build a failsafe and a told layer for your own agent, train it again, and fly the last flight of the course |
# | **What you'll learn** | Guarantee, tell, copy, learn: four ways to get knowledge into an agent, and what each of them costs |
# | **What you'll need** | Notebooks 0 to 8. 40 minutes to read, 60 seconds to run; the project takes an afternoon |
#
# The *DDQN agent* learned from reward alone, with the recipe `lite`. It brings home about as much as
# the paper's agent did over its own map, and a little less than the rule. It paid for its knowledge
# with crashes and millions of steps. But for our cities the channel can be computed. So let us give
# an agent what we know, one gift at a time, and begin with **yours**. Here is how it flies so far (if
# you have not trained one, `any_city`, which you will meet in 9.5, flies in its place):

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

torch.set_num_threads(1)
village, own = load_city("village"), "my_agent.safetensors"
yours = load_agent(own if os.path.exists(own) else "any_city").over(village)
missions = VILLAGE.sample(yours.environment, 5, np.random.default_rng(12))
flight = fly(yours.environment, yours, missions, np.random.default_rng(0)).trajectory(0)
play(yours.environment, flight)

# %% [markdown]
# ## 9.1 Guarantee
#
# Your agent learned from crashes how to land. A rule can do without them. From the map one can count
# the moves from each cell to the landing zone (`time_to_land`: these moves, **and one unit for
# landing itself**). An action is *too late* if, after it, that is more than the time left:

# %%
class Safe(Environment):
    def step(self, state, action, generator):
        return super().step(state, self.in_time(state, action), generator)

    def in_time(self, state, action):
        after = self.next_cell[state.city, state.uav_cell, action]
        too_late = self.time_to_land[state.city, after] > state.time_left - 1
        return np.where(too_late, self.way_home[state.city, state.uav_cell], action)

# %% [markdown]
# Many drones have such a **failsafe**; a rule that corrects an agent's actions is also called a
# **shield**. Try it with the worst pilot, and break it: forget the unit that landing takes.

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
# One forgotten unit, and flights crash over their own landing zone. With the right rule every flight
# lands, by construction, as long as the map is right and no wind slows the UAV. So from here on
# "landed 100 %" is no achievement of the agent, and we look at the return.
#
# ## 9.2 Tell
#
# The network sees buildings, and has to find out from reward what they do to radio signals. But who
# knows the city and the constants of notebook 1 can compute how much data a unit of time over each
# cell would bring: four slots at the mean rate, and no more than the device has left. That is a
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
from uavdh_lite.plotting import draw_maps

told = ToldMap(Safe(village))
maps, _ = told(missions)
draw_maps({"buildings": maps[0, 2], "data left": maps[0, 3], "told": maps[0, 5]}, uav=(7, 7))

# %% [markdown]
# The told picture is bright around the devices and along the streets, and dark in the shadows of
# notebook 2. Now your agent learns again, with the loop that you wrote (as it stands in the small
# file), first with the failsafe alone and then with both gifts. Predict: which curve rises faster, and
# will either beat the rule?

# %%
def learn(see, steps=40_000):
    returns = []
    for step, network in train(Settings(steps=steps), see):
        if step % 4_000 == 0:
            with torch.no_grad():
                best = FunctionPolicy(lambda state: network(*see(state)).detach().argmax(1).numpy())
                flights = evaluate(see.environment, best, VILLAGE, 200, seed=1)
            returns.append((step, flights.returns.mean()))
            print(f"\r{step:,} steps", end="", flush=True)
    return network, returns

pilots = {"failsafe": CentredMap(Safe(village)), "failsafe and told": told}
learned = {name: learn(see) for name, see in pilots.items()}

# %% tags=["hide-input"]
figure = Figure(figsize=(6, 3), layout="constrained")
ax = figure.subplots()
greedy = evaluate(Safe(village), Greedy(Safe(village)), VILLAGE, 200, seed=1).returns.mean()
for (name, (_, returns)), style in zip(learned.items(), ("C1s--", "C0o-")):
    ax.plot(*zip(*returns), style, ms=4, label=name)
ax.axhline(greedy, color="grey", ls=":", label="greedy")
ax.set(xlabel="environment steps", ylabel="return")
ax.legend()
figure

# %% [markdown]
# Both learn faster than in notebook 7, because no crash disturbs the Q-values any more. What the agent
# is told it need not find out: that may help it at first. (One run each: see 8.3 before you say which
# is better.)
#
# ### A second city
#
# The same two networks, over a city that they have never seen, without training:

# %%
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
        over, network = type(see)(world), learned[name][0]
        act = FunctionPolicy(lambda state: network(*over(state)).detach().argmax(1).numpy())
        flown[name] = evaluate(world, act, VILLAGE, 300, seed=2)
    flown["greedy"] = evaluate(world, Greedy(world), VILLAGE, 300, seed=2)
    bars[city.name] = {name: flights.returns.mean() for name, flights in flown.items()}

# %% tags=["hide-input"]
figure = Figure(figsize=(7.5, 2.6), layout="constrained")
for ax, (city, means) in zip(figure.subplots(1, 2, sharex=True), bars.items()):
    ax.barh(list(means), list(means.values()), color=["0.7", "C1", "C0", "grey"])
    ax.set(title=city, xlabel="return, 300 missions")
    ax.invert_yaxis()
figure

# %% [markdown]
# Over its own village half a minute of learning brings an agent near the rule. Over the hamlet it flies
# worse than chance, although it sees the map: it has only ever seen one city, and what it knows by
# heart (8.5) is wrong there. What it was *told* is right there, too, but in training it could do
# without. Greedy looks up its ways in any map. What would help? **Many cities** to learn in: see 9.5.
#
# ### The last flight
#
# Your agent with both gifts, greedy, and your agent of notebook 7: one mission, side by side. Who brings
# home more, and who needs less time? Change the number of the mission and fly again:

# %%
mission, world = missions[[0]], Safe(village)
network = learned["failsafe and told"][0]
best = FunctionPolicy(lambda state: network(*told(state)).detach().argmax(1).numpy())
last = {"guarded and told": best, "greedy": Greedy(world), "your agent of 7": yours.over(village)}
flown = {name: fly(world, one, mission, np.random.default_rng(7)) for name, one in last.items()}
play(world, {name: flights.trajectory(0) for name, flights in flown.items()})

# %% [markdown]
# ## 9.3 Copy
#
# Two gifts are left, and they take more than a minute. The *genie* is a planner that searches over
# whole flights and knows the rate of every link without fading. It is better than any agent here, but
# it has to search anew for each mission, and it needs the formulas of the channel.
#
# Can a network do at a glance what the genie does after a search? Let the genie fly, write down its
# action in each state, and train a network on these examples with the **cross-entropy**, a measure of
# how surprised the network is by the genie's action:
#
# $$L=-\log\pi(a_\text{genie}\mid s)$$
#
# This is **imitation learning**, or *behavioural cloning*; rewards play no part in it.
#
# ## 9.4 Learn on
#
# A copy makes small mistakes, which take it to states where it never saw the genie act. And the genie
# is not perfect, either: it plans without fading. Reward can teach what the genie does not know. The
# agent flies each mission several times and compares each return with the mean of the others. The
# difference is the flight's **advantage** $A$: with returns of 30 and 20, the actions of the first
# flight become more likely ($A=+10$) and those of the second less ($A=-10$). On average taking the
# mean away changes nothing about which way to go, because it does not depend on the action; it only
# takes away luck that all flights share. The loss is that of 9.3, weighted by $A$:
#
# $$L=-A\,\log\pi(a\mid s)$$
#
# A method that changes the probabilities themselves is a **policy gradient** method (PPO is the best
# known). It is on-policy (6.1) and uses a flight only once or a few times, whereas DDQN learns from a
# stored step again and again, so it should be more **sample-efficient** ([a map of the
# field](../docs/tutorials/map_of_the_field.md)).
#
# The picture at the top shows the result over Manhattan, and this table by how much each pilot is
# ahead of the rule, mission by mission:

# %% tags=["hide-input"]
print(f"{'':<34}{'return':>8}{'ahead of greedy':>18}{'95 % interval':>20}")
for name, values in ladder.items():
    mean, low, high = bootstrap_interval(values - rule)
    interval = "" if values is rule else f"{low:+.2f} to {high:+.2f}"
    print(f"{name:<34}{values.mean():8.2f}{mean:+18.2f}{interval:>20}")

# %% [markdown]
# The *imitation agent*, `manhattan` in the library, was given all four gifts and is **ahead of the
# rule**. [The ladder](../docs/results/ladder.md) has all pilots with several training runs each. Every
# gift has its price:
#
# | gift | what somebody had to know | what it cannot do |
# | --- | --- | --- |
# | guarantee | the map, and that it is right | collect data; it only lands |
# | tell | the map and the constants of the channel | say what to do: the agent still has to learn that |
# | copy | a planner, that is, all equations and a search | be expected to beat its teacher |
# | learn on | nothing but the reward | learn quickly from nothing, because few flights of a random agent are good |
#
# So the order of the pilots does not mean that good methods beat bad ones: *a comparison is fair only
# between pilots that were told the same things*. Even the genie does not collect everything (3.4), so
# **do not expect 100 % from any pilot**.
#
# ## 9.5 A city that you have just typed
#
# What if an agent learns in *thousands* of cities, with one of them drawn for each mission? The agent
# `any_city` learned in 3000, with the four gifts, and hardly knows them by heart: its return is about
# 2 units above greedy's both there and in new cities. Type in a city, up to 16 × 16. `L` is a landing
# zone, `N` a no-fly zone, `B` a building, and a dot a free cell:

# %%
from uavdh_lite.checkpoint import load_agent

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
    print(f"{name} flies 300 missions …", flush=True)
    flown[name] = evaluate(pilot.environment, one, any_city.scenario, 300, seed=5)
play(pilot.environment, {name: each.trajectory(0) for name, each in flown.items()})

# %%
for name, each in flown.items():
    print(f"{name:<9} return {each.returns.mean():5.1f} over 300 missions in your city")

# %% [markdown]
# Nobody trained the agent for this city. A wall north of the UAV looks the same in the centred map of
# any city, and what it is told is computed from your map. On average over many cities it is ahead of
# greedy, but in a single city either may win.
#
# Could the agent fly a real UAV? Our UAV knows its exact position, the map and the data left, and meets
# no wind: that is the **sim-to-real gap**. Before a real flight, put such errors into the evaluation
# one at a time, see which costs most, and train with it drawn at random (**domain randomisation**).
#
# ### Why learn at all?
#
# Over our city, learning has gained little. Whoever knows the channel and has a genie should let the
# genie fly. Learning pays where a model of the channel, a good rule or the time to search is missing:
# without a model no genie can plan, but an agent can still learn from reward; where a search takes too
# long, an agent pays for it beforehand, **for all missions**, and then decides at once. Over our city
# nothing is missing, which makes it a good place to study the method.
#
# ## 9.6 Your turn
#
# The course ends with your own [project](project/project.ipynb). Choose a city or a reward, write
# down what you expect, train with three seeds, and report, on one page, a paired interval against
# greedy. The project's notebook is a template that runs as it is; two finished projects come with
# it, one better than the other.
#
# And there is a **challenge**. Write a pilot, a file with a function `policy(environment, state)`
# that gives an action for each state: a rule, a planner or your agent (with `--scenario village`). Your score is its result on the *practice set*, which is the same for
# everybody:
#
# ```text
# python -m uavdh_lite challenge score my_policy.py greedy --leaderboard board.json
# python -m uavdh_lite challenge show board.json
# ```
#
# A function that returns `Greedy(environment).act(state)` is greedy, the pilot to beat.
#
# ## Recap
#
# - A rule that always holds need not be learned; what can be computed can be told to the agent; a
#   planner can be copied; reward teaches the rest.
# - Count everything that takes time, also the landing.
# - An agent that learned in one city knows that city; one that learned in thousands can fly over one
#   that was typed a minute ago.
# - Say what a pilot was told before you compare pilots, and give greedy's result beside every number.
#
# ## Exercises
#
# The [project](project/project.ipynb) is the exercise of this notebook. [What you can do
# now](../docs/tutorials/what_you_can_do.md) has twelve questions for a self-test.
#
# Going further: [evaluation](10_evaluation.ipynb), [replay](11_replay.ipynb), [four ways to
# knowledge](12_four_ways.ipynb), [any city](13_any_city.ipynb) and [a real
# city](14_a_real_city.ipynb), in any order, except that 13 needs 10 and 12, and 14 needs 13.
