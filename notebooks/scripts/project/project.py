# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A project of your own
#
# **Choose a city or a reward, say what you expect, train, and report what happened, on one page.**
# This notebook is the template. It runs as it is, with a small question of its own; put yours in
# its place. Plan for an afternoon: an hour to choose and to predict, 15 minutes of computing, and
# the rest for writing.
#
# Two finished projects lie beside it: [one](example_careful.ipynb) and
# [another](example_hasty.ipynb). Read both before you begin. Which of them would you believe, and
# why?
#
# ## 1 · The question
#
# *Write one sentence that can turn out to be wrong.* Here are some questions that fit into an
# afternoon:
#
# - Does an agent that pays more for each step land sooner, and does it leave data behind?
# - Does a discount of 0.9 do as well as 0.95 in a city as small as the village?
# - In my city the landing zone lies behind a wall. Is learning harder there than in the village?
# - Does my agent of notebook 7 benefit from a larger memory, or from the double target in place of
#   the plain maximum?
# - What happens if data is worth less towards the end of a flight?
#
# The example in this template is: *does an agent that has trained for 16,000 steps over the village
# do as well as greedy?*
#
# ## 2 · What I expect
#
# *Write down your prediction before you run anything, with a number, and say which result would
# mean “no”.* In the example, I expect the agent to be behind greedy by more than 5 percentage
# points of *collected and landed*. I look at the 95 % interval of the mean difference over seeds.
# If all of it lies below −5, I was right; if all of it lies above −5, I was wrong; if it contains
# −5, the question stays undecided.
#
# ## 3 · What I do
#
# Use at least three seeds for everything, because one run shows what can happen, not what usually
# happens. Six are better: for the same spread between agents, the interval over six seeds is less
# than half as wide as that over three ($2.6/\sqrt 6$ standard deviations on each side, compared
# with $4.3/\sqrt 3$), and three seldom decide a question of ordinary size. A seed costs about
# eight seconds here, and a minute with all 144,000 steps of the recipe `small`. `recipe` holds all
# hyperparameters; change one of them, and keep the rest. For a city of your own, begin with
# `from uavdh_lite.city import City`.

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
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.evaluation import bootstrap_interval, evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer

torch.set_num_threads(1)  # quickest for small networks

scenario = find_scenario("village")
# Take the whole 144,000 steps for your project: a minute for each seed. 16,000 take eight seconds
recipe = replace(find_recipe("small"), steps=16_000)
# A city of your own: take the # away, and write Trainer(…, city=city) everywhere below
# from uavdh_lite.city import City
# city = City.from_text("mine", "L . . .\n. B B .\n. . . .\n. N . .")

# %%
def train(recipe, seed):
    trainer = Trainer(scenario, recipe, seed)
    while not trainer.finished:
        trainer.step()
    print("trained, seed", seed, flush=True)
    return trainer.agent

SEEDS = range(3)  # take range(6) for your project
agents = [train(recipe, seed) for seed in SEEDS]
untrained = [Trainer(scenario, recipe, seed).agent for seed in SEEDS]

# %% [markdown]
# The test missions are the same 500 for every agent and for greedy, so that their results can be
# compared mission by mission. The agents also fly these missions before their training, because
# only what training adds to that result has been learned.

# %%
METRIC = "collected_and_landed"

def fly(policy, environment):
    return evaluate(environment, policy, scenario, 500, seed=0).records()[METRIC]

environment = agents[0].environment
rule = fly(Greedy(environment), environment)
flown = [fly(agent, environment) for agent in agents]
ahead = [100 * (records - rule) for records in flown]

# %% [markdown]
# ## 4 · What came out

# %%
before = [fly(agent, environment) for agent in untrained]
for name, group in (("untrained", before), ("trained", flown), ("greedy", [rule])):
    print(f"{name:<10} {METRIC}:", *(f"{records.mean():6.1%}" for records in group))

# %%
figure = Figure(figsize=(6, 2), layout="constrained")
ax = figure.subplots()
for seed, differences in enumerate(ahead):
    mean, low, high = bootstrap_interval(differences)
    ax.errorbar(mean, f"seed {seed}", xerr=[[mean - low], [high - mean]], fmt="o", color="C0")
    print(f"seed {seed}: {mean:+.1f} points ({low:+.1f} to {high:+.1f})")
ax.axvline(0, color="black", lw=1)
ax.set(xlabel="ahead of greedy, points, with the 95 % interval over missions")
figure

# %%
means = np.array([differences.mean() for differences in ahead])
t = {3: 4.3, 4: 3.2, 5: 2.8, 6: 2.6}[len(means)]  # Student's t, by the number of seeds
error = t * means.std(ddof=1) / np.sqrt(len(means))
low, high = means.mean() - error, means.mean() + error
print(f"over seeds: {means.mean():+.1f} points, 95 % interval {low:+.1f} to {high:+.1f}")
print("The prediction was", "right" if high < -5 else "wrong" if low > -5 else "neither shown nor refuted: undecided")

# %% [markdown]
# ## 5 · What I conclude, and what I do not
#
# *Three to five sentences. Was the prediction right? How sure are you, and with respect to what:
# missions, seeds, cities? What else could explain it? What would you do next?*
#
# Here is the template's own conclusion, as an example: by the rule of section 2 the prediction was
# right, since the whole interval over seeds lies below −5. Its ends are rough: no difference can be
# below −100, and three seeds are few. After 16,000 steps the agents have hardly learned to land, so
# this says nothing about what they can become. Next I would train for all 144,000 steps.
#
# The interval of a single seed says how sure we are of *that agent*. The interval in the last line
# is about all agents trained in this way, and with three seeds it is wide. Look at a few flights
# before you write: `trajectory_figure(environment, evaluate(…).trajectory(k))`.
#
# ## How it is judged
#
# | | 0 | 1 | 2 |
# | --- | --- | --- | --- |
# | question | vague | clear | could turn out wrong, and somebody would care |
# | prediction | none, or made afterwards | before, without a number | before, with a number and a “no” |
# | experiment | several things changed | one thing changed | one thing changed, with at least three seeds (six are recommended) and the same missions |
# | comparison | none | greedy beside it | greedy beside it, with a paired interval |
# | conclusion | more than the data says | what the data says | what the data says and what it does not, and why it may be so |
#
# Eight points out of ten make a good project. It does not matter whether the prediction was right.
