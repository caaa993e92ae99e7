"""Exercises of notebook 11, replay."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


@exercise(
    "11.1 · What a memory still holds (1 point, 8 minutes)",
    rules={
        "As long as nothing is overwritten, all items are there: the share is before / (before + "
        "after).": [(100, 30, 10), (100, 50, 50), (7, 1, 2)],
        "A full memory holds `capacity` items, and each new item overwrites the oldest.": [
            (100, 100, 10),
            (50, 80, 20),
            (10, 1000, 3),
        ],
        "Once `capacity` items have come after the change, nothing old is left, then or later.": [
            (10, 30, 10),
            (10, 30, 11),
        ],
        "If nothing has been added after the change, everything is old.": [(10, 30, 0), (10, 3, 0)],
    },
)
def old_share(capacity, before, after):
    """`old_share(capacity, before, after)`: the share of a ring's items from before a change."""
    stored = min(capacity, before + after)
    return 1.0 - min(capacity, after) / stored


def errors(sizes, floor):
    """Errors that are given, or so many random ones."""
    if isinstance(sizes, int):
        sizes = stream(Use.EXERCISE, sizes).normal(0, 3, sizes).round(2)
    return np.array(sizes), floor


def chances(error, floor):
    return (abs(error) + floor) / (abs(error) + floor).sum()


@exercise(
    "11.2 · Prioritised replay (2 points, 12 minutes)",
    rules={
        "If all errors are equally large, each step is drawn with probability 1/N, with weight "
        "1.": [([2.0, 2.0, -2.0, 2.0], 0.5), ([7], 1.0), ([0, 0, 0], 0.1)],
        "A step is drawn in proportion to the size of its error plus the floor, and the "
        "probabilities add up to 1. Its weight is in proportion to one over its probability, so "
        "that probability times weight is the same for all steps; the largest weight is 1.": [
            ([3.0, 1.0, 0.0], 1.0),
            ([3, -1, 0], 1),
            ([-5.0, 5.0, 0.5], 0.01),
            (40, 1.5),
        ],
    },
    mistakes={
        "Scale the weights so that the largest is 1.": (
            lambda error, floor: (chances(error, floor), 1 / chances(error, floor))
        )
    },
    case=errors,
)
def prioritised(error, floor):
    """`prioritised(error, floor)`: each step's probability in a draw, and weight."""
    drawn = chances(error, floor)
    return drawn, drawn.min() / drawn
