# %% [markdown]
# # Exercises 0 · First flight
#
# These exercises go with notebook `00_first_flight`. You need Python, and no more.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it. The check says whether the answer is
# right, and if not, what is probably wrong. Hints are folded away below each task. Your code runs inside this notebook. If it
# never finishes, interrupt the kernel with the stop button.

# %% tags=["remove-cell"]
# Without uavdh_lite installed, as on Colab: install it from a wheel, or from the project's folder.
from glob import glob
from importlib.metadata import distributions

wheel = ""  # its address, if you were given one; a wheel that lies beside this notebook is found
places = ("..", ".", "../..", "../../..", *glob("*"))
project = [path for path in places if glob(f"{path}/uavdh_lite/city.py")]
if not any(distributions(name="uavdh_lite")):
    source = [*filter(None, [wheel]), *glob("uavdh_lite-*.whl"), *project]
    assert source, "upload the wheel beside this notebook, or set its address above"
    # %pip install -q "{source[0]}" ipywidgets
if project:
    # %cd -q {project[0]}/notebooks

# %%
# %matplotlib inline
from uavdh_lite.course import checks
from uavdh_lite.course.checks.notebook_00 import flights_to_tell_apart, mission, picture

# %% [markdown]
# ## 0.1 · The score of one flight (1 point, 5 minutes)
#
# `collected_and_landed` is the score by which flights are compared: the share of all data that was collected, or
# 0 if the UAV did not land. Compute it for one flight with one or more devices.
#
# - `collected`: a list of numbers, the data units collected from each device
# - `initial`: a list of the same length, the data units that each device had at the start. A device may have had 0, but
#   not all of them
# - `landed`: `True` or `False`
#
# Return one number between 0 and 1. All data units count the same, whichever device they come from.
#
# <details><summary>Hint</summary>
#
# A data unit counts the same whichever device it comes from. So what is divided by what? And when is the score
# 0, whatever was collected?
# </details>
#
# <details><summary>Another hint</summary>
#
# Divide the sum of all that was collected by the sum of all that was there. Return that if `landed` is true,
# and 0 if it is not.
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
# Over many flights one takes the mean of this number. That is not the mean share collected times the share of flights
# that landed: the flights that crash may be those that collected most.

# %% [markdown]
# ## 0.2 · Which flight is the agent's? (1 point, 5 minutes)
#
# Three pilots flew the same mission: the agent, greedy and random. Greedy always flies the shortest way to the nearest
# device that has data left, and home when the time just suffices. The triangle is the start. Who flew which flight?
#
# <details><summary>Hint</summary>
#
# One of the three has no plan at all. Which device do the other two fly to first?
# </details>
#
# <details><summary>Another hint</summary>
#
# Greedy has one rule: to the nearest device that has data left, and home when the time just suffices. From the
# start one device is 8 moves away and the other 13. Which of them does greedy fly to first?
# </details>

# %%
flights_to_tell_apart()

# %%
# Replace the line below by your dict, such as: who = {"A": "random", "B": "greedy", "C": "ddqn"}
### BEGIN SOLUTION
who = {"A": "ddqn", "B": "random", "C": "greedy"}
### END SOLUTION

# %%
checks.pilots(who)

# %% [markdown]
# The next exercise takes place in the *village*, a city of 8×8 cells. The cell below draws its mission.
# `picture(actions)` draws it again after a list of actions, to try things out: arrows, and rings where the UAV hovers,
# have the colour of the device that sent most in that step, and are black if none did. When the list is used up, the UAV
# hovers until time is up.

# %%
print("start", mission().start, "devices", mission().devices, "data", mission().data, "time", mission().flying_time)

picture([])

# %% [markdown]
# ## 0.3 · Fly by hand (3 points, 15 minutes)
#
# You are the agent. In the mission above the UAV starts at (row 0, column 0) and has 21 units of flying time. Each of
# two devices has 15 data units. One stands at (4, 1), in a cell where the UAV may not fly, red. The other is at (0, 7), in
# the far corner. Blue is the start and landing zone, black cells are tall buildings. Shades of violet say what is in sight: over
# a white cell the UAV sees both devices, over a pale violet one a building hides one of them, over a deeper one both.
#
# Write the list of all actions of the flight, by their names: `"north"` (one row up), `"east"` (one column to the right),
# `"south"`, `"west"`, `"hover"` (stay) and `"land"`. Each takes one unit of time, also the landing, which must be the
# last and in the landing zone. The flight must
#
# - collect at least 90 % of the data of both devices together,
# - land within the 21 units of time,
# - never try what is not allowed: leave the map, enter a no-fly cell or a tall building, land elsewhere.
#
# The luck of the radio link is always the same here, so that the same list gives the same flight. The link is best next
# to a device and without a building in between, but it also works while the UAV moves.
#
# <details><summary>Hint</summary>
#
# Count the time that each leg takes, landing included. Little is left for waiting, so collect on the move: from
# which cells next to the no-fly cells is the first device in sight, and which of them lie on a way to the
# second one and back?
# </details>
#
# <details><summary>Another hint</summary>
#
# Along row 0 towards the far corner, with hardly any time spent there. Then to (4, 2), one cell from the first
# device: back along row 0 and down the street in column 2 or 3, or down the eastern side and along row 4. Spend
# there what is left beyond the way home.
# </details>

# %%
# Replace the line below by your list, such as: actions = ["south", "hover", "land"]
### BEGIN SOLUTION
actions = ["east"] * 6 + ["hover"] + ["south"] * 4 + ["west"] * 4
actions += ["hover", "north", "north", "west", "north", "land"]
### END SOLUTION

# %%
checks.flown_by_hand(actions)

# %%
picture(actions)

# %% [markdown]
# The agent of the notebook finds such a way for any devices, data and time without a search: it looks at the map once
# for each step.
