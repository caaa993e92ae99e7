import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.scenario import Scenario, find_scenario

SMALL = City.from_text("small", "L.B\n..B\nBB.")  # four cells for devices, one cut off
VILLAGE = City.load("village")
BOTH = Environment((SMALL, VILLAGE))


def test_draws_stay_in_the_ranges_and_reach_their_ends(generator):
    scenario, environment = find_scenario("manhattan"), Environment(City.load("manhattan"))
    state = scenario.sample(environment, 5000, generator)
    data = state.data_initial[state.data_initial > 0]
    assert set((state.data_initial > 0).sum(1)) == {2, 3, 4, 5}
    assert state.time_left.min() == 35 and state.time_left.max() == 70
    assert 5 <= data.min() < 5.1 and 19.9 < data.max() <= 20
    assert set(state.uav_cell) == set(np.flatnonzero(environment.city.landing))
    assert not state.ended.any() and np.array_equal(state.data_left, state.data_initial)


def test_each_device_place_is_uniform_over_the_cells(generator):
    state = Scenario("five", devices=(5, 5)).sample(Environment(VILLAGE), 20_000, generator)
    for place in range(5):
        counts = np.bincount(state.device_cells[:, place], minlength=64)
        there = counts[VILLAGE.open_to_devices.ravel()]
        assert counts.sum() == there.sum()
        free, expected = len(there) - 1, 20_000 / len(there)
        chi_squared = ((there - expected) ** 2 / expected).sum()
        # mean: cells − 1; standard deviation: √(2 (cells − 1))
        assert abs(chi_squared - free) < 5 * np.sqrt(2 * free)


@pytest.mark.parametrize("anywhere", [False, True])
def test_every_episode_is_in_one_city_and_all_cities_are_equally_likely(anywhere, generator):
    scenario = Scenario("three", devices=(3, 3))
    if anywhere:
        state = scenario.sample_anywhere(BOTH, 4000, generator, spare_time=4)
    else:
        state = scenario.sample(BOTH, 4000, generator)
    assert abs((state.city == 0).mean() - 1 / 2) < 0.04
    assert all(len(set(cells)) == 3 for cells in state.device_cells.tolist())
    starts = BOTH.landing_distance >= 0 if anywhere else BOTH.landing
    for city in (0, 1):
        here = state[state.city == city]
        assert set(here.uav_cell) == set(np.flatnonzero(starts[city]))
        assert set(here.device_cells.flat) == set(np.flatnonzero(BOTH.open_to_devices[city]))


def test_episodes_under_way_can_still_be_landed(generator):
    scenario, environment = find_scenario("village"), Environment(VILLAGE)
    state = scenario.sample_anywhere(environment, 3000, generator, spare_time=4)
    spare = state.time_left - VILLAGE.landing_distance.flat[state.uav_cell] - 1
    assert spare.min() == 4 and state.time_left.max() == 35
    assert (state.data_left <= state.data_initial).all()
    used = state.data_initial > 0
    assert (state.data_left[used] == 0).mean() == pytest.approx(1 / 2, abs=0.04)
