"""Exercises of notebook 14, a real city."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise


def arrays(*rows):
    return tuple(np.array(row, float) for row in rows)


def fitted(distance_m, snr_db, times=10.0, keep=np.isfinite, sign=-1):
    x, y = times * np.log10(distance_m[keep(snr_db)]), snr_db[keep(snr_db)]
    slope, level = np.polyfit(x, y, 1)
    return sign * slope, np.std(y - slope * x - level)


def around_the_mean(distance_m, snr_db):
    return fitted(distance_m, snr_db)[0], np.std(snr_db[np.isfinite(snr_db)])


@exercise(
    "14.1 · The exponent of a place (2 points, 10 minutes)",
    rules={
        "Fit the line SNR = level − α · 10 log10 d by least squares. α is its slope with the sign "
        "changed; σ is the root of the mean square of what is left.": [
            ([10, 100], [0, -20]), ([10, 20, 40], [5, -3, -14]), ([10, 30, 90, 15], [9, -8, -9, 6]),
        ],
        "Where no ray arrives the SNR is −inf: leave these links out.": [
            ([10, 100, 50], [0, -30, -np.inf]), ([80, 10, 20, 40], [-np.inf, 5, -3, -14]),
        ],
        "α can be small, and even negative. Do not cut it off.": [
            ([10, 100, 1000], [3, 3, 4]), ([20, 25, 60], [-40, -35, -39]),
        ],
    },
    mistakes={
        "The slope is −α: change its sign.": lambda d, snr: fitted(d, snr, sign=1),
        "That is the slope over log10 d; take 10 log10 d, as the SNR is in dB.": (
            lambda d, snr: fitted(d, snr, times=1.0)
        ),
        "σ is the spread around the line, and not around the mean SNR.": around_the_mean,
    },
    case=arrays,
    smallest=1e-9,
)
def exponent(distance_m, snr_db):
    """`exponent(distance_m, snr_db)`: α and σ of the line through the links that are heard."""
    return fitted(distance_m, snr_db)


def prior(line_db, heard_db, weight):
    return line_db[0], heard_db, weight


@exercise(
    "14.2 · Believe what you heard (2 points, 12 minutes)",
    rules={
        "Add to the line the weighted sum of the errors, heard − line, over 1 + the sum of the "
        "weights.": [
            ([-10], [-20], [1]), ([-10], [-20, -30], [1, 0.5]), ([3], [5, 1, 9], [0.2, 1, 0.6]),
        ],
        "If nothing was heard nearby, the line stays.": [([-7.5], [], []), ([-7.5], [4], [0])],
        "Much that was heard outweighs the line.": [([0], [-15] * 50, [1] * 50)],
    },
    mistakes={
        "The line must count as one measurement: the 1 below is missing.": (
            lambda line, heard, w: line + np.sum(w * (heard - line)) / max(np.sum(w), 1e-300)
        ),
        "Divide by 1 + the sum of the weights, not by 1 + their number.": (
            lambda line, heard, w: line + np.sum(w * (heard - line)) / (1 + len(w))
        ),
        "The weights belong to the errors, heard − line, and not to the SNRs themselves.": (
            lambda line, heard, w: line + np.sum(w * heard) / (1 + np.sum(w))
        ),
    },
    case=lambda *row: prior(*arrays(*row)),
)
def corrected(line_db, heard_db, weight):
    """`corrected(line_db, heard_db, weight)`: the SNR of a link, dB, after what was heard."""
    return line_db + np.sum(weight * (heard_db - line_db)) / (1 + np.sum(weight))
