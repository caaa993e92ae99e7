"""Exercises of notebook 7, the ablation of map centring."""

from itertools import combinations
from math import comb
from pathlib import Path

import numpy as np

from uavdh_lite.course.checks.exercise import CheckFailed, close, exercise, expect, show, solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.values import Unreadable, number, or_none, truth
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.storage import data_folder, read_table
from uavdh_lite.streams import Use, stream

KINDS = {"centred": BLUE, "non_centred": VERMILION}
METRIC = "collected_and_landed"
STUDY = Path("runs") / "centring-manhattan.csv.gz"


def recorded() -> dict[str, np.ndarray]:
    """The recorded ablation's validations, `data/runs/centring-manhattan.csv.gz`, by column."""
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
    at = _steps(table)[_at(table, 300_000)]
    ax.axvline(at, color="grey", linestyle=":", label=f"{at:,.0f} steps")
    ax.set(xlabel="environment steps", ylabel="collected and landed, greedy", ylim=(0, 1))


def _draw_steps_to(ax, solved):
    table = recorded()
    steps, values = _steps(table), curves(table)["non_centred"][0]
    ax.plot(steps, values, ".-", color=KINDS["non_centred"])
    for threshold in (0.7, 0.8, 0.9):
        at = solved(steps, values, threshold)
        said = "never" if at is None else f"{at:,.0f}"
        ax.axhline(threshold, color="grey", linewidth=0.6)
        text = f"{threshold} from {said} on"
        ax.text(steps[-1], threshold, text, ha="right", va="top", fontsize=8)
        ax.plot(at, threshold, "ko")
    ax.set(xlabel="environment steps", ylabel="collected and landed, greedy", ylim=(0, 1))
    ax.set_title("the first recorded non-centred run, three thresholds")


def _curve(values, threshold, steps=None):
    """Arguments of `steps_to`, with validations every 50,000 steps or at these ones."""
    every = 50_000 * np.arange(1, len(values) + 1)
    return np.array(every if steps is None else steps), np.array(values), threshold


def _random_curves():
    generator = stream(Use.EXERCISE, 7)
    drawn = [generator.uniform(0.4, 1, n).round(1) for n in (2, 3, 4, 5, 8, 8, 8, 13) * 2]
    return [
        (values, threshold, np.cumsum(generator.integers(1, 9_000, len(values))) - 1)
        for values in drawn
        for threshold in (0.5, 0.6, 0.8)
    ]


RISES = [0.1, 0.35, 0.6, 0.75, 0.5, 0.8, 0.9, 0.85]


@solution(
    "7.1 · How many steps to a threshold (1 point, 8 minutes)",
    "At which validations is the curve below the threshold? The one after the last of them is "
    "asked for. And if there is none below, or if it is the last of all?",
    "Go from the end backwards, through zip(steps[::-1], values[::-1]), and keep the steps of "
    "each value that is at least threshold, until one is below. If you kept none: None.",
    figure=_draw_steps_to,
    rules={
        "The result is one of `steps`: from there on all values are at least the threshold, and "
        "the value before it is below.": [
            *(([0.2, 0.9], 0.5), ([0.6, 0.4, 0.8], 0.5), ([0.1, 0.7, 0.8, 0.9], 0.6)),
            *((RISES, 0.7), (RISES, 0.84), (RISES, 0.6, range(3, 11))),
        ],
        "If no value is below the threshold, it is the first validation, even at 0 steps.": [
            *((RISES, 0.05), ([0.5], 0.1, [7]), ([0.3, 0.2, 0.9], 0, [0, 100, 200])),
        ],
        "If the last value is below the threshold, there is no such validation: return None. "
        "(np.argmax of a condition that is nowhere true is 0, the first place.)": [
            *((RISES, 0.95), (RISES, 0.88), ([0.5], 0.6), ([0.9, 0.8], 0.85)),
        ],
        "A value that equals the threshold has reached it: only a smaller one, however little, is "
        "below.": [
            *((RISES, 0.85), ([0.2, 0.7, 0.7 - 1e-9, 0.7], 0.7)),
        ],
        "It must hold for all curves and all distances between validations.": _random_curves(),
    },
    made=_curve,
    mistakes={
        "That is the position in the list, not the number of environment steps: look it up in "
        "`steps`.": edit("steps[first]", "first"),
    },
    read=or_none(number),
)
def steps_to(steps, values, threshold):
    """`steps_to(steps, values, threshold)`: the steps from which on it stays there, or None."""
    below = np.flatnonzero(values < threshold)
    first = below[-1] + 1 if len(below) else 0
    return steps[first] if first < len(steps) else None


def _differences(a, b):
    """The difference of the two means for each split of all values."""
    values = np.r_[a, b]
    splits = (list(own) for own in combinations(range(len(values)), len(a)))
    return [np.mean(values[own]) - np.mean(np.delete(values, own)) for own in splits]


def _draw_permutation(ax, solved):
    a, b = (values[:, values.shape[1] // 3] for values in curves(recorded()).values())
    ax.hist(_differences(a, b), 24, color=BLUE)
    for side in (-1, 1):
        ax.axvline(side * (a.mean() - b.mean()), color=VERMILION)
    ax.set(xlabel="difference of the two means, each split", ylabel="number of splits")
    listed = ("a = {}; b = {}").format(*(", ".join(f"{one:.3g}" for one in two) for two in (a, b)))
    title = f"a third into the recorded runs: p = {solved(a, b):.4g}\n{listed}"
    ax.set_title(title, fontsize="medium")


def _groups(a, b, parts=1):
    """Two groups of values; or so many random whole numbers, no two equal, divided by `parts`."""
    if isinstance(a, list):
        return np.array(a), np.array(b)
    values = stream(Use.EXERCISE, 10 * a + b).permutation(np.arange(-99, 99)) / parts
    return values[:a], values[a : a + b]


LARGE, ONE_SIDED = "np.mean(abs(differences) >= abs(seen)", "np.mean(differences >= seen"


@solution(
    "7.2 · A p-value for a few seeds (2 points, 15 minutes)",
    "If the kind made no difference, every way to deal the values out to the two groups would "
    "be as likely as the one that you saw. How many of them differ as much?",
    "itertools.combinations(range(len(a) + len(b)), len(a)) lists which values go to the first "
    "group; the rest are the second. Count where abs(difference) >= abs(observed) - 1e-9, and "
    "divide by the number of splits.",
    figure=_draw_permutation,
    rules={
        "Go through all splits, each once, without chance and without a formula. p is the share of "
        "those whose difference of the means is at least as large as the observed one, in absolute "
        "value; the observed split is one of them.": [
            *(([1, 2, 3], [4, 5, 6]), ([1.5, 4], [0.25, 8]), ([1], [2]), (3, 3), (2, 2), (4, 4)),
        ],
        "The groups may differ in size: the first group of each split is as large as a, and the "
        "difference is that of the means, not of sums.": [
            *(([7], [1, 2, 4]), ([1, 2, 4, 9], [3]), (2, 4), (4, 3), (3, 2), (3, 5), (1, 6)),
        ],
        "Two equal values count as two: deal out positions, range(len(a) + len(b)), not values.": [
            *(([1.0, 1.0, 6.0], [2.0, 8.0]), ([1, 2, 2], [2, 5]), ([3, 3], [3, 3])),
            *(([0, 1, 1], [1, 0, 0]), ([5.0], [5.0, 5.0, 1.0])),
        ],
        "Differences that are equal up to 1e-9 count as equal: sums of decimals are rounded. "
        "Others count as different, however small that is.": [
            *(([0.5, 0.1], [0.4, 0.9, 0.2]), ([0.1, 0.7, 0.3], [0.2, 0.6, 0.4])),
            *((3, 4, 100), (4, 3, 100), (2, 5, 100), (3, 3, 100), (4, 4, 100)),
            *(([1e-6, 2e-6, 4e-6], [0, 0.5e-6, 1e-6]), ([0.5, 0.900001], [0.5, 0.9])),
        ],
    },
    made=_groups,
    mistakes={
        "That is one-sided: the other direction counts too, so take the absolute value of both "
        "differences.": (
            *(edit(LARGE, ONE_SIDED), edit("abs(", "-1 * (")),
            edit("abs(differences)", "differences"),
        ),
        "The observed difference may be below 0: take its absolute value, too.": (
            edit("abs(seen)", "seen")
        ),
        "You double a one-sided share: count the splits whose absolute difference is at least as "
        "large.": edit(LARGE, f"2 * {ONE_SIDED}"),
    },
)
def permutation_p(a, b):
    """`permutation_p(a, b)`: exact and two-sided, of the difference of the means."""
    seen, differences = np.mean(a) - np.mean(b), np.array(_differences(a, b))
    return np.mean(abs(differences) >= abs(seen) - 1e-9)


def _at(table: dict[str, np.ndarray], steps: float) -> int:
    """The first validation at `steps` or later."""
    return int(np.argmax(_steps(table) >= steps))


def truths(table: dict[str, np.ndarray]) -> dict[str, tuple[bool | float, str]]:
    """What is right in exercise 7.3, and why: of each statement, and the smallest p."""
    runs = curves(table)
    (yes, no), at = runs.values(), _at(table, 300_000)
    a, b = yes[:, at], no[:, at]
    gap, spread = abs(a.mean() - b.mean()), max(a.std(ddof=1), b.std(ddof=1))
    best, worst = no[:, -1].max(), yes[:, -1].min()
    fall = max(-np.diff(one, axis=1).min() for one in runs.values())
    least = (1 + (len(a) == len(b))) / comb(len(a) + len(b), len(a))
    reasons = {
        "early": f"Centred: {a.min():.4g} or more; others: {b.max():.4g} or less.",
        "spread": f"The means differ by {gap:.4g}, the larger standard deviation is {spread:.4g}.",
        "swap": f"At the end the best non-centred run has {best:.4g}, the worst centred one "
        f"{worst:.4g}.",
        "steady": f"The largest fall of a run is {fall:.4g}.",
        "best": "The largest of several values is never below the last. That is why reporting the "
        "best validation flatters every run.",
        "equal": "Not to find a difference is not to show that there is none: few seeds leave room "
        "for a difference as large as the spread.",
        "missions": "More missions measure these networks more exactly. How another training run "
        "would come out is seen only in more runs.",
        "any_city": "In another city it has to be tried: no number of runs here shows it.",
        "smallest_p": "It is the same whatever the values are.",
    }
    computed = a.min() > b.max(), gap > spread, best > worst, fall <= 0.05
    right = *computed, True, False, False, False, least
    return dict(zip(reasons, zip(right, reasons.values(), strict=True), strict=True))


@exercise(
    "7.3 · What the recorded runs show (3 points, 20 minutes)",
    "Five of the eight statements are about numbers in the table: compute them. The other "
    "three say that something follows. Ask of those what one would have to vary to know.",
    "Put each kind's curves into an array with one row a seed. `early`: min of one against max "
    "of the other. `steady`: np.diff along the steps of every run, not of the means. "
    "`smallest_p`: how many splits have the largest absolute difference, if the groups do not "
    "overlap at all? `equal`: what would few seeds show if there *were* a small difference?",
    figure=_draw_recorded,
    takes=(lambda answer: isinstance(answer, dict), "Hand over the dict of all answers."),
)
def ablation_reading(answer) -> None:
    """A dict that says of each statement whether it is True or False, and the smallest p."""
    right, given = truths(recorded()), {}
    missing = ", ".join(name for name in right if answer.get(name) is None)
    unknown = ", ".join(show(name) for name in answer if name not in right)
    expect(not missing, f"No answer yet for {missing}.")
    expect(not unknown, f"There is no {unknown}.")
    for name in right:
        try:
            given[name] = (number if name == "smallest_p" else truth)(answer[name])
        except Unreadable as problem:
            raise CheckFailed(f"`{name}` is {show(answer[name])}: {problem}") from None
    wrong = [name for name, (true, _) in right.items() if not close(given[name], true)]
    p, least = given["smallest_p"], right["smallest_p"][0]
    why = ""
    if p <= 0:
        why = " The observed split is one of the splits, so p is never 0."
    elif close(2 * p, least):
        why = (
            " Your `smallest_p` is one-sided: between equally large groups, the split with the "
            "groups exchanged has the same absolute difference."
        )
    listed = ", ".join(f"`{name}`" for name in wrong)
    expect(not wrong, f"Wrong: {listed} ({len(wrong)} of {len(right)}).{why}")
    for name, (true, reason) in right.items():
        print(f"{name}: {show(true)}. {reason}")
