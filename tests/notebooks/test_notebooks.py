"""The notebooks' form: pairs, fresh outputs, the template, how long. nbval runs what is in them."""

import ast
import asyncio
import re
from functools import cache
from pathlib import Path

import execute
import nbformat
import numpy as np
import pytest
from IPython.core.inputtransformer2 import TransformerManager
from IPython.display import DisplayHandle
from jupytext.cli import jupytext as jupytext_cli
from matplotlib import pyplot as plt
from safetensors.numpy import save_file

from uavdh_lite.course import live
from uavdh_lite.course.checks import EXERCISES

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
SECTIONS = ("What you'll do", "What you'll learn", "What you'll need", "Recap", "Exercises")
COURSE = range(10)  # the numbers of its notebooks; the others go further
BRIEFLY = {  # steps of trainings, and fewer
    "07_training": {"72_000": "4_800"},
    "08_ablation_map_centring": {"36_000": "4_000", "6_000": "4_000"},
    "09_finale": {"32_000": "4_000"},
}

SCRIPTS = execute.scripts()


@pytest.fixture(params=SCRIPTS, ids=lambda script: script.stem)
def script(request):
    return request.param


@cache
def read(path):
    return nbformat.read(path, as_version=4)


@pytest.fixture
def notebook(script):
    return read(execute.notebook_of(script))


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def text(notebook):
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")


def is_hidden(cell):
    return any("hide" in tag or "remove" in tag for tag in cell.metadata.get("tags", ()))


def lines(cells):
    """Lines of code that a reader reads: no empty ones, comments or magics."""
    every = (line for cell in cells for line in cell.source.splitlines())
    return [line for line in every if line.strip() and line.strip()[0] not in "#%"]


def reading(notebook):
    """Lines of code, and minutes that a novice needs: for words, lines and figures."""
    shown = [cell for cell in code(notebook) if not is_hidden(cell)]
    figures = sum("image/png" in o.get("data", {}) for cell in shown for o in cell.outputs)
    words, count = len(text(notebook).split()), len(lines(shown))
    return count, words / 60 + count / 5 + figures / 2


def stated(notebook):
    """Minutes to read and seconds to run, as the notebook says."""
    found = re.search(r"(\d+) minutes to read, (\d+) seconds to run", text(notebook))
    assert found, "no “N minutes to read, N seconds to run”"
    return tuple(map(int, found.groups()))


def test_every_notebook_has_its_script():
    names = {path.stem for path in NOTEBOOKS.glob("[0-9]*.ipynb")}
    assert names == {path.stem for path in SCRIPTS} and names


@pytest.mark.parametrize(
    "script",
    SCRIPTS + execute.exercise_scripts() + execute.project_scripts(),
    ids=lambda one: f"{one.parent.name}-{one.stem}",
)
def test_the_notebook_was_executed_from_this_script_without_errors(script):
    notebook, expected = read(execute.notebook_of(script)), execute.from_script(script)
    assert [cell.source for cell in notebook.cells] == [cell.source for cell in expected.cells]
    assert execute.is_fresh(script), f"run: python notebooks/execute.py {script.stem[:2]}"
    cells = code(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert "error" not in {output.output_type for output in outputs}
    assert "stderr" not in {o.name for o in outputs if o.output_type == "stream"}


def test_tutorials_and_exercises_have_the_same_names():
    """The exercise of the finale is the project."""
    names = [script.name for script in SCRIPTS if script.stem != "09_finale"]
    assert [script.name for script in execute.exercise_scripts()] == names


def test_an_afternoon_holds_it_and_the_minutes_that_are_stated_are_a_novice_s(script, notebook):
    count, minutes = reading(notebook)
    assert count <= 110 and minutes <= (50 if int(script.stem[:2]) in COURSE else 60)
    assert not [line for cell in code(notebook) for line in cell.source.splitlines() if line[100:]]
    read, run = stated(notebook)
    assert 0.75 * minutes <= read <= 1.25 * minutes, minutes
    index = (execute.HERE.parent / "docs" / "tutorials" / "index.md").read_text()
    assert re.search(rf"/{script.stem}\.ipynb\) \|.*\| {read} min \| {run} s \|", index)
    number = str(int(script.stem[:2]))
    own = [one.minutes for one in EXERCISES.values() if one.number.split(".")[0] == number]
    assert not own or f"; {sum(own)} minutes of exercises" in text(notebook)


def test_a_notebook_is_stale_if_its_source_or_what_it_read_changed(tmp_path, monkeypatch):
    """An agent's file is opened by a library that is not written in Python."""
    results = {name: tmp_path / "data" / name for name in ("a.csv", "b.csv", "a.safetensors")}
    (tmp_path / "data").mkdir()
    for path in results.values():
        save_file({"weight": np.zeros(1)}, path)
    script = tmp_path / "notebooks" / "00_test.py"
    script.parent.mkdir()
    script.write_text(
        '# %%\nname = "a"\nopen(f"../data/{name}.csv", "rb").read()\n'
        "from safetensors import safe_open\n"
        'safe_open("../data/a.safetensors", framework="np").keys()\n'
    )
    monkeypatch.setattr(execute, "HERE", script.parent)
    execute.execute(script)
    for name, path in results.items():
        before = path.read_bytes()
        path.write_text("after")
        assert execute.is_fresh(script) == (name == "b.csv")
        path.unlink()
        assert execute.is_fresh(script) == (name == "b.csv")
        path.write_bytes(before)
        assert execute.is_fresh(script)
    script.write_text(f"{script.read_text()}\n# %%\n1 + 1\n")
    assert not execute.is_fresh(script)


@pytest.mark.parametrize(
    "script", SCRIPTS + execute.exercise_scripts(), ids=lambda one: f"{one.parent.name}-{one.stem}"
)
def test_the_first_code_cell_finds_the_library_anywhere(script):
    """Where it is not installed, as on Colab: the same cell in all, also in what students get."""
    path = execute.notebook_of(script)
    if execute.is_exercise(script):
        path = execute.HERE / "exercises" / script.stem / path.name
    notebook, first = read(path), read(execute.notebook_of(SCRIPTS[0]))
    assert code(notebook)[0].source == code(first)[0].source
    assert "%pip install" in code(notebook)[0].source
    assert code(notebook)[0].metadata.tags == ["remove-cell"]


def test_template(notebook):
    words = text(notebook)
    assert notebook.cells[0].source.startswith("# ")
    assert all(section in words for section in SECTIONS)
    # Without its `# %% [markdown]` line, a section becomes comments of the cell before it
    assert not [cell.source for cell in code(notebook) if re.search("^# ##", cell.source, re.M)]
    assert any("image/png" in o.get("data", {}) for cell in code(notebook) for o in cell.outputs)


def test_nothing_that_belongs_to_one_machine(script, notebook):
    content = execute.notebook_of(script).read_text()
    assert len(content) < 1_000_000
    assert not re.search(r"/home/|/work/|/tmp/|/root/|C:\\\\", content)
    assert "widgets" not in notebook.metadata
    assert all("execution" not in cell.metadata for cell in notebook.cells)


@pytest.mark.parametrize(
    "script",
    SCRIPTS + execute.exercise_scripts() + execute.project_scripts(),
    ids=lambda one: f"{one.parent.name}-{one.stem}",
)
def test_jupytext_opens_the_script_by_itself_and_its_first_cell_runs(script, tmp_path, monkeypatch):
    """As somebody does who has only the file; `python` reads it, too."""
    copy = tmp_path / script.name
    copy.write_bytes(script.read_bytes())
    assert jupytext_cli(["--quiet", "--to", "ipynb", str(copy)]) == 0
    cells = [cell.source for cell in code(read(copy.with_suffix(".ipynb")))]
    shell = TransformerManager()
    assert cells == [cell.source for cell in code(execute.from_script(script))]
    for source in cells:
        ast.parse(shell.transform_cell(source))
    waits = ast.PyCF_ALLOW_TOP_LEVEL_AWAIT  # for the training in 7
    compile(script.read_text(encoding="utf-8"), script.name, "exec", flags=waits)
    monkeypatch.chdir(script.parent)
    exec(compile(shell.transform_cell(cells[0]), script.name, "exec"), {})
    assert Path.cwd() == NOTEBOOKS


@pytest.mark.parametrize("stem", BRIEFLY)
def test_the_code_of_a_notebook_that_trains_for_long_runs(stem, tmp_path, monkeypatch):
    """In full, and in a kernel of its own, it is one of the long tests."""
    monkeypatch.chdir(tmp_path)  # 7 saves an agent
    monkeypatch.setattr(live, "display", lambda *_, **named: DisplayHandle())
    (script,) = (each for each in SCRIPTS if each.stem == stem)
    assert all(steps in script.read_text(encoding="utf-8") for steps in BRIEFLY[stem])
    space, waits = {"__name__": "__main__"}, ast.PyCF_ALLOW_TOP_LEVEL_AWAIT
    for cell in code(execute.from_script(script))[1:]:  # the first finds the library
        source = re.sub(r"\d+(?=, seed=)", "50", cell.source)  # missions
        for steps, few in BRIEFLY[stem].items():
            source = source.replace(steps, few)
        waited = eval(compile(re.sub("(?m)^%.*", "", source), stem, "exec", waits), space)
        if waited:
            asyncio.run(waited)
    plt.close("all")
