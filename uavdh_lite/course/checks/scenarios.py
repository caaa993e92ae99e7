"""Exercises of notebook 9, scenarios."""

from collections import deque

import numpy as np

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.course.checks.environment import Town
from uavdh_lite.course.checks.exercise import CheckFailed, exercise, expect, solution
from uavdh_lite.course.checks.trial import expect_none
from uavdh_lite.course.checks.values import Unreadable, array_of_numbers
from uavdh_lite.environment import Environment
from uavdh_lite.errors import CityError
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.streams import Use, stream


def _town(city: str | int):
    """A city by its signs, by its name, or a random one with this seed."""
    if isinstance(city, str):
        name = "a city" if len(city) < 99 else "a city with one winding street"
        return (Town.from_text(name, city) if "L" in city else Town.load(city),)
    kinds = stream(Use.EXERCISE, city).choice(5, (8, 8), p=(0.55, 0.15, 0.14, 0.04, 0.12))
    return (Town.from_kinds(f"random city {city}", kinds),)


STREET, LEFT, RIGHT = " ".join("." * 16), "." + " B" * 15, "B " * 15 + "."
WINDING = "\n".join(row for turn in 4 * (RIGHT, LEFT) for row in (STREET, turn))


def _distances(value) -> np.ndarray:
    array = array_of_numbers(value)
    if array.ndim == 2 and (np.isinf(array).any() or np.asarray(value).dtype.kind not in "iu"):
        raise Unreadable("make it an array of ints; where there is no way it has −1.")
    return array


def _draw_reachable(ax, solved):
    distance = City.load("manhattan").landing_distance
    image = ax.imshow(np.where(distance < 0, np.nan, distance), cmap="viridis")
    ax.figure.colorbar(image, ax=ax, label="moves to the landing zone")
    ax.set(xlabel="column", ylabel="row", title="manhattan (white: −1)")


@solution(
    "9.1 · The way home (2 points, 18 minutes)",
    "Start from the landing cells, not from each cell: all cells one move away from them have "
    "1, all new ones a move away from those have 2, and so on.",
    "Fill an array with −1, set the landing cells to 0 and put them into a queue "
    "(collections.deque). Take a cell from its front; each of the four neighbours that is on "
    "the grid, no no-fly cell and still −1 gets one more and goes to the end.",
    figure=_draw_reachable,
    refused={
        (City, "landing_distance"): "City.landing_distance is the solution: write the search "
        "yourself.",
    },
    rules={
        "A cell of the landing zone has 0, each other one more than its nearest neighbour: north, "
        "east, south, west, not diagonally. Rows and columns go from 0 to M − 1.": ["L .\n. ."],
        "The shortest way counts: take the cell that has waited longest, and go on to the cells "
        "one row or one column from it. Each goes into the queue once, when it has no distance yet "
        "itself; else the search never ends. And off the grid there is nothing: row or column −1 "
        "is Python's last one, without an IndexError: test 0 <= row < M, and the column too.": [
            "L . . ." + 3 * "\n. . . ."
        ],
        "All landing cells are starting points, and from each cell the search goes on to all four "
        "neighbours: the nearest landing cell counts.": [
            "L . . .\n. . . .\n. . . L\n. . . .",
            ". . . . .\n. L . . .\n. . . . .\n. . . L .\n. . . . .",
        ],
        "Low buildings may be flown over: what the UAV may not enter is city.no_fly.": [
            "L b .\nb . .\n. . ."
        ],
        "No-fly cells, and all from which no landing cell can be reached, have −1.": [
            "L . N\n. N .\nN . ."
        ],
        "The way goes round all walls, whatever the city.": [
            *(103, 104, 117, 120, 125),
            *("manhattan", "open_field", WINDING.replace(".", "L", 1)),
        ],
    },
    made=_town,
    read=_distances,
    errors={
        "out of bounds": "That is off the grid: ask for 0 <= row < M, 0 <= column < M first.",
    },
    why=lambda city, place: f"The first difference is at row {place[0]}, column {place[1]}.",
)
def reachable(city):
    """`reachable(city)`: moves to the nearest landing cell, (M, M), −1 where there is no way."""
    size, moves, landing = city.size, [(-1, 0), (0, 1), (1, 0), (0, -1)], city.landing
    distance = np.where(landing, 0, -1)
    queue = deque(zip(*np.nonzero(landing), strict=True))
    while queue:
        row, col = queue.popleft()
        for down, right in moves:
            r, c = row + down, col + right
            inside = 0 <= r < size and 0 <= c < size
            if inside and distance[r, c] < 0 and not city.no_fly[r, c]:
                distance[r, c] = distance[row, col] + 1
                queue.append((r, c))
    return distance


MISSIONS, SEED, GREEDY, BEHIND, CHANGED = 100, 92, 0.90, 30, 16
CRAL = "collected_and_landed"


def _fly(city: City, policy: Policy) -> dict[str, float]:
    """Mean metrics on the fixed missions over this city."""
    scenario = load_agent("manhattan_ddqn").scenario
    records = evaluate(Environment(city), policy, scenario, MISSIONS, SEED).records()
    return {name: float(values.mean()) for name, values in records.items()}


def _changed(city: City) -> int:
    """In how many cells the city differs from the agent's own."""
    return int((city.kinds != load_agent("manhattan_ddqn").city.kinds).sum())


def _draw_defeat(ax):
    agent, kinds = load_agent("manhattan_ddqn"), City.load("manhattan").kinds.copy()
    kinds[kinds == 3] = 0
    kinds[:2, -2:] = kinds[-1:, :2] = 3
    city = City.from_kinds("landing zones in the other two corners", kinds)
    flown = {
        "agent, at home": _fly(agent.city, agent),
        "greedy, new city": _fly(city, Greedy(Environment(city))),
        "agent, new city": _fly(city, agent.over(city)),
    }
    for k, (label, metrics) in enumerate(flown.items()):
        shares = [100 * metrics[name] for name in ("landed", "collected", CRAL)]
        ax.bar(np.arange(3) + 0.27 * (k - 1), shares, 0.25, label=label)
    ax.set(xticks=range(3), xticklabels=("landed", "collected", "both (CRAL)"), ylim=(0, 135))
    ax.set(ylabel="mean over 100 missions, %", yticks=range(0, 101, 20))
    ax.set_title(f"landing zones moved: {_changed(city)} cells changed")
    ax.legend(ncols=2, fontsize=8)


SIZE = 16
CITY = {  # what is said of a city, and when
    f"Your city has {{size}} rows and columns; it must have {SIZE}.": lambda of: of.size != SIZE,
    f"It differs from `home` in {{changed}} of its {SIZE**2} cells; at most {CHANGED} may.": (
        lambda of: of.changed > CHANGED
    ),
    "There is no way to the landing zone from {count} of the cells that the UAV may enter, as from "
    "{cut_off} (row, column): open one, or close them (N or B).": lambda of: of.count,
}
DEFEAT = {  # what is said of the flights over it, and when
    "The greedy planner's CRAL is {greedy:.1%} here, and "
    f"{GREEDY:.0%} are needed to show that the missions are possible. Make ways shorter, or "
    "devices easier to hear.": lambda of: of.greedy < GREEDY,
    "The agent is too good. {standing}: it is {behind:.1f} points behind, "
    f"{BEHIND} are asked for. Its landing zones are where it learned to land.": (
        lambda of: of.behind < BEHIND and of.same_zones
    ),
    "The agent is too good. {standing}: it is {behind:.1f} points behind, "
    f"{BEHIND} are asked for. What else is in your city that it never met?": (
        lambda of: of.behind < BEHIND
    ),
}


@exercise(
    "9.2 · A city that defeats the agent (4 points, 20 minutes)",
    "A planner computes its ways from the map. The agent has learned its ways in one single "
    "city. What was the same in every mission that it was trained on?",
    "Start from `home` and change only where the UAV may land: move the zones to places that "
    "it never landed in. Leave two of them, far apart, or the ways get too long for greedy.",
    figure=_draw_defeat,
    takes=(
        lambda answer: isinstance(answer, str),
        "Hand over the city as one text, a line a row, as City.from_text reads it.",
    ),
    seconds=300,
)
def defeat(answer) -> None:
    """The text of a 16×16 city in which greedy does well and the shipped agent does not."""
    expect("L" in answer, "Your city has no landing zone: put an L into at least one cell.")
    try:
        city = City.from_text("mine", answer)
    except CityError as error:
        said = str(error).removeprefix("mine: ")
        raise CheckFailed(f"That is no valid city of {SIZE}×{SIZE} cells: {said}.") from None
    changed = _changed(city) if city.size == SIZE else 0
    cut_off = np.argwhere(~city.no_fly & (city.landing_distance < 0)).tolist()
    expect_none(CITY, size=city.size, changed=changed, count=len(cut_off), cut_off=cut_off[:1])
    agent = load_agent("manhattan_ddqn")
    greedy, own = _fly(city, Greedy(Environment(city)))[CRAL], _fly(city, agent.over(city))
    behind = 100 * (greedy - own[CRAL])
    same_zones = np.array_equal(city.landing, agent.city.landing)
    standing = (
        f"In your city (cells changed: {changed}) greedy has a CRAL of {greedy:.1%}, the agent "
        f"{own[CRAL]:.1%} (it lands in {own['landed']:.0%})"
    )
    expect_none(DEFEAT, greedy=greedy, behind=behind, standing=standing, same_zones=same_zones)
    print(f"{standing}.")
