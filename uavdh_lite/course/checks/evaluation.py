"""Exercises of notebook 8, evaluation."""

import functools
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.course.checks.exercise import CheckFailed, exercise, expect, guarded, solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.trial import expect_none, first_true, name_of
from uavdh_lite.course.checks.values import Unreadable, pair, row, show, whole
from uavdh_lite.environment import ACTIONS, Rewards, State
from uavdh_lite.evaluation import FunctionPolicy, evaluate
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream

Z = 1.959964  # 95 % of a standard normal lie within ± this


def _draw_wilson(ax, solved):
    successes = np.arange(21)
    share = successes / 20
    low, high = np.transpose([solved(k, 20) for k in successes])
    ax.errorbar(share, share, [share - low, high - share], fmt="o", markersize=3, capsize=3)
    ax.set(xlabel="share observed in 20 trials", ylabel="share and its 95 % interval")


@solution(
    "8.1 · An interval for a share (2 points, 18 minutes)",
    "At both ends of the interval the inequality is an equality. Square it: what kind of "
    "equation in q is that?",
    "(p − q)² = z² q (1 − q) / n is quadratic in q. Its solutions are (p + z²/(2n) ± "
    "z sqrt(p (1 − p)/n + z²/(4n²))) / (1 + z²/n), with p = successes / trials.",
    figure=_draw_wilson,
    rules={
        "At both ends of the interval |p − q| equals z sqrt(q (1 − q) / n), with z = 1.96: solve "
        "for q, a grid is not exact enough. The interval is not centred on p; its low end is the "
        "first.": [(7, 10), (5, 20), (33, 40), (11, 271)],
        "It must hold for few and for many trials, and if none or all succeed. Do not round.": [
            *((1, 2), (2, 3), (0, 12), (20, 20), (0, 1), (1, 1), (0, 500)),
            *((997, 1000), (1, 50_000), (31_000, 50_000)),
        ],
    },
    mistakes={
        "That is the normal approximation, p ± z sqrt(p (1 − p) / n). The root must hold the "
        "unknown share, not the observed one; solve for it.": tuple(
            edit("+ Z**2 / (2 * n)", "", "+ Z**2 / (4 * n**2)", "", "/ (1 + Z**2 / n)", cut)
            for cut in ("", ".clip(0, 1)")
        ),
        "The denominator 1 + z²/n is missing.": edit("/ (1 + Z**2 / n)", ""),
    },
    read=pair,
    tolerance=1e-3,
    smallest=1e-7,
    errors={
        "math domain": "Under the root the number is below 0: with p = successes / trials, from 0 "
        "to 1, it cannot be.",
    },
)
def wilson(successes, trials):
    """`wilson(successes, trials)`: low and high end of the 95 % score interval."""
    p, n = successes / trials, trials
    middle = p + Z**2 / (2 * n)
    half = Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    return np.array([middle - half, middle + half]) / (1 + Z**2 / n)


def _draw_needed(ax, solved):
    half = np.geomspace(0.002, 0.05, 60)
    for deviation in (0.05, 0.1, 0.3):
        ax.loglog(half * 100, [solved(deviation, h) for h in half], label=f"σ = {deviation}")
    needed, exact = solved(0.3, 0.02), f"{(1.96 * 0.3 / 0.02) ** 2:.1f}"
    said = f"σ = 0.3, ± 2 points:\n(1.96 · 0.3 / 0.02)² = {exact},\nso {needed} episodes"
    ax.annotate(said, (2, needed), (0.22, 12), arrowprops={"arrowstyle": "->"})
    ax.set_xticks((0.2, 0.5, 1, 2, 5), ("0.2", "0.5", "1", "2", "5"))
    ax.minorticks_off()
    ax.set(xlabel="half width of the interval, points (0.01)", ylabel="episodes needed")


@solution(
    "8.2 · How many episodes (1 point, 5 minutes)",
    "The standard error of a mean of n episodes is the standard deviation over the root of n. "
    "How many standard errors make up the half width?",
    "Solve 1.96 standard_deviation / sqrt(n) = half_width for n, and round up.",
    figure=_draw_needed,
    rules={
        "1.96 standard errors, standard_deviation / sqrt(n), make the half width: solve for n. If "
        "that is a whole number, it is enough: add nothing.": [(0.5, 0.49), (1.0, 0.98), (2, 1.96)],
        "The number is (1.96 · standard_deviation / half_width)². An episode cannot be flown in "
        "part: round that up to the next whole number, an int (math.ceil).": [
            *((0.5, 0.3), (0.2, 0.07), (0.4, 0.101), (3, 1), (0.1, 0.01), (0.3, 0.05)),
        ],
        "One episode is the least, and many are no problem.": [(0.01, 0.5), (40.0, 0.03)],
    },
    mistakes={
        "The square is missing. The half width shrinks with the *root* of the number of "
        "episodes: for half of it you need four times as many.": edit(" ** 2", ""),
        "half_width is one side of the interval already, neither all of it nor half of a side.": (
            *(edit("1.96", "0.98"), edit("1.96", "3.92")),
        ),
    },
    read=whole,
    tolerance=1e-12,
)
def episodes_needed(standard_deviation, half_width):
    """`episodes_needed(standard_deviation, half_width)`: an int."""
    return math.ceil((1.96 * standard_deviation / half_width) ** 2)


SPREAD = "d.std(ddof=1) / np.sqrt(len(d))"
UNPAIRED = edit(SPREAD, "np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / len(d))")


def _draw_lead(ax, solved):
    common, own, other = stream(Use.EXERCISE, 0).standard_normal((3, 100))
    weights = np.linspace(0, 4, 20)
    pairs = [(own + weight * common, other + weight * common) for weight in weights]
    correlation = [np.corrcoef(a, b)[0, 1] for a, b in pairs]
    for name, lead in (("in pairs", solved), ("as if unpaired", UNPAIRED.of(solved))):
        half = [np.ptp(lead(a, b)) / 2 / a.std() for a, b in pairs]
        ax.plot(correlation, half, "o-", markersize=3, label=name)
    ax.set(xlabel="correlation of the two policies' results", ylabel="half width (each σ ≈ 1)")
    ax.set(title="100 scenarios", ylim=(0, None))


def _results(count, together, ahead=0.3, scale=1.0):
    """Random results of two policies that have this much in common; or those that are given."""
    if isinstance(count, list):
        return np.array(count), np.array(together)
    generator = stream(Use.EXERCISE, count)
    common = generator.standard_normal(count)
    a, b = generator.normal((ahead, 0), 1, (count, 2)).T
    return scale * (a + together * common), scale * (b + abs(together) * common)


@solution(
    "8.3 · Paired or not (2 points, 8 minutes)",
    "Both policies flew the same scenarios, so every scenario gives one difference. Of these "
    "you have n, and you know how to give a mean with an interval.",
    "With d = a − b: d.mean() ± 1.96 * d.std(ddof=1) / sqrt(n). The variances of a and of b do "
    "not appear.",
    figure=_draw_lead,
    rules={
        "With d = a − b of each pair: the mean of d, and 1.96 standard errors, "
        "d.std(ddof=1) / sqrt(n), to either side, in the order (mean, low, high).": [
            *(([3.0, 5.0, 10.0], [1.0, 4.0, 2.0]), ([1.0, 4.0, 2.0], [3.0, 5.0, 10.0])),
            *(([9, 5], [1, 2]), (8, 1.0)),
        ],
        "It must hold whether the two results go together or not, for few and many scenarios. If "
        "all differences are equal, the interval has the width 0.": [
            *((30, 2.0), (300, 0.5), (15, -0.7), (9, 0.0), (2, 3.0, 2.0), (40, 1.0, -2.0, 50.0)),
            *((25, 1.0, 3.0, 0.001), ([4.0, 6.0, 11.0], [3.0, 5.0, 10.0])),
        ],
    },
    made=_results,
    mistakes={
        "The sign is wrong: positive means that a is ahead of b.": edit("a - b", "b - a"),
        "You take the size of each difference, abs(a − b): so even of two equally good policies "
        "one would be ahead. Keep the sign.": edit("a - b", "abs(a - b)"),
        "That is the unpaired interval: it adds both variances, as if each policy had flown "
        "scenarios of its own. Take the standard deviation of the differences a − b.": UNPAIRED,
    },
    read=row(3, "(mean, low, high), both ends of the interval, not mean and half width, are"),
    tolerance=1e-3,
    smallest=1e-6,
)
def lead(a, b):
    """`lead(a, b)`: (mean, low, high) of a − b, in pairs."""
    d = a - b
    half = 1.96 * d.std(ddof=1) / np.sqrt(len(d))
    return np.array([d.mean(), d.mean() - half, d.mean() + half])


# In the missions of this seed, to skip a device with less than 2 to 4 units left gains as much as
# in 20,000 others, about 0.3. With some seeds it gains 0.5, by luck.
EPISODES, SEED, SECONDS, AHEAD = 300, 885, 20, 0.4
RETURN = "return"


@functools.cache
def _planner() -> Greedy:
    return Greedy(environment_of("manhattan"))


def _simulated(greedy: Greedy, state: State) -> np.ndarray:
    """For each episode the action that has the highest return with greedy after it, at fading 0."""
    count = len(state)
    actions, episodes = np.indices((len(ACTIONS), count)).reshape(2, -1)
    fading = np.zeros((len(actions), 4, 5), np.float32)
    after, outcome = greedy.environment.transition(state[episodes], actions, fading)
    total, flying = Rewards()(outcome), np.arange(len(actions))
    while not after.ended.all():
        flying, after = flying[~after.ended], after[~after.ended]
        action, mean = greedy.act(after), fading[: len(after)]
        after, outcome = greedy.environment.transition(after, action, mean)
        total[flying] += Rewards()(outcome)
    return total.reshape(-1, count).argmax(axis=0)


def _flown(act: Callable[[State], np.ndarray]) -> dict[str, np.ndarray]:
    environment, policy = _planner().environment, FunctionPolicy(act)
    return evaluate(environment, policy, find_scenario("manhattan"), EPISODES, SEED).records()


def _draw_policy(ax):
    greedy = _planner()

    def leaving(least):
        def rule(state):
            worth = np.where(state.data_left < least, np.float32(0), state.data_left)
            return greedy.act(replace(state, data_left=worth))

        return rule

    rules = {f"skip devices with less than {least}": leaving(least) for least in (1, 3, 6)}
    rules["simulate each action, then\ngreedy; take the best"] = lambda s: _simulated(greedy, s)
    theirs = _flown(greedy.act)[RETURN]
    for y, rule in enumerate(rules.values()):
        own = _flown(rule)[RETURN]
        mean, low, high = lead.solved(own, theirs)
        ax.errorbar(mean, y, xerr=[[mean - low], [high - mean]], fmt="o", capsize=4)
        ax.text(1.55, y, f"{own.mean():.2f}", va="center", ha="right")
    ax.axvline(0, color="grey")
    ax.axvline(AHEAD, color="grey", linestyle="--")
    ax.set(yticks=range(len(rules)), yticklabels=list(rules), xlim=(-1.4, 1.6))
    ax.invert_yaxis()
    ax.set_xlabel("lead over greedy, 95 % interval (dashed: goal)", fontsize=9)
    ax.set_title(f"{EPISODES} missions; right: return (greedy {theirs.mean():.2f})", fontsize=10)


NOT_ALLOWED = "{} is not allowed here: write the rule yourself. Greedy may be a part of it."
CHOICE = {  # what is said of the actions that are chosen in a step, and when
    f"The actions are of type {{kind}}; give whole numbers, indices into {ACTIONS}.": (
        lambda of: of.kind.kind not in "iu"
    ),
    f"There is no action {{unknown[0]:g}}: they are 0 to {len(ACTIONS) - 1}, "
    f"{', '.join(ACTIONS)}.": lambda of: len(of.unknown),
    f"Your policy is too slow: {SECONDS} seconds of processor time are over and not all of the "
    f"{EPISODES} missions have ended. Work on the whole batch at once, and compute tables only "
    "once.": lambda of: of.seconds > SECONDS,
}
STANDING = {  # what is said of all flights, and when
    "These are the same flights as greedy's, in every mission.": lambda of: of.same,
    f"It crashed in {{crashes}} of {EPISODES} missions, 150 points each: turn back while time_left "
    "still suffices for landing_distance and the landing.": (
        lambda of: of.crashes > of.greedy_crashes
    ),
    "The safety controller refused {refused:.1f} actions a mission, a move into a no-fly cell or a "
    "landing outside the zone: look at environment.forbidden[0].": lambda of: of.refused > 1,
    f"It is ahead, but by less than the {AHEAD} that are asked for.": lambda of: of.low > 0,
    "It is behind greedy: `ways(policy)` draws where it loses most.": lambda of: of.high < 0,
    "It is ahead of greedy, but the interval holds 0: that may be luck.": lambda of: of.ahead > 0,
    "It is behind greedy, but the interval holds 0: that may be luck.": lambda of: True,
}


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
        (Genie, "plans"): NOT_ALLOWED.format("Genie"),
        (Agent, "q_values"): NOT_ALLOWED.format("Agent"),
    },
)
def policy(answer) -> None:
    """`policy(environment, state)`: actions for a batch, with a higher return than greedy."""
    environment, began = _planner().environment, time.process_time()
    ask = guarded(answer.__wrapped__, name_of(answer))

    def asked(state: State) -> np.ndarray:
        given, count = ask(environment, state), len(state)
        read = row(count, f"`state` is a batch of {count} episodes: one action for each is")
        try:
            actions = read(given)
        except Unreadable as problem:
            raise CheckFailed(f"Your policy gives {show(given)}: {problem}") from None
        kind = np.asarray(given.detach().cpu() if hasattr(given, "detach") else given).dtype
        unknown = actions[(actions < 0) | (actions >= len(ACTIONS))]
        expect_none(CHOICE, kind=kind, unknown=unknown, seconds=time.process_time() - began)
        return actions.astype(int)

    own, greedy = _flown(asked), _flown(_planner().act)
    ahead, low, high = lead.solved(own[RETURN], greedy[RETURN])
    standing = (
        f"Your return is {own[RETURN].mean():.2f}, greedy's {greedy[RETURN].mean():.2f}: a lead of "
        f"{ahead:+.2f} ({low:+.2f} to {high:+.2f})."
    )
    why = first_true(
        STANDING,
        same=np.array_equal(own[RETURN], greedy[RETURN]),
        crashes=EPISODES - int(own["landed"].sum()),
        greedy_crashes=EPISODES - greedy["landed"].sum(),
        refused=own["safety_interventions"].mean(),
        ahead=ahead,
        low=low,
        high=high,
    )
    expect(ahead >= AHEAD and low > 0, f"{why} {standing}")
    print(standing)
