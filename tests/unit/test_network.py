import math

import pytest
import torch
from torch import nn

from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.network import QNetwork
from uavdh_lite.recipe import PAPER


def test_the_paper_network_has_the_weights_it_should():
    observation = PAPER.observation_for(Environment(City.load("manhattan")))
    network = PAPER.network_for(observation)
    assert sum(parameter.numel() for parameter in network.parameters()) == 2_308_854
    assert network.convolutions(torch.zeros(2, 5, 31, 31)).shape == (2, 16 * 23 * 23)
    assert network(torch.zeros(2, 5, 31, 31), torch.zeros(2, 1)).shape == (2, 6)


def test_layers_are_in_order_and_map_and_flying_time_matter():
    network = QNetwork((5, 9, 9), 4, 3, (2,), hidden=(8, 4), layer_norm=True, leak=0.1)
    kinds = [type(layer).__name__ for layer in network.head]
    assert kinds == ["Linear", "LayerNorm", "LeakyReLU"] * 2 + ["Linear"]
    for rectifier in (network.convolutions[1], network.head[2], network.head[5]):
        assert rectifier(torch.tensor(-2.0)) == torch.tensor(-0.2)
    map, time = torch.rand(1, 5, 9, 9), torch.rand(1, 1)
    for other in (network(map, time + 1), network(map + 1, time)):
        assert not torch.equal(other, network(map, time))


def test_every_layer_begins_with_glorots_weights_and_no_bias():
    """Uniform up to √(6 / (inputs + outputs)), of a kernel's place times its cells."""
    network = QNetwork((5, 9, 9), 8, 3, (1, 2), hidden=(32, 16))
    layers = [one for one in network.modules() if isinstance(one, nn.Conv2d | nn.Linear)]
    assert len(layers) == 5
    for layer in layers:
        outputs, inputs, *kernel = layer.weight.shape
        bound = (6 / ((inputs + outputs) * math.prod(kernel))) ** 0.5
        assert 0.9 * bound < float(layer.weight.detach().abs().max()) <= bound
        assert not layer.bias.any()


def test_too_small_a_map_is_an_error_that_says_so():
    with pytest.raises(InputError, match="1×1 cells is too small"):
        QNetwork((5, 9, 9), strides=(1, 1, 1))


def test_the_network_is_float32_whatever_torchs_default_is(trainer):
    torch.set_default_dtype(torch.float64)
    try:
        run = trainer()
        while not run.updates:
            run.step()
        assert run.agent.q_values(run.state).dtype == torch.float32
    finally:
        torch.set_default_dtype(torch.float32)
