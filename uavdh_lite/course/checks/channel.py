"""Exercises of notebook 1, the city and the channel."""

import numpy as np

from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as solved_rate
from uavdh_lite.course.checks.exercise import close, compare, exercise, expect, guarded, show
from uavdh_lite.streams import Use, stream

CHANNEL = Channel()


def _draw_rate(ax):
    snr_db = np.linspace(-20, 30, 101)
    ax.plot(snr_db, solved_rate(snr_db))
    ax.set(xlabel="SNR, dB", ylabel="rate, data units a slot", title="1 at 0 dB")
    ax.grid(alpha=0.3)


@exercise(
    "1.1",
    "Rate from SNR",
    points=1,
    minutes=5,
    hints=(
        "The rate is log2(1 + SNR), where the SNR is a plain ratio of powers. What is 0 dB as a "
        "ratio? And 10 dB?",
        "10 dB more is ten times the power, so the decibels belong in an exponent. Which number is "
        "raised to it? The 1 is added to the ratio, and numpy has the logarithm to base 2.",
    ),
    figure=_draw_rate,
)
def rate_from_snr(rate) -> None:
    """`rate(snr_db)`: data units in a slot, for numbers and arrays (eq. 4)."""
    mistakes = {
        "The SNR is given in decibels, but the 1 is added to a plain ratio: convert it first, "
        "10 ** (snr_db / 10).": lambda snr_db: np.log2(1 + snr_db),
        "That is the natural logarithm, which counts the data in another unit. The formula has the "
        "logarithm to base 2, np.log2.": (lambda snr_db: np.log(1 + 10 ** (snr_db / 10))),
        "Power ratios have 10 dB a factor of ten: divide by 10, not by 20 (that is for "
        "amplitudes).": lambda snr_db: np.log2(1 + 10 ** (snr_db / 20)),
        "The 1 of log2(1 + SNR) is missing: without it the rate is negative below 0 dB.": (
            lambda snr_db: np.log2(10 ** (snr_db / 10))
        ),
        "That is base 10. Take np.log2.": lambda snr_db: np.log10(1 + 10 ** (snr_db / 10)),
    }
    with np.errstate(invalid="ignore"):
        compare(rate, solved_rate, [(0.0,), (10.0,), (-15.0,), (25.0,)], mistakes)
    several = np.array([[-3.0, 0.0], [3.0, 20.0]])
    expect(
        close(rate(several), solved_rate(several)),
        "It is right for single numbers but not for arrays: use np.log2 and ** on the whole "
        "array, without a loop or `math`.",
    )


def _same_loss_distance(nlos_m):
    return nlos_m ** (CHANNEL.path_loss_exponent_nlos / CHANNEL.path_loss_exponent_los)


def _draw_crossover(ax):
    d = np.geomspace(0.3, 100, 200)
    for name, exponent in (
        ("in sight", CHANNEL.path_loss_exponent_los),
        ("behind a building", CHANNEL.path_loss_exponent_nlos),
    ):
        ax.semilogx(d, 10 * exponent * np.log10(d), label=name)
    ax.axvline(1, color="grey", linestyle=":")
    ax.set(xlabel="distance, m", ylabel="path loss, dB", title="20 m behind = 122 m in sight")
    ax.axhline(36.4 * np.log10(20), color="grey", linewidth=0.8)
    ax.legend()


@exercise(
    "1.2",
    "Where the two path losses cross",
    points=2,
    minutes=10,
    hints=(
        "The path loss in dB is 10 α log10(d). Set the loss with α_LoS at the unknown distance "
        "equal to the one with α_NLoS at the given distance.",
        "Solve for the logarithm of the unknown distance. A factor in front of a logarithm is a "
        "power inside of it. For the crossing: which distance does such a power leave as it is?",
    ),
    figure=_draw_crossover,
)
def path_loss_crossover(answer) -> None:
    """`(same_loss_m, crossover_m)`: functions of the NLoS distance and of nothing, both in m."""
    expect(
        isinstance(answer, tuple) and len(answer) == 2,
        "Hand over both functions: path_loss_crossover((same_loss_m, crossover_m)).",
    )
    same_loss_m, crossover_m = map(guarded, answer)
    los, nlos = CHANNEL.path_loss_exponent_los, CHANNEL.path_loss_exponent_nlos
    mistakes = {
        "The exponents are the wrong way round: behind a building the signal fades faster, so "
        "the equal distance in sight must be the longer one.": lambda d: d ** (los / nlos),
        "The loss is a power of the distance, so the ratio of the exponents belongs in the "
        "exponent, not in front.": lambda d: d * nlos / los,
        "That is the loss in dB, not a distance: solve for the distance.": (
            lambda d: 10 * nlos * np.log10(d)
        ),
        "You add the altitude of 10 m, but d is the length of the whole link already, through the "
        "air: take it as it is.": lambda d: np.hypot(d, 10) ** (nlos / los),
    }
    compare(same_loss_m, _same_loss_distance, [(20.0,), (2.0,), (55.0,)], mistakes)
    distance = crossover_m()
    expect(
        np.ndim(distance) == 0 and not isinstance(distance, str) and distance > 0,
        f"crossover_m must give back a distance above 0 m; yours is {show(distance)}.",
    )
    losses = [show(float(10 * exponent * np.log10(distance))) for exponent in (los, nlos)]
    expect(
        close(distance, 1.0),
        f"At {show(distance)} m the loss is {losses[0]} dB in sight and {losses[1]} dB behind a "
        "building. At crossover_m both losses must be equal.",
    )


def _draw_mean_rate(ax):
    snr_db = np.linspace(-15, 15, 61)
    generator = stream(Use.EXERCISE, 0)
    for variance in (0, 2, 5, 50):
        draws = np.sqrt(variance) * generator.standard_normal((4000, 1))
        ax.plot(snr_db, solved_rate(snr_db + draws).mean(0), label=f"σ² = {variance} dB²")
    ax.set(xlabel="mean SNR, dB", ylabel="mean rate, data units a slot")
    ax.legend()


@exercise(
    "1.3",
    "What fading does to the mean rate",
    points=2,
    minutes=10,
    hints=(
        "Draw many SNRs around the mean, turn each into a rate, and average the rates: in that "
        "order.",
        "Does generator.normal want a variance? The fading belongs to the SNR, while that is still "
        "in dB. One rate for each draw, and the mean comes last.",
    ),
    figure=_draw_mean_rate,
)
def mean_rate(answer) -> None:
    """`mean_rate(snr_db, variance_db2, draws, generator)`: Monte Carlo mean over the fading."""

    def expected(snr_db, variance):
        nodes, weights = np.polynomial.hermite_e.hermegauss(80)
        return weights @ solved_rate(snr_db + np.sqrt(variance) * nodes) / weights.sum()

    draws = 60_000

    def ask(snr_db, variance, seed=0):
        return answer(snr_db, variance, draws, stream(Use.EXERCISE, seed))

    expect(
        np.ndim(ask(0.0, 5.0)) == 0,
        "One number is expected, the mean over the draws; you give back an array.",
    )
    expect(
        close(ask(3.0, 0.0), solved_rate(3.0), 1e-3),
        "Without fading (variance 0) the mean rate is the rate at the mean SNR, and yours is not.",
    )
    mean, wide = ask(-8.0, 30.0), expected(-8.0, 30.0)
    fading_db = stream(Use.EXERCISE, 0).normal(0, np.sqrt(30), draws)
    rates, too_wide = (solved_rate(-8.0 + f * fading_db) for f in (1, np.sqrt(30)))
    mistakes = {
        "The fading is far too strong: generator.normal wants the standard deviation, the root of "
        "the variance.": too_wide.mean(),
        "That is the rate at the mean SNR: average the rates, not the SNRs. The logarithm of a "
        "mean is not the mean of the logarithms.": solved_rate(-8.0 + fading_db.mean()),
        "You add the fading to the rate. It is in dB: add it to the SNR, then compute the rate.": (
            (solved_rate(-8.0) + fading_db).mean()
        ),
        "That is the median of the rates. The mean is asked for.": np.median(rates),
        "You average the SNR as a ratio and then take one logarithm: take the rate of every draw, "
        "then the mean.": solved_rate(-8.0 + 10 * np.log10((10 ** (fading_db / 10)).mean())),
        "That is the rate in a single slot: simulate `draws` slots, each with fading of its own.": (
            rates[0]
        ),
    }
    for message, value in mistakes.items():
        expect(not close(mean, value, 1e-6), message)
    expect(
        close(mean, wide, 0.03),
        f"At −8 dB with a variance of 30 dB² the mean rate is {wide:.4g}; you give {mean:.4g}.",
    )
    expect(
        ask(0.0, 5.0, 1) == ask(0.0, 5.0, 1) != ask(0.0, 5.0, 2),
        "All chance must come from the generator that is passed in: same seed, same result.",
    )
