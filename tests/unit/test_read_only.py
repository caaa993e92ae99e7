"""Whoever writes to what others share gets numpy's error at once."""

from dataclasses import fields

import numpy as np
import pytest

from uavdh_lite.city import COLOURS, LAYERS, City
from uavdh_lite.environment import MOVES, Environment, State
from uavdh_lite.evaluation import fly
from uavdh_lite.missions import HandFlight, Mission
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream


@pytest.fixture(scope="module")
def environment():
    return Environment(City.load("village"))


def arrays_of(thing):
    """The arrays behind a thing's public names, its cached tables included."""
    names = [name for name in dir(type(thing)) if not name.startswith("__")]
    names += [name for name in vars(thing) if name not in names]
    for name in names:
        value = getattr(thing, name)
        several = value if isinstance(value, tuple) else (value,)
        for array in several:
            if isinstance(array, np.ndarray):
                yield name, array


def test_tables_of_city_environment_and_planner(environment):
    shared = {
        f"{type(thing).__name__}.{name}": array
        for thing in (environment.city, environment, Greedy(environment))
        for name, array in arrays_of(thing)
    }
    assert {"City.landing_distance", "Environment.next_cell", "Environment.forbidden"} <= set(
        shared
    )
    assert {"Environment.line_of_sight", "City.landing", "Environment.way_home"} <= set(shared)
    for name, array in shared.items():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
        assert not array.flags.writeable, name
    for constant in (COLOURS, LAYERS, MOVES):
        with pytest.raises(ValueError, match="read-only"):
            constant[0] = 1


def test_states(environment):
    scenario = SCENARIOS["village"]
    start = scenario.sample(environment.city, 3, stream(Use.TEST))
    mission = Mission.draw(scenario, environment.city, 0)
    after, _ = environment.step(start, np.zeros(3, int), stream(Use.FADING))
    states = [start, start[:2], after, start.with_rows([0], start[[1]]), mission.state]
    states += [State.concatenate([start, after]), HandFlight(environment, mission).state]
    for state in states:
        for field in fields(State):
            with pytest.raises(ValueError, match="read-only"):
                getattr(state, field.name)[...] = 0


def test_a_caller_keeps_the_arrays_of_a_state_to_write_in(environment):
    mine = np.array([5], np.int16)
    state = SCENARIOS["village"].sample(environment.city, 1, stream(Use.TEST))
    state = State(**{**vars(state), "uav_cell": mine})
    mine[0] = 6
    with pytest.raises(ValueError, match="read-only"):
        state.uav_cell[0] = 6


def test_a_policy_that_writes_is_stopped_in_its_first_step(environment):
    def cheat(state):
        environment.city.landing_distance[:] += 1
        return np.zeros(len(state), int)

    before = environment.city.landing_distance.copy()
    start = SCENARIOS["village"].sample(environment.city, 2, stream(Use.TEST))
    with pytest.raises(ValueError, match="read-only"):
        fly(environment, cheat, start, stream(Use.FADING))
    assert (environment.city.landing_distance == before).all()
