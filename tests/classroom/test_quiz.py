"""The quizzes: every choice explains itself, and every question is asked in a notebook."""

import re
from pathlib import Path

import pytest

from uavdh_lite.course.quiz import Choice, Question, Quiz
from uavdh_lite.course.quizzes import QUESTIONS
from uavdh_lite.errors import InputError

SCRIPTS = (Path(__file__).parents[2] / "notebooks" / "scripts").glob("*.py")
ASKED = {
    name: script.stem
    for script in SCRIPTS
    for name in re.findall(r'Quiz\("(\w+)"\)', script.read_text())
}


def test_every_question_is_asked_and_every_tutorial_asks_one():
    assert set(ASKED) == set(QUESTIONS)
    assert {stem[:2] for stem in ASKED.values()} == {f"{n:02d}" for n in range(10)}


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_choice_explains_itself(name):
    quiz = Quiz(name)
    assert quiz.choices.value is None and not quiz.answer.value
    said = set()
    for choice in quiz.question.choices:
        quiz.choices.value = choice
        assert ("Right." if choice.right else "No.") in quiz.answer.value
        said.add(quiz.answer.value)
    assert len(said) == len(quiz.question.choices) >= 2


def test_a_question_has_one_right_choice():
    with pytest.raises(InputError, match="exactly one choice must be right"):
        Question("Which?", (Choice("a", "no"), Choice("b", "no")))


def test_an_unknown_question():
    with pytest.raises(InputError, match="no question 'nothing': choose one of half_the_time"):
        Quiz("nothing")


def test_without_widgets_it_is_a_list_with_its_answer_folded_away():
    page = Quiz("frame_size")._repr_mimebundle_()["text/html"]
    before, after = page.split("<details>")
    assert "<li>31</li>" in before and "Right" not in before and "<b>Right.</b> From" in after


def test_text_is_escaped(monkeypatch):
    question = Question("a < b?", (Choice("<b>", "x < y", right=True),))
    monkeypatch.setitem(QUESTIONS, "escaped", question)
    quiz = Quiz("escaped")
    quiz.choices.value = question.choices[0]
    assert "x &lt; y" in quiz.answer.value and "a &lt; b?" in quiz.as_html()
