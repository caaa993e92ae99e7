# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 12 · Four ways to knowledge
#
# The paper's agents learn from reward alone: they are told nothing but the map, and find out the rest by flying. How else
# can knowledge get into an agent? Besides letting it **learn** from reward, you can **guarantee** something by a rule,
# **tell** the agent something as one more layer of the map, or let it **copy** a planner. The figure compares agents that
# got their knowledge in one or more of these ways.

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

from uavdh_lite.plotting import BLUE, GREEN, ORANGE, PINK, VERMILION
from uavdh_lite.storage import data_folder, read_table

WAYS = {
    "learn": ORANGE,
    "guarantee_learn": VERMILION,
    "tell_learn": GREEN,
    "guarantee_tell_learn": BLUE,
    "copy": ORANGE,
    "guarantee_copy": VERMILION,
    "tell_copy": GREEN,
    "guarantee_tell_copy": BLUE,
    "guarantee_tell_copy_learn": PINK,
}

def last_returns(study, way):
    runs = [(study["variant"] == way) & (study["seed"] == seed) for seed in range(3)]
    return [study["return"][run][-1] for run in runs]

def draw_ways():
    study = read_table(data_folder() / "runs/four_ways-manhattan.csv.gz")
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    ax = figure.subplots()
    for place, (way, colour) in enumerate(WAYS.items()):
        ax.plot(last_returns(study, way), [place] * 3, "o", color=colour, ms=8, alpha=0.8)
    ax.set(xlabel="return, mean of 1000 missions; a point is a run", yticks=range(len(WAYS)))
    ax.set_yticklabels([way.replace("_", " + ") for way in WAYS])
    ax.invert_yaxis()
    ax.grid(axis="x", alpha=0.3)
    return figure

# %%
draw_ways()

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Watch a rule bring a random policy home, look at maps of what can be computed, follow a planner, and compare agents that were told much or little |
# | **What you'll learn** | How a guarantee, told layers, copied moves and reward each put knowledge into an agent, what each costs, and what each is worth |
# | **What you'll need** | The course, notebooks 0 to 9. 45 minutes to read, 30 seconds to run; 27 minutes of exercises |
#
# Each row of the figure shows one recipe in three recorded runs over Manhattan, one for each seed.
# In the upper four rows the agents learn from reward, in the next four they copy a planner, and in
# the last one they copy first and then learn from reward. All runs within a group are equally long. The agents that learn from reward without a guarantee are trained with the
# penalties of the recipe `lite` of notebook 7, and half of their flights begin in mid-air. The
# further right a point lies, the higher the return. The rest of this notebook explains the words to
# the left of the rows.
#
# ## 12.1 Guarantee: the failsafe
#
# The paper's agent learns from crashes to be home in time, and each crash costs 150. A rule can bring the UAV home without a single crash.
# From the map you can count the moves from each cell to the nearest landing zone, so you know the last moment at which the UAV can turn
# back:

# %%
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.city import City

city = City.load("manhattan")
environment = SafeEnvironment(city)

# %%
figure = Figure(figsize=(5.2, 4.4), layout="constrained")
ax = figure.subplots()
time = np.where(city.no_fly, np.nan, environment.time_to_land[0].reshape(16, 16))
picture = ax.imshow(time, cmap="viridis")
ax.set(xlabel="column", ylabel="row", title="white: no-fly zones and tall buildings")
figure.colorbar(picture, label="units of time to fly home and land")
figure

# %% [markdown]
# The rule is one line: an action is *too late* if, after it, the way home takes longer than the time left. If $b$ is the time left
# before the action, this reads
#
# $$\text{time to land}(\text{next cell}) > b - 1$$
#
# The failsafe replaces such an action with the first move home. Many drones have a function like this, called *return to
# home*. Does the failsafe work for any policy? Try one that knows nothing:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("random_with_a_failsafe")

# %%
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Random
from uavdh_lite.scenario import find_scenario

scenario = find_scenario("manhattan")
for name, one in {"paper": Environment(city), "failsafe": environment}.items():
    flights = evaluate(one, Random(), scenario, 500, seed=0).records()
    landed, earned = flights["landed"].mean(), flights["return"].mean()
    print(f"{name:<9} landed {landed:6.1%}, return {earned:6.1f}")
assert flights["landed"].all()

# %% [markdown]
# All flights with the failsafe land, and they always will, as long as the map is right and no wind
# slows the UAV. But the return is still poor, because random moves collect little.
#
# What a rule guarantees need not be learned. No crash disturbs the Q-values, and no schedule of penalties is needed. On the other hand, somebody
# must know the rule.
#
# ## 12.2 Tell: maps of what can be computed
#
# The paper's network sees buildings, but it must find out from reward where devices can be heard
# and which way leads around a block. The environment, however, knows the channel and the city, so
# it can compute the answers, which are added to the map as three more layers:

# %%
from uavdh_lite.beyond.told import TOLD_LAYERS, ToldObservation
from uavdh_lite.missions import Mission

state = Mission(city, (8, 4), [(4, 7), (11, 11)], [15, 6], flying_time=50).state
told = ToldObservation(environment).told(state)[0].reshape(3, 16, 16)

# %%
figure = Figure(figsize=(9, 3.2), layout="constrained")
for ax, layer, name in zip(figure.subplots(1, 3), told, TOLD_LAYERS):
    ax.imshow(layer, cmap="magma")
    ax.plot([7, 11], [4, 11], "x", color="white")
    ax.plot(4, 8, "^", color="white")
    ax.set(title=name, xticks=[], yticks=[])
figure

# %% [markdown]
# Bright cells have large values. The triangle is the UAV, and the crosses are the devices.
# *Expected data* is roughly the amount that one unit of time over a cell would bring without
# fading. It is an estimate, because it assumes that the single best device sends all the time;
# exercise 12.2 computes the sum slot by slot. In the formula, $R_k$ is the rate of device $k$
# without fading, and $\delta$ the number of slots in a unit of time:
#
# $$\max_k \min(\delta \cdot R_k,\; \text{data left}_k)$$
#
# Around each device lies a bright spot with dark wedges: the shadows of notebook 2. *Way home* says
# how near a cell is to a landing zone, and *way there* how near it is to the UAV: the fewer the
# moves, the brighter the cell. Moves are counted along the shortest way around tall buildings and
# no-fly zones. Anyone who knows the city and the constants of the channel can work all of this out
# before the flight, whereas a network that is not told has to find it out by flying.

# %%
Quiz("what_may_be_told")

# %% [markdown]
# ## 12.3 Copy: a planner as teacher
#
# The *genie* is a search over whole flights. It knows the rate of every link without fading, and keeps the best
# candidate flights for each cell and moment (a **beam search**). It flies better than any agent here, but has to
# search in flight, which takes seconds over a large city. Can a network learn to do what the genie does, without the
# search?

# %%
from uavdh_lite.beyond.genie import Genie

plan = Genie(environment, beam=1, grow=False).plans(state)[0]
arrows = np.array(list("↑→↓←○L"))
print("".join(arrows[plan.actions[: (plan.actions != 5).sum() + 1]]))

# %% [markdown]
# This is a whole flight, in which arrows are moves and L is the landing. Each state on the way, with the genie's action, is a
# *labelled example*. The network gives a score to each action, and a softmax turns the scores into probabilities $\pi(a \mid
# s)$. The loss is the *cross-entropy*, the network's surprise at what the genie did:
#
# $$L = -\log \pi(a_{\text{genie}} \mid s)$$
#
# The loss is 0 if the network was sure and right, and large if it was sure and wrong. In the library it is one line of `Cloning.loss`;
# the loop around it is that of notebook 7, with the genie in place of the softmax policy.
#
# The shipped agent `manhattan` first copied the genie and then learned from reward (12.4). How often does it agree with
# its teacher? Fly the genie's plans for 100 missions, and ask the agent at each step:

# %%
import torch

from uavdh_lite.checkpoint import load_agent

torch.set_num_threads(1)  # the network is small

copy = load_agent("manhattan")
start = scenario.sample(environment, 100, np.random.default_rng(3))
plans = Genie(environment, beam=1, grow=False).plans(start)

# %%
agree, generator = [], np.random.default_rng(4)
state = start
while not state.ended.all():
    genie = np.array([plan.actions[-max(t, 1)] for plan, t in zip(plans, state.time_left)])
    flying = ~state.ended
    agree += (copy.act(state)[flying] == genie[flying]).tolist()
    state, _ = environment.step(state, genie, generator)
print(f"the copy takes the genie's action in {np.mean(agree):.0%} of {len(agree)} steps")
assert np.mean(agree) > 0.85

# %% [markdown]
# Where the two differ, both actions are often equally good, for example when two ways around a block are equally long.
#
# There is a trap, however. The genie never flies into a dead end, so its flights show no way out of
# one. A copy that errs once gets to places that it has never seen, and errs again. The remedy is to
# let the *learner* fly, and to ask the genie how to go on from states that the learner gets into. A
# third of the genie's flights begin in such a state. (This is a relative of **DAgger**, *dataset aggregation*, which labels every state of the learner's
# flights.)

# %%
Quiz("why_own_starts")

# %% [markdown]
# ## 12.4 Learn: what only reward can say
#
# The genie plans without fading, so it does not allow for luck. And a copy may make errors that further examples from the genie's own
# flights would not correct. Learning from reward needs neither a teacher nor a formula, because all that counts is how good a flight
# was. That is why the shipped agents that copied the genie learned from reward afterwards. To do so, such an agent draws its actions
# from $\pi$, and flies each mission eight times:

# %%
from uavdh_lite.beyond.reinforce import advantages
from uavdh_lite.ddqn import draw_actions, softmax_policy
from uavdh_lite.evaluation import FunctionPolicy, fly

def draw(state):
    return draw_actions(softmax_policy(copy.q_values(state), 1.0), generator)

mission = start[[7] * 8]
returns = fly(environment, FunctionPolicy(draw), mission, generator).returns
print("return   ", *(f"{value:6.1f}" for value in returns))
print("advantage", *(f"{value:6.1f}" for value in advantages(returns)))

# %% [markdown]
# The *advantage* $A$ of a flight says by how much its return exceeds the mean of the other seven, in standard deviations. The loss
# is that of 12.3, weighted by $A$:
#
# $$L = -A\,\log \pi(a \mid s)$$
#
# What the agent did in a good flight becomes likelier, as if the genie had done it, and what it did
# in a bad one becomes less likely. (The library makes several updates from the same flights, so it
# uses this loss in the clipped form of PPO, which limits how far they change a probability.) This
# is a **policy gradient** method, and here no network has to learn values. We have not tried this
# method with an agent that knows nothing; hardly any of its flights would be good. The agent
# `manhattan` had copied the genie first, which took [most of its
# training](../docs/results/speed.md).
#
# The paper's agents see the map, and learn the rest from reward. In principle they could learn even
# in a place whose channel nobody can write down, if they could fly millions of steps there, crashes
# included. In practice, agents are trained in a simulator, possibly with a model of the channel
# that was fitted to measurements (notebook 14).
#
# ## 12.5 What each way is worth
#
# Here are the validation returns of the recorded runs, plotted against the minutes of training on one core. Because other
# programs ran beside some of the runs, all three runs of each recipe are scaled to the length of the quickest. Negative
# returns are left out:

# %%
from uavdh_lite.planners import Greedy
from uavdh_lite.streams import Use

flights = evaluate(environment, Greedy(environment), scenario, 1000, 0, Use.VALIDATION)
greedy = flights.returns.mean()

# %%
study = read_table(data_folder() / "runs/four_ways-manhattan.csv.gz")
figure = Figure(figsize=(8, 3.8), layout="constrained")
ax = figure.subplots()
for way, colour in WAYS.items():
    runs = [(study["variant"] == way) & (study["seed"] == seed) for seed in range(3)]
    quickest = min(study["seconds"][run].max() for run in runs) / 60
    style = "--" if "copy" in way else "-"
    for run in runs:
        minutes = study["seconds"][run] / study["seconds"][run].max() * quickest
        label = way.replace("_", " + ") if run is runs[0] else None
        ax.plot(minutes, study["return"][run], style, color=colour, label=label)
ax.axhline(greedy, color="grey", lw=1, ls=":", label="greedy")
ax.set(xlabel="minutes", ylabel="return in validation", ylim=(0, 37))
ax.legend(fontsize="small", loc="center right")
figure

# %%
for way in WAYS:
    end = last_returns(study, way)
    print(f"{way.replace('_', ' + '):<28}" + "".join(f"{value:8.1f}" for value in end))
print(f"{'greedy':<28}{greedy:8.1f}")

# %% [markdown]
# - The **guarantee** matters most in runs this short. Without it, the agents that learn from reward crash in one mission in
#   twenty to one in five at the end, and the copies in about one in ten. All four recipes end 14 to 23 units of return, on
#   average, behind the same recipes with the guarantee. Crashes cost 9 to 19 of these units, and the learners also collect less.
# - **Telling** is worth about 1.5 units to either kind of agent under the guarantee. (In longer runs, too, agents that are
#   told and learn from reward end ahead, by half a unit: see [the ladder](../docs/results/ladder.md).) Without the guarantee,
#   the three runs of *tell + learn* crash in most missions for half of their time. Then two of them overtake *learn*, and one
#   does not.
# - **Copying** is ahead of learning from reward by 1.5 to 1.7 units under the guarantee, although the copies collect less,
#   because they use only two thirds of the flying time, whereas the learners use nine tenths of it.
# - **Learning**, after copying, adds 1.0 to 1.4 units of return. (So does copying twice as many labels, in other runs.)
#
# To compare copying with learning, look at the dashed and the solid lines of one colour; to see
# what the guarantee and the told layers add, compare the colours. None of these short runs reaches
# greedy's line.
#
# Runs this short show which recipe learns fastest, not which is best in the end. The course's DDQN agent, for example, has no guarantee,
# but it learned for almost two million steps instead of 80,000, and it hardly ever crashes.
#
# ## 12.6 What the labels cost
#
# A planner's labels are not free. Somebody has to know the channel's equations and the city, and has to write the search. Here all
# of this was possible, and copying was the quickest way to a good agent. Where nobody can write down the channel, it has to be
# measured, or else the agent has to learn from reward. An agent that was told more had a head start, so compare agents only with
# others that were told the same.
#
# Here are two agents that you can load, flown on 300 missions that are new to both:

# %%
agents = {"manhattan_ddqn": "reward, no more", "manhattan": "all four"}
for name, knows in agents.items():
    agent = load_agent(name)
    records = evaluate(agent.environment, agent, scenario, 300, seed=12).records()
    print(f"{name:<15} {knows:<22} return {records['return'].mean():5.1f}, "
          f"time used {records['time_used'].mean():4.0%}")

# %% [markdown]
# The second agent earns more, and in less time. But it was also told more, so this shows what knowledge is worth, not which way of
# learning is better.
#
# ## Recap
#
# - A rule that always holds need not be learned: the failsafe brings any policy home.
# - What can be computed can be told, as a layer of the map.
# - A planner's moves can be copied by minimising the cross-entropy, both in the planner's own flights and in flights that begin
#   in states that the learner got into.
# - Learning from reward needs neither a teacher nor anybody who knows the equations. On its own it is slow. After
#   copying, it repairs some of what the copy got wrong.
# - Before you compare agents, say what each of them was told.
#
# ## Exercises
#
# Two exercises are in [`exercises/12_four_ways`](exercises/12_four_ways/12_four_ways.ipynb).
#
# ## Further reading
#
# - Ross, Gordon and Bagnell, [*A reduction of imitation learning and structured prediction to no-regret online
#   learning*](https://arxiv.org/abs/1011.0686), AISTATS 2011: DAgger.
# - The page *Four ways to knowledge* on the site, under Results, says what else was tried.
