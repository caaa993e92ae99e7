"""Exercises of notebook 11, replay."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


def draw_old_share(ax, old_share):
    steps = np.arange(0, 120_001, 1000)
    for capacity in (10_000, 50_000, 100_000):
        shares = [old_share(capacity, 60_000, int(after)) for after in steps]
        ax.plot(steps, shares, label=f"capacity {capacity:,}")
    ax.set(xlabel="steps since the city changed", ylabel="share from the old city")
    ax.set_title("60,000 steps before the change")


@exercise(
    "11.1 · What a memory still holds (1 point, 8 minutes)",
    figure=draw_old_share,
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
    mistakes={
        "That is the share of all that was added. The memory holds `capacity` items at most.": (
            lambda capacity, before, after: before / (before + after)
        ),
        "The memory need not be full: divide by the number of items that it holds.": (
            lambda capacity, before, after: min(before, max(capacity - after, 0)) / capacity
        ),
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


def drawn(error, floor, size=abs, weight=np.reciprocal):
    share = size(error) + floor
    share = share / share.sum()
    return share, weight(share) / weight(share).max()


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
        "An error of −3 surprises as much as one of 3: take the absolute value.": (
            lambda error, floor: drawn(error, floor, size=np.asarray)
        ),
        "The weights are upside down: what is drawn more often must count less.": (
            lambda error, floor: drawn(error, floor, weight=np.asarray)
        ),
        "Scale the weights so that the largest is 1.": (
            lambda error, floor: (drawn(error, floor)[0], 1 / drawn(error, floor)[0])
        ),
    },
    case=errors,
)
def prioritised(error, floor):
    """`prioritised(error, floor)`: each step's probability in a draw, and weight."""
    return drawn(error, floor)
