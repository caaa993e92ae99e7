"""The channel belongs to the scenario: trainings, agents and commands take it from there."""

from dataclasses import replace

import pytest

from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.cli.main import main
from uavdh_lite.config import from_json
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import identity
from uavdh_lite.planners import Random
from uavdh_lite.scenario import Scenario

QUIET = Channel(cell_edge_snr_db=-25.0, fading_variance_los_db2=1.0, slots=2)


@pytest.fixture
def quiet(trainer):
    """A training over another channel, begun."""
    usual = trainer()
    scenario = replace(usual.scenario, channel=QUIET)
    return type(usual)(scenario, usual.recipe, 0, usual.environment.city)


def test_a_training_and_its_agent_have_the_scenarios_channel(quiet, tmp_path):
    assert quiet.environment.channel == QUIET
    assert from_json(Scenario, identity(quiet)["scenario"], "scenario") == quiet.scenario
    save_agent(tmp_path / "agent.safetensors", quiet.agent)
    agent = load_agent(tmp_path / "agent.safetensors")
    assert agent.environment.channel == QUIET
    assert agent.over(agent.city).environment.channel == QUIET
    paper = agent.over(agent.city, Channel())
    collected = [
        evaluate(one.environment, one, one.scenario, 20, 0).records()["collected"].mean()
        for one in (agent, paper)
    ]
    assert collected[0] < collected[1]


def test_an_agent_flies_over_another_channel_if_it_is_named(quiet, tmp_path):
    agent = quiet.agent
    with pytest.raises(InputError, match=r"cell_edge_snr_db -25, not -15.*over\(city, channel\)"):
        evaluate(Environment(agent.city), agent, agent.scenario, 2, 0)
    with pytest.raises(
        InputError, match=r"cell_edge_snr_db -25, not -15.*channel=scenario\.channel"
    ):
        evaluate(Environment(agent.city), Random(0), agent.scenario, 2, 0)
    save_agent(tmp_path / "best.safetensors", agent)
    typed = ["evaluate", "--checkpoint", str(tmp_path), "--episodes", "2"]  # a run's folder
    assert main(typed) == 0
    assert main([*typed, "--cell-edge-snr", "-25"]) == 0
