from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import HOVER, LAND, Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.missions import Mission
from uavdh_lite.planners import CACHED, NO_PATH, Greedy, Random, shortest_paths
from uavdh_lite.scenario import Scenario, find_scenario

SMALL = """
L . b .
. N . .
. . B .
. . . .
"""


@pytest.fixture
def small():
    return Environment(City.from_text("small", SMALL))


def test_random_takes_every_action_alike_and_draws_for_nobody_who_has_landed(small, generator):
    state = Scenario("s", "s", (1, 2)).sample(small, 12_000, generator)
    counts = np.bincount(Random(0).act(state), minlength=6)
    assert counts.min() > 1800 and counts.sum() == 12_000
    landed = np.arange(12_000) % 2 == 0
    action = Random(0).act(replace(state, landed=landed))
    assert (action[landed] == HOVER).all()
    assert np.array_equal(action[~landed], Random(0).act(state[~landed]))


@pytest.mark.parametrize("name", ["manhattan", "open_field"])
def test_greedy_always_lands_in_time_and_needs_no_safety_controller(name):
    environment = Environment(load_city(name))
    flights = evaluate(environment, Greedy(environment), find_scenario(name), 400, seed=0)
    records = flights.records()
    assert (records["landed"] == 1).all()
    assert not records["safety_interventions"].any()
    assert records["collected"].mean() > 0.9


def test_shortest_paths_on_a_small_map(small):
    moves = shortest_paths(small.cities[0].no_fly)
    assert np.array_equal(moves, moves.T) and (np.diag(moves)[[5, 10]] == NO_PATH).all()
    assert moves[0, [0, 1, 9, 6, 15]].tolist() == [0, 1, 3, 3, 6]  # (1, 1) and (2, 2) are closed
    walls = shortest_paths(City.from_text("two halves", "L.N. \n ..N. \n ..N. \n ..N.").no_fly)
    assert walls[0, 3] == NO_PATH and walls[3, 7] == 1


def test_the_tables_of_a_large_city_are_made_in_parts():
    city = CityGenerator(48).draw(1, 3)[0]
    greedy = Greedy(Environment(city))
    moves, approach = greedy.moves[0], greedy.approach[0]
    assert np.array_equal(moves, moves.T) and city.size**4 > 4 * CACHED
    home, free = city.landing_distance.ravel(), np.flatnonzero(~city.no_fly)
    assert np.array_equal(moves[:, city.landing.ravel()].min(axis=1)[free], home[free])
    place = np.stack(np.divmod(np.arange(48**2), 48), axis=1)
    reachable = np.flatnonzero(home >= 0)
    for cell in range(0, 48**2, 7):
        distance = ((place[reachable] - place[cell]) ** 2).sum(axis=1)
        assert approach[cell] == reachable[distance.argmin()]


def test_greedy_goes_to_the_nearest_device_and_home_when_all_is_collected(small):
    state = Mission(small.city, (3, 0), [(3, 3), (0, 1)], [5, 5], 30, max_devices=2).state
    assert Greedy(small).act(state) == 1  # east: (3, 3) is 3 moves away, (0, 1) is 4
    empty = replace(state, data_left=np.zeros_like(state.data_left))
    assert Greedy(small).act(empty) == 0  # north, to the landing zone


def test_greedy_turns_back_when_the_time_just_suffices(small):
    """From (0, 1) one more move east needs 1 + 2 moves home, and the landing."""
    for time, action in ((4, 1), (3, 3), (2, 3)):
        state = Mission(small.city, (0, 1), [(0, 3)], [90], time, max_devices=2).state
        assert Greedy(small).act(state) == action
    at_home = Mission(small.city, (0, 0), [(0, 3)], [90], 2, max_devices=2).state
    assert Greedy(small).act(at_home) == LAND


def test_greedy_goes_next_to_a_device_where_it_may_not_fly(small):
    """The device in the no-fly cell (1, 1): its first neighbour is (0, 1)."""
    assert Greedy(small).approach[0, 5] == 1
    state = Mission(small.city, (0, 1), [(1, 1)], [90], 30, max_devices=2).state
    assert Greedy(small).act(state) == HOVER
