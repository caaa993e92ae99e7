"""The command recorded with a run is that of the run: today's program reads its recipe from it."""

import json
import shlex
from pathlib import Path

import pytest

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.cli.main import main
from uavdh_lite.recipe import Recipe

RUNS = Path(__file__).parents[2] / "data" / "runs"
RECORDS = sorted(RUNS.glob("*/about.json"))
STUDIES = [path for path in RECORDS if "ablation" in json.loads(path.read_text())["command"]]


class Begun(Exception):
    """A command has read its options and would train now."""


@pytest.fixture
def begun(monkeypatch):
    """A function: what a command would train.

    The recipe, the scenario and the seed; in a study the variants, the scenario and None.
    """

    def train(scenario, recipe, seed, **rest):
        raise Begun(recipe, scenario, seed)

    def study(scenario, variants, *rest):
        raise Begun(variants, scenario, None)

    for name in ("Trainer", "OverlappedTrainer"):
        monkeypatch.setattr(f"uavdh_lite.training.{name}", train)
    monkeypatch.setattr("uavdh_lite.experiments.ablation.run_study", study)
    monkeypatch.setattr("uavdh_lite.checkpoint.load_agent", lambda path: None)

    def begin(command):
        with pytest.raises(Begun) as told:
            main(shlex.split(command)[3:])
        return told.value.args

    return begin


def agree(about, told, variant):
    """The recipe, the scenario and the seed of a run are those that its command told."""
    variants, scenario, seed = told
    recipe = variants[variant] if seed is None else variants
    assert Recipe.from_json(about["recipe"]) == recipe
    assert scenario.name == about["scenario"]["name"] and seed in (None, about["seed"])


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.parent.name)
def test_a_run_is_what_its_command_says(path, begun):
    record = json.loads(path.read_text())
    runs = record.get("runs", {path.parent.name: record})
    for name, about in runs.items():
        agree(about, begun(about["command"]), name.rpartition("-")[0])


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.parent.name)
def test_a_study_is_what_its_command_says(path, begun):
    record = json.loads(path.read_text())
    told = begun(record["command"])
    assert {name.rpartition("-")[0] for name in record["runs"]} == set(told[0])
    for name, about in record["runs"].items():
        agree(about, told, name.rpartition("-")[0])


@pytest.mark.parametrize("name", shipped_agents())
def test_a_shipped_agent_is_what_its_command_says(name, begun):
    agent = load_agent(name)
    about = {"recipe": agent.recipe.as_json(), "scenario": {"name": agent.scenario.name}}
    agree(about | agent.training, begun(agent.training["command"]), None)
