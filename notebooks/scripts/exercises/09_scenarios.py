# %% [markdown]
# # Exercises 9 · Scenarios
#
# They go with notebook `09_scenarios`. You need loops for 9.1; for 9.2 notebooks `04_map_centring` and
# `08_evaluation`, and patience.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the
# answer is right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.reachable.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
from collections import deque

import numpy as np

from uavdh_lite.course import checks
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

# %% [markdown]
# ## 9.1 · The way home (2 points, 18 minutes)
#
# How many moves does the UAV need from each cell to the nearest landing cell? A move goes one cell to the north (row − 1),
# east (column + 1), south or west; off the grid there is nothing. The UAV may enter every cell that is not in
# `city.no_fly`, also landing cells of either zone; `city.buildings` block radio links, and the tall ones of them
# are in `city.no_fly` as well. All of `city.landing`, `city.no_fly` and `city.buildings` are (M, M) Boolean arrays, indexed
# `[row, column]`; `city.size` is M.
#
# Return an (M, M) array of ints: 0 over the landing zone, −1 in no-fly cells and wherever no landing cell can be reached.
# Write the search yourself, without `city.landing_distance`.
#
# A *breadth-first* search visits cells in the order of their distance: it takes the cell that has waited longest in a queue
# and puts its new neighbours, one move further, at the queue's end. `queue = deque(cells)` makes such a queue of a list,
# `queue.popleft()` takes the first out, `queue.append(cell)` adds one at the end, and `while queue:` runs until it is empty.

# %%
def reachable(city):
    """Moves from each cell to the nearest landing cell, (M, M) ints; -1 where there is no way."""
    ### BEGIN SOLUTION
    distance = np.where(city.landing, 0, -1)
    queue = deque((int(row), int(col)) for row, col in np.argwhere(city.landing))
    while queue:
        row, col = queue.popleft()
        for r, c in ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1)):
            on_grid = 0 <= r < city.size and 0 <= c < city.size
            if on_grid and not city.no_fly[r, c] and distance[r, c] < 0:
                distance[r, c] = distance[row, col] + 1
                queue.append((r, c))
    return distance
    ### END SOLUTION

# %%
checks.reachable(reachable)

# %% [markdown]
# ## 9.2 · A city that defeats the agent (4 points, 20 minutes)
#
# The network of the agent `manhattan` can be asked about any city of 16×16 cells: it sees that city's maps. It was trained
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
# - the greedy planner's mean CRAL (collected and landed) is at least 90 %;
# - the agent's mean CRAL is at least 30 points below that of the greedy planner.
#
# `trial(text)` flies other missions of the same kind, to practise. With 100 missions the means vary by several points
# from one seed to another, and more where crashes are many: look for a city with 10 points or more to spare.

# %%
agent = load_agent("manhattan_ddqn")

def trial(text, missions=100, seed=0):
    city = City.from_text("your text", text)
    environment = Environment(city)
    for name, policy in (("greedy", Greedy(environment)), ("agent", agent.over(city))):
        metrics = evaluate(environment, policy, agent.scenario, missions, seed).metrics()
        print(f"{name:<8}landed {metrics['landed'].mean:6.1%}   collected "
              f"{metrics['collected'].mean:6.1%}   CRAL {metrics['collected_and_landed'].mean:6.1%}")
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
text = """
..............LL
..............LL
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
.NNNN...........
LL..............
"""
### END SOLUTION

# %%
checks.defeat(text)

# %% [markdown]
# An agent that was trained in one city may have learned much about that city and little about cities. Which of
# the layers that it sees does it use? An answer needs many cities, in training and in the test.
