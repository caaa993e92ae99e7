import numpy as np
import pytest
import torch

from uavdh_lite.beyond.told import TOLD_LAYERS, ToldObservation
from uavdh_lite.channel import rate
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.observation import LAYERS, Observation
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import Scenario

CITIES = (
    City.from_text("five", "L . N . . \n . . b . . \n . B . . L \n . . . N . \n b . . . ."),
    City.from_text("three", "L . . \n . b N \n . . ."),
)
SCENARIO = Scenario("any", devices=(1, 3), data=(0.5, 15.0), flying_time=(10, 40))


@pytest.fixture(scope="module")
def environment():
    return Environment(CITIES)


@pytest.fixture
def states(environment, generator):
    return SCENARIO.sample_anywhere(environment, 20, generator, spare_time=1)


def test_expected_data_is_what_hovering_there_brings_without_fading(environment, states):
    """One device at a time: the environment's own SNR, all four slots, no more than is left."""
    expected = ToldObservation(environment).expected_data(states).numpy()
    size = environment.size
    for i in range(len(states)):
        for cell in range(size**2):
            hovering = states.with_rows([i], states[[i]])[[i]]
            object.__setattr__(hovering, "uav_cell", np.array([cell], np.int16))
            snr_db = environment.snr_db(hovering, hovering.uav_cell, np.zeros((1, 4, 3)))[0]
            offered = rate(snr_db).sum(axis=0)
            row, col = divmod(cell, size)
            if max(row, col) >= CITIES[states.city[i]].size:  # the no-fly cells around a city
                assert expected[i, cell] == 0
                continue
            assert expected[i, cell] == pytest.approx(
                np.minimum(offered, states.data_left[i]).max(), rel=1e-5, abs=1e-6
            )


@pytest.mark.parametrize("size", [0, 8])
def test_ways_are_those_of_the_greedy_planner(size, environment, states):
    """As shares of what is far in the largest city that the network is to see."""
    told = ToldObservation(environment, size=size).told(states).numpy()
    far = 2 * (size or environment.size)
    there = Greedy(environment).moves[states.city, states.uav_cell].astype(float)
    assert np.allclose(told[:, 2], 1 - there.clip(max=far) / far)
    home = environment.landing_distance[states.city]
    assert np.allclose(told[:, 1], np.where(home < 0, 0, 1 - home / far))
    assert (told[:, 1] == 1).any() and (told[:, 1] == 0).any()


@pytest.mark.parametrize("kind", ["centred", "non_centred"])
def test_layers_lie_in_the_frame_as_the_others_do(kind, environment, states):
    plain, told = (one(environment, kind, 5.0, 10.0) for one in (Observation, ToldObservation))
    maps, time = told(states)
    assert maps.shape[1:] == told.map_shape and torch.equal(time, plain(states)[1])
    count = plain.map_shape[0]
    assert torch.equal(maps[:, :count], plain(states)[0])
    assert told.map_shape[0] == count + len(TOLD_LAYERS)
    # A landing cell is where the way home is 1, in either frame; outside all is 0.
    landing = LAYERS.index("landing zone")
    assert torch.equal(maps[:, count + 1] == 1, maps[:, landing] == 1)
    city = states.city == 0
    assert (maps[city][:, count:].flatten(2) != 0).sum(dim=2).max() <= environment.size**2
