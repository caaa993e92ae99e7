"""Studies: the same runs in any order, in any number of processes, killed and all."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import torch
from filelock import FileLock

from uavdh_lite.beyond.recipes import TOLD
from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.cli.main import main
from uavdh_lite.errors import InputError
from uavdh_lite.experiments import runs
from uavdh_lite.experiments.runs import SAVED, train
from uavdh_lite.experiments.study import (
    GOING,
    centring,
    collect_curves,
    final_scores,
    run_study,
    variants_of,
)
from uavdh_lite.recipe import LITE, SMALL
from uavdh_lite.registry import names
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import read_table
from uavdh_lite.training import Trainer

CHANGES = {"steps": 5120, "validation_interval": 2560, "validation_episodes": 5, "kernels": 2}
CHANGES |= {"hidden": (8,), "environments": 64, "replay_capacity": 1000, "replay_prefill": 320}
RECIPE = replace(SMALL, **CHANGES)
RUNS = ["centred-0", "centred-1", "non_centred-0", "non_centred-1"]


def study(out, *more):
    options = [
        word
        for name, value in CHANGES.items()
        for word in (f"--{name.replace('_', '-')}", str(value).strip("(),"))
    ]
    options += ["--scenario", "village", "--recipe", "small", "--seeds", "2"]
    return ["study", *options, "--out", str(out), *more]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    return out, run_study(find_scenario("village"), centring(RECIPE), 2, out, command="a command")


def assert_same_runs(out, other):
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == RUNS
    for name in RUNS:
        ours, theirs = (load(folder / name / SAVED, "training")[0] for folder in (out, other))
        assert ours.keys() == theirs.keys()
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)


def test_a_run_for_each_variant_and_seed_which_is_kept(finished):
    out, folders = finished
    kinds = ("centred", "non_centred")
    assert folders == {name: [out / f"{name}-{seed}" for seed in range(2)] for name in kinds}
    agent = load_agent(out / "non_centred-1" / "best.safetensors")
    assert agent.recipe == replace(RECIPE, observation="non_centred")
    assert agent.training["seed"] == 1 and agent.training["command"] == "a command"
    files = [path for path in out.glob("*/*") if path.name != "lock"]
    before = [path.stat().st_mtime_ns for path in files]
    assert run_study(find_scenario("village"), centring(RECIPE), 2, out) == folders
    assert [path.stat().st_mtime_ns for path in files] == before
    assert not (out / GOING).exists()


def test_the_curves_of_all_runs_come_as_two_tables(finished, tmp_path):
    out, folders = finished
    paths = collect_curves(folders, tmp_path, "a command")
    for kind, path in zip(("training", "validation"), paths, strict=True):
        assert path == tmp_path / f"{kind}.csv.gz"
        table = read_table(path)
        assert list(table)[:3] == ["variant", "seed", "steps"]
        own = (table["variant"] == "non_centred") & (table["seed"] == 1)
        for name, column in read_table(out / "non_centred-1" / f"{kind}.csv").items():
            np.testing.assert_array_equal(table[name][own], column)
    about = json.loads((tmp_path / "about.json").read_text())
    assert about["command"] == "a command" and sorted(about["runs"]) == RUNS
    last = read_table(out / "non_centred-1" / "validation.csv")["collected_and_landed"][-1]
    scores = final_scores(paths[1])
    assert list(scores) == ["centred", "non_centred"] and scores["non_centred"][1] == last


def test_the_tables_of_other_runs_are_not_replaced(finished, tmp_path):
    """More seeds and more variants are of the same study."""
    collect_curves(finished[1], tmp_path, "a command")
    with pytest.raises(InputError, match="holds a study with centred-1, too"):
        run_study(find_scenario("village"), centring(RECIPE), 1, tmp_path)


def test_a_variant_is_the_recipe_with_what_its_text_says():
    texts = ["as_it_is", "pooling=2", "strides=[3,1],kernels=8", "huber_delta=10"]
    texts += ["failsafe=false,discount=0.9", "observation=centred"]
    assert variants_of(TOLD, texts) == {
        "as_it_is": TOLD,
        "pooling=2": replace(TOLD, pooling=2),
        "strides=[3,1],kernels=8": replace(TOLD, strides=(3, 1), kernels=8),
        "huber_delta=10": replace(TOLD, huber_delta=10),
        "failsafe=false,discount=0.9": replace(TOLD, failsafe=False, discount=0.9),
        "observation=centred": TOLD,
    }
    assert centring(LITE)["non_centred"] == replace(LITE, observation="non_centred")
    assert variants_of(LITE, ["huber_delta=null"])["huber_delta=null"].huber_delta is None


@pytest.mark.parametrize("text", ["leek=0", "leak", "kernels=1.5", "discount=2", "pooling=2"])
def test_what_a_recipe_cannot_have_is_named(text):
    with pytest.raises(InputError, match=text.partition("=")[0]):
        variants_of(LITE, [text])


def training_processes(out):
    """The processes that have a run's lock open."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if any(Path(file.path).parent.parent == out for file in process.open_files()):
                found.append(process)
    return found


@pytest.mark.long
@pytest.mark.longest
def test_a_study_whose_call_was_killed_goes_on_at_the_cluster(tmp_path):
    """Two workers are still at its runs, whose locks they hold, when the third takes one."""
    distributed = pytest.importorskip("dask.distributed")
    options = {"n_workers": 3, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        client.run(setattr, runs, "LOCK_SECONDS", 0)
        at = ["--cluster", cluster.scheduler_address]
        command = study(tmp_path, *at, "--seeds", "1", "--steps", "40960")
        process = subprocess.Popen([sys.executable, "-m", "uavdh_lite", *command])
        while len(list(tmp_path.glob(f"*/{SAVED}"))) < 2:
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
        process.wait()
        assert training_processes(tmp_path)
        assert main(command) == 0
    saved = [load(path, "training")[1]["steps"] for path in tmp_path.glob(f"*/{SAVED}")]
    assert saved == [40_960] * 2


def test_a_cluster_must_be_there_and_its_workers_have_one_thread(tmp_path):
    distributed = pytest.importorskip("dask.distributed")
    variants = centring(RECIPE)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(InputError, match="--nthreads 1"):
            run_study(find_scenario("village"), variants, 1, tmp_path, cluster=address)
    with pytest.raises(InputError, match="no Dask scheduler at nowhere"):
        run_study(find_scenario("village"), variants, 1, tmp_path, cluster="nowhere://x")


@pytest.mark.long
@pytest.mark.parametrize("recipe", names("recipe"))
def test_two_seeds_of_every_recipe_are_trained_and_drawn(recipe, tmp_path, capsys):
    """Those that learn by reward have rows at different steps: a row for so many flights."""
    options = ["--steps", "5120", "--validation-interval", "5120", "--validation-episodes", "5"]
    options += ["--environments", "32"]  # with one at a time, as in `paper`, this would be slow
    options += ["--kernels", "2", "--kernel-size", "3", "--hidden", "8", "--batch-size", "64"]
    rewarded = ["--labels", "2560", "--replay-prefill", "512"]
    options += rewarded if recipe == "imitation" else ["--replay-prefill", "4608"]
    named = ["--recipe", recipe, "--scenario", "village", "--variants", "as_it_is"]
    assert main(["study", *named, *options, "--seeds", "2", "--out", str(tmp_path)]) == 0
    table = read_table(tmp_path / "training.csv.gz")
    steps = [table["steps"][table["seed"] == seed].tolist() for seed in range(2)]
    assert all(steps) and (steps[0] != steps[1]) == (recipe == "imitation")
    assert len(capsys.readouterr().out.splitlines()[1].split()) == 3  # a score for each seed
    assert (tmp_path / "curves.png").stat().st_size > 5000


def test_runs_too_short_for_a_curve_are_refused(tmp_path, capsys):
    assert main(study(tmp_path / "a", "--steps", "4000")) == 2
    assert "4000 steps" in capsys.readouterr().err and not (tmp_path / "a").exists()


def test_two_studies_share_no_folder_and_no_more_do_two_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "LOCK_SECONDS", 0)
    village = find_scenario("village")
    for work in (
        lambda: run_study(village, centring(RECIPE), 1, tmp_path),
        lambda: train(Trainer(village, RECIPE, 0), tmp_path, resume=True),
    ):
        with FileLock(tmp_path / "lock"), pytest.raises(InputError, match="another process is"):
            work()


@pytest.mark.long
@pytest.mark.parametrize(
    "number",
    [signal.SIGTERM, *(pytest.param(n, marks=pytest.mark.longest) for n in (2, signal.SIGKILL))],
)
def test_a_stopped_study_leaves_no_process_and_goes_on_to_the_same_runs(finished, tmp_path, number):
    """The signal goes to the parent alone, at a random moment; the workers save and end with it."""
    process = subprocess.Popen(
        [sys.executable, "-m", "uavdh_lite", *study(tmp_path, "--jobs", "2")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while len(list(tmp_path.glob("*/about.json"))) < 2:
        assert process.poll() is None
        time.sleep(0.01)
    time.sleep(np.random.default_rng().random() / 5)
    process.send_signal(number)
    _, message = process.communicate(timeout=200)  # idle workers would stay for 300
    for _ in range(600):
        if not training_processes(tmp_path):
            break
        time.sleep(0.1)
    assert not training_processes(tmp_path)
    saved = [load(path, "training")[1]["steps"] for path in tmp_path.glob(f"*/{SAVED}")]
    assert len(saved) >= 2 and min(saved) < RECIPE.steps
    if number != signal.SIGKILL:
        assert process.returncode == 130 and "the same command continues" in message
        assert not (tmp_path / GOING).exists()
    assert main(study(tmp_path, "--jobs", "1")) == 0
    assert_same_runs(tmp_path, finished[0])
