"""Exercises of notebook 11, replay."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise


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
            (100, 100, 10), (50, 80, 20), (10, 1000, 3), (20, 15, 8),
        ],
        "Once `capacity` items came after the change, nothing old is left, and it stays so.": [
            (10, 30, 10), (10, 30, 11), (10, 5, 400),
        ],
        "With nothing added after the change, all is old.": [(10, 30, 0), (10, 3, 0)],
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
