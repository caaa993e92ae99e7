"""Exercises of notebook 7, the ablation of map centring."""

import functools
from itertools import combinations
from math import comb
from pathlib import Path

import numpy as np

from uavdh_lite.checks.exercise import CheckFailed, compare, exercise, expect, guarded, show
from uavdh_lite.files import data_folder
from uavdh_lite.tables import read_table

KINDS = {"centred": "#0072B2", "non_centred": "#D55E00"}
METRIC = "collection_ratio_and_landed"
STUDY = Path("runs") / "centring-manhattan" / "validation.csv.gz"


def recorded() -> dict[str, np.ndarray]:
    """The validations of the recorded ablation, `data/runs/centring-manhattan`, by column."""
    here = Path.cwd()
    for folder in (data_folder(), *(parent / "data" for parent in (here, *here.parents))):
        if (folder / STUDY).exists():
            return read_table(folder / STUDY)
    raise FileNotFoundError(f"data/{STUDY}: open this notebook inside the project's folder")


def curves(table: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`METRIC` of each kind's runs, one row a seed, one column a validation."""
    result = {}
    for kind in KINDS:
        own = table["variant"] == kind
        seeds = np.unique(table["seed"][own])
        result[kind] = np.array([table[METRIC][own & (table["seed"] == seed)] for seed in seeds])
    return result


def _steps(table: dict[str, np.ndarray]) -> np.ndarray:
    return np.unique(table["steps"])


def _draw_recorded(ax):
    table = recorded()
    for kind, values in curves(table).items():
        lines = ax.plot(_steps(table), values.T, ".-", color=KINDS[kind], linewidth=0.9)
        lines[0].set_label(kind)
    ax.set(xlabel="environment steps", ylabel="collected and landed, greedy", ylim=(0.5, 1))
    ax.legend()


def _solved_steps_to(steps, values, threshold):
    reached = np.flatnonzero(np.asarray(values) >= threshold)
    return steps[reached[0]] if len(reached) else None


def _draw_steps_to(ax):
    table = recorded()
    steps, values = _steps(table), curves(table)["non_centred"][0]
    ax.plot(steps, values, ".-", color=KINDS["non_centred"])
    for threshold in (0.7, 0.8, 0.9):
        at = _solved_steps_to(steps, values, threshold)
        ax.axhline(threshold, color="grey", linewidth=0.6)
        if at is not None:
            ax.plot([at, at], [0, threshold], "k:")
            ax.text(at, 0.03, f" {at:,.0f}", rotation=90, fontsize=8)
    ax.set(xlabel="environment steps", ylabel="collected and landed, greedy", ylim=(0, 1))
    ax.set_title("one recorded run, three thresholds")


def _settled(steps, values, threshold):
    """The validation from which on the curve stays at or above the threshold."""
    below = np.flatnonzero(np.asarray(values) < threshold)
    first = below[-1] + 1 if len(below) else 0
    return steps[first] if first < len(steps) else None


def _last(steps, values, threshold):
    reached = np.flatnonzero(np.asarray(values) >= threshold)
    return steps[reached[-1]] if len(reached) else None


def _strict(steps, values, threshold):
    above = np.flatnonzero(np.asarray(values) > threshold)
    return steps[above[0]] if len(above) else None


def _index(steps, values, threshold):
    reached = np.flatnonzero(np.asarray(values) >= threshold)
    return int(reached[0]) if len(reached) else None


def _sorted(steps, values, threshold):
    at = np.searchsorted(values, threshold)
    return steps[at] if at < len(steps) else None


def _at_the_best(steps, values, threshold):
    best = np.argmax(values)
    return steps[best] if values[best] >= threshold else None


STEPS_TO_MISTAKES = {
    "That is the position in the list, not the number of environment steps: look it up in "
    "`steps`.": _index,
    "That is the last validation at or above the threshold; asked for is the first.": _last,
    "That is the validation from which on the curve stays above the threshold. Asked for is the "
    "first one at all, even if the curve falls below again later.": _settled,
    "A value that equals the threshold has reached it: compare with >=, not with >.": _strict,
    "A search by halving (np.searchsorted) needs sorted values, but a training curve goes up and "
    "down: look at one validation after the other.": _sorted,
    "That is where the curve is highest, not where it first reaches the threshold.": (_at_the_best),
}


@exercise(
    "7.1",
    "How many steps to a threshold",
    points=1,
    minutes=6,
    hints=(
        "Which validations are at or above the threshold? Of those, take the first; and think of "
        "what to do if there is none.",
        "Go through zip(steps, values) and return the steps at the first value >= threshold. "
        "After the loop nothing was found: return None.",
    ),
    figure=_draw_steps_to,
)
def steps_to(answer) -> None:
    """`steps_to(steps, values, threshold)`: the steps of the first validation, or None."""
    written = getattr(answer, "__wrapped__", answer)
    expect(callable(written), "Hand over the function itself, not what it gives back.")

    @functools.wraps(written)
    def boxed(*arguments):
        return (written(*arguments),)  # None is a right answer here

    ask = guarded(boxed)
    steps = np.arange(1, 9) * 50_000
    rises = np.array([0.1, 0.35, 0.6, 0.75, 0.5, 0.8, 0.9, 0.85])
    generator = np.random.default_rng(7)
    cases = [(steps, rises, 0.6), (steps, rises, 0.7), (steps, rises, 0.05), (steps, rises, 0.9)]
    cases += [(steps, generator.random(8).round(1), 0.6) for _ in range(20)]

    never = ask(steps, rises, 0.95)[0]
    if never is not None:
        value = show(never.item() if isinstance(never, np.generic) else never)
        why = "Return None where the curve never reaches the threshold"
        if never == steps[0] or (never == 0 and not isinstance(never, bool)):
            why += "; np.argmax of a condition that is nowhere true is 0, the first place"
        elif never == steps[-1]:
            why += "; the last validation would say that it reached it there"
        raise CheckFailed(f"{why}. You give {value}.")

    given = [ask(s.copy(), v.copy(), t)[0] for s, v, t in cases]
    right = [_solved_steps_to(*case) for case in cases]
    wrong = [k for k in range(len(cases)) if not _same(given[k], right[k])]
    if not wrong:
        return
    if all(one is None for one in given):
        raise CheckFailed("You give None for every curve: is there a `return` for the others?")
    for message, mistake in STEPS_TO_MISTAKES.items():
        if all(_same(given[k], mistake(*cases[k])) for k in wrong):
            raise CheckFailed(message)
    k = wrong[0]
    if given[k] is not None and np.ndim(given[k]) == 0 and given[k] not in steps:
        raise CheckFailed(
            f"{show(given[k])} is none of the validations {steps.tolist()}: nothing was measured "
            "there. Return an element of `steps`, without interpolation."
        )
    raise CheckFailed(
        f"For the values {cases[k][1].tolist()} and the threshold {cases[k][2]} you give "
        f"{show(given[k])}, expected {show(int(right[k])) if right[k] is not None else None}."
    )


def _same(one, other) -> bool:
    if one is None or other is None:
        return one is other
    return np.ndim(one) == 0 and not isinstance(one, str) and float(one) == float(other)


def _differences(a, b, statistic=np.mean, size=None) -> np.ndarray:
    """The difference for every split of all values into groups as large as a and b."""
    values = np.r_[a, b]
    count = len(a) if size is None else size
    return np.array(
        [
            statistic(values[list(own)]) - statistic(np.delete(values, list(own)))
            for own in combinations(range(len(values)), count)
        ]
    )


def _solved_p(a, b) -> float:
    observed = np.mean(a) - np.mean(b)
    return float(np.mean(np.abs(_differences(a, b)) >= abs(observed) - 1e-9))


def _draw_permutation(ax):
    a, b = (values[:, values.shape[1] // 3] for values in curves(recorded()).values())
    splits, observed = _differences(a, b), np.mean(a) - np.mean(b)
    ax.hist(splits, 24, color="#0072B2")
    for side in (-observed, observed):
        ax.axvline(side, color="#D55E00")
    ax.set(xlabel="difference of the two means, each split", ylabel="number of splits")
    ax.set_title(f"a third into the recorded runs: p = {_solved_p(a, b):.3f}")


def _drawn_p(a, b):
    return float(np.mean(_differences(a, b) >= np.mean(a) - np.mean(b) - 1e-9))


PERMUTATION_MISTAKES = {
    "That is one-sided: it counts only splits in which the first group is ahead as far. Without a "
    "direction fixed beforehand the other direction counts too: take the absolute value of both "
    "differences.": _drawn_p,
    "That is one-sided: the other direction counts too, so take the absolute value of both "
    "differences.": lambda a, b: float(
        np.mean(_differences(a, b) <= np.mean(a) - np.mean(b) + 1e-9)
    ),
    "That is one-sided: the absolute value of the observed difference is taken, but not that of "
    "the splits' differences.": lambda a, b: float(
        np.mean(_differences(a, b) >= abs(np.mean(a) - np.mean(b)) - 1e-9)
    ),
    "Doubling the one-sided share is right only if both groups are equally large: count the splits "
    "with an absolute difference at least as large.": lambda a, b: (
        2 * min(_drawn_p(a, b), _drawn_p(b, a))
    ),
    "Splits with exactly the observed difference are left out, and the observed split is one of "
    "them, so that your p can be 0. Count differences *at least* as large (>=, with 1e-9 for "
    "rounding).": lambda a, b: float(
        np.mean(np.abs(_differences(a, b)) > abs(np.mean(a) - np.mean(b)) + 1e-9)
    ),
    "That is the number of splits. Divide by how many splits there are.": lambda a, b: float(
        np.sum(np.abs(_differences(a, b)) >= abs(np.mean(a) - np.mean(b)) - 1e-9)
    ),
    "That is the share of the splits with a *smaller* difference, 1 − p: the p-value is the share "
    "with one at least as large.": lambda a, b: 1 - _solved_p(a, b),
    "You compare the sums of the groups. With groups of different size take the means.": (
        lambda a, b: float(
            np.mean(np.abs(_differences(a, b, np.sum)) >= abs(np.sum(a) - np.sum(b)) - 1e-9)
        )
    ),
    "You compare medians; the task asks for the difference of the means.": lambda a, b: float(
        np.mean(np.abs(_differences(a, b, np.median)) >= abs(np.median(a) - np.median(b)) - 1e-9)
    ),
    "Your first group is always half of all values. It must be as large as a.": lambda a, b: float(
        np.mean(
            np.abs(_differences(a, b, size=(len(a) + len(b)) // 2))
            >= abs(np.mean(a) - np.mean(b)) - 1e-9
        )
    ),
}


@exercise(
    "7.2",
    "A p-value for a few seeds",
    points=2,
    minutes=12,
    hints=(
        "If the kind made no difference, every way to deal the values out to the two groups would "
        "be as likely as the one that you saw. How many of them differ as much?",
        "itertools.combinations(range(len(a) + len(b)), len(a)) lists which values go to the first "
        "group; the rest are the second. Count where abs(difference) >= abs(observed) - 1e-9, and "
        "divide by the number of splits.",
    ),
    figure=_draw_permutation,
)
def permutation_p(answer) -> None:
    """`permutation_p(a, b)`: exact and two-sided, of the difference of the means."""
    expect(callable(answer), "Hand over the function itself, not what it gives back.")
    generator = np.random.default_rng(72)
    cases = [([0.9, 0.92, 0.94], [0.8, 0.82, 0.85]), ([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])]
    cases += [([1.0, 2.0], [2.0, 4.0, 9.0]), ([3.0, 3.5, 8.0, 1.0], [2.0, 2.5])]
    cases += [
        (generator.normal(0.3, 1, first).round(2).tolist(), generator.normal(0, 1, second).tolist())
        for first, second in ((3, 3), (2, 4), (4, 3), (3, 2), (3, 5))
    ]

    def ask(a, b):
        return answer(np.array(a), np.array(b))

    functools.update_wrapper(ask, answer)
    expect(
        ask([0.2, 0.1, 0.7], [0.3, 0.5]) == ask([0.2, 0.1, 0.7], [0.3, 0.5]),
        "Twice the same values give two different results: go through all splits instead of "
        "drawing some at random.",
    )
    compare(ask, _solved_p, cases, PERMUTATION_MISTAKES)
    expect(
        np.isclose(ask([1.0, 1.0], [1.0, 1.0, 1.0]), 1),
        "If all values are equal no split says anything: p must be 1 there.",
    )


def _at(table: dict[str, np.ndarray], steps: float) -> int:
    """The first validation at `steps` or later."""
    return int(np.argmax(_steps(table) >= steps))


def truths(table: dict[str, np.ndarray]) -> dict[str, tuple[bool, str]]:
    """For each statement of exercise 7.3, whether it is true, and why."""
    runs = curves(table)
    yes, no = runs["centred"], runs["non_centred"]
    at = _at(table, 300_000)
    gap = abs(yes[:, -1].mean() - no[:, -1].mean())
    spread = max(yes[:, -1].std(ddof=1), no[:, -1].std(ddof=1))
    fall = max(-np.diff(one, axis=1).min() for one in runs.values())
    least = (1 + (len(yes) == len(no))) / comb(len(yes) + len(no), len(yes))
    return {
        "early": (
            bool(yes[:, at].min() > no[:, at].max()),
            f"There the lowest centred run has {yes[:, at].min():.3f}, the highest of the others "
            f"{no[:, at].max():.3f}.",
        ),
        "spread": (
            bool(gap > spread),
            f"At the last validation the means differ by {gap:.4f}, and the larger standard "
            f"deviation between seeds (ddof=1) is {spread:.4f}.",
        ),
        "swap": (
            bool(no[:, -1].max() > yes[:, -1].min()),
            f"At the end the best non-centred run has {no[:, -1].max():.4f}, the worst centred one "
            f"{yes[:, -1].min():.4f}: one pair is enough.",
        ),
        "steady": (
            bool(fall <= 0.05),
            f"The largest fall from one validation to the next, over all runs, is {fall:.3f}. Look "
            "at every run, not at the means.",
        ),
        "possible": (
            least < 0.05,
            f"With {len(yes)} and {len(no)} seeds the smallest p that the test can give is "
            f"{least:.3f}, whatever the values are.",
        ),
        "best": (
            True,
            "The largest of several values is never below the last of them. That is why reporting "
            "the best validation flatters every run.",
        ),
        "equal": (
            False,
            "Not to find a difference is not to show that there is none: few seeds leave room for "
            "a difference as large as the spread.",
        ),
        "missions": (
            False,
            "More missions measure *these* networks more exactly. How far another training run "
            "would come out elsewhere is seen only in more runs.",
        ),
        "any_city": (
            False,
            "One city was flown. That it holds in another one does not follow from any number of "
            "runs in this one; it has to be tried.",
        ),
    }


@exercise(
    "7.3",
    "What the recorded runs show",
    points=3,
    minutes=15,
    hints=(
        "Six of the nine statements are about numbers in the table: compute them. The other three "
        "say that something follows. Ask of those what one would have to vary to know.",
        "Put each kind's curves into an array with one row a seed. Then `early` is "
        "min of one against max of the other, `steady` is np.diff along the steps of every run, "
        "and `possible` is the smallest share of splits that can be as extreme as the observed "
        "one.",
    ),
    figure=_draw_recorded,
)
def ablation_reading(answer) -> None:
    """A dict that says of each statement whether it is True or False."""
    expect(isinstance(answer, dict), "Hand over the dict of all statements.")
    right = truths(recorded())
    missing = [name for name in right if answer.get(name) is None]
    if missing:
        raise CheckFailed(f"No answer yet for {', '.join(missing)}.")
    unknown = [str(name) for name in answer if name not in right]
    expect(not unknown, f"There is no statement {', '.join(unknown)}.")
    for name in right:
        expect(
            isinstance(answer[name], bool | np.bool_),
            f"`{name}` is {show(answer[name])}: answer True or False.",
        )
    wrong = [name for name, (true, _) in right.items() if bool(answer[name]) != true]
    if wrong:
        why = " ".join(f"`{name}`: {right[name][1]}" for name in wrong)
        raise CheckFailed(f"Wrong are {len(wrong)} of {len(right)}. {why}")
