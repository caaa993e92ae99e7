"""Wrong answers to the exercises of notebook 10, and what the message must say of each."""

import numpy as np

from uavdh_lite.channel import rate_map
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario


def leads(seeds):
    """Greedy's lead over the agent in these missions, points; whatever agent is shipped."""
    environment = environment_of("manhattan")
    for seed in seeds:
        mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
        share = {}
        for name in ("greedy", "manhattan_ddqn"):
            end = mission.fly(environment, find_policy(name, environment)).end
            share[name] = float(end.collected[0]) * bool(end.landed[0])
        yield seed, 100 * (share["greedy"] - share["manhattan_ddqn"])


SMALL_LEAD = next(seed for seed, lead in leads(range(100, 200)) if 0 <= lead < 40)
BEHIND = next((seed for seed, lead in leads(range(100, 160)) if lead < 0), None)


def place_in_list(environment):
    """The index of the worst device cell taken for its number."""
    row, col = choose(environment)
    index = list(environment.city.device_cells).index(row * environment.city.size + col)
    return divmod(index, environment.city.size)


def in_the_notebooks_city(_):
    return choose(environment_of("manhattan"))


def size_of_manhattan(environment):
    row, col = choose(environment)
    return divmod(row * environment.city.size + col, environment_of("manhattan").city.size)


def choose(environment, *, cells=None, mask=None, best=np.max, last=min, turn=1):
    """The cell that a choice of device cells, UAV cells and measures leads to."""
    city = environment.city
    cells = city.device_cells if cells is None else cells
    mask = city.landing_distance >= 0 if mask is None else mask
    value = {}
    for number in cells:
        device = int(number) // city.size, int(number) % city.size
        rates = rate_map(city, environment.channel, environment.sight[0], device[::turn])
        value[device] = float(best(rates[mask]))
    return last(value, key=value.get)


MISTAKES = {
    "failure_seed": [
        (SMALL_LEAD, "40 are asked for"),
        (3.0, "whole number"),
        ([1, 2, 3], "one seed"),
        (10_000, "out of range"),
        (-1, "out of range"),
        (31, "from 100 to 9,999"),
        *([(BEHIND, "the agent is ahead")] if BEHIND is not None else []),
    ],
    "worst_device_cell": [
        (lambda e: choose(e, cells=range(e.city.size**2)), "in city.device_cells"),
        (lambda e: choose(e, best=np.mean), r"lowest \*mean\*"),
        (
            lambda e: choose(e, mask=np.ones((e.city.size,) * 2, bool)),
            "nor get to one that is walled in",
        ),
        (lambda e: choose(e, mask=~e.city.no_fly), "nor get to one that is walled in"),
        (lambda e: choose(e, last=max), "the lowest of these rates"),
        (lambda e: choose(e, best=np.min), "the max over all UAV cells"),
        (lambda e: choose(e, best=np.min, last=max), "the max over all UAV cells"),
        (lambda e: choose(e, turn=-1), "hand to rate_map"),
        (lambda e: choose(e, turn=-1)[::-1], "hand to rate_map"),
        (lambda e: choose(e, mask=e.city.landing_distance > 0), "the landing zone"),
        (in_the_notebooks_city, "not the notebook's own"),
        (size_of_manhattan, "that your function is given"),
        (place_in_list, "an index into city.device_cells"),
        (lambda e: choose(e)[::-1], "as \\(row, column\\)"),
        (lambda e: choose(e)[0] * e.city.size + choose(e)[1], r"\(row, column\)"),
        (lambda e: (11, 2), "not the notebook's own"),
    ],
}
