from dataclasses import replace

import pytest

from uavdh_lite.errors import InputError
from uavdh_lite.recipe import LITE, PAPER, RECIPES, Recipe, find_recipe


def test_schedules():
    recipe = replace(
        LITE,
        steps=1000,
        temperature_decay=0.5,
        crash_reward=-10,
        crash_reward_end=-60,
        crash_reward_growth=0.5,
    )
    assert [recipe.rewards_at(s).crash for s in (0, 250, 500, 900)] == [-10, -35, -60, -60]
    assert [recipe.temperature_at(s) for s in (0, 250, 500, 900)] == pytest.approx(
        [2.0, 1.05, 0.1, 0.1]
    )
    assert recipe.learning_rate_at(500) == pytest.approx(3e-4)
    assert recipe.learning_rate_at(1000) == 0
    assert PAPER.temperature_at(0) == PAPER.temperature_at(10**6) == 0.1


def test_the_paper_recipe_is_the_papers():
    assert (PAPER.discount, PAPER.target_update_rate, PAPER.learning_rate) == (0.95, 0.005, 3e-5)
    assert (PAPER.replay_capacity, PAPER.replay_prefill, PAPER.batch_size) == (50_000, 25_000, 128)
    assert (PAPER.environments, PAPER.return_steps, PAPER.huber_delta) == (1, 1, None)
    assert (PAPER.strides, PAPER.hidden, PAPER.layer_norm) == ((1, 1), (256, 256, 256), False)
    assert PAPER.rewards_at(0).crash == PAPER.rewards_at(PAPER.steps).crash == -150
    assert PAPER.amsgrad
    assert PAPER.learning_rate_at(10**6) == 3e-5 and PAPER.exploring_starts == 0


def test_recipe_round_trip():
    for recipe in RECIPES.values():
        assert Recipe.from_json(recipe.as_json() | {"hidden": list(recipe.hidden)}) == recipe


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("steps", 0),
        ("discount", 1.5),
        ("temperature", 0.0),
        ("learning_rate_end", -1.0),
        ("huber_delta", 0.0),
        ("replay_prefill", 60_000),
        ("environments", 200),
        ("hidden", (256, 0)),
        ("data_scale", -1.0),
        ("exploring_starts", 2.0),
        ("leak", -0.1),
    ],
)
def test_impossible_recipes_name_the_field(field, value):
    with pytest.raises(InputError, match=f"recipe paper: {field} is .* must be"):
        replace(PAPER, **{field: value})


def test_unknown_recipe_lists_the_known_ones():
    with pytest.raises(InputError, match="unknown recipe 'secret': choose one of paper, lite"):
        find_recipe("secret")
