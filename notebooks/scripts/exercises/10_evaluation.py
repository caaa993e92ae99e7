# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 10 · Evaluation
#
# These exercises go with notebook `10_evaluation`. You need means, standard deviations and the normal distribution.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook. If it
# never finishes, interrupt the kernel with the stop button.
#
# If you are still stuck after a quarter of an hour with all the hints, read the solution, close it, and write your own from
# memory. Solutions are in the folder `solutions`, beside `exercises`, unless somebody handed you a copy of the course without
# them.

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
import math

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.course import checks
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

# %% [markdown]
# ## 10.1 · How many missions must land? (2 points, 12 minutes)
#
# A customer wants it in writing that at least 99 % of the flights land, with an interval to show it. You plan the test flights. How many do you
# need if `crashes` of them crash?
#
# - `share`: the share of landings that is to be shown, between 0 and 1
# - `crashes`: how many of the missions crash, 0 or more
#
# Return the smallest number of missions $n$ for which the low end of Wilson's 95 % interval
# (notebook 10, section 10.2) is at least `share`. All missions but `crashes` of them end in a
# landing, so the share of landings is $p = (n - \text{crashes}) / n$, and with $z = 1.96$ the low
# end is
#
# $$\frac{1}{1 + z^2/n} \left(p + \frac{z^2}{2n} - z \sqrt{\frac{p\,(1 - p)}{n} + \frac{z^2}{4n^2}}\right).$$
#
# An example: if none crashes, 381 missions show 99 %, because $381 / (381 + 1.96^2)$ is just above 0.99, and 380 do not.
#
# <details><summary>Hint</summary>
#
# The low end rises with the number of missions, so try one number after another. Where does the search begin if some missions crash?
# </details>
#
# <details><summary>Another hint</summary>
#
# Write a small function for the low end of `n - crashes` landings in `n` missions. Begin at
# `crashes + 1`, and add 1 as long as the low end is below the share.
# </details>

# %%
def needed(share, crashes):
    """The smallest number of missions, these crashes among them, that shows this share of landings."""
    ### BEGIN SOLUTION
    def low_end(n):
        p, z = (n - crashes) / n, 1.96
        half = z * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return (p + z**2 / (2 * n) - half) / (1 + z**2 / n)

    n = crashes + 1
    while low_end(n) < share:
        n += 1
    return n
    ### END SOLUTION

# %%
checks.missions_needed(needed)

# %% [markdown]
# For a share of 99 %, each of the first three crashes costs another 150 to 180 missions, and each later one a little less. But do
# not fly on until the number looks good and then stop, because with such **optional stopping** you would deceive yourself. Decide
# how many missions to fly before the first of them takes off.

# %% [markdown]
# ## 10.2 · A city that defeats the agent (3 points, 12 minutes)
#
# The agent `manhattan_ddqn` can fly over any city of 16×16 cells, because its network sees the
# layers of that city. It was trained in only one city, called `home` below. Change at most 16 of
# the 256 cells of `home` so that the agent does badly, although missions over the changed city can
# be flown well. The city is a text of 16 rows of 16 characters:
#
# | character | cell |
# | --- | --- |
# | `.` | free |
# | `L` | start and landing zone (at least one) |
# | `N` | no-fly zone |
# | `B` | building that may not be flown over |
# | `b` | building that may be flown over; it still blocks the radio link |
#
# The city has to meet all of these conditions, on 100 fixed missions of the agent's own scenario (2
# to 5 devices, 5 to 20 data units each, 35 to 70 steps of flying time):
#
# - it is a valid city, and from every cell that the UAV may enter there is a way to the landing zone;
# - the greedy planner's mean share collected and landed is at least 90 %;
# - the agent's mean share is at least 30 points below that of the greedy planner.
#
# `trial(text)` flies other missions of the same kind, so that you can practise. With 100 missions
# the means vary by several points from one seed to another, and by more where crashes are frequent,
# so look for a city with 10 points or more to spare.
#
# <details><summary>Hint</summary>
#
# A planner computes its routes from the map. The agent has learned its routes in a single city.
# What was the same in every mission that it was trained on?
# </details>
#
# <details><summary>Another hint</summary>
#
# Start from `home` and change only where the UAV may land: move the zones to places where the agent
# has never landed. Keep two zones, far apart, or the routes get too long for greedy.
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
..BB.BB..BB.BB..
..BB.BB..BB.BB..
................
................
..BB.BB..BB.BB..
.NNNNBB..BB.BB..
.NNNN...........
.NBBNBB..BB.BB..
.NBBNBB..BB.BB..
.NNNN.........LL
..............LL
"""
trial(home)

# %%
# Replace the line below with your city: text = """..."""
### BEGIN SOLUTION
rows = home.split()
rows[:2] = ["..............LL"] * 2
rows[14:] = [".NNNN...........", "LL.............."]
text = "\n".join(rows)
### END SOLUTION

# %%
checks.defeat(text)

# %% [markdown]
# An agent that was trained in one city may have learned much about that city and little about cities in general. Which of the layers
# that it sees does it use? To find out, you need many cities, both in training and in the test.
