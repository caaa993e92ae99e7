# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 7 · Training
#
# These exercises go with notebook `07_training`. You should know the curves and the recipe of the
# notebook. For the first exercise you also need the parts that you built in the exercises of
# notebook 6.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check
# says whether the answer is right, and if not, what is probably wrong. Hints are folded away below
# each task. Your code runs inside this notebook. If it never finishes, interrupt the kernel with
# the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it,
# and write your own from memory. Solutions are in the folder `solutions`, beside `exercises`,
# unless somebody handed you a copy of the course without them.

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
from dataclasses import fields, replace

import numpy as np
import torch
from torch import nn

from uavdh_lite.course import checks
from uavdh_lite.course.given import MAY_CHANGE, REWARDS, ROUNDS, RUNS
from uavdh_lite.recipe import SMALL, Recipe

# %% [markdown]
# ## 7.1 · Your own DQN flies the village (6 points, 70 minutes)
#
# Put together the parts that you built in the exercises of notebook 6. This takes about forty lines
# of code, and then an agent that you have built yourself flies over a city. The next cell has three
# of the parts, written as briefly as we could. Paste your own in their place if you like; the
# function that 6.5 calls `target` is `target_of` here, because `target` will be the name of your
# second network.

# %%
class Ring:
    def __init__(self, capacity):
        self.capacity, self.items, self.newest = capacity, [], -1

    def add(self, item):
        self.newest = (self.newest + 1) % self.capacity
        self.items[self.newest : self.newest + 1] = [item]

    def sample(self, size, generator):
        others = generator.integers(0, len(self.items), size - 1)
        return [self.items[place] for place in (self.newest, *others)]


def target_of(reward, terminal, discount, online_next, target_next):
    judged = target_next.gather(1, online_next.argmax(1, keepdim=True))[:, 0]
    return reward + discount * judged * ~terminal


def policy(q_values, temperature):
    return torch.softmax(q_values / temperature, dim=1)

# %% [markdown]
# This is what you need from the library:

# %%
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment, State
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import find_scenario

village = find_scenario("village")
environment = Environment(load_cities("village"))
generator = np.random.default_rng(0)
states = village.sample(environment, 16, generator)  # the starts of 16 missions, side by side
observation = Observation(environment, data_scale=20, time_scale=10)
maps, time = observation(states)
print("what a network sees:", tuple(maps.shape), tuple(time.shape))
next_states, outcome = environment.step(states, generator.integers(0, 6, 16), generator)
print("rewards:", REWARDS(outcome)[:4], "ended:", next_states.ended[:4])
pair = State.concatenate([states[0:1], states[5:6]])  # two single states become a batch
print("a batch of", len(pair))

# %% [markdown]
# Write `train(environment, scenario, rewards, rounds, generator)`. In each round, 16 UAVs each fly
# one step, and the network learns from one minibatch:
#
# 1. **act**: compute the Q-values of the states and the softmax policy, and draw an action for each
#    UAV
# 2. **step**: call `environment.step`, and compute `rewards(outcome)`
# 3. **add**: put each UAV's own step into the ring, for example as `(state, action, reward, next
#    state)`, where each state is a batch of one
# 4. UAVs whose episode has ended start a new mission: `states.with_rows(places, new_states)` gives
#    a copy of `states` in which the rows at these places are new
# 5. **sample** a minibatch, compute the double target, and take one step downhill
# 6. let the **target network** follow the network that learns
#
# Return a function `q_values(state)` that gives the Q-values of all six actions for a batch of
# states, as a tensor of shape $(B, 6)$.
#
# This is what worked for us: a convolution of 16 kernels of 3 × 3 with stride 2, then a layer of 64
# units; a minibatch of 64 steps and a ring for 20,000; no learning in the first hundred rounds;
# Adam with a learning rate of 0.002, $\gamma = 0.95$, $\tau = 0.02$; a $\beta$ that falls from 1 to
# 0.05 over the course of the rounds; `nn.functional.huber_loss` with `delta=5` in place of the
# squared error (the **Huber loss** is a parabola for small errors and a straight line for large
# ones, so that a single crash does not pull too hard at the weights).
#
# The check trains your agent for 2000 rounds, which takes about half a minute, and then flies it
# through 500 missions, in which it always takes its best action. Your agent passes if its
# *collected and landed* is at least 20 percentage points above that of random flying (11 %), if $y$
# was made by a network that lags behind the one that learns, and if your agent has learned that
# nothing follows the end of an episode. Passing means that your agent learns, but not that
# everything is right, so also compare your loop with [the algorithm on one
# page](../../../docs/tutorials/pseudocode.md). With three seeds, our solution reached 50, 72 and 63
# %. Before training, an agent with a network like ours mostly lands at once or never, so its
# *collected and landed* is only 0 to 12 %. `REWARDS` counts 1 for each data unit, −0.1 for each
# step, −1 for each action that the safety controller replaces, and −20 for a crash.
#
# <details><summary>Hint: the network</summary>
#
# The map and the time enter the network at different places. The usual way is a class with
# `__init__` and `forward(maps, time)`, in which `torch.cat([self.convolution(maps), time], dim=1)`
# joins the result of the convolution and the time. A convolution of 3 × 3 with stride 2 turns 15 ×
# 15 cells into 7 × 7.
# </details>
#
# <details><summary>Hint: the same as a skeleton</summary>
#
# ```python
# class Network(nn.Module):
#     def __init__(self, layers):
#         super().__init__()  # before anything else
#         self.convolution = nn.Sequential(nn.Conv2d(layers, 16, kernel_size=3, stride=2), nn.ReLU(), nn.Flatten())
#         self.head = ...  # the list that Flatten makes and the time go in, six numbers come out
#
#     def forward(self, maps, time):
#         ...
# ```
#
# `nn.Conv2d(layers in, kernels, size, stride)` is a convolution, and `nn.Flatten()` turns the
# pictures of each example into a list. Call the network as `network(maps, time)`.
# </details>
#
# <details><summary>Hint: actions</summary>
#
# `torch.multinomial(probabilities, 1)[:, 0].numpy()` draws an action from each row of
# probabilities. The Q-values used for acting need no gradient.
# </details>
#
# <details><summary>Hint: the minibatch</summary>
#
# `zip(*ring.sample(64, generator))` turns a list of four-tuples into four columns. Join states into
# a batch with `State.concatenate(list)`, and numbers with `torch.tensor(np.array(column))`. For the
# batch of next states, `batch.ended` says which of the steps ended an episode.
# </details>

# %%
### BEGIN SOLUTION
import copy


class Network(nn.Module):
    def __init__(self, channels, side):
        super().__init__()
        self.convolution = nn.Sequential(
            nn.Conv2d(channels, 16, kernel_size=3, stride=2), nn.ReLU(), nn.Flatten()
        )
        inputs = 16 * ((side - 3) // 2 + 1) ** 2 + 1
        self.head = nn.Sequential(nn.Linear(inputs, 64), nn.ReLU(), nn.Linear(64, 6))

    def forward(self, maps, time):
        return self.head(torch.cat([self.convolution(maps), time], dim=1))


def train(environment, scenario, rewards, rounds, generator):
    observation = Observation(environment, data_scale=20, time_scale=10)
    online = Network(*observation.map_shape[:2])
    target = copy.deepcopy(online)
    optimiser = torch.optim.Adam(online.parameters(), lr=0.002)
    ring, states = Ring(20_000), scenario.sample(environment, 16, generator)
    for number in range(rounds):
        with torch.no_grad():
            q = online(*observation(states))
        beta = 1 - 0.95 * number / rounds
        actions = torch.multinomial(policy(q, beta), 1)[:, 0].numpy()
        after, outcome = environment.step(states, actions, generator)
        earned = rewards(outcome)
        for k in range(16):
            ring.add((states[k : k + 1], actions[k], earned[k], after[k : k + 1]))
        over = np.flatnonzero(after.ended)
        states = after.with_rows(over, scenario.sample(environment, len(over), generator))
        if number < 100:
            continue
        before, action, reward, following = zip(*ring.sample(64, generator))
        before, following = State.concatenate(before), State.concatenate(following)
        with torch.no_grad():
            seen = observation(following)
            terminal = torch.tensor(following.ended)
            reward = torch.tensor(np.array(reward))
            y = target_of(reward, terminal, 0.95, online(*seen), target(*seen))
        taken = torch.tensor(np.array(action))[:, None]
        q = online(*observation(before)).gather(1, taken)[:, 0]
        loss = nn.functional.huber_loss(q, y, delta=5.0)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        with torch.no_grad():
            for old, new in zip(target.parameters(), online.parameters()):
                old.lerp_(new, 0.02)
    return lambda state: online(*observation(state))
### END SOLUTION

# %%
checks.village_dqn(train)

# %% [markdown]
# How good is your agent? The next cell flies the same missions with your agent, with random, with
# greedy, and with an agent that the library's own loop has trained for as many steps. This takes
# another half minute. The library's recipe `small` has several things that yours lacks: 3-step
# returns, exploring starts (flights that begin in mid-air), two convolutions, layer normalisation,
# and a crash penalty that rises from 5 units to 20.

# %%
from uavdh_lite.evaluation import FunctionPolicy, evaluate
from uavdh_lite.policies import find_policy
from uavdh_lite.training import Trainer

def compare(rounds):
    torch.manual_seed(0)
    q_values = train(environment, village, REWARDS, rounds, np.random.default_rng(0))
    library = Trainer(village, replace(SMALL, steps=16 * rounds), seed=0)
    while not library.finished:
        library.step()
    pilots = {
        "random": find_policy("random", environment),
        "greedy": find_policy("greedy", environment),
        "the library's": library.agent,
        "yours": FunctionPolicy(lambda state: q_values(state).argmax(1).numpy()),
    }
    for name, pilot in pilots.items():
        flown = evaluate(environment, pilot, village, 500, seed=0).metrics()
        print(f"{name:<14}collected and landed {flown['collected_and_landed'].mean:.0%}")


compare(ROUNDS)

# %% [markdown]
# Why does your agent do better or worse here than in the check? The check and the cell run the same
# training code from the same first weights, and afterwards fly the agent through the same 500
# missions. Only the random numbers used in training differ, and with them the missions from which
# the agent learns. For our solution this alone makes the difference between 50 % in the check and
# 66 % here, so do not judge a change by a single seed.
#
# Greedy is far ahead of your agent. What would help your agent: more rounds, another $\beta$, a
# larger network? Begin with three times as many rounds, and **write down what you expect** before
# you take the `#` away and run the next cell, which takes two to three minutes.

# %%
# compare(3 * ROUNDS)

# %% [markdown]
# <details><summary>What our solution reached with 6000 rounds</summary>
#
# With the seeds 0, 1 and 2 our solution collected and landed 96, 97 and 96 % of the data, and
# greedy 99 %. The code was right, but 2000 rounds were too few: after 6000, an agent that takes
# about forty lines of code is nearly as good as the rule.
# </details>
#
# Does the *double* in double DQN help an agent like yours? Notebook 6 shows the effect of the
# double target on random numbers alone. The question makes a good project: train twice with each of
# six seeds, once with `target_of` and once with the plain maximum of the target network.
#
# ## 7.2 · What is wrong with this agent? (1 point, 5 minutes)
#
# A validation gives three shares between 0 and 1, each a mean over many missions: `landed`,
# `collected` (the collected data divided by all data, whether the UAV landed or not) and
# `time_used` (the flying time used divided by the flying time given). The cell below shows nine
# such validations, from training runs over Manhattan: one is of an agent trained
# with the whole recipe `lite` (`all`); the others are of agents for which one part of the recipe
# was replaced by the paper's (`data/runs/deviations-manhattan.csv.gz`). Each name ends with the
# training seed and the number of steps, in thousands, after which the agent was validated.

# %%
for name, shares in RUNS.items():
    print("{:<32}landed {:.3f}, collected {:.3f}, time_used {:.3f}".format(name, *shares))

# %% [markdown]
# Write a function that says what is wrong with an agent, if anything. The agent
#
# 1. is `"lazy"` if it uses less than 25 % of the flying time, whatever its other shares are;
# 2. otherwise it `"crashes"` if it lands in fewer than 90 % of its missions;
# 3. otherwise it is `"good"` if it collects at least 80 % of the data;
# 4. otherwise it `"wanders"`: it flies about but comes home with little.
#
# <details><summary>Hint</summary>
#
# The four terms are defined one after the other, each only for agents to which none of the earlier
# ones applies. Which number, then, must you look at first?
# </details>
#
# <details><summary>Another hint</summary>
#
# First ask whether `time_used < 0.25`, and then whether `landed < 0.9`. If neither holds, look at
# `collected`: at 0.8 or above the agent is "good"; below 0.8 it "wanders".
# </details>

# %%
def diagnose(landed, collected, time_used):
    """One of "lazy", "crashes", "good" and "wanders"."""
    ### BEGIN SOLUTION
    if time_used < 0.25:
        return "lazy"
    if landed < 0.9:
        return "crashes"
    return "good" if collected >= 0.8 else "wanders"
    ### END SOLUTION

# %%
checks.diagnosis(diagnose)

# %%
for name, shares in RUNS.items():
    print(f"{name:<32}{diagnose(*shares)}")

# %% [markdown]
# With the crash reward of `paper`, −150 from the start, the agent of seed 0 is lazy after 100,000 steps. After 300,000 steps it
# uses more of its time, but it has hardly learned to collect more.

# %% [markdown]
# ## 7.3 · The n-step return (2 points, 15 minutes)
#
# An agent with the recipe `lite` learns from 3-step returns: the rewards of three steps and the
# value of the state after them. Here you compute such a return, as a target, for any number of
# steps. A memory holds $T$ consecutive steps of one UAV. Compute the target for the first state,
# $s_0$, over up to $n$ steps:
#
# $$y = r_0 + \gamma r_1 + \dots + \gamma^{m-1} r_{m-1} + \gamma^m V(s_m)$$
#
# - `rewards`: array of $T$ floats; `rewards[k]` is $r_k$, earned in the step from $s_k$ to
#   $s_{k+1}$
# - `terminals`: array of $T$ bools; `terminals[k]` says whether that step ended the episode; a step
#   that is stored after a terminal one belongs to the next episode
# - `values`: array of $T + 1$ floats; `values[k]` is $V(s_k)$, the value of the state $s_k$
# - `n`: whole number, at least 1; `discount`: $\gamma$
#
# Here $m = n$, or $m = T$ if fewer than $n$ steps are stored. If one of these $m$ steps is
# terminal, the sum ends with the reward of the first such step, and no value is added. Return the
# number $y$; leave the arrays as they are.
#
# <details><summary>Hint</summary>
#
# Write the sum down for n = 1 and n = 2, then for n = 2 with the first step terminal. After m
# rewards, which state's value is added, and with which power of γ?
# </details>
#
# <details><summary>Another hint</summary>
#
# Keep a sum, at first 0, and a factor, at first 1. For each step k, add factor · rewards[k] to the
# sum and multiply the factor by γ; if terminals[k] is true, return the sum at once. After m =
# min(n, T) steps, add factor · values[m] and return the sum.
# </details>

# %%
def n_step(rewards, terminals, values, n, discount):
    """The target of the first state over up to n steps."""
    ### BEGIN SOLUTION
    total, factor = 0.0, 1.0
    steps = min(n, len(rewards))
    for k in range(steps):
        total += factor * rewards[k]
        factor *= discount
        if terminals[k]:
            return total
    return total + factor * values[steps]
    ### END SOLUTION

# %%
checks.n_step_return(n_step)

# %% [markdown]
# ## 7.4 · Mend a lazy agent (4 points, 20 minutes)
#
# Section 7.4 of the notebook showed lazy agents, for which a crash cost 150 units from the start.
# The recipe `lazy` below makes an agent timid in the village, too: the agent lands in every mission,
# but it uses only a quarter of its flying time and collects a fifth of the data.

# %%
lazy = replace(SMALL, name="lazy", steps=20_000, crash_reward=-150.0, crash_reward_end=-150.0, huber_delta=None,
               temperature=0.1, exploring_starts=0.0)

# %% [markdown]
# Mend this recipe: use `replace(lazy, ...)` to make a recipe whose agent reaches at least 35 % in
# *collected and landed*. Only the settings in the following table may be changed. The table shows
# their values in `lazy` and in `small`, the recipe with which the notebook trains its agent.

# %%
meaning = {field.name: field.metadata["help"] for field in fields(Recipe) if "help" in field.metadata}
print(f"{'':<20}{'lazy':>8}{'small':>8}")
for name in MAY_CHANGE:
    print(f"{name:<20}{str(getattr(lazy, name)):>8}{str(getattr(SMALL, name)):>8}  {meaning[name]}")

# %% [markdown]
# - `steps`: 24,000 or fewer
# - `crash_reward_end`: −40 or lower (at the end of the run, a crash must cost at least 40 units),
#   so the −20 of `small` is not enough.
# - `crash_reward`, the reward of a crash at the start, may be any number up to 0. From there the
#   reward changes linearly to `crash_reward_end`, and `crash_reward_growth` is the share of the run
#   that this takes: 0.75 means the first three quarters.
# - `temperature` changes to `temperature_end` in the same way, and `temperature_decay` is the share
#   of the run that this takes. The higher the temperature, the more the agent explores.
# - `exploring_starts` is the share of the training episodes that begin in mid-air, at a random
#   place.
#
# The check trains an agent with your recipe and seed 0. Then it flies the agent, as it is at the
# end of the run, through 500 test missions of the village, in which the agent always takes its best
# action. The whole check takes about half a minute on a machine that is not busy.
#
# <details><summary>Hint</summary>
#
# The agent lands so early because it learned to fear crashes before it saw how much there is to
# collect. Must a crash cost as much at the beginning of the training as at its end?
# </details>
#
# <details><summary>Another hint</summary>
#
# Begin with a crash that costs a few data units, about as much as a step brings in, and let this
# cost grow to that of crash_reward_end. Explore more while the Q-values are still wrong
# (temperature about 1), and use all 24,000 steps. The other settings need not change, though a
# limit on the pull of large errors (huber_delta) is worth a try.
# </details>

# %%
# Replace the line below with your recipe: mended = replace(lazy, ...)
### BEGIN SOLUTION
mended = replace(lazy, name="mended", steps=24_000, crash_reward=-2.0, crash_reward_end=-40.0, huber_delta=10.0,
                 temperature=1.0)
### END SOLUTION

# %%
checks.mended_recipe(mended)

# %% [markdown]
# To save time, a single seed decides here whether the recipe passes. How would you find out whether
# your recipe is better than another?
