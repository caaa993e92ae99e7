"""The ideas from beyond the paper, alone, in pairs and together: none may forget another."""

import copy
from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
import pytest
import torch

from uavdh_lite.beyond.recipes import FINE_TUNE, QUANTILE, BeyondRecipe
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.labs.insight import saliency
from uavdh_lite.scenario import Scenario
from uavdh_lite.training import Trainer

CITY = City.from_text("five", "L . N . . \n . . b . . \n . B . . L \n . . . N . \n b . . . .")
SMALLER = City.from_text("three", "L . . \n . b N \n . . .")
SCENARIO = Scenario("any", "five", (1, 3), (2.0, 9.0), (8, 20))

IDEAS = {
    "failsafe": {"failsafe": True},
    "views": {"views": True},
    "global-local": {"pooling": 2, "local_size": 5},
    "quantiles": {"quantiles": 3, "huber_delta": 1.0},
    "advantage": {"advantage_learning": 0.5},
}
SETS = [*(pair for size in (0, 1, 2) for pair in combinations(IDEAS, size)), tuple(IDEAS)]


def with_ideas(recipe, ideas):
    """The recipe with these ideas, a tiny network and a short run."""
    values = {field: value for idea in ideas for field, value in IDEAS[idea].items()}
    network = {"kernels": 2, "strides": (1,), "hidden": (8,), "batch_size": 16}
    run = {"steps": 96, "environments": 8, "replay_prefill": 32, "replay_capacity": 64}
    return replace(BeyondRecipe(**asdict(recipe)), **network, **run, **values)


@pytest.fixture(scope="module", params=SETS, ids=lambda ideas: "+".join(ideas) or "plain")
def recipe(request, quick):
    return with_ideas(quick, request.param)


@pytest.fixture(scope="module")
def agent(recipe):
    return ran(Trainer(SCENARIO, recipe, 1, CITY)).agent


@pytest.fixture
def states(agent):
    return SCENARIO.sample_anywhere(agent.environment, 40, np.random.default_rng(0), spare_time=1)


def ran(trainer, steps=1000):
    while not trainer.finished and trainer.steps < steps:
        trainer.step()
    return trainer


def effects(agent, state, action):
    """How much each cell of the map adds to an action's Q-value, by central differences."""
    network = copy.deepcopy(agent.network).double()
    map, time, *allowed = agent.observation(state)
    count = map.numel()
    others = [one.expand(count, -1) for one in (time.double(), *allowed)]
    steps = 1e-6 * map * torch.eye(count, dtype=torch.float64).view(count, *map.shape[1:])
    with torch.no_grad():
        change = network(map + steps, *others) - network(map - steps, *others)
    return (change[:, action] / 2e-6).view(map.shape[1:]).abs().sum(0).numpy()


def test_it_acts_by_its_q_values_and_saliency_explains_what_it_does(recipe, agent, states):
    q_values, action = agent.q_values(states), agent.act(states)
    assert np.array_equal(action, q_values.argmax(dim=1))
    allowed = agent.environment.allowed_actions(states)
    assert np.array_equal(q_values.isinf(), ~allowed & recipe.failsafe)
    for episode in range(3):
        state = states[[episode]]
        expected = effects(agent, state, action[episode])
        assert np.allclose(saliency(agent, state), expected, rtol=1e-3, atol=1e-6)
    if recipe.failsafe:
        records = evaluate(agent.environment, agent, SCENARIO, 20, seed=0).records()
        assert records["landed"].all() and not records["sent_home"].any()


def test_it_is_the_same_after_saving_and_over_an_embedded_city(recipe, agent, states, tmp_path):
    save_agent(tmp_path / "a.safetensors", agent)
    loaded = load_agent(tmp_path / "a.safetensors")
    assert loaded.recipe == recipe and type(loaded.environment) is type(agent.environment)
    assert torch.equal(loaded.q_values(states), agent.q_values(states))
    small, embedded = loaded.over(SMALLER), agent.over(SMALLER.embedded(5))
    ours, theirs = (
        one.q_values(SCENARIO.sample(one.environment, 20, np.random.default_rng(0)))
        for one in (small, embedded)
    )
    assert torch.equal(ours, theirs)


def test_it_resumes_to_the_bit_with_and_without_an_agent_to_begin_with(recipe, agent, tmp_path):
    path = tmp_path / "t.safetensors"
    digests = []
    for first in (None, agent):
        whole, half, again, other = (
            Trainer(SCENARIO, recipe, 0, CITY, begin_with=begun)
            for begun in (first, first, first, None if first else agent)
        )
        ran(half, steps=64).save(path)
        again.restore(path)
        assert ran(again).agent.digest() == ran(whole).agent.digest()
        with pytest.raises(InputError, match="another begun_with"):
            other.restore(path)
        digests.append(whole.agent.digest())
    assert digests[0] != digests[1]


def test_it_goes_on_learning_over_a_smaller_city_but_not_over_a_larger_one(recipe, agent):
    smaller = Trainer(SCENARIO, recipe, 0, SMALLER, begin_with=agent)
    state, before = smaller.state, agent.digest()
    assert torch.equal(smaller.agent.q_values(state), agent.over(SMALLER).q_values(state))
    assert ran(smaller).agent.digest() != before == agent.digest(), "the agent does not learn"
    with pytest.raises(InputError, match=r"up to 5 cells .* 6 .*five"):
        Trainer(SCENARIO, recipe, 0, CITY.embedded(6), begin_with=agent)


def test_targets_of_all_ideas_at_once_by_hand(quick):
    """Quantiles of what the online mean chooses of the allowed actions, less α of the gap."""
    trainer = ran(Trainer(SCENARIO, with_ideas(quick, IDEAS), 0, CITY))
    learner = trainer.learner
    batch = trainer.replay.sample(100, trainer.generator)
    y = learner.targets(batch)
    map, time, allowed = learner.observation(batch.next_state)
    online, target = learner.online.network, learner.target.network  # without the mask
    chosen, quantiles = online(map, time), target.quantiles(map, time)
    map, time, allowed_before = learner.observation(batch.state)
    q_target = target(map, time)
    masked = gaps = 0
    for row, action in enumerate(batch.action):
        best = max(allowed[row].nonzero().flatten().tolist(), key=lambda a: chosen[row, a])
        gap = q_target[row][allowed_before[row]].max() - q_target[row, action]
        expected = batch.reward[row] + batch.discount[row] * quantiles[row, best] - 0.5 * gap
        assert torch.allclose(y[row], expected, atol=1e-5)
        masked += best != chosen[row].argmax()
        gaps += gap > 0
    assert masked and gaps, "the mask and the gap made no difference: nothing was tested"


def test_ideas_that_do_not_go_together_are_refused():
    with pytest.raises(InputError, match="huber_delta is None"):
        replace(QUANTILE, huber_delta=None)
    for recipe in (QUANTILE, replace(FINE_TUNE, pooling=0)):
        with pytest.raises(InputError, match="found non_centred"):
            replace(recipe, observation="non_centred")
