from dataclasses import replace

import pytest
import torch
from torch import nn

from uavdh_lite import registry
from uavdh_lite.errors import InputError
from uavdh_lite.recipe import PAPER, SMALL, recipe_from_json


def test_schedules():
    recipe = replace(
        SMALL,
        steps=2000,
        temperature=1.0,
        temperature_end=0.1,
        crash_reward_end=-60,
        crash_reward_growth=0.5,
    )
    steps = (0, 500, 1000, 1800)
    assert [recipe.training_rewards_at(s).crash for s in steps] == [-5, -32.5, -60, -60]
    assert {recipe.training_rewards_at(s).movement for s in steps} == {recipe.movement_reward}
    assert [recipe.temperature_at(s) for s in steps] == pytest.approx([1.0, 0.55, 0.1, 0.1])
    assert [recipe.learning_rate_at(s) for s in (1000, 2000)] == pytest.approx([1e-3, 0])


@pytest.mark.parametrize("name", registry.names("recipe"))
def test_recipes_come_back_from_json(name):
    recipe = registry.find("recipe", name)
    assert recipe_from_json({**recipe.as_json(), "hidden": list(recipe.hidden)}) == recipe


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("discount", 1.5),
        ("hidden", (256, 0)),
        ("environments", 129),
        ("batch_size", 25_001),
        ("replay_prefill", 50_001),
    ],
)
def test_impossible_recipes_name_the_field(field, value):
    with pytest.raises(InputError, match=f"recipe paper: {field} is .* must be"):
        replace(PAPER, **{field: value})
    with pytest.raises(InputError, match="replay_prefill is 25000, must be at most steps, 20000"):
        replace(PAPER, steps=20_000)
    least = {"environments": 9, "batch_size": 9, "replay_prefill": 9, "replay_capacity": 9}
    assert replace(PAPER, steps=9, **least).batch_size == 9  # each may be as large as the next


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"kind": []}, "unknown recipe kind"),
        ({"kind": "Recipe"}, "name is missing"),
    ],
)
def test_what_is_no_recipe_is_named(values, named):
    with pytest.raises(InputError, match=named):
        recipe_from_json(values)


@pytest.mark.parametrize("amsgrad", [False, True])
def test_the_optimiser_is_adam_with_the_epsilon_of_keras(amsgrad):
    """A first step is the rate times g / (|g| + ε); amsgrad remembers the largest slope."""
    weight = torch.nn.Linear(1, 1, bias=False)
    recipe = replace(PAPER, learning_rate=0.5, amsgrad=amsgrad)
    optimiser, before = recipe.optimiser_for(weight), weight.weight.item()
    weight.weight.grad = torch.tensor([[3e-7]])
    optimiser.step()
    assert before - weight.weight.item() == pytest.approx(0.5 * 3 / 4, rel=1e-3)
    assert ("max_exp_avg_sq" in optimiser.state[weight.weight]) == amsgrad


def test_the_network_has_the_sizes_and_options_of_the_recipe(corridor):
    options = {"kernels": 3, "kernel_size": 3, "strides": (2,), "hidden": (7, 5)}
    recipe = replace(PAPER, **options, layer_norm=True, leak=0.25)
    observation = recipe.observation_for(recipe.environment_for(corridor))
    layers = [*recipe.network_for(observation).modules()]
    (convolution,) = (layer for layer in layers if isinstance(layer, nn.Conv2d))
    assert (convolution.out_channels, convolution.kernel_size) == (3, (3, 3))
    assert convolution.stride == (2, 2)
    assert [one.out_features for one in layers if isinstance(one, nn.Linear)] == [7, 5, 6]
    assert [one.normalized_shape for one in layers if isinstance(one, nn.LayerNorm)] == [(7,), (5,)]
    assert [one.negative_slope for one in layers if isinstance(one, nn.LeakyReLU)] == [0.25] * 3
