"""What a class hands in: collected, mended before nbgrader grades it, given back.

A course is a folder as nbgrader has it: `exercises/` holds what students got, `submitted/` what
they handed in, a folder for each student. `look_through` never changes `submitted/`: it writes a
mended copy to `checked/`, which the course's `nbgrader_config.py` has nbgrader grade.
"""

import ast
import copy
import csv
import html
import io
import json
import re
import shutil
import warnings
import zipfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from uavdh_lite.errors import InputError, extra, one_line
from uavdh_lite.storage import write_atomically

with extra("classroom"):
    import nbformat
    from IPython.core.inputtransformer2 import TransformerManager

LARGEST = 200_000_000  # bytes of a file: a notebook's outputs are dropped, but have to be read
MOODLE = re.compile(r"(?P<who>[^/]+?_\d+)_assignsubmission_file_/?(?P<file>.+)")
UNFIT = re.compile(r"^\.|[][*?]")  # what nbgrader would not find
CALL = re.compile(r"checks\.(?P<name>\w+)\((?P<answer>\w*)")
SOLUTION = re.compile(r"checks\b.*\.solution|course\.checks\.|course/checks")
SHADOWED = re.compile(
    r"(?m)^(checks|checks\.\w+) *=[^=]|^(class|def) checks\b|^import.* as checks$"
)


@dataclass
class Sheet:
    """What one student handed in for an assignment: what was odd, and the notebook to grade."""

    student: str
    notes: list[str] = field(default_factory=list)  # they stand in the feedback, too
    private: list[str] = field(default_factory=list)  # for the teacher, who judges them
    answered: int = 0
    notebook: nbformat.NotebookNode | None = None  # None: nothing in it can be graded


def collect(archive: Path, course: Path, assignment: str) -> tuple[list[str], list[str]]:
    """Unpack Moodle's zip of all submissions into `submitted/`, in place of what was there.

    Returns the students, and the files that are set aside. Raises `InputError` if it is no such
    zip, or damaged, or encrypted.
    """
    students: list[str] = []
    odd: list[str] = []
    try:
        with zipfile.ZipFile(archive) as packed:
            for entry in packed.infolist():
                match = MOODLE.fullmatch(entry.filename)
                if not match or "/." in f"/{match['file']}" or entry.file_size > LARGEST:
                    odd += [entry.filename] * (not entry.is_dir())
                    continue
                content = packed.read(entry)  # before an earlier one is deleted: it may be damaged
                folder = course / "submitted" / match["who"] / assignment
                if match["who"] not in students:
                    students.append(match["who"])
                    shutil.rmtree(folder, ignore_errors=True)
                    folder.mkdir(parents=True)
                path = folder / Path(match["file"]).name[-50:]  # file systems have limits
                while path.exists():  # one from another folder
                    path = path.with_name(f"_{path.name}")
                path.write_bytes(content)
    except OSError:
        raise
    except Exception as error:  # whatever a damaged or encrypted zip makes its reader say
        raise InputError(f"{archive}: {error}") from None
    if not students:
        said = "no NAME_NUMBER_assignsubmission_file_/FILE in it, as Moodle has"
        raise InputError(f"{archive}: {said}")
    return students, odd


def look_through(course: Path, assignment: str) -> list[Sheet]:
    """Look through an assignment of all students, and write what nbgrader is to grade.

    A student whose file cannot be used gets an empty sheet, so that the feedback says why; one who
    has handed in nothing for this assignment gets none.

    Raises `InputError` if what students got is not there or damaged, or if nobody has handed in
    anything.
    """
    release = course / "exercises" / assignment / f"{assignment}.ipynb"
    try:
        empty = nbformat.read(release, as_version=4)
        if not any("nbgrader" in cell.metadata for cell in empty.cells):
            raise ValueError("no exercises")
    except Exception as error:  # whatever a damaged file makes a parser say
        said = f"this is no folder of the course, or that is damaged ({one_line(error)[:80]})"
        raise InputError(f"{release}: {said}") from None
    students = sorted(path for path in (course / "submitted").glob("*") if path.is_dir())
    sheets = [sheet for one in students if (sheet := _sheet(one, assignment, empty))]
    if not sheets:
        raise InputError(f"{course / 'submitted'}: nobody has handed in {assignment}")
    for sheet in sheets:
        if (known := UNFIT.sub("-", sheet.student)) != sheet.student:
            sheet.private.append(f"the folder {sheet.student}: nbgrader would not find that name")
            sheet.student = known
        graded = sheet.notebook or copy.deepcopy(empty)
        if sheet.notes:
            said = html.escape("\n".join(map(one_line, sheet.notes)))
            text = f"**Before this was graded, it was looked through:**\n\n<pre>{said}</pre>"
            first = nbformat.v4.new_markdown_cell(text, id="looked-through")
            graded.cells.insert(0, first)
        path = course / "checked" / sheet.student / assignment / release.name
        content = nbformat.writes(graded).encode()
        if not path.is_file() or path.read_bytes() != content:
            write_atomically(path, partial(Path.write_bytes, data=content))
            stamp = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"
            path.with_name("timestamp.txt").write_text(stamp)  # nbgrader grades what is newer
    for folder in (course / "checked").glob(f"*/{assignment}"):
        if folder.parts[-2] not in [sheet.student for sheet in sheets]:  # it was taken back
            shutil.rmtree(folder)
    return sheets


def _sheet(student: Path, assignment: str, release: nbformat.NotebookNode) -> Sheet | None:
    """What a student handed in for an assignment; of several notebooks the one answered most."""
    inside = (path.relative_to(student) for path in sorted(student.rglob("*")))
    files = [path for path in inside if assignment in path.parts[0] and path.name != assignment]
    files = [path for path in files if "/." not in f"/{path.as_posix()}"]
    if not files:
        return None
    whole = student.resolve()  # a link may lead to another student's work
    own = [p for p in files if (whole / p).is_file() and (whole / p).resolve() == whole / p]
    own = [path for path in own if path.suffix.lower() == ".ipynb"]
    if not own:
        said = f"there is no notebook, but {', '.join(path.name for path in files)}"
        return Sheet(student.name, [f"{said}: hand in the .ipynb itself"])
    read = [_read(student.name, whole / path, release) for path in own]
    best = max(read, key=lambda sheet: sheet.answered)
    if len(own) > 1:
        name = own[read.index(best)].name
        best.notes.insert(0, f"there are {len(own)} notebooks; this is {name}, answered most")
    return best


def _read(student: str, path: Path, release: nbformat.NotebookNode) -> Sheet:
    """What is in one notebook."""
    sheet = Sheet(student)
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError("it is too large")
        cells = json.loads(path.read_bytes().decode("utf-8-sig"))["cells"]
        sheet.notebook = _mended(cells, release, sheet)
        nbformat.writes(sheet.notebook).encode()  # JSON can say what is no character
    except Exception as error:  # whatever a student's file makes a parser say
        said = f"set aside: {path.name} cannot be used ({type(error).__name__}: {str(error)[:80]})"
        sheet.notes = [f"{said}: save it in Jupyter and hand it in again"]
        sheet.notebook, sheet.answered = None, 0
    return sheet


def _mended(cells: list[dict], release: nbformat.NotebookNode, sheet: Sheet):
    """The release with a student's answers and other code in it; `ValueError` without any of it.

    Everything runs in the order of the student's notebook, and a check judges what has its answer's
    name by then. What stands in a cell that was given, or in an answer's second one, follows as a
    cell of its own: nbgrader wants each cell once. Statements that were added to one that was given
    follow one by one, so that one which fails costs nothing else.
    """
    mended = copy.deepcopy(release)
    given = {cell.source.strip() for cell in release.cells}
    code = [(cell, "".join(cell["source"])) for cell in cells if cell["cell_type"] == "code"]
    written = [(cell, re.sub("\r\n?", "\n", text)) for cell, text in code if text.strip()]
    marked = {_mark(cell) for cell, source in written if source.strip() not in given}
    places, known = _places(mended.cells, marked), False
    others: dict[int, list[str]] = defaultdict(list)
    last = next(k for k, cell in enumerate(mended.cells) if cell.cell_type == "code")
    for cell, source in written:
        place = next((places[key] for key in _keys(cell, source) if key in places), None)
        if place is None:
            others[last].append(source)
            continue
        there, last = mended.cells[place], max(last, place)
        marks = there.metadata.get("nbgrader", {})
        known = known or bool(marks)
        name = f"exercise {marks.get('grade_id', '').removeprefix('check-').replace('-', '.')}"
        if not marks.get("solution"):
            parts = _parts(there.source)
            added = [part for part in _parts(source) if part not in parts]
            others[last] += added
            if marks and added:
                sheet.notes.append(f"the check of {name} was edited: restored")
        elif there.source.strip() not in given:
            others[last].append(source)
        elif source.strip() not in given:
            there.source = source
            sheet.answered += 1
            _look_at(source, f"the answer to {name}", sheet)
    if not known:
        raise ValueError("none of this notebook's exercises are in it")
    every, mended.cells = mended.cells, []
    for place, cell in enumerate(every):
        mended.cells.append(cell)
        for k, source in enumerate(others[place]):
            _look_at(source, "a cell of the student's own", sheet)
            mended.cells.append(nbformat.v4.new_code_cell(source, id=f"own-{place}-{k}"))
    return mended


def _places(release: list, marked: set) -> dict[tuple, int]:
    """By what each cell may be known, as `_keys` has it; an answer by its name if unmarked."""
    places: dict[tuple, int] = {}
    solved = 0
    for place, cell in enumerate(release):
        places["text", cell.source.strip()] = place
        if "nbgrader" not in cell.metadata:
            places["id", cell.id] = place
            continue
        places["number", _mark(cell)] = place
        if call := CALL.match(cell.source):
            places["calls", call["name"]] = place
            if _mark(release[solved]) not in marked:
                places["defines", call["answer"]] = solved
        else:
            solved = place
    return places


def _keys(cell: dict, source: str) -> Iterator[tuple]:
    """By what a student's cell may be known, the surest first: it may have lost its metadata."""
    yield "number", _mark(cell)
    yield "text", source.strip()
    if call := CALL.match(source):
        yield "calls", call["name"]
    yield "id", cell.get("id")
    for name in re.findall(r"(?m)^(?:def |class |(?=\w+ *[:=]))(\w+)", source):
        yield "defines", name


def _mark(cell: dict) -> str | None:
    """The name that nbgrader knows a cell by."""
    return cell["metadata"].get("nbgrader", {}).get("grade_id")


def _parts(source: str) -> list[str]:
    """The statements of a cell in one form, a magic as a call; or the cell if it cannot be read."""
    with suppress(SyntaxError, ValueError, RecursionError, MemoryError):
        with warnings.catch_warnings(action="ignore"):  # of a student's "\\d"
            tree = ast.parse(TransformerManager().transform_cell(source))
        return [ast.unparse(part) for part in tree.body]
    return [source]


def _look_at(source: str, name: str, sheet: Sheet) -> None:
    """Note if a cell takes a solution, or puts something in place of a check."""
    if SOLUTION.search(source):
        sheet.private.append(f"{name} reads a solution or a check: look at it")
    if SHADOWED.search(source):
        sheet.private.append(f"{name} puts something in place of a check: look at it")


def fill_in(
    worksheet: Path, filled: Path, course: Path, assignment: str, column: str = "Grade"
) -> tuple[int, list[str]]:
    """Write the points that nbgrader has given into Moodle's grading worksheet.

    A row belongs to the student whose name ends with the number of its Identifier. Points are
    scaled to the Maximum Grade. In another language these are the first column and the one after
    the grade's, as Moodle has them.

    Returns the number of rows that are filled, and the students who have none. Raises `InputError`
    if the worksheet is none, and as `_shares` does.
    """
    shares = _shares(course, assignment)
    content, count = worksheet.read_bytes(), len(shares)
    try:
        text, code = _decoded(content)
        mark = max(",;\t", key=text.partition("\n")[0].count)
        header, *rows = csv.reader(io.StringIO(text), delimiter=mark)
        place, names = header.index(column), ("Identifier", "Maximum Grade")
        english = column == "Grade" or {*names} & {*header}
        who, scale = map(header.index, names) if english else (0, place + 1)
        for row in filter(None, rows):
            number = row[who][len(row[who].rstrip("0123456789")) :]
            if number in shares:
                most = row[scale]
                if not 0 < float(most.replace(",", ".")) < 1e6:
                    raise ValueError(f"the maximum of {row[who]} is {most}")
                grade = f"{shares.pop(number)[1] * float(most.replace(',', '.')):.2f}"
                row[place] = grade.replace(".", ",") if "," in most else grade
    except (ValueError, IndexError, csv.Error) as error:
        said = f"no grading worksheet with {column} and its maximum ({error})"
        raise InputError(f"{worksheet}: {said}: see --column") from None
    out = io.StringIO()
    csv.writer(out, delimiter=mark).writerows([header, *rows])
    write_atomically(filled, partial(Path.write_bytes, data=out.getvalue().encode(code)))
    return count - len(shares), sorted(student for student, _ in shares.values())


def _shares(course: Path, assignment: str) -> dict[str, tuple[str, float]]:
    """Each student and the share of all points, by the number at the end of the student's name.

    The grade book keeps a sheet that was taken back, `checked/` does not.

    Raises `InputError` if nothing has been graded, if grading was stopped at a student, if
    somebody has more points than there are, or if two students have one number.
    """
    with extra("classroom"):
        from nbgrader.api import Gradebook

    shares: dict[str, tuple[str, float]] = {}
    grades = course / "gradebook.db"
    if not grades.is_file():
        raise InputError(f"{grades}: not there: run nbgrader autograde first")
    with Gradebook(f"sqlite:///{grades}", "uavdh_lite") as book:
        for one in book.assignment_submissions(assignment):
            student, points, most = one.student.id, one.score, one.max_score
            if not (course / "checked" / student / assignment).is_dir():
                continue
            again = f'nbgrader autograde --force --student="{student}" {assignment}'
            if None in [grade.auto_score for part in one.notebooks for grade in part.grades]:
                raise InputError(f"{grades}: grading was stopped at {student}: run {again}")
            if not 0 <= points <= most or most == 0:
                found = f"{student} has {points:g} of {most:g} points in {assignment}"
                raise InputError(f"{grades}: {found}: look at the sheet, and run {again}")
            number = student.rpartition("_")[2]
            if number in shares:
                both = f"submitted/{shares[number][0]} and submitted/{student}"
                raise InputError(f"{both} have one number, {number}: keep the one that is right")
            points = max(0.0, points - one.late_submission_penalty)
            shares[number] = student, points / most
    if not shares:
        raise InputError(f"{grades}: nothing graded for {assignment}: run nbgrader autograde first")
    return shares


def _decoded(content: bytes) -> tuple[str, str]:
    """A text as Moodle or Excel writes it, and the code to write it in again."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16"), "utf-16"
    with suppress(UnicodeDecodeError):
        return content.decode("utf-8-sig"), "utf-8"
    return content.decode("cp1252"), "cp1252"


def give_back(archive: Path, course: Path, assignment: str) -> list[str]:
    """Pack nbgrader's feedback as Moodle takes it back, "feedback files in a zip".

    Returns the students; raises `InputError` if there is no feedback, or the archive exists.
    """
    pages = sorted((course / "feedback").glob(f"*/{assignment}/{assignment}.html"))
    if not pages:
        said = f"none for {assignment}: run nbgrader generate_feedback first"
        raise InputError(f"{course / 'feedback'}: {said}")
    if archive.exists():
        raise InputError(f"{archive} exists: name another file, or delete it")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for page in pages:
            packed.write(page, f"{page.parts[-3]}_assignsubmission_file_/{page.name}")
    return [page.parts[-3] for page in pages]
