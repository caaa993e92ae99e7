"""A class through our commands and nbgrader's: handed in, looked through, graded, given back."""

import copy
import csv
import html
import io
import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from collections import Counter
from pathlib import Path

import assignments
import matplotlib
import nbformat
import pytest
from traitlets.config import Config

from uavdh_lite.cli.main import main
from uavdh_lite.course import checks, handed_in

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
ASSIGNMENT = "01_city_and_channel"
FILE = f"{ASSIGNMENT}/{ASSIGNMENT}.ipynb"
STEMS = sorted(path.name for path in (NOTEBOOKS / "solutions").iterdir() if path.is_dir())
SOLVED = {
    "1.1": "return np.log2(1 + 10 ** (snr_db / 10))",
    "1.2": "return nlos_distance_m ** (3.64 / 2.27)",
    "1.3": "return library_rate(snr_db + generator.normal(0, variance_db2**0.5, draws)).mean()",
}
HELPED = {"_1_2": "return power(nlos_distance_m, 3.64 / 2.27)"}
WRONG = "return nlos_distance_m ** (2.27 / 3.64)"
SWALLOWS = """import time
    while True:
        try:
            time.sleep(1)
        except BaseException:
            pass"""
SUSPECT = """course = 'Radio'
%time x = 1
def f(checks):
    return checks.eval()"""
FAKE = """class checks:
    rate_from_snr = same_path_loss = mean_rate = staticmethod(lambda answer: print("right"))"""
PATCH = """import uavdh_lite.course.checks.exercise as one
one.Exercise.wrong_with = lambda self, answer: \"\""""


def answer(notebook, number):
    """The cell of an answer."""
    mark = number.replace(".", "-")
    cells = (c for c in notebook.cells if c.metadata.get("nbgrader", {}).get("grade_id") == mark)
    return next(cells)


def check_of(notebook, number):
    return answer(notebook, f"check-{number}")


def solved(notebook, **written):
    """The students' notebook with answers; `_1_2="..."` gives another one for 1.2."""
    for number, text in (SOLVED | {k[1:].replace("_", "."): v for k, v in written.items()}).items():
        cell = answer(notebook, number)
        cell.source = cell.source.replace(f'raise NotImplementedError("exercise {number}")', text)
    return notebook


def copied(notebook):
    cell = answer(notebook, "1.1")
    notebook.cells.insert(notebook.cells.index(cell), nbformat.from_dict(cell))
    return notebook


def copied_before_it_was_answered(notebook):
    stub = nbformat.from_dict(answer(notebook, "1.1"))
    solved(notebook).cells.insert(0, stub)
    return notebook


def without(notebook, *cells):
    notebook.cells = [cell for cell in notebook.cells if cell not in cells]
    return notebook


def without_metadata(notebook):
    for cell in solved(notebook).cells:
        cell.metadata = nbformat.NotebookNode()
        del cell["id"]
    return notebook


def edited_check(notebook):
    check_of(solved(notebook, _1_2=WRONG), "1.2").source = 'print("Exercise 1.2: right.")'
    return notebook


def with_cell(notebook, source, **written):
    solved(notebook, **written).cells.insert(2, nbformat.v4.new_code_cell(source))
    return notebook


def takes_a_solution(notebook):
    answer(solved(notebook), "1.2").source = "same_loss_m = checks.same_path_loss.solution"
    return notebook


def noisy(notebook):
    return solved(notebook, _1_2=f"print('x' * 2_000_000)\n    {SOLVED['1.2']}")


def helped(notebook):
    with_cell(notebook, "def power(x, y):\n    return x**y", _1_2="return power(")
    answer(notebook, "1.2").source += "nlos_distance_m, 3.64 / 2.27)"
    return notebook


def broken_import(notebook):
    """In the first cell, whose other lines everything needs."""
    solved(notebook, _1_2="return nlos_distance_m ** math.prod([3.64, 1 / 2.27])")
    setup = next(c for c in notebook.cells if c.source.startswith("%matplotlib"))
    setup.source = f"import a_package_that_nobody_has\nimport math\n{setup.source}"
    return notebook


def with_outputs(notebook):
    answer(solved(notebook), "1.1").outputs = [{"output_type": "what is this", "text": "x" * 9999}]
    return notebook


HOSTILE = """import glob, os, sqlite3
from IPython.display import HTML
for path in ["../../../gradebook.db", *glob.glob("/tmp/**/gradebook.db", recursive=True)]:
    with sqlite3.connect(path) as book:
        book.execute("create trigger t after insert on grade begin update grade set x = 9; end")
print("<script>alert(1)</script>", glob.glob("/**/*.ipynb", recursive=True)[-9:])
print(os.listdir("../.."))
HTML("<script>alert(1)</script>")"""

# What each student made of the notebook, the points for it, and what is said before it is graded
STUDENTS = {
    "all": (solved, [1, 2, 2], None),
    "one": (lambda n: solved(n, _1_2="", _1_3=""), [1, 0, 0], None),
    "wrong": (lambda n: solved(n, _1_2=WRONG), [1, 0, 2], None),
    "copied": (lambda n: copied(solved(n)), [1, 2, 2], None),
    "copied_stub": (copied_before_it_was_answered, [1, 2, 2], None),
    "deleted_check": (lambda n: without(solved(n), check_of(n, "1.2")), [1, 2, 2], None),
    "deleted_answer": (lambda n: without(solved(n), answer(n, "1.3")), [1, 2, 0], None),
    "without_metadata": (without_metadata, [1, 2, 2], None),
    "syntax": (lambda n: solved(n, _1_2="return ("), [1, 0, 2], None),
    "endless": (lambda n: solved(n, _1_2="while True:\n        pass"), [1, 0, 2], None),
    "swallows": (lambda n: solved(n, _1_2=SWALLOWS), [1, 0, 2], None),
    "exits": (lambda n: solved(n, _1_2="import os\n    os._exit(0)"), [1, 0, 2], None),
    "exits_at_once": (lambda n: with_cell(n, "import os\nos._exit(0)"), [1, 2, 2], None),
    "noisy": (noisy, [1, 2, 2], None),
    "asks": (lambda n: solved(n, _1_2="return float(input())"), [1, 0, 2], None),
    "edited_check": (edited_check, [1, 0, 2], "the check of exercise 1.2 was edited: restored"),
    "fake": (lambda n: with_cell(n, FAKE, _1_2=WRONG), [1, 0, 2], "in place of a check"),
    "patches": (lambda n: with_cell(n, PATCH, _1_2=WRONG), [1, 0, 2], "reads a solution"),
    "takes": (takes_a_solution, [1, 0, 2], "answer to exercise 1.2 reads a solution"),
    "hostile": (lambda n: with_cell(n, HOSTILE, _1_2=WRONG), [1, 0, 2], None),
    "helped": (helped, [1, 2, 2], None),
    "import": (broken_import, [1, 2, 2], None),
    "suspect": (lambda n: with_cell(n, SUSPECT), [1, 2, 2], None),
    "odd_outputs": (with_outputs, [1, 2, 2], None),
}  # fmt: skip
OTHER = NOTEBOOKS / "exercises/02_shadow_ray_tracing/02_shadow_ray_tracing.ipynb"
FILES = {  # what others handed in instead of a notebook under its name
    "(1)": (lambda text: text, f"{ASSIGNMENT}/{ASSIGNMENT} (1).ipynb", [1, 2, 2], None),
    "above": (lambda text: text, f"{ASSIGNMENT}.ipynb", [1, 2, 2], None),
    "notepad": (lambda text: "\ufeff" + text, FILE, [1, 2, 2], None),
    "garbage": (lambda text: "this is no notebook", FILE, [0, 0, 0], "cannot be used"),
    "cut": (lambda text: text[: len(text) // 2], FILE, [0, 0, 0], "cannot be used"),
    "list": (lambda text: "[]", FILE, [0, 0, 0], "cannot be used"),
    "other": (lambda text: OTHER.read_text(), FILE, [0, 0, 0], "none of this notebook's exercises"),
    "zip": (
        lambda text: text, f"{ASSIGNMENT}/homework.zip", [0, 0, 0], "hand in the .ipynb"
    ),
    "no_character": (
        lambda text: text.replace("snr_db / 10", "snr_db / 10 # \\ud800"), FILE, [0, 0, 0],
        "cannot be used (UnicodeEncodeError",
    ),
}  # fmt: skip
POINTS = {name: row[-2] for name, row in {**STUDENTS, **FILES}.items()}
NOTES = {name: row[-1] for name, row in {**STUDENTS, **FILES}.items()}


def hand_in(root: Path) -> None:
    """A class of whom most are odd in one way."""
    for student, (made, _, _) in STUDENTS.items():
        notebook = made(nbformat.read(NOTEBOOKS / "exercises" / FILE, as_version=4))
        path = root / "submitted" / student / FILE
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(notebook))
    text = (root / "submitted" / "all" / FILE).read_text()
    for student, (changed, name, _, _) in FILES.items():
        path = root / "submitted" / student / name
        path.parent.mkdir(parents=True)
        path.write_text(changed(text), encoding="utf-8")


@pytest.fixture
def root(tmp_path):
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "exercises" / ASSIGNMENT)
    (tmp_path / "submitted").mkdir()
    return tmp_path


def classroom(root, *command):
    return main(["classroom", *map(str, command), "--course", str(root)])


def test_what_is_odd_is_named_and_all_that_was_answered_is_in_a_copy(root):
    hand_in(root)
    (root / "submitted" / "nothing" / ASSIGNMENT).mkdir(parents=True)
    before = {p: p.read_bytes() for p in (root / "submitted").rglob("*") if p.is_file()}
    sheets = {sheet.student: sheet for sheet in handed_in.look_through(root, ASSIGNMENT)}
    assert {*sheets} == {*NOTES}
    numbers = [o.number for o in checks.EXERCISES.values() if o.number.startswith("1.")]
    for student, note in NOTES.items():
        sheet = sheets[student]
        said = " / ".join(sheet.notes + sheet.private)
        assert note in said if note else not said, (student, said)
        mended = nbformat.read(root / "checked" / student / FILE, as_version=4)
        nbformat.validate(mended)
        marked = [c.metadata.nbgrader.grade_id for c in mended.cells if "nbgrader" in c.metadata]
        assert marked == [
            f"{kind}{n.replace('.', '-')}" for n in numbers for kind in ("", "check-")
        ]
        text = "\n".join(cell.source for cell in mended.cells)
        assert all(html.escape(note) in text for note in sheet.notes)
        assert not any(note in text for note in sheet.private)  # nobody has judged that yet
        assert SOLVED["1.1"] in text or not POINTS[student][0]
    assert before == {p: p.read_bytes() for p in (root / "submitted").rglob("*") if p.is_file()}


OWN = {  # number, how far after the answer, what it is, what the answers are then
    "a draft": ("1.1", 0, "def rate(snr_db):\n    return snr_db", {}),
    "a name": ("1.1", 0, "rate = None  # follows", {}),
    "a name that comes later": ("1.1", 0, "np = np\nmean_rate = None\npower = pow", HELPED),
    "a helper": ("1.1", 1, "power = pow\n\nrate(0)", HELPED),
    "the first half": ("1.2", 0, "power = pow", HELPED),
    "below": ("1.2", 1, f"def same_loss_m(nlos_distance_m):\n    {SOLVED['1.2']}", {"_1_2": WRONG}),
    "a value afterwards": ("1.1", 2, "rate = rate(0)", {}),
    "a check": ("1.1", 2, "checks.rate_from_snr(rate)\npower = pow", HELPED),
}


@pytest.mark.parametrize(
    "kind, marked", [(k, m) for k in OWN for m in (True, False) if m or "later" not in k]
)
def test_what_is_right_from_top_to_bottom_is_right_in_the_copy(root, kind, marked):
    number, after, source, answers = OWN[kind]
    notebook = solved(nbformat.read(root / "exercises" / FILE, as_version=4), **answers)
    beside = notebook.cells.index(answer(notebook, number))
    own = nbformat.v4.new_code_cell(source)
    if "half" in kind:
        own.metadata = notebook.cells[beside].metadata
    notebook.cells.insert(beside + after, own)
    for cell in () if marked else notebook.cells:
        cell.metadata = nbformat.NotebookNode()
    (path := root / "submitted" / "a_1" / FILE).parent.mkdir(parents=True)
    path.write_text(json.dumps(notebook))
    (sheet,) = handed_in.look_through(root, ASSIGNMENT)
    assert sheet.answered == 3
    for made in (notebook, sheet.notebook):
        space = {}
        for cell in made.cells:
            if cell.cell_type == "code" and "%pip" not in cell.source:
                exec(cell.source.replace("%matplotlib inline", ""), space)


def test_only_what_is_there_for_this_assignment_is_graded(root):
    """A better sheet in another's zip, one taken back, names that are globs, Windows' line ends."""
    whole = json.dumps(solved(nbformat.read(root / "exercises" / FILE, as_version=4)))
    blank = (root / "exercises" / FILE).read_text().replace(r"\n", r"\r\n")
    every = {f"{who}/{FILE}": whole for who in ("[x]*_4", ".y_6", "z_7")}
    every |= {f"late_5/{FILE}": blank, f"late_5/{OTHER.stem}/{ASSIGNMENT}.ipynb": whole}
    for name, text in every.items():
        (path := root / "submitted" / name).parent.mkdir(parents=True)
        path.write_text(text)
    for left in ({"late_5": 0, "-x--_4": 3, "-y_6": 3, "z_7": 3}, {"late_5": 0, "-x--_4": 3}):
        sheets = handed_in.look_through(root, ASSIGNMENT)
        assert {sheet.student: sheet.answered for sheet in sheets} == left
        assert {p.parts[-3] for p in (root / "checked").glob(f"*/{FILE}")} == {*left}
        assert any("folder [x]*_4" in said for sheet in sheets for said in sheet.private)
        for gone in (".y_6", "z_7"):
            shutil.rmtree(root / "submitted" / gone, ignore_errors=True)


def test_what_is_large_a_link_or_a_script_costs_one_student_at_most(root):
    """Outputs of 52 MB, 4,000 cells, a link to another's work, a folder, a script for a name."""
    blank = root / "exercises" / FILE
    whole = solved(nbformat.read(blank, as_version=4))
    for who in ("large", "many", "linked", "script", "both", "folder"):
        path, own = root / "submitted" / who / FILE, copy.deepcopy(whole)
        path.parent.mkdir(parents=True)
        if who == "large":
            answer(own, "1.1").outputs = [nbformat.v4.new_output("stream", text="x" * 52_000_000)]
        elif who == "many":
            own.cells += [nbformat.v4.new_code_cell(f"x = {k}") for k in range(4_000)]
        elif who == "script":
            path = path.with_name(f"{ASSIGNMENT}<script>\x1b[2J.ipynb")
        elif who == "both":
            shutil.copy(blank, path)
            path = path.with_name(f"{ASSIGNMENT} (1).ipynb")
        if who == "linked":
            path.symlink_to(root / "submitted" / "large" / FILE)
        elif who == "folder":
            path.mkdir()
        else:
            path.write_text(json.dumps(own))
    shutil.copy(blank, root / "submitted" / "script" / FILE)
    began = time.process_time()
    sheets = {s.student: s for s in handed_in.look_through(root, ASSIGNMENT)}
    assert time.process_time() - began < 10
    answered = dict.fromkeys(sheets, 3) | {"linked": 0, "folder": 0}
    assert {who: sheet.answered for who, sheet in sheets.items()} == answered and len(sheets) == 6
    assert "hand in the .ipynb itself" in sheets["linked"].notes[0]
    text = (root / "checked" / "script" / FILE).read_text()
    assert "&lt;script&gt;" in text and "<script>" not in text and "\\u001b" not in text
    assert len((root / "checked" / "large" / FILE).read_text()) < 100_000


@pytest.mark.parametrize("damage", ["this is no notebook", '{"cells": []}', None])
def test_a_release_that_is_damaged_or_not_there_is_named(root, damage, capsys):
    release = root / "exercises" / FILE
    release.write_text(damage) if damage else release.unlink()
    assert classroom(root, "check", ASSIGNMENT) == 2
    assert f"{release}: " in (said := capsys.readouterr().err) and said.count("\n") == 1


def packed(archive, files):
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_moodle_s_zip_comes_in_and_the_feedback_goes_back(root, capsys, monkeypatch):
    monkeypatch.setattr(handed_in, "LARGEST", 50)
    archive, names = root / "all.zip", ("Änne Müller_101", "B. O'Neil_102", "C d_103")
    odd = [f"{names[0]}_assignsubmission_onlinetext_/onlinetext.html"]
    odd += [f"{names[0]}_assignsubmission_file_/{name}" for name in ("big.ipynb", ".x.ipynb", "..")]
    files = {
        f"{names[0]}_assignsubmission_file_/{ASSIGNMENT}.ipynb": "{}",
        f"{names[1]}_assignsubmission_file_/{ASSIGNMENT}/{ASSIGNMENT}.ipynb": "{}",
        f"{names[1]}_assignsubmission_file_/first/{ASSIGNMENT}.ipynb": "{}",
        f"{names[2]}_assignsubmission_file_{'字' * 250}.ipynb": "{}",
        f"{names[2]}_assignsubmission_file_{names[0]}_assignsubmission_file_x.ipynb": "{}",
        "../../D_104_assignsubmission_file_/../x.ipynb": "{}",
    }
    packed(archive, files | dict.fromkeys(odd, "x" * 51))
    assert classroom(root, "collect", archive, ASSIGNMENT) == 0
    said = capsys.readouterr().out
    assert "of 3 students" in said
    assert all(f"- {name}" in said for name in (*odd, "../../D_104")), said
    found = [p.relative_to(root).parts[1] for p in (root / "submitted").rglob("*.ipynb")]
    assert Counter(found) == dict(zip(names, (1, 2, 2), strict=True))
    assert not list(root.parent.glob("x.ipynb"))
    for who in names:
        page = root / "feedback" / who / FILE
        page.parent.mkdir(parents=True)
        page.with_suffix(".html").write_text(who)
    back = root / "back.zip"
    assert classroom(root, "return", ASSIGNMENT, back) == 0
    with zipfile.ZipFile(back) as given:
        said = {name: given.read(name).decode() for name in given.namelist()}
    assert said == {f"{w}_assignsubmission_file_/{ASSIGNMENT}.html": w for w in names}
    for command in (
        ["check", "99_none"],
        ["return", "99_none", back],
        ["return", ASSIGNMENT, back],
    ):
        assert classroom(root, *command) == 2


def test_a_zip_that_cannot_be_unpacked_is_named(root, capsys):
    archive = root / "all.zip"
    packed(archive, {"a_1_assignsubmission_file_/x.ipynb": bytes(range(256)) * 9})
    content = archive.read_bytes()
    place = content.index(b"PK\1\2") - 40  # within the compressed bytes
    for damaged in (content[:place] + bytes(30) + content[place + 30 :], content[:99], b"no zip"):
        archive.write_bytes(damaged)
        assert classroom(root, "collect", archive, ASSIGNMENT) == 2
        said = capsys.readouterr().err
        assert "all.zip: " in said and said.count("\n") == 1


def test_only_what_has_changed_is_graded_again(root):
    """A second zip replaces what a student had; the time of a sheet is that of its last change."""
    text = (NOTEBOOKS / "exercises" / FILE).read_text()
    other = text.replace('raise NotImplementedError(\\"exercise 1.1\\")', "return 1")

    def checked(**files):
        every = {f"{who}_assignsubmission_file_/{name}": own for who, (name, own) in files.items()}
        packed(root / "all.zip", every)
        assert classroom(root, "collect", root / "all.zip", ASSIGNMENT) == 0
        assert classroom(root, "check", ASSIGNMENT) == 0
        found = {p.parts[-3]: p.name for p in (root / "submitted").rglob("*.ipynb")}
        assert found == {who: name for who, (name, _) in files.items()}
        stamps = root.glob("checked/*/*/timestamp.txt")
        return {path.parts[-3]: path.stat().st_mtime_ns for path in stamps}

    first = checked(a_1=("x.ipynb", text), b_2=("y.ipynb", text), c_3=("z.ipynb", text))
    assert other != text
    second = checked(
        a_1=("x.ipynb", text),
        b_2=("y.ipynb", other),
        c_3=("z (1).ipynb", text),
        d_4=("x.ipynb", text),
    )
    assert {who for who in second if second[who] != first.get(who)} == {"b_2", "d_4"}


def in_grade_book(root, points):
    """A grade book with an assignment of 5 points."""
    from nbgrader.api import Gradebook

    with Gradebook(f"sqlite:///{root}/gradebook.db", "uavdh_lite") as book:
        if not book.assignments:
            book.add_assignment(ASSIGNMENT)
            book.add_notebook("one", ASSIGNMENT)
            book.add_grade_cell("check", "one", ASSIGNMENT, max_score=5, cell_type="code")
        for who, own in points.items():
            if who not in [student.id for student in book.students]:
                book.add_student(who)
                book.add_submission(ASSIGNMENT, who)
            book.find_grade("check", "one", ASSIGNMENT, who).auto_score = own
            (root / "checked" / who / ASSIGNMENT).mkdir(parents=True)
        book.db.commit()


HEADER = "Identifier,Full name,Grade,Maximum Grade,Feedback comments\n"
ELSEWHERE = "Row,Identifier,Grade,Attempts,Maximum Grade,Full name\n"


@pytest.mark.filterwarnings("ignore:Object of type")  # nbgrader's own
def test_moodle_s_worksheet_is_filled_in_with_the_points(root, capsys):
    sheet, filled = root / "grades.csv", root / "filled.csv"
    command = ("marks", ASSIGNMENT, sheet, filled)
    assert classroom(root, *command) == 2
    assert "run nbgrader autograde first" in capsys.readouterr().err
    in_grade_book(root, {"Änne Müller_101": 5, "B_102": 2, "Gone_104": 1, "Taken back_102": 3})
    shutil.rmtree(root / "checked" / "Taken back_102")
    for header, most, given, code, mark in (
        (HEADER, "5.00", ["5.00", "2.00"], "utf-8", ","),
        (ELSEWHERE, "5.00", ["5.00", "2.00"], "utf-8", ","),
        ("Kennung,Full name,X,Bestwert", "1,00", ["1,00", "0,40"], "cp1252", ";"),
        (HEADER.replace("Grade", "X", 1), "1.00", ["1.00", "0.40"], "utf-16", "\t"),
    ):
        names, grade = header.strip().split(","), "X" if "X" in header else "Grade"
        rows = [[*names]]
        for n in (101, 102, 103):
            row = {
                "Full name": "M, Ä",
                "Maximum Grade": most,
                "Bestwert": most,
                "Row": f"{204 - n}",
            }
            row |= {"Identifier": f"Participant {n}", "Kennung": f"Teilnehmer {n}"}
            rows.append([row.get(name, "") for name in names])
        csv.writer(out := io.StringIO(), delimiter=mark).writerows(rows)
        sheet.write_bytes(out.getvalue().encode("utf-8-sig" if code == "utf-8" else code))
        assert classroom(root, *command, "--column", grade) == 0
        found = list(csv.reader(filled.read_text(code).splitlines(), delimiter=mark))
        assert [row[names.index(grade)] for row in found[1:]] == [*given, ""]
        assert found[1][names.index("Full name")] == "M, Ä"
        assert f"- Gone_104 is not in {sheet}\n{filled}: 2 grades" in capsys.readouterr().out
    bad = [f"{HEADER}Participant 101,A,,{most},\n" for most in ("a scale", "nan", "0", "inf")]
    other = [HEADER.replace(name, "Note") for name in ("Identifier", "Grade", "Maximum Grade")]
    for text in (*other, *bad, "", "\0"):
        sheet.write_text(text)
        assert classroom(root, *command) == 2
        assert f"{sheet}: no grading worksheet with Grade" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:Object of type")  # nbgrader's own
@pytest.mark.parametrize(
    "points, said",
    [
        ({"B_102": 297}, f"B_102 has 297 of 5 points in {ASSIGNMENT}"),
        ({"B_102": None}, f'autograde --force --student="B_102" {ASSIGNMENT}'),
        ({"A twin_102": 1, "B_102": 2}, "submitted/A twin_102 and submitted/B_102 have one number"),
    ],
)
def test_marks_that_cannot_be_are_refused(root, capsys, points, said):
    in_grade_book(root, points)
    (root / "grades.csv").write_text(HEADER)
    assert classroom(root, "marks", ASSIGNMENT, root / "grades.csv", root / "filled.csv") == 2
    assert said in capsys.readouterr().err and not (root / "filled.csv").exists()


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """The commands of the guide, for the whole class."""
    root = tmp_path_factory.mktemp("course")
    config = (NOTEBOOKS / "nbgrader_config.py").read_text()
    assert "Integer(180" in config
    (root / "nbgrader_config.py").write_text(config.replace("Integer(180", "Integer(60"))
    shutil.copytree(NOTEBOOKS / "solutions" / ASSIGNMENT, root / "solutions" / ASSIGNMENT)
    nbgrader(root, "generate_assignment", "--force", ASSIGNMENT)
    hand_in(root)
    assert main(["classroom", "check", ASSIGNMENT, "--course", str(root)]) == 0
    nbgrader(root, "autograde", ASSIGNMENT)
    nbgrader(root, "generate_feedback", ASSIGNMENT)
    nbgrader(root, "export")
    return root


def nbgrader(root, *command):
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
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_a_sheet_has_a_limit_of_time_and_what_no_file_can_hold_is_replaced(monkeypatch):
    monkeypatch.syspath_prepend(str(NOTEBOOKS))
    space = {"get_config": Config}
    exec((NOTEBOOKS / "nbgrader_config.py").read_text(), space)
    odd = "print('\\ud800')\nraise ValueError('\\ud800')"
    sources = [odd, *["while True:\n    pass"] * 9, "checks.rate_from_snr(rate)"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(s) for s in sources])
    notebook.cells[-1].metadata.nbgrader = assignments._cell("check-1-1", points=1)
    began, step = time.monotonic(), space["WithinWalls"](whole=3, unprotected=True)
    step.preprocess(notebook, {"metadata": {"path": "nowhere"}})
    assert time.monotonic() - began < 60
    nbformat.writes(notebook).encode()
    assert "took the 3 s of a sheet" in notebook.cells[-1].outputs[0].evalue


def points(root):
    from nbgrader.api import Gradebook

    with Gradebook(f"sqlite:///{root / 'gradebook.db'}", "uavdh_lite") as book:
        found = {}
        for submission in book.assignment_submissions(ASSIGNMENT):
            grades = {grade.name: grade.auto_score for grade in submission.notebooks[0].grades}
            assert submission.max_score == 5 and not submission.needs_manual_grade
            found[submission.student.id] = [grades[f"check-1-{k}"] for k in (1, 2, 3)]
        return found


@pytest.mark.long
@pytest.mark.longest
def test_each_student_gets_the_points_of_the_exercises_that_are_right(course):
    assert points(course) == POINTS
    for path in (course / "checked").rglob("timestamp.txt"):
        graded = course / "autograded" / path.relative_to(course / "checked")
        assert graded.read_text() == path.read_text()
    rows = (course / "grades.csv").read_text().splitlines()
    assert {row.split(",")[3] for row in rows[1:]} >= {*POINTS}


@pytest.mark.long
@pytest.mark.longest
def test_feedback_says_what_is_wrong_and_what_was_odd(course):
    said = {s: (course / "feedback" / s / FILE).with_suffix(".html").read_text() for s in POINTS}
    for student, text in {
        "wrong": "in sight is the longer",
        "one": "Is there a `return` in every branch?",
        "endless": "Is there a loop that never ends",
        "swallows": "it never ends, and cannot be interrupted",
        "exits": "it ended its own process",
        "asks": "input()",
        "garbage": "cannot be used",
        "zip": "hand in the .ipynb",
    }.items():
        assert text in said[student], student
    assert len(said["noisy"]) < len(said["all"]) + 300_000
    for student in POINTS:
        others = [name for name in POINTS if len(name) > 7 and name not in student]
        assert not any(name in said[student] for name in others), student
    assert "<script>alert" not in said["hostile"]


@pytest.mark.long
@pytest.mark.longest
def test_one_who_hands_in_again_is_graded_again_without_a_flag(course):
    path = course / "submitted" / "garbage" / FILE
    path.write_text((course / "submitted" / "all" / FILE).read_text())
    future = path.stat().st_mtime + 60
    os.utime(path, (future, future))
    assert main(["classroom", "check", ASSIGNMENT, "--course", str(course)]) == 0
    said = nbgrader(course, "autograde", ASSIGNMENT)
    assert said.count("Autograding ") == 1 and points(course)["garbage"] == [1, 2, 2]
    nbgrader(course, "generate_feedback", ASSIGNMENT)
    page = (course / "feedback" / "garbage" / FILE).with_suffix(".html").read_text()
    assert "set aside" not in page


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
