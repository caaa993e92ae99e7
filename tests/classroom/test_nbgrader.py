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
FILE = f"{ASSIGNMENT}/{ASSIGNMENT}.ipynb"
SOLVED = {
    "1.1": "return np.log2(1 + 10 ** (snr_db / 10))",
    "1.2": "return nlos_distance_m ** (3.64 / 2.27)",
    "1.3": "return library_rate(snr_db + generator.normal(0, variance_db2**0.5, draws)).mean()",
}
STUDENTS = {  # what each wrote, and the points for it
    "all": (SOLVED, [1, 2, 2]),
    "one": ({"1.1": SOLVED["1.1"]}, [1, 0, 0]),
    "wrong": (SOLVED | {"1.2": "return nlos_distance_m ** (2.27 / 3.64)"}, [1, 0, 2]),
    "endless": (SOLVED | {"1.2": "while True:\n        nlos_distance_m += 1"}, [1, 0, 2]),
}
STEMS = sorted(path.name for path in (NOTEBOOKS / "solutions").iterdir() if path.is_dir())


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """A course of five students with one assignment; one of them handed in garbage."""
    root = tmp_path_factory.mktemp("course")
    config = (NOTEBOOKS / "nbgrader_config.py").read_text()
    assert "timeout = 180" in config
    (root / "nbgrader_config.py").write_text(config.replace("timeout = 180", "timeout = 40"))
    shutil.copytree(NOTEBOOKS / "solutions" / ASSIGNMENT, root / "solutions" / ASSIGNMENT)
    nbgrader(root, "generate_assignment", "--force", ASSIGNMENT)
    for student, (written, _) in STUDENTS.items():
        notebook = nbformat.read(root / "exercises" / FILE, as_version=4)
        for number, text in written.items():
            stub = f'raise NotImplementedError("exercise {number}")'
            cell = next(cell for cell in notebook.cells if stub in cell.source)
            cell.source = cell.source.replace(stub, text)
        (root / "submitted" / student / ASSIGNMENT).mkdir(parents=True)
        nbformat.write(notebook, root / "submitted" / student / FILE)
    (root / "submitted" / "garbage" / ASSIGNMENT).mkdir(parents=True)
    (root / "submitted" / "garbage" / FILE).write_text("this is no notebook")
    said = nbgrader(root, "autograde", ASSIGNMENT, fails=True)
    assert "garbage" in said
    nbgrader(root, "generate_feedback", ASSIGNMENT)
    nbgrader(root, "export")
    return root


def nbgrader(root, *command, fails=False):
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
    assert fails or done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.long
@pytest.mark.longest
def test_each_student_gets_the_points_of_the_exercises_that_are_right(course):
    from nbgrader.api import Gradebook

    with Gradebook(f"sqlite:///{course / 'gradebook.db'}", "uavdh_lite") as book:
        for student, (_, points) in STUDENTS.items():
            submission = book.find_submission(ASSIGNMENT, student)
            grades = {grade.name: grade.auto_score for grade in submission.notebooks[0].grades}
            assert grades == dict(zip(("check-1-1", "check-1-2", "check-1-3"), points, strict=True))
            assert submission.max_score == 5 and not submission.needs_manual_grade


@pytest.mark.long
@pytest.mark.longest
def test_the_commands_are_those_of_the_guide(course):
    guide = (NOTEBOOKS.parent / "docs" / "teach" / "index.md").read_text()
    for command in ("generate_assignment --force", "autograde", "generate_feedback"):
        assert f"nbgrader {command} {ASSIGNMENT}" in guide
    grades = (course / "grades.csv").read_text().splitlines()
    assert {line.split(",")[3] for line in grades[1:]} >= {*STUDENTS}


@pytest.mark.long
@pytest.mark.longest
def test_feedback_says_what_is_wrong(course):
    said = {s: (course / "feedback" / s / FILE).with_suffix(".html").read_text() for s in STUDENTS}
    assert "in sight is the longer" in said["wrong"] and "is not written yet" in said["one"]
    assert "Is there a loop that never ends" in said["endless"]


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
