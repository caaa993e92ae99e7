"""What happens when things go wrong: each test really does it."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.errors import TrainingDiverged
from uavdh_lite.experiments.runs import train
from uavdh_lite.training import BIN, Trainer

OPTIONS = {
    "scenario": "village",
    "recipe": "small",
    "seed": 3,
    "steps": 9600,
    "validation-interval": 800,
    "validation-episodes": 10,
    "kernels": 2,
    "hidden": 16,
    "batch-size": 32,
    "replay-capacity": 2000,
    "replay-prefill": 320,
    "environments": 16,
}


def command(out, *more):
    options = [text for name, value in OPTIONS.items() for text in (f"--{name}", str(value))]
    return [sys.executable, "-m", "uavdh_lite", "train", *options, "--out", str(out), *more]


def run(arguments, **options):
    return subprocess.run(arguments, capture_output=True, text=True, **options)


def test_two_runs_in_one_folder(tmp_path):
    endless = command(tmp_path, "--steps", "100000000")
    with subprocess.Popen(endless, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as first:
        try:
            while not (tmp_path / "training.safetensors").exists():
                assert first.poll() is None
                time.sleep(0.005)
            second = run(command(tmp_path, "--resume"))
            assert second.returncode == 2 and first.poll() is None
            assert "another process is training there; choose another folder" in second.stderr
        finally:
            first.kill()


def test_the_lock_of_a_killed_run_does_not_stay(tmp_path):
    with subprocess.Popen(command(tmp_path), stderr=subprocess.DEVNULL) as first:
        while not (tmp_path / "training.safetensors").exists():
            assert first.poll() is None
            time.sleep(0.005)
        first.kill()
    assert run(command(tmp_path, "--resume")).returncode == 0


def test_a_training_that_diverges_stops_with_its_last_good_state(
    tmp_path, corridor, corridor_scenario, quick
):
    recipe = replace(quick, steps=4 * BIN, validation_interval=BIN)
    trainer = Trainer(corridor_scenario, recipe, 0, corridor)
    descend = trainer.ddqn.descend

    def diverging(*minibatch):
        loss = descend(*minibatch)
        if trainer.steps > 1.5 * BIN:
            with torch.no_grad():
                next(trainer.ddqn.online.parameters()).fill_(float("nan"))
        return loss

    trainer.ddqn.descend = diverging
    with pytest.raises(TrainingDiverged, match=f"not finite after {2 * BIN} steps: the last good"):
        train(trainer, tmp_path)
    tensors, about = load(tmp_path / "training.safetensors", "training")
    assert about["steps"] == BIN
    assert all(torch.isfinite(t).all() for t in tensors.values() if t.is_floating_point())
    agent = load_agent(tmp_path / "best.safetensors")
    assert all(torch.isfinite(p).all() for p in agent.network.parameters())


def test_the_command_says_that_it_diverged(tmp_path):
    done = run(command(tmp_path, "--learning-rate", "1e30", "--learning-rate-end", "1e30"))
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "is not finite after" in done.stderr and "nothing was saved yet" in done.stderr


def in_small_folder(size, tmp_path, script):
    """Run a shell script with a file system of this size at `disk`, in a mount name space."""
    if not shutil.which("unshare") or run(["unshare", "-rm", "true"]).returncode:
        pytest.skip("no private file systems here: unshare -rm does not work")
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = f"mount -t tmpfs -o size={size} none {disk}"
    return run(["unshare", "-rm", "sh", "-c", f"{mount} && {script}"], cwd=tmp_path)


def test_a_full_disk(tmp_path):
    """The run stops with a message; what was saved before stays whole and goes on elsewhere."""
    train = " ".join(command("disk/run"))
    script = (
        f"{train} --stop-after 1600 >first 2>&1; cp -r disk/run kept; "
        f"dd if=/dev/zero of=disk/rest bs=1k >/dev/null 2>&1; "
        f"{train} --resume >second 2>&1; echo $? >code; ls -a disk/run >names; cp -r disk/run after"
    )
    done = in_small_folder("3m", tmp_path, script)
    assert done.returncode == 0, done.stderr
    message = (tmp_path / "second").read_text()
    assert (tmp_path / "code").read_text().strip() == "1"
    assert "No space left on device" in message and "Traceback" not in message
    assert (tmp_path / "names").read_text() == "\n".join(
        [".", "..", *sorted(p.name for p in (tmp_path / "kept").iterdir())]
    ) + "\n"
    for path in (tmp_path / "kept").iterdir():
        assert path.read_bytes() == (tmp_path / "after" / path.name).read_bytes(), path.name
    resumed = run(command(tmp_path / "after", "--resume"))
    assert resumed.returncode == 0, resumed.stderr


def test_a_folder_that_cannot_be_written(tmp_path):
    script = f"mount -o remount,ro disk; {' '.join(command('disk/run'))}"
    done = in_small_folder("1m", tmp_path, script)
    assert done.returncode == 1
    assert "Read-only file system" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.long
def test_twenty_kills_at_random_moments(tmp_path):
    """Whenever it is killed, the run resumes, and ends with the weights of an undisturbed one."""
    assert run(command(tmp_path / "whole")).returncode == 0
    expected, _ = load(tmp_path / "whole" / "training.safetensors", "training")
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
            compare(out, expected)
            shutil.rmtree(out)
    if not (out / "training.safetensors").exists():
        shutil.rmtree(out, ignore_errors=True)
    more = ["--resume"] if out.exists() else []
    assert run(command(out, *more)).returncode == 0
    compare(out, expected)


def compare(out, expected):
    tensors, _ = load(out / "training.safetensors", "training")
    assert tensors.keys() == expected.keys()
    for name, tensor in tensors.items():
        assert torch.equal(tensor, expected[name]), name
