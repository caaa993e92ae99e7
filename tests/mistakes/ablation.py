"""Wrong answers to the exercises of notebook 7, and what the message must say of each."""

import math
from itertools import combinations

import numpy as np

from uavdh_lite.checks.ablation import recorded


def first_index(steps, values, threshold):
    return next((k for k, v in enumerate(values) if v >= threshold), None)


def last_reached(steps, values, threshold):
    found = None
    for step, value in zip(steps, values, strict=True):
        if value >= threshold:
            found = step
    return found


def strictly_above(steps, values, threshold):
    return next((s for s, v in zip(steps, values, strict=True) if v > threshold), None)


def stays_above(steps, values, threshold):
    for k, step in enumerate(steps):
        if (values[k:] >= threshold).all():
            return step
    return None


def interpolated(steps, values, threshold):
    if (values < threshold).all():
        return None
    k = int(np.argmax(values >= threshold))
    if k == 0:
        return steps[0]
    share = (threshold - values[k - 1]) / (values[k] - values[k - 1])
    return steps[k - 1] + share * (steps[k] - steps[k - 1])


def never_the_end(steps, values, threshold):
    k = 0
    while k < len(steps) - 1 and values[k] < threshold:
        k += 1
    return steps[k]


def splits(a, b):
    everything = list(a) + list(b)
    for chosen in combinations(range(len(everything)), len(a)):
        rest = [v for k, v in enumerate(everything) if k not in chosen]
        yield np.mean([everything[k] for k in chosen]) - np.mean(rest)


def one_sided(a, b):
    return np.mean([d >= np.mean(a) - np.mean(b) - 1e-9 for d in splits(a, b)])


def only_larger(a, b):
    observed = abs(np.mean(a) - np.mean(b))
    return np.mean([abs(d) > observed + 1e-9 for d in splits(a, b)])


def a_count(a, b):
    observed = abs(np.mean(a) - np.mean(b))
    return sum(abs(d) >= observed - 1e-9 for d in splits(a, b))


def shuffled(a, b, generator=np.random.default_rng(3)):  # noqa: B008 (one stream for all calls)
    everything, observed = np.concatenate([a, b]), abs(np.mean(a) - np.mean(b))
    count = 0
    for _ in range(200):
        generator.shuffle(everything)
        d = abs(everything[: len(a)].mean() - everything[len(a) :].mean())
        count += d >= observed - 1e-9
    return count / 200


def normal_test(a, b):
    error = math.sqrt(np.var(a, ddof=1) / len(a) + np.var(b, ddof=1) / len(b))
    return math.erfc(abs(np.mean(a) - np.mean(b)) / error / math.sqrt(2))


def _read():
    """The right answers, and for the first of them the numbers, computed here once more."""
    table = recorded()
    ends, runs = {}, {}
    for kind, seed in sorted(set(zip(table["variant"], table["seed"], strict=True))):
        own = (table["variant"] == kind) & (table["seed"] == seed)
        curve = table["collection_ratio_and_landed"][own]
        runs.setdefault(kind, []).append((table["steps"][own], curve))
        ends.setdefault(kind, []).append(curve[-1])
    early = {k: [c[s >= 300_000][0] for s, c in several] for k, several in runs.items()}
    spread = max(np.std(values, ddof=1) for values in ends.values())
    counts = len(ends["centred"]), len(ends["non_centred"])
    return {
        "early": bool(min(early["centred"]) > max(early["non_centred"])),
        "spread": bool(abs(np.mean(ends["centred"]) - np.mean(ends["non_centred"])) > spread),
        "swap": bool(max(ends["non_centred"]) > min(ends["centred"])),
        "steady": bool(min(np.diff(c).min() for r in runs.values() for _, c in r) >= -0.05),
        "possible": (1 + (counts[0] == counts[1])) / math.comb(sum(counts), counts[0]) < 0.05,
        "best": True,
        "equal": False,
        "missions": False,
        "any_city": False,
    }


RIGHT = _read()

MISTAKES = {
    "steps_to": [
        (first_index, "position in the list"),
        (last_reached, "the last validation at or above"),
        (stays_above, "from which on the curve stays"),
        (strictly_above, ">="),
        (lambda s, v, t: s[np.argmax(v >= t)], "nowhere true is 0"),
        (never_the_end, "the last validation would say"),
        (interpolated, "none of the validations"),
        (lambda s, v, t: None, "None for every curve"),
    ],
    "permutation_p": [
        (one_sided, "one-sided"),
        (only_larger, "at least"),
        (a_count, "number of splits"),
        (shuffled, "at random"),
        (normal_test, "expected"),
        (lambda a, b: 1 - np.mean([abs(d) < 1 for d in splits(a, b)]), "expected"),
    ],
    "ablation_reading": [
        (RIGHT | {"any_city": True}, "are 1 of 9.*`any_city`: One city was flown"),
        (RIGHT | {"equal": True}, "`equal`: Not to find a difference"),
        (RIGHT | {"missions": True}, "seen only in more runs"),
        (RIGHT | {"spread": not RIGHT["spread"]}, "`spread`: .* the means differ by"),
        (RIGHT | {"steady": not RIGHT["steady"]}, "`steady`: The largest fall"),
        (RIGHT | {"possible": not RIGHT["possible"]}, "`possible`: .* the smallest p"),
        ({name: None for name in RIGHT}, "No answer yet for early, spread"),
        (RIGHT | {"best": "yes"}, "answer True or False"),
    ],
}
