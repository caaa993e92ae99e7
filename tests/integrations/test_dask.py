"""Studies on the workers of a Dask cluster."""

from dataclasses import replace

import distributed
import psutil
import pytest
import torch

from uavdh_lite.checkpoint import load
from uavdh_lite.errors import InputError
from uavdh_lite.experiments import ablation
from uavdh_lite.experiments.runs import SAVED
from uavdh_lite.recipe import SMALL
from uavdh_lite.scenario import find_scenario

pytestmark = pytest.mark.long

RECIPE = replace(
    SMALL,
    steps=5120,
    environments=32,
    kernels=2,
    hidden=(8,),
    batch_size=32,
    validation_interval=2560,
    validation_episodes=5,
)
STUDY = {"scenario": find_scenario("village"), "variants": {"small": RECIPE}, "seeds": 2}


@pytest.fixture(scope="module")
def cluster():
    """Two workers on this machine."""
    with ablation._cluster("dask", None, jobs=2) as client:
        yield client


def test_two_workers_give_the_runs_of_one_process(cluster, tmp_path):
    here = ablation.run_study(**STUDY, out=tmp_path / "here")
    there = ablation.run_study(
        **STUDY, out=tmp_path / "there", backend="dask", scheduler=cluster.scheduler.address
    )
    for folder, other in zip(here["small"], there["small"], strict=True):
        ours, theirs = (load(one / SAVED, "training")[0] for one in (folder, other))
        assert ours.keys() == theirs.keys()
        assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_local_cluster_listens_on_loopback_only(cluster):
    process = psutil.Process()
    addresses = {
        connection.laddr.ip
        for one in (process, *process.children(recursive=True))
        for connection in one.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    }
    assert addresses == {"127.0.0.1"}


def test_no_scheduler_there(tmp_path, monkeypatch):
    monkeypatch.setattr(
        distributed,
        "Client",
        lambda address, timeout, real=distributed.Client: real(address, timeout=timeout / 20),
    )
    with pytest.raises(InputError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        ablation.run_study(**STUDY, out=tmp_path, backend="dask", scheduler="tcp://127.0.0.1:9")
