"""Exercises of notebook 10, the labs."""

import numpy as np

from uavdh_lite.channel import rate_map
from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import CheckFailed, exercise, expect, guarded
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.trial import name_of
from uavdh_lite.course.checks.values import Unreadable, pair, show
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import VERMILION
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario

SEEDS, POINTS = range(100, 10_000), 40  # the tutorial shows seeds below 100
MISSIONS = 500  # in the hint's figure


SCORE = "collection_ratio_and_landed"


def results(seed: int) -> tuple[float, ...]:
    """The scores of greedy and agent in the mission of this seed, with the same fading."""
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
    flights = (
        mission.fly(environment, find_policy(name, environment))
        for name in ("greedy", "manhattan_ddqn")
    )
    return tuple(100 * float(flight.records()[SCORE][0]) for flight in flights)


def _draw_leads(ax):
    environment, scenario = environment_of("manhattan"), find_scenario("manhattan")
    greedy, agent = (
        evaluate(environment, find_policy(name, environment), scenario, MISSIONS, 0).records()
        for name in ("greedy", "manhattan_ddqn")
    )
    lead = 100 * (greedy[SCORE] - agent[SCORE])
    ax.plot(np.sort(lead)[::-1], ".")
    ax.axhline(POINTS, color=VERMILION, linestyle="--", label=f"{POINTS} points")
    ax.set(xlabel=f"{MISSIONS} missions, sorted", ylabel="greedy's lead over the agent, points")
    ax.set_title(f"{(lead >= POINTS).sum()} of {MISSIONS} random missions reach {POINTS} points")


@exercise(
    "10.1 · Find a failure (2 points, 10 minutes)",
    "Such missions are rare. Let the computer fly one seed after the other.",
    "for seed in range(100, 10_000): draw the mission, fly it with "
    "find_policy(name, environment) for both names, "
    "take 100 * collection_ratio[0] * landed[0] at the end, and stop at the first lead "
    f"of {POINTS}.",
    figure=_draw_leads,
    function=False,
    seconds=300,
)
def failure_seed(answer) -> None:
    """The seed of a mission in which greedy is at least 40 points ahead of the agent."""
    expect(
        isinstance(answer, int | np.integer) and not isinstance(answer, bool),
        f"Hand over one seed, a whole number (int), not {show(answer)}.",
    )
    expect(
        answer in SEEDS,
        f"The seed {show(answer)} is out of range: it must be from {SEEDS[0]} to {SEEDS[-1]:,}.",
    )
    greedy, agent = results(int(answer))
    lead, standing = greedy - agent, f"greedy brings home {greedy:.1f} %, the agent {agent:.1f} %"
    expect(
        lead >= 0,
        f"In mission {answer} the agent is ahead: {standing}. The lead is greedy minus agent.",
    )
    expect(
        lead >= POINTS,
        f"In mission {answer} {standing}: a lead of {lead:.4g} points, {POINTS} are asked for. "
        f"(A share of {POINTS / 100} is {POINTS} points; and the fading must come from the "
        "mission's own seed, as mission.fly does it.)",
    )
    print(f"In mission {answer} {standing}.")


POCKET = """
B N N L N . B N
L L L . N . b L
B N b N b B L .
. b N N N . . .
L B . . B N b L
N . . N . N N .
b B N . b b B .
L L N N . N N N
"""  # no two of the mistakes below give the same cell here


def _best_rates(environment):
    """The best mean rate of each cell for a device."""
    city, found = environment.city, {}
    for number in city.device_cells:
        cell = divmod(int(number), city.size)
        rates = rate_map(city, environment.channel, environment.line_of_sight, cell)
        found[cell] = float(rates[city.landing_distance >= 0].max())
    return found


def _lowest(rates: dict[tuple, float], sign: int = 1) -> set[tuple]:
    """All cells with the lowest rate, or the highest with sign −1; ties count."""
    end = min(sign * rate for rate in rates.values())
    return {cell for cell, rate in rates.items() if sign * rate - end <= 1e-5}


def _mistakes(environment: Environment) -> dict[str, set[tuple]]:
    """The answers of typical mistakes, by what to say about them."""
    city, right = environment.city, _best_rates(environment)
    worst, devices = _lowest(right), city.device_cells

    def edited(*texts):
        return _lowest(edit(*texts).of(_best_rates)(environment))

    turned = edited("line_of_sight, cell", "line_of_sight, cell[::-1]")
    return {
        "A device cannot stand there, on a building: only city.device_cells count.": edited(
            "city.device_cells", "range(city.size**2)"
        ),
        "That cell has the lowest *mean* of the rates over all UAV cells. The UAV chooses where "
        "it hovers: take the best rate for each device cell first.": edited("max", "mean"),
        "That cell has the lowest rate of all at the *worst* UAV cell; the UAV hovers at the best "
        "one: max over the UAV's cells, then min over the devices.": edited("max", "min"),
        "Your UAV never hovers over the landing zone: there landing_distance is 0, and it counts "
        "too (>= 0, not > 0).": edited(">= 0", "> 0"),
        "Your UAV hovers where it cannot get to, in cells that are walled in. Only the cells with "
        "city.landing_distance >= 0 count; that a cell is no no-fly cell is not enough.": edited(
            "city.landing_distance >= 0", "~city.no_fly"
        ),
        "Row and column are the wrong way round: the answer is (row, column).": {
            cell[::-1] for cell in worst
        },
        "The device that you hand to rate_map is (column, row). It must be (row, column), as "
        "divmod(number, M) gives it.": turned | {cell[::-1] for cell in turned},
        "That is an index into city.device_cells, not a cell: take the number that stands there.": {
            divmod(int(np.searchsorted(devices, row * city.size + col)), city.size)
            for row, col in worst
        },
        "That cell has the highest best rate: the lowest is asked for.": _lowest(right, -1),
        "A device there is heard as well as anywhere, from right above, but the UAV cannot get "
        "there. Only the cells with city.landing_distance >= 0 count.": {
            divmod(int(devices[k]), city.size)
            for k in (0, -1)  # all are equal: the first or last
        },
    }


def _draw_worst(ax):
    environment = environment_of("manhattan")
    best = np.full((environment.city.size,) * 2, np.nan)
    for cell, rate in _best_rates(environment).items():
        best[cell] = rate
    image = ax.imshow(best, cmap="viridis")
    ax.figure.colorbar(image, ax=ax, label="best mean rate, data units a slot")
    ax.set(xlabel="device's column", ylabel="device's row", title="manhattan (white: no device)")


@exercise(
    "10.2 · The worst place for a device (3 points, 12 minutes)",
    "Two steps: for one device cell, which rate does the UAV get at the best place that it can "
    "fly to? Then compare the device cells.",
    "For each number in city.device_cells: device = divmod(number, city.size), then the "
    "maximum of rate_map(city, environment.channel, environment.line_of_sight, device) over "
    "the cells with city.landing_distance >= 0. Keep the device with the lowest maximum.",
    figure=_draw_worst,
    seconds=60,
)
def worst_device_cell(answer) -> None:
    """`worst_device_cell(environment)`: (row, column) with the lowest best mean rate."""
    ask = guarded(answer.__wrapped__, name_of(answer))
    cities = [City.load("manhattan"), City.from_text("pocket", POCKET), City.load("open_field")]
    environments = [Environment(city) for city in cities]
    given = [_cell(ask(environment), environment.city.size) for environment in environments]
    rates = [_best_rates(environment) for environment in environments]
    wrong = [k for k, cell in enumerate(given) if cell not in _lowest(rates[k])]
    if not wrong:
        return
    expect(
        len(set(given)) > 1,
        f"You give {given[0]} in each of {len(given)} cities. Use the environment that your "
        "function is given, not the notebook's own.",
    )
    for cell, city in zip(given, cities, strict=True):
        expect(
            min(cell) >= 0 and max(cell) < city.size,
            f"There is no cell {cell} in a city of {city.size} × {city.size}. Are M and all else "
            "taken from the environment that your function is given?",
        )
    known = {k: _mistakes(environments[k]) for k in wrong}
    for message in known[wrong[0]]:
        expect(not all(given[k] in known[k][message] for k in wrong), message)
    k = wrong[0]
    cell, own = given[k], cities[k].name == "pocket"
    where, drawing = ("a city of the check's own, below", POCKET) if own else (cities[k].name, "")
    expect(
        cell in rates[k],
        f"In {where}, no device can stand at {cell}: take city.device_cells.{drawing}",
    )
    raise CheckFailed(
        f"In {where}, a device at {cell} is heard with {rates[k][cell]:.4g} data units a slot from "
        "the best cell that the UAV can reach; there is a place with "
        f"{min(rates[k].values()):.4g}.{drawing}"
    )


def _cell(value, size: int) -> tuple[int, ...]:
    """The answer as (row, column)."""
    try:
        cell = pair(value).tolist()
    except Unreadable:
        cell = []
    expect(
        cell and all(part.is_integer() for part in cell),
        f"You give {show(value)}. Hand over (row, column), as divmod(number, {size}) makes them.",
    )
    return tuple(map(int, cell))
