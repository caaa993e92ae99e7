"""Exercises of notebook 8, evaluation."""

import functools
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uavdh_lite.agent import Agent
from uavdh_lite.course.checks.exercise import CheckFailed, exercise, expect, guarded
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.trial import name_of
from uavdh_lite.course.checks.values import Unreadable, numbers, pair, row, show, whole
from uavdh_lite.environment import ACTIONS, Environment, Rewards, State
from uavdh_lite.evaluation import evaluate
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Genie, Greedy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream

Z, Z90 = 1.959964, 1.644854  # 95 and 90 % of a standard normal lie within ± these


def _wilson(successes, trials):
    p, n = successes / trials, trials
    middle = p + Z**2 / (2 * n)
    half = Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    return np.array([middle - half, middle + half]) / (1 + Z**2 / n)


def _grid(k, n):
    """The ends that 1001 shares on a grid give."""
    q = np.linspace(0, 1, 1001)
    return q[abs(k / n - q) <= 1.96 * np.sqrt(q * (1 - q) / n)][[0, -1]]


def _draw_wilson(ax):
    successes = np.arange(21)
    share = successes / 20
    low, high = np.transpose([_wilson(k, 20) for k in successes])
    ax.errorbar(share, share, [share - low, high - share], fmt="o", markersize=3, capsize=3)
    ax.set(xlabel="share observed in 20 trials", ylabel="share and its 95 % interval")


def _wilson_cases():
    generator = stream(Use.EXERCISE, 81)
    drawn = [(int(generator.integers(1, n)), int(n)) for n in generator.integers(5, 300, 6)]
    return {
        "At both ends of the interval |p − q| equals z sqrt(q (1 − q) / n): solve for q, with "
        "z = 1.96. The interval is not centred on p.": [(7, 10), (5, 20), (33, 40), *drawn],
        "If none or all succeed, one end is 0 or 1 and the other is not.": [
            *((0, 12), (20, 20), (0, 1), (1, 1), (0, 500)),
        ],
        "It must hold for few and for many trials.": [
            *((1, 2), (1, 3), (2, 3), (1, 1000), (997, 1000), (1, 50_000), (31_000, 50_000)),
        ],
    }


MIDDLE, ROOT, BELOW = ("+ Z**2 / (2 * n)", ""), ("+ Z**2 / (4 * n**2)", ""), "/ (1 + Z**2 / n)"
WILSON = Table(
    _wilson,
    _wilson_cases,
    mistakes={
        "Low and high are the wrong way round.": edit("return", "half = -half; return"),
        "That is the normal approximation, p ± z sqrt(p (1 − p) / n). Of n successes in n trials "
        "it says that the share is certainly 1. The root must hold the unknown share, not the "
        "observed one; solve for it.": edit(*MIDDLE, *ROOT, BELOW, ""),
        "That is the normal approximation, cut off at 0 and 1. Of n successes in n trials it still "
        "says that the share is certainly 1; solve for the unknown share instead.": (
            edit(*MIDDLE, *ROOT, BELOW, ".clip(0, 1)")
        ),
        "z = 1 holds the share in 68 % of all cases. For 95 % z is 1.96.": edit("Z", "1"),
        "z = 1.645 holds the share in 90 % of all cases. For 95 % z is 1.96.": edit("Z", "Z90"),
        "z is 2 in your interval, a rule of thumb. For 95 % z is 1.96.": edit("Z", "2"),
        "The denominator 1 + z²/n is missing: the upper end can exceed 1.": edit(BELOW, ""),
        "The middle is not shifted: it is p + z²/(2n), not p, before the division.": edit(*MIDDLE),
        "Under the root z²/(4n²) is missing: for a share of 1 the width would be 0.": edit(*ROOT),
        "That is as coarse as a grid of shares, which is not exact enough. At both ends of the "
        "interval the inequality is an equality: solve it for q.": _grid,
        "Do not round: in many trials the ends are small numbers.": tuple(
            (lambda k, n, digits=digits: np.round(_wilson(k, n), digits)) for digits in (2, 3, 4)
        ),
        "These are percentages; hand over shares from 0 to 1.": edit("return", "return 100 *"),
    },
    read=pair,
    tolerance=1e-3,
    smallest=1e-7,
)


@exercise(
    "8.1 · An interval for a share (2 points, 18 minutes)",
    "At both ends of the interval the inequality is an equality. Square it: what kind of "
    "equation in q is that?",
    "(p − q)² = z² q (1 − q) / n is quadratic in q. Its solutions are (p + z²/(2n) ± "
    "z sqrt(p (1 − p)/n + z²/(4n²))) / (1 + z²/n), with p = successes / trials.",
    figure=_draw_wilson,
    table=WILSON,
)
def wilson(answer) -> None:
    """`wilson(successes, trials)`: low and high end of the 95 % score interval."""


def _needed(standard_deviation, half_width):
    return math.ceil((1.96 * standard_deviation / half_width) ** 2)


def _draw_needed(ax):
    half = np.geomspace(0.002, 0.05, 60)
    for deviation in (0.05, 0.1, 0.3):
        ax.loglog(half * 100, [_needed(deviation, h) for h in half], label=f"σ = {deviation}")
    needed, exact = _needed(0.3, 0.02), f"{(1.96 * 0.3 / 0.02) ** 2:.1f}"
    ax.plot(2, needed, "ko")
    said = f"σ = 0.3, ± 2 points:\n(1.96 · 0.3 / 0.02)² = {exact},\nso {needed} episodes"
    ax.annotate(said, (2, needed), (0.22, 12), arrowprops={"arrowstyle": "->"})
    ticks = (0.2, 0.5, 1, 2, 5)
    ax.set_xticks(ticks, map(str, ticks))
    ax.set_xticks([], minor=True)
    ax.set(xlabel="half width of the interval, points (0.01)", ylabel="episodes needed")


def _needed_cases():
    generator = stream(Use.EXERCISE, 82)
    drawn = []
    while len(drawn) < 12:
        case = tuple(generator.uniform((0.05, 0.005), (0.6, 0.08)).round(3).tolist())
        rounded, exact = ((np.array(z) * case[0] / case[1]) ** 2 for z in ((1.96, 1.645), (Z, Z90)))
        if 0.1 < exact[0] % 1 < 0.9 and (np.ceil(rounded) == np.ceil(exact)).all():
            drawn.append(case)  # the rounded and the exact z agree
    return {
        "1.96 standard errors, standard_deviation / sqrt(n), make the half width: solve for n.": [
            *((0.1, 0.01), (0.3, 0.05), (1, 0.1), (0.3, 0.02), *drawn),
        ],
        "An episode cannot be flown in part: round up to the next whole number, an int.": [
            *((0.5, 0.3), (0.2, 0.07), (0.4, 0.101), (3, 1)),
        ],
        "If the formula gives a whole number, that is enough.": [
            (0.5, 0.49),
            (1.0, 0.98),
            (2, 1.96),
        ],
        "One episode is the least, and many are no problem.": [
            *((0.01, 0.5), (1e-6, 0.1), (40.0, 0.03), (150.0, 200.0)),
        ],
    }


NEEDED = Table(
    _needed,
    _needed_cases,
    mistakes={
        "Rounded down, the interval is too wide: round up (math.ceil).": edit("ceil", "floor"),
        "Rounded to the nearest, it may be too small: math.ceil.": edit("math.ceil", "round"),
        "math.ceil rounds up already: add nothing.": edit("return", "return 1 +"),
        "Where the number comes out whole, it is enough; you add one there (as int(x) + 1 does). "
        "Take math.ceil.": edit("math.ceil", "1 + math.floor"),
        "An episode cannot be flown in part: round up (math.ceil).": edit("math.ceil", ""),
        "The square is missing. The half width shrinks with the *root* of the number of "
        "episodes: for half of it you need four times as many.": edit(" ** 2", ""),
        "The 1.96 is missing: one standard error to each side holds 68 %.": edit("1.96 *", ""),
        "The 1.96 is not squared; it belongs inside the square.": edit("(1.96 * ", "1.96 * ("),
        "The standard deviation is not squared, as if it were a variance already.": (
            edit("1.96 * standard_deviation", "1.96 * standard_deviation**0.5")
        ),
        "half_width is one side of the interval, not all of its width: your answer is four times "
        "too small.": edit("1.96", "0.98"),
        "half_width is already one side of the interval. You halve it again.": edit("1.96", "3.92"),
        "The ratio is upside down: more scatter needs more episodes, a wider interval fewer.": (
            edit("standard_deviation / half_width", "half_width / standard_deviation")
        ),
        "Two standard errors are a rule of thumb. For 95 % z is 1.96.": edit("1.96", "2"),
        "With z = 1.645 the interval is a 90 % one. For 95 % z is 1.96.": edit("1.96", "1.645"),
        "With z = 2.576 the interval is a 99 % one. For 95 % z is 1.96.": edit("1.96", "2.576"),
    },
    read=whole,
    tolerance=1e-12,
)


@exercise(
    "8.2 · How many episodes (1 point, 5 minutes)",
    "The standard error of a mean of n episodes is the standard deviation over the root of n. "
    "How many standard errors make up the half width?",
    "Solve 1.96 standard_deviation / sqrt(n) = half_width for n, and round up.",
    figure=_draw_needed,
    table=NEEDED,
)
def episodes_needed(answer) -> None:
    """`episodes_needed(standard_deviation, half_width)`: an int."""


def _lead(a, b):
    d = a - b
    half = Z * d.std(ddof=1) / np.sqrt(len(d))
    return np.array([d.mean(), d.mean() - half, d.mean() + half])


def _unpaired(ddof):
    return edit(
        "d.std(ddof=1) / np.sqrt(len(d))",
        f"np.sqrt((a.var(ddof={ddof}) + b.var(ddof={ddof})) / len(d))",
    )


def _draw_lead(ax):
    generator = stream(Use.EXERCISE, 0)
    common, own = generator.standard_normal((2, 100, 1))
    shares = np.linspace(0, 0.95, 20)
    other = np.sqrt(shares) * common + np.sqrt(1 - shares) * generator.standard_normal((100, 1))
    first = np.sqrt(shares) * common + np.sqrt(1 - shares) * own
    pairs = list(zip(first.T, other.T, strict=True))
    correlation = [np.corrcoef(a, b)[0, 1] for a, b in pairs]
    for name, lead in (("in pairs", _lead), ("as if unpaired", _unpaired(1).of(_lead))):
        half = [np.ptp(lead(a, b)) / 2 for a, b in pairs]
        ax.plot(correlation, half, "o-", markersize=3, label=name)
    ax.set(xlabel="correlation of the two policies' results", ylabel="half width (each σ ≈ 1)")
    ax.set(title="100 scenarios", ylim=(0, None))


def _lead_cases():
    generator = stream(Use.EXERCISE, 836)  # no end near 0, where 1.96 and Z would differ too much

    def drawn(count, together, ahead=0.3, scale=1.0):
        common = generator.standard_normal(count)
        a, b = generator.normal((ahead, 0), 1, (count, 2)).T
        return scale * (a + together * common), scale * (b + abs(together) * common)

    few = np.array([3.0, 5.0, 10.0]), np.array([1.0, 4.0, 2.0])
    return {
        "With d = a − b of each pair: the mean of d, and 1.96 standard errors, "
        "d.std(ddof=1) / sqrt(n), to either side: (mean, low, high).": [
            *(few, few[::-1], (np.array([9, 5]), np.array([1, 2])), drawn(8, 1.0)),
        ],
        "It must hold whether the two results go together or not, for few and many scenarios.": [
            *(drawn(30, 2.0), drawn(300, 0.5), drawn(15, -0.7), drawn(9, 0.0), drawn(2, 3.0, 2.0)),
            *(drawn(40, 1.0, -2.0, 50.0), drawn(25, 1.0, 3.0, 0.001)),
        ],
        "If all differences are equal, the interval has the width 0.": [
            (np.array([2.0, 3.0, 7.0]), np.array([1.0, 2.0, 6.0])),
        ],
    }


BY_ROOT = "/ np.sqrt(len(d))"
LEAD = Table(
    _lead,
    _lead_cases,
    mistakes={
        "The sign is wrong: positive means that a is ahead of b.": edit("a - b", "b - a"),
        "You take the size of each difference, abs(a − b): so even of two equally good policies "
        "one would be ahead. Keep the sign.": edit("a - b", "abs(a - b)"),
        "That is the unpaired interval: it adds both variances, as if each policy had flown "
        "scenarios of its own. Take the standard deviation of the differences a − b.": (
            *(_unpaired(1), _unpaired(0)),
        ),
        "The interval is made of the standard deviation of one difference. The mean of n of them "
        "is known better: divide by the root of n (the standard error).": (
            *(edit(BY_ROOT, ""), edit(BY_ROOT, "", "ddof=1", "")),
        ),
        "These are quantiles of the differences: 95 % of the single scenarios lie between them. "
        "The mean of n is known better: take its standard error.": (
            lambda a, b: np.array([(a - b).mean(), *np.quantile(a - b, (0.025, 0.975))])
        ),
        "Take the standard deviation, not the variance.": edit("std", "var"),
        "Divided by n instead of by the root of n.": edit(BY_ROOT, "/ len(d)"),
        "np.std divides by n by default. The standard deviation is estimated from the same n "
        "values as the mean, so divide by n − 1: ddof=1.": edit("ddof=1", ""),
        "Divided by the root of n − 1. The n − 1 belongs into the standard deviation (ddof=1); its "
        "mean's standard error is that over the root of n.": edit("len(d)", "len(d) - 1"),
        "One standard error on either side holds 68 %. For 95 % take 1.96.": edit("Z * ", ""),
        "Low and high are the wrong way round.": edit("half = ", "half = -"),
        "The order is (mean, low, high), the mean first.": (
            edit("d.mean(), d.mean() - half", "d.mean() - half, d.mean()")
        ),
    },
    read=row(3, "(mean, low, high), both ends of the interval, not mean and half width, are"),
    tolerance=1e-3,
    smallest=1e-6,
)


@exercise(
    "8.3 · Paired or not (2 points, 8 minutes)",
    "Both policies flew the same scenarios, so every scenario gives one difference. Of these "
    "you have n, and you know how to give a mean with an interval.",
    "With d = a − b: d.mean() ± 1.96 * d.std(ddof=1) / sqrt(n). The variances of a and of b do "
    "not appear.",
    figure=_draw_lead,
    table=LEAD,
)
def lead(answer) -> None:
    """`lead(a, b)`: (mean, low, high) of a − b, in pairs."""


# In the missions of this seed, to skip a device with less than 2 to 4 units left gains as much as
# in 20,000 others, about 0.3. With some seeds it gains 0.5, by luck.
EPISODES, SEED, SECONDS, AHEAD = 300, 885, 20, 0.4
RETURN = "cumulative_reward"
Rule = Callable[[State], np.ndarray]


@functools.cache
def _planner(environment: Environment) -> Greedy:
    return Greedy(environment)


def _simulated(
    environment: Environment, state: State, plans: list[tuple[Rule, Rule]]
) -> np.ndarray:
    """For each episode the first action of the plan with the highest return at fading 0.

    A plan is a rule for the first action and one for all later ones.
    """
    fading = np.zeros((len(state), 4, 5), np.float32)
    actions = np.array([first(state) for first, _ in plans])
    plan, episode = np.indices(actions.shape).reshape(2, -1)
    after, outcome = environment.transition(state[episode], actions.ravel(), fading[episode])
    total, flying = Rewards()(outcome), np.arange(len(episode))
    while not after.ended.all():
        flying, after = flying[~after.ended], after[~after.ended]
        rows = [plan[flying] == k for k in range(len(plans))]
        action = [then(after[mine]) for mine, (_, then) in zip(rows, plans, strict=True)]
        after, outcome = environment.transition(
            after, np.concatenate(action), fading[episode[flying]]
        )
        total[flying] += Rewards()(outcome)
    best = total.reshape(actions.shape).argmax(axis=0)
    return actions[best, np.arange(len(state))]


def _flown(policy: Rule) -> dict[str, np.ndarray]:
    environment = environment_of("manhattan")
    return evaluate(environment, policy, find_scenario("manhattan"), EPISODES, SEED).records()


def _draw_policy(ax):
    greedy = _planner(environment_of("manhattan"))

    def leaving(least: float) -> Rule:
        def rule(state):
            worth = np.where(state.data_left < least, np.float32(0), state.data_left)
            return greedy(replace(state, data_left=worth))

        return rule

    def best(plans) -> Rule:
        return lambda state: _simulated(greedy.environment, state, plans)

    firsts = [(lambda s, a=a: np.full(len(s), a), greedy) for a in range(len(ACTIONS))]
    rules = {
        **{f"skip devices with less than {least}": leaving(least) for least in (1, 3, 6)},
        "simulate skipping below\n0, 1, 2, 4; take the best": (
            best([(leaving(least), leaving(least)) for least in (0, 1, 2, 4)])
        ),
        "simulate each action, then\ngreedy; take the best": best(firsts),
    }
    theirs = _flown(greedy)[RETURN]
    for y, rule in enumerate(rules.values()):
        own = _flown(rule)[RETURN]
        mean, low, high = _lead(own, theirs)
        ax.errorbar(mean, y, xerr=[[mean - low], [high - mean]], fmt="o", capsize=4)
        ax.text(1.55, y, f"{own.mean():.2f}", va="center", ha="right")
    ax.axvline(0, color="grey")
    ax.axvline(AHEAD, color="grey", linestyle="--")
    ax.set(yticks=range(len(rules)), yticklabels=list(rules), ylim=(len(rules) - 0.5, -0.5))
    ax.set(xlim=(-1.4, 1.6))
    ax.set_xlabel("lead over greedy, 95 % interval (dashed: goal)", fontsize=9)
    ax.set_title(f"{EPISODES} missions; right: return (greedy {theirs.mean():.2f})", fontsize=10)


NOT_ALLOWED = "{} is not allowed here: write the rule yourself. Greedy may be a part of it."


@exercise(
    "8.4 · Beat the greedy planner (4 points, 45 minutes)",
    "No single rule is best everywhere: leaving the last units of a device pays in one mission "
    "and not in another. Have several rules, and choose among them at every step.",
    "Choose by simulation: for each candidate (a rule, or one of the six actions and greedy "
    "after it) fly all episodes on to their end with environment.transition and fading 0, add "
    "up Rewards()(outcome), and take the first action of the one with the highest return.",
    figure=_draw_policy,
    seconds=300,
    refused={
        (Genie, "_search"): NOT_ALLOWED.format("Genie"),
        (Agent, "q_values"): NOT_ALLOWED.format("Agent"),
    },
)
def policy(answer) -> None:
    """`policy(environment, state)`: actions for a batch, with a higher return than greedy."""
    environment = environment_of("manhattan")
    ask, began = guarded(answer.__wrapped__, name_of(answer)), time.process_time()

    def asked(state: State) -> np.ndarray:
        given, count = ask(environment, state), len(state)
        try:
            shape = numbers(given).shape
        except Unreadable as problem:
            raise CheckFailed(f"Your policy gives {show(given)}: {problem}") from None
        action = np.asarray(given.detach() if hasattr(given, "detach") else given)
        expect(
            shape == (count,),
            f"For {count} episodes you give an array of the shape {shape}. One action an "
            f"episode is expected, ({count},): `state` is a batch, also when few are in the air.",
        )
        expect(
            np.issubdtype(action.dtype, np.integer),
            f"The actions are of type {action.dtype}; give whole numbers, indices into {ACTIONS}.",
        )
        unknown = action[(action < 0) | (action >= len(ACTIONS))]
        if len(unknown):
            known = f"0 to {len(ACTIONS) - 1}, {', '.join(ACTIONS)}"
            raise CheckFailed(f"There is no action {unknown[0]}: they are {known}.")
        expect(
            time.process_time() - began < SECONDS,
            f"Your policy is too slow: {SECONDS} seconds of processor time are over and not all of "
            f"the {EPISODES} missions have ended. Work on the whole batch at once, and compute "
            "tables only once.",
        )
        return action

    own, greedy = _flown(asked), _flown(_planner(environment))
    lead, low, high = _lead(own[RETURN], greedy[RETURN])
    standing = (
        f"Your return is {own[RETURN].mean():.2f}, greedy's {greedy[RETURN].mean():.2f}: a lead of "
        f"{lead:+.2f} ({low:+.2f} to {high:+.2f})."
    )
    if lead >= AHEAD and low > 0:
        print(standing)
        return
    crashes = int((~own["has_landed"].astype(bool)).sum())
    refused = own["safety_interventions"].mean()
    if np.array_equal(own[RETURN], greedy[RETURN]):
        why = "These are the same flights as greedy's, in every mission."
    elif crashes > EPISODES - greedy["has_landed"].sum():
        why = (
            f"It crashed in {crashes} of {EPISODES} missions, 150 points each: turn back while "
            "time_left still suffices for landing_distance and the landing."
        )
    elif refused > 1:
        why = (
            f"The safety controller refused {refused:.1f} actions a mission, a move into a no-fly "
            "cell or a landing outside the zone: look at environment.forbidden."
        )
    elif low > 0:
        why = f"It is ahead, but by less than the {AHEAD} that are asked for."
    elif high < 0:
        why = "It is behind greedy: `ways(policy)` draws where it loses most."
    else:
        side = "ahead of" if lead > 0 else "behind"
        why = f"It is {side} greedy, but the interval holds 0: that may be luck."
    raise CheckFailed(f"{why} {standing}")
