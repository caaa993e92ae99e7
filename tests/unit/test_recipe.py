from dataclasses import replace

import pytest
import torch

from uavdh_lite import registry
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


def test_a_minibatch_may_be_as_large_as_the_memory_and_the_run():
    least = {"environments": 9, "batch_size": 9, "replay_prefill": 9, "replay_capacity": 9}
    assert replace(PAPER, steps=9, **least).batch_size == 9


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
