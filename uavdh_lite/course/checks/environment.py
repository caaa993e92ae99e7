"""Exercises of notebook 3, the environment."""

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.city import SIGNS, City
from uavdh_lite.course.checks.exercise import close, exercise, expect, solution
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.values import Unreadable, pair, truth
from uavdh_lite.environment import ACTIONS, HOVER, LAND, MOVES
from uavdh_lite.plotting import GREEN, draw_city
from uavdh_lite.streams import Use, stream


def _draw_slot(ax, solved):
    left = np.array([4.0, 5.0, 3.0])
    for slot, snr_db in enumerate(([4, 9, -2], [8, 6, 1], [5, 7, 3], [2, 8, 4], [-3, 9, -6])):
        device, amount = solved(np.array(snr_db, float), left)
        bar = ax.bar(slot, amount, color=f"C{device}")
        ax.bar_label(
            bar, [f"device {device}\nSNR {snr_db}\nleft {left.round(1).tolist()}"], fontsize=7
        )
        left[device] -= amount
    ax.margins(y=0.3)
    ax.set(xlabel="slot", ylabel="uploaded, data units")


@solution(
    "3.1 · Who gets the slot? (1 point, 12 minutes)",
    "First rule out the devices without data. Then the best of the rest, by its number among "
    "all devices. Then two limits on what it uploads.",
    "Let the empty devices stay in the array, with an SNR that never wins: then all numbers "
    "stay right. (Would 0 dB do?) What if all are empty? The winner uploads the smaller of "
    "two amounts.",
    figure=_draw_slot,
    rules={
        "If no device has data left, nobody may send: −1 and 0.": [
            *(([3.0, 8.0], [0.0, 0.0]), ([-70.0], [0])),
        ],
        "First comes the device's number, then what it uploads: what the slot carries, "
        "rate(snr_db), but no more than is left.": [
            *(([2], [9]), ([-30.0], [5.0]), ([60.0], [1000.0]), ([10.0], [0.7]), ([40.0], [1.5])),
        ],
        "The device with the highest SNR is served, however little it is ahead, and however much "
        "it has left, if it has any; its number is an index into snr_db.": [
            *(([4.0, 9.0, -2.0], [50.0, 30.0, 40.0]), ([5.0, 5.000001, 5.0], [9.0, 8.0, 9.0])),
            *(([-3, -1], [9, 9]), ([9.0, 3.0], [1.0, 50.0]), ([10.0, 3.0], [0.7, 8.0])),
        ],
        "A device without data is not served, but the others keep their numbers. The highest SNR "
        "among them wins; give that device's index in the full snr_db.": [
            *(([12, 5, 9], [0, 50, 40]), ([9.0, 8.0, 7.0], [0.0, 5.0, 6.0])),
            ([9.0, 3.0, 6.0, -2.5, 8.5], [0.0, 0.0, 2.0, 3.0, 0.0]),
        ],
        "That holds for the lowest SNRs too: none is too low to be served, 0 dB is not low. An "
        "empty device must get −infinity.": [
            *(([-6.0, -11.0], [0.0, 8.0]), ([5.0, -140.0], [0.0, 1.0])),
        ],
        "A device has data left if it is more than 0, however little.": [
            *(([8.0, 3.0], [1e-7, 9.0]), ([-8.0, -3.0, 2.0], [9.0, 1e-9, 0.0])),
        ],
    },
    read=pair,
    smallest=1e-12,
    made=lambda *arrays: tuple(map(np.array, arrays)),
)
def tdma_slot(snr_db, left):
    """`slot(snr_db, data_left)`: the device served, or -1, and the data units it uploads."""
    if not (left > 0).any():
        return -1, 0.0
    device = int(np.argmax(np.where(left > 0, snr_db, -np.inf)))
    return device, min(rate(snr_db[device]), left[device])


# Of each step the four terms of its reward, and what the link could carry in it
FLIGHTS = {
    "A": (
        *((0.0, -0.2, 0, 0, 0.0), (0.5, -0.2, -1, 0, 0.5), (2.5, -0.2, 0, 0, 2.5)),
        *((1.0, -0.2, 0, 0, 2.5), (0.5, -0.2, 0, 0, 0.5), (0.0, 0.0, 0, 0, 2.0)),
    ),
    "B": ((1.8, -0.2, 0, 0, 1.8), (1.0, -0.2, -1, 0, 1.0), (0.0, -0.2, -1, -150, 1.5)),
}


def _terms(data, movement, safety, crash, carried):
    return data + movement + safety + crash


TERMS = Table(
    _terms,
    {
        "Write down its four terms, for data, movement, safety and crash, and add them up.": [
            *FLIGHTS["A"],
            *FLIGHTS["B"],
        ]
    },
    mistakes={
        "That counts what the link could carry. A step uploads no more than the device has left, "
        "and in the step that ends an episode nothing is uploaded.": edit("data", "carried"),
        "The data uploaded is missing: it counts 1 for each data unit.": edit("data", "0"),
        "The 0.2 for the step is missing: it is charged whenever the step does not land, also for "
        "hovering and for an intervention.": edit("movement", "0"),
        "The controller replaced the action: its penalty is missing.": edit("safety", "0"),
        "The time has run out without a landing: the penalty for the crash is missing.": (
            edit("crash", "0")
        ),
        "The step that lands does not pay for the movement.": edit("movement", "-0.2"),
        "The safety controller did not intervene in this step.": edit("safety", "-1"),
        "Only the end of the time without a landing is a crash.": edit("crash", "-150"),
        "The 0.2 for the step is a price: subtract it.": edit("movement", "-movement"),
    },
)


def _draw_by_hand(ax):
    for name, steps in FLIGHTS.items():
        returns = np.cumsum([0, *(sum(step[:3]) for step in steps)])
        ax.plot(returns, "o-", label=f"flight {name}")
    ax.set(xlabel="steps flown", ylabel="sum of the rewards so far", ylim=(-1.3, 4.3))
    ax.set_title("without the 150 for the crash at the end of flight B")


@exercise(
    "3.2 · Rewards by hand (2 points, 14 minutes)",
    "Ask four questions of each step. What was uploaded? Did it land? Did the controller "
    "intervene? Did the time run out without a landing? More than one term may apply.",
    "Keep an account of each device's data left, because a step uploads no more than that, and "
    "the step that ends a flight uploads nothing. Only a landing is free of the 0.2, and the "
    "last step of flight B has three terms.",
    figure=_draw_by_hand,
)
def rewards_by_hand(answer) -> None:
    """`rewards_by_hand()`: two lists, the rewards of the steps of flights A and B."""
    given = answer()
    expect(
        isinstance(given, tuple | list)
        and len(given) == 2
        and all(hasattr(part, "__len__") and hasattr(part, "__getitem__") for part in given),
        "Give back two lists, the rewards of flight A and those of flight B.",
    )
    for (name, steps), rewards in zip(FLIGHTS.items(), given, strict=True):
        expect(
            len(rewards) == len(steps),
            f"Flight {name} has {len(steps)} steps, your list has {len(rewards)} numbers.",
        )
        expect(
            not close(rewards, np.cumsum([_terms(*step) for step in steps])),
            f"Flight {name}: these are the sums of the rewards so far. Give each step's own.",
        )
        for k, (reward, step) in enumerate(zip(list(rewards), steps, strict=True), 1):
            TERMS.by_hand(f"Flight {name}, step {k}", reward, step)


def _draw_reward(ax, solved):
    uploaded = np.linspace(0, 4, 9)
    for label, *event in (("an ordinary step", 0, 0, 0), ("with an intervention", 1, 0, 0)):
        rewards = solved(uploaded[:, None], *np.array(event, bool))
        ax.plot(uploaded, rewards, "o-", label=label)
    ax.plot(0, 0, "^", color=GREEN, label="the step that lands (a crash: -150.2)")
    ax.set(xlabel="uploaded in the four slots together, data units", ylabel="reward")


def _batch(events, whole=False):
    """Steps with random uploads; an event has the letters of what happens in it."""
    flags = np.array([[letter in event for letter in "ILC"] for event in events])
    uploaded = stream(Use.EXERCISE, len(events)).uniform(0, 4, (len(events), 4)).round(3)
    uploaded = uploaded * ~flags[:, 1:].any(1)[:, None]  # none in the step that ends it
    return uploaded.round().astype(int) if whole else uploaded, *flags.T


@solution(
    "3.3 · The reward of a batch (2 points, 8 minutes)",
    "A Boolean array counts as 0 and 1 in a product, so each term is a number times an array. "
    "Along which axis are the four slots?",
    "Sum the uploads over the second axis. Then ask of each of the three prices which array "
    "says where it is due; for one of them the array says where it is not.",
    figure=_draw_reward,
    rules={
        "An ordinary step earns the sum of its own four slots, .sum(1), less 0.2.": [
            *([""], ["", ""], [""] * 4, [""] * 5, ([""] * 3, True)),
        ],
        "Only the step that lands is free of the 0.2.": [["L"], ["L", ""], ["", "", "L"]],
        "An intervention costs 1, besides the 0.2.": [["I"], ["I", ""], ["", "I", "L"]],
        "A crash costs 150, besides the 0.2.": [["C"], ["C", ""], ["L", "C", "I"]],
        "All that applies is added. In one step an intervention and the crash can both happen.": [
            *(["IC"], ["IC", "C", "I"]),
        ],
        "Each episode of a batch has its own reward, also if there are four of them.": [
            *(["", "I", "L", "C"], ["I", "L", "C", "IC"], ["", "I", "L", "C", "IC", "", "I"]),
        ],
    },
    errors={
        "truth value": "`if`, `and` and `or` cannot decide for a whole batch, where some episodes "
        "have landed and some have not. Use np.where, or multiply by the Boolean array.",
    },
    made=_batch,
)
def reward(uploaded, intervened, landed, crashed):
    """`reward(uploaded, intervened, landed, crashed)`: (B,), for a batch of steps."""
    return uploaded.sum(1) - 0.2 * ~landed - 1.0 * intervened - 150.0 * crashed


class Town(City):
    """A city that a message shows by its signs, or by its name if it is known or large."""

    @classmethod
    def of(cls, name: str, *rows: str) -> "Town":
        return cls.from_text(name, "\n".join(rows))

    def __repr__(self) -> str:
        if self.name == "small":
            return "CITY_OF_HINT_3"
        text = "\n".join(" ".join(SIGNS[kind] for kind in row) for row in self.kinds)
        return f"City.from_text({self.name!r}, {text!r})" if self.size < 8 else self.name


SMALL = Town.of("small", "L...B", ".N.b.", "...bN", "B....", "..L.L")
TOWNS = (
    Town.of("plain", ".....", ".....", "..L..", ".....", "....."),
    SMALL,
    Town.of("seven", ".N..b..", "..B..L.", "N..b..N", ".b.L.B.", "L.N...b", "....N..", "B..L..N"),
    Town.of("two", "L.", ".N"),
)


def _draw_safe_step(ax, solved):
    draw_city(ax, SMALL)
    for cell in map(tuple, np.argwhere(~SMALL.no_fly).tolist()):
        for action in range(4):
            row, col = np.add(cell, 0.3 * MOVES[action])
            ax.plot(col, row, "rx" if solved(SMALL, cell, action)[1] else "k.")
        if not solved(SMALL, cell, LAND)[1]:
            ax.text(cell[1], cell[0], "H", ha="center", va="center")
    ax.set_title("the four moves from each cell (×: hovers instead)\nH: may land")


def _sign(city, cell, action):
    """The sign of the cell that an action leads to; empty outside of the grid."""
    row, col = np.add(cell, MOVES[action])
    inside = min(row, col) >= 0 and max(row, col) < city.size
    return SIGNS[city.kinds[row, col]] if inside else ""


STEPS = [
    (city, tuple(cell), action)
    for city in TOWNS
    for cell in np.argwhere(~city.no_fly).tolist()
    for action in range(6)
]


def _led(city, cell, action, _):
    target = tuple(np.add(cell, MOVES[action]).tolist())
    return f"Here action {action} is {ACTIONS[action]}, from {cell} to {target}."


def _cell_and_flag(value) -> np.ndarray:
    try:
        cell, flag = value
        return np.append(pair(cell), truth(flag))
    except Exception:
        raise Unreadable(
            "give back the cell and whether the controller intervened, True or False: `return "
            "(row, col), intervened`. (If you wrote ~, write `not`: in Python ~True is −2.)"
        ) from None


@solution(
    "3.4 · The safety controller (3 points, 20 minutes)",
    "Four kinds of actions: hovering is always allowed, landing is a matter of one layer, and "
    "a move needs two questions about its target, in the right order.",
    "Work out the target's row and column. Ask first whether they are in the grid, from 0 to "
    "M − 1, and only then what city.no_fly says of them. Twice no: the UAV stays in its old "
    "cell, and that counts as an intervention.",
    figure=_draw_safe_step,
    rules={
        "North is one row up (row − 1), east one column to the right (col + 1); the actions "
        "are numbered north, east, south, west, hover, land. Nothing is in the way there, so "
        "the controller does not intervene. Rows and columns go from 0 to M − 1.": (
            lambda *case: True
        ),
        "The building in the target cell is low and may be flown over: only city.no_fly says "
        "where the UAV may not go, city.buildings is about the radio link.": (
            lambda *case: _sign(*case) == "b"
        ),
        "The target is a no-fly zone or a tall building, one that is in city.no_fly: the UAV "
        "hovers instead, in its cell, and the controller intervenes.": (
            lambda *case: _sign(*case) in "NB"
        ),
        "That leaves the grid: the UAV hovers instead, in its cell, and the controller "
        "intervenes. (To numpy, row or column −1 is the last one: no error warns you.)": (
            lambda *case: not _sign(*case)
        ),
        "Hovering stays in the cell and is always allowed: the controller does not "
        "intervene.": lambda city, cell, action: action == HOVER,
        "A UAV that lands stays in its cell; in the zone the controller does not intervene.": (
            lambda city, cell, action: action == LAND
        ),
        "That cell is not in the landing zone, so landing is not allowed: the UAV hovers "
        "instead, in its cell, and the controller intervenes.": (
            lambda city, cell, action: action == LAND and not city.landing[cell]
        ),
    },
    among=STEPS,
    mistakes={
        "You look up city.no_fly[col, row]. The row comes first: city.no_fly[row, col].": (
            edit("no_fly[row, col]", "no_fly[col, row]")
        ),
        "You look up city.landing[col, row]. The row comes first: city.landing[row, col].": (
            edit("landing[cell]", "landing[cell[::-1]]")
        ),
    },
    read=_cell_and_flag,
    shown=lambda array: (tuple(array[:2].astype(int).tolist()), bool(array[2])),
    why=_led,
    errors={"out of bounds": "You look up a cell that does not exist: ask for the grid first."},
    again=False,
)
def safe_step(city, cell, action):
    """`safe_step(city, cell, action)`: the next cell, and whether the controller intervened."""
    if action == HOVER:
        return cell, False
    if action == LAND:
        return cell, not city.landing[cell]
    row, col = cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]
    inside = 0 <= row < city.size and 0 <= col < city.size
    if not inside or city.no_fly[row, col]:
        return cell, True
    return (row, col), False
