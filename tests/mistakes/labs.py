"""Wrong answers to the exercises of notebook 10, and what the message must say of each."""

import numpy as np

from uavdh_lite.link import rate_map
from uavdh_lite.mission import Mission, environment_of, pilots
from uavdh_lite.scenario import find_scenario


def leads(count):
    """Greedy's lead over the agent in the first missions, points; whatever agent is shipped."""
    environment = environment_of("manhattan")
    policies = pilots(environment)
    for seed in range(count):
        mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
        share = {}
        for name in ("greedy", "agent manhattan"):
            end = mission.fly(environment, policies[name](seed)).end
            share[name] = float(end.collection_ratio[0]) * bool(end.landed[0])
        yield seed, 100 * (share["greedy"] - share["agent manhattan"])


SMALL_LEAD = next(seed for seed, lead in leads(100) if 0 <= lead < 25)
BEHIND = next((seed for seed, lead in leads(60) if lead < 0), None)


def choose(environment, *, cells=None, mask=None, best=np.max, last=min):
    """The cell that a choice of device cells, UAV cells and measures leads to."""
    city = environment.city
    cells = city.device_cells if cells is None else cells
    mask = city.landing_distance >= 0 if mask is None else mask
    value = {}
    for number in cells:
        device = int(number) // city.size, int(number) % city.size
        rates = rate_map(city, environment.channel, environment.line_of_sight, device)
        value[device] = float(best(rates[mask]))
    return last(value, key=value.get)


MISTAKES = {
    "failure_seed": [
        (SMALL_LEAD, "25 are asked for"),
        (3.0, "whole number"),
        ([1, 2, 3], "one seed"),
        (10_000, "out of range"),
        (-1, "out of range"),
        *([(BEHIND, "the agent is ahead")] if BEHIND is not None else []),
    ],
    "worst_device_cell": [
        (lambda e: choose(e, cells=range(e.city.size**2)), "on a building"),
        (lambda e: choose(e, best=np.mean), r"lowest \*mean\*"),
        (
            lambda e: choose(e, mask=np.ones((e.city.size,) * 2, bool)),
            "also where it cannot get to",
        ),
        (lambda e: choose(e, mask=~e.city.no_fly), "walled in"),
        (lambda e: choose(e, last=max), r"\*best\* places for a device"),
        (lambda e: choose(e)[::-1], "wrong way round"),
        (lambda e: choose(e)[0] * e.city.size + choose(e)[1], r"\(row, column\)"),
        (lambda e: (11, 2), "heard with|no device can stand|no cell"),
    ],
}
