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
WRONG = "return nlos_distance_m ** (2.27 / 3.64)"
SWALLOWS = """import time
    while True:
        try:
            time.sleep(1)
        except BaseException:
            pass"""
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


TRIGGER = """import glob, sqlite3
for path in ["../../../gradebook.db", *glob.glob("/tmp/**/gradebook.db", recursive=True)]:
    with sqlite3.connect(path) as book:
        book.execute("create trigger t after insert on grade begin update grade set x = 9; end")
"""
PEEK = """import glob, os
from IPython.display import HTML
print("<script>alert(1)</script>", glob.glob("/**/*.ipynb", recursive=True)[-9:])
print(os.listdir("../.."), os.listdir("../../../submitted"))
HTML("<script>alert(1)</script>")"""

# What each student made of the notebook, the points for it, and what is said before it is graded
STUDENTS = {
    "all": (solved, [1, 2, 2], None),
    "one": (lambda n: solved(n, _1_2="", _1_3=""), [1, 0, 0], None),
    "wrong": (lambda n: solved(n, _1_2=WRONG), [1, 0, 2], None),
    "copied": (lambda n: copied(solved(n)), [1, 2, 2], "answer to 1.1 is there 2 times"),
    "copied_stub": (copied_before_it_was_answered, [1, 2, 2], "the first answered one counts"),
    "deleted_check": (lambda n: without(solved(n), check_of(n, "1.2")), [1, 2, 2], "was deleted"),
    "deleted_answer": (lambda n: without(solved(n), answer(n, "1.3")), [1, 2, 0], "to 1.3 was del"),
    "without_metadata": (without_metadata, [1, 2, 2], "the answer to 1.2 had lost its metadata"),
    "syntax": (lambda n: solved(n, _1_2="return ("), [1, 0, 2], "answer to 1.2 cannot be read"),
    "endless": (lambda n: solved(n, _1_2="while True:\n        pass"), [1, 0, 2], None),
    "swallows": (lambda n: solved(n, _1_2=SWALLOWS), [1, 0, 2], None),
    "exits": (lambda n: solved(n, _1_2="import os\n    os._exit(0)"), [1, 0, 2], None),
    "exits_at_once": (lambda n: with_cell(n, "import os\nos._exit(0)"), [1, 2, 2], None),
    "noisy": (noisy, [1, 2, 2], None),
    "asks": (lambda n: solved(n, _1_2="return float(input())"), [1, 0, 2], None),
    "edited_check": (edited_check, [1, 0, 2], "the check of 1.2 was edited: restored"),
    "fake": (lambda n: with_cell(n, FAKE, _1_2=WRONG), [1, 0, 2], "in place of a check"),
    "patches": (lambda n: with_cell(n, PATCH, _1_2=WRONG), [1, 0, 2], "reads a solution"),
    "takes": (takes_a_solution, [1, 0, 2], "answer to 1.2 reads a solution"),
    "trigger": (lambda n: with_cell(n, TRIGGER, _1_2=WRONG), [1, 0, 2], None),
    "peeks": (lambda n: with_cell(n, PEEK), [1, 2, 2], None),
    "helped": (helped, [1, 2, 2], None),
    "import": (broken_import, [1, 2, 2], None),
    "heading": (lambda n: with_cell(n, "course = 'Radio'\n%time x = 1"), [1, 2, 2], None),
    "parameter": (lambda n: with_cell(n, "def f(checks): return checks.eval()"), [1, 2, 2], None),
    "odd_outputs": (with_outputs, [1, 2, 2], None),
}  # fmt: skip
OTHER = NOTEBOOKS / "exercises/02_shadow_ray_tracing/02_shadow_ray_tracing.ipynb"
FILES = {  # what others handed in instead of a notebook under its name
    "(1)": (lambda text: text, f"{ASSIGNMENT}/{ASSIGNMENT} (1).ipynb", [1, 2, 2], "was named"),
    "above": (lambda text: text, f"{ASSIGNMENT}.ipynb", [1, 2, 2], "was named"),
    "notepad": (lambda text: "\ufeff" + text, FILE, [1, 2, 2], None),
    "garbage": (lambda text: "this is no notebook", FILE, [0, 0, 0], "cannot be opened"),
    "cut": (lambda text: text[: len(text) // 2], FILE, [0, 0, 0], "cannot be opened"),
    "list": (lambda text: "[]", FILE, [0, 0, 0], "cannot be opened"),
    "other": (lambda text: OTHER.read_text(), FILE, [0, 0, 0], "set aside: another notebook"),
    "nothing": (lambda text: None, FILE, [0, 0, 0], "nothing handed in"),
    "zip": (
        lambda text: text, f"{ASSIGNMENT}/homework.zip", [0, 0, 0], "hand in the .ipynb"
    ),
    "no_character": (
        lambda text: text.replace("snr_db / 10", "snr_db / 10 # \\ud800"), FILE, [0, 0, 0],
        "cannot be opened as a notebook (UnicodeEncodeError",
    ),
    "twin": (lambda text: text + " ", FILE, [1, 2, 2], "the same file as twin_too"),
    "twin_too": (lambda text: text + " ", FILE, [1, 2, 2], "the same file as twin"),
}  # fmt: skip
POINTS = {name: row[-2] for name, row in {**STUDENTS, **FILES}.items() if name != "nothing"}
NOTES = {name: row[-1] for name, row in {**STUDENTS, **FILES}.items()}


def hand_in(root: Path) -> None:
    """A class of whom most are odd in one way."""
    for student, (made, _, _) in STUDENTS.items():
        notebook = made(nbformat.read(NOTEBOOKS / "exercises" / FILE, as_version=4))
        path = root / "submitted" / student / FILE
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(notebook) + "\n" * len(student))
    text = (root / "submitted" / "all" / FILE).read_text()
    for number, (student, (changed, name, _, _)) in enumerate(FILES.items()):
        path = root / "submitted" / student / name
        path.parent.mkdir(parents=True)
        if (content := changed(text)) is not None:
            twin = student.startswith("twin")
            path.write_text(content + " " * (0 if twin else number + 2), encoding="utf-8")


@pytest.fixture
def looked_through(tmp_path):
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "exercises" / ASSIGNMENT)
    hand_in(tmp_path)
    return {sheet.student: sheet for sheet in handed_in.look_through(tmp_path, ASSIGNMENT)}


def test_what_is_odd_is_named_and_nothing_else(looked_through):
    assert {*looked_through} == {*NOTES}
    for student, note in NOTES.items():
        sheet = looked_through[student]
        said = " / ".join(sheet.notes + sheet.private)
        assert note in said if note else not said, (student, said)


def test_all_that_was_answered_is_in_the_copy_and_what_was_handed_in_is_as_it_was(tmp_path):
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "exercises" / ASSIGNMENT)
    hand_in(tmp_path)
    before = {p: p.read_bytes() for p in (tmp_path / "submitted").rglob("*") if p.is_file()}
    for sheet in handed_in.look_through(tmp_path, ASSIGNMENT):
        path = tmp_path / "checked" / sheet.student / FILE
        assert path.exists() != sheet.missing == (sheet.student == "nothing")
        if sheet.missing:
            continue
        copy = nbformat.read(path, as_version=4)
        nbformat.validate(copy)
        marked = [c.metadata.nbgrader.grade_id for c in copy.cells if "nbgrader" in c.metadata]
        numbers = [o.number for o in checks.EXERCISES.values() if o.number.startswith("1.")]
        assert marked == [
            f"{kind}{n.replace('.', '-')}" for n in numbers for kind in ("", "check-")
        ]
        text = "\n".join(cell.source for cell in copy.cells)
        assert all(html.escape(note) in text for note in sheet.notes)
        assert not any(note in text for note in sheet.private)  # nobody has judged that yet
        if POINTS[sheet.student][0]:
            assert SOLVED["1.1"] in text
    assert before == {p: p.read_bytes() for p in (tmp_path / "submitted").rglob("*") if p.is_file()}


def test_moodle_s_zip_comes_in_and_the_feedback_goes_back(tmp_path, capsys):
    archive, names = tmp_path / "all.zip", ("Änne Müller_101", "B. O'Neil_102", "C d_103")
    with zipfile.ZipFile(archive, "w") as packed:
        for who in names[:2]:
            folder = f"{ASSIGNMENT}/" * (who == names[1])  # some hand in the folder
            packed.writestr(f"{who}_assignsubmission_file_/{folder}{ASSIGNMENT}.ipynb", "{}")
        packed.writestr(f"{names[2]}_assignsubmission_file_{ASSIGNMENT} (1).ipynb", "{}")
        packed.writestr(f"{names[0]}_assignsubmission_onlinetext_/onlinetext.html", "hello")
        packed.writestr("../../D_104_assignsubmission_file_/../x.ipynb", "{}")
    course = ["--course", str(tmp_path)]
    assert main(["classroom", "collect", str(archive), ASSIGNMENT, *course]) == 0
    said = capsys.readouterr().out
    assert "of 3 students" in said
    for name in (f"{names[0]}_assignsubmission_onlinetext_/onlinetext.html", "../../D_104"):
        assert f"- {name}" in said
    found = sorted(
        p.relative_to(tmp_path).parts[1] for p in (tmp_path / "submitted").rglob("*.ipynb")
    )
    assert found == sorted(names) and not list(tmp_path.parent.glob("x.ipynb"))
    for who in names:
        page = tmp_path / "feedback" / who / FILE
        page.parent.mkdir(parents=True)
        page.with_suffix(".html").write_text(who)
    back = tmp_path / "back.zip"
    assert main(["classroom", "return", ASSIGNMENT, str(back), *course]) == 0
    with zipfile.ZipFile(back) as packed:
        said = {name: packed.read(name).decode() for name in packed.namelist()}
    assert said == {f"{w}_assignsubmission_file_/{ASSIGNMENT}.html": w for w in names}
    for command in (["check", "99_none"], ["return", "99_none", str(back)]):
        assert main(["classroom", *command, *course]) == 2


def test_what_is_no_file_sets_one_student_aside(tmp_path):
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "exercises" / ASSIGNMENT)
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "submitted/good" / ASSIGNMENT)
    (tmp_path / "submitted" / "folder" / FILE).mkdir(parents=True)
    (tmp_path / "submitted" / "link" / ASSIGNMENT).mkdir(parents=True)
    (tmp_path / "submitted" / "link" / FILE).symlink_to("nowhere")
    folder, good, link = handed_in.look_through(tmp_path, ASSIGNMENT)
    assert not good.notes and good.notebook
    for sheet in (folder, link):
        assert sheet.notes == [f"set aside: {FILE} is not a file", "nothing handed in"]


def test_what_is_large_or_odd_is_read(tmp_path):
    """Outputs of 6 MB, 4,000 cells, a link to another's work, a name that is a script."""
    release = NOTEBOOKS / "exercises" / ASSIGNMENT
    shutil.copytree(release, tmp_path / "exercises" / ASSIGNMENT)
    whole = solved(nbformat.read(release / f"{ASSIGNMENT}.ipynb", as_version=4))
    for who in ("large", "many", "linked", "script", "both"):
        (tmp_path / "submitted" / who / ASSIGNMENT).mkdir(parents=True)
        path = tmp_path / "submitted" / who / FILE
        own = copy.deepcopy(whole)
        if who == "large":
            output = nbformat.v4.new_output("stream", text="x" * 6_000_000)
            answer(own, "1.1").outputs = [output]
        elif who == "many":
            own.cells += [nbformat.v4.new_code_cell(f"x = {k}") for k in range(4_000)]
        elif who == "script":
            path = path.with_name(f"{ASSIGNMENT}<script>\x1b[2J.ipynb")
        elif who == "both":
            shutil.copy(release / f"{ASSIGNMENT}.ipynb", path)
            path = path.with_name(f"{ASSIGNMENT} (1).ipynb")
        if who == "linked":
            path.symlink_to(tmp_path / "submitted" / "large" / FILE)
        else:
            path.write_text(json.dumps(own))
    began = time.monotonic()
    sheets = {s.student: s for s in handed_in.look_through(tmp_path, ASSIGNMENT)}
    assert time.monotonic() - began < 60
    assert {w: s.answered for w, s in sheets.items()} == {
        "large": 3, "many": 3, "script": 3, "both": 3, "linked": 0
    }  # fmt: skip
    assert "1,000 of 4,0" in sheets["many"].notes[0]
    assert "is not a file" in sheets["linked"].notes[0]
    text = (tmp_path / "checked" / "script" / FILE).read_text()
    assert "&lt;script&gt;" in text and "<script>" not in text and "\\u001b" not in text
    assert len((tmp_path / "checked" / "large" / FILE).read_text()) < 100_000


def test_a_student_whom_moodle_numbers_anew_is_one_student(tmp_path):
    shutil.copytree(NOTEBOOKS / "exercises" / ASSIGNMENT, tmp_path / "exercises" / ASSIGNMENT)
    handed = {
        "A B_1": "00",
        "A B_2": "02",
        "C_1": "00",
        "C_2": "02",
        "C_3": ASSIGNMENT,
        "D_1": "00",
    }
    handed |= {"one_1": ASSIGNMENT, "one_2": "00"}  # numbered by the lecturer
    for who, name in handed.items():
        (tmp_path / "submitted" / who / name).mkdir(parents=True)
        (tmp_path / "submitted" / who / name / f"{name}.ipynb").write_text("{}")
    (tmp_path / "submitted" / "one_1" / "00").mkdir()
    for who in ("N N_1", "N N_2"):  # two of one name, of whom one has handed in
        (tmp_path / "submitted" / who / "00").mkdir(parents=True)
    (tmp_path / "submitted" / "N N_3" / ASSIGNMENT).mkdir(parents=True)
    (tmp_path / "submitted" / "N N_3" / FILE).write_text("{}")
    sheets = {s.student: s.missing for s in handed_in.look_through(tmp_path, ASSIGNMENT)}
    assert sheets.pop("N N_3") is False and sheets.pop("N N_1") is True
    assert sheets == {"A B_1": True, "C_3": False, "D_1": True, "one_1": False, "one_2": True}


@pytest.mark.parametrize("damage", ["this is no notebook", '{"cells": []}'])
def test_a_damaged_release_is_named(tmp_path, damage, capsys):
    release = tmp_path / "exercises" / FILE
    release.parent.mkdir(parents=True)
    (tmp_path / "submitted" / "one").mkdir(parents=True)
    release.write_text(damage)
    assert main(["classroom", "check", ASSIGNMENT, "--course", str(tmp_path)]) == 2
    assert f"{release}: " in (said := capsys.readouterr().err) and said.count("\n") == 1


def test_a_zip_that_cannot_be_unpacked_is_named(tmp_path, capsys):
    archive = tmp_path / "all.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("a_1_assignsubmission_file_/x.ipynb", bytes(range(256)) * 9)
    content = archive.read_bytes()
    place = content.index(b"PK\1\2") - 40  # within the compressed bytes
    for damaged in (content[:place] + bytes(30) + content[place + 30 :], content[:99], b"no zip"):
        archive.write_bytes(damaged)
        command = ["classroom", "collect", str(archive), ASSIGNMENT, "--course", str(tmp_path)]
        assert main(command) == 2
        said = capsys.readouterr().err
        assert "all.zip: " in said and said.count("\n") == 1


def test_a_second_zip_replaces_what_is_another_and_leaves_the_rest(tmp_path, capsys):
    archive = tmp_path / "all.zip"

    def collected(**files):
        with zipfile.ZipFile(archive, "w") as packed:
            for who, (name, text) in files.items():
                packed.writestr(f"{who}_assignsubmission_file_/{name}", text)
        command = ["classroom", "collect", str(archive), ASSIGNMENT, "--course", str(tmp_path)]
        assert main(command) == 0
        found = {p for p in (tmp_path / "submitted").rglob("*") if p.is_file()}
        written = {(p.parts[-3], p.name, p.read_text()): p.stat().st_mtime_ns for p in found}
        return written, capsys.readouterr().out

    same, other, renamed = ("x.ipynb", "1"), ("y.ipynb", "2"), ("z.ipynb", "3")
    first, said = collected(a_1=same, b_2=other, c_3=renamed)
    assert said.endswith(f"submitted: {ASSIGNMENT} of 3 students: 3 new\n")
    files = {"a_1": same, "b_2": ("y.ipynb", "4"), "c_3": ("z (1).ipynb", "3"), "d_4": same}
    second, said = collected(**files)
    assert {*second} == {(who, *file) for who, file in files.items()}
    assert [key for key in second if first.get(key) == second[key]] == [("a_1", *same)]
    assert said.startswith("- b_2 handed in again\n- c_3 handed in again\n")
    assert said.endswith("1 as before, 2 handed in again, 1 new\n")


@pytest.mark.filterwarnings("ignore:Object of type")  # nbgrader's own
def test_moodle_s_worksheet_is_filled_in_with_the_points(tmp_path, capsys):
    from nbgrader.api import Gradebook

    sheet, filled = tmp_path / "grades.csv", tmp_path / "filled.csv"
    command = ["classroom", "marks", ASSIGNMENT, str(sheet), str(filled), "--course", str(tmp_path)]
    assert main(command) == 2 and "run nbgrader autograde first" in capsys.readouterr().err
    assert not handed_in.is_in_grade_book(tmp_path, ASSIGNMENT)
    with Gradebook(f"sqlite:///{tmp_path}/gradebook.db", "uavdh_lite") as book:
        book.add_assignment(ASSIGNMENT)
        book.add_notebook("one", ASSIGNMENT)
        book.add_grade_cell("check", "one", ASSIGNMENT, max_score=5, cell_type="code")
        for who, points in {"Änne Müller_101": 5, "B_102": 2, "Gone_104": 1}.items():
            book.add_student(who)
            book.add_submission(ASSIGNMENT, who)
            book.find_grade("check", "one", ASSIGNMENT, who).auto_score = points
        book.db.commit()
    assert handed_in.is_in_grade_book(tmp_path, ASSIGNMENT)
    assert not handed_in.is_in_grade_book(tmp_path, "99_none")
    header = "Identifier,Full name,Grade,Maximum Grade,Feedback comments\n"
    for grade, most, given, code, mark in (
        ("Grade", "5.00", ["5.00", "2.00"], "utf-8", ","),
        ("X", "1,00", ["1,00", "0,40"], "cp1252", ";"),
        ("X", "1.00", ["1.00", "0.40"], "utf-16", "\t"),
    ):
        rows = [header.replace("Grade", grade, 1).strip().split(",")]
        rows += [[f"Participant {n}", "M, Ä", "", most] for n in (101, 102, 103)]
        csv.writer(out := io.StringIO(), delimiter=mark).writerows(rows)
        content = out.getvalue()
        sheet.write_bytes(content.encode("utf-8-sig" if code == "utf-8" else code))
        assert main([*command, "--column", grade]) == 0
        found = list(csv.reader(filled.read_text(code).splitlines(), delimiter=mark))
        assert [row[2] for row in found[1:]] == [*given, ""] and found[1][1] == "M, Ä"
        assert f"- Gone_104 is not in {sheet}\n{filled}: 2 grades" in capsys.readouterr().out
    for bad in (
        header.replace("Grade", "Note"),
        *(f"{header}Participant 101,A,,{most},\n" for most in ("a scale", "nan", "0", "inf")),
        "",
        "\0",
    ):
        sheet.write_text(bad)
        assert main(command) == 2
        assert f"{sheet}: no grading worksheet with Grade" in capsys.readouterr().err
    with Gradebook(f"sqlite:///{tmp_path}/gradebook.db", "uavdh_lite") as book:
        book.add_student("A twin_102")
        book.add_submission(ASSIGNMENT, "A twin_102")
        book.find_grade("check", "one", ASSIGNMENT, "A twin_102").auto_score = 1
        book.db.commit()
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "submitted/A twin_102" in said and "submitted/B_102" in said and "one number" in said
    for points, reason in ((297, f"B_102 has 297 of 5 points in {ASSIGNMENT}"), (None, "B_102")):
        with Gradebook(f"sqlite:///{tmp_path}/gradebook.db", "uavdh_lite") as book:
            book.find_grade("check", "one", ASSIGNMENT, "B_102").auto_score = points
            book.db.commit()
        assert main(command) == 2 and reason in (reason_said := capsys.readouterr().err)
    assert f'autograde --force --student="B_102" {ASSIGNMENT}' in reason_said


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_what_is_set_aside_of_a_zip_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(handed_in, "LARGEST", 50)
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as packed:
        for name, size in ((f"{'x' * 250}.ipynb", 1), ("..", 1), ("big.ipynb", 101)):
            packed.writestr(f"a_1_assignsubmission_file_/{name}", "x" * size)
        for text in ("first", "second"):
            packed.writestr("b_2_assignsubmission_file_/y.ipynb", text)
    students, odd = handed_in.collect(tmp_path / "all.zip", tmp_path, ASSIGNMENT)
    assert students == {"a_1": "new", "b_2": "new"} and len(odd) == 3
    assert "/.. is set aside" in odd[0] and "/big.ipynb is set aside: 0 MB" in odd[1]
    assert "b_2_assignsubmission_file_/y.ipynb is there twice" in odd[2]


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
        "garbage": "cannot be opened",
        "zip": "hand in the .ipynb",
    }.items():
        assert text in said[student], student
    assert len(said["noisy"]) < len(said["all"]) + 300_000
    for student in POINTS:
        others = [name for name in POINTS if len(name) > 7 and name not in student]
        assert not any(name in said[student] for name in others), student
    assert "<script>alert" not in said["peeks"]


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
    sheet = handed_in.Sheet("one")
    assert handed_in._mended(kept.cells, kept, sheet).cells == kept.cells and not sheet.notes
    graded = [cell.metadata.nbgrader for cell in kept.cells if "nbgrader" in cell.metadata]
    assert sum(cell.get("points", 0) for cell in graded) == sum(one.points for one in own)
