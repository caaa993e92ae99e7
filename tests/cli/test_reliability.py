"""What happens when things go wrong: each test really does it."""

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
from uavdh_lite.experiments.runs import SAVED
from uavdh_lite.storage import read_table

pytestmark = pytest.mark.long  # processes are started, killed and resumed

OPTIONS = (
    "--scenario village --recipe small --seed 3 --steps 6400 --validation-interval 1280 "
    "--validation-episodes 10 --kernels 2 --hidden 16 --batch-size 32 --environments 16 "
    "--replay-capacity 2000 --replay-prefill 320 --threads 1"
)


def arguments(out, *more):
    return ["train", *OPTIONS.split(), "--out", str(out), *more]


def command(out, *more):
    """The same in a process of its own."""
    return [sys.executable, "-m", "uavdh_lite", *arguments(out, *more)]


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    assert main(arguments(out)) == 0
    return out


def assert_same_result(out, uninterrupted):
    tensors, about = load(out / SAVED, "training")
    expected, expected_about = load(uninterrupted / SAVED, "training")
    assert about["steps"] == expected_about["steps"] == 6400
    assert tensors.keys() == expected.keys()
    for name, tensor in tensors.items():
        assert torch.equal(tensor, expected[name]), name
    for name in ("training.csv", "validation.csv"):
        ours, theirs = read_table(out / name), read_table(uninterrupted / name)
        for column in ours.keys() - {"seconds"}:
            assert np.array_equal(ours[column], theirs[column], equal_nan=True), column


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGTERM])
def test_a_run_that_was_killed_or_interrupted_resumes_to_the_same_result(
    tmp_path, uninterrupted, signal_number
):
    """Its lock does not stay either. SIGTERM says how to go on, as Ctrl-C does."""
    process = subprocess.Popen(
        command(tmp_path), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    while not (tmp_path / SAVED).exists():
        assert process.poll() is None, process.stdout.read()
        time.sleep(0.005)
    process.send_signal(signal_number)
    output, _ = process.communicate(timeout=60)
    assert 0 < load(tmp_path / SAVED, "training")[1]["steps"] < 6400
    if signal_number != signal.SIGKILL:
        assert "--resume" in output and "Traceback" not in output
        assert process.returncode == 130
    assert main(arguments(tmp_path, "--resume")) == 0
    assert_same_result(tmp_path, uninterrupted)


def in_small_folder(size, tmp_path, script):
    """Run a shell script with a file system of this size at `disk`, in a mount name space."""
    if not shutil.which("unshare") or subprocess.run(["unshare", "-rm", "true"]).returncode:
        pytest.skip("no private file systems here: unshare -rm does not work")
    disk = tmp_path / "disk"
    disk.mkdir()
    script = f"mount -t tmpfs -o size={size} none {disk} && {script}"
    shell = ["unshare", "-rm", "sh", "-c", script]
    return subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True)


def contents(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.name != "about.json"}


def test_a_full_disk(tmp_path):
    """The run stops with a message; what was saved before stays whole and goes on elsewhere."""
    kept, after = tmp_path / "kept", tmp_path / "after"
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
    assert contents(after) == contents(kept)
    assert main(arguments(after, "--resume")) == 0
