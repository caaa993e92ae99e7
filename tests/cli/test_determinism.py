"""What repeats to the last bit on one machine, and what may differ between machines.

On one machine, a seed, a recipe, a device and a number of threads fix every weight, however many
processes run side by side. Another processor or version of PyTorch adds floats up in another order:
a training then goes its own way, with results that spread as those of other seeds do. Evaluating a
given agent changes only where two Q-values are nearly equal.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.cli.main import main
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.storage import data_folder, read_table


def test_a_hash_seed_changes_nothing(capsys):
    """Python's own random hashes must not reach a result: here, and in a process with another."""
    arguments = ["evaluate", "--checkpoint", "manhattan", "--episodes", "30"]
    assert main(arguments) == 0
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    process = subprocess.run(
        [sys.executable, "-m", "uavdh_lite", *arguments],
        env={**os.environ, "PYTHONHASHSEED": other},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout == capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "policy"),
    [
        ("manhattan", "agent"),
        ("manhattan_ddqn", "manhattan_ddqn"),
        ("open_field", "agent"),
        ("open_field_ddqn", "open_field_ddqn"),
        ("harbour", "agent"),
    ],
)
def test_shipped_agents_score_what_was_recorded(name, policy):
    """Where it was recorded to six digits; on another machine within half a point."""
    agent, metric = load_agent(name), "collected_and_landed"
    table = read_table(data_folder() / "runs" / f"comparison-{agent.scenario.name}.csv.gz")
    recorded = table[metric][table["policy"] == policy]
    flights = evaluate(Environment(agent.city), agent, agent.scenario, len(recorded), seed=0)
    assert flights.records()[metric].mean() == pytest.approx(recorded.mean(), abs=0.005)


def test_other_numbers_of_threads_decide_alike():
    """Q-values differ in their last digits, decisions only where two are that near."""
    agent = load_agent("manhattan")
    generator = np.random.default_rng(0)
    state = agent.scenario.sample_anywhere(agent.environment, 2000, generator, 0)
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
