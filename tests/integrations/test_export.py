"""ONNX files decide as the agents that they were made from."""

import json
from dataclasses import replace

import numpy as np
import onnxruntime
import pytest
import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.cli.main import main
from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError
from uavdh_lite.export import TOLERANCE, export_onnx
from uavdh_lite.training import Trainer


def test_decisions_agree(tmp_path):
    agent = load_agent("manhattan_ddqn")
    assert export_onnx(agent, tmp_path / "a.onnx", states=200) < TOLERANCE
    session = onnxruntime.InferenceSession(tmp_path / "a.onnx")
    state = agent.scenario.sample(agent.city, 50, np.random.default_rng(1))  # another batch size
    (maps,), time = agent.observation(state)
    (q_values,) = session.run(None, {"map": maps.numpy(), "time": time.numpy()})
    assert np.allclose(q_values, agent.q_values(state).numpy(), atol=1e-3)
    assert (q_values.argmax(1) == agent(state)).mean() > 0.98
    about = json.loads(session.get_modelmeta().custom_metadata_map["uavdh_lite"])
    assert about["actions"] == list(ACTIONS) and about["data_scale"] == agent.recipe.data_scale
    assert about["failsafe"] is False
    assert "\n".join(about["city"]["rows"]) == agent.city.text


def test_global_and_local_maps(tmp_path, corridor, corridor_scenario, quick):
    recipe = replace(quick, observation="global_local", local_size=5, pooling=1, strides=(1,))
    agent = Trainer(corridor_scenario, recipe, 0, corridor).agent
    export_onnx(agent, tmp_path / "a.onnx", states=50)
    inputs = onnxruntime.InferenceSession(tmp_path / "a.onnx").get_inputs()
    assert [one.name for one in inputs] == ["global_map", "local_map", "time"]


def test_the_q_values_of_a_network_with_quantiles(tmp_path, corridor, corridor_scenario, quick):
    recipe = replace(quick, quantiles=8, failsafe=True)
    agent = Trainer(corridor_scenario, recipe, 0, corridor).agent
    export_onnx(agent, tmp_path / "a.onnx", states=50)
    session = onnxruntime.InferenceSession(tmp_path / "a.onnx")
    assert [one.shape[1] for one in session.get_outputs()] == [6]
    about = json.loads(session.get_modelmeta().custom_metadata_map["uavdh_lite"])
    assert about["failsafe"] is True


def test_a_file_that_decides_otherwise_is_not_written(tmp_path, monkeypatch):
    agent = load_agent("manhattan_ddqn_early")
    q_values = type(agent).q_values
    monkeypatch.setattr(
        type(agent), "q_values", lambda self, state: q_values(self, state) + torch.eye(6)[0]
    )
    with pytest.raises(InputError, match="not written, ONNX Runtime decides otherwise"):
        export_onnx(agent, tmp_path / "a.onnx", states=50)
    assert not list(tmp_path.iterdir())


def test_command(tmp_path, capsys):
    out = tmp_path / "agent.onnx"
    assert main(["export", "--checkpoint", "manhattan_ddqn_early", "--out", str(out)]) == 0
    assert out.stat().st_size > 900_000 and "decides as the agent" in capsys.readouterr().out
