"""The list of recorded studies: runs become tables and agents, and it is known what made them."""

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import record
from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.checkpoint import load, load_agent, save, shipped_agents
from uavdh_lite.errors import InputError
from uavdh_lite.experiments import runs
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import read_json, read_table, write_json
from uavdh_lite.training import Trainer

LIST = """
[same]
0123456789abcdef = "only a case was added"

[studies.tiny]
what = "Two short runs"
command = "python -m uavdh_lite study {0} && python -m uavdh_lite study {0} --out runs/tiny/more"
runs = {{ first = "one", second = "other" }}
""".format("--scenario village --recipe small")
TINY = replace(
    find_recipe("small"), steps=5_200, replay_prefill=5_000, validation_interval=2_600,
    validation_episodes=20, hidden=(8,),
)  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A folder with two runs."""
    out = tmp_path_factory.mktemp("trained")
    other = BeyondRecipe(**asdict(TINY) | {"discount": 0.9, "failsafe": True})
    for name, recipe in {"one": TINY, "other": other}.items():
        trainer = Trainer(find_scenario("village"), recipe, seed=3)
        runs.train(trainer, out / f"{name}-3", show_progress=False)
    return out


@pytest.fixture
def folder(trained, tmp_path, monkeypatch) -> Path:
    """A folder with these runs, and a list that has them as a study."""
    shutil.copytree(trained, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr(record, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(record, "AGENTS", tmp_path / "agents")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "list.toml").write_text(LIST)
    return tmp_path


def test_runs_become_tables_with_what_changes_and_rounded_agents(folder):
    """Variants may have recipes of two kinds."""
    assert record.state("tiny") == "not recorded"
    of_a_seed_that_is_gone = folder / "agents/tiny-first-2.safetensors"
    of_a_seed_that_is_gone.parent.mkdir()
    of_a_seed_that_is_gone.touch()
    record.gather("tiny", folder, "HEAD")
    assert not of_a_seed_that_is_gone.exists()
    about = read_json(folder / "runs/tiny.json")
    assert about["runs"]["first-3"]["steps"] == 5_200
    assert list(about["runs"]) == ["first-3", "second-3"]
    second = {"kind": "BeyondRecipe", "discount": 0.9, "failsafe": True}
    assert about["recipes"]["second"].items() >= second.items()
    assert about["recipes"]["first"]["hidden"] == [8]
    table = read_table(folder / "runs/tiny.csv.gz")
    own = read_table(folder / "one-3/validation.csv")
    assert table["variant"].tolist() == ["first"] * 2 + ["second"] * 2
    np.testing.assert_array_equal(table["return"][:2], own["return"])
    whole = load_agent(folder / "one-3/best.safetensors").network.state_dict()
    kept = load_agent(folder / "agents/tiny-first-3.safetensors").network.state_dict()
    assert all(torch.equal(kept[name], whole[name].half().float()) for name in whole)


def test_only_finished_runs_of_a_known_program_are_recorded_under_their_own_names(folder):
    def refused(message, *program):
        with pytest.raises(InputError, match=message):
            record.gather("tiny", folder, *program)
        assert not (folder / "agents").exists()

    refused("which program made these runs")
    shutil.copytree(folder / "other-3", folder / "other-3.bak")
    refused(r"other-3\.bak: is seed 3", "HEAD")
    shutil.rmtree(folder / "other-3.bak")
    about = read_json(folder / "other-3/about.json")
    write_json(folder / "other-3/about.json", about | {"steps": 1_400})
    refused("other-3: has 1400 of 5200 steps", "HEAD")
    (folder / "runs/list.toml").write_text(f"{LIST}steps = 1400\n")
    refused("one-3: has 5200 of 1400 steps", "HEAD")
    write_json(
        folder / "one-3/about.json", read_json(folder / "one-3/about.json") | {"steps": 1_400}
    )
    record.gather("tiny", folder, "HEAD")  # as the study has them


def test_runs_of_another_study_and_agents_of_another_run_are_not_recorded(folder):
    """Whatever their folders are called; seed 4 and a `leak` that is none are copies."""
    names = {"one": "as_it_is", "other": "leak=0"}
    text = LIST.replace('"one"', '"as_it_is"').replace('"other"', '"leak=0"')
    (folder / "runs/list.toml").write_text(text)
    for name, called in names.items():
        (folder / f"{name}-3").rename(folder / f"{called}-3")
    shutil.rmtree(folder / "leak=0-3")
    shutil.copytree(folder / "as_it_is-3", folder / "leak=0-3")
    record.gather("tiny", folder, "HEAD")  # a leak of 0 is what TINY has
    (folder / "agents/tiny-second-3.safetensors").unlink()
    assert record.state("tiny") == "recorded without tiny-second-3.safetensors"
    best, about = folder / "leak=0-3/best.safetensors", folder / "leak=0-3/about.json"
    content, right = best.read_bytes(), read_json(about)
    recipe, scenario = right["recipe"], right["scenario"]
    for change, named in (
        ({"recipe": recipe | {"leak": 0.1}}, "leak=0-3: another leak"),
        ({"recipe": recipe | {"discount": 0.9}}, "leak=0-3: another discount"),
        ({"scenario": scenario | {"name": "harbour"}}, "leak=0-3: another scenario and"),
        ({"scenario": scenario | {"data": [1, 2]}}, "leak=0-3: another scenario than"),
        ({"cities": "0"}, "leak=0-3: another cities"),
        ({"threads": 2}, "leak=0-3: another number of threads"),
        ({}, "best.safetensors: not the best agent of this run"),
    ):
        write_json(about, right | change)
        if not change:
            tensors, kept = load(best, "agent")
            kept["training"]["seed"] = 4
            save(best, "agent", tensors, kept)
        with pytest.raises(InputError, match=named):
            record.gather("tiny", folder, "HEAD")
        best.write_bytes(content)
    assert not (folder / "agents/tiny-second-3.safetensors").exists()


def test_a_study_is_of_today_by_the_digest_that_it_was_recorded_with(folder, monkeypatch):
    record.gather("tiny", folder, "HEAD")
    assert record.state("tiny") == ""
    today = record.digest()
    monkeypatch.setattr(record, "digest", lambda commit="": "fedcba9876543210")
    assert today in record.state("tiny")  # the program has changed
    record.gather("tiny", folder, "HEAD")
    monkeypatch.setattr(record, "digest", lambda commit="": today)
    assert "fedcba9876543210" in record.state("tiny")
    text = (folder / "runs/list.toml").read_text().replace("0123456789abcdef", "fedcba9876543210")
    (folder / "runs/list.toml").write_text(text)
    assert record.state("tiny") == ""  # the list says that it computes the same


def test_the_digest_is_of_what_world_and_learning_compute(tmp_path, monkeypatch):
    today = record.digest()
    with np.load(record.GOLDEN, allow_pickle=False) as arrays:
        values = {name: arrays[name] for name in arrays.files}

    def changed(part: str) -> str:
        name = next(n for n, v in values.items() if n.startswith(part) and v.dtype.kind == "f")
        np.savez(tmp_path / "golden.npz", **(values | {name: values[name] + 1}))
        return record.digest()

    monkeypatch.setattr(record, "GOLDEN", tmp_path / "golden.npz")
    assert changed("learning") != today != changed("observations")
    assert changed("flights") == today


def test_what_is_recorded_is_of_today_or_said_to_be_outstanding(monkeypatch):
    listed, today = record.studies(), record.digest()
    monkeypatch.setattr(record, "digest", lambda: today)  # is not computed for each
    for study, entry in listed.items():
        assert "outstanding" in entry or record.state(study) == "", study
    index = (record.ROOT / "docs/results/index.md").read_text(encoding="utf-8")
    assert ("{generated} outstanding\n" in index) == any(
        "outstanding" in e for e in listed.values()
    )
    tables = record.RUNS.glob("*.csv.gz")
    names = {path.name.split(".")[0].removesuffix("-training") for path in tables}
    assert names <= listed.keys()
    agents = {path.stem for path in record.AGENTS.glob("*.safetensors")}
    made_by = {
        f"{study}-{variant}-{seed}"
        for study, entry in listed.items()
        for variant in entry.get("runs", ())
        for seed in range(3)
    }
    assert agents and agents <= made_by


def test_every_shipped_agent_is_named_by_the_study_that_makes_it():
    ships = {entry["ships"]: study for study, entry in record.studies().items() if "ships" in entry}
    assert sorted(ships) == shipped_agents()
    for name, study in ships.items():
        (kept, *_) = sorted(record.AGENTS.glob(f"{study}-*-0.safetensors")) or [None]
        shipped = record.SHIPPED / f"{name}.safetensors"
        assert kept is None or kept.read_bytes() == shipped.read_bytes(), name


def test_a_command_makes_its_runs_and_they_are_recorded(folder, monkeypatch):
    def run(command, cwd, check):
        name, out = lines.pop(0)
        words = " ".join([*command[1:4], *command[-4:]])
        assert words == f"-m uavdh_lite study --out {out} --jobs 2"
        (cwd / "runs/tiny").mkdir(exist_ok=True)
        (folder / name).rename(cwd / "runs/tiny" / name)

    lines = [("one-3", "runs/tiny"), ("other-3", "runs/tiny/more")]

    monkeypatch.setattr(record, "ROOT", folder)
    monkeypatch.setattr(record.subprocess, "run", run)
    monkeypatch.setattr(record, "digest", lambda commit="": "0123456789abcdef")
    record.make("tiny", jobs=2)
    assert record.state("tiny") == "" and not lines
    monkeypatch.setattr(record, "digest", lambda commit="": "fedcba9876543210")
    with pytest.raises(InputError, match="begun by another program"):
        record.make("tiny")
    (folder / "runs/tiny/golden").unlink()
    with pytest.raises(InputError, match="begun by another program"):
        record.make("tiny")  # by which is not known
