"""The README's pictures are light, its code runs, its numbers are recorded ones."""

import re
from pathlib import Path

import numpy as np
import pytest
from markdown_it import MarkdownIt

from uavdh_lite.paper import RESULTS
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COLUMNS = 7
ROWS = {  # of the ladder
    "**imitation agent**": "imitation",
    "**DDQN agent**": "ddqn",
    "DDQN with a failsafe": "ddqn_told",
    "**plain agent**": "plain",
    "greedy": "greedy",
    "teacher": "teacher",
    "random": "random",
}


def test_its_pictures_are_light():
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert pictures and all((ROOT / picture).stat().st_size < 1_000_000 for picture in pictures)


def test_the_python_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    exec(code.replace("episodes=1000", "episodes=20"), {})
    assert "collected_and_landed" in capsys.readouterr().out


def row(name: str) -> list[str]:
    """The cells of the row that begins with this name, of the table as a reader sees it."""
    tokens = MarkdownIt("commonmark").enable("table").parse(README)
    table = next(i for i, token in enumerate(tokens) if token.type == "table_open")
    cells = [token.content for token in tokens[table:] if token.type == "inline"]
    (at,) = [i for i, cell in enumerate(cells) if cell.startswith(name)]
    return [cell.replace("−", "-") for cell in cells[at : at + COLUMNS]]


def number(value: float) -> str:
    return "100 %" if value == 100 else f"{value:.1f} %"


@pytest.mark.parametrize("name", ROWS)
def test_the_results_are_those_of_the_ladder(name):
    table, expected = read_table(ROOT / "data/runs/ladder.csv.gz"), []
    for scenario in RESULTS:
        found = np.flatnonzero((table["scenario"] == scenario) & (table["row"] == ROWS[name]))
        if not found.size:
            expected += [""] * 3
            continue
        one = {key: values[found[0]] for key, values in table.items()}
        shares = (100 * one[metric] for metric in ("landed", "collected_and_landed"))
        expected += [*map(number, shares), f"{one['return']:.1f}"]
        if one["steps"]:
            assert one["seeds"] == 3  # as the text says
    assert row(name)[1:] == expected


def test_the_papers_row_is_the_papers():
    expected = []
    for paper in RESULTS.values():
        shares = (paper["landed"], paper["collected_and_landed"])
        expected += [*(f"{100 * share:.1f} %" for share in shares), ""]
    assert row("the paper's agents")[1:] == expected
