"""Exercises of notebook 1, the city and the channel."""

import numpy as np

from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as library_rate
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.checks.values import show
from uavdh_lite.streams import Use, stream


@exercise(
    "1.1 · Rate from SNR (1 point, 5 minutes)",
    rules={
        "The rate is log2(1 + SNR), with the SNR as a ratio of powers: 0 dB is a ratio of 1, so "
        "the rate there is log2(2) = 1.": [0.0],
        "Adding 10 dB multiplies the power by ten, so the ratio is 10 ** (snr_db / 10), near 0 dB "
        "and far from it. Nothing is rounded.": [10.0, -10.0, -60.0, 150.0],
        "An array has a rate for each element: use np.log2 and ** on the whole array, without a "
        "loop, `if` or `math`.": [
            np.array(snr_db) for snr_db in ([6.0], [0, 10, -20], [[-3.0, 0.0], [3.0, 20.0]])
        ],
    },
    mistakes={
        "np.log is the natural logarithm. The rate counts doublings: take np.log2.": (
            lambda snr_db: np.log(1 + 10 ** (snr_db / 10))
        ),
        "The SNR is given in decibels. Turn it into a ratio of powers before you add 1.": (
            lambda snr_db: np.log2(1 + snr_db)
        ),
    },
)
def rate_from_snr(snr_db):
    """`rate(snr_db)`: data units in a slot, for numbers and arrays (eq. 1)."""
    return np.log2(1 + 10 ** (snr_db / 10))


LOS, NLOS = Channel().path_loss_exponent_los, Channel().path_loss_exponent_nlos


@exercise(
    "1.2 · How much distance is a building worth? (2 points, 10 minutes)",
    rules={
        "The loss 10 α log10(d) with α_LoS at your distance must equal the loss with α_NLoS at the "
        "distance given. Behind a building the loss grows faster, so the distance in sight is the "
        "longer one. Round neither the exponents' ratio nor the result.": [20.0, 2.0, 55],
        "Both losses are 0 dB at 1 m, so there the two distances are equal.": [1.0],
    },
    mistakes={
        "As a ratio, the loss is d ** α, so the ratio of the exponents belongs in the exponent, "
        "not in front.": lambda d: d * NLOS / LOS
    },
)
def same_path_loss(nlos_m):
    """`same_loss_m(nlos_m)`: the distance in sight with the loss of a blocked link, m."""
    return float(nlos_m ** (NLOS / LOS))


NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(120)
MANY = 400_000  # draws: only chance explains a deviation of 1.5 %


def exact(snr_db, variance):
    """Mean and standard deviation of the rate over the fading."""
    rates = library_rate(snr_db + np.sqrt(variance) * NODES)
    mean = np.average(rates, weights=WEIGHTS)
    return float(mean), float(np.sqrt(np.average((rates - mean) ** 2, weights=WEIGHTS)))


def scatters_wrongly(answer) -> str:
    """As many slots as asked for, by the generator's chance; a right answer fails once in 1e7."""
    one, other, again = (answer(0.0, 5.0, 9, stream(Use.EXERCISE, seed)) for seed in (0, 2, 0))
    if one == other:
        said = "Another generator changes nothing, so no random number comes from it. Simulate: "
        return f"{said}draw the fading of each slot from the generator that is passed in."
    if one != again:
        return "All random numbers must come from the generator that is passed in."
    few = [answer(12.0, 2.0, 40, stream(Use.EXERCISE, seed)) for seed in range(1000)]
    used = (exact(12.0, 2.0)[1] / (np.std(few) + 1e-12)) ** 2
    if not 40 / 1.6 < used < 1.6 * 40:
        said = "mean_rate(12, 2, 40, generator) is right on average, but scatters like a mean of"
        return f"{said} {show(used)}: simulate `draws` slots, each with its own fading."
    return ""


@exercise(
    "1.3 · What fading does to the mean rate (2 points, 10 minutes)",
    rules={
        "With a variance of 0 there is no fading: all rates equal the rate at the mean SNR, and so "
        "does their mean.": [(3.0, 0.0, 5), (-11, 0, 1)],
        "Simulate `draws` slots, each with a fading of its own: normal, mean 0, standard deviation "
        "√variance. Add it to the SNR, in dB. Turn each SNR into a rate, then average the "
        "rates. Chance explains a deviation of at most 1.5 %.": [
            (-8, 30, MANY),
            (0.0, 5, MANY),
            (12, 2.0, MANY),
            (-20, 9.0, MANY),
            (0.0, 60.0, MANY),
        ],
    },
    mistakes={
        "The fading is far too strong: generator.normal expects the standard deviation, the square "
        "root of the variance.": (lambda snr_db, variance, *_: exact(snr_db, variance**2)[0]),
        "On average that is the rate at the mean SNR, which is also the median rate. Either the "
        "fading is not added, or the SNRs are averaged before they become rates, or you take the "
        "median. Add fading to the SNR in each slot, turn each SNR into a rate, then average the "
        "rates.": lambda snr_db, *_: library_rate(snr_db),
    },
    case=lambda *case: (*case, stream(Use.EXERCISE, 1)),
    also=scatters_wrongly,
    tolerance=0.015,
)
def mean_rate(snr_db, variance_db2, draws, generator):
    """`mean_rate(snr_db, variance_db2, draws, generator)`: Monte Carlo mean over the fading."""
    return exact(snr_db, variance_db2)[0]
