"""The quizzes: every choice explains itself, and every question is asked in a notebook."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from uavdh_lite.course.quiz import Quiz, questions
from uavdh_lite.errors import InputError

SCRIPTS = (Path(__file__).parents[2] / "notebooks" / "scripts").glob("*.py")
ASKED = {
    name: script.stem
    for script in SCRIPTS
    for name in re.findall(r'Quiz\("(\w+)"\)', script.read_text())
}


def test_every_question_is_asked_and_every_notebook_of_the_course_asks_one():
    assert set(ASKED) == set(questions())
    assert {stem[:2] for stem in ASKED.values()} >= {f"{n:02d}" for n in range(9)}


@pytest.mark.parametrize("name", questions())
def test_every_choice_explains_itself(name):
    quiz = Quiz(name)
    assert quiz.choices.value is None and not quiz.answer.value
    said = set()
    for choice in quiz.question["choices"]:
        quiz.choices.value = choice
        assert ("Right." if choice.get("right") else "No.") in quiz.answer.value
        said.add(quiz.answer.value)
    assert len(said) == len(quiz.question["choices"]) >= 2
    assert sum(choice.get("right", False) for choice in quiz.question["choices"]) == 1
    assert all(choice["text"] and choice["why"] for choice in quiz.question["choices"])


def test_a_quiz_needs_no_more_than_ipywidgets():
    code = "import sys; from uavdh_lite.course.quiz import Quiz; Quiz('frame_size'); "
    code += "print([name for name in sys.modules if name.startswith('uavdh_lite.labs')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    with pytest.raises(InputError, match="no question 'nothing': choose one of half_the_time"):
        Quiz("nothing")


def test_without_widgets_it_is_a_list_with_its_answer_folded_away_and_text_is_escaped(monkeypatch):
    page = Quiz("frame_size")._repr_mimebundle_()["text/html"]
    before, after = page.split("<details>")
    assert "<li>31</li>" in before and "Right" not in before and "<b>Right.</b> From" in after
    question = {"question": "a < b?", "choices": [{"text": "<b>", "why": "x < y", "right": True}]}
    monkeypatch.setitem(questions(), "escaped", question)
    quiz = Quiz("escaped")
    quiz.choices.value = question["choices"][0]
    assert "x &lt; y" in quiz.answer.value and "a &lt; b?" in quiz.as_html()
