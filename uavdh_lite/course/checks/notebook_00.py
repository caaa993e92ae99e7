"""Exercises of notebook 0, the first flight."""

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.environment import ACTIONS, HOVER, LAND
from uavdh_lite.evaluation import FunctionPolicy, Trajectory
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import draw_trajectory
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario


def draw_score(ax, score):
    collected = np.linspace(0, 20, 41)
    for landed, label in ((True, "landed"), (False, "not landed")):
        ax.plot(collected, [score([c, 5.0], [20.0, 5.0], landed) for c in collected], label=label)
    ax.set(xlabel="collected from a device with 20 data units, data units")
    ax.set(ylabel="collected and landed", ylim=(-0.05, 1.05))
    ax.set_title("the second device's 5 units are all collected")


@exercise(
    "0.1 · The score of one flight (1 point, 5 minutes)",
    "A data unit counts the same whichever device it comes from. So what is divided by what? "
    "And when is the score 0, whatever was collected?",
    "Divide the sum of all that was collected by the sum of all that was there. Return that "
    "if `landed` is true, and 0 if it is not.",
    figure=draw_score,
    rules={
        "The score of a UAV that has landed is the sum of all that was collected over the sum of "
        "all that was there, from 0 to 1.": [
            *(([20.0, 0.0], [20.0, 5.0], True), ([6, 1], [8, 2], True), ([1.5], [6.0], True)),
            ([2.3, 7.1, 0.4, 11.9, 5.0], [9.2, 13.7, 6.6, 15.3, 5.1], True),
        ],
        "All of the data is a score of 1, none of it a score of 0.": [
            *(([20.0, 5.0], [20.0, 5.0], True), ([0], [3], True)),
        ],
        "A UAV that has not landed scores 0, whatever it collected.": [
            *(([18.0, 5.0], [20.0, 5.0], False), ([3.0], [3.0], False)),
        ],
        "A device may have had no data at the start: divide once, by the sum.": [
            *(([6.0, 0.0, 2.0], [12.0, 0.0, 4.0], True), ([0.0, 2.0], [0.0, 2.0], False)),
        ],
        "Large and small amounts count alike, and nothing is rounded.": [
            *(([1e-6, 0.0], [2e-6, 1e-6], True), ([1e9, 1.0], [3e9, 1.0], True)),
        ],
    },
    mistakes={
        "Every data unit counts the same: do not average the devices' own ratios.": (
            lambda collected, initial, landed: landed * np.mean(np.divide(collected, initial))
        ),
        "That is what is left. What was collected counts.": (
            lambda collected, initial, landed: landed * (1 - sum(collected) / sum(initial))
        ),
    },
)
def flight_score(collected, initial, landed):
    """`score(collected, initial, landed)`: the collected share of all data, 0 without landing."""
    return sum(collected) / sum(initial) if landed else 0.0


PILOTS = {"A": "manhattan_ddqn", "B": "random", "C": "greedy"}
SEED = 148  # of a mission in which the agent does not begin with the nearest device


def flights_to_tell_apart() -> Figure:
    """Three flights of one mission, A, B and C."""
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.city, SEED)
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    for ax, (letter, name) in zip(figure.subplots(1, 3), PILOTS.items(), strict=True):
        flown = mission.fly(environment, find_policy(name, environment))
        draw_trajectory(ax, environment, flown.trajectory(0)).set_title(f"flight {letter}")
    return figure


def wrong_pilots(answer) -> str:
    wrong = [letter for letter, name in PILOTS.items() if answer.get(letter) != name.split("_")[-1]]
    if sorted(answer.values(), key=str) != ["ddqn", "greedy", "random"]:
        return 'Give each of A, B and C one of "ddqn", "greedy" and "random", each of them once.'
    if "B" in wrong:
        return "Random goes back and forth, and reaches no device: its steps have no aim."
    if wrong:
        return "Greedy always flies to the nearest device with data left. Count the moves."
    return ""


def draw_pilots(ax, _):
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.city, SEED)
    for letter, name in PILOTS.items():
        flown = mission.fly(environment, find_policy(name, environment)).trajectory(0)
        collected = flown.data_left[0].sum() - flown.data_left.sum(1)
        ax.plot(collected, label=f"flight {letter}: {name}")
    ax.set(xlabel="time since the start, units of time", ylabel="collected, data units")


@exercise(
    "0.2 · Which flight is the agent's? (1 point, 5 minutes)",
    "One of the three has no plan at all. Which device do the other two fly to first?",
    "Greedy has one rule: to the nearest device that has data left, and home when the time just "
    "suffices. From the start, count the moves to each device.",
    figure=draw_pilots,
    takes=dict,
    also=wrong_pilots,
)
def pilots():
    """Who flew A, B and C: a dict of "ddqn", "greedy" and "random"."""


DEVICES, DATA, FLYING_TIME, LEAST_SHARE = ((4, 1), (0, 7)), (15.0, 15.0), 21, 0.9


def mission() -> Mission:
    """The mission of exercise 0.3."""
    return Mission(environment_of("village").city, (0, 0), DEVICES, DATA, FLYING_TIME)


def flown(actions: list[str]) -> Trajectory:
    """The flight of these actions; once they are used up, the UAV hovers."""
    left = iter([ACTIONS.index(name) for name in actions])
    policy = FunctionPolicy(lambda state: np.array([next(left, HOVER)]))
    return mission().fly(environment_of("village"), policy).trajectory(0)


def picture(actions: list[str]) -> Figure:
    """The map after these actions."""
    figure = Figure(figsize=(5, 5.6), layout="constrained")
    draw_trajectory(figure.subplots(), environment_of("village"), flown(actions))
    return figure


def wrong_flight(actions) -> str:
    for step, name in enumerate(actions, 1):
        if name not in ACTIONS:
            return f"Step {step} is {name!r}. Give names, in small letters: {', '.join(ACTIONS)}."
    flight = flown(actions)
    refused = [k for k in range(min(len(actions), len(flight.action))) if flight.intervened[k]]
    if refused:
        row, col = divmod(int(flight.uav_cell[refused[0]]), 8)
        why = (
            "that is outside the landing zone, the blue cells"
            if flight.action[refused[0]] == LAND
            else "the map ends there, or the cell is no-fly or a tall building"
        )
        said = f"{actions[refused[0]]!r} from ({row}, {col}): {why}"
        return f"The safety controller intervened at step {refused[0] + 1}, {said}."
    if not flight.landed and len(actions) < FLYING_TIME:
        return "The list ends with the UAV in the air: its last action must be `land`."
    if not flight.landed:
        return f"The flying time ran out after {FLYING_TIME} units, and landing takes one more."
    if len(actions) > len(flight.action):
        return (
            f"The UAV lands at step {len(flight.action)}, which ends the flight: put `land` last."
        )
    share = 1 - flight.data_left[-1].sum() / sum(DATA)
    left = " and ".join(f"{amount:.1f}" for amount in flight.data_left[-1, :2])
    if share < LEAST_SHARE:
        said = f"It lands, but with only {share:.1%} of the data, and {LEAST_SHARE:.0%} are asked"
        spare = FLYING_TIME - len(actions)
        return f"{said} for. The devices have {left} units left; {spare} units of time are spare."
    return ""


def draw_flight(ax, _):
    out = ["east"] * 6 + ["hover"] + ["south"] * 4 + ["west"] * 4
    flight = flown([*out, "hover", "north", "north", "west", "north", "land"])
    for device, cell in enumerate(DEVICES):
        ax.plot(flight.data_left[:, device], ".-", label=f"device at {cell}")
    ax.set(xlabel="time since the start, units of time", ylabel="data left, data units")


@exercise(
    "0.3 · Fly by hand (3 points, 15 minutes)",
    "Count the time that each leg takes, landing included. Little is left for waiting, so "
    "collect on the move: from which cells next to the no-fly cells is the first device in "
    "sight, and which of them lie on a way to the second one and back?",
    "Along row 0 towards the far corner, with hardly any time spent there. Then to (4, 2), one "
    "cell from the first device: back along row 0 and down the street in column 2 or 3, or "
    "down the eastern side and along row 4. Spend there what is left beyond the way home.",
    figure=draw_flight,
    takes=list,
    also=wrong_flight,
)
def flown_by_hand():
    """A list of action names that collects 90 % in the village mission and lands in time."""
