"""Quizzes in the notebooks: predict before you run; each wrong choice explains itself."""

import html
from dataclasses import dataclass

import ipywidgets

from uavdh_lite.errors import InputError
from uavdh_lite.labs.markup import status

RIGHT = "#1F6F3F"


@dataclass(frozen=True)
class Choice:
    """One answer, and what there is to say about it."""

    text: str
    why: str
    right: bool = False


@dataclass(frozen=True)
class Question:
    """A question with one right choice."""

    text: str
    choices: tuple[Choice, ...]

    def __post_init__(self):
        if sum(choice.right for choice in self.choices) != 1:
            raise InputError(f"question {self.text!r}: exactly one choice must be right")


class Quiz(ipywidgets.VBox):
    """A question of `quizzes.QUESTIONS` to click on.

    Where widgets do not run, as on a web page, it is a list with the answer folded away.
    """

    def __init__(self, name: str):
        from uavdh_lite.course.quizzes import QUESTIONS

        if name not in QUESTIONS:
            raise InputError(f"no question {name!r}: choose one of {', '.join(QUESTIONS)}")
        self.question = QUESTIONS[name]
        self.choices = ipywidgets.RadioButtons(
            options=[(choice.text, choice) for choice in self.question.choices],
            value=None,
            layout={"width": "auto"},
        )
        self.answer = ipywidgets.HTML()
        self.choices.observe(self._explain, "value")
        text = ipywidgets.HTML(f"<b>{html.escape(self.question.text)}</b>")
        super().__init__([text, self.choices, self.answer])

    def _explain(self, change) -> None:
        choice = change["new"]
        word, colour = ("Right.", RIGHT) if choice.right else ("No.", "#C1272D")
        self.answer.value = status(f"{word} {choice.why}", colour)

    def _repr_mimebundle_(self, **options) -> dict:
        bundle = super()._repr_mimebundle_(**options)
        return {**bundle, "text/html": self.as_html()}

    def as_html(self) -> str:
        """The question for a page without widgets."""
        choices = "".join(f"<li>{html.escape(c.text)}</li>" for c in self.question.choices)
        answers = "".join(
            f"<li>{'<b>Right.</b>' if c.right else 'No.'} {html.escape(c.why)}</li>"
            for c in self.question.choices
        )
        kind = 'type="a"'
        return (
            f"<p><b>{html.escape(self.question.text)}</b></p><ol {kind}>{choices}</ol>"
            f"<details><summary>Answer</summary><ol {kind}>{answers}</ol></details>"
        )
