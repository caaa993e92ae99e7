"""Exercises of notebook 8, the ablation of map centring."""

from itertools import combinations

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream

RISES = [0.1, 0.35, 0.6, 0.75, 0.5, 0.8, 0.9, 0.85]


def curve(values, threshold, steps=None):
    """Arguments of `steps_to`, with validations every 50,000 steps or at these ones."""
    every = 50_000 * np.arange(1, len(values) + 1)
    return np.array(every if steps is None else steps), np.array(values), threshold


def random_curves():
    for n in (2, 3, 4, 5, 8, 8, 8, 13) * 2:
        values = (generator := stream(Use.EXERCISE, n)).uniform(0.4, 1, n).round(1)
        for threshold in (0.5, 0.6, 0.8):
            yield values, threshold, np.cumsum(generator.integers(1, 9_000, n)) - 1


@exercise(
    "8.1 · How many steps to a threshold (1 point, 8 minutes)",
    rules={
        "The result is one of `steps`: from there on all values are at least the threshold, and "
        "the value before that is below it.": [
            ([0.2, 0.9], 0.5),
            ([0.6, 0.4, 0.8], 0.5),
            (RISES, 0.6, range(3, 11)),
        ],
        "If no value is below the threshold, the result is the first validation, even at 0 "
        "steps.": [(RISES, 0.05), ([0.5], 0.1, [7]), ([0.3, 0.2, 0.9], 0, [0, 100, 200])],
        "If the last value is below the threshold, there is no such validation: return None. "
        "np.argmax of a condition that is nowhere true is 0, the first place.": [
            (RISES, 0.95),
            (RISES, 0.88),
        ],
        "A value that equals the threshold has reached it: only a smaller one, by however little, "
        "is below it.": [(RISES, 0.85), ([0.2, 0.7, 0.7 - 1e-9, 0.7], 0.7)],
        "All values from your validation to the last must be at least the threshold, in any "
        "curve and with any distances between validations.": list(random_curves()),
    },
    mistakes={
        "That is the first crossing. The curve falls back later: find the last crossing.": (
            lambda steps, values, threshold: next(
                (float(s) for s, v in zip(steps, values, strict=True) if v >= threshold), None
            )
        ),
        "That is the position in the list, not the number of environment steps: look it up in "
        "`steps`.": lambda steps, *others: steps_to.solution(range(len(steps)), *others),
    },
    case=curve,
)
def steps_to(steps, values, threshold):
    """`steps_to(steps, values, threshold)`: the steps at which it is reached for good, or None."""
    below = np.flatnonzero(values < threshold)
    first = below[-1] + 1 if len(below) else 0
    return float(steps[first]) if first < len(steps) else None


def interval(d, error=None):
    half = 1.96 * (d.std(ddof=1) / np.sqrt(len(d)) if error is None else error)
    return float(d.mean()), float(d.mean() - half), float(d.mean() + half)


def unpaired(a, b):
    return interval(a - b, np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / len(a)))


def results(count, together, ahead=0.3, scale=1.0):
    """Random results of two policies that have this much in common; or those that are given."""
    if isinstance(count, list):
        return np.array(count), np.array(together)
    generator = stream(Use.EXERCISE, count)
    common = generator.standard_normal(count)
    a, b = generator.normal((ahead, 0), 1, (count, 2)).T
    return scale * (a + together * common), scale * (b + abs(together) * common)


@exercise(
    "8.2 · Paired or not (2 points, 8 minutes)",
    rules={
        "With d = a − b of each pair, return the mean of d and the ends of the interval, 1.96 "
        "standard errors, d.std(ddof=1) / sqrt(n), to either side: (mean, low, high).": [
            ([3.0, 5.0, 10.0], [1.0, 4.0, 2.0]),
            ([1.0, 4.0, 2.0], [3.0, 5.0, 10.0]),
            (8, 1.0),
        ],
        "It must hold whether the two results go together or not, for few missions and for many. "
        "If all differences are equal, the interval has width 0.": [
            (30, 2.0),
            (300, 0.5),
            (15, -0.7),
            (2, 3.0, 2.0),
            (40, 1.0, -2.0, 50.0),
            ([4.0, 6.0, 11.0], [3.0, 5.0, 10.0]),
        ],
    },
    mistakes={
        "That is the unpaired interval: it adds both variances, as if each policy had flown "
        "missions of its own. Take the standard deviation of the differences a − b.": unpaired
    },
    tolerance=1e-3,
    case=results,
)
def lead(a, b):
    """`lead(a, b)`: (mean, low, high) of a − b, in pairs."""
    return interval(a - b)


def differences(a, b):
    """The difference of the two means for each split of all values."""
    values = np.r_[a, b]
    splits = (list(own) for own in combinations(range(len(values)), len(a)))
    return np.array([np.mean(values[own]) - np.mean(np.delete(values, own)) for own in splits])


def groups(a, b, parts=1):
    """Two groups of values; or so many random whole numbers, no two equal, divided by `parts`."""
    if isinstance(a, list):
        return np.array(a), np.array(b)
    values = stream(Use.EXERCISE, 10 * a + b).permutation(np.arange(-99, 99)) / parts
    return values[:a], values[a : a + b]


@exercise(
    "8.3 · A p-value for a few seeds (2 points, 15 minutes)",
    rules={
        "Go through all splits, each once, without random draws and without a formula. p is the "
        "share of those whose difference of the means is at least as large as the observed one, in "
        "absolute value; the observed split is one of them.": [
            ([1, 2, 3], [4, 5, 6]),
            ([1.5, 4], [0.25, 8]),
            ([1], [2]),
            (3, 3),
            (2, 2),
            (4, 4),
        ],
        "The groups may differ in size: the first group of each split is as large as a, and the "
        "difference is that of the means, not of sums.": [
            ([7], [1, 2, 4]),
            ([1, 2, 4, 9], [3]),
            (2, 4),
            (4, 3),
            (3, 2),
            (3, 5),
            (1, 6),
            (7, 7),
        ],
        "Two equal values count as two: deal out positions, range(len(a) + len(b)), not values.": [
            ([1.0, 1.0, 6.0], [2.0, 8.0]),
            ([1, 2, 2], [2, 5]),
            ([3, 3], [3, 3]),
            ([0, 1, 1], [1, 0, 0]),
            ([5.0], [5.0, 5.0, 1.0]),
        ],
        "Differences that are equal up to 1e-9 count as equal: sums of decimals are rounded. "
        "All others count as different, by however little they differ.": [
            ([0.5, 0.1], [0.4, 0.9, 0.2]),
            ([0.1, 0.7, 0.3], [0.2, 0.6, 0.4]),
            (3, 4, 100),
            (4, 3, 100),
            (2, 5, 100),
            (3, 3, 100),
            (4, 4, 100),
            ([1e-6, 2e-6, 4e-6], [0, 0.5e-6, 1e-6]),
            ([0.5, 0.900001], [0.5, 0.9]),
            ([100.0005], [50, 0]),
        ],
    },
    mistakes={
        "That is one-sided: the other direction counts too, so take the absolute value of both "
        "differences.": lambda a, b: float(
            np.mean(differences(a, b) >= np.mean(a) - np.mean(b) - 1e-9)
        )
    },
    case=groups,
)
def permutation_p(a, b):
    """`permutation_p(a, b)`: exact and two-sided, of the difference of the means."""
    return float(np.mean(abs(differences(a, b)) >= abs(np.mean(a) - np.mean(b)) - 1e-9))
