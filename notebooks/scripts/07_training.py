# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 7 · Training
#
# Two agents fly the same mission below. Both were trained with the **recipe** `lite`, but for
# different numbers of steps. (A recipe sets all constants and choices of a run.) The agent on the left
# comes from a run planned for two million steps and stopped after 300,000; the one on the right is
# the best agent of a run of nearly four million steps. **What happens in all these steps, and how
# can you tell whether training is going well?**

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
import torch
from matplotlib import pyplot as plt

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.evaluation import evaluate
from uavdh_lite.plotting import draw_trajectory

torch.set_num_threads(1)  # small networks
figure, axes = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
for ax, name in zip(axes, ("manhattan_ddqn_early", "manhattan_ddqn")):
    agent = load_agent(name)
    flights = evaluate(agent.environment, agent, agent.scenario, 40, seed=0)
    draw_trajectory(ax, agent.environment, flights.trajectory(20)).set_title(name)

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Train an agent for a village, read its curves, and make training fail |
# | **What you'll learn** | The training loop, what each curve says, two ways to fail, what a recipe is |
# | **What you'll need** | Notebooks 3 and 6. 45 minutes to read, 45 seconds to run; 110 minutes of exercises |
#
# The early agent leaves about a sixth of the data behind and lands at the last moment, whereas the
# late one brings all the data home and has two units of time to spare.
#
# ## 7.1 One step of the loop
#
# Everything so far comes together in one method:

# %%
import inspect

from uavdh_lite.training import Trainer

print(inspect.getsource(Trainer.step))

# %% [markdown]
# | in the code | what it does | where you met it |
# | --- | --- | --- |
# | `self._act` | **act**: draw an action from the softmax policy (eq. 10) | 6.4 |
# | `environment.step` | **step**: take the action, and see what happens | notebook 3 |
# | `replay.add` | **add** the step to the memory | 6.2 |
# | `replay.sample` | **sample** a minibatch that includes the newest steps | 6.2 |
# | `learner.update` | **update**: DDQN targets (eq. 8), a step downhill (eq. 7), the soft update | 6.3, 6.5 |
#
# The loop feeds on itself: an agent learns from its own flights, so a bad agent learns from bad
# flights, and a good one from good flights.
#
# Five more things are worth knowing:
#
# - Several UAVs fly side by side, 16 in the next section. Each flies one step between one update
#   and the next.
# - When an episode has ended, `_restart_ended` puts a new random mission in its place, so the agent
#   cannot simply memorise one mission.
# - Until the memory holds `replay_prefill` steps, the agent flies at random and learns nothing.
#   Otherwise the first minibatches would be drawn again and again from the same few steps.
# - The agent learns from the rewards of `training_rewards_at`, in which the cost of a crash may
#   grow during the run. The agent is judged by the rewards `REPORTED`, which are fixed.
# - The last two lines record one row of the training curves every 5000 steps.
#
# ## 7.2 Train one now
#
# A village of 8 × 8 cells with one or two devices is so small that an agent can be trained for it
# while you wait. The recipe `small` sets all **hyperparameters** (5.2): the size of the network,
# the learning rate, $\gamma$, $\tau$, $\beta$ and the rewards. Training takes half a minute.

# %%
from dataclasses import replace

from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario

def train(**changes):
    trainer = Trainer(find_scenario("village"), replace(find_recipe("small"), **changes), seed=0)
    trainer.validate()
    while not trainer.finished:
        if trainer.advance():  # a step and, now and then, a validation
            print(f"{trainer.steps:,} of {trainer.recipe.steps:,} steps", flush=True)
    return trainer

# %%
trainer = train()
print(f"{trainer.steps:,} steps, {trainer.updates:,} updates")

# %% [markdown]
# Every few thousand steps the loop stops for a **validation**. The agent then flies 200 missions
# that are always the same, and always takes the best action, without exploring (eq. 9). Validation
# also decides which version of the agent a run keeps: the one with the best score. Such a choice is
# partly luck, and the largest of many scores is on average too high, like the maximum in 6.5.
# Therefore the final score of an agent comes from a third set of missions, the *test*. The sets for
# training, validation and test have no mission in common. In validation and test, a *seed*, the
# number that starts the stream of random numbers, makes every agent fly the same missions.

# %%
def draw(ax, rows, title):
    for name, style in (("collected", "C0--"), ("collected_and_landed", "C1-"), ("landed", "C2^:")):
        shares = [row[name] for row in rows]
        ax.plot([row["steps"] for row in rows], shares, style, label=name.replace("_", " "))
    ax.set(title=title, xlabel="steps", ylabel="share", ylim=(-0.03, 1.03))
    ax.legend(fontsize="small")

figure, ax = plt.subplots(figsize=(6, 3), layout="constrained")
draw(ax, trainer.validation_rows, "the village")

# %% [markdown]
# Most untrained agents (step 0) bring nothing home. This one waits near the start and then lands,
# which in so small a village brings in nearly half the data. Therefore judge a curve, above all
# that of **collected and landed**, not by where it starts but by how far it rises. To see
# a network learn here while you turn its dials, open the lab *Train* (`python -m uavdh_lite app`).

# %%
last = trainer.validation_rows[-1]
assert last["collected_and_landed"] > 0.6
print(f"landed {last['landed']:.0%}, collected and landed {last['collected_and_landed']:.0%}")

# %% [markdown]
# ## 7.3 Reading the curves of a real run
#
# Below are the curves of the run that produced the agent of the course, averaged over bins of 5000
# steps. They show *training* flights, in which the agent explores. Half of the training flights
# begin in mid-air, so that the agent practises the way home; those are left out of the figure.

# %%
from uavdh_lite.storage import data_folder, read_table

def curves(study, variant, seed):
    table = read_table(data_folder() / f"runs/{study}-training.csv.gz")
    rows = (table["variant"] == variant) & (table["seed"] == seed)
    return {column: values[rows] for column, values in table.items()}

run = curves("ddqn-manhattan", "lite", 0)
figure, axes = plt.subplots(2, 2, figsize=(8, 4.4), layout="constrained")
for ax, name in zip(axes.flat, ("return", "landed", "collected", "loss")):
    ax.plot(run["steps"] / 1e6, run[name], lw=0.8)
    ax.set(ylabel=name, xlabel="million steps")

# %% [markdown]
# During this run the cost of a crash grew from 10 to 150 units, but the curve of the return counts
# every crash as 150.
#
# At first the agent learns to land. Then **collected** rises while **landed** and the **return**
# fall sharply, because the agent flies farther, and exploring makes it late. Later both recover,
# mainly because the agent explores less: of its flights without exploration between 200,000 and
# 500,000 steps, when a crash still cost less than 30 units, 98 % ended with a landing.
#
# Many people look at the **loss** first, but the loss tells you least. In notebook 5 the examples
# were fixed, so a falling loss meant better answers to them. Here the loss measures how far the
# Q-values are from their targets, and the targets move with the network. An agent that lands at
# once may have the same loss as one that collects half of the data. In this run the loss rises for
# a while as the agent collects more, perhaps because a bolder agent has more to predict, or because
# each crash costs more.
#
# Test flights tell more: at the start of 1000 missions our agent's largest Q-value is 20.7 on
# average, and the discounted rewards that then come in (with steps costing 0.1 units, as in
# training) add up to 20.9. A mean Q-value far above that sum would be a sign of the bias of 6.5.
#
# What if the score falls late in a run? First look at the other seeds and the next validations,
# because a single dip is often chance. Then compare Q-values and rewards: if the Q-values are far
# too large, they are diverging (6.3). If not, see what was changing when the score fell (β, the
# learning rate, the cost of a crash), and whether the memory still holds enough different flights.
#
# If the learning rate is far too large, the score does not rise, whatever the seed, and the
# Q-values swing; if it is far too small, Q-values and score hardly move. The loss may grow in
# either case.
#
# ## 7.4 Two ways to fail
#
# What happens if the penalty for a crash is too large, and what if there is none? Predict the first
# case:

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("huge_penalty")

# %% [markdown]
# **The lazy agent.** What if a crash costs 150 units from the start? The next cell compares such a
# recipe with `lite`, in which the cost begins at 10, by three recorded runs of each. Each run has
# only 300,000 steps, so whatever changes during a run changes faster than in longer runs.

# %%
study = read_table(data_folder() / "runs/deviations-manhattan.csv.gz")
names = {"all": "10, later 150", "without_crash_reward": "150 from the start"}  # lite, paper
for variant, crash in names.items():
    rows = (study["variant"] == variant) & (study["steps"] == study["steps"].max())
    for name in ("landed", "collected_and_landed"):
        print(f"{crash:<20}{name:<21}", *(f"{share:4.0%}" for share in study[name][rows]))

# %% [markdown]
# With the large penalty all three agents nearly always land, but they leave most of the data where
# it is.
# The paper's method has the same penalty and gets past this stage, as 7.5 shows.
#
# **The agent that never lands.** If a crash costs nothing, there is hardly any reason to fly home.
# Try this in the village:

# %%
crashing = train(crash_reward=0.0, crash_reward_end=0.0, steps=16_000, validation_interval=4000)
assert crashing.validation_rows[-1]["collected_and_landed"] < 0.5
figure, ax = plt.subplots(figsize=(6, 3), layout="constrained")
draw(ax, crashing.validation_rows, "a crash costs nothing")

# %% [markdown]
# The agent collects data but brings hardly any home. With `steps=48_000`, it collects nearly
# everything but still does not land, because landing earns it too little. The reward was wrong.
#
# What if an agent hovers in one place until its time is up? Print its Q-values there (0.6). If they
# are almost equal, the agent cannot yet tell the actions apart. If the value of flying on is too
# low, the agent has explored too little or fears crashing too much. If the values are right,
# hovering is what the reward pays for.
#
# Could a bonus for every step towards home help? If coming nearer is rewarded and going away costs
# nothing, the agent can earn the bonus again and again by flying to and fro (**reward hacking**). A
# safe bonus is $\gamma\Phi(s')-\Phi(s)$, where $\Phi$ is any number that depends on the state alone
# and is 0 after the end of the episode. This bonus is paid as the agent approaches a place and
# taken back as it leaves, so the best policy stays the same. This is **potential-based shaping**
# (Ng, Harada and Russell, 1999).
#
# How large must the crash penalty be? Ten steps ahead, a penalty of 20 units counts only $20 \cdot
# 0.95^{10} \approx 12$, less than the 15 units that a device in the village may hold, so collecting
# them and then crashing can pay. A penalty of 150 still counts 90.
#
# What if *every* reward were ten times as large? The best policy would be the same, but $\beta$ and
# the Huber loss would need scaling, too. Otherwise the agent would hardly explore, and more errors
# would lie in the straight part of the loss.
#
# ## 7.5 Two recipes
#
# The two recipes in this section share centred maps, the softmax policy, double Q-learning, the
# soft update with τ = 0.005, combined replay and γ = 0.95. `plain` is the paper's method with
# nothing added, but with a network small enough for an ordinary processor. `lite` is our own
# recipe, used to train the agent of this course. `docs/project/differences_from_the_paper.md` lists
# all changes in `lite`. Four of them show the idea:
#
# | in `lite` | what it is for |
# | --- | --- |
# | 32 UAVs fly side by side | more flights for each update |
# | three rewards before the Q-value in the target | news spreads faster |
# | $\beta$ from 2 to 0.1 | explore first, refine later |
# | crash reward from −10 to −150 | first fly far, then land in time |
#
# With three rewards before its Q-value, the target is a *three-step return*:
#
# $$y=r_t+\gamma r_{t+1}+\gamma^2r_{t+2}+\gamma^3\,Q_{\bar\theta}\big(s_{t+3},\arg\max_{a'}Q_\theta(s_{t+3},a')\big)$$
#
# If the episode ends within these steps, the sum ends there, without a $Q$.
#
# News spreads faster, but there is a price. In 6.1 the target asked for the *best* next action,
# whichever was taken. Here the second and third rewards were earned by an older agent that was
# exploring, so the target is a little too low on average. Strictly speaking, such a target is right
# only for flights that the present agent makes without exploring. (A *Monte Carlo* target takes all
# rewards to the end and no $Q$: it contains no wrong estimate, but all the luck of the flight.)
#
# `lite` also halves the cost of a step, to 0.1 units. Short runs over Manhattan collected and
# landed as much with 0.2, and used less time ([the page on the recipe](../docs/results/recipe.md)).
#
# The **paper's method** makes an update for every step, once its memory holds 25,000 random steps.
# The picture shows *training* flights from three runs of each recipe.

# %%
figure, ax = plt.subplots(figsize=(5.5, 2.6), layout="constrained")
for study, variant, colour in (("centring_plain", "centred", "C1"), ("ddqn", "lite", "C0")):
    runs = [curves(f"{study}-manhattan", variant, seed) for seed in range(3)]
    for run in runs:
        ax.semilogx(run["steps"], run["collected_and_landed"], colour, lw=0.7)
    steps, updates = runs[0]["steps"].max(), runs[0]["updates"].max()
    print(f"{study}: {steps:,.0f} steps with {updates:,.0f} updates")
ax.set(title="orange: plain; blue: lite", xlabel="steps, logarithmic",
       ylabel="collected and landed");

# %% [markdown]
# In the picture, `plain` improves after fewer steps than `lite`. But `plain` makes many more
# updates per step, and it explores less, because β is 0.1 throughout. The picture therefore
# compares steps, not work.
#
# ## Recap
#
# - Training is a loop: act, step, add, sample, update. The agent makes its own data.
# - In a validation the agent flies missions that training never uses, and always takes the best
#   action.
# - Look at **landed** and **collected** together. The loss tells you least.
# - With a large crash penalty from the start, an agent may become lazy, and without one it has
#   hardly any reason to come home.
#
# ## Exercises
#
# The [exercises of this notebook](exercises/07_training/07_training.ipynb) come with checks and
# hints. In exercise 7.1 you build a DQN of your own, which with enough rounds nearly matches
# greedy.
#
# Agents often do not learn at first. [My agent does not learn](../docs/tutorials/does_not_learn.md)
# says what to look at, and in which order.
#
# Further reading: Henderson et al., *Deep Reinforcement Learning that Matters*, 2018.
