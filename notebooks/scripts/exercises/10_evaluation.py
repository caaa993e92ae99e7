# %% [markdown]
# # Exercises 10 · Evaluation
#
# These exercises go with notebook `10_evaluation`. You need means, standard deviations and the normal distribution.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook.
# If it never finishes, interrupt the kernel with the stop button.

# %%
# %matplotlib inline
import math

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.course import checks
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

# %% [markdown]
# ## 10.1 · An interval for a share (2 points, 12 minutes)
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
#
# <details><summary>Hint</summary>
#
# At both ends of the interval the inequality is an equality. Square it: what kind of equation in q is that?
# </details>
#
# <details><summary>Another hint</summary>
#
# (p − q)² = z² q (1 − q) / n is quadratic in q. Its solutions are (p + z²/(2n) ± z sqrt(p (1 − p)/n +
# z²/(4n²))) / (1 + z²/n), with p = successes / trials.
# </details>

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
# ## 10.2 · A city that defeats the agent (3 points, 12 minutes)
#
# The network of the agent `manhattan_ddqn` can be asked about any city of 16×16 cells: it sees that city's maps. It was trained
# in one, `home` below. Change at most 16 of the 256 cells of `home` so that the agent does badly although the missions
# there are possible. The city is a text of 16 rows of 16 signs:
#
# | sign | cell |
# | --- | --- |
# | `.` | free |
# | `L` | start and landing zone (at least one) |
# | `N` | no-fly zone |
# | `B` | building that may not be flown over |
# | `b` | building that may be flown over; it still blocks the radio link |
#
# It has to meet all of these conditions, on 100 fixed missions of the agent's own scenario (2 to 5 devices, 5 to 20 data
# units each, 35 to 70 steps of flying time):
#
# - it is a valid city, and from every cell that the UAV may enter there is a way to the landing zone;
# - the greedy planner's mean share collected and landed is at least 90 %;
# - the agent's is at least 30 points below that of the greedy planner.
#
# `trial(text)` flies other missions of the same kind, to practise. With 100 missions the means vary by several points
# from one seed to another, and more where crashes are many: look for a city with 10 points or more to spare.
#
# <details><summary>Hint</summary>
#
# A planner computes its ways from the map. The agent has learned its ways in one single city. What was the same
# in every mission that it was trained on?
# </details>
#
# <details><summary>Another hint</summary>
#
# Start from `home` and change only where the UAV may land: move the zones to places that it never landed in.
# Leave two of them, far apart, or the ways get too long for greedy.
# </details>

# %%
agent = load_agent("manhattan_ddqn")

def trial(text, missions=100, seed=0):
    city = City.from_text("your text", text)
    environment = Environment(city)
    for name, policy in (("greedy", Greedy(environment)), ("agent", agent.over(city))):
        metrics = evaluate(environment, policy, agent.scenario, missions, seed).metrics()
        print(f"{name:<8}landed {metrics['landed'].mean:6.1%}   collected "
              f"{metrics['collected'].mean:6.1%}   both {metrics['collected_and_landed'].mean:6.1%}")
    print("cells changed:", (city.kinds != agent.city.kinds).sum())

home = """
LL..............
LL..............
..BB.BB..BB.BB..
..BB.BB..BB.BB..
................
..BB.bb..BB.BB..
..BB.bb..BB.BB..
................
................
..BB.BB..bb.BB..
.NNNNBB..bb.BB..
.NNNN...........
.NBBNBB..BB.BB..
.NBBNBB..BB.BB..
.NNNN.........LL
..............LL
"""
trial(home)

# %%
# Replace the line below by your city: text = """..."""
### BEGIN SOLUTION
rows = home.split()
rows[:2] = ["..............LL"] * 2
rows[14:] = [".NNNN...........", "LL.............."]
text = "\n".join(rows)
### END SOLUTION

# %%
checks.defeat(text)

# %% [markdown]
# An agent that was trained in one city may have learned much about that city and little about cities. Which of
# the layers that it sees does it use? An answer needs many cities, in training and in the test.
