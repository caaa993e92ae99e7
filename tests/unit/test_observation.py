from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario

SMALL = City.from_text("small", "L . N . \n . b . . \n B . . . \n . . b .")
LARGE = City.from_text("large", "B L . . . \n . N . b . \n . . . . L \n b B . . . \n . . N N .")
SCENARIO = Scenario("any", devices=(1, 3), data=(1, 9), flying_time=(20, 30))


def slow_map(observation, city, state, episode):
    """Cell by cell, from the city as it was before it was embedded."""
    uav = np.array(divmod(int(state.uav_cell[episode]), observation.environment.size))
    if observation.kind == "centred":
        corner = observation.size - 1 - uav
    else:
        corner = np.array([(observation.width - city.size) // 2] * 2)
    map = np.zeros(observation.map_shape, np.float32)
    map[1] = 1
    for cell in np.ndindex(city.size, city.size):
        row, col = corner + cell
        map[:3, row, col] = city.landing[cell], city.no_fly[cell], city.buildings[cell]
    for k, cell in enumerate(state.device_cells[episode]):
        row, col = corner + divmod(int(cell), observation.environment.size)
        left, initial = state.data_left[episode, k], state.data_initial[episode, k]
        map[3:5, row, col] += np.float32([left, initial - left]) / observation.data_scale
    if observation.kind == "non_centred":
        map[5, *(corner + uav)] = 1
    return map


@pytest.mark.parametrize("kind", ["centred", "non_centred"])
@pytest.mark.parametrize(("cities", "size"), [((LARGE,), 0), ((SMALL,), 5), ((SMALL, LARGE), 6)])
def test_maps_against_a_slow_reference(kind, cities, size, generator):
    """Also of a smaller city next to a larger one, and for a network that is to see larger ones."""
    environment = Environment(cities)
    observation = Observation(environment, kind, data_scale=4, time_scale=10, size=size)
    state = SCENARIO.sample_anywhere(environment, 100, generator, spare_time=5)
    state = replace(state, data_left=state.data_left * np.float32(0.75))
    # Two places may share a cell, as those without data do in a mission
    state = replace(state, device_cells=state.device_cells[:, [0, 1, 1]])
    map, time = observation(state)
    assert observation.width == 2 * (size or 5) - 1
    for episode in range(100):
        city = cities[state.city[episode]]
        assert np.array_equal(map[episode], slow_map(observation, city, state, episode))
    assert np.allclose(time[:, 0], state.time_left / 10)
