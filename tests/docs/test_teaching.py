"""The teaching guide: its plans add up, its tables are complete, its exam's points are right."""

import re
from pathlib import Path

import pytest

from uavdh_lite.course.checks import EXERCISES

DOCS = Path(__file__).parents[2] / "docs"
tables = pytest.importorskip("tables")
COURSE = [f"{number:02d}" for number in range(10)]


@pytest.mark.parametrize("name", ["three_afternoons", "two_afternoons", "four_weeks", "lecture"])
def test_the_plan_adds_up(name):
    table = tables.plan(name)
    assert f"plan {name}\n" in (DOCS / "teach" / "index.md").read_text()
    for session, longest, parts in tables.sessions(name):
        total = sum(minutes for _, minutes, _ in parts)
        assert total <= longest, f"{session} takes {total} minutes, not {longest}"
        assert f"| **{session}** | **{total}** |" in table
        assert longest < 130 or any(what == "break" for what, _, _ in parts) or "home" in session
    done = [number for _, _, parts in tables.sessions(name) for *_, ns in parts for number in ns]
    assert len(done) == len(set(done)) and set(done) <= {one.number for one in EXERCISES.values()}


@pytest.mark.parametrize("name", ["three_afternoons", "four_weeks"])
def test_the_plan_has_the_whole_course_in_order(name):
    whats = [what for _, _, parts in tables.sessions(name) for what, _, _ in parts]
    read = [what[2:4] for what in whats if what.startswith("[`")]
    assert [number for number in read if number in COURSE] == COURSE


def test_a_part_has_the_minutes_of_the_notebook_and_of_its_exercises():
    parts = {p[0]: p[1] for _, _, parts in tables.sessions("three_afternoons") for p in parts}
    (path,) = tables.NOTEBOOKS.glob("00_*.ipynb")
    read = int(re.search(r"(\d+) minutes to read", path.read_text())[1])
    own = EXERCISES["flight_score"].minutes + EXERCISES["pilots"].minutes
    assert parts["[`00_first_flight`](../tutorials/00_first_flight.ipynb)"] == read + own


def test_what_trial_readings_took_stands_next_to_what_is_planned():
    read = [re.search(r"(\d+) minutes to read", p.read_text()) for p in tables.NOTEBOOKS.glob("0*")]
    own = sum(one.minutes for one in EXERCISES.values() if int(one.number.split(".")[0]) < 10)
    kit = (DOCS / "teach" / "kit.md").read_text()
    planned = re.search(r"where (\d+)\s+are planned.*where (\d+)\s+are planned", kit, re.S)
    assert [int(n) for n in planned.groups()] == [sum(int(found[1]) for found in read), own]


def test_the_index_has_the_minutes_of_the_exercises_and_the_core_that_the_plan_has():
    parts = [part for _, _, parts in tables.sessions("three_afternoons") for part in parts]
    core = {number for *_, numbers in parts for number in numbers}
    index = (DOCS / "tutorials" / "index.md").read_text()
    rows = re.findall(r"^\| \[(\d+) · .* \| ([^|]+) \|$", index, re.M)
    assert (
        len(rows) == 15
        and 80 <= sum(o.minutes for o in EXERCISES.values() if o.number in core) <= 100
    )
    for notebook, said in rows:
        own = [one for one in EXERCISES.values() if one.number.split(".")[0] == notebook]
        marked = ", ".join(one.number for one in own if one.number in core)
        planned = f"{sum(one.minutes for one in own)} min" if own else "the project"
        assert said == planned + (f", core: {marked}" if marked else "")


def test_every_exercise_has_its_goals():
    rows = [line.split(" | ") for line in tables.exercises().splitlines()[2:]]
    assert len(rows) == len(EXERCISES)
    assert not [row[0] for row in rows if row[-1].strip(" |") == ""]


def test_the_points_of_the_exam_are_those_of_its_answers():
    text = (DOCS / "teach" / "exam.md").read_text()
    asked = {int(n): int(p) for n, p in re.findall(r"^\| (\d+) \| .* \| (\d+) \|$", text, re.M)}
    answers = re.split(r"(?m)^(\d+)\. ", text.partition("## Answers")[2])[1:]
    given = {
        int(number): sum(0.5 if p == "½" else int(p) for p in re.findall(r"\[([\d½])\]", answer))
        for number, answer in zip(answers[::2], answers[1::2], strict=True)
    }
    assert given == asked and len(asked) == 12 and sum(asked.values()) == 60


def test_the_numbers_of_the_exam_s_answers_are_right():
    text = (DOCS / "teach" / "exam.md").read_text()
    solved = {name: one.solution for name, one in EXERCISES.items()}
    low, high = (float(solved["rate_from_snr"](snr)) for snr in (-10, 10))
    p = solved["permutation_p"]
    smallest, here = p([4, 5, 6], [1, 2, 3]), p([96.1, 95.8, 96.4], [95.9, 95.2, 95.5])
    assert f"extreme: {smallest} [1]. (With these numbers it is {here}," in text
    assert f"= {low:.2f} [1]" in text and f"= {high:.2f}, {high / low:.0f} times" in text
    assert f"= {solved['same_path_loss'](40):.0f} m" in text
    assert f"16 · (6 · 25 + 1) = {16 * (6 * 25 + 1)}" in text
