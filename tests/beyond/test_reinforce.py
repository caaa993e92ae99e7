from copy import deepcopy
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
import torch
from torch.nn.functional import cross_entropy

from uavdh_lite.beyond.recipes import ImitationRecipe
from uavdh_lite.beyond.reinforce import FLIGHTS, SURE, Reinforced, advantages
from uavdh_lite.environment import State
from uavdh_lite.evaluation import evaluate


@pytest.fixture(scope="module")
def trained(corridor, corridor_scenario, quick):
    """A run with hardly any labels, after so many steps; those of one number share it."""

    values = {"failsafe": True, "told": True, "labels": 960, "replay_prefill": 320}
    rates = {"learning_rate": 1e-3, "reward_learning_rate": 1e-3}
    recipe = ImitationRecipe(**asdict(quick) | values | rates)

    @cache
    def once(steps):
        run = Reinforced(corridor_scenario, replace(recipe, steps=steps), 0, corridor)
        while not run.finished:
            run.step()
        return run

    return lambda steps: deepcopy(once(steps))


@pytest.fixture
def run(trained):
    """All labels are copied, and nothing is learned by reward yet."""
    return trained(960)


def test_a_flight_is_compared_with_the_others_of_its_mission():
    returns = np.array([8.0, *[1.0] * (FLIGHTS - 1), *[5.0] * FLIGHTS], np.float32)
    gain = advantages(returns)
    assert gain[0] == pytest.approx(-(FLIGHTS - 1) * gain[1])  # 7 above the others; -1 of them
    assert (gain[FLIGHTS:] == 0).all()
    assert gain.std() == pytest.approx(1, rel=1e-4)
    assert advantages(1000 * returns) == pytest.approx(gain)
    assert not advantages(np.zeros(2 * FLIGHTS, np.float32)).any()


def surprise_of(run, state, action):
    scores = run.learner.q_values(state)
    return cross_entropy(scores, torch.tensor(action), reduction="none").numpy()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_update_makes_actions_likelier_by_their_gain(run, sign):
    """A little: an action that has become so much likelier, or unlikelier, is not pushed on."""
    state = run.replay.sample(32, np.random.default_rng(0)).state
    action, gain = run.agent.act(state), np.full(32, sign, np.float32)
    before = surprise_of(run, state, action)
    run.learner.set_learning_rate(1e-3)
    for _ in range(10):
        run._update(state, action, gain, before)
    assert sign * (before - surprise_of(run, state, action)).mean() > 0.02
    for ratio, pushed in ((1 + sign * 0.3, False), (1 - sign * 0.3, True)):
        run.learner.optimiser.state.clear()
        before = surprise_of(run, state, action)
        run._update(state, action, gain, before + np.float32(np.log(ratio)))
        assert (surprise_of(run, state, action) != before).any() == pushed


def test_flights_draw_actions_and_know_which_were_unsure(run, corridor_scenario):
    start = corridor_scenario.sample(run.environment, 50, np.random.default_rng(0))
    flights, unsure, surprise = run._drawn_flights(start)
    flown = [(step, ~step.state.ended) for step in flights.history]
    state = State.concatenate([step.state[rows] for step, rows in flown])
    taken = np.concatenate([step.action[rows] for step, rows in flown])
    assert len(unsure) == len(state) == flights.steps.sum()
    shares = run.learner.q_values(state).softmax(1)
    assert (unsure == (shares.amax(1) < SURE).numpy()).all()
    assert 0 < (taken != shares.argmax(1).numpy()).mean() < 0.9
    assert np.exp(-surprise) == pytest.approx(shares.numpy()[np.arange(len(taken)), taken])


@pytest.mark.long
def test_reward_makes_a_poor_copy_better(trained, corridor_scenario):
    poor, better = (
        evaluate(run.environment, run.agent, corridor_scenario, 200, seed=0).returns.mean()
        for run in map(trained, (960, 20_000))
    )
    assert better > poor + 1


def test_learning_by_reward_begins_without_the_moments_of_copying(trained):
    run = trained(944)
    assert run.learner.optimiser.state
    run.step()
    assert run.steps == 960 and not run.learner.optimiser.state
