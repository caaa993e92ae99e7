"""A run in its folder."""

import json

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import SAVED, VALIDATION_SEED, train, validate
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import recipe_from_json
from uavdh_lite.storage import read_table
from uavdh_lite.streams import Use
from uavdh_lite.training import BIN


def test_a_validation_is_a_row_of_means_and_says_if_the_return_is_the_highest(trainer):
    own = trainer()
    assert validate(own)  # the first one is
    flights = evaluate(
        own.environment, own.agent, own.scenario, 50, VALIDATION_SEED, Use.VALIDATION
    )
    (row,) = own.validation_rows
    for name, values in flights.records().items():
        assert row[name] == values.mean()
    assert not validate(own)  # it is the same
    own.validation_rows = [row | {"return": row["return"] - 1, "landed": 2.0}]
    assert validate(own)


def test_files_of_a_run(trainer, tmp_path):
    own = trainer(3, steps=2 * BIN + 50, environments=50, batch_size=64, validation_interval=2500)
    out = tmp_path / "run"
    best = train(own, out, command="python -m uavdh_lite train ...")
    names = ["about.json", "best.safetensors", "lock", "training.csv", SAVED, "validation.csv"]
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    curve, validation = read_table(out / "training.csv"), read_table(out / "validation.csv")
    assert curve["steps"].tolist() == [BIN, 2 * BIN] and (curve["episodes"] > 0).all()
    assert validation["steps"].tolist() == [2500, 5000, 7500, 10_000, 10_050]
    assert (np.diff(validation["seconds"]) >= 0).all() and validation["seconds"][-1] > 0
    kept = load_agent(best).training
    assert kept["validation"]["return"] == pytest.approx(validation["return"].max(), abs=1e-3)
    assert kept["steps"] == kept["validation"]["steps"]
    assert kept["command"].startswith("python -m uavdh_lite train") and kept["seed"] == 3
    assert kept["threads"] == torch.get_num_threads()
    about = json.loads((out / "about.json").read_text())
    assert about["steps"] == 10_050 and about.items() >= provenance().items()
    assert recipe_from_json(about["recipe"]) == own.recipe
    assert about["scenario"]["name"] == own.scenario.name


def test_a_folder_with_a_run_is_not_overwritten(trainer, tmp_path):
    train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="holds a run already"):
        train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="no run to resume"):
        train(trainer(steps=400), tmp_path / "empty", resume=True)
    assert not (tmp_path / "empty").exists()  # a refused run leaves nothing behind
    before = (tmp_path / SAVED).read_bytes()
    train(trainer(steps=400), tmp_path, resume=True)  # a finished run stays finished
    assert (tmp_path / SAVED).read_bytes() == before


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
    tensors, about = load(tmp_path / SAVED, "training")
    assert about["steps"] == BIN
    assert all(torch.isfinite(t).all() for t in tensors.values() if t.is_floating_point())
    agent = load_agent(tmp_path / "best.safetensors")
    assert all(torch.isfinite(p).all() for p in agent.network.parameters())
