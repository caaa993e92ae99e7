from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from torch.nn.functional import cross_entropy

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.beyond.recipes import ImitationRecipe
from uavdh_lite.beyond.reinforce import Reinforced
from uavdh_lite.beyond.symmetry import SYMMETRIES, turned, turned_actions
from uavdh_lite.environment import LAND
from uavdh_lite.evaluation import evaluate


@pytest.fixture(scope="module")
def recipe(quick):
    """A tiny network that sees everything, and copies the genie."""
    return replace(
        ImitationRecipe(**asdict(quick)),
        failsafe=True,
        told=True,
        exploring_starts=0.3,
        own_starts=0.3,
        environments=16,
        batch_size=32,
        replay_prefill=320,
        learning_rate=3e-3,
    )


def trainer(corridor, corridor_scenario, recipe, steps):
    run = Reinforced(corridor_scenario, replace(recipe, steps=steps), 0, corridor)
    while not run.finished:
        run.step()
    return run


@pytest.fixture(scope="module")
def run(corridor, corridor_scenario, recipe):
    """A run that several tests look at, and none changes but by drawing more."""
    return trainer(corridor, corridor_scenario, recipe, 1600)


def test_the_memory_holds_what_the_planner_does(run):
    batch = run.replay.sample(200, np.random.default_rng(0))
    plans = Genie(run.environment, beam=1, grow=False).plans(batch.state)
    values = {(plan.value, plan.actions[0]) for plan in plans}
    # The best plan from here may begin otherwise, after other luck, but hardly ever does.
    same = np.array([plan.actions[0] for plan in plans]) == batch.action
    assert len(values) > 10 and same.mean() > 0.9


def test_flights_begin_where_the_learner_has_flown_once_it_has_learned_and_can_land(
    corridor, corridor_scenario, recipe
):
    """Without the failsafe it is often too late for that."""
    recipe = replace(recipe, own_starts=1.0, exploring_starts=0.0, failsafe=False)
    run = Reinforced(corridor_scenario, recipe, 0, corridor)
    assert run.from_start.all()
    while run.from_start.any() and run.steps < 1600:
        run.step()
    assert run.updates and not run.from_start.any()
    plans = [*run.plans, *(actions for _, actions, _ in run.waiting)]
    assert all(actions[-1] == LAND for actions in plans)


def test_starts_are_of_every_kind_and_plans_land(run, corridor_scenario):
    planned = [flight for _ in range(5) for flight in run._planned()]
    ordinary = np.array([flight[0] for flight in planned])
    assert 0.2 < ordinary.mean() < 0.6
    assert all(actions[-1] == LAND for _, actions, _ in planned)
    longest = corridor_scenario.flying_time[1]
    times = np.array([len(actions) for _, actions, _ in planned])
    assert times[~ordinary].min() < corridor_scenario.flying_time[0] <= times[ordinary].min()
    assert times.max() <= longest


def test_the_loss_is_the_cross_entropy_over_the_eight_views(run):
    batch = run.replay.sample(32, np.random.default_rng(0))
    map, time, allowed = run.learner.observation(batch.state)
    inner = run.learner.online.network  # without the mask
    losses = []
    for row, action in enumerate(batch.action):
        symmetry = SYMMETRIES[row % 8]
        scores = inner(turned(map[[row]], *symmetry), time[[row]])[:, turned_actions(*symmetry)]
        masked = scores.masked_fill(~allowed[[row]], -torch.inf)
        losses.append(cross_entropy(masked, torch.tensor([action])))
    loss = run.learner.loss(batch, run.learner.targets(batch))
    assert loss.item() == pytest.approx(torch.stack(losses).mean().item(), rel=1e-4)


@pytest.mark.long
@pytest.mark.longest
def test_it_learns_to_fly_the_corridor_by_what_the_genie_does(corridor, corridor_scenario, recipe):
    run = trainer(corridor, corridor_scenario, recipe, 14_400)
    returns = [
        evaluate(run.environment, policy, corridor_scenario, 60, seed=0).returns.mean()
        for policy in (run.agent, Genie(run.environment))
    ]
    assert returns[0] > 0.85 * returns[1] > 0
