import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.cli.main import main
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.ablation import centring, deviations, run_study
from uavdh_lite.experiments.runs import SAVED
from uavdh_lite.recipe import LITE, PAPER
from uavdh_lite.storage import read_table

SHORT = (
    "--steps 6400 --validation-interval 800 --validation-episodes 5 --kernels 2 --hidden 8 "
    "--batch-size 32 --replay-prefill 320 --replay-capacity 1000"
)


def ablation(out, *more):
    return ["ablation", "--seeds", "2", "--jobs", "2", "--out", str(out), *SHORT.split(), *more]


def run(out, *more):
    command = [sys.executable, "-m", "uavdh_lite", *ablation(out, *more)]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def weights(folder):
    tensors, _ = load(folder / SAVED, "training")
    return {name: value for name, value in tensors.items() if name.startswith("online.")}


def assert_same_runs(out, other):
    names = sorted(path.name for path in out.iterdir() if path.is_dir())
    assert names == ["centred-0", "centred-1", "non_centred-0", "non_centred-1"]
    for name in names:
        ours, theirs = weights(out / name), weights(other / name)
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    return out, run(out)


def test_the_grid_runs_with_a_table_and_curves(finished):
    out, process = finished
    rows = [line.split() for line in process.stdout.splitlines()]
    assert [row[0] for row in rows[1:3]] == ["centred", "non_centred"]
    assert len(rows[1]) == 3  # a value a seed
    assert (out / "curves.png").stat().st_size > 5000
    agent = load_agent(out / "non_centred-1" / "best.safetensors")
    assert agent.recipe.observation == "non_centred" and agent.training["seed"] == 1
    assert agent.training["command"].startswith("python -m uavdh_lite ablation --seeds 2")


def test_the_curves_of_all_runs_come_as_two_tables(finished):
    out, _ = finished
    for kind in ("training", "validation"):
        table = read_table(out / f"{kind}.csv.gz")
        assert list(table)[:3] == ["variant", "seed", "steps"]
        own = (table["variant"] == "non_centred") & (table["seed"] == 1)
        run = read_table(out / "non_centred-1" / f"{kind}.csv")
        for name, column in run.items():
            np.testing.assert_array_equal(table[name][own], column)
    about = json.loads((out / "about.json").read_text())
    assert set(about["runs"]) == {"centred-0", "centred-1", "non_centred-0", "non_centred-1"}
    assert about["runs"]["centred-1"]["seed"] == 1 and about["runs"]["centred-1"]["seconds"] > 0


def test_finished_runs_are_kept(finished):
    out, _ = finished
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    run(out)
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == before


def test_a_killed_grid_goes_on_to_the_same_runs(finished, tmp_path):
    command = [sys.executable, "-m", "uavdh_lite", *ablation(tmp_path)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    while not list(tmp_path.glob(f"*/{SAVED}")):
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.5)  # the workers of the killed process are gone
    assert any(load(path, "training")[1]["steps"] < 6400 for path in tmp_path.glob(f"*/{SAVED}"))
    run(tmp_path)
    assert_same_runs(tmp_path, finished[0])


def test_two_workers_of_a_dask_cluster_give_the_same_runs(finished, tmp_path):
    process = run(tmp_path, "--backend", "dask")
    assert "Traceback" not in process.stderr
    assert_same_runs(tmp_path, finished[0])


def test_each_deviation_is_undone_alone():
    variants = deviations(LITE)
    assert variants.pop("all") == LITE
    assert variants["without_layer_norm"] == replace(LITE, layer_norm=False)
    assert variants["without_learning_rate"].learning_rate == PAPER.learning_rate
    assert len(variants) == 11 and all(recipe != LITE for recipe in variants.values())
    assert deviations(PAPER) == {"all": PAPER}
    assert set(centring(LITE)) == {"centred", "non_centred"}


def test_unknown_backend_study_and_scheduler(corridor_scenario, quick, tmp_path, capsys):
    quick = replace(quick, steps=5000)
    with pytest.raises(InputError, match="unknown backend 'mpi': choose loky or dask"):
        run_study(corridor_scenario, {"all": quick}, 1, tmp_path, backend="mpi")
    with pytest.raises(InputError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        run_study(
            corridor_scenario,
            {"all": quick},
            1,
            tmp_path,
            backend="dask",
            scheduler="tcp://127.0.0.1:9",
        )
    assert main(["ablation", "--study", "weather"]) == 2
    assert "unknown study 'weather': choose one of centring, deviations" in capsys.readouterr().err
    assert main(["ablation", "--variants", "centred", "sideways"]) == 2
    assert "unknown variant 'sideways': choose from centred, non_centred" in capsys.readouterr().err


def test_runs_too_short_for_a_curve_are_refused_before_they_run(tmp_path, capsys):
    assert main(["ablation", "--steps", "4000", "--out", str(tmp_path / "a")]) == 2
    assert "runs of 4000 steps: a study's curves need 5000 at least" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_a_part_of_a_study_is_the_same_runs(finished, tmp_path):
    run(tmp_path, "--variants", "non_centred")
    assert sorted(path.name for path in tmp_path.glob("*-*")) == ["non_centred-0", "non_centred-1"]
    ours, theirs = (weights(out / "non_centred-1") for out in (tmp_path, finished[0]))
    assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
