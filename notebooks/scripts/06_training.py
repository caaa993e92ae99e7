# %% [markdown]
# # 6 · Training
#
# Notebook 5 had the update. Here it is repeated tens of thousands of times, and turns an agent that
# flies at random into one that serves devices and lands in time. You train one yourself, read the
# curves of the shipped DDQN agent's run, and make training fail in two ways, to know them when you meet them.

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
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.storage import read_table

torch.set_num_threads(1)
RUN = Path("../data/runs/manhattan-lite-0")
METRICS = {"has_landed": "landed", "collection_ratio": "collected",
           "collection_ratio_and_landed": "collected and landed", "time_used": "flying time used"}

# %%
def draw_validation(ax, table, title):
    for metric, label in METRICS.items():
        ax.plot(np.array(table["steps"]) / 1000, table[metric], label=label)
    ax.set(title=title, xlabel="thousand environment steps", ylabel="share", ylim=(-0.03, 1.03))

figure = Figure(figsize=(7, 3.6), layout="constrained")
ax = figure.subplots()
draw_validation(ax, read_table(RUN / "validation.csv"), "the DDQN agent's run, 1000 missions a point")
ax.legend(loc="center right")
figure

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Train an agent for a village, read the curves of the shipped DDQN agent's training, make an agent that crashes and one that is lazy, and fly an early agent next to the final one |
# | **What you'll learn** | The order of things in the training loop, what each curve says, and which knobs decide whether it learns |
# | **What you'll need** | Notebooks 3 and 5. 25 minutes to read, 60 seconds to run; 15 minutes of exercises |
#
# ## 6.1 One step of the loop
#
# All that happens in training happens in this method:

# %%
import inspect

from uavdh_lite.training import Trainer

print(inspect.getsource(Trainer.step))

# %% [markdown]
# 1. **Act.** The softmax policy chooses an action for each of the environments that fly side by side. (Until
#    the memory holds enough, all actions are equally likely.)
# 2. **Step.** The environments answer with the next states and with what happened. The *recipe* makes a reward of it.
#    The agent learns from this reward; the curve in 6.3 adds up the paper's.
# 3. **Remember.** The transitions, from state to state, go into the replay memory.
# 4. **Replace** the episodes that ended: they are counted in the current row of `training.csv`, and new ones start in
#    their places.
# 5. **Draw** a minibatch from the memory and compute its targets.
# 6. **Learn** from a minibatch: one gradient step, one soft update (`ddqn.update`).
#
# One detail: it learns from the minibatch that the step *before* drew. So the targets are one gradient step old, of
# about 60,000. In return, learning and flying need nothing of each other within a step, and can go on at the same time
# (`--threads 2`). The weights are the same to the last bit.
#
# Everything that the loop depends on is in a *recipe*. Here are the paper's and our `lite`. These are the
# constants that this notebook needs; the site's reference has them all, with the reasons:

# %%
from uavdh_lite.recipe import LITE, find_recipe

constants = {"steps": "environment steps in all", "environments": "UAVs that fly side by side",
             "replay_capacity": "transitions in the memory", "temperature": "exploration at the start: notebook 5's β",
             "huber_delta": "up to this error the loss is its square, beyond it grows linearly",
             "exploring_starts": "share of episodes that begin under way, anywhere",
             "crash_reward": "what a crash costs at first", "crash_reward_end": "and at the end",
             "crash_reward_growth": "over which share of the run it grows",
             "return_steps": "rewards summed before the target's Q-value takes over (6.5)"}
paper = find_recipe("paper")
for name, meaning in constants.items():
    print(f"{name:<20}{getattr(paper, name)!s:>9}{getattr(LITE, name)!s:>9}   {meaning}")

# %% [markdown]
# The left column, the paper's, trains for more than a day on a laptop, the right one for about 20 minutes (the shipped
# DDQN agents took two to four times its steps). Two of them matter most below. `huber_delta` keeps a crash from
# drowning all else in the loss; `None` means squared throughout. And `crash_reward` lets the agent learn to fly far
# while a crash costs little, and to land in time when it costs all of 150.
#
# ## 6.2 Train one now
#
# Those 20 minutes are for a city of 16×16 cells. The village of 8×8 with one or two devices, and the
# recipe `small`, take ten seconds on a quiet machine for 20,000 steps. That is less than half of the recipe's:

# %%
from uavdh_lite.city import City
from uavdh_lite.plotting import draw_city
from uavdh_lite.scenario import find_scenario

village, missions, small = City.load("village"), find_scenario("village"), find_recipe("small")
figure = Figure(figsize=(4, 4), layout="constrained")
draw_city(figure.subplots(), village)
figure

# %%
import tempfile
from dataclasses import replace

from uavdh_lite.experiments.runs import train

def train_village(**changes):
    with tempfile.TemporaryDirectory() as folder:
        recipe = replace(small, steps=20_000, validation_interval=4000, **changes)
        trainer = Trainer(missions, recipe, seed=0, city=village)
        trainer.validate()
        train(trainer, folder, show_progress=False)
    return trainer

# %%
learned = train_village()
assert learned.validation_rows[-1]["collection_ratio_and_landed"] > 0.25
print(f"{learned.steps:,} environment steps, {learned.updates:,} updates")

# %%
def draw_runs(trainers, titles):
    figure = Figure(figsize=(max(6, 4.2 * len(trainers)), 3.7), layout="constrained")
    axes = figure.subplots(1, len(trainers), sharey=True, squeeze=False)[0]
    for ax, trainer, title in zip(axes, trainers, titles):
        rows = trainer.validation_rows
        draw_validation(ax, {name: [row[name] for row in rows] for name in rows[0]}, title)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return figure

draw_runs([learned], ["the village"])

# %% [markdown]
# Each point is a greedy validation: the policy without exploration, on missions that are always the same
# and that training never sees. The agent kept is the one of the best point, not the last one: the rule
# is fixed before the run, and the final test uses other missions again.
#
# At step 0 the network is untrained: its actions have nothing to do with the mission. (Often it repeats one until the
# battery is empty.) How the curves go from there differs from seed to seed and from machine to machine: *landed* may rise once or jump up
# and down, as the agent tries what a crash costs and as that cost grows. In the five seeds that we tried it ended
# alike: it lands in nearly all missions, in about half of the time that it has, and brings home about half of the data. The
# rest of the recipe's 48,000 steps teaches it to use the other half (notebook 11 has those curves).
#
# ## 6.3 Reading the curves of a real run
#
# The DDQN agent of the Manhattan city, seen from inside:

# %%
import json

about = json.loads((RUN / "about.json").read_text())
print(about["command"])
print(f"{about['updates']} updates in {about['seconds'] / 60:.1f} min, {about['machine']}")

# %% [markdown]
# (Random numbers are drawn in another way since that run was recorded. The same command now gives another run of the
# same kind.)

# %%
training = read_table(RUN / "training.csv")
panels = {"cumulative_reward": "cumulative reward", "has_landed": "landed", "collection_ratio": "collected",
          "collection_ratio_and_landed": "collected and landed", "loss": "loss", "temperature": "temperature β"}
figure = Figure(figsize=(10, 5.2), layout="constrained")
for ax, (column, label) in zip(figure.subplots(2, 3, sharex=True).flat, panels.items()):
    ax.plot(training["steps"] / 1000, training[column], lw=0.8)
    ax.set(ylabel=label)
for ax in figure.axes[3:]:
    ax.set(xlabel="thousand environment steps")
figure.axes[0].set_ylim(-60, 40)
figure

# %% [markdown]
# These are the training episodes with an ordinary start, flown by the *exploring* policy; the figure at the
# top is greedy. The reward dives between 100,000 and 400,000 steps, while *collected* rises: the agent learns
# to fly far before it learns to be home in time, and up to half of the flights crash. The figure charges 150
# for each, as the paper does. The agent's own penalty is below 25 at that time; that is what lets it try.
#
# | curve | what it says | what it does not say |
# | --- | --- | --- |
# | cumulative reward | how the *exploring* policy does, in the paper's reward constants | how good the greedy policy is |
# | landed, collected | safety and usefulness, each alone | how much comes home: a mission that collects all and crashes counts in *collected* |
# | collected and landed | data that was brought home: the figure to compare. It is the mean of a product, not the product of the two means | why the rest is missing |
# | flying time used | near 0: it lands at once; near 1: it flies on until it must | whether it used the time well |
# | temperature | how much it explores | whether that is enough |
# | loss | how far predictions are from targets that move as well | whether the agent gets better |
#
# The loss is the curve that everybody looks at first, and the least useful one. After a first spike it rises
# while the agent gets better, since an agent that dares more has more to predict; then it falls, while the
# agent gets better:

# %%
for start in (50_000, 200_000, 600_000, 3_900_000):
    rows = (training["steps"] > start) & (training["steps"] < start + 5e4)
    loss, both = (training[c][rows].mean() for c in ("loss", "collection_ratio_and_landed"))
    print(f"from step {start:>9,}: loss {loss:.2f}, collected and landed {both:.0%}")

# %% [markdown]
# ## 6.4 Two ways to fail

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("huge_penalty")

# %% [markdown]
# **The agent that crashes.** Data is worth a few points a step, and the crash comes at the very end. If it
# costs nothing, there is no reason to fly home. (If it costs 1, that depends on the seed: try it.)
# **The lazy agent.** With a large penalty, little exploration and
# errors that are squared, the fear of the crash drowns all else: the agent finds that landing at once is
# safe, and then it never sees again what it could have collected. Both in the village:

# %%
crashing = train_village(crash_reward=0.0, crash_reward_end=0.0)
lazy = train_village(crash_reward=-150.0, crash_reward_end=-150.0, huber_delta=None, temperature=0.1,
                     exploring_starts=0.0)
draw_runs([crashing, lazy], ["crashing", "lazy"])

# %%
for name, trainer in (("recipe", learned), ("crashing", crashing), ("lazy", lazy)):
    row = trainer.validation_rows[-1]
    print(f"{name:<10}" + "  ".join(f"{label} {row[m]:.0%}" for m, label in METRICS.items()))

# %% [markdown]
# All three after 20,000 steps. How to see it: look at *landed*, *collected* and *time used* together. "Landed 100 %, next to no time used" is the lazy agent, and its mean
# reward is better than that of one that flies and crashes often (exercise 2). A report of loss and reward
# alone shows neither.
#
# ## 6.5 The knobs
#
# - **Crash penalty** `crash_reward`, `crash_reward_end`: the larger, the safer the landing and the slower
#   the learning. So the recipe lets it grow: first learn to fly far, then to be home in time.
# - **Temperature** `temperature`: large against the errors of early Q-values, small at the end. Its decay
#   is a bet on how long exploration pays.
# - **Return steps** `return_steps`: the number $n$ of rewards summed before the target's Q-value takes over.
#   More steps carry news back faster; they are also those of a policy that explored. In notebook 5 $n = 1$;
#   with the recipe's 3 the target is
#
# $$y = r_t + \gamma r_{t+1} + \gamma^2 r_{t+2} + \gamma^3\, Q_{\bar\theta}\big(s_{t+3}, \arg\max_{a'} Q_\theta(s_{t+3}, a')\big)$$
#
# Turn one, and train again: `train_village(return_steps=1)`, or with a crash reward of −20 throughout. A single run is
# enough to play, not to conclude anything: with another seed, or on another machine, the order may be another. For
# conclusions there is a recorded study of the recipe's settings, trained on Manhattan, 300,000 steps with three seeds
# each. Four of its rows, *collected and landed* for each seed:

# %%
study = read_table("../data/runs/deviations-manhattan/validation.csv.gz")
rows = {"all": "nothing changed", "without_return_steps": "one-step returns",
        "without_crash_reward": "crash −150 throughout", "without_replay": "the paper's memory"}
for variant, name in rows.items():
    last = (study["variant"] == variant) & (study["steps"] == study["steps"].max())
    print(f"{name:<22}", *(f"{share:.0%}" for share in study["collection_ratio_and_landed"][last]))

# %% [markdown]
# The crash penalty decides: no seed learns much with −150 from the start. With one-step returns every seed is behind, one
# of them only a little and another far.
#
# The paper's memory holds a quarter of the steps of the recipe's, and half of it is filled by random flying before learning begins.
# With it every seed is far behind. Two settings change at once here, so the row does not say whether the size or the
# random start does it. (Notebook 5 shows alone what a small memory does, in section 5.3.) Notebook 7 shows how such a comparison is set up.

# %% [markdown]
# ## 6.6 Early and late
#
# `manhattan_ddqn_early` comes from the same recipe, from a run that was stopped after 300,000 of 2,000,000 steps.
# Both fly the same mission with the same fading:

# %%
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import bootstrap_interval, evaluate
from uavdh_lite.plotting import add_legend, draw_trajectory

agents = {name: load_agent(name) for name in ("manhattan_ddqn_early", "manhattan_ddqn")}
environment = Environment(agents["manhattan_ddqn"].city)
flights = {name: evaluate(environment, agent, agent.scenario, 200, seed=0, record=True)
           for name, agent in agents.items()}

# %%
def side_by_side(mission):
    figure = Figure(figsize=(11, 7.2), layout="constrained")
    for ax, (name, flown) in zip(figure.subplots(1, 2), flights.items()):
        trajectory = flown.trajectory(mission)
        draw_trajectory(ax, environment, trajectory)
        ax.set_title(name)
    add_legend(figure, 5)
    return figure

side_by_side(7)

# %%
for name, flown in flights.items():
    records = flown.records()
    print(name, *(f"{label} {bootstrap_interval(records[metric]).mean:.0%};"
                  for metric, label in METRICS.items()))

# %% [markdown]
# In the picture the early agent keeps far from the device in the no-fly zone. It leaves most of its data, and lands
# with time to spare. The final one flies up to the zone, collects all, and uses its time to the last unit. Over 200
# missions the early agent leaves a fifth of the data and crashes now and then; the final one leaves about a twentieth.
#
# ## Recap
#
# - A training step: act, step, remember, replace, draw, learn. A recipe holds every constant, a seed the rest.
# - Watch *landed*, *collected* and *time used* together, of the greedy policy, on missions of their own.
# - The crash penalty decides most between crashing, laziness and learning.
#
# ## Exercises
#
# A few with their answers. More, to write yourself, with checks and hints, are in
# [`exercises/06_training`](exercises/06_training/06_training.ipynb).
#
# **1.** An update uses 128 transitions, and there are 32 environments and one update for each step of
# all. How often is a transition used, on average, before it is forgotten? And with the paper's numbers?

# %%
def uses(recipe):
    # A transition stays for capacity / environments updates, and each draws it with chance batch / capacity.
    return recipe.batch_size / recipe.environments

assert uses(LITE) == 4 and uses(paper) == 128
print(f"lite {uses(LITE):.0f} times, paper {uses(paper):.0f} times")

# %% [markdown]
# **2.** Of the lazy and the crashing agent, which ends with the higher cumulative reward, and which collects more?
# So what would "keep the agent with the best reward" have kept?

# %%
ends = {"lazy": lazy.validation_rows[-1], "crashing": crashing.validation_rows[-1]}
assert ends["lazy"]["cumulative_reward"] > ends["crashing"]["cumulative_reward"]
for name, row in ends.items():
    print(f"{name:<9} reward {row['cumulative_reward']:6.1f}, "
          f"collected {row['collection_ratio']:.0%}")

# %% [markdown]
# It would have kept the lazy one, which collects nothing. In "collected and landed" both are next to 0.
#
# **3.** Mend the lazy agent: give it back a setting of the recipe, one alone. Which suffices? Begin with the crash reward.

# %%
sick = {"crash_reward": -150.0, "crash_reward_end": -150.0, "huber_delta": None, "temperature": 0.1,
        "exploring_starts": 0.0}
given_back = {field: value for field, value in sick.items() if field not in ("crash_reward", "crash_reward_end")}
mended = train_village(**given_back).validation_rows[-1]
print(f"landed {mended['has_landed']:.0%}, collected and landed {mended['collection_ratio_and_landed']:.0%}")
assert mended["collection_ratio_and_landed"] > ends["lazy"]["collection_ratio_and_landed"] + 0.1

# %% [markdown]
# The crash reward alone suffices: a crash that costs little at first. Now try the other three, each alone and with more
# than one seed. Before you run it: why will the Huber loss hardly do, as long as the penalty is far larger than all
# there is to collect?
#
# ## Further reading
#
# - Henderson et al.: *Deep Reinforcement Learning that Matters*, AAAI 2018: seeds, and what curves hide.
# - Andrychowicz et al.: *What Matters in On-Policy Reinforcement Learning?*, ICLR 2021: a study of knobs.
# - `docs/results/history.md`, on the site under Results: every experiment that led to the recipe, also those that failed.
