"""Exercises of notebook 10, evaluation."""

import numpy as np

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy

Z = 1.96  # 95 % of a standard normal lie within ± this


def draw_wilson(ax, wilson):
    successes = np.arange(21)
    share = successes / 20
    low, high = np.transpose([wilson(k, 20) for k in successes])
    ax.errorbar(share, share, np.abs([share - low, high - share]), fmt="o", markersize=3, capsize=3)
    ax.set(xlabel="share observed in 20 trials", ylabel="share and its 95 % interval")


def normal(successes, trials):
    p = successes / trials
    half = Z * np.sqrt(p * (1 - p) / trials)
    return p - half, p + half


def score_interval(successes, trials):
    """Both ends before they are divided by 1 + z²/n."""
    p, n = successes / trials, trials
    half = Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    return p + Z**2 / (2 * n) - half, p + Z**2 / (2 * n) + half


@exercise(
    "10.1 · An interval for a share (2 points, 12 minutes)",
    figure=draw_wilson,
    rules={
        "At both ends of the interval |p − q| equals z sqrt(q (1 − q) / n), with z = 1.96: solve "
        "for q exactly. The interval is not centred on p; its low end is the first.": [
            (7, 10), (5, 20), (33, 40), (11, 271),
        ],
        "It must hold for few and for many trials, and if none or all succeed. Do not round.": [
            (1, 2), (2, 3), (0, 12), (20, 20), (0, 1), (1, 1), (0, 500),
            (997, 1000), (1, 50_000), (31_000, 50_000),
        ],
    },
    mistakes={
        "That is the normal approximation, p ± z sqrt(p (1 − p) / n). The root must hold the "
        "unknown share, not the observed one; solve for it.": normal,
        "That is the normal approximation, cut off at 0 and 1. The root must hold the unknown "
        "share, not the observed one.": lambda k, n: tuple(np.clip(normal(k, n), 0, 1)),
        "The denominator 1 + z²/n is missing.": score_interval,
    },
    tolerance=1e-3,
    smallest=1e-7,
)
def wilson(successes, trials):
    """`wilson(successes, trials)`: low and high end of the 95 % score interval."""
    low, high = score_interval(successes, trials)
    return low / (1 + Z**2 / trials), high / (1 + Z**2 / trials)


MISSIONS, SEED, GREEDY, BEHIND, CHANGED, SIZE = 100, 92, 0.90, 0.30, 16, 16


def scores(city: City) -> list[float]:
    """Collected and landed of greedy and of the agent, on the fixed missions over this city."""
    environment, agent = Environment(city), load_agent("manhattan_ddqn")
    flown = (
        evaluate(environment, policy, agent.scenario, MISSIONS, SEED)
        for policy in (Greedy(environment), agent.over(city))
    )
    return [float(flights.records()["collected_and_landed"].mean()) for flights in flown]


def wrong_city(text: str) -> str:
    try:
        city = City.from_text("mine", text)
    except InputError as error:
        return f"That is no valid city: {error}."
    if city.size != SIZE:
        return f"Your city has {city.size}×{city.size} cells; it must have {SIZE}×{SIZE}."
    changed = int((city.kinds != load_agent("manhattan_ddqn").city.kinds).sum())
    if changed > CHANGED:
        return f"It differs from `home` in {changed} of its {SIZE**2} cells; at most {CHANGED} may."
    cut_off = np.argwhere(~city.no_fly & (city.landing_distance < 0)).tolist()
    if cut_off:
        said = f"There is no way to the landing zone from {cut_off[0]}"
        return f"{said}; number of such cells: {len(cut_off)}."
    greedy, agent = scores(city)
    said = f"Collected and landed: greedy {greedy:.1%}, the agent {agent:.1%}"
    print(said)
    if greedy < GREEDY:
        return f"{said}. Greedy must reach {GREEDY:.0%}, so that the missions are possible."
    if greedy - agent < BEHIND:
        return f"{said}. The agent is too good: what was the same in all missions of its training?"
    return ""


@exercise("10.2 · A city that defeats the agent (3 points, 12 minutes)", takes=str, also=wrong_city)
def defeat():
    """The text of a 16×16 city in which greedy does well and the shipped agent does not."""
