"""nbgrader's configuration of this course: run its commands in this folder."""

from nbgrader.converters import GenerateAssignment
from nbgrader.preprocessors import ClearSolutions


class NumberedStubs(ClearSolutions):
    """What replaces a solution names the exercise, so that its error does too."""

    def preprocess_cell(self, cell, resources, cell_index):
        number = cell.metadata.get("nbgrader", {}).get("grade_id", "").replace("-", ".")
        self.code_stub = {"python": f'raise NotImplementedError("exercise {number}")'}
        return super().preprocess_cell(cell, resources, cell_index)


c = get_config()  # noqa: F821 (nbgrader defines it)
c.CourseDirectory.course_id = "uavdh_lite"
c.CourseDirectory.source_directory = "solutions"
c.CourseDirectory.release_directory = "exercises"
c.GenerateAssignment.preprocessors = [
    NumberedStubs if step is ClearSolutions else step
    for step in GenerateAssignment.class_traits()["preprocessors"].default()
]
c.ExecutePreprocessor.timeout = 180  # seconds a cell: 6.3 trains an agent
c.ExecutePreprocessor.interrupt_on_timeout = True  # the check says in which line, and others count
c.ClearSolutions.enforce_metadata = True
