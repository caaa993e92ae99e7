"""The ideas from beyond the paper, in pairs and together: none may forget another."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from torch.nn.utils import parameters_to_vector

from uavdh_lite.beyond.recipes import IMITATION, TOLD, BeyondRecipe, ImitationRecipe
from uavdh_lite.beyond.reinforce import Reinforced
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import restore_run, save_run
from uavdh_lite.scenario import Scenario
from uavdh_lite.training import trainer_of

CITY = City.from_text("five", "L . N . . \n . . b . . \n . B . . L \n . . . N . \n b . . . .")
SMALLER = City.from_text("three", "L . . \n . b N \n . . .")
SCENARIO = Scenario("any", "five", (1, 3), (2.0, 9.0), (8, 20))

IDEAS = {
    "failsafe": {"failsafe": True},
    "told": {"told": True},
    "global-local": {"pooling": 2, "local_size": 5},
    "imitation": {"own_starts": 0.3, "exploring_starts": 0.3, "labels": 64},
}
SETS = [(), ("failsafe", "told"), ("global-local", "imitation"), tuple(IDEAS)]


def with_ideas(recipe, ideas):
    """The recipe with these ideas, a tiny network and a short run."""
    kind = ImitationRecipe if "imitation" in ideas else BeyondRecipe
    values = {field: value for idea in ideas for field, value in IDEAS[idea].items()}
    network = {"kernels": 2, "strides": (1,), "hidden": (8,), "batch_size": 16}
    run = {"steps": 96, "environments": 8, "replay_prefill": 32, "replay_capacity": 64}
    return replace(kind(**asdict(recipe)), **network, **run, **values)


@pytest.fixture(scope="module", params=SETS, ids=lambda ideas: "+".join(ideas) or "plain")
def recipe(request, quick):
    return with_ideas(quick, request.param)


def trainer_for(recipe, seed=0):
    return trainer_of(recipe)(SCENARIO, recipe, seed, CITY)


@pytest.fixture(scope="module")
def agent(recipe):
    return ran(trainer_for(recipe, seed=1)).agent


@pytest.fixture
def states(agent):
    return SCENARIO.sample_anywhere(agent.environment, 40, np.random.default_rng(0), spare_time=1)


def ran(trainer, steps=1000):
    while not trainer.finished and trainer.steps < steps:
        trainer.step()
    return trainer


def test_it_acts_by_its_values_and_the_failsafe_masks_them(recipe, agent, states):
    q_values, action = agent.q_values(states), agent.act(states)
    assert np.array_equal(action, q_values.argmax(dim=1))
    allowed = agent.environment.allowed_actions(states)
    assert np.array_equal(q_values.isinf(), ~allowed & recipe.failsafe)
    if recipe.failsafe:
        records = evaluate(agent.environment, agent, SCENARIO, 20, seed=0).records()
        assert records["landed"].all() and not records["sent_home"].any()


def test_it_is_the_same_after_saving_and_over_a_city_among_others(recipe, agent, states, tmp_path):
    save_agent(tmp_path / "a.safetensors", agent)
    loaded = load_agent(tmp_path / "a.safetensors")
    assert loaded.recipe == recipe and type(loaded.environment) is type(agent.environment)
    assert torch.equal(loaded.q_values(states), agent.q_values(states))
    small, beside = loaded.over(SMALLER), agent.over((SMALLER, CITY))
    start = SCENARIO.sample(small.environment, 20, np.random.default_rng(0))
    cells = {name: getattr(start, name) for name in ("uav_cell", "device_cells")}
    there = replace(start, **{name: cell // 3 * 5 + cell % 3 for name, cell in cells.items()})
    assert torch.equal(small.q_values(start), beside.q_values(there))
    with pytest.raises(InputError, match=r"up to 5 cells .* 6 .*six"):
        agent.over(City.from_text("six", "L....." + 5 * "\n......"))


def test_it_resumes_to_the_bit(recipe, tmp_path):
    path = tmp_path / "t.safetensors"
    whole, half, again = (trainer_for(recipe) for _ in range(3))
    save_run(path, ran(half, steps=64))
    restore_run(path, again)
    ours, theirs = (
        parameters_to_vector(ran(one).learner.online.parameters()) for one in (again, whole)
    )
    assert torch.equal(ours, theirs)


def test_an_imitation_is_trained_by_what_it_names():
    assert trainer_of(IMITATION) is Reinforced


def test_the_middle_of_a_small_map_is_all_of_it():
    assert replace(TOLD, observation="non_centred", pooling=0).told
    recipe = replace(TOLD, local_size=17, strides=(1,))
    observation = recipe.observation_for(recipe.environment_for(CITY))
    assert recipe.network_for(observation).network.local_size == observation.width == 9


def test_the_learning_rate_falls_twice():
    memory = {"replay_prefill": 500, "replay_capacity": 1000}
    rates = {"learning_rate": 0.4, "learning_rate_end": 0.0, "reward_learning_rate": 0.1}
    two = replace(IMITATION, steps=2000, labels=1000, **memory, **rates)
    rates = [two.learning_rate_at(steps) for steps in (0, 500, 1000, 1500, 2000)]
    assert rates == pytest.approx([0.4, 0.2, 0.1, 0.05, 0])
    for labels in (None, 5000):  # a run without a part for reward
        assert replace(two, labels=labels).learning_rate_at(1000) == pytest.approx(0.2)
