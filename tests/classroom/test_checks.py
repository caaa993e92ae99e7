"""The exercises' checks: what they refuse, what they say of it, and that nothing breaks them."""

import ast
import copy
import itertools
import re
import sys
from pathlib import Path

import assignments
import jupytext
import numpy as np
import pytest
import torch
from mistakes import MISTAKES
from mutants import code_of

from uavdh_lite.course import checks
from uavdh_lite.course.checks import exercise as module
from uavdh_lite.course.checks.exercise import Exercise
from uavdh_lite.course.checks.notebook_07 import RUNS
from uavdh_lite.course.checks.values import difference
from uavdh_lite.environment import Rewards
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
OTHERWISE = ("mean_rate", "rewards_by_hand")  # asked
SCRIPTS = sorted((ROOT / "notebooks" / "scripts" / "exercises").glob("*.py"))
FUNCTIONS = {name: one for name, one in checks.EXERCISES.items() if one.rules}
WRONG = [
    pytest.param(name, answer, told, id=f"{name}-{k}")
    for name, answers in MISTAKES.items()
    for k, (answer, told) in enumerate(answers)
]


@pytest.mark.parametrize("name, answer, told", WRONG)
def test_a_wrong_answer_is_refused_with_the_rule_or_the_mistake(name, answer, told):
    assert re.search(told, checks.EXERCISES[name].wrong_with(answer))


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.filterwarnings("ignore")
def test_each_named_mistake_is_told_as_itself(name):
    one = checks.EXERCISES[name]
    assert len(one.mistakes) <= 3
    for sentence, mistake in one.mistakes.items():
        assert one.wrong_with(mistake) == sentence


@pytest.mark.parametrize("name", [n for n in FUNCTIONS if n not in OTHERWISE])
def test_every_parameter_matters_and_nothing_may_be_rounded(name):
    one = checks.EXERCISES[name]
    cases = [case for _, case in one.cases()]
    for k, kept in enumerate(cases[0]):
        if one.ask.__name__ == "<lambda>":
            assert one.wrong_with(
                lambda *c, k=k, kept=kept: one.solution(*c[:k], kept, *c[k + 1 :])
            )
    if all(isinstance(result, float) for result in one._right):
        assert one.wrong_with(lambda *case: 0.0)
        if any(result != round(result) for result in one._right):
            assert one.wrong_with(lambda *case: round(one.solution(*case), 2))


def plus_one(**options):
    rules = {"One more.": [12, 1], "Also for large numbers.": [1000.25]}
    return Exercise("9.9 · One more (1 point, 1 minutes)", lambda x: x + 1.0, rules, **options)


def test_the_rule_that_fails_first_is_told_with_its_smallest_case_and_the_digits_that_differ():
    one = plus_one()
    assert not one.wrong_with(lambda x: x + 1)
    for answer, told in {
        (lambda x: x): r"your function\(1\) gives 1, expected 2\. One more\.",
        (lambda x: x + 1 + 0.01 * (x > 99)): r"gives 1001\.3, expected 1001\.2\. Also for",
        (lambda x: 7 if x == 12 else x + 1): r"\(12\) gives 7, expected 13\. One more\.",
        (lambda x: [x + 1]): "gives .*, but one number is expected",
        (lambda x: None): "gives None, expected 2. Is there a `return` in every branch?",
        (lambda x: (x,)): r"gives \(1,\), but one number is expected",
        (lambda x: x + 99_999.0 + (x == 12)): r"gives 100000, expected 2\. One",
        (lambda x: print): "gives <built-in function print>, but one number is expected",
        (lambda x: {}[x]): r"stops with KeyError: 1, in line \d+, `\(lambda x: {}\[x\]\)",
        (lambda x: sys.exit()): "stops with SystemExit.*One more",
        (lambda x: [][x]): r"\(1\) stops with IndexError: .*,`\. One more\.$",
        (lambda x: eval("y")): r"\(1\) stops with NameError: .* is not defined, in line .*`\.$",
        (lambda: 1): r"\(1\) stops with TypeError: .* 1 was given\.$",
        (lambda x: x + 1 if x < 99 else x + "1"): r"stops with TypeError: .*\. Also for",
    }.items():
        assert re.search(told, one.wrong_with(answer))


def test_a_mistake_is_told_only_if_it_gives_the_same_in_every_case_and_a_value_may_be_kept_back():
    one = plus_one(mistakes={"It forgets the 1.": lambda x: x})
    assert one.wrong_with(lambda x: x) == "It forgets the 1."
    assert "expected 2" in one.wrong_with(lambda x: 7 if x == 1 else x)
    assert "expected 13" in one.wrong_with(lambda x: x + (x != 12))
    said = plus_one(secret=True).wrong_with(lambda x: x)
    assert said.startswith("your function(1) gives 1, which is not right.")
    nothing = checks.steps_to.wrong_with(lambda steps, values, threshold: None)
    assert "gives None, expected 100000. The result is" in nothing  # elsewhere None is right


def test_answers_that_change_their_arguments_or_remember_calls_are_refused():
    one = Exercise("9.9 · Sum (1 point, 1 minutes)", np.sum, {"Sum.": [np.ones(3), [1.0]]})
    asked = []

    def in_place(x):
        x += 1
        return np.sum(x - 1)

    def remembers(x):
        asked.append(x)
        return np.sum(x) + (len(asked) > 3)

    for changes in (in_place, lambda x: x.append(0.0) or sum(x)):
        assert "changes what it is given" in one.wrong_with(changes)
    assert "earlier calls" in one.wrong_with(remembers)
    assert not one.wrong_with(lambda x: sum(x))
    chance = itertools.cycle((0.94, 1.06))  # right every time, as far as one can tell
    assert not plus_one(tolerance=0.1).wrong_with(lambda x: (x + 1) * next(chance))


def test_what_an_answer_prints_is_shown_of_the_case_that_failed(capsys):
    def noisy(x):
        print(x, "\n" * 99)
        return x + (x != 1000.25)

    with pytest.raises(checks.CheckFailed, match="gives 1000, expected 1001"):
        plus_one()(noisy)
    said = capsys.readouterr().out
    assert said.startswith("1000.25") and said.count("\n") == 20
    plus_one()(lambda x: print(x) or x + 1)
    assert capsys.readouterr().out == "Exercise 9.9: right.\n"


def test_what_is_not_written_or_interrupted():
    def rate(snr_db):
        raise NotImplementedError("exercise 1.1")

    class StdinNotImplementedError(NotImplementedError):
        """What `input()` raises where nobody can answer."""

    def asks(snr_db):
        raise StdinNotImplementedError("raw_input was called")

    def endless(snr_db):  # as Jupyter's stop button and nbgrader's time limit end it
        while True:
            raise KeyboardInterrupt

    for answer, told in {
        None: "Exercise 1.1 has no answer yet",
        ...: "Exercise 1.1 has no answer yet",
        rate: "Exercise 1.1 is not written yet",
        asks: "stops with StdinNotImplementedError",
        endless: r"Interrupted, in line \d+, `raise KeyboardInterrupt`",
        1.5: "without brackets",
        Exercise: "without brackets",
    }.items():
        with pytest.raises(checks.CheckFailed, match=told):
            checks.rate_from_snr(answer)


class Nasty:
    """A value that refuses to be looked at."""

    def __repr__(self):
        raise RuntimeError("no repr")

    __array__ = __bool__ = __len__ = __eq__ = __iter__ = __float__ = __repr__
    __hash__ = object.__hash__


recursive = [1.0]
recursive.append(recursive)
VALUES = [
    *(0, 1.5, True, "text", b"bytes", "", float("nan"), float("inf"), 10**400, 1j),
    *([], [[1.0, 2.0], [3.0]], (None, None), {1: 2}, set(), Nasty(), int),
    *(np.zeros(0), np.array("text"), np.array([None, 1]), np.datetime64("2020-01-01")),
    *(torch.tensor([1.0], requires_grad=True), torch.zeros(2, 0), itertools.count(), print),
    *((i for i in range(3)), range(3), recursive, ("a", "b"), ((1, 2), True), [torch.zeros(1)] * 2),
]


@pytest.mark.parametrize("name", checks.EXERCISES)
def test_whatever_is_handed_in_or_given_back_ends_in_a_sentence(name):
    """What is asked in no way of its own is compared as all others are: a part of them will do."""
    one, own = checks.EXERCISES[name], checks.EXERCISES[name].ask.__name__ != "<lambda>"
    answers = [*VALUES, *(lambda *_, value=v: value for v in (VALUES if own else VALUES[::7]))]
    for answer in answers if name in FUNCTIONS else VALUES:
        assert 10 < len(one.wrong_with(answer)) < 1500


def test_values_are_compared_as_what_they_are():
    assert not difference(np.float32(0.100005), 0.1) and difference(0.100005, 0.1)
    assert not difference([1, 2.0], (1.0, 2.0))
    assert not difference(torch.tensor([1.0]), np.array([1.0])) and not difference(1, True)
    assert difference(4.5, 4) and not difference(4.0, 4) and difference([1.0], 1.0)
    assert difference([1.0], np.ones(1)) and difference(np.ones(1), np.ones(1, bool))
    assert "at [12]" in difference(np.arange(13), np.minimum(np.arange(13), 11))


def test_the_lines_of_pytorch_that_are_taught_run_and_have_the_shapes_they_say():
    text = next((ROOT / "notebooks" / "scripts").glob("05_*.py")).read_text(encoding="utf-8")
    table = text[text.index("# ### PyTorch") : text.index("# Mind the shapes")]
    lines = re.findall(r"\| `(.+)` \|$", table, re.M)
    space: dict = {"torch": torch, "nn": torch.nn, "copy": copy}
    results = [exec(line, space) or space for line in lines[:3]]
    taken, largest = eval(lines[3].split("; ")[1], space | {"a": torch.zeros(5).long()}), lines[4]
    assert results and space["q"].shape == (5, 4) and taken.shape == (5,)
    assert [one.shape for one in eval(largest, space)] == [(5,), (5,)]
    assert eval(lines[5], space).shape == (5, 1)
    exec(lines[6] + "\n" + lines[7], space)
    assert len(lines) == 8 and not space["y"].requires_grad


def test_the_notebooks_have_every_exercise_in_order():
    for script in SCRIPTS:
        text = script.read_text().replace("\n# ", "\n")
        number = str(int(script.name[:2]))
        own = {n: e for n, e in checks.EXERCISES.items() if e.number.split(".")[0] == number}
        assert 1 <= len(own) <= 6
        places = [
            place
            for name, one in own.items()
            for place in (text.find(f"## {one.heading}\n"), text.find(f"\nchecks.{name}("))
        ]
        assert places == sorted(places) and places[0] > 0, (
            f"{script.name}: a heading or check differs"
        )
        assert text.count("<details><summary>Hint") >= len(own)
    assert len(SCRIPTS) == 14


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_no_import_takes_the_name_of_an_answer(script):
    """Finding: after 1.3, check 1.1 was handed the library's `rate`."""
    text = code_of(script)
    nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import | ast.ImportFrom)]
    imported = {alias.asname or alias.name for node in nodes for alias in node.names}
    answers = set(re.findall(r"^checks\.\w+\((\w+)\)$", text, re.M))
    assert answers and not answers & imported


def test_the_validations_to_diagnose_are_recorded_ones():
    table = read_table(ROOT / "data/runs/pilots-manhattan.csv.gz")
    for name, shares in RUNS.items():
        variant, seed, thousands = name.rsplit("-", 2)
        row = (table["variant"] == variant) & (table["seed"] == int(seed))
        row &= table["steps"] == 1000 * int(thousands)
        columns = ("landed", "collected", "time_used")
        assert list(shares) == [round(float(table[c][row].item()), 3) for c in columns]


def test_the_rewards_by_hand_are_made_of_the_library_s_prices():
    prices = Rewards()
    flight_a, flight_b = checks.rewards_by_hand.solution()
    assert flight_a[0] == prices.movement
    assert flight_b[2] == pytest.approx(prices.movement + prices.safety + prices.crash)


def test_a_heading_has_a_form_and_two_exercises_cannot_share_a_name_or_a_number(monkeypatch):
    with pytest.raises(ValueError, match="2 points, 10 minutes"):
        Exercise("1.9 · No points", print)
    monkeypatch.setattr(module, "EXERCISES", dict(checks.EXERCISES))

    def rate_from_snr():
        """Another one of that name."""

    for solution, heading in ((rate_from_snr, "9.9"), (print, "1.1")):
        with pytest.raises(ValueError, match=r"1\.1 is checks\.rate_from_snr: take another"):
            module.exercise(f"{heading} · Title (1 point, 1 minutes)")(solution)
    rate_from_snr.__module__, rate_from_snr.__name__ = "__main__", "loss"
    for title in ("Title", "Better title"):  # in a notebook, a cell is run again and again
        module.exercise(f"1.9 · {title} (1 point, 1 minutes)")(rate_from_snr)
    assert module.EXERCISES["loss"].title == "Better title"


CELLS = """# %% [markdown]
# ## 1.1 · Rate from SNR (1 point, 5 minutes)
# The task.

# %%
def rate(snr_db):
    ### BEGIN SOLUTION
    return 1
    ### END SOLUTION

# %%
checks.rate_from_snr(rate)
"""


@pytest.mark.parametrize(
    ("here", "there", "said"),
    [
        ("    ### BEGIN SOLUTION\n", "", r"checks.rate_from_snr\(rate\)'.*no cell with .*BEGIN"),
        ("Rate from SNR", "The rate", r"must be '## 1\.1 · Rate from SNR \(1 point, 5 minutes\)'"),
        ("checks.rate_from_snr", "checks.rate", "no page in .* has rate$"),
    ],
)
def test_a_forgotten_mark_or_another_heading_is_an_error_that_names_the_cell(here, there, said):
    good, bad = (jupytext.reads(text, "py:percent") for text in (CELLS, CELLS.replace(here, there)))
    assignments.mark_cells(good)
    assert [c.metadata.nbgrader.grade_id for c in good.cells if "nbgrader" in c.metadata] == [
        *("1-1", "check-1-1")
    ]
    with pytest.raises(ValueError, match=said):
        assignments.mark_cells(bad)


def test_right_answers_in_fewer_digits_pass_and_no_rule_explains_a_type():
    for name in ("convolve", "centre", "expected_target", "epsilon_greedy", "data_of_a_step"):
        one = checks.EXERCISES[name]
        coarse = lambda *case, one=one: np.asarray(one.solution(*case), np.float32)  # noqa: E731
        if name in ("expected_target", "epsilon_greedy"):
            coarse = lambda *case, one=one: one.solution(*case).float()  # noqa: E731
        assert not one.wrong_with(coarse), name
    for name, kind in {
        "convolve": lambda value: value.tolist(),
        "epsilon_greedy": lambda value: value.numpy(),
        "shadow_map": lambda value: value.astype(np.uint8),
        "tdma_slot": lambda value: (*value, 0),
        "old_share": lambda value: [value],
    }.items():
        one = checks.EXERCISES[name]
        said = one.wrong_with(lambda *case, one=one, kind=kind: kind(one.solution(*case)))
        assert re.search(r", but .* (is|are) expected\.$", said), said
