"""A run in its folder."""

import json
import re
import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent, save, save_agent
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.experiments import runs
from uavdh_lite.experiments.runs import SAVED, restore_run, save_run, train
from uavdh_lite.experiments.stopping import SIGNALS, deferred_stop
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import recipe_from_json
from uavdh_lite.storage import read_table
from uavdh_lite.training import BIN, Trainer


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_noted_and_a_second_one_interrupts(number):
    before, notes = [signal.getsignal(each) for each in SIGNALS], []
    with deferred_stop(lambda: notes.append(number)) as asked:
        assert not asked()
        signal.raise_signal(number)
        assert asked() and notes == [number]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert [signal.getsignal(each) for each in SIGNALS] == before


@pytest.fixture(scope="module")
def finished(corridor, corridor_scenario, quick, tmp_path_factory):
    """What begins a run, and the folder of one that has ended."""
    options = {"steps": BIN + 50, "environments": 50, "batch_size": 64, "validation_interval": 2500}
    recipe, out = replace(quick, **options), tmp_path_factory.mktemp("finished")
    train(Trainer(corridor_scenario, recipe, 3, corridor), out, command="a command")
    return lambda: Trainer(corridor_scenario, recipe, 3, corridor), out


def content(folder):
    """The bytes of each file, sorted: safetensors writes its metadata in any order."""
    return {path.name: sorted(path.read_bytes()) for path in folder.iterdir()}


def test_files_of_a_run(finished):
    begin, out = finished
    names = ["about.json", "best.safetensors", "lock", "training.csv", SAVED, "validation.csv"]
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    curve, validation = read_table(out / "training.csv"), read_table(out / "validation.csv")
    assert curve["steps"].tolist() == [BIN] and (curve["episodes"] > 0).all()
    assert validation["steps"].tolist() == [2500, 5000, 5050]
    assert (np.diff(validation["seconds"]) >= 0).all() and validation["seconds"][-1] > 0
    kept = load_agent(out / "best.safetensors").training
    assert kept["validation"]["return"] == pytest.approx(validation["return"].max(), abs=1e-3)
    assert kept["steps"] == kept["validation"]["steps"]
    assert kept["command"] == "a command" and kept["seed"] == 3
    assert kept["threads"] == torch.get_num_threads()
    about, own = json.loads((out / "about.json").read_text()), begin()
    assert about["steps"] == 5_050 and about.items() >= provenance().items()
    assert recipe_from_json(about["recipe"]) == own.recipe
    assert about["scenario"]["name"] == own.scenario.name


def test_another_run_is_not_restored(trainer, tmp_path, corridor_scenario, quick, corridor):
    path = tmp_path / "t.safetensors"
    save_run(path, trainer())
    tiny = type(corridor).from_text("tiny", "L .\n. .")
    for other, difference in (
        (trainer(seed=5), "another seed .*0 there, 5 here"),
        (trainer(discount=0.9), "another discount than asked for: 0.95 there, 0.9 here"),
        (Trainer(corridor_scenario, quick, 0, tiny), "its cities have other cells"),
        (Trainer(corridor_scenario, quick, 0, (corridor, tiny)), "its cities have other cells"),
        (Trainer(replace(corridor_scenario, data=(1, 2)), quick, 0, corridor), "another data"),
    ):
        with pytest.raises(InputError, match=difference) as refused:
            restore_run(path, other)
        assert not re.search("[0-9a-f]{64}", str(refused.value))
    restore_run(path, Trainer(replace(corridor_scenario, city="./it.png"), quick, 0, corridor))
    renamed = replace(corridor, name="avenue")
    restore_run(path, Trainer(corridor_scenario, quick, 0, renamed))  # the cells decide


def test_a_state_without_the_parts_of_this_run_is_refused(trainer, tmp_path):
    path = tmp_path / "t.safetensors"
    save_run(path, trainer())
    tensors, values = load(path, "training")
    for lost in ({"values": {}}, {"values": {"cities": values["cities"]}}, {"tensors": {}}):
        save(path, "training", *({"tensors": tensors, "values": values} | lost).values())
        with pytest.raises(InputError, match=r"t\.safetensors: "):
            restore_run(path, trainer())


def test_a_folder_with_a_run_or_a_part_of_one_is_refused_and_nothing_there_changes(
    finished, tmp_path
):
    begin, folder = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    before = content(tmp_path)
    train(begin(), tmp_path, resume=True, command="another")  # a finished run stays as it is
    with pytest.raises(InputError, match="holds a run already"):
        train(begin(), tmp_path)
    assert content(tmp_path) == before
    best, own = tmp_path / "best.safetensors", load_agent(tmp_path / "best.safetensors")
    for training in ({"seed": 4}, {"steps": 10}, None):
        best.unlink()
        if training:
            save_agent(best, replace(own, training=own.training | training))
        with pytest.raises(InputError, match=r"best\.safetensors: not the best agent of this run"):
            train(begin(), tmp_path, resume=True)
    save_agent(best, own)
    (tmp_path / SAVED).unlink()
    with pytest.raises(InputError, match=f"holds a run without its {SAVED}"):
        train(begin(), tmp_path, resume=True)
    assert content(tmp_path) == {name: each for name, each in before.items() if name != SAVED}


def test_the_same_call_with_resume_begins_and_continues_and_ends(trainer, tmp_path, monkeypatch):
    """Killed between the tables and the state, with a half-written file: all is mended."""
    whole, out = tmp_path / "whole", tmp_path / "run"
    train(trainer(steps=1200), whole)
    saved = []
    with monkeypatch.context() as patched:
        patched.setattr(
            runs, "save_run", lambda *run: 1 / 0 if saved else saved.append(save_run(*run))
        )
        with pytest.raises(ZeroDivisionError):
            train(trainer(steps=1200), out, resume=True)
    assert load(out / SAVED, "training")[1]["steps"] == 0 and (out / "validation.csv").exists()
    (out / ".best-0123.unfinished.safetensors").write_bytes(b"half")
    train(trainer(steps=1200), out, resume=True)
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}
    for name, kind in ((SAVED, "training"), ("best.safetensors", "agent")):
        ours, theirs = (load(folder / name, kind)[0] for folder in (out, whole))
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    rows = [read_table(folder / "validation.csv") for folder in (out, whole)]
    assert rows[0]["return"].tolist() == rows[1]["return"].tolist()


def test_a_run_that_is_asked_to_stop_saves_itself_and_says_how_to_go_on(trainer, tmp_path, capsys):
    own = trainer(steps=400)
    with pytest.raises(KeyboardInterrupt):
        train(own, tmp_path, stop=lambda: own.steps >= 160)
    assert "stopped after 160 steps; add --resume" in capsys.readouterr().out
    assert load(tmp_path / SAVED, "training")[1]["steps"] == 160


def test_a_run_is_saved_by_time_too_and_goes_on_only_with_its_own_threads(
    trainer, tmp_path, monkeypatch
):
    monkeypatch.setattr(runs, "SAVE_SECONDS", 0)
    saved = []
    own = trainer(steps=400, validation_interval=400)
    with monkeypatch.context() as patched:
        patched.setattr(runs, "save_run", lambda path, run: saved.append(run.steps))
        train(own, tmp_path / "a")
    assert saved[:3] == [0, 16, 32]
    train(trainer(), tmp_path / "b", stop_after=160)
    with pytest.raises(InputError, match=r"another seed than asked for: 0 there, 1 here$"):
        train(trainer(1), tmp_path / "b", resume=True)
    torch.set_num_threads(2)
    try:
        with pytest.raises(InputError, match="another threads than asked for: 1 there, 2 here"):
            train(trainer(), tmp_path / "b", resume=True)
    finally:
        torch.set_num_threads(1)


@pytest.mark.parametrize("part", ["loss", "weight"])
def test_a_run_that_diverges_ends_and_the_last_good_state_stays(trainer, tmp_path, part):
    """Whether it would be saved at a validation or because it is stopped."""

    def diverging():
        own = trainer(steps=800, validation_interval=400)

        def update(batch):
            if part == "weight":
                next(own.learner.online.parameters()).data[0] = torch.nan
            return torch.tensor(1.0 if part == "weight" else torch.nan)

        own.learner.update = update
        return own

    train(trainer(steps=800, validation_interval=400), tmp_path, stop_after=400)
    before = content(tmp_path)
    for stop_after in (480, None):
        with pytest.raises(TrainingDiverged, match=r"last good state is .*training\.safetensors"):
            train(diverging(), tmp_path, resume=True, stop_after=stop_after)
        assert content(tmp_path) == before
