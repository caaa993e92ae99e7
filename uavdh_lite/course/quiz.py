"""Quizzes in the notebooks: predict before you run. Every choice explains itself."""

import html
import tomllib
from functools import cache
from pathlib import Path

from uavdh_lite.errors import InputError, extra
from uavdh_lite.plotting import RED

with extra("notebooks"):
    import ipywidgets

FILE = Path(__file__).with_name("quizzes.toml")
RIGHT = "#1F6F3F"


@cache
def questions() -> dict[str, dict]:
    """The questions of all quizzes by name, as they stand in `quizzes.toml`."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


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
            options=[(choice["text"], choice) for choice in self.question["choices"]],
            value=None,
            layout={"width": "auto"},
        )
        self.answer = ipywidgets.HTML()
        self.choices.observe(self._explain, "value")
        text = ipywidgets.HTML(f"<b>{html.escape(self.question['question'])}</b>")
        super().__init__([text, self.choices, self.answer])

    def _explain(self, change) -> None:
        choice = change["new"]
        word, colour = ("Right.", RIGHT) if choice.get("right") else ("No.", RED)
        style = f"color:color-mix(in srgb, {colour} 65%, currentColor)"  # for dark pages, too
        said = html.escape(f"{word} {choice['why']}")
        self.answer.value = f'<span role="status" style="{style}">{said}</span>'

    def _repr_mimebundle_(self, **options) -> dict:
        bundle = super()._repr_mimebundle_(**options)
        return {**bundle, "text/html": self.as_html()}

    def as_html(self) -> str:
        """The question for a page without widgets."""
        asked, choices = self.question["question"], self.question["choices"]
        listed = "".join(f"<li>{html.escape(choice['text'])}</li>" for choice in choices)
        answers = "".join(
            f"<li>{'<b>Right.</b>' if c.get('right') else 'No.'} {html.escape(c['why'])}</li>"
            for c in choices
        )
        return (
            f'<p><b>{html.escape(asked)}</b></p><ol type="a">{listed}</ol>'
            f'<details><summary>Answer</summary><ol type="a">{answers}</ol></details>'
        )
