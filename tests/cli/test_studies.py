"""Studies on the command line, over several processes, killed and all."""

import os
import signal
import subprocess
import sys
import time

import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.cli.main import main
from uavdh_lite.experiments.runs import SAVED

SHORT = (
    "--scenario village --recipe small --steps 5120 --environments 32 --validation-interval 1280 "
    "--validation-episodes 5 --kernels 2 --hidden 8 --batch-size 32 --replay-prefill 320 "
    "--replay-capacity 1000 --seeds 2"
)


def ablation(out, *more):
    return ["ablation", *SHORT.split(), "--out", str(out), *more]


def command(out, *more):
    """The same in processes of its own."""
    return [sys.executable, "-m", "uavdh_lite", *ablation(out, *more)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study in this process, one run after the other."""
    out = tmp_path_factory.mktemp("study")
    assert main(ablation(out)) == 0
    return out


def assert_same_runs(out, other, *names):
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == sorted(names)
    for name in names:
        ours, theirs = (load(folder / name / SAVED, "training")[0] for folder in (out, other))
        assert ours.keys() == theirs.keys()
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)


@pytest.mark.long
def test_any_number_of_jobs_gives_the_same_runs_with_a_table_and_curves(finished, tmp_path):
    jobs = command(tmp_path, "--jobs", "2")
    process = subprocess.run(jobs, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    rows = [line.split() for line in process.stdout.splitlines()]
    assert [row[0] for row in rows[1:3]] == ["centred", "non_centred"]
    assert len(rows[1]) == 3  # a value for each seed
    assert (tmp_path / "curves.png").stat().st_size > 5000
    agent = load_agent(tmp_path / "non_centred-1" / "best.safetensors")
    assert agent.training["command"].startswith("python -m uavdh_lite ablation --scenario village")
    assert_same_runs(tmp_path, finished, "centred-0", "centred-1", "non_centred-0", "non_centred-1")


@pytest.mark.long
def test_a_killed_grid_goes_on_to_the_same_runs(finished, tmp_path):
    centred = ("--variants", "centred")
    process = subprocess.Popen(
        command(tmp_path, "--jobs", "2", *centred),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    while not list(tmp_path.glob(f"*/{SAVED}")):
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.5)  # the workers of the killed process are gone
    assert any(load(path, "training")[1]["steps"] < 5120 for path in tmp_path.glob(f"*/{SAVED}"))
    assert main(ablation(tmp_path, *centred)) == 0
    assert_same_runs(tmp_path, finished, "centred-0", "centred-1")


def test_bad_values_are_one_line(tmp_path, capsys):
    for options, message in {
        "--study weather": "unknown study 'weather': choose one of centring, deviations, parts",
        "--variants centred sideways": "unknown variant 'sideways': choose from centred, non_",
        "--steps 4000": "runs of 4000 steps: a study's curves need at least 5000",
    }.items():
        assert main(ablation(tmp_path / "a", *options.split())) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    assert not (tmp_path / "a").exists()
