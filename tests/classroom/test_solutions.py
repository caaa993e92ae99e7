"""Every check accepts the solution next to it; the long tests run the solutions as notebooks."""

import jupytext
import pytest
from mutants import SCRIPTS

LONG = ("06_training", "10_labs")  # one trains, one searches: only as notebooks


@pytest.mark.parametrize(
    "script",
    [script for script in sorted(SCRIPTS.glob("*.py")) if script.stem not in LONG],
    ids=lambda script: script.stem,
)
def test_solutions_pass(script, monkeypatch, capsys):
    monkeypatch.chdir(script.parents[2] / "solutions" / script.stem)  # as in the notebook
    answers = {"__name__": "answers"}
    cells = [cell.source for cell in jupytext.read(script).cells if cell.cell_type == "code"]
    for source in cells:
        plain = [line for line in source.splitlines() if not line.startswith("%")]
        exec("\n".join(plain), answers)
    checked = sum(source.startswith("checks.") for source in cells)
    assert checked and capsys.readouterr().out.count(": right.\n") == checked
