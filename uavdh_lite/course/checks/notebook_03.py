"""Exercises of notebook 3, the environment."""

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.city import SIGNS, City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.environment import HOVER, LAND, MOVES
from uavdh_lite.plotting import GREEN, draw_city
from uavdh_lite.streams import Use, stream


def draw_slot(ax, slot):
    left = np.array([4.0, 5.0, 3.0])
    for place, snr_db in enumerate(([4, 9, -2], [8, 6, 1], [5, 7, 3], [2, 8, 4], [-3, 9, -6])):
        device, amount = slot(np.array(snr_db, float), left)
        bar = ax.bar(place, amount, color=f"C{device}")
        said = f"device {device}\nSNR {snr_db}\nleft {left.round(1).tolist()}"
        ax.bar_label(bar, [said], fontsize=7)
        left[device] -= amount
    ax.margins(y=0.3)
    ax.set(xlabel="slot", ylabel="uploaded, data units")


def best_of(snr_db, left, empty=-np.inf):
    device = int(np.argmax(np.where(left > 0, snr_db, empty)))
    return device, min(rate(snr_db[device]), left[device])


@exercise(
    "3.1 · Who gets the slot? (1 point, 10 minutes)",
    "First rule out the devices without data. Then the best of the rest, by its number among "
    "all devices. Then two limits on what it uploads.",
    "Let the empty devices stay in the array, with an SNR that never wins: then all numbers "
    "stay right. Would 0 dB do? What if all are empty? The winner uploads the smaller of "
    "two amounts.",
    figure=draw_slot,
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
        "That holds for the lowest SNRs too: none is too low to be served.": [
            *(([-6.0, -11.0], [0.0, 8.0]), ([5.0, -140.0], [0.0, 1.0])),
        ],
        "A device has data left if it is more than 0, however little.": [
            *(([8.0, 3.0], [1e-7, 9.0]), ([-8.0, -3.0, 2.0], [9.0, 1e-9, 0.0])),
        ],
    },
    mistakes={
        "0 dB is not low: other devices may be below. An empty device must get −infinity.": (
            lambda snr_db, left: best_of(snr_db, left, 0) if left.any() else (-1, 0.0)
        ),
    },
    case=lambda *arrays: tuple(map(np.array, arrays)),
)
def tdma_slot(snr_db, left):
    """`slot(snr_db, data_left)`: the device served, or -1, and the data units it uploads."""
    return best_of(snr_db, left) if left.any() else (-1, 0.0)


# Of each step of both flights: what is uploaded, and the letters of what happens: I, L, C
FLIGHTS = {
    "A": ((0.0, ""), (0.5, "I"), (2.5, ""), (1.0, ""), (0.5, ""), (0.0, "L")),
    "B": ((1.8, ""), (1.0, "I"), (0.0, "IC")),
}
CARRIED = {("A", 4): 2.5, ("A", 6): 2.0, ("B", 3): 1.5}  # where the link could carry more
TERMS = {
    "The 0.2 for the step is due whenever the step does not land.": lambda at: "L" not in at,
    "The controller replaced the action: its penalty is 1.": lambda at: "I" in at,
    "The time has run out without a landing: that is a crash.": lambda at: "C" in at,
    "The step that lands does not pay for the movement.": lambda at: "L" in at,
}


def hand_reward(data, events):
    return data - 0.2 * ("L" not in events) - ("I" in events) - 150 * ("C" in events)


def wrong_rewards(answer) -> str:
    given = [list(part) for part in answer()]
    if [len(part) for part in given] != [6, 3]:
        return "Give back two lists: six rewards of flight A, three of flight B."
    if None in [*given[0], *given[1]]:
        return "Some steps have no number yet."
    for (name, steps), rewards in zip(FLIGHTS.items(), given, strict=True):
        right = [hand_reward(*step) for step in steps]
        if np.allclose(rewards, np.cumsum(right)):
            return f"Flight {name}: these are the sums of the rewards so far. Give each step's own."
        for k, (reward, (data, events)) in enumerate(zip(rewards, steps, strict=True), 1):
            carried = CARRIED.get((name, k), data)
            if np.isclose(reward, hand_reward(carried, events)) and carried != data:
                why = "A step uploads no more than is left, and the last step uploads nothing."
            else:
                due = [sentence for sentence, question in TERMS.items() if question(events)]
                why = " ".join(["Each data unit counts 1.", *due])
            if not np.isclose(reward, hand_reward(data, events)):
                return f"Flight {name}, step {k}: {reward:.4g} is not right. {why}"
    return ""


def draw_rewards(ax, _):
    for name, steps in FLIGHTS.items():
        returns = np.cumsum([0, *(hand_reward(data, events[:1]) for data, events in steps)])
        ax.plot(returns, "o-", label=f"flight {name}")
    ax.set(xlabel="steps flown", ylabel="sum of the rewards so far", ylim=(-1.3, 4.3))
    ax.set_title("without the 150 for the crash at the end of flight B")


@exercise(
    "3.2 · Rewards by hand (2 points, 10 minutes)",
    "Ask four questions of each step. What was uploaded? Did it land? Did the controller "
    "intervene? Did the time run out without a landing? More than one term may apply.",
    "Keep an account of each device's data left, because a step uploads no more than that, and "
    "the step that ends a flight uploads nothing. Only a landing is free of the 0.2, and the "
    "last step of flight B has three terms.",
    figure=draw_rewards,
    also=wrong_rewards,
)
def rewards_by_hand():
    """`rewards_by_hand()`: two lists, the rewards of the steps of flights A and B."""
    return [[hand_reward(*step) for step in steps] for steps in FLIGHTS.values()]


def draw_reward(ax, reward):
    uploaded = np.linspace(0, 4, 9)
    for label, *event in (("an ordinary step", 0, 0, 0), ("with an intervention", 1, 0, 0)):
        rewards = reward(uploaded[:, None], *np.array(event, bool))
        ax.plot(uploaded, rewards, "o-", label=label)
    ax.plot(0, 0, "^", color=GREEN, label="the step that lands (a crash: -150.2)")
    ax.set(xlabel="uploaded in the four slots together, data units", ylabel="reward")


def batch(events, whole=False):
    """Steps with random uploads; an event has the letters of what happens in it."""
    flags = np.array([[letter in event for letter in "ILC"] for event in events])
    uploaded = stream(Use.EXERCISE, len(events)).uniform(0, 4, (len(events), 4)).round(3)
    uploaded = uploaded * ~flags[:, 1:].any(1)[:, None]  # none in the step that ends it
    return uploaded.round().astype(int) if whole else uploaded, *flags.T


@exercise(
    "3.3 · The reward of a batch (2 points, 8 minutes)",
    "A Boolean array counts as 0 and 1 in a product, so each term is a number times an array. "
    "Along which axis are the four slots?",
    "Sum the uploads over the second axis. Then ask of each of the three prices which array "
    "says where it is due; for one of them the array says where it is not.",
    figure=draw_reward,
    rules={
        "An ordinary step earns the sum of its own four slots, .sum(1), less 0.2.": [
            *([""], ["", ""], [""] * 4, [""] * 5, ([""] * 3, True)),
        ],
        "Only the step that lands is free of the 0.2. `if` cannot decide for a whole batch.": [
            *(["L"], ["L", ""], ["", "", "L"]),
        ],
        "An intervention costs 1, besides the 0.2.": [["I"], ["I", ""], ["", "I", "L"]],
        "A crash costs 150, besides the 0.2.": [["C"], ["C", ""], ["L", "C", "I"]],
        "All that applies is added. In one step an intervention and the crash can both happen.": [
            *(["IC"], ["IC", "C", "I"]),
        ],
        "Each episode of a batch has its own reward, also if there are four of them.": [
            *(["", "I", "L", "C"], ["I", "L", "C", "IC"], ["", "I", "L", "C", "IC", "", "I"]),
        ],
    },
    case=batch,
)
def reward(uploaded, intervened, landed, crashed):
    """`reward(uploaded, intervened, landed, crashed)`: (B,), for a batch of steps."""
    return uploaded.sum(1) - 0.2 * ~landed - 1.0 * intervened - 150.0 * crashed


class Town(City):
    """A city that a message shows by its name or, if it is not in a figure, by its signs."""

    @classmethod
    def of(cls, name: str, *rows: str) -> "Town":
        return cls.from_text(name, "\n".join(rows))

    def __repr__(self) -> str:
        rows = ["".join(SIGNS[kind] for kind in row) for row in self.kinds]
        return "CITY_OF_HINT_3" if self.name == "small" else f"City({' '.join(rows)})"


SMALL = Town.of("small", "L...B", ".N.b.", "...bN", "B....", "..L.L")
TOWNS = (
    Town.of("plain", ".....", ".....", "..L..", ".....", "....."),
    SMALL,
    Town.of("seven", ".N..b..", "..B..L.", "N..b..N", ".b.L.B.", "L.N...b", "....N..", "B..L..N"),
    Town.of("two", "L.", ".N"),
)


def sign(city, cell, action):
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
BY_MOVE = {(c, cell, a): sign(c, cell, a) for c, cell, a in STEPS if a < HOVER}


def draw_safe_step(ax, safe_step):
    draw_city(ax, SMALL)
    for cell in map(tuple, np.argwhere(~SMALL.no_fly).tolist()):
        for action in range(4):
            row, col = np.add(cell, 0.3 * MOVES[action])
            ax.plot(col, row, "rx" if safe_step(SMALL, cell, action)[1] else "k.")
        if not safe_step(SMALL, cell, LAND)[1]:
            ax.text(cell[1], cell[0], "H", ha="center", va="center")
    ax.set_title("the four moves from each cell (×: hovers instead)\nH: may land")


@exercise(
    "3.4 · The safety controller (3 points, 15 minutes)",
    "Four kinds of actions: hovering is always allowed, landing is a matter of one layer, and "
    "a move needs two questions about its target, in the right order.",
    "Work out the target's row and column. Ask first whether they are in the grid, from 0 to "
    "M − 1, and only then what city.no_fly says of them. Twice no: the UAV stays in its old "
    "cell, and that counts as an intervention.",
    figure=draw_safe_step,
    rules={
        "North is one row up (row − 1), east one column to the right (col + 1). Nothing is in the "
        "way there, so the controller does not intervene.": [
            step for step, there in BY_MOVE.items() if there in (".", "L")
        ],
        "The building in the target cell is low and may be flown over: only city.no_fly says "
        "where the UAV may not go, city.buildings is about the radio link.": [
            step for step, there in BY_MOVE.items() if there == "b"
        ],
        "The target is a no-fly zone or a tall building, one that is in city.no_fly: the UAV "
        "hovers instead, in its cell, and the controller intervenes.": [
            step for step, there in BY_MOVE.items() if there in ("N", "B")
        ],
        "That leaves the grid: the UAV hovers instead, in its cell, and the controller intervenes. "
        "To numpy, row or column −1 is the last one: no error warns you.": [
            step for step, there in BY_MOVE.items() if there == ""
        ],
        "Hovering stays in the cell and is always allowed: the controller does not intervene.": [
            step for step in STEPS if step[2] == HOVER
        ],
        "A UAV that lands stays in its cell; in the zone the controller does not intervene.": [
            step for step in STEPS if step[2] == LAND and step[0].landing[step[1]]
        ],
        "That cell is not in the landing zone, so landing is not allowed: the UAV hovers "
        "instead, in its cell, and the controller intervenes.": [
            step for step in STEPS if step[2] == LAND and not step[0].landing[step[1]]
        ],
    },
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
