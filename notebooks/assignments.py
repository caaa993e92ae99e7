"""The exercises as nbgrader assignments: what is solved, what is graded, and the students' version.

scripts/exercises/NN_topic.py → solutions/NN_topic/NN_topic.ipynb (executed) → exercises/NN_topic/,
which nbgrader itself makes of it with `nbgrader_config.py`.
"""

import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

import nbformat

from uavdh_lite.course import checks

HERE = Path(__file__).parent
CONFIG = HERE / "nbgrader_config.py"


def mark_cells(notebook: nbformat.NotebookNode) -> None:
    """Tell nbgrader which cells are solved and which are graded, and for how many points.

    A cell that calls a check is graded, with the points of its exercise; the nearest cell with a
    solution before it is the one that students write.
    """
    solution, said = None, ""
    for cell in notebook.cells:
        cell.metadata.pop("lines_to_next_cell", None)
        said += cell.source + "\n"
        if cell.cell_type != "code":
            continue
        if "### BEGIN SOLUTION" in cell.source and "### END SOLUTION" in cell.source:
            solution = cell
        if called := re.match(r"checks\.(\w+)\(", cell.source):
            solution, wanted = None, _marked(cell.source, called[1], solution, said)
            exercise = checks.EXERCISES[called[1]]
            grade_id = exercise.number.replace(".", "-")
            wanted.metadata.nbgrader = _cell(grade_id, solution=True)
            cell.metadata.nbgrader = _cell(f"check-{grade_id}", points=exercise.points)


def _marked(call: str, name: str, solution, said: str):
    """The cell with the solution of a check; `ValueError` if it, or the heading, is not there."""
    if name not in checks.EXERCISES:
        raise ValueError(f"cell {call!r}: no page in uavdh_lite/course/checks has {name}")
    if solution is None:
        marks = "`### BEGIN SOLUTION` and `### END SOLUTION`"
        raise ValueError(f"cell {call!r}: no cell with {marks} between the check before and it")
    heading = f"## {checks.EXERCISES[name].heading}"
    if f"{heading}\n" not in said:
        raise ValueError(
            f"cell {call!r}: the heading before it must be {heading!r}, as on its page"
        )
    return solution


def _cell(grade_id: str, points: int | None = None, solution: bool = False) -> dict:
    graded = {} if points is None else {"points": points}
    return {
        "grade": points is not None,
        "grade_id": grade_id,
        "locked": not solution,
        "schema_version": 3,
        "solution": solution,
        "task": False,
        **graded,
    }


def path_with_commands() -> str:
    """PATH with this environment's commands: nbgrader runs one of them, alembic, by its name."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])


def release(assignments: list[str], exercises: Path) -> None:
    """Make the students' notebooks of these assignments in `exercises`, by nbgrader's own command.

    It runs in a folder of its own, so that no grade book is touched.
    """
    from nbgrader.apps import NbGraderAPI
    from traitlets.config import PyFileConfigLoader

    os.environ["PATH"] = path_with_commands()
    with tempfile.TemporaryDirectory() as root:
        config = PyFileConfigLoader(CONFIG.name, str(CONFIG.parent)).load_config()
        config.CourseDirectory.root = root
        nbgrader = NbGraderAPI(config=config)
        for assignment in assignments:
            shutil.copytree(HERE / "solutions" / assignment, Path(root, "solutions", assignment))
            result = nbgrader.generate_assignment(assignment)
            if not result["success"]:
                raise RuntimeError(f"{assignment}: {result.get('error') or result['log']}")
            shutil.rmtree(exercises / assignment, ignore_errors=True)
            shutil.copytree(Path(root, "exercises", assignment), exercises / assignment)
