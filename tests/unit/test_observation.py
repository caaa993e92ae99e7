from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.observation import LAYERS, Observation
from uavdh_lite.scenario import SCENARIOS, place

PICTURE = """
L . N
. b .
B . .
"""


@pytest.fixture
def city():
    return City.from_text("drawn", PICTURE)


def test_centred_layers_cell_by_cell_by_hand(city):
    """The UAV at (2, 1): the city's cell (row, col) is at (row, col + 1) of the 5×5 map."""
    state = place(city, (2, 1), [(0, 1), (1, 2)], [3.0, 4.0], 9, max_devices=3)
    left = np.array([[1.0, 4.0, 0.0]], np.float32)
    state = replace(state, data_left=left)  # 2 of the first device's 3 units are collected
    (maps,), time = Observation(city)(state)
    landing, no_fly, buildings, left, collected = maps[0].int().tolist()
    assert landing == [
        [0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
    ]
    assert no_fly == [
        [1, 0, 0, 1, 1],
        [1, 0, 0, 0, 1],
        [1, 1, 0, 0, 1],
        [1, 1, 1, 1, 1],
        [1, 1, 1, 1, 1],
    ]
    assert buildings == [
        [0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0],
        [0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
    ]
    assert left[0] == [0, 0, 1, 0, 0] and left[1] == [0, 0, 0, 4, 0]
    assert collected[0] == [0, 0, 2, 0, 0] and np.sum(collected) == 2
    assert time.tolist() == [[9.0]]


def batch(name="manhattan", count=200):
    city = City.load(name)
    state = SCENARIOS[name].sample_anywhere(city, count, np.random.default_rng(3), spare_time=5)
    return city, state


def slow_layers(city, state, episode):
    """The five layers in place, cell by cell."""
    layers = np.zeros((5, city.size, city.size), np.float32)
    layers[0], layers[1], layers[2] = city.landing, city.no_fly, city.buildings
    for k, cell in enumerate(state.device_cells[episode]):
        row, col = divmod(int(cell), city.size)
        layers[3, row, col] += state.data_left[episode, k]
        layers[4, row, col] += state.data_initial[episode, k] - state.data_left[episode, k]
    return layers


@pytest.mark.parametrize("name", ["manhattan", "open_field"])
def test_centred_map_against_a_slow_reference_with_no_fly_padding(name):
    city, state = batch(name)
    (maps,), _ = Observation(city)(state)
    assert maps.shape == (200, 5, 31, 31)
    for episode in range(200):
        layers = slow_layers(city, state, episode)
        uav_row, uav_col = divmod(int(state.uav_cell[episode]), city.size)
        expected = np.zeros((5, 31, 31), np.float32)
        for row in range(31):
            for col in range(31):
                r, c = row - 15 + uav_row, col - 15 + uav_col
                if 0 <= r < 16 and 0 <= c < 16:
                    expected[:, row, col] = layers[:, r, c]
                else:
                    expected[1, row, col] = 1
        assert np.array_equal(maps[episode].numpy(), expected)


def test_non_centred_map_is_in_place_with_no_fly_padding_and_one_hot_position():
    city, state = batch()
    (maps,), _ = Observation(city, "non_centred")(state)
    assert maps.shape == (200, 6, 31, 31)
    outside = np.ones((31, 31), bool)
    outside[7:23, 7:23] = False
    for episode in range(200):
        found = maps[episode].numpy()
        assert np.array_equal(found[:5, 7:23, 7:23], slow_layers(city, state, episode))
        assert (found[1, outside] == 1).all()
        assert not found[[0, 2, 3, 4]][:, outside].any()
        row, col = divmod(int(state.uav_cell[episode]), 16)
        assert np.argwhere(found[5]).tolist() == [[row + 7, col + 7]]


def test_global_local_maps_are_the_pooled_and_the_cropped_centred_map():
    city, state = batch(count=20)
    (centred,), _ = Observation(city)(state)
    observation = Observation(city, "global_local", pooling=3, local_size=9)
    (pooled, local), _ = observation(state)
    assert observation.map_shapes() == [(5, 10, 10), (5, 9, 9)]
    assert torch.equal(local, centred[:, :, 11:20, 11:20])
    assert pooled[7, 3, 2, 5] == pytest.approx(float(centred[7, 3, 6:9, 15:18].mean()))


def test_scales_divide_data_and_time():
    city, state = batch(count=5)
    (plain,), time = Observation(city)(state)
    (scaled,), scaled_time = Observation(city, data_scale=20, time_scale=10)(state)
    assert torch.allclose(scaled[:, 3:] * 20, plain[:, 3:])
    assert torch.equal(scaled[:, :3], plain[:, :3])
    assert torch.allclose(scaled_time * 10, time)


def test_shapes_are_as_promised():
    city, state = batch(count=2)
    for kind in ("centred", "non_centred", "global_local"):
        observation = Observation(city, kind)
        assert [tuple(one.shape[1:]) for one in observation(state)[0]] == observation.map_shapes()
    assert len(LAYERS) == 5


def test_unknown_kind_and_impossible_local_map(city):
    with pytest.raises(InputError, match=r"unknown observation 'polar'.*centred, non_centred"):
        Observation(city, "polar")
    with pytest.raises(InputError, match="local_size 17: must be odd and at most 5"):
        Observation(city, "global_local")
