import pytest
import torch

from uavdh_lite.agent import build
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.network import QNetwork
from uavdh_lite.recipe import LITE, PAPER


def count(network):
    return sum(parameter.numel() for parameter in network.parameters())


def test_parameter_count_of_the_paper_network():
    _, network = build(PAPER, City.load("manhattan"))
    assert count(network) == 2_308_854


def test_parameter_count_with_four_layers_as_in_the_authors_code():
    assert count(QNetwork([(4, 31, 31)])) == 2_308_454


def test_shapes_of_the_paper_network_as_documented():
    network = QNetwork([(5, 31, 31)])
    convolutions = network.convolutions[0]
    maps = torch.zeros(2, 5, 31, 31)
    assert convolutions[0](maps).shape == (2, 16, 27, 27)
    assert convolutions(maps).shape == (2, 16 * 23 * 23)
    assert network.head[0].in_features == 8465
    assert network([maps], torch.zeros(2, 1)).shape == (2, 6)


def test_layer_norm_comes_before_each_hidden_relu_and_not_at_the_output():
    _, network = build(LITE, City.load("manhattan"))
    kinds = [type(layer).__name__ for layer in network.head]
    assert kinds == ["Linear", "LayerNorm", "LeakyReLU"] * 3 + ["Linear"]


def test_leaky_relus_pass_a_share_of_what_is_below_zero():
    torch.manual_seed(0)
    plain, leaky = (QNetwork([(5, 12, 12)], strides=(1,), leak=leak) for leak in (0.0, 0.1))
    leaky.load_state_dict(plain.state_dict())
    below = torch.full((1, 16, 8, 8), -2.0)
    assert torch.equal(plain.convolutions[0][1](below), torch.zeros_like(below))
    assert torch.allclose(leaky.convolutions[0][1](below), 0.1 * below)
    maps, time = [torch.rand(1, 5, 12, 12)], torch.rand(1, 1)
    assert not torch.equal(plain(maps, time), leaky(maps, time))


def test_flying_time_and_every_map_matter():
    torch.manual_seed(0)
    network = QNetwork([(5, 12, 12), (5, 9, 9)], strides=(2,))
    maps, time = [torch.rand(1, 5, 12, 12), torch.rand(1, 5, 9, 9)], torch.rand(1, 1)
    q = network(maps, time)
    assert not torch.equal(network(maps, time + 1), q)
    assert not torch.equal(network([maps[0] + 1, maps[1]], time), q)
    assert not torch.equal(network([maps[0], maps[1] + 1], time), q)


def test_too_small_a_map_is_an_error_that_says_so():
    with pytest.raises(InputError, match="a map of 1×1 cells is too small for a convolution"):
        QNetwork([(5, 9, 9)], strides=(1, 1, 1))
