"""What a class hands in: collected, looked through before nbgrader grades it, given back.

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
import warnings
import zipfile
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from hashlib import sha256
from pathlib import Path

from uavdh_lite.errors import InputError, extra, one_line
from uavdh_lite.storage import write_atomically

with extra("classroom"):
    import nbformat
    from IPython.core.inputtransformer2 import TransformerManager

LARGEST = 200_000_000  # bytes of a notebook: its outputs are dropped, but somebody has to read them
MOST, LONGEST = 1000, 100_000  # cells that are read, characters of one
MOODLE = re.compile(r"(?P<who>[^/]+_\d+)_assignsubmission_file_/?(?P<file>.+)")
SOLUTION = re.compile(r"checks\b.*\.solution|course\.checks\.|course/checks")
SHADOWED = re.compile(
    r"(?m)^(checks|checks\.\w+) *=[^=]|^(class|def) checks\b|^import.* as checks$"
)
UNREADABLE = (SyntaxError, ValueError, RecursionError, MemoryError)


@dataclass
class Sheet:
    """What one student handed in for an assignment: what was odd, and the notebook to grade."""

    student: str
    notes: list[str] = field(default_factory=list)  # they stand in the feedback, too
    private: list[str] = field(default_factory=list)  # for the teacher, who judges them
    answered: int = 0
    of: int = 0
    notebook: nbformat.NotebookNode | None = None  # None: nothing in it can be graded
    fingerprint: str = ""
    when: float = 0.0
    missing: bool = False  # not handed in: there is nothing to give feedback on


def look_through(course: Path, assignment: str) -> list[Sheet]:
    """Look through an assignment of all students, and write what nbgrader is to grade.

    A student whose file cannot be used gets an empty sheet, so that the feedback says why; one who
    has handed in nothing for this assignment gets none. Moodle gives a student another number, and
    so another folder, in each assignment: these folders count as one student.

    Raises `InputError` if the course has no such assignment, if what students got is damaged, or if
    nobody has handed in anything.
    """
    release = course / "exercises" / assignment / f"{assignment}.ipynb"
    students = sorted(p for p in (course / "submitted").glob("*") if p.is_dir())
    if not release.is_file() or not students:
        missing = course / "submitted" if release.is_file() else release
        raise InputError(f"{missing} is not there: run this in the folder of the course")
    try:
        empty = _notebook(release)
        whole = _mended(empty.cells, empty, Sheet(""))
    except Exception:  # whatever a damaged file makes a parser say
        whole = None
    if not whole:
        raise InputError(f"{release}: no notebook with exercises: get it anew")
    sheets = _one_for_each([_sheet(student, assignment, empty) for student in students], students)
    for sheet in sheets:
        same = [o.student for o in sheets if o is not sheet and o.fingerprint == sheet.fingerprint]
        if sheet.fingerprint and same:
            sheet.private.append(f"the same file as {', '.join(same)}")
        if sheet.missing:
            continue
        graded = sheet.notebook or copy.deepcopy(empty)
        if sheet.notes:
            said = html.escape("\n".join(map(one_line, sheet.notes)))
            text = f"**Before this was graded, it was looked through:**\n\n<pre>{said}</pre>"
            graded.cells.insert(0, nbformat.v4.new_markdown_cell(text))
        path = course / "checked" / sheet.student / assignment / release.name
        write_atomically(path, lambda temporary, graded=graded: nbformat.write(graded, temporary))  # type: ignore[misc]
        stamp = f"{datetime.fromtimestamp(sheet.when, UTC):%Y-%m-%d %H:%M:%S} UTC"
        path.with_name("timestamp.txt").write_text(stamp)  # nbgrader grades anew what is newer
    return sheets


def _one_for_each(sheets: list[Sheet], folders: list[Path]) -> list[Sheet]:
    """Without those missing here who have handed in under another number.

    As many people have a name as folders of this name have ever handed in one assignment.
    """
    given = {path.name: [p.name for p in path.glob("[!.]*")] or [""] for path in folders}
    named: dict[str, list[Sheet]] = {}
    for sheet in sorted(sheets, key=lambda one: one.missing):
        named.setdefault(re.sub(r"_\d+$", "", sheet.student), []).append(sheet)
    kept: list[Sheet] = []
    for own in named.values():
        times = Counter(name for sheet in own for name in given[sheet.student])
        handed = sum(not sheet.missing for sheet in own)
        kept += own[: max(handed, *times.values())]
    return sorted(kept, key=lambda one: one.student)


def _sheet(student: Path, assignment: str, empty: nbformat.NotebookNode) -> Sheet:
    sheet = Sheet(student.name)
    notebooks = (p for p in student.rglob("*") if p.suffix.lower() == ".ipynb")
    every = [p for p in notebooks if not any(x[0] == "." for x in p.parts[-3:])]
    named = [p for p in every if p.parent.name == assignment or assignment in p.name]
    whole = student.resolve()  # a link may lead to another student's work
    own = [p for p in named if p.is_file() and p.resolve() == whole / p.relative_to(student)]
    aside = [p.relative_to(student).as_posix() for p in named if p not in own]
    sheet.notes += [f"set aside: {path} is not a file" for path in aside]
    if not own:
        others = sorted(p.name for p in (student / assignment).glob("*") if p.suffix != ".ipynb")
        sheet.missing = not named and not others
        instead = f"hand in the .ipynb itself, not {', '.join(others)}"
        sheet.notes.append(instead if others else "nothing handed in")
        return sheet
    read = {path: _read(path, student.name, empty) for path in own}
    proper = student / assignment / f"{assignment}.ipynb"
    path = max(own, key=lambda p: (read[p].answered, p == proper, read[p].when))
    if len(own) > 1:
        sheet.notes.append(f"there are {len(own)} notebooks; this is {path.name}, answered most")
    elif path != proper:
        sheet.notes.append(f"was named {path.relative_to(student).as_posix()}")
    read[path].notes[:0] = sheet.notes
    return read[path]


def _read(path: Path, student: str, empty: nbformat.NotebookNode) -> Sheet:
    """What is in one notebook."""
    sheet = Sheet(student, when=path.stat().st_mtime)
    if path.stat().st_size > LARGEST:
        sheet.notes.append(f"set aside: {path.stat().st_size / 1e6:.0f} MB, too large to read")
        return sheet
    try:
        sheet.fingerprint = sha256(path.read_bytes()).hexdigest()
        mended = _mended(_notebook(path).cells, empty, sheet)
        nbformat.writes(mended or empty).encode()  # JSON can say what is no character
        sheet.notebook = mended
    except Exception as error:  # whatever a student's file makes a parser say
        sheet.answered = 0
        said = f"set aside: the file cannot be opened as a notebook ({type(error).__name__})"
        sheet.notes.append(f"{said}: save it in Jupyter and hand it in again")
    return sheet


def _notebook(path: Path) -> nbformat.NotebookNode:
    """A notebook without its outputs."""
    content = json.loads(path.read_bytes().decode("utf-8-sig"))
    for cell in content.get("cells", ()):
        if "outputs" in cell:
            cell["outputs"] = []
        cell["source"] = "".join(cell["source"])  # a list of lines, or a text
    if content.get("nbformat") == 4:
        return nbformat.from_dict(content)
    with warnings.catch_warnings(action="ignore"):
        return nbformat.reads(json.dumps(content), as_version=4)


def _mended(
    cells: list, empty: nbformat.NotebookNode, sheet: Sheet
) -> nbformat.NotebookNode | None:
    """The release with a student's answers and other code in it; None if it is another notebook.

    Cells that were given run as they were given; what a student has put into one follows after it,
    each statement in a cell of its own, so that one which fails costs nothing else.
    """
    release = copy.deepcopy(empty.cells)
    usual = {part for c in release if c.cell_type == "code" for part in _statements(c.source)}
    found: dict[int, list] = {}
    others: dict[int, list] = {}
    last = next(k for k, cell in enumerate(release) if cell.cell_type == "code")
    read = [cell for cell in cells[:MOST] if len(cell.source) < LONGEST]
    if len(read) < len(cells):
        read_of = f"{len(read):,} of {len(cells):,} cells"
        sheet.notes.append(f"{read_of} are read: at most {MOST}, each below {LONGEST:,} characters")
    for cell in read:
        place = _place(cell, release)
        if place is not None:
            found.setdefault(place, []).append(cell)
            last = max(last, place)
        elif cell.cell_type == "code" and cell.source.strip():
            others.setdefault(last, []).append(cell)
    if not any(release[place].metadata.get("nbgrader") for place in found):
        sheet.notes.append("set aside: another notebook, with none of this one's exercises")
        return None
    mended = []
    for place, cell in enumerate(release):
        own, marks = found.get(place, []), cell.metadata.get("nbgrader", {})
        graded = bool(marks.get("grade"))
        name = marks.get("grade_id", "").removeprefix("check-").replace("-", ".")
        name = f"the {'check of' if graded else 'answer to'} {name}"
        answers = [c for c in own if c.source.strip() != cell.source.strip()]
        after = others.get(place, [])
        if marks and not own:
            sheet.notes.append(f"{name} was deleted: restored")
        elif marks and not any("nbgrader" in c.metadata for c in own):
            sheet.notes.append(f"{name} had lost its metadata: restored")
        if marks and not graded and len(own) > 1:
            sheet.notes.append(f"{name} is there {len(own)} times: the first answered one counts")
        if graded and answers:
            sheet.notes.append(f"{name} was edited: restored")
        elif answers and cell.cell_type == "code" and marks:
            cell.source = answers[0].source
            sheet.answered += 1
            _look_at(cell.source, name, sheet)
        elif answers and cell.cell_type == "code":
            parts = [part for c in answers for part in _parts(c.source) if part not in usual]
            after = [*map(nbformat.v4.new_code_cell, parts), *after]
        sheet.of += bool(marks.get("solution"))
        mended.append(cell)
        for other in after:
            _look_at(other.source, "a cell of the student's own", sheet)
            mended.append(nbformat.v4.new_code_cell(other.source))
    return nbformat.v4.new_notebook(cells=mended, metadata=copy.deepcopy(empty.metadata))


def _place(cell: nbformat.NotebookNode, release: list) -> int | None:
    """Which cell of the release this is: by its metadata, its text, its id, or what it defines."""
    grade_id = cell.metadata.get("nbgrader", {}).get("grade_id")
    called = re.match(r"checks\.\w+\(", cell.source)
    for k, one in enumerate(release):
        if grade_id and one.metadata.get("nbgrader", {}).get("grade_id") == grade_id:
            return k
    for k, one in enumerate(release):
        marked, answer = "nbgrader" in one.metadata, None
        if marked and one.metadata.nbgrader.solution and cell.cell_type == "code":
            check = next(c for c in release[k:] if c.metadata.get("nbgrader", {}).get("grade"))
            answer = re.search(r"\((\w+)\)", check.source)[1]  # type: ignore[index]
        if (
            one.source.strip() == cell.source.strip()
            or (called and one.source.startswith(called[0]))
            or (not marked and one.cell_type == cell.cell_type and one.id == cell.get("id"))
            or (answer and re.search(rf"(?m)^(def |class )?{answer}\b *[(:=]", cell.source))
        ):
            return k
    return None


def _statements(source: str) -> dict[str, ast.stmt]:
    """The statements of a cell by their text, in one form; a magic is a call."""
    with warnings.catch_warnings(action="ignore"):  # of a student's "\\d"
        parts = ast.parse(TransformerManager().transform_cell(source)).body
    return {ast.unparse(part): part for part in parts}


def _parts(source: str) -> list[str]:
    """The statements of a cell, or the cell if it cannot be read."""
    with suppress(*UNREADABLE):
        return [*_statements(source)]
    return [source]


def _look_at(source: str, name: str, sheet: Sheet) -> None:
    """Note if a cell cannot be read, takes a solution, or puts something in place of a check."""
    try:
        _statements(source)
    except UNREADABLE as error:
        sheet.notes.append(f"{name} cannot be read: {str(error).replace('<unknown>, ', '')[:80]}")
    if SOLUTION.search(source):
        sheet.private.append(f"{name} reads a solution or a check: look at it")
    elif SHADOWED.search(source):
        sheet.private.append(f"{name} puts something in place of a check, which has no effect")


def collect(archive: Path, course: Path, assignment: str) -> tuple[dict[str, str], list[str]]:
    """Unpack Moodle's zip of all submissions into `submitted/`.

    A file in a subfolder counts as one beside it. Where an earlier zip was collected, files that
    are the same stay as they are, so that they are not graded again; others take their place.

    Returns each student's state, "new", "handed in again" or "as before", and what is odd: files
    that are set aside, and two of one name. Raises `InputError` if it is no such zip, or damaged,
    or encrypted.
    """
    states: dict[str, str] = {}
    odd: list[str] = []
    found: list[Path] = []
    try:
        with zipfile.ZipFile(archive) as packed:
            entries = [one for one in packed.infolist() if not one.is_dir()]
            for entry in entries:
                match = MOODLE.fullmatch(entry.filename)
                wrong = "" if match else "no file of a submission"
                if match and any(part[0] == "." for part in Path(match["file"]).parts):
                    wrong = "hidden"
                elif match and entry.file_size > 2 * LARGEST:
                    wrong = f"{entry.file_size / 1e6:.0f} MB"
                if wrong or not match:
                    odd.append(f"{entry.filename} is set aside: {wrong}")
                    continue
                content, who = packed.read(entry), match["who"]
                folder = course / "submitted" / who / assignment
                state = states.get(who, "as before" if folder.exists() else "new")
                path = folder / Path(match["file"]).name[-100:]  # folders have limits
                if not path.is_file() or path.read_bytes() != content:
                    write_atomically(path, partial(Path.write_bytes, data=content))
                    state = "new" if state == "new" else "handed in again"
                if path in found:
                    odd.append(f"{entry.filename} is there twice: the later one counts")
                states[who] = state
                found.append(path)
    except OSError:
        raise
    except Exception as error:  # whatever a damaged or encrypted zip makes its reader say
        raise InputError(f"{archive}: {error}") from None
    if not found and all(note.endswith("no file of a submission") for note in odd):
        raise InputError(
            f"{archive}: no NAME_NUMBER_assignsubmission_file_/FILE in it, as Moodle has"
        )
    for folder in {path.parent for path in found}:
        for left in {*folder.glob("[!.]*")} - {*found}:  # under a name that it no longer has
            if left.is_file():
                left.unlink()
                states[folder.parent.name] = "handed in again"
    return dict(sorted(states.items())), odd


def is_in_grade_book(course: Path, assignment: str) -> bool:
    """Whether nbgrader can grade the assignment in this folder: `generate_assignment` enters it."""
    with extra("classroom"):
        from nbgrader.api import Gradebook

    if not (course / "gradebook.db").is_file():
        return False
    with Gradebook(f"sqlite:///{course / 'gradebook.db'}", "uavdh_lite") as book:
        return assignment in [one.name for one in book.assignments]


def fill_in(
    worksheet: Path, filled: Path, course: Path, assignment: str, column: str = "Grade"
) -> tuple[int, list[str]]:
    """Write the points that nbgrader has given into Moodle's grading worksheet.

    A row belongs to the student whose name ends with the number of its first column. Points are
    scaled to the maximum, which stands in the column after the grade's.

    Returns the number of rows that are filled, and the students who have none. Raises `InputError`
    if nothing has been graded, if grading was stopped at a student, if two students have one
    number, if somebody has more points than there are, or if the worksheet is none.
    """
    with extra("classroom"):
        from nbgrader.api import Gradebook

    grades, shares = course / "gradebook.db", {}
    if grades.is_file():
        with Gradebook(f"sqlite:///{grades}", "uavdh_lite") as book:
            for one in book.assignment_submissions(assignment):
                points, most = max(0.0, one.score - one.late_submission_penalty), one.max_score
                said = f'nbgrader autograde --force --student="{one.student.id}" {assignment}'
                if None in [grade.auto_score for part in one.notebooks for grade in part.grades]:
                    stopped = f"grading was stopped at {one.student.id}"
                    raise InputError(f"{grades}: {stopped}: run {said}")
                if not 0 <= points <= most or most == 0:
                    found = f"{one.student.id} has {points:g} of {most:g} points in {assignment}"
                    raise InputError(f"{grades}: {found}: look at the sheet, and run {said}")
                shares[one.student.id] = points / most
    if not shares:
        raise InputError(f"{grades}: nothing graded for {assignment}: run nbgrader autograde first")
    students: dict[str, str] = {}
    for student in shares:
        number = student.rpartition("_")[2]
        if number in students:
            both = f"submitted/{students[number]} and submitted/{student}"
            raise InputError(f"{both} have one number, {number}: keep the one that is right")
        students[number] = student
    content = worksheet.read_bytes()
    try:
        text, code = _decoded(content)
        mark = max(",;\t", key=text.partition("\n")[0].count)
        header, *rows = csv.reader(io.StringIO(text), delimiter=mark)
        place = header.index(column, 1)
        for row in (rows := [row for row in rows if row]):
            student = students.pop(re.search(r"\d*$", row[0])[0], None)  # type: ignore[index]
            if student is not None:
                most = row[place + 1]
                if not 0 < float(most.replace(",", ".")) < 1e6:
                    raise ValueError(f"the maximum of {row[0]} is {most}")
                grade = f"{shares[student] * float(most.replace(',', '.')):.2f}"
                row[place] = grade.replace(".", ",") if "," in most else grade
    except (ValueError, IndexError, csv.Error) as error:
        said = f"no grading worksheet with {column} and its maximum ({error})"
        raise InputError(f"{worksheet}: {said}: see --column") from None
    out = io.StringIO()
    csv.writer(out, delimiter=mark).writerows([header, *rows])
    write_atomically(filled, lambda to: to.write_bytes(out.getvalue().encode(code)))
    return len(shares) - len(students), sorted(students.values())


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
        raise InputError(
            f"{course / 'feedback'}: none for {assignment}: run generate_feedback first"
        )
    if archive.exists():
        raise InputError(f"{archive} exists: name another file, or delete it")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for page in pages:
            who = page.parts[-3]
            packed.write(page, f"{who}_assignsubmission_file_/{page.name}")
    return [page.parts[-3] for page in pages]
