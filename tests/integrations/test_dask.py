"""A study on the workers of a Dask cluster."""

import distributed
import pytest
import torch

from uavdh_lite.checkpoint import load
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import SAVED
from uavdh_lite.experiments.study import run_study
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import BIN

pytestmark = pytest.mark.long


def test_two_workers_give_the_runs_of_one_process(tmp_path, trainer, monkeypatch):
    recipe = trainer(steps=BIN, environments=32, validation_interval=BIN).recipe
    study = find_scenario("village"), {"one": recipe}, 2
    here = run_study(*study, tmp_path / "here")
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        there = run_study(*study, tmp_path / "there", scheduler=cluster.scheduler_address)
    for folder, other in zip(here["one"], there["one"], strict=True):
        ours, theirs = (load(one / SAVED, "training")[0] for one in (folder, other))
        assert all(torch.equal(ours[name], theirs[name]) for name in ours)

    client = distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda where, timeout: client(where, timeout=0.5))
    with pytest.raises(InputError, match=r"tcp://127\.0\.0\.1:9"):
        run_study(*study, tmp_path, scheduler="tcp://127.0.0.1:9")
