"""The teaching guide: its plans add up, its tables are complete."""

import re
from pathlib import Path

import pytest

from uavdh_lite.course.checks import EXERCISES

DOCS = Path(__file__).parents[2] / "docs"
tables = pytest.importorskip("tables")
COURSE = [f"{number:02d}" for number in range(10)]


@pytest.mark.parametrize("name", ["three_afternoons", "seven_lessons", "week"])
def test_the_plan_adds_up_and_has_the_whole_course_in_order(name):
    table = tables.plan(name)
    assert f"plan {name}\n" in (DOCS / "teach" / "index.md").read_text()
    for session, longest, parts in tables.sessions(name):
        total = sum(minutes for _, minutes, _ in parts)
        assert total <= longest, f"{session} takes {total} minutes, not {longest}"
        assert f"| **{session}** | **{total}** |" in table
        assert longest < 130 or any(what == "break" for what, _, _ in parts) or "home" in session
    done = [number for _, _, parts in tables.sessions(name) for *_, ns in parts for number in ns]
    assert len(done) == len(set(done)) and set(done) <= {one.number for one in EXERCISES.values()}
    whats = [what for _, _, parts in tables.sessions(name) for what, _, _ in parts]
    read = [what[2:4] for what in whats if what.startswith("[`")]
    assert [number for number in read if number in COURSE] == COURSE


def test_a_part_has_the_minutes_of_the_notebook_and_of_its_exercises():
    parts = {p[0]: p[1] for _, _, parts in tables.sessions("three_afternoons") for p in parts}
    (path,) = tables.NOTEBOOKS.glob("00_*.ipynb")
    read = int(re.search(r"(\d+) minutes to read", path.read_text())[1])
    own = EXERCISES["flight_score"].minutes + EXERCISES["pilots"].minutes
    assert parts["[`00_first_flight`](../tutorials/00_first_flight.ipynb)"] == read + own


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


def test_every_notebook_has_its_outcome_with_its_exercises_and_questions():
    rows = tables.outcomes().splitlines()[2:]
    assert len(rows) == len(list(tables.NOTEBOOKS.glob("[0-9][0-9]_*.ipynb")))
    for number, one in ((one.number, one) for one in EXERCISES.values()):
        assert f"{number} ({one.minutes} min)" in rows[int(number.split(".")[0])]
    assert [row.rsplit(" | ", 1)[1] for row in rows] == 10 * ["4 |"] + 5 * ["— |"]


def test_the_first_page_is_short():
    """What one reads before the first lesson, and all that there is to read."""
    words = {path.stem: len(path.read_text().split()) for path in (DOCS / "teach").glob("*.md")}
    assert words["index"] <= 600 and sum(words.values()) <= 2700
