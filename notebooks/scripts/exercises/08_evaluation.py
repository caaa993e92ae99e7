# %% [markdown]
# # Exercises 8 · Evaluation
#
# They go with notebook `08_evaluation`. You need means, standard deviations and the normal distribution; for 8.4 also
# notebook `03_environment` and some numpy.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the
# answer is right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.wilson.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
import math
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.course import checks
from uavdh_lite.environment import Rewards
from uavdh_lite.evaluation import FunctionPolicy, evaluate
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.plotting import draw_trajectory
from uavdh_lite.scenario import find_scenario

# %% [markdown]
# ## 8.1 · An interval for a share (2 points, 18 minutes)
#
# `successes` of `trials` missions ended well: a share $p$ of $n$. Which true shares $q$ are compatible with that? If $q$
# is the true share, then $p$ scatters around it with the standard error $\sqrt{q(1-q)/n}$, and lies within $z = 1.96$
# standard errors of it in 95 % of all cases. *Wilson's interval* are all $q$ with
#
# $$|p - q| \le z \sqrt{q (1 - q) / n}.$$
#
# Return its two ends, `(low, high)`, as shares from 0 to 1, to within 0.1 % of their value: solve the equation for $q$, a
# grid of shares is too coarse. Try to do without `wilson_interval` or another library's, that is the point of the
# exercise.

# %%
def wilson(successes, trials):
    """Low and high end of Wilson's 95 % interval for the share of successes."""
    ### BEGIN SOLUTION
    share, z = successes / trials, 1.96
    middle = share + z**2 / (2 * trials)
    half = z * math.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    below = 1 + z**2 / trials
    return (middle - half) / below, (middle + half) / below
    ### END SOLUTION

# %%
checks.wilson(wilson)

# %% [markdown]
# ## 8.2 · How many episodes (1 point, 5 minutes)
#
# The result of an episode scatters with `standard_deviation` around the true mean. How many independent episodes does
# one have to fly so that the 95 % interval of their mean (normal approximation, $z = 1.96$ standard errors) reaches at
# most `half_width` to either side? Both arguments are in the same unit. Return the smallest such number, an `int`.

# %%
def episodes_needed(standard_deviation, half_width):
    """The number of episodes for a 95 % interval of ± half_width."""
    ### BEGIN SOLUTION
    return math.ceil((1.96 * standard_deviation / half_width) ** 2)
    ### END SOLUTION

# %%
checks.episodes_needed(episodes_needed)

# %% [markdown]
# ## 8.3 · Paired or not (2 points, 8 minutes)
#
# Two policies flew the *same* $n$ scenarios; `a` and `b` are their results, two arrays of shape (n,), where `a[k]` and
# `b[k]` belong to the same scenario. By how much is the first ahead, and how sure is that?
#
# Return `(mean, low, high)`: the mean of $a - b$ and the ends of its 95 % interval, by the normal approximation
# (1.96 standard errors), with the standard deviation estimated with $n - 1$. Make use of the pairs, and leave `a` and `b`
# as they are.

# %%
def lead(a, b):
    """Mean lead of a over b with its 95 % interval: (mean, low, high)."""
    ### BEGIN SOLUTION
    difference = a - b
    half = 1.96 * difference.std(ddof=1) / math.sqrt(len(difference))
    return difference.mean(), difference.mean() - half, difference.mean() + half
    ### END SOLUTION

# %%
checks.lead(lead)

# %% [markdown]
# ## 8.4 · Beat the greedy planner (4 points, 45 minutes)
#
# The greedy planner always flies the shortest way to the nearest device with data left, and home when the time just
# suffices. Write a better rule for the city `manhattan`.
#
# `policy(environment, state)` is asked once a step for all episodes still in the air, B of them, and returns their
# actions: (B,) ints, 0 north, 1 east, 2 south, 3 west, 4 hover, 5 land. A cell is one number, `row * 16 + column`. Of use:
#
# | | shape | |
# | --- | --- | --- |
# | `state.uav_cell`, `state.time_left` | (B,) | the UAV's cell; remaining steps, landing included |
# | `state.device_cells`, `state.data_left` | (B, 5) | cells of the devices; data units left (places not used have 0) |
# | `state.ended` | (B,) | whether the episode is over, by a landing or a crash |
# | `replace(state, data_left=other)` | | a copy of the state with other data left |
# | `environment.next_cell[0]`, `environment.forbidden[0]` | (256, 6) | the cell after an action; whether the action is refused |
# | `environment.sight[0]` | (256, 256) | `[device cell, uav cell]` |
# | `environment.city.landing_distance.ravel()[cell]` | | moves to the nearest landing cell |
# | `greedy.act(state)` | (B,) | the greedy planner's actions; the cell below makes it |
# | `environment.transition(state, actions, fading)` | | the next state and an outcome; `fading` has the shape (B, 4, 5), zeros stand for the mean channel. Episodes already over stay as they are |
# | `Rewards()(outcome)` | (B,) | the reward of that step, 0 for episodes already over |
# | `moves_to(cell)` | (256,) | moves from every cell to this one, which the UAV must be allowed to enter |
#
# The check flies 300 missions of the scenario `manhattan`, the same with both policies and with the same fading. You
# have beaten greedy if your mean return (sum of the paper's rewards: 1 for a data unit, −0.2 a step, −150 for a crash) is
# ahead by at least 0.4, and the paired 95 % interval of the lead lies above 0. Skipping the last units of a device is not
# enough for that. Not allowed are the genie and trained agents; greedy may be a part of yours. All in all it may take 20
# seconds of processor time.
#
# To practise, other missions than those of the check: `practise(policy)` gives your lead, `ways(policy)` draws the
# mission in which you lose most to greedy.

# %%
environment, scenario = environment_of("manhattan"), find_scenario("manhattan")
greedy = Greedy(environment)

def moves_to(cell):
    """Moves from every cell to this one, (256,) ints; -1 where there is no way."""
    goal = np.arange(256).reshape(16, 16) == cell
    city = replace(environment.city, landing=goal, buildings=goal & False)
    return city.landing_distance.ravel()

def both(policy, seed):
    """The flights of policy and greedy in the same 300 missions."""
    pilots = FunctionPolicy(lambda state: policy(environment, state)), greedy
    return [evaluate(environment, pilot, scenario, 300, seed) for pilot in pilots]

def practise(policy, seed=0):
    """Lead over greedy on 300 missions, with the half width of its paired 95 % interval."""
    ours, theirs = (flights.records() for flights in both(policy, seed))
    for name in ("landed", "collected_and_landed", "return"):
        d = ours[name] - theirs[name]
        half = 1.96 * d.std(ddof=1) / 300**0.5
        print(f"{name:<28}{ours[name].mean():8.3f}   lead {d.mean():+.3f} ± {half:.3f}")

def ways(policy, seed=0):
    """The two flights of the mission in which policy loses most to greedy."""
    flown = both(policy, seed)
    worst = int((flown[0].returns - flown[1].returns).argmin())
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    for ax, name, flights in zip(figure.subplots(1, 2), ("yours", "greedy"), flown):
        draw_trajectory(ax, environment, flights.trajectory(worst))
        ax.set_title(f"mission {worst}, {name}: return {flights.returns[worst]:.1f}")
    return figure

# %%
def policy(environment, state):
    """The actions for a batch of states, (B,) ints."""
    ### BEGIN SOLUTION
    # Try each action, fly on with greedy through the mean channel, and take the best.
    fading, returns = np.zeros((len(state), 4, 5), np.float32), []
    for action in range(6):
        after, outcome = environment.transition(state, np.full(len(state), action), fading)
        total = Rewards()(outcome)
        while not after.ended.all():
            after, outcome = environment.transition(after, greedy.act(after), fading)
            total = total + Rewards()(outcome)
        returns.append(total)
    return np.argmax(returns, axis=0)
    ### END SOLUTION

# %%
checks.policy(policy)

# %% [markdown]
# `practise(policy)` on several seeds tells how far the lead depends on the missions. If you chose among many rules, the
# best of them on one seed will look better there than it is.
