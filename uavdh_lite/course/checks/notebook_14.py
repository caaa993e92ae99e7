"""Exercises of notebook 14, a real city."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


def along(cells, resembles, step_m=10):
    """Residuals in so many cells, each a little like the one before; or a list."""
    if isinstance(cells, list):
        return np.array(cells), step_m
    generator = stream(Use.EXERCISE, cells)
    left_db = [8.0]
    for new in generator.normal(0, 6, cells - 1):
        left_db.append(resembles * left_db[-1] + new)
    return np.round(left_db, 1), step_m


@exercise(
    "14.1 · How far does a shadow reach? (2 points, 12 minutes)",
    rules={
        "Subtract the mean first. ρ at a distance is the mean product of all pairs that are that "
        "many cells apart, divided by the mean square of all values.": [
            ([9, 8, 4, 3, -2, -5, -8, -9], 0),
            ([6.5, 7, 3, 1, 1.5, 2], 0),
        ],
        "The result is the first distance at which ρ is below 1/e, in metres, however far away it "
        "is. A ρ below 0 is below 1/e, too.": [
            ([3, -3], 0),
            (list(range(-100, 101)), 1),
            (12, 0.9),
            (20, 0.8, 5),
            (40, 0.95, 2.5),
            (90, 0.9, 7.125),
            (150, 0.97),
            (30, 0.0),
            (80, -0.8, 1),
        ],
    },
    mistakes={
        "That is a number of cells: multiply it by step_m.": lambda left_db, step_m: (
            shadow_reach.solution(left_db, 1)
        )
    },
    case=along,
)
def shadow_reach(left_db, step_m):
    """`reach_m(left_db, step_m)`: the first distance at which ρ is below 1/e, m."""
    off = left_db - left_db.mean()
    for k in range(1, len(off)):
        if np.mean(off[k:] * off[:-k]) / np.mean(off**2) < 1 / np.e:
            return float(k * step_m)
    return float(len(off) * step_m)


def arrays(*rows):
    return tuple(np.array(row, float) for row in rows)


def prior(line_db, heard_db, weight):
    return line_db[0], heard_db, weight


@exercise(
    "14.2 · Believe what you heard (2 points, 12 minutes)",
    rules={
        "Add to the line the weighted sum of the errors, heard − line, divided by 1 + the "
        "sum of the weights.": [
            ([-10], [-20], [1]),
            ([-10], [-20, -30], [1, 0.5]),
            ([3], [5, 1, 9], [0.2, 1, 0.6]),
        ],
        "If nothing was heard nearby, believe the line.": [([-7.5], [], []), ([-7.5], [4], [0])],
        "Many measurements outweigh the line.": [([0], [-15] * 50, [1] * 50)],
    },
    mistakes={
        "The line must count as one measurement: the 1 in the denominator is missing.": (
            lambda line, heard, w: line + np.sum(w * (heard - line)) / max(np.sum(w), 1e-300)
        )
    },
    case=lambda *row: prior(*arrays(*row)),
)
def corrected(line_db, heard_db, weight):
    """`corrected(line_db, heard_db, weight)`: the SNR of a link, dB, after what was heard."""
    return line_db + np.sum(weight * (heard_db - line_db)) / (1 + np.sum(weight))
