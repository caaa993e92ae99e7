"""The exam: forty questions with numbers of a seed, and answers that the library computes."""

import re
from collections import Counter

import pytest

from uavdh_lite.cli.main import main
from uavdh_lite.course.exam import draw_exam, questions, with_numbers, write_exam
from uavdh_lite.errors import InputError
from uavdh_lite.streams import Use, stream


def test_there_are_four_questions_for_each_notebook_and_any_numbers_fit():
    assert Counter(one["notebook"] for one in questions()) == dict.fromkeys(range(10), 4)
    for seed in range(20):
        for question in questions():
            one = with_numbers(question, stream(Use.EXERCISE, seed))
            assert 4 <= one.points <= 6 and not re.search(r"[{}]|nan|inf\b", one.ask + one.key)
            letters = [set(re.findall(r"\(([a-d])\)", text)) for text in (one.ask, one.key)]
            assert letters[0] <= letters[1]  # each part has an answer


def test_every_number_that_is_drawn_matters():
    for question in questions():
        texts = {with_numbers(question, stream(Use.EXERCISE, s)).ask for s in range(40)}
        assert len(texts) >= 2
        for name, few in question["draw"].items():
            used = question["ask"] + " ".join(question.get("let", {}).values())
            assert len(few) > 1 and re.search(rf"\b{name}\b", used), (question["ask"], name)


def fixed(part, **numbers):
    """The question with this in it, with these numbers."""
    (one,) = (question for question in questions() if part in question["ask"])
    return with_numbers(one | {"draw": {k: [v] for k, v in numbers.items()}}, stream(Use.EXERCISE))


def test_answers_are_those_worked_out_by_hand():
    target = fixed("double DQN", online=[5.0, 9, 7], target=[6.0, 4, 8], r=1, gamma=0.5).key
    assert "= 5 [2]. Double DQN" in target and "= 3 [2]" in target
    (double,) = (question for question in questions() if "double DQN" in question["ask"])
    for seed in range(20):  # the two targets differ, whatever is drawn
        key = with_numbers(double, stream(Use.EXERCISE, seed)).key
        assert len(set(re.findall(r"= (\S+) \[2\]", key))) == 2
    assert "= 371 m [1]" in fixed("through the air*, behind", d=40).key
    assert "= 2,416 [2]" in fixed("kernels of", kernels=16, k=5, layers=6, stride=2, size=16).key
    late = fixed("forgets the landing", d=5, spare=1)
    assert "6 units of time" in late.ask and "only a move towards home fits" in late.key
    assert "≤ 6 [2]" in late.key
    three = fixed("Student's factor", scores=[60.0, 66.0, 75.0])
    numbers = re.search(r"± (\S+) · (\S+) / √3 = \S+ ± (\S+)", three.key).groups()
    factor, deviation, half = map(float, numbers)
    assert f"{factor * deviation / 3**0.5:.1f}" == f"{half}" and f" {factor}. (a)" in three.ask


def test_sheet_and_key_are_written_and_another_seed_asks_something_else(tmp_path, capsys):
    assert main(["classroom", "exam", str(tmp_path), "--seed", "7"]) == 0
    sheet, key = (path.read_text() for path in write_exam(tmp_path, 7))
    assert capsys.readouterr().out.count("exam-7-12-") == 2
    assert not {*write_exam(tmp_path, 7)} & {*write_exam(tmp_path, 7, 40)}
    assert sheet.count("<li>") == key.count("<li>") == 12 and "[1]" in key and "[1]" not in sheet
    asked = draw_exam(7)
    assert asked == draw_exam(7) != draw_exam(8) and len({one.notebook for one in asked}) == 10
    assert f"{sum(one.points for one in asked)} points" in sheet
    with pytest.raises(InputError, match="there are 40"):
        draw_exam(7, 41)
