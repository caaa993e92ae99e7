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
# A rule of a few lines has been ahead of our agent since notebook 0. And when notebook 8 moved the
# landing zones, the agent was lost, because it knew some places by heart. **Can an agent beat the
# rule, and can an agent fly over a city that it has never seen?** Each point below is the mean
# return of one pilot over the same 1000 missions. The grey line marks the rule. The labels on the
# left name the pilots or say what they were given; sections 9.2 to 9.5 explain these labels.

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
    "manhattan_ddqn": "DDQN, strengthened",
    "greedy": "greedy: the rule",
    "agent": "told, guarded, copying, learning",
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
# | **What you'll do** | Give an agent what we know until it is ahead of the rule, let another fly over a city that you type yourself, and begin a project of your own |
# | **What you'll learn** | Guarantee, tell, copy, learn: four ways to get knowledge into an agent, and what each of them costs |
# | **What you'll need** | Notebooks 0 to 8. 40 minutes to read, 40 seconds to run; the project takes an afternoon |
#
# ## 9.1 Where we stand
#
# The DDQN agent, strengthened by the recipe `lite`, brings home about as much as the paper's agent
# did over its own map, and a little less than a rule that needs no training.
#
# Our agent learned from reward alone. It sees the street map, like the rule, but nobody told it
# what the map means: how moves work, which routes are short, what a wall does to radio signals. It
# paid for its knowledge with crashes and with millions of steps. For our city, however, the channel
# can be computed, so let us give the agent what we know, one gift at a time.
#
# ## 9.2 Guarantee
#
# The DDQN agent learned from crashes how to land. A rule can do without crashes: from the map one
# can count the moves from each cell to the nearest landing zone, and an action is *too late* if,
# after it, the way home takes longer than the time left. The **failsafe** replaces such an action
# with the first move home. Many drones have such a function, called *return to home*; a rule that
# corrects an agent's actions in this way is called a **shield**. Does the failsafe work for any
# pilot? Let us try the worst one:

# %%
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.scenario import find_scenario

# %%
city, scenario = City.load("manhattan"), find_scenario("manhattan")
worlds = {"as in the paper": Environment(city), "with a failsafe": SafeEnvironment(city)}
for name, world in worlds.items():
    flights = evaluate(world, Random(), scenario, 500, seed=0)
    print(f"random, {name}: landed {flights.metrics()['landed'].mean:.0%}")
assert flights.end.landed.all()

# %% [markdown]
# With the failsafe every flight lands, by construction, as long as the map is right and no wind
# slows the UAV. A skill that a rule guarantees need not be learned, and no crash reward of −150
# disturbs the Q-values any more. From here on, therefore, "landed 100 %" is no achievement of the
# agent, and we shall look at the return.
#
# ## 9.3 Tell
#
# The network sees buildings, and has to find out from reward what they do to radio signals. But
# anyone who knows the city and the constants of notebook 1 can compute, before the flight, roughly
# how much data a unit of time over each cell would bring. The result is a picture, and a network
# that reads five pictures can also read a sixth:

# %%
from uavdh_lite.beyond.told import ToldObservation
from uavdh_lite.missions import Mission

world = SafeEnvironment(city)
state = Mission(city, (8, 4), [(4, 7), (11, 11)], [15, 6], flying_time=50).state
expected_data = ToldObservation(world).told(state)[0, 0].reshape(16, 16)

# %%
figure = Figure(figsize=(5, 4), layout="constrained")
ax = figure.subplots()
picture = ax.imshow(expected_data, cmap="magma")
ax.plot([7, 11], [4, 11], "wx", ms=9)
ax.plot(4, 8, "w^", ms=8)
ax.set(xlabel="column", ylabel="row", title="triangle: UAV, crosses: devices")
figure.colorbar(picture, label="data units in one unit of time, without fading")
figure

# %% [markdown]
# The picture is bright around each device and along the streets, and dark where a building is in
# the way, in the shadows of notebook 2. The spot around the second device is dimmer than the other,
# because no cell can bring more than the 6 units that this device holds. The agent is given two
# more pictures of this kind, which show how far home is from each cell and how far each cell is
# from the UAV.
#
# ## 9.4 Copy
#
# The *genie* is a planner that searches over whole flights and knows, for every link, the rate
# without fading, which is a little lower than the mean rate of notebook 1. It lets many flights
# grow step by step, drops those that cannot get home in time or can no longer become the best, and
# keeps, among flights in the same cell with the same devices emptied, only the few that have
# collected most. On one core this takes about a twentieth of a second for a mission over our city,
# but several seconds over `metropolis`, which has 50 × 50 cells and up to ten devices.
#
# The genie is better than any agent here. But it has to search anew for each mission, and it needs
# the formulas of the channel. Can a network learn to do at a glance what the genie does after a
# search? Let the genie fly, write down its action in each state, and train a network on these
# examples. The network gives a score for each action, a softmax turns scores into probabilities,
# and the loss is the **cross-entropy**, a measure of how surprised the network is by the genie's
# action:
#
# $$L=-\log\pi(a_\text{genie}\mid s)$$
#
# This is **imitation learning**, or *behavioural cloning*. Its training loop is that of notebook 5
# with a different loss; rewards play no part in it.
#
# ## 9.5 Learn on
#
# A copy makes small mistakes, which can take the copy to states in which it never saw the genie
# act; there it makes larger mistakes. Asking the genie what to do in those states is meant to
# remedy this (notebook 12). And the genie itself is not perfect: it plans without fading, so it
# does not reckon with luck. Reward can teach what the genie does not know.
#
# The agent therefore now learns from its own flights. It flies each mission several times, drawing
# its actions from its probabilities, and compares the return of each flight with the mean return of
# the others. The difference is the flight's **advantage** $A$. Suppose two flights of one mission
# bring returns of 30 and 20. The first has $A=+10$, so each of its actions becomes more likely. The
# second has $A=-10$, so each of its actions becomes less likely, even a good one; over many flights
# such errors average out. The loss is that of 9.4, weighted by $A$:
#
# $$L=-A\,\log\pi(a\mid s)$$
#
# A method that changes the probabilities themselves in this way is called a **policy gradient**
# method. (As in *proximal policy optimisation*, PPO, our program limits how far a probability may
# change.)
#
# Such a method is on-policy (6.1): it uses a flight only once or a few times, because the actions
# of an older agent were drawn from other probabilities. DDQN learns from a stored step again and
# again, so it should be more **sample-efficient**. [A map of the
# field](../docs/tutorials/map_of_the_field.md) shows the place of PPO, SAC and the other
# **actor–critic** methods, which learn values as well.
#
# ## 9.6 The ladder
#
# Here are all the pilots on the same 1000 missions, each compared with the rule mission by mission:

# %%
print(f"{'':<34}{'return':>8}{'ahead of greedy':>18}{'95 % interval':>20}")
for name, values in ladder.items():
    mean, low, high = bootstrap_interval(values - rule)
    interval = "" if values is rule else f"{low:+.2f} to {high:+.2f}"
    print(f"{name:<34}{values.mean():8.2f}{mean:+18.2f}{interval:>20}")

# %% [markdown]
# The agent that was given all four gifts is **ahead of the rule**, and the interval for its lead
# does not contain 0. (This agent comes from a single training run.) It is called `manhattan` in the
# library and *imitation agent* in the README; its teacher is the genie with a narrower search. On
# [the ladder](../docs/results/ladder.md), over 3000 missions, guarded agents that learned from
# reward alone are level with the rule; those that were also told what can be computed lead by 0.4
# units of return, a copy by 1.2, and agents with all four gifts by 1.4. Here `manhattan`, greedy
# and the DDQN agent, all with the failsafe, fly the mission of section 0.3 with 40 units of time:

# %%
from uavdh_lite.player import play
from uavdh_lite.policies import find_policy

mission = Mission(city, (0, 0), [(0, 12), (8, 1), (12, 14)], [12, 15, 18], flying_time=40)
names = ("manhattan", "greedy", "manhattan_ddqn")
play(world, {name: mission.fly(world, find_policy(name, world)).trajectory(0) for name in names})

# %% [markdown]
# The agent with four gifts collects everything, whereas each of the others leaves one device's data
# behind. We picked this mission to show a difference. With 35 units of time, as in notebook 0, the
# agent is no better than greedy, and the DDQN agent is ahead of both. In two thirds of the 1000
# missions above, the returns of the agent and greedy are within one unit of each other.
#
# Each gift has its price:
#
# | gift | what somebody had to know | what it cannot do |
# | --- | --- | --- |
# | guarantee | the map, and that it is right | collect data; it only lands |
# | tell | the map and the constants of the channel | say what to do: the agent still has to learn that |
# | copy | a planner, that is, all equations and a search | be expected to beat its teacher |
# | learn on | nothing but the reward | learn quickly from nothing, because few flights of a random agent are good |
#
# Thus the order of the pilots on the ladder does not mean that good methods beat bad ones. The
# pilots differ in what they were told, and *a comparison is fair only between pilots that were told
# the same things*.
#
# Even the genie does not collect everything, for the reasons given in 3.4. **So do not expect 100 %
# from any pilot.** The genie is not an upper bound, but the distance to it says more than the
# distance to 100 %. [Notebook 12](12_four_ways.ipynb) compares agents with and without each gift,
# in runs with three seeds.
#
# ## 9.7 A city that you have just typed
#
# The agent of notebook 8 had learned some places by heart. What if an agent learns in *thousands*
# of cities, with one of them drawn for each mission? The agent `any_city` learned in 3000 cities,
# with the four gifts. It hardly knows these cities by heart: its return is about 2 units above
# greedy's both there and in new cities. Type in a city, and let the agent fly over it. `L` is a
# landing zone, `N` a no-fly zone, `B` a building, and a dot a free cell. Any square up to 16 × 16
# will do:

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
# Nobody trained the agent for this city. The network sees the walls and zones around the UAV in the
# centred map of the paper, in which a wall north of the UAV looks the same in any city. And the
# pictures of 9.3 are computed from your city's map. Is the agent ahead of greedy here? On average
# over many cities it is, but in a single city either may win.
#
# Could the agent fly a real UAV? The difference between a simulator and the street is called the
# **sim-to-real gap**. Our UAV knows its exact position, the map and the data left, meets no wind,
# and saves time where a real UAV saves energy. Before a real flight, put realistic errors into the
# evaluation one at a time (a position one cell off, a building missing from the map, stronger
# fading), see which error costs most, and train with that error drawn at random (**domain
# randomisation**).
#
# ### Why learn at all?
#
# Over our city, learning has gained us little. Greedy does not search, decides at once and flies
# over any city, and the agent that learned from reward alone is a little behind greedy. Agents
# with four gifts earn 1.4 units more than greedy. But the genie is further ahead, and over our city
# it is quick. Whoever knows the channel and has a genie should let the genie fly.
#
# Learning pays where a model of the channel, a good rule or the time to search is missing. Without
# a model, no genie can plan and nobody can compute expected data, but an agent can still learn from
# reward, over millions of real steps or in a simulator fitted to measurements (notebook 14). Where
# nobody knows a good rule, an agent may find its own. Where a search takes too long, as it may over
# `metropolis`, an agent pays for it beforehand, in training and **for all missions**, and then
# decides at once. Over our city nothing is missing, which makes it a good place to study the
# method: the genie's flights show how much can be achieved.
#
# ## 9.8 Your turn
#
# The course ends with your own [project](project/project.ipynb). Choose a city or a reward, write
# down what you expect, train with three seeds, and report, on one page, a paired interval against
# greedy. The project's notebook is a template that runs as it is; two finished projects come with
# it, one better than the other.
#
# And there is a **challenge**. Write a pilot, a file with a function `policy(environment, state)`
# that gives an action for each state: a rule, a planner or the network of exercise 7.1 (with
# `--scenario village`). Your score is its result on the *practice set*, which is the same for
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
# - With all four gifts, an agent beats the rule in its own city. With reward alone, an agent comes
#   close to the rule over Manhattan, and over the open field its return is a little higher than the
#   rule's.
# - An agent that learned in thousands of cities can fly over one that was typed a minute ago.
# - Say what a pilot was told before you compare pilots, and give greedy's result beside every
#   number.
#
# ## Exercises
#
# The [project](project/project.ipynb) is the exercise of this notebook. [What you can do
# now](../docs/tutorials/what_you_can_do.md) has twelve questions for a self-test.
#
# Going further: [evaluation](10_evaluation.ipynb), [replay](11_replay.ipynb), [four ways to
# knowledge](12_four_ways.ipynb), [any city](13_any_city.ipynb) and [a real
# city](14_a_real_city.ipynb), in any order, except that 13 needs 10 and 12, and 14 needs 13.
