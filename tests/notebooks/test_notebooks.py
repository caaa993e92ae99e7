"""The notebooks' form: pairs, fresh outputs, the template. nbval runs what is in them."""

import re
from pathlib import Path
from statistics import median

import execute
import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
SECTIONS = ("What you'll do", "What you'll learn", "What you'll need", "Recap", "Exercises")


SCRIPTS = execute.scripts()


@pytest.fixture(params=SCRIPTS, ids=lambda script: script.stem)
def script(request):
    return request.param


@pytest.fixture
def notebook(script):
    return nbformat.read(execute.notebook_of(script), as_version=4)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def text(notebook):
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")


def test_every_notebook_has_its_script():
    names = {path.stem for path in NOTEBOOKS.glob("[0-9]*.ipynb")}
    assert names == {path.stem for path in SCRIPTS} and names


@pytest.mark.parametrize(
    "script", SCRIPTS + execute.exercise_scripts(), ids=lambda one: f"{one.parent.name}-{one.stem}"
)
def test_the_notebook_was_executed_from_this_script_without_errors(script):
    notebook = nbformat.read(execute.notebook_of(script), as_version=4)
    expected = execute.from_script(script)
    assert [cell.source for cell in notebook.cells] == [cell.source for cell in expected.cells]
    assert execute.is_fresh(script), f"run: python notebooks/execute.py {script.stem[:2]}"
    cells = code(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert "error" not in {output.output_type for output in outputs}
    assert "stderr" not in {o.name for o in outputs if o.output_type == "stream"}


@pytest.mark.parametrize("script", execute.exercise_scripts(), ids=lambda one: one.stem)
def test_solutions_are_right(notebook):
    checked = [cell for cell in code(notebook) if cell.source.startswith("checks.")]
    assert all("right." in cell.outputs[-1].text for cell in checked) and len(checked) >= 2


def test_tutorials_and_exercises_have_the_same_names():
    """All but the one about other libraries, whose few exercises are in the tutorial."""
    tutorials = [s.name for s in SCRIPTS if s.name != "11_gymnasium.py"]
    assert [s.name for s in execute.exercise_scripts()] == tutorials


def test_a_changed_script_is_stale_and_one_that_names_a_changed_result(tmp_path, monkeypatch):
    named = ("checkpoints/manhattan_ddqn.safetensors", "runs/centring-village.csv.gz")
    others = ("checkpoints/manhattan.safetensors", "runs/centring-village-training.csv.gz")
    results = {name: tmp_path / "data" / name for name in named + others}
    for path in results.values():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("before")
    script = tmp_path / "notebooks" / "00_test.py"
    script.parent.mkdir()
    script.write_text('# %%\nload_agent("manhattan_ddqn"), "data/runs/centring-village.csv.gz"\n')
    monkeypatch.setattr(execute, "HERE", script.parent)
    nbformat.write(execute.from_script(script), execute.notebook_of(script))
    for name, path in results.items():
        path.write_text("after")
        assert execute.is_fresh(script) == (name in others)
        path.write_text("before")
        assert execute.is_fresh(script)
    script.write_text(f"{script.read_text()}\n# %%\n1 + 1\n")
    assert not execute.is_fresh(script)


def test_the_first_code_cell_finds_the_library_anywhere(notebook):
    """Where it is not installed, as on Colab: the same cell in all."""
    first = nbformat.read(execute.notebook_of(SCRIPTS[0]), as_version=4)
    assert code(notebook)[0].source == code(first)[0].source
    assert "%pip install" in code(notebook)[0].source
    assert code(notebook)[0].metadata.tags == ["remove-cell"]


def test_template(notebook):
    words = text(notebook)
    assert notebook.cells[0].source.startswith("# ")
    for section in SECTIONS:
        assert section in words, section
    assert re.search(r"\d+ minutes to read, \d+ seconds to run; \d+ minutes of exercises", words)
    lengths = [len(cell.source.splitlines()) for cell in code(notebook)[1:]]
    assert median(lengths) <= 6
    assert sorted(lengths)[int(0.8 * len(lengths))] <= 12
    assert any("image/png" in o.get("data", {}) for cell in code(notebook) for o in cell.outputs)


def test_the_list_of_tutorials_says_how_long_each_takes(script, notebook):
    index = (execute.HERE.parent / "docs" / "tutorials" / "index.md").read_text()
    read, run = re.search(r"(\d+) minutes to read, (\d+) seconds to run", text(notebook)).groups()
    assert re.search(rf"\({script.stem}\.ipynb\) \|.*\| {read} min \| {run} s \|", index)


def test_no_prose_is_lost_in_a_code_cell(notebook):
    """Without its `# %% [markdown]` line, a section becomes comments of the cell before it."""
    assert not [cell.source for cell in code(notebook) if re.search("^# ##", cell.source, re.M)]


def test_nothing_that_belongs_to_one_machine(script, notebook):
    content = execute.notebook_of(script).read_text()
    assert len(content) < 1_000_000
    assert not re.search(r"/home/|/work/|/tmp/|/root/|C:\\\\", content)
    assert "widgets" not in notebook.metadata
    assert all("execution" not in cell.metadata for cell in notebook.cells)
