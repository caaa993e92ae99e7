"""Wrong answers to the exercises of notebook 7, and what the message must say of each."""

import math
from itertools import combinations

import numpy as np

from uavdh_lite.course.checks.ablation import recorded


def stays_above(steps, values, threshold, above=np.greater_equal):
    for k, step in enumerate(steps):
        if above(values[k:], threshold).all():
            return step
    return None


def position(steps, values, threshold):
    return stays_above(range(len(steps)), values, threshold)


def strictly_above(steps, values, threshold):
    return stays_above(steps, values, threshold, np.greater)


def first_reached(steps, values, threshold):
    return next((s for s, v in zip(steps, values, strict=True) if v >= threshold), None)


def last_reached(steps, values, threshold):
    return first_reached(steps[::-1], values[::-1], threshold)


def last_below(steps, values, threshold):
    below = steps[values < threshold]
    return None if values[-1] < threshold else below[-1] if len(below) else steps[0]


def after_the_last_below(steps, values, threshold):
    return None if values[-1] < threshold else steps[np.flatnonzero(values < threshold)[-1] + 1]


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


def share(a, b, split=abs, seen=abs, slack=1e-9):
    observed = seen(np.mean(a) - np.mean(b))
    return np.mean([split(d) >= observed - slack for d in splits(a, b)])


def running_sums(a, b):
    everything, found = [*a, *b], []
    for chosen in combinations(range(len(everything)), len(a)):
        first = sum(everything[k] for k in chosen)
        found.append(abs(first / len(a) - (sum(everything) - first) / len(b)))
    return np.mean([d >= abs(sum(a) / len(a) - sum(b) / len(b)) for d in found])


def values_for_positions(a, b):
    everything, found = [*a, *b], []
    for chosen in combinations(everything, len(a)):
        rest = [v for v in everything if v not in chosen]
        found.append(abs(sum(chosen) / len(a) - sum(rest) / len(rest)))
    return np.mean([d >= abs(np.mean(a) - np.mean(b)) - 1e-9 for d in found])


def distinct_values(a, b):
    found = []
    for chosen in combinations([*a, *b], len(a)):
        rest = np.setdiff1d([*a, *b], chosen)
        found.append(abs(np.mean(chosen) - rest.mean()))
    return np.mean([d >= abs(np.mean(a) - np.mean(b)) - 1e-9 for d in found])


def shuffled_seeded(a, b):
    return shuffled(a, b, np.random.default_rng(3))


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
        curve = table["collected_and_landed"][own]
        runs.setdefault(kind, []).append((table["steps"][own], curve))
        ends.setdefault(kind, []).append(curve[-1])
    early = {k: [c[s >= 300_000][0] for s, c in several] for k, several in runs.items()}
    spread = max(np.std(values, ddof=1) for values in early.values())
    counts = len(ends["centred"]), len(ends["non_centred"])
    return {
        "early": bool(min(early["centred"]) > max(early["non_centred"])),
        "spread": bool(abs(np.mean(early["centred"]) - np.mean(early["non_centred"])) > spread),
        "swap": bool(max(ends["non_centred"]) > min(ends["centred"])),
        "steady": bool(min(np.diff(c).min() for r in runs.values() for _, c in r) >= -0.05),
        "best": True,
        "equal": False,
        "missions": False,
        "any_city": False,
        "smallest_p": (1 + (counts[0] == counts[1])) / math.comb(sum(counts), counts[0]),
    }


RIGHT = _read()


def of_a_set(a, b):
    splits = list(combinations(sorted({*a, *b}), len(a)))
    total = sum(a) + sum(b)
    observed = abs(np.mean(a) - np.mean(b))
    far = [abs(np.mean(s) - (total - sum(s)) / len(b)) >= observed - 1e-9 for s in splits]
    return np.mean(far)


MISTAKES = {
    "steps_to": [
        (position, "position in the list"),
        (first_reached, "from there on all values"),
        (last_reached, "from there on all values"),
        (last_below, "the value before it is below"),
        (strictly_above, "that equals the threshold"),
        (lambda s, v, t: s[np.argmax(v >= t)], "the value before it is below"),
        (never_the_end, "the value before it is below"),
        (interpolated, "the value before it is below"),
        (lambda s, v, t: None, "gives None, expected .* The result is one of"),
        (lambda s, v, t: s[np.flatnonzero(v < t)[-1] + 1], "IndexError.*first validation"),
        (after_the_last_below, "IndexError.*If no value is below"),
    ],
    "permutation_p": [
        (one_sided, "one-sided"),
        (only_larger, "at least"),
        (a_count, "p is the share of those"),
        (of_a_set, "Two equal values count as two"),
        (shuffled, "not on earlier calls or on chance"),
        (shuffled_seeded, "without chance"),
        (normal_test, "without a formula"),
        (lambda a, b: 1 - np.mean([abs(d) < 1 for d in splits(a, b)]), "gives .* expected"),
        (
            lambda a, b: (a_count(a, b) - 1) / (len([*splits(a, b)]) - 1),
            "observed split is one of them",
        ),
        (lambda a, b: (a_count(a, b) - 1) / len([*splits(a, b)]), "observed split is one of them"),
        (lambda a, b: 100 * share(a, b), "p is the share of those"),
        (lambda a, b: share(a, b, seen=lambda d: d), "observed difference may be below 0"),
        (lambda a, b: share(a, b, split=lambda d: d), "absolute value of both"),
        (lambda a, b: 2 * one_sided(a, b), "double a one-sided share"),
        (lambda a, b: min(2 * one_sided(a, b), 1), "in absolute value"),
        (lambda a, b: share(a, b, slack=0), "equal up to 1e-9"),
        (running_sums, "equal up to 1e-9"),
        (values_for_positions, "deal out positions"),
        (distinct_values, "deal out positions"),
        (lambda a, b: (share(a, b), 20), "expected are numbers, in rows|one number is"),
    ],
    "ablation_reading": [
        (RIGHT | {"any_city": True}, r"^Wrong: `any_city` \(1 of 9\)\.$"),
        (RIGHT | {"equal": True, "missions": True}, r"^Wrong: `equal`, `missions` \(2 of 9\)\.$"),
        *(
            (RIGHT | {name: not RIGHT[name]}, rf"^Wrong: `{name}` \(1 of 9\)\.$")
            for name in ("early", "spread", "swap", "steady", "best")
        ),
        (RIGHT | {"smallest_p": RIGHT["smallest_p"] / 2}, "`smallest_p` is one-sided"),
        (RIGHT | {"smallest_p": 0}, "p is never 0"),
        (RIGHT | {"smallest_p": 1 / 720}, r"^Wrong: `smallest_p` \(1 of 9\)\.$"),
        (RIGHT | {"smallest_p": True}, r"^Wrong: `smallest_p` \(1 of 9\)\.$"),
        ({name: None for name in RIGHT}, "No answer yet for early, spread"),
        (RIGHT | {"best": "yes"}, "one truth value is expected, True or False"),
        (RIGHT | {"possible": False}, "There is no .possible"),
    ],
}
