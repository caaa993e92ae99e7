"""A small world that both learners must solve: fly to the device, collect, fly back, land."""

from dataclasses import replace

import pytest

from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.training import Trainer

QUANTILE = {"steps": 16_000, "learning_rate": 3e-3, "quantiles": 8, "huber_delta": 1.0}
DDQN = {
    "steps": 12_000,
    "hidden": (64,),
    "batch_size": 64,
    "learning_rate": 3e-3,
    "target_update_rate": 0.05,
    "temperature": 1.0,
    "crash_reward": -5.0,
    "crash_reward_end": -20.0,
    "crash_reward_growth": 0.75,
}


@pytest.mark.parametrize(
    ("changes", "least"),
    [
        pytest.param(DDQN, 0.9, id="ddqn"),
        pytest.param(QUANTILE, 0.8, id="quantile", marks=pytest.mark.long),
        pytest.param(QUANTILE | {"failsafe": True}, 0.8, id="quantile-failsafe"),
    ],
)
def test_a_corridor_world_is_solved_in_seconds(corridor, corridor_scenario, quick, changes, least):
    """From reward alone."""
    trainer = Trainer(corridor_scenario, replace(quick, **changes), seed=0, city=corridor)
    environment = Environment(corridor)

    def cral():
        flights = evaluate(environment, trainer.agent, corridor_scenario, 300, seed=1)
        return flights.records()["collection_ratio_and_landed"].mean()

    before = cral()
    while not trainer.finished:
        trainer.step()
    assert before < 0.3
    assert cral() > least
