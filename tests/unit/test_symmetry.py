"""Turned and mirrored cities: what is the same, and which actions."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.agent import Agent, build
from uavdh_lite.city import Cities, City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import ACTIONS, EAST, HOVER, LAND, NORTH, SOUTH, WEST, Environment
from uavdh_lite.recipe import QUANTILE
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.symmetry import (
    SYMMETRIES,
    mean_over_symmetries,
    turned,
    turned_actions,
    turned_cities,
)

SCENARIO = Scenario("any", devices=(1, 3), data=(2.0, 15.0), flying_time=(10, 40))


def test_by_hand():
    west_of_north = torch.tensor([[1, 2], [3, 4]])
    assert turned(west_of_north, 0, False).tolist() == [[1, 2], [3, 4]]
    assert turned(west_of_north, 1, False).tolist() == [[2, 4], [1, 3]]  # to the left
    assert turned(west_of_north, 0, True).tolist() == [[2, 1], [4, 3]]
    assert turned_actions(1, False) == [WEST, NORTH, EAST, SOUTH, HOVER, LAND]
    assert turned_actions(0, True) == [NORTH, WEST, SOUTH, EAST, HOVER, LAND]
    assert len({tuple(turned_actions(*symmetry)) for symmetry in SYMMETRIES}) == 8


def moved(city, cell, turns, mirrored):
    """Where a cell of a city is in the turned one."""
    place = np.zeros((city.size, city.size), bool)
    place.ravel()[cell] = True
    return int(turned(torch.from_numpy(place), turns, mirrored).flatten().int().argmax())


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_the_turned_action_leads_to_the_turned_cell(symmetry):
    city = CityGenerator((8, 8)).draw(1, seed=2)[0]
    other = City.from_kinds("turned", turned(torch.tensor(city.kinds), *symmetry).numpy())
    here, there = Environment(city), Environment(other)
    for cell in city.flight_cells:
        where = moved(city, cell, *symmetry)
        for action, as_turned in zip(range(len(ACTIONS)), turned_actions(*symmetry), strict=True):
            after = moved(city, here.next_cell[cell, action], *symmetry)
            assert there.next_cell[where, as_turned] == after


def test_the_eight_views_of_a_city_and_of_several():
    first, second = CityGenerator((9, 9)).draw(2, seed=2).cities
    views = turned_cities(first)
    assert len(views) == 8 and views[0] is first
    assert len({city.fingerprint for city in views.cities}) == 8
    assert {city.landing.sum() for city in views.cities} == {first.landing.sum()}
    for turns, mirrored in SYMMETRIES:
        expected = turned(torch.tensor(first.kinds), turns, mirrored)
        assert any(np.array_equal(city.kinds, expected) for city in views.cities)
    both = turned_cities(Cities((first, second)))
    assert len(both) == 16 and both.cities[:2] == (first, second)


@pytest.mark.parametrize("kind", ["global_local", "centred", "non_centred"])
def test_the_mean_over_the_symmetries_knows_them(kind):
    """An untrained network values a turned map otherwise; the mean over eight views does not."""
    recipe = replace(QUANTILE, observation=kind, local_size=9, hidden=(16,), strides=(1, 1))
    city = CityGenerator((9, 9)).draw(1, seed=2)[0]
    state = SCENARIO.sample_anywhere(city, 20, stream(Use.TEST), 3)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        observation, network = build(recipe, city)
    agent = Agent(network, observation, recipe, SCENARIO, city, symmetric=True)
    for symmetry in SYMMETRIES[1:]:
        kinds = turned(torch.tensor(city.kinds), *symmetry).numpy()
        elsewhere = replace(agent, city=City.from_kinds("turned", kinds))
        elsewhere = replace(elsewhere, observation=build(recipe, elsewhere.city)[0])
        cells = np.array([moved(city, cell, *symmetry) for cell in range(city.size**2)], np.int16)
        as_turned = replace(
            state, uav_cell=cells[state.uav_cell], device_cells=cells[state.device_cells]
        )
        expected = agent.q_values(state)
        q_values = elsewhere.q_values(as_turned)[:, turned_actions(*symmetry)]
        torch.testing.assert_close(q_values, expected, atol=1e-5, rtol=1e-4)
        one_view, other = replace(agent, symmetric=False), replace(elsewhere, symmetric=False)
        difference = other.q_values(as_turned)[:, turned_actions(*symmetry)]
        assert (difference - one_view.q_values(state)).abs().max() > 1e-3


def test_a_network_that_knows_the_symmetries_keeps_its_values():
    """What is north of the middle, to its east, and so on, is a Q-value that turns with the map."""

    def around(maps):
        middle = maps[:, 0, 1:-1, 1:-1]
        north, east, south, west = (
            middle[:, 0, 1],
            middle[:, 1, 2],
            middle[:, 2, 1],
            middle[:, 1, 0],
        )
        return torch.stack([north, east, south, west, middle[:, 1, 1], 0 * north], dim=1)

    maps = torch.rand(4, 1, 5, 5, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(mean_over_symmetries(around, maps), around(maps))
