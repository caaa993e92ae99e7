"""Exercises of notebook 13, any city."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


def numbered(channels, side, *asked):
    """A map in which no two cells are alike, and what is asked."""
    return np.arange(channels * side**2).reshape(channels, side, side), *asked


@exercise(
    "13.1 · Turn the map, turn the action (2 points, 10 minutes)",
    rules={
        "Without turning or mirroring, the map and the action stay as they are.": [
            (1, 2, action, 0, False) for action in (0, 3)
        ],
        "Turn the last two axes to the left: what was in the north comes to the west, and what was "
        "in the west to the south. A turn takes 1 from the number of a move; below 0 it wraps "
        "round to 3.": [(1, 2, action, turns, False) for turns in (1, 2, 3) for action in range(4)],
        "A mirror image swaps left and right: east and west change places, north and south stay.": [
            (2, 3, action, 0, True) for action in range(4)
        ],
        "The map is mirrored first, and then turned. So is the action.": [
            (3, 3, action, turns, True) for turns in (1, 2, 3) for action in range(4)
        ],
        "Hover and land are the same on every map.": [
            (1, 3, 4, 1, False),
            (1, 3, 5, 0, True),
            (1, 3, 4, 3, True),
        ],
    },
    mistakes={
        "You turn to the right: a turn to the left brings north to the west.": (
            lambda layers, action, turns, mirrored: view.solution(layers, action, -turns, mirrored)
        ),
        "The map is right, but the action is that of the old map.": (
            lambda layers, action, *how: (view.solution(layers, action, *how)[0], action)
        ),
    },
    case=numbered,
)
def view(layers, action, turns, mirrored):
    """`view(layers, action, turns, mirrored)`: the other map, and the action's number on it."""
    seen = np.rot90(layers[:, :, ::-1] if mirrored else layers, turns, axes=(1, 2))
    if action > 3:
        return seen, action
    return seen, ((0, 3, 2, 1)[action] - turns if mirrored else action - turns) % 4


T = 12.71, 4.30, 3.18, 2.78, 2.57  # Student's factor of two cities, three, …


def usual(values, city, t):
    return float(t * np.std(values, ddof=1) / np.sqrt(len(values)))


def missions(values, city):
    """Values and their cities; or, if there are fewer, so many missions of each city, at random."""
    t = T[len(set(city)) - 2]
    if len(values) > len(set(city)):
        return np.array(values), np.array(city), t
    generator = stream(Use.EXERCISE, sum(values))
    shared = np.repeat(generator.normal(0.8, 0.1, len(city)), values)
    order = generator.permutation(sum(values))
    drawn = (shared + generator.normal(0, 0.1, sum(values))).round(3)
    return drawn[order], np.repeat(city, values)[order], t


@exercise(
    "13.2 · How sure are you if missions share a city? (2 points, 12 minutes)",
    rules={
        "Subtract the mean from the values, add up the differences in each city, and square these "
        "sums. Multiply their total by C/(C − 1), take its square root, and multiply that by t / "
        "N.": [([4.0, 6, 1, 1], [0, 0, 1, 1]), ([3, 3, 3], range(3)), ([4] * 6, range(6))],
        "Cities may have different numbers of missions. The mean is that of all N missions, not of "
        "the cities' means.": [([1, 3], [0, 1]), ([5, 1, 2, 9], [0, 1, 2, 3])],
        "The cities' numbers are names: any ints, in any order. C is the number of different "
        "ones.": [([2, 3], [7, 4]), ([2, 5, 1], [-1, -2, 10**6]), ([1] * 4, range(4))],
        "Values may be whole numbers or Booleans, too, such as whether each UAV landed.": [
            ([3, 4, 4, 9, 1], [1, 1, 0, 0, 2]),
            ([True, True, False, True], [5, 5, 0, 0]),
        ],
    },
    mistakes={
        "That is the usual interval, as if all missions were independent: add up the differences "
        "of a city before you square them.": usual
    },
    case=missions,
)
def clustered_half_width(values, city, t):
    """`half_width(values, city, t)`: of the 95 % interval of the mean, cities drawn at random."""
    off = values - np.mean(values)
    sums = np.array([off[city == name].sum() for name in np.unique(city)])
    count, n = len(sums), len(values)
    return float(t * np.sqrt(count / (count - 1) * (sums**2).sum()) / n)
