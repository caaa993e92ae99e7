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


def low_end(landed, missions):
    """Wilson's."""
    p, n = landed / missions, missions
    half = Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    return (p + Z**2 / (2 * n) - half) / (1 + Z**2 / n)


@exercise(
    "10.1 · How many missions must land? (2 points, 12 minutes)",
    rules={
        "Without a crash, all n missions land. Find the smallest n at which the low end of "
        "Wilson's interval reaches the share.": [
            (0.99, 0),
            (0.9, 0),
            (0.5, 0),
            (0.2, 0),
            (0.999, 0),
        ],
        "With crashes, n − crashes of n missions land, so n must begin above the number of "
        "crashes.": [
            (0.99, 1),
            (0.9, 3),
            (0.95, 2),
            (0.5, 5),
            (0.2, 3),
            (0.998, 2),
            (0.97, 12),
            (0.05, 1),
            (0.999, 5),
        ],
    },
)
def missions_needed(share, crashes):
    """`needed(share, crashes)`: the least missions that show that this share lands, at least."""
    n = crashes + 1
    while low_end(n - crashes, n) < share:
        n += 1
    return n


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
    if "L" not in text:
        return "That city has no landing zone: at least one character must be L."
    try:
        city = City.from_text("mine", text)
    except InputError as error:
        return f"That is not a valid city: {error}."
    if city.size != SIZE:
        return f"Your city has {city.size}×{city.size} cells; it must have {SIZE}×{SIZE}."
    changed = int((city.kinds != load_agent("manhattan_ddqn").city.kinds).sum())
    if changed > CHANGED:
        return f"{changed} of its {SIZE**2} cells differ from `home`; at most {CHANGED} may."
    cut_off = np.argwhere(~city.no_fly & (city.landing_distance < 0)).tolist()
    if cut_off:
        said = f"There is no way to the landing zone from {cut_off[0]}"
        return f"{said}; number of such cells: {len(cut_off)}."
    greedy, agent = scores(city)
    said = f"Collected and landed: greedy {greedy:.1%}, the agent {agent:.1%}"
    print(said)
    if greedy < GREEDY:
        return f"{said}. Greedy must reach {GREEDY:.0%}, to show that the missions are possible."
    if greedy - agent < BEHIND:
        return f"{said}. The agent is too good: what was the same in all missions of its training?"
    return ""


@exercise("10.2 · A city that defeats the agent (3 points, 12 minutes)", takes=str, also=wrong_city)
def defeat():
    """The text of a 16×16 city in which greedy does well and the shipped agent does not."""
