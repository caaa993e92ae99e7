"""Exercises of notebook 1, the city and the channel."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as solved_rate
from uavdh_lite.course.checks.exercise import (
    CheckFailed,
    close,
    exercise,
    expect,
    guarded,
    show,
    solution,
)
from uavdh_lite.course.checks.table import Table
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
    read=number,
)


@exercise(
    "1.2 · Where the two path losses cross (2 points, 10 minutes)",
    "The path loss in dB is 10 α log10(d). Set the loss with α_LoS at the unknown distance "
    "equal to the one with α_NLoS at the given distance.",
    "Solve for the logarithm of the unknown distance. A factor in front of a logarithm is a "
    "power inside of it. For the crossing: which distance does such a power leave as it is?",
    figure=_draw_crossover,
    function=False,
)
def path_loss_crossover(answer) -> None:
    """`(same_loss_m, crossover_m)`: functions of the NLoS distance and of nothing, both in m."""
    expect(
        isinstance(answer, tuple | list) and len(answer) == 2 and all(map(callable, answer)),
        "Hand over both functions: path_loss_crossover((same_loss_m, crossover_m)).",
    )
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


def _draw_mean_rate(ax):
    snr_db = np.linspace(-15, 15, 61)
    generator = stream(Use.EXERCISE, 0)
    for variance in (0, 2, 5, 50):
        draws = np.sqrt(variance) * generator.standard_normal((4000, 1))
        ax.plot(snr_db, solved_rate(snr_db + draws).mean(0), label=f"σ² = {variance} dB²")
    ax.set(xlabel="mean SNR, dB", ylabel="mean rate, data units a slot")


def _moments(snr_db, variance):
    """Mean and standard deviation of the rate over the fading."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(120)
    rates = solved_rate(snr_db + np.sqrt(variance) * nodes)
    mean = np.average(rates, weights=weights)
    return mean, np.sqrt(np.average((rates - mean) ** 2, weights=weights))


FADING = ((0.0, 5.0), (-8, 30), (12.0, 2.0), (-20.0, 9.0), (0.0, 60.0))
SEEDS, FEW, MANY = 1000, 40, 400_000


def _of_chance(ask: Callable) -> Iterator[tuple]:
    """What must hold of the mean rates that are asked for, and what to say if it does not."""
    for snr_db, draws in ((3.0, 5), (-11, 1)):
        given, right = ask(snr_db, 0.0, draws, 0), solved_rate(snr_db)
        said = f"the mean rate is that at the mean SNR, {right:.4g} at {snr_db} dB"
        yield close(given, right, 1e-6), f"Without fading {said}; yours is {given:.4g}."
    few = np.array([[ask(*case, FEW, seed) for seed in range(SEEDS)] for case in FADING])
    mean, limit = few.mean(1), 6.5 * few.std(1, ddof=1) / np.sqrt(SEEDS) + 1e-8
    expected, spread = np.transpose([_moments(*case) for case in FADING])
    for message, value in {
        "The fading is far too strong: generator.normal wants the root of the variance.": (
            [_moments(snr_db, variance**2)[0] for snr_db, variance in FADING]
        ),
        "On average that is the rate at the mean SNR. The fading belongs to the SNR, in dB, not to "
        "the rate; and average the rates, not the SNRs: the logarithm of a mean is not the mean "
        "of the logarithms, nor is the median.": [solved_rate(snr_db) for snr_db, _ in FADING],
    }.items():
        agrees, right_too = ((abs(mean - one) < limit).all() for one in (value, expected))
        yield right_too or not agrees, message
    other = [ask(0.0, 5.0, 9, seed) for seed in (1, 2, 1)]
    yield (
        other[0] != other[1],
        "The result is the same for every generator. Draw the fading from the one passed in, with "
        "the mean 0 and the standard deviation √variance, in this order.",
    )
    for k, case in enumerate(FADING):
        at = "At {} dB with a variance of {} dB²".format(*case)
        near = (
            f"{at} the mean rate is {expected[k]:.4g}; yours is {{:.4g}}, and chance explains no "
            "more than {:.2g}. Turn each SNR into a rate, then average these."
        )
        yield abs(mean[k] - expected[k]) < limit[k], near.format(mean[k], limit[k])
        draws = (spread[k] / (few[k].std(ddof=1) + 1e-12)) ** 2
        yield (
            FEW / 1.6 < draws < 1.6 * FEW,
            f"{at} yours has the right mean, but scatters as the mean of {draws:.3g} draws does, "
            f"instead of {FEW}: simulate `draws` slots, each with a fading of its own.",
        )
        given, least = ask(*case, MANY, 1), 6.5 * spread[k] / np.sqrt(MANY)
        yield abs(given - expected[k]) < least, near.format(given, least)
    yield (
        other[0] == other[2],
        "All chance must come from the generator that is passed in: same seed, same result.",
    )


@exercise(
    "1.3 · What fading does to the mean rate (2 points, 10 minutes)",
    "Draw many SNRs around the mean, turn each into a rate, and average the rates: in that order.",
    "Does generator.normal want a variance? The fading belongs to the SNR, while that is still "
    "in dB. One rate for each draw, and the mean comes last.",
    figure=_draw_mean_rate,
)
def mean_rate(answer) -> None:
    """`mean_rate(snr_db, variance_db2, draws, generator)`: Monte Carlo mean over the fading.

    A right answer is refused with a probability below 1e-7: every limit is at 6 standard errors or
    more. One whose mean is off by 2 %, or that makes half as many draws, is accepted with one of
    less than 1e-6.
    """

    def ask(snr_db, variance, draws, seed):
        given = answer(snr_db, variance, draws, stream(Use.EXERCISE, seed))
        try:
            return float(number(given))
        except Unreadable as problem:
            call = f"mean_rate({snr_db}, {variance}, {draws}, generator)"
            raise CheckFailed(f"{call} gives {show(given)}: {problem}") from None

    for holds, message in _of_chance(ask):
        expect(holds, message)
