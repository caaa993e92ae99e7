"""What a class hands in: collected, looked through before nbgrader grades it, given back.

A course is a folder as nbgrader has it: `exercises/` holds what students got, `submitted/` what
they handed in, a folder for each student. `look_through` never changes `submitted/`: it writes a
mended copy to `checked/`, which the course's `nbgrader_config.py` has nbgrader grade.
"""

import ast
import copy
import csv
import errno
import io
import re
import warnings
import zipfile
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

from uavdh_lite.errors import InputError, extra
from uavdh_lite.storage import write_atomically

with extra("classroom"):
    import nbformat
    from IPython.core.inputtransformer2 import TransformerManager

LARGEST = 50_000_000  # bytes of a notebook: outputs can be dropped, but somebody has to read them
MOODLE = re.compile(r"(?P<who>[^/]+_\d+)_assignsubmission_file_/?(?P<file>.+)")
USUAL = re.compile(
    r"checks\.\w+\(\w+\)|from uavdh_lite\.course import checks|get_ipython\(\)\.\w+\('matplotlib'.*"
)
DYNAMIC = {"eval", "exec", "globals", "__import__", "import_module", "modules", "get_ipython"}


@dataclass
class Sheet:
    """What one student handed in for an assignment: what was odd, and the notebook to grade."""

    student: str
    notes: list[str] = field(default_factory=list)
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
        whole = _mended(empty.cells, empty, Sheet("")) is not None
    except Exception as error:  # whatever a damaged file makes a parser say
        said = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(f"{release}: not a notebook ({said}): get it anew") from None
    if not whole:
        raise InputError(f"{release}: has no exercises: get it anew")
    sheets = _one_for_each([_sheet(student, assignment, empty) for student in students], students)
    for sheet in sheets:
        same = [o.student for o in sheets if o is not sheet and o.fingerprint == sheet.fingerprint]
        told = [*sheet.notes]
        if sheet.fingerprint and same:
            sheet.notes.append(f"the same file as {', '.join(same)}")
            told.append("the same file as another student's")  # whose is not for them to read
        if sheet.missing:
            continue
        graded = copy.deepcopy(empty) if sheet.notebook is None else sheet.notebook
        if told:
            said = "".join(f"\n- {note}" for note in told)
            text = f"**Before this was graded, it was looked through.** What was found:\n{said}"
            text = text.encode("utf-8", "backslashreplace").decode()  # a file's name may be odd
            graded.cells.insert(0, nbformat.v4.new_markdown_cell(text))
        path = course / "checked" / sheet.student / assignment / release.name
        write_atomically(path, lambda temporary, graded=graded: nbformat.write(graded, temporary))  # type: ignore[misc]
        stamp = f"{datetime.fromtimestamp(sheet.when, UTC):%Y-%m-%d %H:%M:%S} UTC"
        path.with_name("timestamp.txt").write_text(stamp)  # nbgrader grades anew what is newer
    return sheets


def _one_for_each(sheets: list[Sheet], folders: list[Path]) -> list[Sheet]:
    """Without those that are missing here because the student has another folder, or is listed."""
    given = {path.name: {p.name for p in path.glob("[!.]*")} for path in folders}
    names = {folder: re.sub(r"_\d+$", "", folder) for folder in given}
    kept: list[Sheet] = []
    for sheet in sorted(sheets, key=lambda one: one.missing):
        own = given[sheet.student]
        others = [o.student for o in kept if names[o.student] == names[sheet.student]]
        if not (sheet.missing and own and any(own.isdisjoint(given[one]) for one in others)):
            kept.append(sheet)
    return sorted(kept, key=lambda one: one.student)


def _sheet(student: Path, assignment: str, empty: nbformat.NotebookNode) -> Sheet:
    sheet = Sheet(student.name)
    notebooks = (p for p in student.rglob("*") if p.suffix.lower() == ".ipynb")
    every = [p for p in notebooks if not any(x[0] == "." for x in p.parts[-3:])]
    named = [p for p in every if p.parent.name == assignment or assignment in p.name]
    own = [p for p in named if p.is_file()]
    for path in (p for p in named if p not in own):
        sheet.notes.append(f"set aside: {path.relative_to(student).as_posix()} is not a file")
    if not own:
        others = sorted(p.name for p in (student / assignment).glob("*") if p.suffix != ".ipynb")
        sheet.missing = not named and not others
        sheet.notes.append(
            f"hand in the .ipynb itself, not {', '.join(others)}" if others else "nothing handed in"
        )
        return sheet
    path = max(own, key=lambda p: (p.name == f"{assignment}.ipynb", p.stat().st_mtime))
    if path.relative_to(student) != Path(assignment, f"{assignment}.ipynb"):
        sheet.notes.append(f"was named {path.relative_to(student).as_posix()}")
    if len(own) > 1:
        sheet.notes.append(f"there are {len(own)} notebooks; this is {path.name}")
    sheet.when = path.stat().st_mtime
    if path.stat().st_size > LARGEST:
        sheet.notes.append(f"set aside: {path.stat().st_size / 1e6:.0f} MB, too large to read")
        return sheet
    try:
        sheet.fingerprint = sha256(path.read_bytes()).hexdigest()
        mended = _mended(_notebook(path).cells, empty, sheet)
        if mended is not None:
            nbformat.writes(mended).encode()  # JSON can say what is no character
        sheet.notebook = mended
    except Exception as error:  # whatever a student's file makes a parser say
        sheet.answered = 0
        damaged = "set aside: the file cannot be opened as a notebook"
        sheet.notes.append(
            f"{damaged} ({type(error).__name__}): save it in Jupyter and hand it in again"
        )
    return sheet


def _notebook(path: Path) -> nbformat.NotebookNode:
    with warnings.catch_warnings(action="ignore"):  # of ids that are missing, or there twice
        return nbformat.reads(path.read_bytes().decode("utf-8-sig"), as_version=4)


def _mended(
    cells: list, empty: nbformat.NotebookNode, sheet: Sheet
) -> nbformat.NotebookNode | None:
    """The release with a student's answers and other code in it; None if it is another notebook."""
    release = [copy.deepcopy(cell) for cell in empty.cells]
    usual = {part for c in release if c.cell_type == "code" for part in _statements(c.source)}
    found: dict[int, list] = {}
    others: dict[int, list] = {}
    last = next(k for k, cell in enumerate(release) if cell.cell_type == "code")
    for cell in cells:
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
        kind = "the check of " if marks.get("grade") else "the answer to "
        name = kind + marks.get("grade_id", "").removeprefix("check-").replace("-", ".")
        answers = [c for c in own if c.source.strip() != cell.source.strip()]
        if marks and not own:
            sheet.notes.append(f"{name} was deleted: restored")
        elif marks and not any("nbgrader" in c.metadata for c in own):
            sheet.notes.append(f"{name} had lost its metadata: restored")
        if marks and len(own) > 1:
            sheet.notes.append(f"{name} is there {len(own)} times: the first answered one counts")
        if marks.get("grade") and answers:
            sheet.notes.append(f"{name} was edited: restored")
        elif answers and cell.cell_type == "code" and _is_honest(answers[0], sheet, name, usual):
            cell.source = answers[0].source
            sheet.answered += bool(marks)
        sheet.of += bool(marks.get("solution"))
        mended.append(cell)
        for other in others.get(place, []):
            if _is_honest(other, sheet, "a cell of the student's own", usual):
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
    parts = ast.parse(TransformerManager().transform_cell(source)).body
    return {ast.unparse(part): part for part in parts}


def _is_honest(
    cell: nbformat.NotebookNode, sheet: Sheet, name: str, usual: Collection[str]
) -> bool:
    """Whether a cell uses `checks` in no other way than the course does; notes what is odd.

    Arguments:
        usual: statements that stand in what students got.
    """
    try:
        parts = _statements(cell.source).items()
    except (SyntaxError, ValueError, RecursionError) as error:
        sheet.notes.append(f"{name} cannot be read: {str(error).replace('<unknown>, ', '')[:80]}")
        return "checks" not in cell.source
    own = [part for text, part in parts if text not in usual and not USUAL.fullmatch(text)]
    words: set[str] = set()
    for node in (node for part in own for node in ast.walk(part)):
        named = [
            getattr(node, key, None) for key in ("id", "name", "asname", "arg", "attr", "module")
        ]
        if isinstance(node, ast.Constant) and "uavdh_lite.course" in str(node.value):
            named.append(node.value)
        words.update(part for text in named if text for part in str(text).split("."))
    if taken := words & {"checks", "course"}:
        sheet.notes.append(f"{name} uses `{min(taken)}` for more than checking: it does not count")
    elif looked := words & DYNAMIC:
        sheet.notes.append(f"{name} uses `{min(looked)}`: look at it")
    return not taken


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
        packed = zipfile.ZipFile(archive)
    except OSError:
        raise
    except Exception as error:  # whatever a damaged zip makes its reader say
        raise InputError(f"{archive}: {error}") from None
    with packed:
        for entry in packed.infolist():
            if entry.is_dir():
                continue
            match = MOODLE.fullmatch(entry.filename)
            if not match or any(part[0] == "." for part in Path(match["file"]).parts):
                kind = "hidden" if match else "no file of a submission"
                odd.append(f"{entry.filename} is set aside: {kind}")
                continue
            if entry.file_size > 2 * LARGEST:
                odd.append(f"{entry.filename} is set aside: {entry.file_size / 1e6:.0f} MB")
                continue
            try:
                content = packed.read(entry)
            except Exception as error:  # damaged, encrypted, or compressed in an unknown way
                raise InputError(f"{archive}: {entry.filename}: {error}") from None
            who, folder = match["who"], course / "submitted" / match["who"] / assignment
            state = states.get(who, "as before" if folder.exists() else "new")
            path = folder / Path(match["file"]).name
            try:
                if not path.is_file() or path.read_bytes() != content:
                    write_atomically(path, lambda to, content=content: to.write_bytes(content))  # type: ignore[misc]
                    state = "new" if state == "new" else "handed in again"
            except OSError as error:
                if error.errno not in (errno.ENAMETOOLONG, errno.EISDIR, errno.EBUSY):
                    raise
                odd.append(f"{entry.filename} is set aside: {error.strerror}")
                continue
            if path in found:
                odd.append(f"{entry.filename} is there twice: the later one counts")
            states[who] = state
            found.append(path)
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
    if nothing has been graded, if grading was stopped at a student, or if the worksheet is none.
    """
    with extra("classroom"):
        from nbgrader.api import Gradebook

    grades, shares, stopped = course / "gradebook.db", {}, ""
    if grades.is_file():
        with Gradebook(f"sqlite:///{grades}", "uavdh_lite") as book:
            for one in book.assignment_submissions(assignment):
                points = max(0.0, one.score - one.late_submission_penalty)
                shares[one.student.id] = points / one.max_score
                if None in [grade.auto_score for part in one.notebooks for grade in part.grades]:
                    stopped = one.student.id
    if stopped:
        again = f'nbgrader autograde --force --student="{stopped}" {assignment}'
        raise InputError(f"{grades}: grading was stopped at {stopped}: run {again}")
    if not shares:
        raise InputError(f"{grades}: nothing graded for {assignment}: run nbgrader autograde first")
    students = {student.rpartition("_")[2]: student for student in shares}
    try:
        with worksheet.open(encoding="utf-8-sig", newline="") as file:
            header, *rows = csv.reader(file)
        place = header.index(column, 1)
        for row in (rows := [row for row in rows if row]):
            student = students.pop(re.search(r"\d*$", row[0])[0], None)  # type: ignore[index]
            if student is not None:
                most = row[place + 1]
                grade = f"{shares[student] * float(most.replace(',', '.')):.2f}"
                row[place] = grade.replace(".", ",") if "," in most else grade
    except (ValueError, IndexError, csv.Error) as error:
        said = f"no grading worksheet with {column} and its maximum ({error})"
        raise InputError(f"{worksheet}: {said}: see --column") from None
    text = io.StringIO()
    csv.writer(text).writerows([header, *rows])
    write_atomically(filled, lambda to: to.write_bytes(text.getvalue().encode()))
    return len(shares) - len(students), sorted(students.values())


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
