# %% [markdown]
# # Exercises 0 · First flight
#
# They go with notebook `00_first_flight`. You need Python, and no more.
#
# Write your answer where a cell raises `NotImplementedError`, then run the cell below it: it says whether the answer is
# right, and if not, what is probably wrong. Stuck? Each exercise has three hints; for example
# `checks.flight_score.hint()` in a cell of your own gives the first, again gives the next.

# %%
# %matplotlib inline
from matplotlib.figure import Figure

from uavdh_lite.course import checks
from uavdh_lite.course.checks.first_flight import fly_by_hand, mission
from uavdh_lite.missions import environment_of
from uavdh_lite.plotting import draw_trajectory

# %% [markdown]
# ## 0.1 · The score of one flight (1 point, 5 minutes)
#
# `collected_and_landed` is the score by which flights are compared: the share of all data that was collected, or
# 0 if the UAV did not land. Compute it for one flight with one or more devices.
#
# - `collected`: a list of numbers, the data units collected from each device
# - `initial`: a list of the same length, the data units that each device had at the start; a device may have had 0, but
#   not all of them
# - `landed`: `True` or `False`
#
# Give back one number between 0 and 1. All data units count the same, whichever device they come from.

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
# Over many flights one takes the mean of this number. That is not the mean collection ratio times the share of flights
# that landed: the flights that crash may be those that collected most.

# %% [markdown]
# The next exercise takes place in the *village*, a city of 8×8 cells. The cell below draws its mission.
# `picture(actions)` draws it again after a list of actions, to try things out: arrows, and rings where the UAV hovers,
# have the colour of the device that sent most in that step, and are black if none did.

# %%
def picture(actions):
    """The map after these actions, a list of names."""
    flight = fly_by_hand(actions)
    figure = Figure(figsize=(5, 5.6), layout="constrained")
    draw_trajectory(figure.subplots(), environment_of("village"), flight.flights().trajectory(0))
    return figure

print("start", mission().start, "devices", mission().devices, "data", mission().data, "time", mission().flying_time)

picture([])

# %% [markdown]
# ## 0.2 · Fly by hand (3 points, 15 minutes)
#
# You are the agent. In the mission above the UAV starts at (row 0, column 0) and has 21 units of flying time. Each of
# two devices has 15 data units; one stands at (4, 1), in a cell where the UAV may not fly (red), the other at (0, 7), in
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
