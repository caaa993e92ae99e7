"""A run in its folder."""

import json

import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.experiments.runs import train
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import Recipe
from uavdh_lite.storage import read_table
from uavdh_lite.training import BIN


def test_files_of_a_run(trainer, tmp_path):
    done = trainer(steps=2 * BIN + 50, environments=50, batch_size=64, validation_interval=2500)
    best = train(done, tmp_path / "run", command="python -m uavdh_lite train ...")
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "about.json",
        "best.safetensors",
        "lock",
        "training.csv",
        "training.safetensors",
        "validation.csv",
    ]
    curve = read_table(tmp_path / "run" / "training.csv")
    assert curve["steps"].tolist() == [BIN, 2 * BIN]
    assert (curve["episodes"] > 0).all()
    validation = read_table(tmp_path / "run" / "validation.csv")
    assert validation["steps"].tolist() == [2500, 5000, 7500, 10_000, 10_050]
    agent = load_agent(best)
    about = agent.training
    kept = about["validation"]["collection_ratio_and_landed"]
    assert kept == pytest.approx(validation["collection_ratio_and_landed"].max(), abs=1e-6)
    assert about["command"].startswith("python -m uavdh_lite train")
    assert about["seed"] == 0 and about["steps"] == about["validation"]["steps"]


def test_a_folder_with_a_run_is_not_overwritten(trainer, tmp_path):
    train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="holds a run already; add --resume"):
        train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="no run to resume there"):
        train(trainer(steps=400), tmp_path / "empty", resume=True)
    assert not (tmp_path / "empty").exists()  # a refused run leaves nothing behind
    train(trainer(steps=400), tmp_path, resume=True)  # a finished run stays finished


def test_a_run_tells_how_it_was_made(trainer, tmp_path):
    own = trainer(seed=3, steps=640, validation_episodes=5)
    train(own, tmp_path / "run", command="a command")
    about = json.loads((tmp_path / "run" / "about.json").read_text())
    assert about["command"] == "a command" and about["seed"] == 3
    assert about["steps"] == 640 and about["seconds"] > 0
    assert about.items() >= provenance().items()
    assert about["validation"]["steps"] == 640
    assert Recipe.from_json(about["recipe"]) == own.recipe
    assert about["scenario"]["name"] == own.scenario.name


def test_a_training_that_diverges_stops_with_its_last_good_state(trainer, tmp_path):
    own = trainer(steps=4 * BIN, environments=50, batch_size=64, validation_interval=BIN)
    update = own.learner.update

    def diverging(*minibatch):
        loss = update(*minibatch)
        if own.steps > 1.5 * BIN:
            with torch.no_grad():
                next(own.learner.online.parameters()).fill_(float("nan"))
        return loss

    own.learner.update = diverging
    with pytest.raises(TrainingDiverged, match=f"not finite after {2 * BIN} steps: the last good"):
        train(own, tmp_path)
    tensors, about = load(tmp_path / "training.safetensors", "training")
    assert about["steps"] == BIN
    assert all(torch.isfinite(t).all() for t in tensors.values() if t.is_floating_point())
    agent = load_agent(tmp_path / "best.safetensors")
    assert all(torch.isfinite(p).all() for p in agent.network.parameters())
