"""Quizzes in the notebooks: predict before you run. Every choice explains itself."""

import html
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from uavdh_lite.errors import InputError, extra
from uavdh_lite.plotting import RED

with extra("notebooks"):
    import ipywidgets

FILE = Path(__file__).with_name("quizzes.toml")
RIGHT = "#1F6F3F"


@dataclass(frozen=True)
class Choice:
    """One answer, and why it is right or wrong."""

    text: str
    why: str
    right: bool = False


@dataclass(frozen=True)
class Question:
    """A question and its choices, one of which is right."""

    text: str
    choices: tuple[Choice, ...]


@cache
def questions() -> dict[str, Question]:
    """The questions of all quizzes in `quizzes.toml`, by name."""
    return {
        name: Question(entry["question"], tuple(Choice(**choice) for choice in entry["choices"]))
        for name, entry in tomllib.loads(FILE.read_text(encoding="utf-8")).items()
    }


class Quiz(ipywidgets.VBox):
    """A question to click on, one of `questions()`.

    Where widgets do not run, as on a web page, it is a list with the answer folded away.
    """

    def __init__(self, name: str):
        known = questions()
        if name not in known:
            raise InputError(f"no question {name!r}: choose one of {', '.join(known)}")
        self.question = known[name]
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
        word, colour = ("Right.", RIGHT) if choice.right else ("No.", RED)
        style = f"color:color-mix(in srgb, {colour} 65%, currentColor)"  # for dark pages, too
        said = html.escape(f"{word} {choice.why}")
        self.answer.value = f'<span role="status" style="{style}">{said}</span>'

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
        return (
            f'<p><b>{html.escape(self.question.text)}</b></p><ol type="a">{choices}</ol>'
            f'<details><summary>Answer</summary><ol type="a">{answers}</ol></details>'
        )
