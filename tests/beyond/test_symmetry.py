from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.beyond.failsafe import MaskedNetwork, SafeEnvironment, SafeObservation
from uavdh_lite.beyond.symmetry import (
    SYMMETRIES,
    EightViews,
    in_eight_views,
    turned,
    turned_actions,
)
from uavdh_lite.beyond.told import ToldObservation
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
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


def test_by_the_mean_of_eight_views_a_turned_mission_is_flown_as_the_turned_flight(
    elsewhere, generator
):
    """Whatever the network is, and with the actions that the failsafe allows."""
    city, cells, symmetry = elsewhere
    city, here = (SafeEnvironment(each.city) for each in (city, CITY))
    state = SCENARIO.sample_anywhere(here, 20, generator, spare_time=0)
    there = replace(
        state, **{name: cells[getattr(state, name)] for name in ("uav_cell", "device_cells")}
    )
    torch.manual_seed(0)
    seen, seen_there = SafeObservation(here)(state), SafeObservation(city)(there)
    one = nn.Sequential(nn.Flatten(), nn.Linear(seen[0][0].numel(), 6))
    network = EightViews(MaskedNetwork(lambda map, time: one(map)))
    actions = turned_actions(*symmetry)
    assert torch.allclose(network(*seen), network(*seen_there)[:, actions], atol=1e-5)
    views = [one(turned(seen[0], *each))[:, turned_actions(*each)] for each in SYMMETRIES]
    mean = torch.stack(views).mean(dim=0).masked_fill(~seen[2], -torch.inf)
    assert torch.allclose(network(*seen), mean, atol=1e-5)


def test_agents_that_have_learned_from_all_views_may_fly_by_them():
    agent = load_agent("any_city").over(City.load("village"))
    start = agent.scenario.sample(agent.environment, 30, np.random.default_rng(0))
    eight = in_eight_views(agent)
    changed = (eight.q_values(start) - agent.q_values(start)).abs().nan_to_num().max()
    assert changed > 0.01 and np.mean(eight.act(start) == agent.act(start)) > 0.7
    with pytest.raises(InputError, match="the recipe lite has learned from one view"):
        in_eight_views(load_agent("manhattan_ddqn"))
