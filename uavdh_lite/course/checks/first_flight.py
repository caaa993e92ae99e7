"""Exercises of notebook 0, the first flight."""

import numpy as np

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.course.checks.exercise import exercise, expect, solution
from uavdh_lite.course.checks.trial import expect_none
from uavdh_lite.course.checks.values import show
from uavdh_lite.environment import ACTIONS, MOVES
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.plotting import device_colour


def _draw_score(ax, solved):
    collected = np.linspace(0, 20, 41)
    for landed, label in ((True, "landed"), (False, "not landed")):
        ax.plot(collected, [solved([c, 5.0], [20.0, 5.0], landed) for c in collected], label=label)
    ax.set(xlabel="collected from a device with 20 data units, data units")
    ax.set(ylabel="collection ratio and landed", ylim=(-0.05, 1.05))
    ax.set_title("the second device's 5 units are all collected")


@solution(
    "0.1 · The score of one flight (1 point, 5 minutes)",
    "A data unit counts the same whichever device it comes from. So what is divided by what? "
    "And when is the score 0, whatever was collected?",
    "Divide the sum of all that was collected by the sum of all that was there. Return that "
    "if `landed` is true, and 0 if it is not.",
    figure=_draw_score,
    rules={
        "The score of a UAV that has landed is the sum of all that was collected over the sum of "
        "all that was there, from 0 to 1. Every data unit counts the same: do not average the "
        "devices' own ratios.": [
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
)
def flight_score(collected, initial, landed):
    """`score(collected, initial, landed)`: the collected share of all data, 0 without landing."""
    return sum(collected) / sum(initial) if landed else 0.0


DEVICES, DATA, FLYING_TIME, LEAST_SHARE = ((4, 1), (0, 7)), (15.0, 15.0), 21, 0.9
AT = "The safety controller intervened at step {step}, {name!r} from {before}: "
STEP = {  # what is said of a step of a flight, and when
    AT + "that is outside the landing zone, the blue cells.": (
        lambda at: at.intervened and at.name == "land"
    ),
    AT + "the map ends there. Rows and columns go from 0 to 7.": (
        lambda at: at.intervened and not {*at.target} <= {*range(8)}
    ),
    AT + "cell {target} is no-fly or a tall building. The UAV hovered instead, and all later steps "
    "are displaced.": lambda at: at.intervened,
    f"The flying time ran out: after {FLYING_TIME} units the UAV is still in the air. The flight "
    "home takes time, and landing one unit more.": lambda at: at.ended and not at.landed,
    "The UAV lands at step {step}, and that ends the flight, but the list has {steps} actions. "
    "Put `land` last.": lambda at: at.ended and at.step < at.steps,
}
FLIGHT = {  # what is said of a whole flight, and when
    "The list is empty: put at least a first action into it.": lambda flown: flown.steps == 0,
    "The list ends after {steps} actions with the UAV in the air over {cell}: its last action "
    "must be `land`, in the landing zone.": lambda flown: not flown.ended,
    f"It lands, but with only {{share:.1%}} of the data, and {LEAST_SHARE:.0%} are asked for. "
    "Left are {left} of 15 data units at the devices (4, 1) and (0, 7), and {unused} of "
    f"{FLYING_TIME} units of time are not used.": lambda flown: flown.share < LEAST_SHARE,
}


def mission() -> Mission:
    """The mission of exercise 0.2."""
    return Mission(environment_of("village").city, (0, 0), DEVICES, DATA, FLYING_TIME)


def fly_by_hand(actions) -> HandFlight:
    """The flight of these actions; raises `CheckFailed` if one of them cannot be flown."""
    expect(
        isinstance(actions, list | tuple),
        'actions must be a list of names, such as ["south", "hover", "land"].',
    )
    for step, name in enumerate(actions, 1):
        expect(
            isinstance(name, str) and name in ACTIONS,
            f"Step {step} is {show(name)}, which is no action. Give names, in small letters: "
            f"{', '.join(ACTIONS)}.",
        )
    flight = HandFlight(environment_of("village"), mission())
    for step, name in enumerate(actions, 1):
        before, action = _cell(flight), ACTIONS.index(name)
        expect_none(
            STEP,
            step=step,
            name=name,
            steps=len(actions),
            before=before,
            target=tuple(np.add(before, MOVES[action]).tolist()),
            intervened=flight.step(action).intervened[0],
            ended=flight.ended,
            landed=flight.state.landed[0],
        )
    return flight


def _cell(flight: HandFlight) -> tuple[int, int]:
    return divmod(int(flight.state.uav_cell[0]), flight.environment.city.size)


def _draw_flight(ax):
    environment = environment_of("village")
    flights = mission().fly(environment, Genie(environment, time_cost=0.01))
    left = flights.trajectory(0).data_left
    for device, cell in enumerate(DEVICES):
        ax.plot(left[:, device], ".-", color=device_colour(device), label=f"device at {cell}")
    ax.set(xlabel="time since the start, units of time", ylabel="data left, data units")
    share, steps = flights.end.collected[0], flights.steps[0]
    ax.set_title(f"one good flight: {share:.0%}, landed after {steps} of {FLYING_TIME}")


@exercise(
    "0.2 · Fly by hand (3 points, 15 minutes)",
    "Count the time that each leg takes, landing included. Little is left for waiting, so "
    "collect on the move: from which cells next to the no-fly cells is the first device in "
    "sight, and which of them lie on a way to the second one and back?",
    "Along row 0 towards the far corner, with hardly any time spent there. Then to (4, 2), one "
    "cell from the first device: back along row 0 and down the street in column 2 or 3, or "
    "down the eastern side and along row 4. Spend there what is left beyond the way home.",
    figure=_draw_flight,
    takes=(lambda answer: True, ""),  # what it must be is said by `fly_by_hand`
)
def flown_by_hand(answer) -> None:
    """A list of action names that collects 90 % in the village mission and lands in time."""
    flight = fly_by_hand(answer)
    expect_none(
        FLIGHT,
        steps=len(answer),
        cell=_cell(flight),
        ended=flight.ended,
        share=float(flight.state.collected[0]),
        left=" and ".join(f"{amount:.1f}" for amount in flight.state.data_left[0, :2]),
        unused=FLYING_TIME - len(answer),
    )
