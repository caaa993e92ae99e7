"""What a decision hangs on: a linear network, for which it can be computed by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.agent import Agent, saliency, value_map
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import SCENARIOS, place


class Linear(nn.Module):
    """Six sums over the maps, each with weights of its own."""

    def __init__(self, generator):
        super().__init__()
        self.weight = nn.Parameter(torch.randn(6, 5, 31, 31, generator=generator))

    def forward(self, maps, time):
        return torch.einsum("bchw,achw->ba", maps[0], self.weight)


@pytest.fixture
def city():
    return City.load("manhattan")


@pytest.fixture
def state(city):
    return place(city, (8, 7), [(4, 4), (7, 9)], [10, 5], 40, 5)


def test_saliency_of_a_linear_network_is_weight_times_input(city, state):
    network = Linear(torch.Generator().manual_seed(0))
    agent = Agent(network, Observation(city), LITE, SCENARIOS["manhattan"], city)
    (maps,), _ = agent.observation(state)
    best = int(agent(state)[0])
    expected = (maps[0] * network.weight[best]).abs().sum(0).detach()
    np.testing.assert_allclose(saliency(agent, state), expected, rtol=1e-5)
    assert network.weight.grad is None  # nothing is left behind in the network


def test_saliency_needs_one_map(city, state):
    agent = load_agent("manhattan")
    two = Observation(city, "global_local")
    with pytest.raises(InputError, match="saliency needs one map"):
        saliency(replace(agent, observation=two), state)


def test_value_map_moves_the_uav_and_nothing_else(city, state):
    agent = load_agent("manhattan")
    values = value_map(agent, state)
    assert (np.isnan(values) == city.no_fly).all()
    for cell in ((0, 0), (8, 7), (15, 15)):
        moved = place(city, cell, [(4, 4), (7, 9)], [10, 5], 40, 5)
        assert values[cell] == pytest.approx(float(agent.q_values(moved).max()), abs=1e-4)
    assert state.uav_cell[0] == 8 * 16 + 7
