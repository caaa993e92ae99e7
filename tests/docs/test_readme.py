"""The README is short, its links lead somewhere, its code runs, its numbers are recorded ones."""

import re
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.paper import RESULTS
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
POLICIES = {
    "**quantile agent**": "agent",
    "**DDQN agent**": "{}_ddqn",
    "greedy": "greedy",
    "genie": "genie",
    "random": "random",
}


def test_it_is_short_and_its_picture_is_light():
    assert len(README.splitlines()) <= 120
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert pictures and all((ROOT / picture).stat().st_size < 1_000_000 for picture in pictures)


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", README))))
def test_links_lead_somewhere(target):
    assert target.startswith("https://") or (ROOT / target).exists()


def test_anchors_are_headings():
    headings = {line.lstrip("# ").lower().replace(" ", "-") for line in README.splitlines()}
    assert set(re.findall(r"\]\(#([^)]+)\)", README)) <= headings


def test_the_python_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(code.replace("episodes=1000", "episodes=20"), {})
    assert "collection_ratio_and_landed" in capsys.readouterr().out


def row(name):
    (line,) = [line for line in README.splitlines() if line.startswith(f"| {name}")]
    return [cell.strip().replace("−", "-") for cell in line.split("|")[2:-1]]


def recorded(scenario, policy):
    """Landed and collected in percent, and the return, as the table prints them."""
    table = read_table(ROOT / f"data/runs/comparison-{scenario}.csv.gz")
    mine = table["policy"] == policy
    return [float(np.mean(table[name][mine])) for name in METRICS]


METRICS = ("has_landed", "collection_ratio_and_landed", "cumulative_reward")


@pytest.mark.parametrize("name", POLICIES)
def test_the_results_are_those_of_the_recorded_comparison(name):
    shown = row(name)
    for column, scenario in ((0, "manhattan"), (3, "open_field")):
        if not shown[column]:
            continue  # no such agent
        landed, collected, total = recorded(scenario, POLICIES[name].format(scenario))
        if name == "genie":  # each column has the genie that was made for it
            collected = recorded(scenario, "genie_data")[1]
        assert shown[column] in (f"{100 * landed:.1f} %", f"{100 * landed:.0f} %")
        assert shown[column + 1] == f"{100 * collected:.1f} %"
        assert shown[column + 2] == f"{total:.1f}"


def test_the_papers_row_is_the_papers():
    shown = row("the paper's agents")
    for column, scenario in ((0, "manhattan"), (3, "open_field")):
        paper = RESULTS[scenario]
        assert shown[column] == f"{100 * paper['has_landed']:.1f} %"
        assert shown[column + 1] == f"{100 * paper['collection_ratio_and_landed']:.1f} %"
