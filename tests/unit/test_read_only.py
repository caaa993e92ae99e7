"""Whoever writes to what others share gets numpy's error at once."""

import numpy as np

from uavdh_lite.city import COLOURS, KIND_LAYERS, City
from uavdh_lite.environment import MOVES, Environment, State
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream


def test_tables_of_city_environment_and_planner():
    environment = Environment((City.load("village"), City.from_text("tiny", "L.\n.b")))
    shared = {"COLOURS": COLOURS, "KIND_LAYERS": KIND_LAYERS, "MOVES": MOVES}
    for thing in (*environment.cities, environment, Greedy(environment)):
        for name in dir(thing):  # tables are made when they are asked for, and kept in `vars`
            getattr(thing, name)
        shared |= {f"{type(thing).__name__}.{name}": v for name, v in vars(thing).items()}
    assert {"City.landing_distance", "Environment.next_cell", "Environment.sight"} <= set(shared)
    for name, value in shared.items():
        for array in value if isinstance(value, tuple) else (value,):
            assert not isinstance(array, np.ndarray) or not array.flags.writeable, name


def test_states():
    environment, scenario = Environment(City.load("village")), find_scenario("village")
    start = scenario.sample(environment, 3, stream(Use.TEST))
    after, _ = environment.step(start, np.zeros(3, int), stream(Use.FADING))
    taken = [start[:2], start.with_rows([0], start[[1]]), State.concatenate([start, after])]
    for state in (start, after, *taken):
        assert not any(array.flags.writeable for array in vars(state).values())
