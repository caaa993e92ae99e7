"""Exercises of notebook 9, replay."""

import numpy as np

from uavdh_lite.course.checks.exercise import CheckFailed, exercise
from uavdh_lite.course.checks.values import show
from uavdh_lite.streams import Use, stream


def draws(ring: type, capacity: int, added: int, size: int, count: int = 1, seed: int = 0):
    """The numbers of the items in so many samples, 1 for the first added; another ring has more."""
    items = [(np.full(2, n % 3), n % 6, n / 10, f"state {n % 4}") for n in range(added)]
    numbers = {id(item): number for number, item in enumerate(items, 1)}
    own, other, generator = ring(capacity), ring(3), stream(Use.EXERCISE, seed)
    for item in items:
        own.add(item)
        other.add((item,))
    samples = [list(own.sample(size, generator)) for _ in range(count)]
    for sample in samples:
        strange = [item for item in sample if id(item) not in numbers]
        if len(sample) != size or strange:
            said = f"{asked(capacity, added, size)} gives back"
            if len(sample) != size:
                said = f"{said} a list of length {len(sample)}, expected {size}. An item may come "
                raise CheckFailed(f"{said}more than once: draw size − 1 places, add the newest.")
            said = f"{said} {show(strange[0])}, which was never added. Give back the very tuples"
            raise CheckFailed(f"{said} that were added, not copies or parts of them.")
    return [[numbers[id(item)] for item in sample] for sample in samples]


Unquoted = type("Unquoted", (str,), {"__repr__": str.__str__})  # as it stands in a message


def items_drawn(ring, *case):
    numbers = sorted(set(*draws(ring, *case)))
    return Unquoted(f"item{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}")


def asked(capacity, added, size):
    return f"Ring({capacity}), after {added} × add(item), sample({size}, generator)"


def wrong_chance(ring: type) -> str:
    """Besides one newest item all are equally likely; a right answer fails once in 1e7."""
    one, again, other = (draws(ring, 8, 8, 60, seed=seed) for seed in (1, 1, 2))
    if one != again or one == other:
        return "All chance must come from the generator that is passed in."
    for capacity, added, limit in ((8, 3, 37.0), (8, 27, 52.0), (8, 8, 52.0)):
        drawn, stored = np.array(draws(ring, capacity, added, 9, 600)), min(capacity, added)
        counts = np.bincount(drawn.ravel())[-stored:] - 600 * (np.arange(stored) == stored - 1)
        if not (drawn == added).any(1).all():
            return "A sample of 1 is the newest item, but larger samples do not always have it."
        if ((counts - counts.mean()) ** 2).sum() / counts.mean() > limit:
            said = f"After {added} items, besides the newest, the oldest to the newest are drawn "
            return f"{said}{counts.tolist()} times: each must be equally likely."
        different = [len(set(sample)) for sample in draws(ring, capacity, added, 3, 1800)]
        right = 1 + (stored - 1) * (1 - (1 - 1 / stored) ** 2)
        if abs(np.mean(different) - right) > 6 * np.std(different) / 1800**0.5 + 1e-9:
            return "Draw every place by itself: generator.integers(0, number stored, size − 1)."
    return ""


@exercise(
    "9.1 · A ring buffer with combined replay (3 points, 15 minutes)",
    rules={
        "The newest item is in every sample, so that a sample of 1 is the newest alone.": [
            (5, added, 1) for added in range(1, 5)
        ],
        "When the ring is full, each new item still goes in, in the place of the oldest. So the "
        "newest is no longer at the end: it is one place before that to be overwritten next.": [
            (size, added, 1) for size, most in ((5, 17), (1, 4)) for added in range(size, most)
        ],
        "The other items of a sample are drawn from all stored ones, only from places that are "
        "filled, and may come more than once.": [(5, added, 300) for added in range(1, 6)],
        "When the ring is full, each new item must overwrite the oldest, and no other: the ring "
        "does not grow. generator.integers leaves out its upper end already.": [
            (1, 3, 60), (3, 8, 200), (7, 22, 420)
        ]
        + [(5, added, 300) for added in range(6, 17)],
    },
    takes=type,
    ask=items_drawn,
    call=asked,
    also=wrong_chance,
)
class ring_buffer:
    """The class `Ring(capacity)` with `add(item)` and `sample(size, generator)`."""

    def __init__(self, capacity):
        self.capacity, self.items, self.newest = capacity, [], -1

    def add(self, item):
        self.newest = (self.newest + 1) % self.capacity
        self.items[self.newest : self.newest + 1] = [item]

    def sample(self, size, generator):
        rest = generator.integers(0, len(self.items), size - 1)
        return [self.items[k] for k in (self.newest, *rest)]


def draw_old_share(ax, old_share):
    steps = np.arange(0, 120_001, 1000)
    for capacity in (10_000, 50_000, 100_000):
        shares = [old_share(capacity, 60_000, int(after)) for after in steps]
        ax.plot(steps, shares, label=f"capacity {capacity:,}")
    ax.set(xlabel="steps since the city changed", ylabel="share from the old city")
    ax.set_title("60,000 steps before the change")


@exercise(
    "9.2 · What a memory still holds (1 point, 8 minutes)",
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
