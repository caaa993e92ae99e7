from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.beyond.views import SYMMETRIES, EightViews, turned, turned_actions
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario

CITY = Environment(City.from_text("uneven", "L . N . \n . b . . \n B . . L \n . . b N"))
SCENARIO = Scenario("any", devices=(1, 3), data=(2.0, 15.0), flying_time=(10, 40))


@pytest.fixture(params=SYMMETRIES)
def elsewhere(request):
    """The turned city; for each cell, and for each action, which one it is there."""
    kinds = turned(torch.tensor(CITY.cities[0].kinds), *request.param).numpy()
    cells = turned(torch.arange(16).reshape(4, 4), *request.param).flatten().argsort()
    city = Environment(City.from_kinds("turned", kinds))
    return city, cells.numpy().astype(np.int16), turned_actions(*request.param)


def test_the_turned_action_leads_to_the_turned_cell(elsewhere):
    city, cells, actions = elsewhere
    for action in range(len(ACTIONS)):
        after = cells[CITY.next_cell[0, :, action]]
        assert np.array_equal(city.next_cell[0, cells, actions[action]], after)


def test_the_mean_over_the_views_values_a_turned_mission_alike(elsewhere, generator):
    """A single view does not: the network is not trained."""
    city, cells, actions = elsewhere
    network = QNetwork((5, 7, 7), kernels=4, kernel_size=3, strides=(1,), hidden=(16,))
    state = SCENARIO.sample_anywhere(CITY, 20, generator, spare_time=3)
    moved = {name: cells[getattr(state, name)] for name in ("uav_cell", "device_cells")}
    same_city = np.array_equal(cells, range(16))
    for one, alike in ((EightViews(network), True), (network, same_city)):
        q_values = one(*Observation(CITY)(state))
        q_turned = one(*Observation(city)(replace(state, **moved)))[:, actions]
        assert torch.allclose(q_turned, q_values, atol=1e-5) == alike
