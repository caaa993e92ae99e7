"""The exercises' checks: typical mistakes are named."""

import importlib
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.course import checks
from uavdh_lite.course.checks import any_city
from uavdh_lite.course.checks.environment import FLIGHTS
from uavdh_lite.course.checks.table import Table, by_rule, edit
from uavdh_lite.course.checks.training import RUNS
from uavdh_lite.course.checks.trial import expect_none
from uavdh_lite.course.checks.values import close
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.missions import place
from uavdh_lite.observation import Observation
from uavdh_lite.storage import read_table

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SCRIPTS = sorted((ROOT / "notebooks" / "scripts" / "exercises").glob("*.py"))
MISTAKES = {
    name: answers
    for path in sorted((HERE / "mistakes").glob("*.py"))
    for name, answers in importlib.import_module(f"mistakes.{path.stem}").MISTAKES.items()
}
CASES = [
    pytest.param(name, answer, message, id=f"{name}-{k}")
    for name, answers in MISTAKES.items()
    for k, (answer, message) in enumerate(answers)
]


@pytest.mark.parametrize("name, answer, message", CASES)
def test_a_mistake_fails_with_a_message_that_names_it(name, answer, message):
    with pytest.raises(checks.CheckFailed, match=message):
        checks.EXERCISES[name](answer)


def test_the_validations_to_diagnose_are_recorded_ones():
    table = read_table(ROOT / "data/runs/deviations-manhattan.csv.gz")
    columns = ("landed", "collected", "time_used")
    for name, shares in RUNS.items():
        variant, seed, thousands = name.rsplit("-", 2)
        row = (table["variant"] == variant) & (table["seed"] == int(seed))
        row &= table["steps"] == 1000 * int(thousands)
        recorded = [round(float(table[column][row].item()), 3) for column in columns]
        assert list(shares) == recorded, name


def test_the_flights_by_hand_have_the_prices_of_the_library():
    prices = Rewards()
    terms = np.array([step for steps in FLIGHTS.values() for step in steps])
    for column, price in ((1, prices.movement), (2, prices.safety), (3, prices.crash)):
        assert set(terms[:, column]) == {0, price}
    assert (terms[:, 0] <= terms[:, 4]).all()


def test_a_small_citys_map_is_that_of_the_library():
    layers, uav, size = any_city.small_city_map.table.cases[-1][1]
    city = CityGenerator(9).draw(1, seed=3)[0]
    device = tuple(int(k) for k in divmod(city.device_cells[0], city.size))
    state = place(city, uav, devices=[device], data=[5], flying_time=30, max_devices=1)
    maps = Observation(Environment(city), "centred", size=size).centred_map(state)
    assert np.array_equal(layers, [city.landing, city.no_fly, city.buildings])
    assert np.array_equal(any_city.small_city_map.table.right[-1].value, maps[0, :3].numpy())


def test_every_exercise_has_two_mistakes_at_least():
    assert set(MISTAKES) == set(checks.EXERCISES)
    assert all(len(answers) >= 2 for answers in MISTAKES.values())


def test_every_notebook_has_its_exercises_in_order():
    numbers = [one.number for one in checks.EXERCISES.values()]
    assert numbers == sorted(numbers, key=lambda n: [int(part) for part in n.split(".")])
    for script in SCRIPTS:
        text = script.read_text().replace("\n# ", "\n")
        own = [
            (name, one)
            for name, one in checks.EXERCISES.items()
            if int(one.number.split(".")[0]) == int(script.name[:2])
        ]
        assert 2 <= len(own) <= 4
        places = [text.index(f"{one.heading}\n") for _, one in own]
        calls = [re.search(rf"^checks\.{name}\(", text, re.M).start() for name, _ in own]
        assert sorted(places + calls) == [
            p for pair in zip(places, calls, strict=True) for p in pair
        ]
    assert len(SCRIPTS) == len({one.number.split(".")[0] for one in checks.EXERCISES.values()})


@pytest.mark.parametrize("name", checks.EXERCISES)
def test_hints(name, capsys):
    one = checks.EXERCISES[name]
    one.given.clear()
    one.hint()
    one.hint()
    said = capsys.readouterr().out.splitlines()
    assert said == [f"Hint {k + 1} of 3: {words}" for k, words in enumerate(one.words)]
    assert one.picture().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="there are 1, 2 and 3"):
        one.hint(4)


@pytest.mark.parametrize("name", checks.EXERCISES)
@pytest.mark.parametrize("nothing", [None, ...])
def test_no_answer(name, nothing):
    with pytest.raises(checks.CheckFailed, match="no answer yet"):
        checks.EXERCISES[name](nothing)


def test_unwritten_functions_and_missing_returns():
    def blank(snr_db):
        raise NotImplementedError("exercise 1.1")

    def silent(snr_db):
        snr_db + 1

    for answer, message in (
        (blank, "blank is not written yet"),
        (silent, "is a `return` missing"),
    ):
        with pytest.raises(checks.CheckFailed, match=message):
            checks.rate_from_snr(answer)


def one_more(x):
    return x + 1


def plus_one(mistakes):
    cases = {"One more.": [12, (1,)], "Also for large numbers.": [(1000.25,)]}
    return Table(one_more, lambda: cases, mistakes)


def test_a_mistake_may_be_an_edit_of_the_solution():
    twice = edit("1", "2"), lambda x: 2 * x
    table = plus_one({"one less": edit("+", "-"), "two more or twice": twice})
    for answer, message in (
        (lambda x: x - 1, "^one less$"),
        (lambda x: x + 2, "^two more"),
        (lambda x: 2 * x, "^two more"),
    ):
        with pytest.raises(checks.CheckFailed, match=message):
            table(answer)
    with pytest.raises(ValueError, match="one_more has no '-' to be changed"):
        edit("-", "+").of(one_more)


def test_without_its_source_a_check_shows_the_rule(monkeypatch):
    def no_source(function):
        raise OSError("could not get source code")

    monkeypatch.setattr(inspect, "getsource", no_source)
    with pytest.raises(checks.CheckFailed, match=r"expected 2\. One more"):
        plus_one({"one less": edit("+", "-")})(lambda x: x - 1)


def test_a_mistake_is_named_only_if_it_agrees_on_every_case():
    table = plus_one({"it forgets the 1": lambda x: x})
    table(lambda x: x + 1)
    with pytest.raises(checks.CheckFailed, match="forgets the 1"):
        table(lambda x: x)
    with pytest.raises(checks.CheckFailed, match=r"\(1\) gives 7, expected 2\. One more\."):
        table(lambda x: 7 if x == 1 else x)
    with pytest.raises(checks.CheckFailed, match=r"\(12\) gives 12, expected 13\. One more\."):
        table(lambda x: x + (x != 12))


def test_the_smallest_failing_case_comes_with_its_rule_and_the_digits_that_differ():
    table = plus_one({})
    with pytest.raises(checks.CheckFailed, match=r"gives 1001\.3, expected 1001\.2\. Also"):
        table(lambda x: x + 1 + 0.01 * (x > 100))
    with pytest.raises(checks.CheckFailed, match=r"has the shape \(1,\), one number is expected"):
        table(lambda x: [x + 1])
    with pytest.raises(checks.CheckFailed, match=r"\(1000.25\) stops with KeyError: 1. Also for"):
        table(lambda x: {}[1] if x > 100 else x + 1)


def test_rows_are_made_into_arguments_and_called_by_their_own_words():
    table = Table(one_more, {"One more.": [(1, 2)]}, made=lambda *two: (sum(two),))
    table.call = lambda x: f"asked for {x}"
    table(lambda x: x + 1)
    with pytest.raises(checks.CheckFailed, match=r"^asked for 3 gives 3, expected 4\. One more"):
        table(lambda x: x)


def test_a_case_goes_to_the_last_rule_whose_question_is_true():
    questions = {"any": lambda x: True, "even": lambda x: x % 2 == 0, "large": lambda x: x > 5}
    rules = by_rule(questions, [(1,), (2,), (7,), (8,)])
    assert rules == {"any": [(1,)], "even": [(2,)], "large": [(7,), (8,)]}


def test_what_is_worked_out_by_hand_is_not_told():
    table = plus_one({"one less": edit("+", "-")})
    table.by_hand("here", 13, (12,))
    for given, message in (
        (11, "here: 11 is not right. one less"),
        (14, "here: 14 is not right. One more."),
        (None, "here has no number yet."),
    ):
        with pytest.raises(checks.CheckFailed) as caught:
            table.by_hand("here", given, (12,))
        assert str(caught.value) == message


def test_the_first_sentence_whose_question_is_true_is_told():
    sentences = {"{x} is odd": lambda of: of.x % 2, "{x:.1f} is large": lambda of: of.x > 5}
    expect_none(sentences, x=4)
    for x, message in ((7, "7 is odd"), (8, r"8\.0 is large")):
        with pytest.raises(checks.CheckFailed, match=message):
            expect_none(sentences, x=x)


def test_close_compares_shapes_and_takes_anything():
    assert close([1, 2], (1.0, 2.0)) and not close([1, 2], [[1, 2]])
    assert not close("text", 1.0) and not close(float("nan"), 1.0)


def test_the_teaching_guide_has_every_exercise():
    guide = (ROOT / "docs" / "teach" / "index.md").read_text()
    rows = re.findall(r"^\| (\d+\.\d) \| (.+?) \| (\d+) \| (\d+)\*? \|", guide, re.M)
    assert rows == [
        (one.number, one.title, str(one.points), str(one.minutes))
        for one in checks.EXERCISES.values()
    ]


def test_the_heading_of_an_exercise_must_be_that_of_the_notebook():
    with pytest.raises(ValueError, match="2 points, 10 minutes"):
        checks.exercise.exercise("1.9 · No points", "", "", figure=None)(lambda answer: None)
