"""nbgrader's configuration of this course: run its commands in this folder."""

import copy
from pathlib import Path

from nbclient.exceptions import CellTimeoutError, DeadKernelError
from nbformat.v4 import new_output
from nbgrader.converters import Autograde, GenerateAssignment
from nbgrader.preprocessors import ClearSolutions, Execute
from nbgrader.utils import is_grade

MOST_OUTPUT = 100_000  # characters of a cell that are kept
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


class EachByItself(Execute):
    """Runs the cells so that no answer costs another one its points.

    A cell that ends its kernel, or does not let go when it is interrupted, has failed: the cells
    before it run once more in a new kernel, and the next one follows. Before each graded cell,
    `checks` is imported anew, whatever the cells before it made of that name.

    nbgrader leaves alone what has the time of what was handed in. A sheet gets it when it has been
    graded, so that one at which grading was stopped is graded when it goes on.
    """

    def preprocess(self, notebook, resources=None, km=None):
        self.lost = set()  # cells that took their kernel with them
        stamp = Path(resources["metadata"]["path"], "timestamp.txt")
        handed_in = stamp.read_text() if stamp.exists() else None
        if handed_in:
            stamp.write_text("1970-01-01 00:00:00 UTC")
        done = super().preprocess(notebook, resources, km)
        if handed_in:
            stamp.write_text(handed_in)
        return done

    def preprocess_cell(self, cell, resources, index):
        if cell.cell_type == "code":
            self._execute(cell, index)
        return cell, resources

    def _execute(self, cell, index):
        try:
            if is_grade(cell):
                asked = self.kc.execute(FRESH_CHECKS, store_history=False)
                if self.wait_for_reply(asked)["content"]["status"] != "ok":
                    raise DeadKernelError("nothing can be checked after what the cells before did")
            self.execute_cell(cell, index)
        except (CellTimeoutError, DeadKernelError) as error:
            self.lost.add(index)
            hung = isinstance(error, CellTimeoutError)
            said = "it never ends, and cannot be interrupted" if hung else "it ended its own kernel"
            said = f"This cell gets no points: {said}."
            failed = new_output("error", ename="Lost", evalue=said, traceback=[said])
            cell.outputs = [*cell.outputs, failed]
            self._begin_again(index)

    def _begin_again(self, index):
        """A new kernel, in which all cells up to this one have run but those that were lost."""
        self._cleanup_kernel()
        self.km = self.create_kernel_manager()
        self.start_new_kernel()
        self.start_new_kernel_client()
        for k, cell in enumerate(self.nb.cells[:index]):
            if cell.cell_type == "code" and not is_grade(cell) and k not in self.lost:
                self._execute(copy.deepcopy(cell), k)

    def output(self, outputs, message, display_id, cell_index):
        size = len(str(message["content"]))
        if sum(len(str(one)) for one in outputs[-100:]) + size < MOST_OUTPUT and len(outputs) < 100:
            return super().output(outputs, message, display_id, cell_index)
        return None


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
c.Autograde.autograde_preprocessors = [
    EachByItself if step is Execute else step
    for step in Autograde.class_traits()["autograde_preprocessors"].default()
]
c.ExecutePreprocessor.timeout = 180  # seconds a cell: 7.1 and 7.4 train an agent
c.ExecutePreprocessor.interrupt_on_timeout = True  # the check says in which line, and others count
c.ExecutePreprocessor.shutdown_kernel = "immediate"
c.ClearSolutions.enforce_metadata = True
