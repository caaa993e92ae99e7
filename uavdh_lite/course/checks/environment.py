"""Exercises of notebook 3, the environment."""

import functools
import itertools

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import CheckFailed, close, compare, exercise, expect, show
from uavdh_lite.environment import (
    ACTIONS,
    HOVER,
    LAND,
    MOVES,
    Environment,
    Outcome,
    Rewards,
    schedule,
)
from uavdh_lite.plotting import BLUE, GREEN, ORANGE, RED
from uavdh_lite.streams import Use, stream


def _slot(snr_db, data_left):
    """The device that gets the slot and what it uploads, from the library's scheduler; (2,)."""
    served, uploaded, _ = schedule(snr_db[None, None], data_left[None])
    return np.array([served[0, 0], uploaded[0, 0]], float)


def _draw_slot(ax):
    snr_db = np.array([(4, 9, -2), (8, 6, 1), (5, 7, 3), (2, 8, 4), (-3, 9, -6), (6, 1, 2)], float)
    left, labels = np.array([4.0, 5.0, 3.0]), []
    colours = (ORANGE, BLUE, GREEN)
    for slot, snrs in enumerate(snr_db):
        device, amount = _slot(snrs, left)
        labels.append("\n".join(f"{s:g} dB, {d:.2g}" for s, d in zip(snrs, left, strict=True)))
        ax.bar(slot, amount, color=colours[int(device)])
        left[int(device)] -= amount
    for device, colour in enumerate(colours):
        ax.bar(0, 0, color=colour, label=f"device {device}")
    ax.set_xticks(range(len(labels)), labels, fontsize="small")
    ax.set(xlabel="a slot each: SNR and data left before it, of devices 0, 1, 2")
    ax.set(ylabel="uploaded, data units")
    ax.legend()


@exercise(
    "3.1",
    "Who gets the slot?",
    points=1,
    minutes=12,
    hints=(
        "First rule out the devices without data. Then the best of the rest, by its number among "
        "all devices. Then two limits on what it uploads.",
        "Let the empty devices stay in the array, with an SNR that never wins: then all numbers "
        "stay right. (Would 0 dB do?) What if all are empty? The winner uploads the smaller of "
        "two amounts.",
    ),
    figure=_draw_slot,
)
def tdma_slot(answer) -> None:
    """`slot(snr_db, data_left)`: the device served, or -1, and the data units it uploads."""

    def ask(snr_db, data_left):
        snr_db, data_left = np.array(snr_db, float), np.array(data_left, float)
        copies = snr_db.copy(), data_left.copy()
        result = answer(*copies)
        expect(
            isinstance(result, tuple | list | np.ndarray) and np.shape(result) == (2,),
            "Give back two numbers, the device and what it uploads: `return device, uploaded`. "
            f"Yours is {show(result)}.",
        )
        expect(
            (copies[1] == data_left).all() and (copies[0] == snr_db).all(),
            "Your function changes the arrays that it is given. It only says what is uploaded: "
            "take a copy if you need to change something.",
        )
        return np.array(result, float)

    ask.__name__ = getattr(answer, "__name__", "your function")

    def text(snr_db, data_left):
        return f"With the SNRs {snr_db} dB and the data left {data_left}"

    for snr_db in ([3.0, 8.0], [-4.0, -9.0, -6.0]):
        left = [0.0] * len(snr_db)
        device, uploaded = ask(snr_db, left)
        expect(
            device == -1 and uploaded == 0,
            f"{text(snr_db, left)} nobody may send: device -1, 0 data units. You give "
            f"({device:g}, {uploaded:.4g}).",
        )

    def case(*arguments):
        return tuple(np.array(values, float) for values in arguments)

    def among_the_rest(snr_db, left):
        snr_db, left = snr_db[left > 0], left[left > 0]
        return one(lambda snr, left: snr, limited)(snr_db, left)

    def nobody_if_empty(snr_db, left):
        device = int(snr_db.argmax())
        return (device, limited(snr_db[device], left[device])) if left[device] else (-1, 0)

    def one(choice, amount):
        def mistake(snr_db, left):
            device = int(choice(snr_db, left).argmax())
            return device, amount(snr_db[device], left[device])

        return mistake

    def best(snr_db, left):
        return np.where(left > 0, snr_db, -np.inf)

    def limited(snr_db, left):
        return min(rate(snr_db), left)

    mistakes = {
        "If the device with the best SNR is empty, nobody sends in yours: the next best device "
        "sends, of those with data left.": nobody_if_empty,
        "You serve a device that has nothing left: the slot goes to the best of those with data "
        "left.": one(lambda snr, left: snr, limited),
        "The device uploads more than it has: it is the smaller of the rate and the data left.": (
            one(best, lambda snr, left: rate(snr))
        ),
        "You serve a device that has nothing left and let it upload more than it has.": (
            one(lambda snr, left: snr, lambda snr, left: rate(snr))
        ),
        "The device uploads all it has, but a slot carries no more than the rate, log2(1 + SNR).": (
            one(best, lambda snr, left: left)
        ),
        "You upload as many data units as the SNR has decibels: turn it into a rate first, "
        "rate(snr_db).": one(best, min),
        "The rate is larger than the data left or smaller; the device uploads the smaller, min.": (
            one(best, lambda snr, left: max(rate(snr), left))
        ),
        "Your number counts only the devices with data left. Count all of them: the result is an "
        "index into snr_db.": among_the_rest,
        "Your index counts the filtered array, the devices with data left, but you use it in the "
        "full arrays.": one(lambda snr, left: snr[left > 0], limited),
        "An SNR times 0 is 0 dB, which is better than a negative SNR: an empty device must get "
        "−infinity instead.": one(lambda snr, left: snr * (left > 0), limited),
        "The slot goes to the device with the largest upload, but the rule is the best SNR.": (
            one(lambda snr, left: np.minimum(rate(snr), left), limited)
        ),
        "The slot goes to the device with the most data, but the rule is the best SNR.": (
            one(lambda snr, left: left, limited)
        ),
        "That is the device with the worst SNR of those with data left.": one(
            lambda snr, left: np.where(left > 0, -snr, -np.inf), limited
        ),
    }
    generator = stream(Use.EXERCISE, 3)
    cases = [
        case([4.0, 9.0, -2.0], [50.0, 30.0, 40.0]),
        case([4.0, 9.0, -2.0], [50.0, 0.0, 40.0]),
        case([12.0, 5.0, 9.0], [0.0, 50.0, 40.0]),
        case([-6.0, -11.0], [0.0, 8.0]),
        case([10.0, 3.0], [0.7, 8.0]),
    ]
    for _ in range(20):
        count = generator.integers(1, 6)
        left = generator.uniform(0.2, 8, count) * (generator.random(count) < 0.6)
        if left.any():
            cases.append(case(generator.normal(0, 8, count), left))
    compare(ask, _slot, cases, mistakes)


FLIGHTS = {
    # name: data left at the start by device, has it landed, and for each step what the link could
    # carry in it, from which device, and whether the safety controller intervened
    "A": (
        (4.0, 3.0),
        True,
        ((0.0, 0, 0), (0.5, 0, 1), (2.5, 0, 0), (2.5, 0, 0), (0.5, 1, 0), (2.0, 1, 0)),
    ),
    "B": ((6.0,), False, ((1.8, 0, 0), (1.0, 0, 1), (1.5, 0, 1))),
}


def _flown(name):
    """The terms of the reward, (steps,) each, and what the uploads and what is left would be."""
    left, landed, steps = FLIGHTS[name]
    carried, device, intervened = np.array(steps, float).T
    last = np.arange(len(steps)) == len(steps) - 1
    earlier = np.tri(len(steps), k=-1) * (device == device[:, None])  # [step, step before it]
    before = np.maximum(np.take(left, device.astype(int)) - earlier @ carried, 0)
    uploaded = np.where(last, 0, np.minimum(carried, before))
    outcome = Outcome(
        served=np.zeros((len(steps), 1), np.int8),
        uploaded=uploaded[:, None],
        intervened=intervened > 0,
        landed=last & landed,
        crashed=last & (not landed),
        flew=np.ones(len(steps), bool),
    )
    return Rewards().terms(outcome), carried, before, last


def _draw_by_hand(ax):
    for name, style in (("A", "o-"), ("B", "s-")):
        terms, _, _, last = _flown(name)
        total = sum(terms.values())
        crash = terms["crash"].sum()
        label = f"flight {name}" + (f", and then {crash:g} for the crash" if crash else "")
        returns = np.cumsum(total - terms["crash"])
        ax.plot(np.arange(len(last) + 1), np.append(0, returns), style, label=label)
    ax.set(xlabel="steps flown", ylabel="sum of the rewards so far", xticks=range(7))
    ax.grid(alpha=0.3)
    ax.set_ylim(-1.3, 3.3)
    ax.legend(loc="upper left")


@exercise(
    "3.2",
    "Rewards by hand",
    points=2,
    minutes=14,
    hints=(
        "Ask four questions of each step. What was uploaded? Did it land? Did the controller "
        "intervene? Did the time run out without a landing? More than one term may apply.",
        "Keep an account of each device's data left, because a step uploads no more than that, and "
        "the step that ends a flight uploads nothing. Only a landing is free of the 0.2, and the "
        "last step of flight B has three terms.",
    ),
    figure=_draw_by_hand,
)
def rewards_by_hand(answer) -> None:
    """`rewards_by_hand()`: two lists, the rewards of the steps of flights A and B."""
    given = answer()
    expect(
        isinstance(given, tuple | list) and len(given) == 2 and all(map(np.ndim, given)),
        "Give back two lists, the rewards of flight A and those of flight B.",
    )
    for name, numbers in zip(FLIGHTS, given, strict=True):
        steps = len(FLIGHTS[name][2])
        expect(
            len(numbers) == steps,
            f"Flight {name} has {steps} steps, your list has {len(numbers)} numbers.",
        )
        expect(
            not close(numbers, np.cumsum(sum(_flown(name)[0].values()))),
            f"Flight {name}: these are the sums of the rewards so far. The reward of each step by "
            "itself is asked for.",
        )
        for step, number in enumerate(numbers):
            if number is None or number is ...:
                raise CheckFailed(f"Flight {name}, step {step + 1} has no number yet.")
            reason = _why_not(name, step, number)
            expect(
                not reason, f"Flight {name}, step {step + 1}: {show(number)} is not right. {reason}"
            )


def _why_not(name, step, number):
    """What is probably wrong with the reward of this step; empty if nothing is."""
    all_terms, carried, before, last = _flown(name)
    terms = {term: float(values[step]) for term, values in all_terms.items()}
    carried, before, last = float(carried[step]), float(before[step]), bool(last[step])
    landed = last and FLIGHTS[name][1]
    total, rewards = sum(terms.values()), Rewards()

    def is_near(value):
        return close(number, value)

    if is_near(total):
        return ""
    forgotten = {
        "data": "The data uploaded is missing: it counts 1 for each data unit.",
        "movement": "The 0.2 for the step is missing: it is charged whenever the step does not "
        "land, also for hovering and for an intervention.",
        "safety": "The safety controller replaced the action: its penalty is missing.",
        "crash": "The time has run out and the UAV has not landed: the penalty for the crash is "
        "missing.",
    }
    guesses = [(total - value, forgotten[term]) for term, value in terms.items() if value]
    if landed:
        guesses += [
            (rewards.movement, "The step that lands does not pay for the movement."),
            (rewards.crash, "It landed with its last unit of time, and that is no crash."),
            (rewards.crash + rewards.movement, "It landed in time: no crash, no movement."),
        ]
    if last:
        upload = min(carried, before)
        guesses += [
            (total + amount, "In the step that ends the episode nothing is uploaded.")
            for amount in (upload, carried)
        ]
        guesses.append(
            (rewards.movement + carried, "That step ends the episode: nothing is uploaded in it.")
        )
    elif carried > before:
        guesses.append(
            (
                total + carried - before,
                f"The link could carry {carried:g}, but the device has only {before:g} left.",
            )
        )
    if not terms["safety"]:
        guesses.append(
            (total + rewards.safety, "The safety controller did not intervene in this step.")
        )
    guesses += [
        *(
            (value, f"That is the term for {term} alone: add the others that apply to this step.")
            for term, value in terms.items()
        ),
        (total - 2 * terms["movement"], "The 0.2 for the step is a price: subtract it."),
        (-total, "The sign is wrong: data is a gain, all other terms are prices."),
    ]
    for value, reason in guesses:
        if is_near(value):
            return reason
    return "Write down its four terms, for data, movement, safety and crash, and add them up."


def _rewards(uploaded, intervened, landed, crashed):
    flew = np.ones(len(landed), bool)
    return Rewards()(Outcome(None, uploaded, intervened, landed, crashed, flew))


def _draw_reward(ax):
    uploaded = np.linspace(0, 4, 9)[:, None] * np.full(4, 0.25)
    no, yes = np.zeros(9, bool), np.ones(9, bool)
    for style, label, events in (
        ("o-", "an ordinary step", (no, no, no)),
        ("s-", "with an intervention", (yes, no, no)),
    ):
        ax.plot(uploaded.sum(1), _rewards(uploaded, *events), style, label=label)
    landed = _rewards(uploaded[:1], no[:1], yes[:1], no[:1])
    crashed = _rewards(uploaded[:1], no[:1], no[:1], yes[:1])
    ax.plot(0, landed[0], "^", color=GREEN, ms=9, label="the step that lands")
    ax.plot([], [], " ", label=f"a crash, far below: {crashed[0]:.1f}")
    ax.set(xlabel="uploaded in the four slots together, data units", ylabel="reward")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")


@exercise(
    "3.3",
    "The reward of a batch",
    points=2,
    minutes=8,
    hints=(
        "A Boolean array counts as 0 and 1 in a product, so each term is a number times an array. "
        "Along which axis are the four slots?",
        "Sum the uploads over the second axis. Then ask of each of the three prices which array "
        "says where it is due; for one of them the array says where it is not.",
    ),
    figure=_draw_reward,
)
def reward(answer) -> None:
    """`reward(uploaded, intervened, landed, crashed)`: (B,), for a batch of steps."""
    constants = Rewards()

    @functools.wraps(answer)
    def ask(*arrays):
        copies = [array.copy() for array in arrays]
        try:
            result = answer(*copies)
        except CheckFailed as failed:
            if "truth value" not in str(failed):
                raise
            raise CheckFailed(
                "`if`, `and` and `or` cannot decide for a whole batch, where some episodes have "
                "landed and some have not. Use np.where, or multiply by the Boolean array."
            ) from None
        expect(
            all((a == b).all() for a, b in zip(arrays, copies, strict=True)),
            "Your function changes the arrays that it is given: make a new one for the reward.",
        )
        return result

    def variant(data=None, movement=None, safety=None, crash=None):
        def mistake(uploaded, intervened, landed, crashed):
            terms = (
                uploaded.sum(1) if data is None else data(uploaded),
                -0.2 * ~landed if movement is None else movement(intervened, landed, crashed),
                -1.0 * intervened if safety is None else safety(intervened),
                constants.crash * crashed if crash is None else crash(crashed, landed),
            )
            return sum(terms)

        return mistake

    def nothing(*_):
        return 0

    def always(intervened, landed, crashed):
        return np.full(len(landed), -0.2)

    mistakes = {
        "You sum over the episodes: the slots are the second axis of uploaded, .sum(1).": (
            variant(data=lambda uploaded: uploaded.sum(0) if len(uploaded) == 4 else np.nan)
        ),
        "You sum the uploads of all episodes together: each has its own reward, .sum(1).": (
            variant(data=lambda uploaded: uploaded.sum())
        ),
        "You take the mean of the four slots: the reward counts all that was uploaded, their "
        "sum.": variant(data=lambda uploaded: uploaded.mean(1)),
        "Only one of the four slots counts in yours: sum over all.": (
            variant(data=lambda uploaded: uploaded[:, 0])
        ),
        "You charge 0.2 for the step that lands too: it is free of it.": variant(movement=always),
        "You charge 0.2 only where the UAV has landed: it is the other way round.": (
            variant(movement=lambda i, landed, c: -0.2 * landed)
        ),
        "An intervention costs 1 in addition to the 0.2 for the step, not instead of it.": (
            variant(movement=lambda i, landed, c: -0.2 * ~(landed | i))
        ),
        "A crash comes in addition to the 0.2 for the step, not instead of it.": (
            variant(movement=lambda i, landed, c: -0.2 * ~(landed | c))
        ),
        "A step with an intervention or a crash costs the 0.2 too.": (
            variant(movement=lambda i, landed, c: -0.2 * ~(landed | c | i))
        ),
        "The 0.2 for the step is missing.": variant(movement=nothing),
        "The penalty for an intervention is missing.": variant(safety=nothing),
        "The penalty for a crash is missing.": variant(crash=nothing),
        "The terms for intervention and crash exclude each other in yours. In one step both can "
        "happen, and then both count.": (
            lambda u, i, landed, c: u.sum(1) - 0.2 * ~landed + np.where(i, -1.0, -150.0 * c)
        ),
        "The terms for intervention and crash exclude each other in yours. In one step both may "
        "happen, and then both count.": (
            lambda u, i, landed, c: u.sum(1) - 0.2 * ~landed + np.where(c, -150.0, -1.0 * i)
        ),
        "You punish each step without a landing as a crash: crashed says which.": (
            variant(crash=lambda crashed, landed: constants.crash * ~landed)
        ),
        "The prices have the wrong sign: they are subtracted.": (
            lambda u, i, landed, c: 2 * u.sum(1) - _rewards(u, i, landed, c)
        ),
    }

    def batch(uploaded, *events):
        return np.array(uploaded, float), *(np.array(event, bool) for event in events)

    generator = stream(Use.EXERCISE, 0)
    kinds = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 0, 0)])
    uploaded = generator.uniform(0, 4, (6, 4)) * ~kinds[:, 1:].any(1)[:, None]
    for rows in (kinds[:4], kinds):  # first as many episodes as slots: then any axis fits
        compare(ask, _rewards, [batch(uploaded[: len(rows)], *rows.T)], mistakes)
    for k in range(6):
        compare(ask, _rewards, [batch(uploaded[k : k + 1], *kinds[k : k + 1].T)], {})


class _Town(City):
    """A city that is short in messages."""

    def __repr__(self) -> str:
        return "city"


PLAIN = _Town.from_text("plain", ". . . . .\n. . . . .\n. . L . .\n. . . . .\n. . . . .")
SMALL = _Town.from_text(
    "small",
    """
    L . . . B
    . N . b .
    . . . b N
    B . . . .
    . . L . L
    """,
)


def _safe_step(city, cell, action):
    environment = Environment(city)
    number = cell[0] * city.size + cell[1]
    row, col = divmod(int(environment.next_cell[number, action]), city.size)
    return (row, col), bool(environment.forbidden[number, action])


def _draw_safe_step(ax):
    from uavdh_lite.plotting import draw_city

    draw_city(ax, SMALL)
    for cell in np.argwhere(~SMALL.no_fly).tolist():
        for action in range(4):
            _, intervened = _safe_step(SMALL, cell, action)
            row, col = cell + 0.3 * MOVES[action]
            ax.plot(col, row, "x" if intervened else ".", color=RED if intervened else "k")
        if not _safe_step(SMALL, cell, LAND)[1]:
            ax.text(cell[1], cell[0], "H", ha="center", va="center")
    for marker, colour, label in ((".", "k", "flies"), ("x", RED, "hovers instead")):
        ax.plot([], [], marker, color=colour, ls="", label=label)
    ax.plot([], [], marker="$H$", color="k", ls="", label="may land")
    ax.set_title("the four moves from each cell")
    ax.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))


def _kind(city, cell, action):
    """What is special about this action in this cell."""
    if action == HOVER:
        return "hover"
    if action == LAND:
        return "land" if city.landing[cell] else "land outside"
    row, col = np.add(cell, MOVES[action]).tolist()
    if not (0 <= row < city.size and 0 <= col < city.size):
        return "edge"
    if city.no_fly[row, col]:
        return "tall building" if city.buildings[row, col] else "no-fly zone"
    return "low building" if city.buildings[row, col] else "move"


# What may be wrong if the cell is wrong, and if only the second value is, by kind of action.
REASONS = {
    "move": (
        "North is one row up (row − 1), east one column to the right (col + 1), and the actions "
        "are numbered north, east, south, west, hover, land.",
        "Nothing is in the way there, so the controller does not intervene.",
    ),
    "hover": (
        "Hovering stays in the cell.",
        "Hovering is always allowed: the controller does not intervene, also if the UAV stays "
        "where it is.",
    ),
    "land": (
        "A UAV that lands stays in its cell.",
        "That cell is in the landing zone, so that landing is allowed.",
    ),
    "land outside": (
        "That cell is not in the landing zone: the UAV hovers instead, in its cell.",
        "That cell is not in the landing zone: the controller intervenes there too.",
    ),
    "edge": (
        "That leaves the grid, so the UAV hovers instead, in its cell.",
        "That leaves the grid: the UAV stays in its cell because the controller intervenes, so "
        "say True. (Limiting row and column to the grid hides it.)",
    ),
    "no-fly zone": (
        "That cell is a no-fly zone: the UAV hovers instead, in its cell.",
        "That cell is a no-fly zone, so the controller intervenes.",
    ),
    "tall building": (
        "That cell is a tall building, one that is in city.no_fly: the UAV hovers instead.",
        "That cell is a tall building, one that is in city.no_fly: the controller intervenes.",
    ),
    "low building": (
        "That building is low and may be flown over: only city.no_fly says where the UAV may not "
        "go, city.buildings is about the radio link.",
        "That building is low and may be flown over: only city.no_fly says where the controller "
        "intervenes.",
    ),
}


@exercise(
    "3.4",
    "The safety controller",
    points=3,
    minutes=20,
    hints=(
        "Four kinds of actions: hovering is always allowed, landing is a matter of one layer, and "
        "a move needs two questions about its target, in the right order.",
        "Work out the target's row and column. Ask first whether they are in the grid, from 0 to "
        "M − 1, and only then what city.no_fly says of them. Twice no: the UAV stays in its old "
        "cell, and that counts as an intervention.",
    ),
    figure=_draw_safe_step,
)
def safe_step(answer) -> None:
    """`safe_step(city, cell, action)`: the next cell, and whether the controller intervened."""

    def ask(city, cell, action):
        call = f"From {cell}, {ACTIONS[action]}"
        try:
            result = answer(city, cell, action)
        except CheckFailed as failed:
            if not isinstance(failed.__cause__, IndexError):
                raise
            raise CheckFailed(
                f"{call}: you look up a cell that does not exist ({failed.__cause__}). Ask first "
                f"whether row and column are from 0 to {city.size - 1}."
            ) from None
        right = (
            isinstance(result, tuple | list)
            and len(result) == 2
            and np.shape(result[0]) == (2,)
            and np.ndim(result[1]) == 0
        )
        expect(
            right,
            f"{call}: give back the cell and whether the controller intervened, `return (row, "
            f"col), intervened`. Yours is {show(result)}.",
        )
        expect(
            result[1] in (0, 1),
            f"{call}: whether the controller intervened must be True or False; yours is "
            f"{show(result[1])}. If you wrote ~, write `not`: in Python ~True is −2 and ~False is "
            "−1, and both count as True.",
        )
        return tuple(int(number) for number in result[0]), bool(result[1])

    for city in (PLAIN, SMALL, _Town.load("village")):
        cells = _inner_first(city, np.argwhere(~city.no_fly).tolist())
        for kind, (_, flag_wrong) in REASONS.items():
            for cell, action in itertools.product(cells, range(6)):
                if _kind(city, cell, action) != kind:
                    continue
                said, flag = ask(city, cell, action)
                right, intervened = _safe_step(city, cell, action)
                call = f"In a city of {city.size}×{city.size} cells, from {cell}, {ACTIONS[action]}"
                if city is SMALL:
                    call = (
                        f"In the city of hint 3 (safe_step.hint(3)), from {cell}, {ACTIONS[action]}"
                    )
                if (said, flag) != (right, intervened):
                    _expect_row_first(ask)
                expect(
                    said == right,
                    f"{call} leads to {said} in yours, and should to {right}. "
                    f"{_why_not_there(city, cell, action, said, flag)}",
                )
                expect(
                    flag == intervened,
                    f"{call}: the cell is right, but you say {flag}, not {intervened}. "
                    f"{flag_wrong}",
                )


def _expect_row_first(ask):
    """No layer is looked up as [col, row]; with the right order or other mistakes all is well."""
    cells = list(map(tuple, np.argwhere(~SMALL.no_fly).tolist()))
    inside = [
        (cell, action, (col, row))
        for cell, action in itertools.product(cells, range(4))
        for row, col in [np.add(cell, MOVES[action]).tolist()]
        if min(row, col) >= 0 and max(row, col) < SMALL.size
    ]
    for layer, looked_up in (
        ("no_fly", [ask(SMALL, c, a)[1] == SMALL.no_fly[place] for c, a, place in inside]),
        ("landing", [ask(SMALL, c, LAND)[1] != SMALL.landing[c[::-1]] for c in cells]),
    ):
        expect(
            not all(looked_up),
            f"You look up city.{layer}[col, row]. The row comes first: city.{layer}[row, col].",
        )


def _inner_first(city, cells):
    """Cells as tuples, from the middle to the border: there more may be special."""
    middle = (city.size - 1) / 2
    return sorted(map(tuple, cells), key=lambda cell: max(abs(k - middle) for k in cell))


def _why_not_there(city, cell, action, said, flag):
    """What is probably wrong with an answer that leads to the wrong cell."""
    kind, target = _kind(city, cell, action), np.add(cell, MOVES[action]).tolist()
    reason = REASONS[kind][0]
    if kind == "move" and said == cell and flag and {0, city.size - 1} & set(target):
        return f"Rows and columns go from 0 to {city.size - 1}, so that cell is in the grid."
    if kind == "edge" and city.size - 1 in np.abs(np.subtract(said, cell)):
        return "The UAV must not come back on the opposite side: it hovers instead."
    if kind == "edge" and -1 in target:
        return f"{reason} (In numpy, row or column −1 means the last one: no error warns you.)"
    return reason
