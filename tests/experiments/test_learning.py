"""A small world that the quantile learner must solve, with the failsafe and without."""

from dataclasses import replace

import pytest

from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.training import Trainer


@pytest.mark.parametrize("failsafe", [True, False])
def test_solves_a_corridor_world_in_seconds(corridor, corridor_scenario, quick, failsafe):
    recipe = replace(
        quick, steps=16_000, learning_rate=3e-3, quantiles=8, huber_delta=1.0, failsafe=failsafe
    )
    trainer = Trainer(corridor_scenario, recipe, seed=0, city=corridor)
    environment = Environment(corridor)

    def cral():
        flights = evaluate(environment, trainer.agent, corridor_scenario, 300, seed=1)
        return flights.records()["collection_ratio_and_landed"].mean()

    before = cral()
    while not trainer.finished:
        trainer.step()
    assert before < 0.3
    assert cral() > 0.8
