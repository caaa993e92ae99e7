"""The exercises through nbgrader's real commands: released, submitted, graded, fed back."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import assignments
import matplotlib
import nbformat
import pytest

from uavdh_lite.course import checks

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
ASSIGNMENT = "01_city_and_channel"
MIXED = {  # one right, one wrong, and the third left as it was
    "1.1": "return np.log2(1 + 10 ** (snr_db / 10))",
    "1.2": "return nlos_distance_m ** (2.27 / 3.64)",
}
STEMS = sorted(path.name for path in (NOTEBOOKS / "solutions").iterdir() if path.is_dir())


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """A course with one assignment, and what nbgrader made of two submissions to it."""
    root = tmp_path_factory.mktemp("course")
    shutil.copy(NOTEBOOKS / "nbgrader_config.py", root)
    for folder in ("solutions", "exercises"):
        shutil.copytree(NOTEBOOKS / folder / ASSIGNMENT, root / folder / ASSIGNMENT)
    nbgrader(root, "generate_assignment", "--force", ASSIGNMENT)
    file = f"{ASSIGNMENT}/{ASSIGNMENT}.ipynb"
    submit(root, "full", nbformat.read(root / "solutions" / file, as_version=4))
    notebook = nbformat.read(root / "exercises" / file, as_version=4)
    for number, text in MIXED.items():
        stub = f'raise NotImplementedError("exercise {number}")'
        cell = next(cell for cell in notebook.cells if stub in cell.source)
        cell.source = cell.source.replace(stub, text)
    submit(root, "mixed", notebook)
    nbgrader(root, "autograde", ASSIGNMENT)
    nbgrader(root, "generate_feedback", ASSIGNMENT)
    nbgrader(root, "export")
    return root


def nbgrader(root, *command):
    path = assignments.path_with_commands()
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "HOME": str(root), "PATH": path}
    environment["MPLCONFIGDIR"] = matplotlib.get_cachedir()  # else it looks for all fonts again
    done = subprocess.run(
        [sys.executable, "-m", "nbgrader", *command],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def submit(root, student, notebook):
    folder = root / "submitted" / student / ASSIGNMENT
    folder.mkdir(parents=True)
    nbformat.write(notebook, folder / f"{ASSIGNMENT}.ipynb")


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.parametrize(
    "student, points",
    [("full", {"1.1": 1, "1.2": 2, "1.3": 2}), ("mixed", {"1.1": 1, "1.2": 0, "1.3": 0})],
)
def test_autograde(course, student, points):
    from nbgrader.api import Gradebook

    with Gradebook(f"sqlite:///{course / 'gradebook.db'}", "uavdh_lite") as book:
        submission = book.find_submission(ASSIGNMENT, student)
        grades = {grade.name: grade.auto_score for grade in submission.notebooks[0].grades}
        names = {number: f"check-{number.replace('.', '-')}" for number in points}
        assert grades == {names[number]: value for number, value in points.items()}
        assert submission.max_score == 5 and not submission.needs_manual_grade


@pytest.mark.long
@pytest.mark.longest
def test_the_commands_are_those_of_the_guide(course):
    guide = (NOTEBOOKS.parent / "docs" / "teach" / "index.md").read_text()
    for command in ("generate_assignment --force", "autograde", "generate_feedback"):
        assert f"nbgrader {command} {ASSIGNMENT}" in guide
    grades = (course / "grades.csv").read_text().splitlines()
    assert sorted(line.split(",")[3] for line in grades[1:]) == ["full", "mixed"]


@pytest.mark.long
@pytest.mark.longest
def test_feedback_says_what_is_wrong(course):
    page = (course / "feedback" / "mixed" / ASSIGNMENT / f"{ASSIGNMENT}.html").read_text()
    assert "the distance in sight is the longer" in page
    assert "is not written yet" in page


@pytest.mark.long
def test_students_notebooks_are_what_nbgrader_makes_of_the_solutions(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", os.environ["PATH"])  # restored afterwards
    assignments.release(STEMS, tmp_path)
    for stem in STEMS:
        made = nbformat.read(tmp_path / stem / f"{stem}.ipynb", as_version=4)
        kept = nbformat.read(NOTEBOOKS / "exercises" / stem / f"{stem}.ipynb", as_version=4)
        assert made == kept, "run: python notebooks/execute.py"
    assert sorted(p.name for p in (NOTEBOOKS / "exercises").iterdir() if p.is_dir()) == STEMS


@pytest.mark.parametrize("stem", STEMS)
def test_students_notebooks_hold_no_solutions_and_all_points(stem):
    kept = nbformat.read(NOTEBOOKS / "exercises" / stem / f"{stem}.ipynb", as_version=4)
    text = "\n".join(cell.source for cell in kept.cells)
    every = checks.EXERCISES.values()
    own = [one for one in every if int(one.number.split(".")[0]) == int(stem[:2])]
    assert "SOLUTION" not in text and "jupytext" not in kept.metadata
    assert not any(cell.get("outputs") for cell in kept.cells)
    assert all(f'NotImplementedError("exercise {one.number}")' in text for one in own)
    graded = [cell.metadata.nbgrader for cell in kept.cells if "nbgrader" in cell.metadata]
    assert sum(cell.get("points", 0) for cell in graded) == sum(one.points for one in own)
