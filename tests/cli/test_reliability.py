"""What happens when things go wrong: each test really does it."""

import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load
from uavdh_lite.cli.main import main
from uavdh_lite.storage import read_table

pytestmark = pytest.mark.long  # processes are started, killed and resumed

OPTIONS = {
    "scenario": "village",
    "recipe": "small",
    "seed": 3,
    "steps": 6400,
    "validation-interval": 1280,
    "validation-episodes": 10,
    "kernels": 2,
    "hidden": 16,
    "batch-size": 32,
    "replay-capacity": 2000,
    "replay-prefill": 320,
    "environments": 16,
}


def arguments(out, *more):
    options = [text for name, value in OPTIONS.items() for text in (f"--{name}", str(value))]
    return ["train", *options, "--out", str(out), *more]


def command(out, *more):
    """The same in a process of its own."""
    return [sys.executable, "-m", "uavdh_lite", *arguments(out, *more)]


def run(command, **options):
    return subprocess.run(command, capture_output=True, text=True, **options)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    assert main(arguments(out)) == 0
    return out


def assert_same_result(out, uninterrupted):
    tensors, about = load(out / "training.safetensors", "training")
    expected, expected_about = load(uninterrupted / "training.safetensors", "training")
    assert about["steps"] == expected_about["steps"] == 6400
    assert tensors.keys() == expected.keys()
    for name, tensor in tensors.items():
        assert torch.equal(tensor, expected[name]), name
    for name in ("training.csv", "validation.csv"):
        ours, theirs = read_table(out / name), read_table(uninterrupted / name)
        for column in ours.keys() - {"seconds"}:
            assert np.array_equal(ours[column], theirs[column], equal_nan=True), column


def started(out, signal_number):
    """Start the run, wait for its first saved state, send the signal; the finished process."""
    process = subprocess.Popen(
        command(out), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    while not (out / "training.safetensors").exists():
        assert process.poll() is None, process.stdout.read()
        time.sleep(0.005)
    os.kill(process.pid, signal_number)
    output, _ = process.communicate(timeout=60)
    _, about = load(out / "training.safetensors", "training")
    assert 0 < about["steps"] < 6400
    return process.returncode, output


def test_a_killed_run_resumes_to_the_same_result(tmp_path, uninterrupted):
    """Its lock does not stay either."""
    code, _ = started(tmp_path, signal.SIGKILL)
    assert code == -signal.SIGKILL
    assert main(arguments(tmp_path, "--resume")) == 0
    assert_same_result(tmp_path, uninterrupted)


def test_ctrl_c_saves_and_says_how_to_resume(tmp_path, uninterrupted):
    code, output = started(tmp_path, signal.SIGINT)
    assert code == 130
    assert "--resume" in output and "Traceback" not in output
    assert main(arguments(tmp_path, "--resume")) == 0
    assert_same_result(tmp_path, uninterrupted)


@pytest.mark.parametrize("steps", [800, 1920])
def test_a_run_left_early_resumes_to_the_same_result(tmp_path, uninterrupted, steps, capsys):
    """Before and after the first validation, at 1280 steps; 16 environments."""
    assert main(arguments(tmp_path, "--stop-after", str(steps))) == 0
    output = capsys.readouterr().out
    assert f"stopped after {steps} steps; add --resume to continue" in output
    assert ("best agent" in output) == (tmp_path / "best.safetensors").exists() == (steps > 1280)
    assert main(arguments(tmp_path, "--resume")) == 0
    assert_same_result(tmp_path, uninterrupted)


def test_two_runs_in_one_folder(tmp_path, capsys):
    endless = command(tmp_path, "--steps", "100000000")
    with subprocess.Popen(endless, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as first:
        try:
            while not (tmp_path / "training.safetensors").exists():
                assert first.poll() is None
                time.sleep(0.005)
            assert main(arguments(tmp_path, "--resume")) == 2 and first.poll() is None
            error = capsys.readouterr().err
            assert "another process is training there; choose another folder" in error
        finally:
            first.kill()


def test_the_command_says_that_it_diverged(tmp_path, capsys):
    rate = ("--learning-rate", "1e30", "--learning-rate-end", "1e30")
    assert main(arguments(tmp_path, *rate)) == 1
    error = capsys.readouterr().err
    assert "is not finite after" in error and "nothing was saved yet" in error
    assert "Traceback" not in error


def in_small_folder(size, tmp_path, script):
    """Run a shell script with a file system of this size at `disk`, in a mount name space."""
    if not shutil.which("unshare") or run(["unshare", "-rm", "true"]).returncode:
        pytest.skip("no private file systems here: unshare -rm does not work")
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = f"mount -t tmpfs -o size={size} none {disk}"
    return run(["unshare", "-rm", "sh", "-c", f"{mount} && {script}"], cwd=tmp_path)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_full_disk(tmp_path):
    """The run stops with a message; what was saved before stays whole and goes on elsewhere."""
    kept = tmp_path / "kept"
    assert main(arguments(kept, "--stop-after", "1280")) == 0
    script = (
        f"cp -r kept disk/run; dd if=/dev/zero of=disk/rest bs=1k >/dev/null 2>&1; "
        f"{' '.join(command('disk/run', '--resume'))} >second 2>&1; echo $? >code; "
        f"cp -r disk/run after"
    )
    done = in_small_folder("3m", tmp_path, script)
    assert done.returncode == 0, done.stderr
    message = (tmp_path / "second").read_text()
    assert (tmp_path / "code").read_text().strip() == "1"
    assert "No space left on device" in message and "Traceback" not in message
    before, after = (
        {p.name: p.read_bytes() for p in f.iterdir()} for f in (kept, tmp_path / "after")
    )
    assert after == before
    assert main(arguments(tmp_path / "after", "--resume")) == 0


def test_a_folder_that_cannot_be_written(tmp_path):
    script = f"mount -o remount,ro disk; {' '.join(command('disk/run'))}"
    done = in_small_folder("1m", tmp_path, script)
    assert done.returncode == 1
    assert "Read-only file system" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.longest
def test_twenty_kills_at_random_moments(tmp_path, uninterrupted):
    """Whenever it is killed, the run resumes, and ends with the weights of an undisturbed one."""
    generator = np.random.default_rng(0)
    out, kills = tmp_path / "killed", 0
    while kills < 20:
        more = ["--resume"] if (out / "training.safetensors").exists() else []
        process = subprocess.Popen(
            command(out, *more), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        started = time.monotonic()
        while not (out / "lock").exists() and process.poll() is None:
            time.sleep(0.005)
        try:
            process.wait(timeout=2 + 2.5 * generator.random())
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            kills += 1
        assert process.returncode in (0, -signal.SIGKILL), time.monotonic() - started
        if process.returncode == 0:  # finished before it was killed: once more from the start
            assert_same_result(out, uninterrupted)
            shutil.rmtree(out)
    if not (out / "training.safetensors").exists():
        shutil.rmtree(out, ignore_errors=True)
    more = ["--resume"] if out.exists() else []
    assert main(arguments(out, *more)) == 0
    assert_same_result(out, uninterrupted)
