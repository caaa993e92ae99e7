"""`classroom`: what a class hands in, before and after nbgrader grades it."""

from pathlib import Path

from cyclopts import App

from uavdh_lite.course import exam as exams
from uavdh_lite.course import handed_in
from uavdh_lite.errors import one_line

classroom = App("classroom", help="Collect, look through and give back a class's exercises.")
COURSE = Path(".")


@classroom.command
def collect(archive: Path, assignment: str, /, *, course: Path = COURSE) -> None:
    """Unpack Moodle's zip of all submissions into submitted/.

    What a student has in an earlier zip is replaced.

    Arguments:
        archive: the zip that Moodle calls "Download all submissions".
        assignment: its name, such as 01_city_and_channel.
        course: the folder with exercises/ in it.
    """
    students, odd = handed_in.collect(archive, course, assignment)
    for name in odd:
        print(f"- {one_line(name)} is set aside")
    print(f"{course / 'submitted'}: {assignment} of {len(students)} students")


@classroom.command
def check(assignment: str, /, *, course: Path = COURSE) -> None:
    """Look through what was handed in, say what is odd, and write what nbgrader is to grade.

    submitted/ stays as it is. What can be mended is mended in the copy, checked/.

    Arguments:
        assignment: its name, such as 01_city_and_channel.
        course: the folder with exercises/ and submitted/ in it.
    """
    sheets = handed_in.look_through(course, assignment)
    for sheet in sheets:
        print(f"{one_line(sheet.student)}: {sheet.answered} answered")
        for note in sheet.notes + [f"{note} (for you alone)" for note in sheet.private]:
            print(f"  - {one_line(note)}")
    aside = sum(sheet.notebook is None for sheet in sheets)
    print(f"{len(sheets)} students, {aside} without anything to grade")


@classroom.command(name="return")
def give_back(assignment: str, archive: Path, /, *, course: Path = COURSE) -> None:
    """Pack the feedback as a zip that Moodle gives back.

    Arguments:
        assignment: its name, such as 01_city_and_channel.
        archive: the zip to write, for Moodle's "Upload multiple feedback files in a zip".
        course: the folder with feedback/ in it.
    """
    students = handed_in.give_back(archive, course, assignment)
    print(f"{archive}: feedback for {len(students)} students")


@classroom.command
def marks(
    assignment: str,
    worksheet: Path,
    filled: Path,
    /,
    *,
    course: Path = COURSE,
    column: str = "Grade",
) -> None:
    """Fill in Moodle's grading worksheet with the points that nbgrader has given.

    Arguments:
        assignment: its name, such as 01_city_and_channel.
        worksheet: the CSV that Moodle calls "Download grading worksheet".
        filled: the CSV to write, for Moodle's "Upload grading worksheet".
        course: the folder with gradebook.db in it.
        column: the name of the grade's column, where Moodle does not speak English.
    """
    count, left = handed_in.fill_in(worksheet, filled, course, assignment, column)
    for student in left:
        print(f"- {one_line(student)} is not in {worksheet}")
    print(f"{filled}: {count} grades")


@classroom.command
def exam(folder: Path = Path("."), /, *, seed: int, questions: int = 12) -> None:
    """Write an exam's sheet and its key as pages to print.

    The numbers vary by the seed, and the library computes the answers, so its questions are public.

    Arguments:
        folder: where the two pages go.
        seed: of the numbers and of the choice of questions.
        questions: how many of the forty; 40 has them all, to practise.
    """
    for path in exams.write_exam(folder, seed, questions):
        print(path)
