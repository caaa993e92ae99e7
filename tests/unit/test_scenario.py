import re

import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.city_generator import load_city
from uavdh_lite.errors import InputError
from uavdh_lite.scenario import SCENARIOS, Scenario, find_scenario


@pytest.fixture(scope="module")
def manhattan():
    return City.load("manhattan")


def test_draws_stay_in_the_ranges_and_reach_their_ends(manhattan, generator):
    scenario = SCENARIOS["manhattan"]
    state = scenario.sample(manhattan, 5000, generator)
    number = (state.data_initial > 0).sum(1)
    assert set(number) == {2, 3, 4, 5}
    assert state.time_left.min() == 35 and state.time_left.max() == 70
    data = state.data_initial[state.data_initial > 0]
    assert 5 <= data.min() < 5.1 and 19.9 < data.max() <= 20
    assert set(state.uav_cell) == set(manhattan.landing_cells)
    assert np.isin(state.device_cells, manhattan.device_cells).all()
    assert not state.landed.any() and not state.ended.any()
    assert (state.data_left == state.data_initial).all()


def test_devices_of_an_episode_stand_in_different_cells(generator):
    city = City.from_text("tiny", "L.B\n..B\nBBB")
    state = Scenario("tiny", "tiny", (3, 3)).sample(city, 500, generator)
    assert all(len(set(cells)) == 3 for cells in state.device_cells.tolist())


def test_each_device_place_is_uniform_over_the_cells(manhattan, generator):
    state = SCENARIOS["manhattan"].sample(manhattan, 40_000, generator)
    expected = 40_000 / len(manhattan.device_cells)
    for place in range(5):
        counts = np.bincount(state.device_cells[:, place], minlength=256)[manhattan.device_cells]
        chi_squared = ((counts - expected) ** 2 / expected).sum()
        # mean: cells − 1; standard deviation: √(2 (cells − 1))
        free = len(counts) - 1
        assert abs(chi_squared - free) < 5 * np.sqrt(2 * free)


def test_same_generator_state_same_draws(manhattan):
    first, second = (
        SCENARIOS["manhattan"].sample(manhattan, 10, np.random.default_rng(7)) for _ in range(2)
    )
    assert (first.device_cells == second.device_cells).all()
    assert (first.data_initial == second.data_initial).all()


def test_episodes_under_way_can_still_be_landed(manhattan, generator):
    state = SCENARIOS["manhattan"].sample_anywhere(manhattan, 3000, generator, spare_time=4)
    distance = manhattan.landing_distance.ravel()[state.uav_cell]
    assert (distance >= 0).all()
    spare = state.time_left - distance - 1
    assert spare.min() == 4
    assert state.time_left.max() == 70
    assert (state.data_left <= state.data_initial).all()
    assert ((state.data_left == 0) & (state.data_initial > 0)).any()


def test_every_preset_fits_its_city(generator):
    for scenario in SCENARIOS.values():
        few = re.sub(r"random:\d+", "random:20", scenario.city)  # drawing all takes seconds
        state = scenario.sample(load_city(few), 3, generator)
        assert state.device_cells.shape == (3, scenario.max_devices)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("devices", (0, 2)),
        ("devices", (3, 2)),
        ("data", (-1.0, 5.0)),
        ("data", (0.0, 0.0)),
        ("flying_time", (0, 10)),
        ("flying_time", (10, 40_000)),
    ],
)
def test_impossible_ranges_name_the_field(field, value):
    with pytest.raises(InputError, match=f"scenario mine: {field}"):
        Scenario("mine", **{field: value})


def test_more_devices_than_cells(generator):
    city = City.from_text("tiny", "L.B\n..B\nBBB")
    with pytest.raises(InputError, match="up to 4 devices, but tiny has 3 cells"):
        Scenario("tiny", "tiny", (1, 4)).sample(city, 1, generator)


def test_unknown_scenario_lists_the_known_ones():
    with pytest.raises(InputError, match=r"unknown scenario 'mars'.*manhattan, open_field"):
        find_scenario("mars")
