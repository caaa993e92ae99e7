from dataclasses import replace

import pytest

from uavdh_lite import registry
from uavdh_lite.errors import InputError
from uavdh_lite.recipe import PAPER, SMALL, recipe_from_json


def test_schedules():
    recipe = replace(
        SMALL, steps=2000, temperature_decay=0.5, crash_reward_end=-60, crash_reward_growth=0.5
    )
    steps = (0, 500, 1000, 1800)
    assert [recipe.training_rewards_at(s).crash for s in steps] == [-5, -32.5, -60, -60]
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
        ("replay_prefill", 60_000),
        ("environments", 200),
        ("hidden", (256, 0)),
        ("temperature", float("nan")),
    ],
)
def test_impossible_recipes_name_the_field(field, value):
    with pytest.raises(InputError, match=f"recipe paper: {field} is .* must be"):
        replace(PAPER, **{field: value})


def test_a_run_in_which_nothing_would_be_learned_is_refused():
    with pytest.raises(InputError, match="replay_prefill is 25000, must be at most steps, 20000"):
        replace(PAPER, steps=20_000)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ([], "unknown recipe kind"),
        ({"kind": []}, "unknown recipe kind"),
        ({"kind": "Recipe"}, "name is missing"),
        ({"kind": "Recipe", "name": "a", "wings": 2}, "'wings' is no field"),
        ({"kind": "Recipe", "name": "a", "hidden": ["a"]}, "hidden is .* each a whole number"),
    ],
)
def test_what_is_no_recipe_is_named(values, named):
    with pytest.raises(InputError, match=named):
        recipe_from_json(values)
