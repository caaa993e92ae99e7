"""Wrong answers to the exercises of notebook 1, and what the message must say of each."""

import numpy as np

MISTAKES = {
    "rate_from_snr": [
        (lambda snr_db: np.log2(1 + snr_db), "decibels"),
        (lambda snr_db: np.log(1 + 10 ** (snr_db / 10)), "natural logarithm"),
        (
            lambda snr_db: np.log2(1 + 10 ** (float(snr_db) / 10)),
            "stops with TypeError.*An array has",
        ),
        (lambda snr_db: np.log2(10 ** (snr_db / 10)), "0 dB is a ratio of 1"),
    ],
    "path_loss_crossover": [
        ((lambda d: d ** (2.27 / 3.64), lambda: 1.0), "the distance in sight is the longer"),
        ((lambda d: d * 3.64 / 2.27, lambda: 1.0), "belongs in the exponent"),
        ((lambda d: (d**2 + 100) ** (1.82 / 2.27), lambda: 1.0), "add the altitude"),
        ((lambda d: d ** (3.64 / 2.27), lambda: 10.0), "At 10 m the loss is 22.7 dB in sight"),
        ((lambda d: d ** (3.64 / 2.27), lambda: 0), "a distance above 0 m"),
        ((lambda d: d ** (3.64 / 2.27), lambda: None), "is there a `return`"),
    ],
    "mean_rate": [
        (
            lambda snr, var, n, g: np.log2(
                1 + 10 ** ((snr + np.random.default_rng(0).normal(0, var**0.5, n)) / 10)
            ).mean(),
            "same for every generator",
        ),
        (
            lambda snr, var, n, g: np.log2(1 + 10 ** ((snr + g.normal(0, var, n)) / 10)).mean(),
            "root of the variance",
        ),
        (
            lambda snr, var, n, g: (
                np.log2(1 + 10 ** (snr / 10)) + g.normal(0, var**0.5, n)
            ).mean(),
            "belongs to the SNR, in dB, not to the rate",
        ),
        (
            lambda snr, var, n, g: np.median(
                np.log2(1 + 10 ** ((snr + g.normal(0, var**0.5, n)) / 10))
            ),
            "nor is the median",
        ),
        (
            lambda snr, var, n, g: np.log2(1 + 10 ** ((snr + g.normal(0, var**0.5)) / 10)),
            "Simulate `draws` slots",
        ),
        (
            lambda snr, var, n, g: np.log2(
                1 + 10 ** ((snr + g.normal(0, var**0.5, n).mean()) / 10)
            ),
            "Average the rates, not the SNRs",
        ),
        (
            lambda snr, var, n, g: np.log2(1 + 10 ** ((snr + g.normal(0, var**0.5, n)) / 10)),
            "one number is expected",
        ),
        (
            lambda snr, var, n, g: np.log2(
                1 + 10 ** ((snr + np.random.default_rng().normal(0, var**0.5, n)) / 10)
            ).mean(),
            "generator that is passed in",
        ),
    ],
}
