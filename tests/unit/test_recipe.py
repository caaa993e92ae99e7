from dataclasses import replace

import pytest

from uavdh_lite import registry
from uavdh_lite.errors import InputError
from uavdh_lite.recipe import LITE, PAPER, recipe_from_json


def test_schedules():
    recipe = replace(
        LITE, steps=1000, temperature_decay=0.5, crash_reward_end=-60, crash_reward_growth=0.5
    )
    steps = (0, 250, 500, 900)
    assert [recipe.training_rewards_at(s).crash for s in steps] == [-10, -35, -60, -60]
    assert [recipe.temperature_at(s) for s in steps] == pytest.approx([2.0, 1.05, 0.1, 0.1])
    assert [recipe.learning_rate_at(s) for s in (500, 1000)] == pytest.approx([3e-4, 0])


@pytest.mark.parametrize("name", registry.names("recipe"))
def test_recipes_come_back_from_json(name):
    recipe = registry.find("recipe", name)
    assert recipe_from_json({**recipe.as_json(), "hidden": list(recipe.hidden)}) == recipe


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("discount", 1.5),
        ("replay_prefill", 60_000),
        ("environments", 200),
        ("hidden", (256, 0)),
        ("temperature", float("nan")),
    ],
)
def test_impossible_recipes_name_the_field(field, value):
    with pytest.raises(InputError, match=f"recipe paper: {field} is .* must be"):
        replace(PAPER, **{field: value})
