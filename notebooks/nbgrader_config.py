"""nbgrader's configuration of this course: run its commands in this folder."""

import base64
import io
import re
import sys
import time
from pathlib import Path

from nbformat.v4 import new_output
from nbgrader.converters import Autograde, GenerateAssignment
from nbgrader.preprocessors import ClearSolutions, Execute, NbGraderPreprocessor, SaveAutoGrades
from nbgrader.utils import is_grade
from traitlets import Bool, Integer

from uavdh_lite.course.checks import EXERCISES
from uavdh_lite.course.walls import BESIDE, Lost, Walled, judged, program
from uavdh_lite.errors import InputError

PRINTED = 100_000  # characters of a cell that are kept
LARGEST_FIGURE = 2_000_000  # bytes
CALL = re.compile(r"checks\.(\w+)\((\w+)\)")  # of a graded cell
FRESH_CHECKS = """
import importlib, sys
for _name in [name for name in sys.modules if name.startswith("uavdh_lite.course")]:
    del sys.modules[_name]
checks = importlib.import_module("uavdh_lite.course.checks")
"""


class NumberedStubs(ClearSolutions):
    """What replaces a solution names the exercise, so that its error does too."""

    def preprocess_cell(self, cell, resources, cell_index):
        number = cell.metadata.get("nbgrader", {}).get("grade_id", "").replace("-", ".")
        self.code_stub = {"python": f'raise NotImplementedError("exercise {number}")'}
        return super().preprocess_cell(cell, resources, cell_index)


class WithinWalls(NbGraderPreprocessor):
    """Runs the cells within walls, and judges the answers from outside.

    No answer costs another one its points. Where a cell ends its process, or does not let go when
    it is interrupted, it has failed: the cells before it run once more, and the next one follows.
    Of what is printed and drawn, only text and PNG remain.

    nbgrader leaves alone what has the time of what was handed in. A sheet gets it when it has been
    graded, so that one at which grading was stopped is graded when it goes on.
    """

    timeout = Integer(180, help="seconds for a cell: 7.1 and 7.4 train an agent").tag(config=True)
    whole = Integer(900, help="seconds for a sheet, all in all").tag(config=True)
    unprotected = Bool(False, help="whether there are no walls").tag(config=True)

    def preprocess(self, notebook, resources):
        try:
            self.unprotected or program()
        except InputError as error:  # of all students: nobody is graded
            sys.exit(f"{error} (here: --WithinWalls.unprotected=True)")
        self.lost = set()  # cells that took their process with them
        self.ends = time.monotonic() + self.whole
        stamp = Path(resources["metadata"]["path"], "timestamp.txt")
        handed_in = stamp.read_text() if stamp.exists() else None
        if handed_in:
            stamp.write_text("1970-01-01 00:00:00 UTC")
        calls = [CALL.fullmatch(cell.source.strip()) for cell in notebook.cells if is_grade(cell)]
        beside = {call[1] in BESIDE for call in calls}
        self.cells, self.walled = notebook.cells, {}  # a process with the checks, one without
        try:
            for index, cell in enumerate(notebook.cells):
                if cell.cell_type == "code":
                    cell.outputs = self._outputs(cell, index, beside)
        finally:
            for one in self.walled.values():
                one.__exit__()
        if handed_in:
            stamp.write_text(handed_in)
        return notebook, resources

    def _outputs(self, cell, index, beside):
        """What a cell gives; it runs in each process that its sheet needs."""
        outputs = []
        call = CALL.fullmatch(cell.source.strip()) if is_grade(cell) else None
        # What is kept of a cell that is not graded is from the process without the checks
        for checks in [call[1] in BESIDE] if call else sorted(beside, reverse=True):
            try:
                if checks not in self.walled:
                    self._begin_again(checks, index)
                outputs = self._judged(cell, *call.groups()) if call else self._run(cell, checks)
            except Lost as lost:
                self.lost.add(index)
                self.walled.pop(checks).__exit__()
                said = f"This cell gets no points: {lost}."
                outputs = [new_output("error", ename="Lost", evalue=said, traceback=[said])]
        return outputs

    def _begin_again(self, checks, index):
        """A new process, in which all cells up to this one have run but those that were lost."""
        self.walled[checks] = Walled(checks=checks, unprotected=self.unprotected)
        for k, cell in enumerate(self.cells[:index]):
            if cell.cell_type == "code" and not is_grade(cell) and k not in self.lost:
                self._run(cell, checks)

    def _seconds(self):
        """How long a cell may take: the sheet has a limit, too."""
        left = self.ends - time.monotonic()
        if left < 0:
            raise Lost(f"the cells before it took the {self.whole} s of a sheet")
        return min(self.timeout, left)

    def _run(self, cell, checks, before=""):
        walled = self.walled[checks]
        walled.begin(self._seconds())
        reply = walled.ask({"run": before + cell.source})
        try:
            return _outputs(reply["said"], reply["figures"], reply["errors"])
        except Exception as error:  # whatever a hostile process has sent
            raise Lost(f"what it gives cannot be read ({type(error).__name__})") from None

    def _judged(self, cell, name, answer):
        if name in BESIDE:
            return self._run(cell, True, FRESH_CHECKS)
        exercise = EXERCISES[name]
        said, wrong = judged(self.walled[False], exercise, answer, self._seconds())
        figures = []
        if exercise.figure and not wrong:
            content = io.BytesIO()
            exercise.picture().savefig(content, format="png", dpi=72)
            figures = [base64.b64encode(content.getvalue()).decode()]
        return _outputs(said, figures, [["CheckFailed", wrong, [wrong]]] if wrong else [])


def _outputs(said, figures, errors):
    """Outputs that hold nothing but text and PNG, whatever a process within the walls has sent."""
    said = _readable(said, PRINTED)
    outputs = [new_output("stream", text=said)] if said else []
    for figure in figures[:10]:
        content = base64.b64decode(figure)
        if content.startswith(b"\x89PNG\r\n") and len(content) < LARGEST_FIGURE:
            data = {"image/png": base64.b64encode(content).decode()}
            outputs.append(new_output("display_data", data))
    for kind, text, lines in errors[:1]:
        told = {"ename": _readable(kind, 100), "evalue": _readable(text, 2000)}
        told["traceback"] = [_readable(line, 2000) for line in lines[:50]]
        outputs.append(new_output("error", **told))
    return outputs


def _readable(text, most):
    """A text that a file can hold: JSON can say what is no character."""
    return str(text)[:most].encode(errors="replace").decode()


class SaveRunGrades(SaveAutoGrades):
    """Saves no points of a check that did not run: nbgrader would give all of them."""

    def preprocess_cell(self, cell, resources, cell_index):
        if is_grade(cell) and not cell.outputs:
            raise RuntimeError(f"{cell.metadata.nbgrader.grade_id} did not run: grade it again")
        return super().preprocess_cell(cell, resources, cell_index)


c = get_config()  # noqa: F821 (nbgrader defines it)
c.CourseDirectory.course_id = "uavdh_lite"
c.CourseDirectory.source_directory = "solutions"
c.CourseDirectory.release_directory = "exercises"
# What `uavdh_lite classroom check` makes of submitted/
c.CourseDirectory.submitted_directory = "checked"
c.GenerateAssignment.preprocessors = [
    NumberedStubs if step is ClearSolutions else step
    for step in GenerateAssignment.class_traits()["preprocessors"].default()
]
OURS = {Execute: WithinWalls, SaveAutoGrades: SaveRunGrades}
c.Autograde.autograde_preprocessors = [
    OURS.get(step, step) for step in Autograde.class_traits()["autograde_preprocessors"].default()
]
c.ClearSolutions.enforce_metadata = True
