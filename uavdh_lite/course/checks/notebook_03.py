"""Exercises of notebook 3, the environment."""

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.given import Unfit
from uavdh_lite.environment import ACTIONS, HOVER, LAND, MOVES


@exercise(
    "3.1 · Who gets the slot? (1 point, 10 minutes)",
    rules={
        "If no device has data left, nobody may send: return −1 and 0.": [
            ([3.0, 8.0], [0.0, 0.0]),
            ([-70.0], [0]),
        ],
        "First comes the device's number, then what it uploads: what the slot carries, "
        "rate(snr_db), but no more than is left.": [
            ([2], [9]),
            ([60.0], [1000.0]),
            ([10.0], [0.7]),
        ],
        "The device with the highest SNR is served, however small its lead is and however little "
        "it has left, as long as it has any; its number is an index into snr_db.": [
            ([4.0, 9.0, -2.0], [50.0, 30.0, 40.0]),
            ([5.0, 5.000001, 4.0], [9.0, 8.0, 9.0]),
            ([-3, -1], [9, 9]),
        ],
        "A device without data is not served, but the others keep their numbers. The highest SNR "
        "among them wins, however low; give that device's index in the full snr_db.": [
            ([12, 5, 9], [0, 50, 40]),
            ([9.0, 8.0, 7.0], [0.0, 5.0, 6.0]),
            ([-6.0, -11.0], [0.0, 8.0]),
            ([5.0, -140.0], [0.0, 1.0]),
        ],
        "A device has data left if its amount is more than 0, however small.": [
            ([8.0, 3.0], [1e-7, 9.0]),
            ([-8.0, -3.0, 2.0], [9.0, 1e-9, 0.0]),
        ],
    },
    mistakes={
        "0 dB is not low enough for an empty device: the SNRs of the others may be lower. Give it "
        "−infinity.": (lambda snr_db, left: tdma_slot.solution(snr_db, left, empty=0))
    },
    case=lambda *arrays: tuple(map(np.array, arrays)),
)
def tdma_slot(snr_db, left, empty=-np.inf):
    """`slot(snr_db, data_left)`: the device served, or -1, and the data units it uploads."""
    if not left.any():
        return -1.0, 0.0
    device = np.argmax(np.where(left > 0, snr_db, empty))
    return float(device), float(min(rate(snr_db[device]), left[device]))


def step_of(answer, flight, step):
    given = answer()
    several = given if isinstance(given, tuple | list) else ()
    if [len(part) if hasattr(part, "__len__") else 1 for part in several] != [6, 3]:
        raise Unfit("Return two lists: six rewards of flight A, three of flight B.")
    return given["AB".index(flight)][step - 1]


@exercise(
    "3.2 · Rewards by hand (2 points, 10 minutes)",
    rules={
        "Each data unit that is uploaded counts 1, and each step in which the UAV does not land "
        "costs 0.2.": [("A", 1), ("A", 3), ("A", 5), ("B", 1)],
        "The controller replaced the action with hovering. Its penalty of 1 comes on top of the "
        "0.2, and a UAV that hovers uploads all the same.": [("A", 2), ("B", 2)],
        "A step uploads no more than the device has left, so keep track of that; and a step in "
        "which the UAV hovers costs the 0.2 like any other.": [("A", 4)],
        "The step in which the UAV lands does not cost the 0.2, and nothing is uploaded in it.": [
            ("A", 6)
        ],
        "Nothing is uploaded in the step that ends a flight. Here time runs out in the air: the "
        "penalty for the crash is added to that of the controller and to the 0.2.": [("B", 3)],
    },
    mistakes={
        "These are the sums of the rewards so far. Give the reward of each step alone.": (
            lambda: [np.cumsum(part) for part in rewards_by_hand.solution()]
        )
    },
    ask=step_of,
    call=lambda flight, step: f"Flight {flight}, step {step}",
    secret=True,
)
def rewards_by_hand():
    """`rewards_by_hand()`: two lists, the rewards of the steps of flights A and B."""
    return [-0.2, -0.7, 2.3, 0.8, 0.3, 0.0], [1.6, -0.2, -151.2]


TOWNS = [
    City.from_text(text, text.replace(" ", "\n"))
    for text in (
        "..... ..... ..L.. ..... .....",
        "L...B .N.b. ...bN B.... ..L.L",
        ".N..b.. ..B..L. N..b..N .b.L.B. L.N...b ....N.. B..L..N",
        "L. .N",
    )
]
SENTENCES = {
    "free": "North is one row up (row − 1), east one column to the right (col + 1). Nothing is in "
    "the way there, so the controller does not intervene.",
    "low": "The building in the target cell is low and may be flown over: only city.no_fly says "
    "where the UAV may not go; city.buildings is about the radio link.",
    "closed": "The target is a no-fly zone or a tall building, so city.no_fly[row, col] is True: "
    "the UAV stays in its cell and hovers instead, and the controller intervenes.",
    "outside": "That leaves the grid: the UAV stays in its cell and hovers instead, and the "
    "controller intervenes. In numpy, index −1 means the last row or column, so no error warns "
    "you.",
    "hover": "Hovering stays in the cell and is always allowed: the controller does not intervene.",
    "zone": "A UAV that lands stays in its cell; in the zone the controller does not intervene.",
    "elsewhere": "That cell is not in the landing zone, city.landing[row, col]: the UAV stays in "
    "its cell and hovers instead, and the controller intervenes.",
}


def kind(city, cell, action):
    """Which sentence explains a step."""
    (row, col), size = np.add(cell, MOVES[action]), city.size
    if action >= HOVER:
        return "hover" if action == HOVER else "zone" if city.landing[cell] else "elsewhere"
    if not (0 <= row < size and 0 <= col < size):
        return "outside"
    return "closed" if city.no_fly[row, col] else "low" if city.buildings[row, col] else "free"


STEPS = [
    (city, tuple(cell), action)
    for city in TOWNS
    for cell in np.argwhere(~city.no_fly).tolist()
    for action in range(6)
]


@exercise(
    "3.3 · The safety controller (3 points, 15 minutes)",
    rules={
        sentence: [step for step in STEPS if kind(*step) == name]
        for name, sentence in SENTENCES.items()
    },
    call=lambda city, cell, action: f"{ACTIONS[action]} ({action}) from {cell} in {city.name!r}",
)
def safe_step(city, cell, action):
    """`safe_step(city, cell, action)`: the next cell, and whether the controller intervened."""
    refused = kind(city, cell, action) in ("closed", "outside", "elsewhere")
    if refused or action in (HOVER, LAND):
        return cell, refused
    return tuple(np.add(cell, MOVES[action]).tolist()), False
