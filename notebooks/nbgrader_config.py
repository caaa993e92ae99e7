"""nbgrader's configuration of this course: run its commands in this folder."""

import base64
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
from uavdh_lite.course.walls import Lost, Walled, judged, program
from uavdh_lite.errors import InputError

PRINTED = 100_000  # characters of a cell that are kept
LARGEST_FIGURE = 2_000_000  # bytes
CALL = re.compile(r"checks\.(\w+)\((\w+)\)")  # of a graded cell


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
        self.ends = time.monotonic() + self.whole
        stamp = Path(resources["metadata"]["path"], "timestamp.txt")
        handed_in = stamp.read_text() if stamp.exists() else None
        if handed_in:
            stamp.write_text("1970-01-01 00:00:00 UTC")
        self.cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
        self.walled, self.lost = None, []  # the process, and cells that took one with them
        try:
            for cell in self.cells:
                cell.outputs = self._outputs(cell)
        finally:
            if self.walled:
                self.walled.__exit__()
        if handed_in:
            stamp.write_text(handed_in)
        return notebook, resources

    def _outputs(self, cell):
        """What a cell gives."""
        try:
            if not self.walled:
                self._begin_again(cell)
            return self._judged(cell) if is_grade(cell) else self._run(cell)
        except Lost as lost:
            self.lost.append(cell)
            self.walled.__exit__()
            self.walled = None
            said = f"This cell gets no points: {lost}."
            return [new_output("error", ename="Lost", evalue=said, traceback=[said])]

    def _begin_again(self, until):
        """A new process, in which all cells before this one have run but those that were lost."""
        self.walled = Walled(unprotected=self.unprotected)
        for cell in self.cells:
            if cell is until:
                return
            if not is_grade(cell) and not any(cell is one for one in self.lost):
                self._run(cell)

    def _seconds(self):
        """How long a cell may take: the sheet has a limit, too."""
        left = self.ends - time.monotonic()
        if left < 0:
            raise Lost(f"the cells before it took the {self.whole} s of a sheet")
        return min(self.timeout, left)

    def _run(self, cell):
        self.walled.begin(self._seconds())
        reply = self.walled.ask({"run": cell.source})
        try:
            return _outputs(reply["said"], reply["figures"], reply["errors"])
        except Exception as error:  # whatever a hostile process has sent
            raise Lost(f"what it gives cannot be read ({type(error).__name__})") from None

    def _judged(self, cell):
        name, answer = CALL.fullmatch(cell.source.strip()).groups()
        said, wrong = judged(self.walled, EXERCISES[name], answer, self._seconds())
        return _outputs(said, [], [["CheckFailed", wrong, [wrong]]] if wrong else [])


def _outputs(said, figures, errors):
    """Outputs that hold nothing but text and PNG, whatever a process within the walls has sent."""
    outputs = [new_output("stream", text=_readable(said, PRINTED))] if said else []
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
