"""What repeats to the last bit on one machine, and what may differ between machines.

On one machine, a seed, a recipe and a device fix every weight, on one thread or on two, however
many processes run side by side. Another processor or version of PyTorch adds floats up in another
order: a training then goes its own way, with results that spread as those of other seeds do.
Evaluating a given agent changes only where two Q-values are nearly equal.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.storage import data_folder, read_table

METRIC = "collection_ratio_and_landed"
SHORT = (
    "--scenario village --recipe small --steps 6400 --validation-interval 3200 --kernels 2 "
    "--validation-episodes 10 --replay-prefill 320 --seeds 2"
)


def test_any_number_of_jobs_gives_the_same_weights(tmp_path):
    runs = {}
    for jobs in (1, 3):
        out = tmp_path / str(jobs)
        command = ["-m", "uavdh_lite", "ablation", "--jobs", str(jobs), "--out", str(out)]
        done = subprocess.run([sys.executable, *command, *SHORT.split()], capture_output=True)
        assert done.returncode == 0, done.stderr.decode()
        runs[jobs] = {
            str(path.relative_to(out)): load(path, "training")[0]
            for path in sorted(out.rglob("training.safetensors"))
        }
    assert runs[1].keys() == runs[3].keys() and len(runs[1]) == 4
    for name, tensors in runs[1].items():
        assert all(torch.equal(tensor, runs[3][name][key]) for key, tensor in tensors.items())


def test_a_hash_seed_changes_nothing(tmp_path):
    """Python's own random hashes must not reach a result."""
    printed = set()
    for seed in ("1", "2"):
        command = [sys.executable, "-m", "uavdh_lite", "evaluate", "--checkpoint", "manhattan"]
        printed.add(
            subprocess.run(
                [*command, "--episodes", "30"],
                env={**os.environ, "PYTHONHASHSEED": seed},
                capture_output=True,
                check=True,
            ).stdout
        )
    assert len(printed) == 1


@pytest.mark.parametrize("name", ["manhattan", "open_field"])
def test_shipped_agents_score_what_was_recorded(name):
    """Where it was recorded to six digits; on another machine within half a point."""
    table = read_table(data_folder() / "runs" / f"comparison-{name}.csv.gz")
    recorded = table[METRIC][table["policy"] == "agent"].mean()
    agent = load_agent(name)
    flights = evaluate(Environment(agent.city), agent, agent.scenario, 1000, seed=0)
    assert flights.records()[METRIC].mean() == pytest.approx(recorded, abs=0.005)


def test_other_numbers_of_threads_decide_alike():
    """Q-values differ in their last digits, decisions only where two are that near."""
    agent = load_agent("manhattan")
    state = agent.scenario.sample_anywhere(agent.city, 2000, np.random.default_rng(0), 0)
    threads, answers = torch.get_num_threads(), []
    for number in (1, 2):
        torch.set_num_threads(number)
        answers.append(agent.q_values(state))
    torch.set_num_threads(threads)
    one, two = answers
    assert torch.allclose(one, two, atol=1e-3)
    best = one.topk(2).values
    clear = best[:, 0] - best[:, 1] > 2e-3
    assert clear.float().mean() > 0.95
    assert torch.equal(one.argmax(1)[clear], two.argmax(1)[clear])
