"""ONNX files decide as the agents that they were made from."""

import json
from dataclasses import asdict
from itertools import combinations

import numpy as np
import onnxruntime
import pytest

from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.bridges.onnx import TOLERANCE, export_onnx
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError
from uavdh_lite.training import Trainer

KINDS = {"failsafe": True, "told": True, "pooling": 2}
SHIPPED = [
    pytest.param("manhattan_ddqn", "manhattan", marks=pytest.mark.long),
    ("any_city", "village"),
]


def export(agent, path):
    """Export, and ask the file about states of its own; returns its metadata."""
    assert export_onnx(agent, path, states=200) < TOLERANCE
    session = onnxruntime.InferenceSession(path)
    start = agent.scenario.sample(agent.environment, 7, np.random.default_rng(1))
    arrays = [part.numpy() for part in agent.observation(start)]
    names = [one.name for one in session.get_inputs()]
    assert names == ["map", "time", "allowed"][: len(arrays)]
    (q_values,) = session.run(["q_values"], dict(zip(names, arrays, strict=True)))
    assert np.allclose(q_values, agent.q_values(start).numpy(), atol=TOLERANCE)
    return json.loads(session.get_modelmeta().custom_metadata_map["uavdh_lite"])


@pytest.mark.long
@pytest.mark.parametrize("kinds", list(combinations(KINDS, 2)))
def test_every_pair_of_kinds_of_agents(tmp_path, corridor, corridor_scenario, quick, kinds):
    """A tiny network, as it is before training; of the shipped agents one has none, one all."""
    tiny = {"kernels": 2, "hidden": (8,), "strides": (1,), "kernel_size": 2, "local_size": 5}
    recipe = BeyondRecipe(**(asdict(quick) | tiny | {kind: KINDS[kind] for kind in kinds}))
    agent = Trainer(corridor_scenario, recipe, 0, corridor).agent
    export(agent, tmp_path / "a.onnx")


@pytest.mark.parametrize("name, city", SHIPPED)
def test_a_shipped_agent(tmp_path, name, city):
    agent = load_agent(name).over(City.load(city))
    about = export(agent, tmp_path / "a.onnx")
    assert about["actions"] == list(ACTIONS) and about["size"] == 16
    assert about["recipe"]["data_scale"] == agent.recipe.data_scale


@pytest.mark.parametrize("error", [2 * TOLERANCE, np.nan])
def test_a_file_that_decides_otherwise_is_not_written(tmp_path, monkeypatch, error):
    agent = load_agent("manhattan_ddqn_early")
    q_values = type(agent).q_values
    monkeypatch.setattr(type(agent), "q_values", lambda *args: q_values(*args) + error)
    with pytest.raises(InputError, match="not written"):
        export_onnx(agent, tmp_path / "a.onnx", states=50)
    assert not list(tmp_path.iterdir())
