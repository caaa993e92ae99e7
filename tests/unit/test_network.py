import math
from dataclasses import replace

import pytest
import torch
from torch import nn

from uavdh_lite import registry
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.network import QNetwork, WholeFrame
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


KINDS = [
    (name, kind)
    for name in registry.names("recipe")
    for kind in ("centred", "non_centred")
    if kind == "centred" or not getattr(registry.find("recipe", name), "pooling", 0)
]


@pytest.mark.parametrize("size", [*range(4, 17), 32, 50])
@pytest.mark.parametrize(("name", "observation"), KINDS)
def test_every_cell_of_the_map_is_read(name, observation, size):
    """The output depends on each cell of each layer: by the gradient of what goes in."""
    recipe = registry.find("recipe", name)
    recipe = replace(recipe, observation=observation, kernels=2, hidden=(8,), leak=0.1)
    city = City.from_text("field", "\n".join(["L" + "." * (size - 1)] * size))
    seen = recipe.observation_for(recipe.environment_for(city))
    network = recipe.network_for(seen)
    map = torch.rand(2, *seen.map_shape, requires_grad=True)
    allowed = torch.ones(2, 6, dtype=bool)
    network(map, torch.rand(2, 1), *[allowed][: getattr(recipe, "failsafe", 0)]).sum().backward()
    assert map.grad.abs().sum(0).min() > 0


def test_what_a_frame_adds_is_as_outside_the_city():
    """To the south and east, as few cells as make whole windows of 3×3 with stride 2 after 4×4."""
    frame, map = WholeFrame(9, 4, (3, 2)), torch.rand(2, 5, 9, 9)
    framed = frame(map)
    assert framed.shape == (2, 5, 13, 13)
    torch.testing.assert_close(framed[:, :, :9, :9], map, atol=1e-6, rtol=0)
    for added in (framed[:, :, 9:], framed[:, :, :, 9:]):
        assert (added[:, 1] == 1).all() and not added[:, [0, 2, 3, 4]].any()
    assert WholeFrame(31, 4, (3, 1))(other := torch.rand(1, 5, 31, 31)) is other
