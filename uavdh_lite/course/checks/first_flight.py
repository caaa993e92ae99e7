"""Exercises of notebook 0, the first flight."""

import numpy as np

from uavdh_lite.course.checks.exercise import CheckFailed, exercise, expect
from uavdh_lite.course.checks.table import Edit, Table, edit
from uavdh_lite.course.checks.values import number, show
from uavdh_lite.environment import ACTIONS, LAND, MOVES
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.planners import Genie
from uavdh_lite.plotting import device_colour
from uavdh_lite.streams import Use, stream


def _score(collected, initial, landed):
    return sum(collected) / sum(initial) if landed else 0.0


def _draw_score(ax):
    collected = np.linspace(0, 20, 41)
    for landed, label in ((True, "landed"), (False, "not landed")):
        ax.plot(collected, [_score([c, 5.0], [20.0, 5.0], landed) for c in collected], label=label)
    ax.set(xlabel="collected from a device with 20 data units, data units")
    ax.set(ylabel="collection ratio and landed", ylim=(-0.05, 1.05))
    ax.set_title("the second device's 5 units are all collected")


def _score_cases():
    generator = stream(Use.EXERCISE, 1)
    drawn = []
    for count in (1, 3, 5, 8):
        initial = generator.uniform(5, 20, count).round(1)
        collected = (initial * generator.uniform(0.1, 0.9, count)).round(1)
        drawn.append((collected.tolist(), initial.tolist()))
    return {
        "The score of a UAV that has landed is the sum of all that was collected over the sum of "
        "all that was there: every data unit counts the same.": [
            *(([20.0, 0.0], [20.0, 5.0], True), ([6, 1], [8, 2], True), ([1.5], [6.0], True)),
            *((*flight, True) for flight in drawn),
        ],
        "All of the data is a score of 1, none of it a score of 0.": [
            *(([0.0, 0], [20.0, 5], True), ([20.0, 5.0], [20.0, 5.0], True), ([0], [3], True)),
        ],
        "A UAV that has not landed scores 0, whatever it collected.": [
            *((*flight, False) for flight in drawn[:2]),
            *(([18.0, 5.0], [20.0, 5.0], False), ([3.0], [3.0], False)),
        ],
        "A device may have had no data at the start: divide once, by the sum.": [
            *(([6.0, 0.0, 2.0], [12.0, 0.0, 4.0], True), ([0, 1], [0, 4], True)),
            ([0.0, 2.0], [0.0, 2.0], False),
        ],
        "Large and small amounts count alike, and nothing is rounded.": [
            *(([1e-6, 0.0], [2e-6, 1e-6], True), ([1e9, 1.0], [3e9, 1.0], True)),
        ],
    }


RATIOS = tuple(
    edit(
        "sum(collected) / sum(initial)",
        f"np.mean([c / i for c, i in zip(collected, initial, strict=True) {chosen}])",
    )
    for chosen in ("", "if i")
)
SCORE = Table(
    _score,
    _score_cases,
    mistakes={
        "You average the devices' own ratios, so that a device with little data counts as much "
        "as one with a lot. Add up first, then divide once.": RATIOS,
        "`landed` is not used: a UAV that did not land scores 0.": edit("if landed else 0.0", ""),
        "You average the devices' own ratios (add up first, then divide once), and `landed` is "
        "not used.": tuple(Edit((*one.changes, ("if landed else 0.0", ""))) for one in RATIOS),
        "`landed` is the wrong way round.": edit("if landed", "if not landed"),
        "That is a percentage: leave out the 100.": edit("return", "return 100 *"),
        "Divide by what there was at the start.": edit("/ sum(initial)", ""),
        "That is the share left at the devices.": edit("return", "return 1 -"),
        "Divide by all data, not by the number of devices.": edit("sum(initial)", "len(initial)"),
        "Only the first device counts. Sum over all of them.": (
            edit("sum(collected) / sum(initial)", "collected[0] / initial[0]")
        ),
    },
    read=number,
)


@exercise(
    "0.1 · The score of one flight (1 point, 5 minutes)",
    "A data unit counts the same whichever device it comes from. So what is divided by what? "
    "And when is the score 0, whatever was collected?",
    "Divide the sum of all that was collected by the sum of all that was there. Return that "
    "if `landed` is true, and 0 if it is not.",
    figure=_draw_score,
    table=SCORE,
)
def flight_score(answer) -> None:
    """`score(collected, initial, landed)`: the collected share of all data, 0 without landing."""


DEVICES, DATA, FLYING_TIME, LEAST_SHARE = ((4, 1), (0, 7)), (15.0, 15.0), 21, 0.9


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
        _expect_known(step, name)
    flight = HandFlight(environment_of("village"), mission())
    for step, name in enumerate(actions, 1):
        before = _cell(flight)
        if flight.step(ACTIONS.index(name)).intervened[0]:
            raise CheckFailed(
                f"The safety controller intervened at step {step}, {name!r} from {before}: "
                f"{_refusal(flight.environment.city, before, name)}"
            )
        if flight.ended:
            expect(
                flight.state.landed[0],
                f"The flying time ran out: after {step} of {FLYING_TIME} units the UAV is still in "
                "the air. The flight home takes time, and landing one unit more.",
            )
            expect(
                step == len(actions),
                f"The UAV lands at step {step}, and that ends the flight, but the list has "
                f"{len(actions)} actions. Put `land` last.",
            )
    return flight


def _expect_known(step: int, name) -> None:
    """Raise `CheckFailed` unless it is the name of an action."""
    if isinstance(name, str) and name in ACTIONS:
        return
    known = ", ".join(ACTIONS)
    if isinstance(name, int | np.integer):
        raise CheckFailed(f"Step {step} is the number {show(name)}. Give names: {known}.")
    almost = name.strip().lower() if isinstance(name, str) else ""
    meant = f" Did you mean {almost!r}?" if almost in ACTIONS else ""
    raise CheckFailed(f"Step {step} is {show(name)}, which is no action. There are {known}.{meant}")


def _refusal(city, cell: tuple[int, int], name: str) -> str:
    """Why the safety controller refused this action in this cell."""
    action = ACTIONS.index(name)
    if action == LAND:
        return "that is outside the landing zone, the blue cells."
    row, col = (int(part) for part in np.array(cell) + MOVES[action])
    if not (0 <= row < city.size and 0 <= col < city.size):
        return f"the map ends there. Rows and columns go from 0 to {city.size - 1}."
    what = "a tall building" if city.buildings[row, col] else "no-fly"
    return f"cell {row, col} is {what}. The UAV hovered instead, and all later steps are displaced."


def _cell(flight: HandFlight) -> tuple[int, int]:
    return divmod(int(flight.state.uav_cell[0]), flight.environment.city.size)


def _draw_flight(ax):
    environment = environment_of("village")
    flights = mission().fly(environment, Genie(environment, time_cost=0.01))
    left = flights.trajectory(0).data_left
    for device, cell in enumerate(DEVICES):
        ax.plot(left[:, device], ".-", color=device_colour(device), label=f"device at {cell}")
    ax.set(xlabel="time since the start, units of time", ylabel="data left, data units")
    share, steps = flights.end.collection_ratio[0], flights.steps[0]
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
    function=False,
)
def flown_by_hand(answer) -> None:
    """A list of action names that collects 90 % in the village mission and lands in time."""
    flight = fly_by_hand(answer)
    expect(answer, "The list is empty: put at least a first action into it.")
    expect(
        flight.ended,
        f"The list ends after {len(answer)} actions with the UAV in the air over {_cell(flight)}: "
        "its last action must be `land`, in the landing zone.",
    )
    share = float(flight.state.collection_ratio[0])
    left = " and ".join(
        f"{amount:.1f} of {whole:.0f} at the device {cell}"
        for amount, whole, cell in zip(flight.state.data_left[0], DATA, DEVICES, strict=False)
    )
    spare = FLYING_TIME - len(answer)
    unused = f" {spare} of {FLYING_TIME} units of time are not used." if spare else ""
    expect(
        share >= LEAST_SHARE,
        f"It lands, but with only {share:.1%} of the data, and {LEAST_SHARE:.0%} are asked for. "
        f"Left are {left} data units.{unused}",
    )
