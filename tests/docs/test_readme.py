"""The README is short, its code runs, its numbers are recorded ones."""

import json
import re
from pathlib import Path

import pytest

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.paper import RESULTS
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
POLICIES = {
    "**imitation agent**": "agent",
    "**DDQN agent**": "{}_ddqn",
    "greedy": "greedy",
    "genie": "genie",
    "random": "random",
}


def test_it_is_short_and_its_pictures_are_light():
    assert len(README.splitlines()) <= 100
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert pictures and all((ROOT / picture).stat().st_size < 1_000_000 for picture in pictures)


def test_the_python_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(code.replace("episodes=1000", "episodes=20"), {})
    assert "collected_and_landed" in capsys.readouterr().out


def row(name: str) -> list[str]:
    (line,) = [line for line in README.splitlines() if line.startswith(f"| {name}")]
    return [cell.strip().replace("−", "-") for cell in line.split("|")[2:-1]]


def recorded(scenario: str, policy: str, metric: str) -> float:
    table = read_table(ROOT / f"data/runs/comparison-{scenario}.csv.gz")
    return float(table[metric][table["policy"] == policy].mean())


@pytest.mark.parametrize("name", POLICIES)
def test_the_results_are_those_of_the_recorded_comparison(name):
    expected = []
    for scenario in RESULTS:
        policy = POLICIES[name].format(scenario)
        collector = "genie_data" if name == "genie" else policy  # each column has its own genie
        landed = 100 * recorded(scenario, policy, "landed")
        collected = 100 * recorded(scenario, collector, "collected_and_landed")
        total = recorded(scenario, policy, "return")
        shown = "100 %" if landed == 100 else f"{landed:.1f} %"
        expected += [shown, f"{collected:.1f} %", f"{total:.1f}"]
    assert row(name) == expected


def test_the_row_of_the_papers_constants_is_the_recorded_run():
    run = json.loads((ROOT / "data/runs/paper-manhattan.json").read_text())
    steps, test = f"{1000 * round(run['agent']['steps'] / 1000):,}", run["test"]
    shares = (f"{100 * test[name]:.1f} %" for name in ("landed", "collected_and_landed"))
    cells = [*shares, f"{test['return']:.1f}", "", "", ""]
    assert row(f"the paper's constants: {steps} of a million steps") == cells
    assert load_agent("manhattan_paper").training["steps"] == run["agent"]["steps"]


def test_the_papers_row_is_the_papers():
    expected = []
    for paper in RESULTS.values():
        shares = (paper["landed"], paper["collected_and_landed"])
        expected += [*(f"{100 * share:.1f} %" for share in shares), ""]
    assert row("the paper's agents") == expected
