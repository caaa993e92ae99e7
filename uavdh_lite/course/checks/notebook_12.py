"""Exercises of notebook 12, four ways past the paper."""

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.environment import LAND, Environment
from uavdh_lite.streams import Use, stream

CITY = "L . . B\n. N B .\n. . . N\n. . . ."  # no way home from cell 7


def situation(name, cell, time_left):
    """Arguments of `fits` for cells of a city; for a number, so many at random, with about that."""
    city = City.load(name) if name == "village" else City.from_text("small", name)
    distance = city.landing_distance.ravel()
    if isinstance(cell, int):
        generator = stream(Use.EXERCISE, cell)
        cell = generator.choice(np.flatnonzero(~city.no_fly.ravel()), cell)
        time_left = np.maximum(distance[cell] + generator.integers(-1, time_left, len(cell)), 1)
    return distance, Environment(city).next_cell[0], np.array(cell), np.array(time_left)


@exercise(
    "12.1 · The failsafe's mask (2 points, 12 minutes)",
    rules={
        "An action fits if it, the way home after it and the landing take at most time_left units. "
        "That also goes for `land` outside the zone, which is the same as hovering.": [
            (CITY, [9], [3]),
            (CITY, [9], [4]),
            (CITY, [9], [5]),
            (CITY, [4, 14, 2], [4, 6, 3]),
        ],
        "Landing at once always fits, but only in the zone: elsewhere `land` is no landing, and "
        "costs a unit of time, as hovering does.": [(CITY, [0], [1]), (CITY, [0, 1, 0], [1, 1, 2])],
        "Where there is no way home, distance −1, nothing fits: −1 is a marker, not a distance.": [
            (CITY, [7], [3]),
            (CITY, [7, 0], [10**6, 10**6]),
        ],
        "The mask must be right for all UAVs of a batch, each with its own time, in any city. A "
        "column of times is time_left[:, None].": [
            (CITY, 30, 4),
            ("village", 6, 4),
            ("village", 40, 4),
            (CITY[::-1], 12, 4),
        ],
    },
    mistakes={
        "You leave too little time: on top of the way home, action and landing take a unit each.": (
            lambda *case: failsafe_mask.solution(*case, spare=1)
        ),
        "Only in the zone is a landing sure to fit. Elsewhere it is refused, and costs a unit of "
        "time, as hovering does.": lambda distance, next_cell, *others: (
            failsafe_mask.solution(distance, next_cell, *others) | (np.arange(6) == LAND)
        ),
    },
    case=situation,
)
def failsafe_mask(distance, next_cell, cell, time_left, spare=2):
    """`fits(distance, next_cell, cell, time_left)`: the actions that leave time to land, (B, 6)."""
    home = np.where(distance < 0, np.inf, distance)
    fits = home[next_cell[cell]] + spare <= time_left[:, None]
    fits[:, LAND] |= distance[cell] == 0
    return fits


def links(devices, size, *left):
    """Mean rates of so many devices to every cell, and their data left."""
    generator = stream(Use.EXERCISE, 10 * devices + size)
    return generator.uniform(0.05, 7, (devices, size, size)).round(2), np.array(left)


def one_device(rate, left):
    """The estimate of notebook 12: the most that a single device sends in four slots."""
    return np.minimum(4 * rate, left[:, None, None]).max(0)


@exercise(
    "12.2 · What a cell really brings (2 points, 15 minutes)",
    rules={
        "A single device sends its rate in each of the four slots, until it has nothing left.": [
            links(1, 2, 100.0),
            links(1, 3, 1000),
            links(1, 3, 0.0),
        ],
        "In every slot the loudest of those with data left sends alone. As long as it has data, "
        "the others wait, however much they hold.": [
            links(2, 2, 100.0, 100.0),
            links(3, 2, 100.0, 40.0, 70),
            links(3, 2, 0, 0, 0),
        ],
        "A device that has become empty leaves the next slots to the others; what it does not use "
        "of its last one is lost. Each cell begins with the data that was given.": [
            links(2, 2, 3.0, 100.0),
            links(3, 3, 4.0, 9.0, 30.0),
            links(4, 4, 0.0, 2.0, 11.0, 6.0),
            links(5, 5, 1, 20, 3, 14, 8),
        ],
    },
    mistakes={
        "That is the notebook's estimate, one device for all four slots. When the loudest is "
        "empty, the next loudest gets the slots that are left.": one_device,
        "Only one device sends in a slot, so all share the four slots. You give each all four.": (
            lambda rate, left: np.minimum(4 * rate, left[:, None, None]).sum(0)
        ),
    },
)
def data_of_a_step(rate, left):
    """`brings(rate, left)`: the data of a step over each cell, by the rule of the slots, (M, M)."""
    rest = np.repeat(left.astype(float), rate[0].size).reshape(rate.shape)
    for _ in range(4):
        heard = np.where(rest > 0, rate, -1)
        rest = np.where(heard == heard.max(0), rest - np.minimum(rate, rest), rest)
    return left.sum() - rest.sum(0)
