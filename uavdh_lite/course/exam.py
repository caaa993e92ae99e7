"""An exam that may be public: the questions of `exam.toml`, with numbers drawn by a seed."""

import html
import re
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from uavdh_lite.channel import Channel, rate
from uavdh_lite.course.checks import EXERCISES
from uavdh_lite.ddqn import ddqn_target, softmax_policy
from uavdh_lite.environment import Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.storage import write_atomically
from uavdh_lite.streams import Use, stream

FILE = Path(__file__).with_name("exam.toml")
LIBRARY = {  # what computes an answer
    **{"np": np, "torch": torch, "channel": Channel(), "rate": rate, "prices": Rewards()},
    **{"ddqn_target": ddqn_target, "softmax_policy": softmax_policy},
    "solved": {name: one.solution for name, one in EXERCISES.items()},
}
STYLE = "body{font:11pt/1.45 serif;max-width:42rem;margin:2rem auto}li{margin:0 0 1.4em}"


@dataclass(frozen=True)
class Question:
    """A question with its numbers: of which notebook, what is asked, the answer with its points."""

    notebook: int
    ask: str
    key: str

    @property
    def points(self) -> int:
        """The sum of those in the key, such as [2]."""
        return sum(map(int, re.findall(r"\[(\d)\]", self.key)))


def questions() -> list[dict]:
    """All questions without their numbers, as they stand in `exam.toml`."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))["questions"]


def with_numbers(question: dict, generator: np.random.Generator) -> Question:
    """A question with numbers of a generator; what follows from them is computed."""
    drawn = question["draw"]
    values = {name: few[generator.integers(len(few))] for name, few in drawn.items()}
    for name, code in question.get("let", {}).items():
        values[name] = eval(code, LIBRARY, values)  # noqa: S307 (from the package)
    fill = {"prices": LIBRARY["prices"], **values}
    ask, key = (
        re.sub(r"(?<=\d)%", " %", re.sub(r"(?<!\w)-(?=[\d.])", "−", question[part].format(**fill)))
        for part in ("ask", "key")
    )
    return Question(question["notebook"], ask, key)


def draw_exam(seed: int, count: int = 12) -> list[Question]:
    """Questions of a seed, as many of one notebook as of another, in the order of the notebooks.

    Raises `InputError` if there are not so many.
    """
    every = questions()
    if not 1 <= count <= len(every):
        raise InputError(f"{count} questions: there are {len(every)}, and one must be asked")
    generator = stream(Use.EXERCISE, seed)
    turns: dict[int, list[int]] = {}
    for place in generator.permutation(len(every)).tolist():
        turns.setdefault(every[place]["notebook"], []).append(place)
    first = [place for turn in zip(*turns.values(), strict=True) for place in turn]
    return [with_numbers(every[place], generator) for place in sorted(first[:count])]


def write_exam(folder: Path, seed: int, count: int = 12) -> list[Path]:
    """Write the sheet and the key as pages to print; raises `InputError` as `draw_exam` does."""
    asked = draw_exam(seed, count)
    total, pages = sum(one.points for one in asked), {"sheet": "", "key": ""}
    for one in asked:
        tag = f" <small>({one.points} points, notebook {one.notebook})</small>"
        ask, key = (re.sub(r"\*(.+?)\*", r"<i>\1</i>", html.escape(t)) for t in (one.ask, one.key))
        pages["sheet"] += f"<li>{ask}{tag}</li>"
        pages["key"] += f"<li>{ask}{tag}<br><b>{key}</b></li>"
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, items in pages.items():
        title = f"Exam {seed}, {name}: {count} questions, {total} points, {1.5 * total:.0f} minutes"
        page = f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{STYLE}</style>"
        page += f"<h1>{title}</h1><p>A pocket calculator is allowed.<ol>{items}</ol>"
        path = folder / f"exam-{seed}-{count}-{name}.html"
        write_atomically(path, partial(Path.write_text, data=page, encoding="utf-8"))
        written.append(path)
    return written
