"""Every check accepts the solution next to it; the longest tests run the solutions as notebooks."""

import jupytext
import pytest
from mutants import SCRIPTS, code_of


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda script: script.stem)
def test_solutions_pass(script, capsys):
    answers = {"__name__": "answers"}
    notebook = jupytext.reads(code_of(script), "py:percent")
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    for source in cells:
        plain = [line for line in source.splitlines() if not line.startswith("%")]
        exec("\n".join(plain), answers)
    checked = sum(source.startswith("checks.") for source in cells)
    assert checked and capsys.readouterr().out.count(": right.\n") == checked
