"""Exercises of notebook 1, the city and the channel."""

from contextlib import suppress

import numpy as np

from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as solved_rate
from uavdh_lite.course.checks.exercise import (
    close,
    exercise,
    expect,
    guarded,
    show,
    solution,
)
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.values import Unreadable, number
from uavdh_lite.streams import Use, stream

LOS, NLOS = Channel().path_loss_exponent_los, Channel().path_loss_exponent_nlos


def _draw_rate(ax, solved):
    snr_db = np.linspace(-20, 30, 101)
    ax.plot(snr_db, solved(snr_db))
    ax.set(xlabel="SNR, dB", ylabel="rate, data units a slot", title="1 at 0 dB")


@solution(
    "1.1 · Rate from SNR (1 point, 5 minutes)",
    "The rate is log2(1 + SNR), where the SNR is a plain ratio of powers. What is 0 dB as a "
    "ratio? And 10 dB?",
    "10 dB more is ten times the power, so the decibels belong in an exponent. Which number is "
    "raised to it? The 1 is added to the ratio, and numpy has the logarithm to base 2.",
    figure=_draw_rate,
    rules={
        "The rate is log2(1 + SNR) of a ratio of powers, and 0 dB is a ratio of 1: convert the "
        "decibels first. np.log would be the natural logarithm.": [0.0],
        "10 dB more are ten times the power, so the ratio is 10 ** (snr_db / 10).": [
            *(10.0, -10.0, 3.0, 20, -15.0, 25.5)
        ],
        "That holds far from 0 dB too: no rate is exactly 0, and none is rounded.": [
            *(-30.0, -60.0, 55.25, 150.0, 0.001)
        ],
        "An array has a rate for each element: use np.log2 and ** on the whole array, without a "
        "loop, `if` or `math`.": [
            np.array(snr_db) for snr_db in ([6.0], [0, 10, -20], [[-3.0, 0.0], [3.0, 20.0]], [])
        ],
    },
    smallest=1e-15,
)
def rate_from_snr(snr_db):
    """`rate(snr_db)`: data units in a slot, for numbers and arrays (eq. 4)."""
    return solved_rate(snr_db)


MANY = 400_000  # draws: only chance explains a deviation of 1.5 %


def _draw_crossover(ax):
    d = np.geomspace(0.3, 100, 200)
    for name, exponent in (("in sight", LOS), ("behind a building", NLOS)):
        ax.semilogx(d, 10 * exponent * np.log10(d), label=name)
    ax.axvline(1, color="grey", linestyle=":")
    ax.set(xlabel="distance, m", ylabel="path loss, dB", title="20 m behind = 122 m in sight")
    ax.axhline(36.4 * np.log10(20), color="grey", linewidth=0.8)


SAME_LOSS = Table(
    lambda nlos_m: nlos_m ** (NLOS / LOS),
    lambda: {
        "The loss 10 α log10(d) with α_LoS at your distance must be the one with α_NLoS at the "
        "distance given. Behind a building the loss grows faster, so the distance in sight is the "
        "longer one.": [*(20.0, 2.0, 55, 7.5, 1000.0)],
        "Both losses are 0 dB at 1 m; nearer, the distance in sight is the shorter one.": [
            *(1.0, 0.5, 0.03)
        ],
    },
    {
        "The loss is a power of the distance, so the ratio of the exponents belongs in the "
        "exponent, not in front.": lambda d: d * NLOS / LOS,
        "You add the altitude of 10 m, but d is the length of the whole link already.": (
            lambda d: np.hypot(d, 10) ** (NLOS / LOS)
        ),
    },
)


@exercise(
    "1.2 · Where the two path losses cross (2 points, 10 minutes)",
    "The path loss in dB is 10 α log10(d). Set the loss with α_LoS at the unknown distance "
    "equal to the one with α_NLoS at the given distance.",
    "Solve for the logarithm of the unknown distance. A factor in front of a logarithm is a "
    "power inside of it. For the crossing: which distance does such a power leave as it is?",
    figure=_draw_crossover,
    takes=(
        lambda answer: (
            isinstance(answer, tuple | list) and len(answer) == 2 and all(map(callable, answer))
        ),
        "Hand over both functions: path_loss_crossover((same_loss_m, crossover_m)).",
    ),
)
def path_loss_crossover(answer) -> None:
    """`(same_loss_m, crossover_m)`: functions of the NLoS distance and of nothing, both in m."""
    SAME_LOSS(answer[0])
    given = guarded(answer[1])()
    with suppress(Unreadable):
        losses = [10 * exponent * np.log10(number(given)) for exponent in (LOS, NLOS)]
        expect(
            not np.isfinite(losses).all() or close(given, 1.0),
            f"At {show(given)} m the loss is {losses[0]:.4g} dB in sight and {losses[1]:.4g} dB "
            "behind a building. At crossover_m both losses must be equal.",
        )
    expect(
        close(given, 1.0), f"crossover_m must give back a distance above 0 m, not {show(given)}."
    )


def _draw_mean_rate(ax, solved):
    snr_db = np.linspace(-15, 15, 61)
    for variance in (0, 2, 5, 50):
        mean = [solved(snr, variance, 1, None) for snr in snr_db]
        ax.plot(snr_db, mean, label=f"σ² = {variance} dB²")
    ax.set(xlabel="mean SNR, dB", ylabel="mean rate, data units a slot")


def _as_many_draws(answer) -> None:
    """As many slots are simulated as asked for, by chance of the generator alone.

    A right answer is refused with a probability below 1e-7: the limits are at 6 standard errors or
    more, those of the means in the table, too.
    """
    results = [answer(0.0, 5.0, 9, stream(Use.EXERCISE, seed)) for seed in (1, 2, 1)]
    expect(
        results[0] == results[2],
        "All chance must come from the generator that is passed in: same seed, same result.",
    )
    expect(
        results[0] != results[1],
        "The result is the same for every generator. Draw the fading from the one passed in, with "
        "the mean 0 and the standard deviation √variance, in this order.",
    )
    for draws in (1, 40):
        seeds = range(1000)
        few = [answer(12.0, 2.0, draws, stream(Use.EXERCISE, seed)) for seed in seeds]
        used = (_rates(12.0, 2.0)[1] / (np.std(few) + 1e-12)) ** 2
        expect(
            draws / 1.6 < used < 1.6 * draws,
            f"mean_rate(12, 2, {draws}, generator) has the right mean, but scatters from generator "
            f"to generator as the mean of {used:.3g} draws does, instead of {draws}: simulate "
            "`draws` slots, each with a fading of its own.",
        )


def _rates(snr_db, variance):
    """Mean and standard deviation of the rate over the fading."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(120)
    rates = solved_rate(snr_db + np.sqrt(variance) * nodes)
    mean = np.average(rates, weights=weights)
    return mean, np.sqrt(np.average((rates - mean) ** 2, weights=weights))


@solution(
    "1.3 · What fading does to the mean rate (2 points, 10 minutes)",
    "Draw many SNRs around the mean, turn each into a rate, and average the rates: in that order.",
    "Does generator.normal want a variance? The fading belongs to the SNR, while that is still "
    "in dB. One rate for each draw, and the mean comes last.",
    figure=_draw_mean_rate,
    rules={
        "With a variance of 0 (and the mean 0) there is no fading: all rates are the one at the "
        "mean SNR, and so is their mean.": [
            *((3.0, 0.0, 5), (-11, 0, 1)),
        ],
        "Simulate `draws` slots, each with a fading of its own: normal, mean 0, standard deviation "
        "√variance. It belongs to the SNR, in dB, not to the rate. Turn each SNR into a rate, then "
        "average the rates, not the SNRs. (Chance explains no more than 1.5 %.)": [
            *((0.0, 5.0, MANY), (-8, 30, MANY), (12.0, 2.0, MANY), (-20.0, 9.0, MANY)),
            (0.0, 60.0, MANY),
        ],
    },
    mistakes={
        "The fading is far too strong: generator.normal wants the root of the variance.": (
            edit("variance_db2", "variance_db2**2")
        ),
        "On average that is the rate at the mean SNR. Average the rates, not the SNRs: the rate "
        "at a mean is not the mean of the rates, nor is the median.": edit("variance_db2", "0"),
    },
    tolerance=0.015,
    again=False,
    made=lambda *case: (*case, stream(Use.EXERCISE, 1)),
    also=_as_many_draws,
)
def mean_rate(snr_db, variance_db2, draws, generator):
    """`mean_rate(snr_db, variance_db2, draws, generator)`: Monte Carlo mean over the fading."""
    return _rates(snr_db, variance_db2)[0]
