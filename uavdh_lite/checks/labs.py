"""Exercises of notebook 10, the labs."""

from dataclasses import fields

import numpy as np

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.checks.evaluation import briefly
from uavdh_lite.checks.exercise import CheckFailed, exercise, expect, show
from uavdh_lite.city import City
from uavdh_lite.environment import Environment, State
from uavdh_lite.evaluation import fly
from uavdh_lite.link import rate_map
from uavdh_lite.mission import Mission, environment_of, pilots
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario

LARGEST, POINTS = 10_000, 25


def results(seed: int) -> dict[str, float]:
    """CRAL of greedy and agent in the mission of this seed, with the same fading, points."""
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
    makers = pilots(environment)
    return {
        name: 100 * float(mission.fly(environment, makers[own](seed)).records()[CRAL][0])
        for name, own in (("greedy", "greedy"), ("agent", "agent manhattan"))
    }


CRAL = "collection_ratio_and_landed"


def _draw_leads(ax):
    environment, scenario = environment_of("manhattan"), find_scenario("manhattan")
    drawn = [Mission.draw(scenario, environment.city, seed).state for seed in range(400)]
    start = State(*(np.concatenate([getattr(s, f.name) for s in drawn]) for f in fields(State)))
    flown = [
        fly(environment, policy, start, np.random.default_rng(0)).records()[CRAL]
        for policy in (Greedy(environment), load_agent("manhattan"))
    ]
    lead = 100 * (flown[0] - flown[1])
    ax.plot(np.sort(lead)[::-1], ".")
    ax.axhline(POINTS, color="#D55E00", linestyle="--", label=f"{POINTS} points")
    ax.set(xlabel="missions of seeds 0 to 399, sorted", ylabel="greedy's lead, points of CRAL")
    ax.set(title="all flown with one draw of the fading")
    ax.legend()


@exercise(
    "10.1",
    "Find a failure",
    points=2,
    minutes=15,
    hints=(
        "Such missions are rare. Let the computer fly one seed after the other.",
        "for seed in range(10_000): draw the mission, fly it with pilots(environment)[name](seed) "
        "for both names, take 100 * collection_ratio * landed at the end, and stop at the first "
        "lead of 25.",
    ),
    figure=_draw_leads,
)
def failure_seed(answer) -> None:
    """The seed of a mission in which greedy is at least 25 points ahead of the agent."""
    expect(
        isinstance(answer, int | np.integer) and not isinstance(answer, bool),
        f"Hand over one seed, a whole number (int), not {repr(answer)[:60]}.",
    )
    expect(
        0 <= answer < LARGEST,
        f"The seed {answer} is out of range: it must be at least 0 and below {LARGEST:,}.",
    )
    points = results(int(answer))
    lead = points["greedy"] - points["agent"]
    standing = f"greedy brings home {points['greedy']:.1f} %, the agent {points['agent']:.1f} %"
    if lead < 0:
        raise CheckFailed(
            f"In mission {answer} the agent is ahead: {standing}. Check the sign of your lead: "
            "greedy minus agent."
        )
    expect(
        lead >= POINTS,
        f"In mission {answer} {standing}: a lead of {lead:.1f} points, {POINTS} are asked for. "
        "(A share of 0.25 is 25 points; and the fading must come from the mission's own seed, as "
        "mission.fly does it.)",
    )
    print(f"In mission {answer} {standing}.")


POCKET = """
L . . B . . B .
L . . B . . B .
. . . B B B B .
. b . . . . . .
. b B N N N . .
. . N . . N . .
. . N . b N . B
. . N N N N . .
"""


def _rates(environment: Environment, cells, over: np.ndarray, of=np.max) -> dict[tuple, float]:
    """For each device cell, `of` its mean rates at the UAV cells in `over`."""
    size, own = environment.city.size, {}
    for cell in cells:
        device = divmod(int(cell), size)
        rates = rate_map(environment.city, environment.channel, environment.line_of_sight, device)
        own[device] = float(of(rates[over]))
    return own


def _lowest(rates: dict[tuple, float], highest: bool = False) -> set[tuple]:
    """All cells with the lowest rate; ties count."""
    end = max(rates.values()) if highest else min(rates.values())
    return {cell for cell, rate in rates.items() if abs(rate - end) <= 1e-5}


def _solved_rates(environment: Environment) -> dict[tuple, float]:
    city = environment.city
    return _rates(environment, city.device_cells, city.landing_distance >= 0)


def _mistakes(environment: Environment) -> dict[str, set[tuple]]:
    """The answers of typical mistakes, by what to say about them."""
    city = environment.city
    everywhere, reach = np.ones((city.size,) * 2, bool), city.landing_distance >= 0
    devices = city.device_cells
    right = _solved_rates(environment)
    worst = _lowest(right)
    return {
        "A device cannot stand there, on a building: only city.device_cells count.": _lowest(
            _rates(environment, range(city.size**2), reach)
        ),
        "That cell has the lowest *mean* of the rates over all UAV cells. The UAV chooses where "
        "it hovers: take the best rate for each device cell, then the lowest of these.": _lowest(
            _rates(environment, devices, reach, np.mean)
        ),
        "Your UAV hovers where it cannot get to, in cells that are walled in. Only the cells with "
        "city.landing_distance >= 0 count; that a cell is no no-fly cell is not enough.": _lowest(
            _rates(environment, devices, ~city.no_fly)
        ),
        "Row and column are the wrong way round: the answer is (row, column).": {
            (col, row) for row, col in worst
        },
        "That is one of the *best* places for a device: either you take the highest rate where "
        "the lowest is asked for, or your UAV hovers right above every device, also where it "
        "cannot get to. Only the cells with city.landing_distance >= 0 count.": (
            _lowest(right, True) | _lowest(_rates(environment, devices, everywhere))
        ),
        "That cell has the lowest rate of all at the *worst* UAV cell; the UAV hovers at the best "
        "one.": _lowest(_rates(environment, devices, reach, np.min)),
    }


def _draw_worst(ax):
    environment = environment_of("manhattan")
    best = np.full((environment.city.size,) * 2, np.nan)
    for cell, rate in _solved_rates(environment).items():
        best[cell] = rate
    image = ax.imshow(best, cmap="viridis")
    ax.figure.colorbar(image, ax=ax, label="best mean rate, data units a slot")
    ax.set(xlabel="device's column", ylabel="device's row", title="manhattan (white: no device)")


@exercise(
    "10.2",
    "The worst place for a device",
    points=3,
    minutes=15,
    hints=(
        "Two steps: for one device cell, which rate does the UAV get at the best place that it can "
        "fly to? Then compare the device cells.",
        "For each number in city.device_cells: device = divmod(number, city.size), then the "
        "maximum of rate_map(city, environment.channel, environment.line_of_sight, device) over "
        "the cells with city.landing_distance >= 0. Keep the device with the lowest maximum.",
    ),
    figure=_draw_worst,
)
def worst_device_cell(answer) -> None:
    """`worst_device_cell(environment)`: (row, column) with the lowest best mean rate."""
    ask = briefly(answer)
    cities = [City.load("manhattan"), City.from_text("pocket", POCKET), City.load("open_field")]
    environments = [Environment(city) for city in cities]
    given = []
    for environment in environments:
        value = ask(environment)
        size = environment.city.size
        try:
            cell = tuple(int(part) for part in value)
        except (TypeError, ValueError):
            cell = ()
        expect(
            len(cell) == 2,
            f"You give {show(value)}. Hand over (row, column); divmod(number, {size}) makes "
            "both of a cell's number.",
        )
        expect(
            min(cell) >= 0 and max(cell) < size,
            f"There is no cell {cell} in a city of {size} × {size}.",
        )
        given.append(cell)
    rates = [_solved_rates(environment) for environment in environments]
    wrong = [k for k, cell in enumerate(given) if cell not in _lowest(rates[k])]
    if not wrong:
        return
    known = {k: _mistakes(environments[k]) for k in wrong}
    for message in known[wrong[0]]:
        if all(given[k] in known[k][message] for k in wrong):
            raise CheckFailed(message)
    k = wrong[0]
    name, cell = cities[k].name, given[k]
    if cell not in rates[k]:
        raise CheckFailed(f"In {name} no device can stand at {cell}: take city.device_cells.")
    raise CheckFailed(
        f"A device at {cell} in {name} is heard with {rates[k][cell]:.3f} data units a slot from "
        f"the best cell that the UAV can reach; there is a place with {min(rates[k].values()):.3f}."
    )
