"""What happens when things go wrong: each test really does it."""

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
