from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.beyond.symmetry import SYMMETRIES, turned, turned_actions
from uavdh_lite.beyond.told import ToldObservation
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario

CITY = Environment(City.from_text("uneven", "L . N . \n . b . . \n B . . L \n . . b N"))
SCENARIO = Scenario("any", devices=(1, 3), data=(2.0, 15.0), flying_time=(10, 40))


@pytest.fixture(params=SYMMETRIES)
def elsewhere(request):
    """The turned city; for each cell, which one it is there; the symmetry."""
    kinds = turned(torch.tensor(CITY.cities[0].kinds), *request.param).numpy()
    cells = turned(torch.arange(16).reshape(4, 4), *request.param).flatten().argsort()
    city = Environment(City.from_kinds("turned", kinds))
    return city, cells.numpy().astype(np.int16), request.param


def test_the_turned_action_leads_to_the_turned_cell(elsewhere):
    city, cells, symmetry = elsewhere
    actions = turned_actions(*symmetry)
    for action in range(len(ACTIONS)):
        after = cells[CITY.next_cell[0, :, action]]
        assert np.array_equal(city.next_cell[0, cells, actions[action]], after)


@pytest.mark.parametrize("kind", [Observation, ToldObservation])
def test_the_map_of_a_turned_mission_is_the_turned_map(kind, elsewhere, generator):
    city, cells, symmetry = elsewhere
    state = SCENARIO.sample_anywhere(CITY, 20, generator, spare_time=3)
    there = replace(
        state, **{name: cells[getattr(state, name)] for name in ("uav_cell", "device_cells")}
    )
    (map, time), (map_there, time_there) = kind(CITY)(state), kind(city)(there)
    assert torch.equal(time, time_there)
    assert torch.allclose(turned(map, *symmetry), map_there, atol=1e-5)
