# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # 6 · From Q-learning to DDQN
#
# The agent is over cell (11, 8) and decides by the six numbers below, one for each action. Each is
# a **Q-value**: the sum of the rewards that the agent expects from now on if it takes that action
# and acts well afterwards, with later rewards counting less. **How can one number know about the
# rewards of the next twenty steps?**

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
import numpy as np
import torch
from matplotlib import pyplot as plt

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.missions import Mission

torch.set_num_threads(1)  # small networks
agent = load_agent("manhattan_ddqn")
q_now = agent.q_values(Mission(agent.city, (11, 8), [(4, 7), (11, 11)], [15, 10], 50).state)
figure, ax = plt.subplots(figsize=(6, 2.4), layout="constrained")
ax.set(ylabel="Q-value, data units")
ax.bar(("north", "east", "south", "west", "hover", "land"), q_now[0]);

# %% [markdown]
# | | |
# | --- | --- |
# | **What you'll do** | Follow a value through a table, watch a network explode, see what calms it; in the exercises, build all of it |
# | **What you'll learn** | The Bellman equation, discount, replay, target network, exploration, double Q-learning |
# | **What you'll need** | Notebooks 3 to 5. 50 minutes to read, 40 seconds to run; 110 minutes of exercises |
#
# ## 6.1 A table
#
# We begin with a city of four by four cells. The UAV starts in the south-west. In the north-east
# corner stands a device; reaching it brings 10 units of data and ends the episode. Each step costs
# 0.2 units.
#
# Imagine a table $Q$ with one number for each cell $s$ and action $a$. Each entry *should* be the
# sum that you earn from that cell onwards if you take that action and fly well afterwards. The last
# step brings $10-0.2=9.8$, and then the episode is over. The step before it costs 0.2 and leads to
# a cell from which 9.8 can be earned. And so on: a Q-value is the reward $r$ of its own step plus
# the best Q-value of the next cell $s'$, the largest over all actions $a'$. A factor $\gamma$ a
# little below 1, the *discount*, makes that second part count slightly less.
#
# $$Q(s,a)=r+\gamma\max_{a'}Q(s',a')$$
#
# This is the **Bellman equation** of the best policy. It answers the question at the top: no number
# has to know about twenty steps, because each only has to agree with its neighbour, and the
# neighbour with the next.
#
# Nobody gives us the table, so we start with zeros and let the UAV fly. Each step tells us $r$ and
# $s'$, and so the *current* value $y$ of the equation's right-hand side. The entry moves a fraction
# $\alpha$ of the way to $y$:
#
# $$y=r+\gamma\max_{a'}Q(s',a'),\qquad Q(s,a)\leftarrow Q(s,a)+\alpha\,\big(y-Q(s,a)\big)$$
#
# With $\gamma=0.95$ and $\alpha=0.5$, let us make two updates by hand. The UAV is one cell west of
# the device and flies east. Nothing follows the last step of an episode, so $y=r=9.8$, and the
# entry goes from 0 to 4.9. A few flights later, the UAV is in the next cell to the west and flies
# east: $y=-0.2+0.95\cdot4.9\approx4.5$. The news has moved one cell back. Here is the largest
# Q-value of each cell, the cell's *value* $V(s)=\max_aQ(s,a)$, after 1, 3 and 100 flights:

# %%
from uavdh_lite.course.small_city import CELLS, START, flights_of
from uavdh_lite.course.small_city import learn_network, learn_table, small_city
from uavdh_lite.plotting import draw_maps

def table(flights, gamma=0.95):
    generator = np.random.default_rng(0)
    return learn_table(small_city(), START, flights, gamma, 0.5, generator).max(axis=2)

draw_maps({f"flights: {n}": table(n) for n in (1, 3, 100)}, numbers=True)

# %% [markdown]
# After one flight only the last cell before the device knows that something good is near. (In the
# cells with −0.1 and −0.2, all four moves have been tried in vain.) Each further flight spreads the
# news, until the start is worth 6.7. A table thus solves **credit assignment** from back to front.
#
# ### Names
#
# The method is **Q-learning**. The value $y$ is the **target**, $\alpha$ the learning rate, and the
# gap $y-Q(s,a)$ the **TD error** (*temporal difference*): how much better or worse the step turned
# out than the table expected. In a **stochastic** world, where chance plays a part, the right-hand
# side of the Bellman equation is a mean; with a small $\alpha$, good and bad luck average out.
# Q-learning is *model-free*: it needs steps, but not notebook 3's distribution $p$. If $p$ were
# known, a small table could be computed without a flight (**dynamic programming**).
#
# The UAV picked all actions at random, and still learned what *good* flying is worth, because the
# target asks for the *best* next action, not for the one taken next. A method that can learn from
# the flights of another policy is called **off-policy**. (The other policy must try every action in
# every cell again and again.) An **on-policy** method, such as *SARSA*, would have learned what
# flying at random is worth.
#
# ### The last step
#
# At the last step of an episode, $y$ is $r$ alone. If you forget this, rewards seem to go on after
# a crash. But not every stop is an end. When our UAV's time is up, which the agent can foresee from
# the state, the mission is over: this is a true end, a **termination**. If the simulation merely
# stops, say after 1000 steps, that is a **truncation**: more rewards would have followed, so $y$
# keeps its second part.
#
# ### The discount
#
# The agent does not learn the plain sum of rewards of notebook 3, but a sum in which a reward $k$
# steps ahead counts only $\gamma^k$ times its size (paper, eq. 6). A Q-value is the expected value
# of that sum (eq. 5):
#
# $$Q(s_t,a_t)=\mathbb{E}\left[\sum_{k}\gamma^k\,r_{t+k}\right]$$

# %%
for gamma in (0.5, 0.95, 1.0):
    print(f"γ = {gamma:<5}the start is worth {table(300, gamma)[START]:.1f}")

# %% [markdown]
# With $\gamma=0.5$ the device hardly counts at the start. With $\gamma=1$ the device counts in
# full, which does no harm here: a flight that never ends costs more and more, so the best flights
# end. **Why discount, then, if the plain sum is what we want?**
#
# - *Errors.* Each value is estimated from the next, which is estimated from the one after it, and
#   so on. Each estimate adds an error, and $\gamma$ shrinks the errors from far away.
# - *Noise.* Rewards fifty steps ahead depend on fifty steps of fading and on fifty actions still to
#   be chosen, so they say little about which action is better *now*.
# - *Time.* With $\gamma=0.95$, news of a reward need not travel back more than a few dozen steps.
#   With $\gamma=1$, it has to travel back through the whole flight.
#
# The price is short-sightedness. The factors $1,\gamma,\gamma^2,\dots$ add up to $1/(1-\gamma)$,
# the **horizon**: 20 steps for $\gamma=0.95$, and 100 for 0.99. A crash that costs 150 units and is
# 60 steps ahead counts only $150\cdot0.95^{60}\approx7$. Over Manhattan, where home is never more
# than 14 moves away, that does no harm; a much longer way home may need a larger $\gamma$.
#
# ## 6.2 A network instead of the table
#
# A table for Manhattan would need a row for every combination of positions, times and amounts of
# data: for five devices, more than $10^{13}$ rows, even without the amounts. Instead, a network
# computes the Q-values from its inputs (in the small city, the row and column of the cell). It
# answers even for a cell it has never seen, and neighbouring cells get similar values. This is
# **generalisation**.
#
# In the table, an entry moved a fraction $\alpha$ of the way to $y$. Now the weights $\theta$ take
# a step downhill on the squared error (paper, eq. 7):
#
# $$L(\theta)=\mathbb{E}\big[(y-Q_\theta(s,a))^2\big]$$
#
# The target $y$ is computed with the network, too, but treated as a fixed number, because $Q$
# should move towards $y$, and not $y$ towards $Q$.
#
# ### Why a memory?
#
# A table may learn from the steps of a flight one after another. A network should not, for two
# reasons. Successive steps of a flight are much alike, so a network that learns from them in order
# fits what it has just seen and **forgets** the rest, because the same weights serve all places.
# And gradient descent works best with independent examples.
#
# Therefore all steps go into a **replay memory**, and the network learns from a *minibatch* drawn
# from it at random. Only an off-policy method may do this, because earlier, worse versions of the
# agent flew most of the stored steps.
#
# - *How large?* A small memory holds little but the last few flights, so it brings back the problem
#   that replay was meant to solve. A large one also holds older steps, flown by agents that knew
#   less. What counts is probably the number of *flights* in it ([notebook 11](11_replay.ipynb)).
# - *Should the newest step be in every minibatch?* Drawn at random from 50,000 steps, it would be
#   in about one in 400 minibatches of 128. The paper's **combined experience replay** puts it into
#   every minibatch, at the cost of one place in 128.
#
# ## 6.3 It explodes
#
# The memory below holds 100 random flights. All steps from or to cell (1, 1) have been left out, so
# that we can test what a network says about an unseen cell. Three networks start from different
# random weights, and each computes its own targets. The value of the start cell should become 6.7.

# %%
memory = flights_of(small_city(), 100)
memory = memory[~((memory[:, :2] == 1).all(1) | (memory[:, 4:6] == 1).all(1))]

def learn(tau, seed):
    torch.manual_seed(seed)
    return learn_network(memory, 0.95, tau, 1000)

# %%
copies = [learn(tau=1.0, seed=seed) for seed in range(3)]  # the next section explains τ
print("value of the start cell:", *(f"{path[-1]:,.0f}" for _, path in copies))

# %% [markdown]
# All three networks have exploded. Why, when a table does not?
#
# An update raises $Q(s,a)$ towards $y$. In a table nothing else would change. In the network the
# same weights also determine the values of the neighbouring cells, so those rise, too, and *the
# next cell $s'$ is a neighbour*. But $y$ is computed from the values of $s'$, so by moving towards
# the target the network has pushed the target away. Next time the gap is wider, and the chase
# continues.
#
# Three things have come together: a network that generalises, targets made from its own estimates
# (**bootstrapping**), and learning off-policy. Together they are the *deadly triad*: no theorem
# promises that such learning ends well.
#
# ### The target network
#
# The cure is simple: do not let the target move at once. A second network, the **target network**
# with the weights $\bar\theta$, computes $y$. It begins as a copy of the network that learns, the
# **online network** $\theta$, and after each update moves a small fraction $\tau$ of the way
# towards $\theta$ (a **soft update**):
#
# $$\bar\theta\leftarrow(1-\tau)\,\bar\theta+\tau\,\theta$$
#
# While the online network takes a step, the targets hardly move, so it can catch up with them. The
# target network lags about $1/\tau$ updates behind, 200 with the agent's $\tau=0.005$. With
# $\tau=0.00001$ the targets would stay meaningless for the whole run below; with $\tau=1$ the two
# networks would be identical. Here are three runs with $\tau=0.05$:

# %%
calm = [learn(tau=0.05, seed=seed) for seed in range(3)]
figure, ax = plt.subplots(figsize=(6, 3), layout="constrained")
for runs, style in ((copies, "C1"), (calm, "C0")):
    ax.plot(np.transpose([path for _, path in runs]), style, lw=1)
ax.set(xlabel="updates", ylabel="value of the start cell", yscale="symlog",
       title="orange: τ = 1; blue: τ = 0.05; three runs each")
assert min(path[-1] for _, path in copies) > 100 > max(path[-1] for _, path in calm)

# %% [markdown]
# All three runs with $\tau=0.05$ settle. Are their values right?

# %%
values = [online(CELLS).detach().amax(1).view(4, 4) for online, _ in calm]
draw_maps({"table": table(300), "network": values[0], "another": values[1]}, numbers=True)

# %% [markdown]
# The values are nearly right, even in cell (1, 1), which the networks never saw. Only the value of
# the device's cell is far off, because no step starts there.
#
# ## 6.4 Exploring
#
# In a large city random flights rarely get far, so the agent should use what it has learned
# (**exploitation**). But if it always takes the action that seems best, it may never find out that
# another is better. Trying other actions for the sake of knowledge is called **exploration**. The
# paper draws actions from a **softmax policy** with the **temperature** $\beta$ (eq. 10):
#
# $$\pi(a\mid s)=\frac{\exp(Q(s,a)/\beta)}{\sum_{a'}\exp(Q(s,a')/\beta)}$$

# %%
from uavdh_lite.course.quiz import Quiz

Quiz("cold_policy")

# %% [markdown]
# For the Q-values at the top, three temperatures give these probabilities:

# %%
from uavdh_lite.ddqn import softmax_policy

figure, axes = plt.subplots(1, 3, figsize=(7, 2.2), sharey=True, layout="constrained")
for ax, beta in zip(axes, (0.1, 1, 10)):
    ax.bar(list("NESWHL"), softmax_policy(q_now, beta)[0])
    ax.set(title=f"β = {beta}", ylim=(0, 1))
axes[0].set_ylabel("probability");

# %% [markdown]
# With a low β the agent nearly always takes one of the best actions; with a high β, almost any
# action. After training it follows the **greedy policy** (eq. 9): it always takes the best action.
#
# The best-known alternative is **ε-greedy**: it takes a random action with probability ε, and
# otherwise the best. The same ε suits Q-values of any size, whereas β must fit their size. But
# ε-greedy tries the worst action as often as the second best.
#
# One could also mask pointless actions (3.4), because the safety controller knows them. But then
# the maximum in the target must be masked, too, because the value of an action that is never tried
# is never corrected. The paper uses penalties; so do we.
#
# ## 6.5 Double Q-learning
#
# Q-values are estimates, so each has some error. In the first picture, landing would be refused and
# cost 1 unit more than hovering, so its bar should be 1 unit lower than that for hovering. It is
# nearly 7 units lower, perhaps because landing is hardly ever tried there, so that its value is
# hardly ever corrected. What do such errors do to the largest Q-value?

# %%
Quiz("whose_maximum")

# %% [markdown]
# The maximum asks the same estimates two questions: *which* action is best, and *what* is it worth?
# The estimate with the luckiest error answers both, so the value comes out too high: a
# **maximisation bias**. In **double Q-learning** one set of estimates chooses the action and
# another judges it. In the paper's target, the online network chooses and the target network judges
# (eq. 8):
#
# $$y=r+\gamma\,Q_{\bar\theta}\big(s',\arg\max_{a'}Q_\theta(s',a')\big)$$
#
# Let six actions all be worth 0, with random errors in their estimates, and ask three judges what
# the chosen action is worth:

# %%
from uavdh_lite.ddqn import ddqn_target

chooser, own = torch.randn(2, 20_000, 6)
for name, share in (("the chooser itself", 1.0), ("a related judge", 0.7), ("a stranger", 0.0)):
    # share is the correlation with the chooser's errors: 1 for equal ones, 0 for unrelated ones
    judge = share * chooser + (1 - share**2) ** 0.5 * own
    y = ddqn_target(torch.zeros(20_000), torch.ones(20_000), chooser, judge)  # reward 0, discount 1
    print(f"{name:<19} mean target {y.mean():5.2f}")

# %% [markdown]
# The right target is 0, and only the stranger finds it. The target network, an older copy of the
# online network, is a related judge, so it removes only part of the bias.
#
# No constant can correct the bias, because it is large where several actions are almost equally
# good and their values uncertain, and nearly 0 where one action is clearly the best. The bias
# therefore does not cancel when states are compared, and draws the agent to states about which it
# knows little.
#
# A deep network with double Q-learning is a *double deep Q-network*, or **DDQN**.
#
# ## 6.6 All of it
#
# [One page](../docs/tutorials/pseudocode.md) shows the whole algorithm as pseudocode, beside the
# names in the code.
#
# ## Recap
#
# - The Bellman equation ties each Q-value to those of the next state, so the news of a reward
#   spreads backwards.
# - A replay memory makes the examples of a minibatch nearly independent.
# - A network that makes its own targets may explode; a slow target network keeps it calm.
#
# ## Exercises
#
# In the [exercises of this notebook](exercises/06_ddqn/06_ddqn.ipynb) you build a deep Q-network.
#
# Further reading: Sutton and Barto, *Reinforcement Learning*, sections 6.5, 6.7 and 11.3; Mnih et
# al., 2015; van Hasselt et al., 2016.
