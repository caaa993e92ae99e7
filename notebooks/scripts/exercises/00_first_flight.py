# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Exercises 0 · First flight
#
# These exercises go with notebook `00_first_flight`. All you need is Python.
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
from uavdh_lite.course import checks
from uavdh_lite.course.given import flights_to_tell_apart, mission, picture

# %% [markdown]
# ## 0.1 · The score of one flight (1 point, 5 minutes)
#
# `collected_and_landed` is the score by which flights are compared: the collected share of all
# data, or 0 if the UAV did not land. Compute it for one flight with one or more devices.
#
# - `collected`: a list of numbers, the data units collected from each device
# - `initial`: a list of the same length, the data units that each device had at the start. Some of
#   these numbers may be 0, but not all of them
# - `landed`: `True` or `False`
#
# Return one number between 0 and 1. All data units count the same, whichever device they come from.
#
# <details><summary>Hint</summary>
#
# All data units count the same, so which total do you divide by which? And when is the score 0,
# however much data was collected?
# </details>
#
# <details><summary>Another hint</summary>
#
# Divide the sum of `collected` by the sum of `initial`. Return the quotient if `landed` is true, and 0 if it is not.
# </details>

# %%
def collected_and_landed(collected, initial, landed):
    """The collected share of the data, or 0 if the UAV did not land."""
    ### BEGIN SOLUTION
    if not landed:
        return 0.0
    return sum(collected) / sum(initial)
    ### END SOLUTION

# %%
checks.flight_score(collected_and_landed)

# %% [markdown]
# To score many flights, take the mean of their scores. In general, this mean is not the mean
# collected share times the share of flights that landed, because the flights that crash may be
# those that collected the most.

# %% [markdown]
# ## 0.2 · Which flight is the agent's? (1 point, 5 minutes)
#
# Three pilots flew the same mission: the agent (`"ddqn"`), greedy and random. Greedy flies the
# shortest route to the nearest device that has data left, and turns for home when none has, or when
# just enough time is left to get there. The triangle marks the start. Which pilot flew which
# flight?
#
# <details><summary>Hint</summary>
#
# One of the three pilots flies without any aim. Which device do the other two pilots fly to first?
# </details>
#
# <details><summary>Another hint</summary>
#
# Greedy flies to the nearest device that has data left. One device is 8 moves from the start and
# the other 13. Which of the two does greedy fly to first?
# </details>

# %%
flights_to_tell_apart()

# %%
# Replace the line below with your dict, such as: who = {"A": "random", "B": "greedy", "C": "ddqn"}
### BEGIN SOLUTION
who = {"A": "ddqn", "B": "random", "C": "greedy"}
### END SOLUTION

# %%
checks.pilots(who)

# %% [markdown]
# The next exercise takes place in the *village*, a city of 8×8 cells. The code below draws the
# mission. To try things out, call `picture(actions)` with a list of actions: it draws the flight on
# the map. Arrows show moves, and rings show where the UAV hovers. Both have the colour of the
# device that sent the most data in that step, and are black if no device sent any. When the list is
# used up, the UAV hovers until its time is up.

# %%
print("start", mission().start, "devices", mission().devices, "data", mission().data, "time", mission().flying_time)

picture([])

# %% [markdown]
# ## 0.3 · Fly by hand (3 points, 15 minutes)
#
# You are the agent. In the mission above the UAV starts at (row 0, column 0) and has 21 units of
# flying time. Each of the two devices has 15 data units. One stands at (4, 1), in a no-fly cell
# (red). The other is at (0, 7), in a corner. The start and landing zone is blue, and tall buildings
# are dark grey. The shades of violet say how many devices are hidden: over a white cell the UAV
# sees both devices, over a pale violet cell one of them is hidden by a building, and over a deeper
# violet cell both are.
#
# Write a list of all actions of the flight, by name: `"north"` (one row up), `"east"` (one column
# to the right), `"south"`, `"west"`, `"hover"` (stay) and `"land"`. Each of these takes one unit of
# time, even the landing. The landing must be the last action and must take place in the landing
# zone. The flight must
#
# - collect at least 90 % of the data of both devices together,
# - land within the 21 units of time,
# - never try anything that is not allowed: leaving the map, entering a no-fly cell or a tall
#   building, or landing outside the landing zone.
#
# The random part of the radio link is the same every time here, so the same list always gives the
# same flight. The link is best near a device with no building in between. Data also comes in while
# the UAV moves.
#
# <details><summary>Hint</summary>
#
# Add up the time that each leg takes, landing included. Little time is left for waiting, so collect
# data on the move. From which of the cells next to the no-fly cells is the device at (4, 1) in
# sight, and which of these lie on a route to the other device and back?
# </details>
#
# <details><summary>Another hint</summary>
#
# Fly along row 0 to the cell beside the far device and hover there once or twice, or go on until
# you are above it. Then fly to (4, 2), one cell from the device at (4, 1), either back along row 0
# and down the street in column 2 or 3, or down the eastern side and along row 4. There is time for
# one hover there at most. From there, fly to the nearest cell of the landing zone, (1, 1).
# </details>

# %%
# Replace the line below with your list, such as: actions = ["south", "hover", "land"]
### BEGIN SOLUTION
actions = ["east"] * 6 + ["hover"] + ["south"] * 4 + ["west"] * 4
actions += ["hover", "north", "north", "west", "north", "land"]
### END SOLUTION

# %%
checks.flown_by_hand(actions)

# %%
picture(actions)

# %% [markdown]
# The agent of the notebook finds such a route over its own city in about nine missions out of ten,
# and it does so without searching: it looks at the map just once for each step.
