"""Exercises of notebook 0, the first flight."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.given import DATA, FLYING_TIME, PILOTS, flown
from uavdh_lite.environment import ACTIONS


@exercise(
    "0.1 · The score of one flight (1 point, 5 minutes)",
    rules={
        "The score of a UAV that has landed is the sum of all that was collected, divided by the "
        "sum of all that was there: a number from 0 to 1. Nothing is rounded.": [
            ([20.0, 0.0], [20.0, 5.0], True),
            ([6, 1], [8, 2], True),
            ([2.3, 0.4], [9.2, 6.6], True),
            ([1e-6, 0.0], [2e-6, 1e-6], True),
        ],
        "A UAV that has not landed scores 0, whatever it collected.": [
            ([18.0, 5.0], [20.0, 5.0], False),
            ([3.0], [3.0], False),
        ],
        "A device may have had no data at the start: divide once, by the sum.": [
            ([6.0, 0.0, 2.0], [12.0, 0.0, 4.0], True),
            ([0.0, 2.0], [0.0, 2.0], False),
        ],
    },
    mistakes={
        "Every data unit counts the same: do not average the devices' own ratios.": (
            lambda c, i, landed: landed * np.mean([x / y for x, y in zip(c, i, strict=True) if y])
        )
    },
)
def flight_score(collected, initial, landed):
    """`score(collected, initial, landed)`: the collected share of all data, 0 without landing."""
    return sum(collected) / sum(initial) if landed else 0.0


def wrong_pilots(answer: dict) -> str:
    names = ["ddqn", "greedy", "random"]
    if sorted(answer) != [*PILOTS] or sorted(map(str, answer.values())) != names:
        return 'Give each of A, B and C one of "ddqn", "greedy" and "random", using each once.'
    if answer["B"] != "random":
        return "Random flies without any aim, and its flight reaches no device."
    if answer["C"] != "greedy":
        return "Greedy flies to the nearest device with data. Which device is that at the start?"
    return ""


@exercise("0.2 · Which flight is the agent's? (1 point, 5 minutes)", takes=dict, also=wrong_pilots)
def pilots():
    """Who flew A, B and C: a dict of "ddqn", "greedy" and "random"."""


LEAST_SHARE = 0.9


def wrong_flight(actions: list[str]) -> str:
    for step, name in enumerate(actions, 1):
        if name not in ACTIONS:
            said = f"Step {step} is {name!r}. Give the names of actions, in lower case: "
            return f"{said}{', '.join(ACTIONS)}."
    flight = flown(actions)
    for step, (name, refused) in enumerate(zip(actions, flight.intervened, strict=False), 1):
        if refused:
            at = divmod(int(flight.uav_cell[step - 1]), 8)
            said = f"The safety controller intervened at step {step}, {name!r} from {at}: that "
            if name == "land":
                return f"{said}is outside the landing zone, the blue cells."
            said = f"{said}leads into a no-fly zone or a tall building, or off the map, so every "
            return f"{said}later step starts from the wrong cell."
    if not flight.landed and len(actions) < FLYING_TIME:
        return "The list ends with the UAV in the air: its last action must be `land`."
    if not flight.landed:
        return f"The flying time ran out after {FLYING_TIME} units. Landing takes one of them."
    if len(actions) > len(flight.action):
        return f"Landing at step {len(flight.action)} ends the flight: make `land` the last action."
    left = flight.data_left[-1, :2]
    if 1 - left.sum() / sum(DATA) < LEAST_SHARE:
        said = f"It lands, but the devices have {left[0]:.1f} and {left[1]:.1f} of 15 units left."
        said += " At least 90 % of all 30 must be collected: no more than 3 may be left."
        return f"{said} Unused units of time: {FLYING_TIME - len(actions)}."
    return ""


@exercise("0.3 · Fly by hand (3 points, 15 minutes)", takes=list, also=wrong_flight)
def flown_by_hand():
    """A list of action names that collects 90 % in the village mission and lands in time."""
