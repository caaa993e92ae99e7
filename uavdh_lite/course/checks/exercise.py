"""What all exercises share: a check, hints, and a notebook that survives whatever is handed in."""

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uavdh_lite.course.checks.table import Table
from uavdh_lite.course.checks.trial import (
    CheckFailed,
    Stopped,
    contained,
    expect,
    guarded,
    refused,
    stops_with,
    within,
)
from uavdh_lite.course.checks.values import close, show
from uavdh_lite.plotting import png

__all__ = [
    "EXERCISES",
    "CheckFailed",
    "Exercise",
    "close",
    "exercise",
    "expect",
    "guarded",
    "show",
    "solution",
]

EXERCISES: dict[str, "Exercise"] = {}
"""All exercises by the name of their check, in the order of the notebooks."""

SECONDS = 10.0
"""So long an answer may take, unless its exercise says otherwise."""


@dataclass(eq=False, repr=False)
class Exercise:
    """One exercise: call it with the answer to check it; `hint()` gives up to three hints.

    Arguments:
        number: `tutorial.exercise`, such as "1.2".
        minutes: that a student is expected to need.
        words: two hints in words, from vague to nearly there.
        figure: draws what the solution produces on an Axes; the third hint.
        check: takes the answer and raises `CheckFailed`.
        table: what an answer must give back, asked before the check.
        takes: if the answer is no function: what it must be, and what is said of another.
        seconds: how long the check may take; `SECONDS` if not given.
        refused: what an answer may not use, by class and name, with what to say.
    """

    number: str
    title: str
    points: int
    minutes: int
    words: tuple[str, ...]
    figure: Callable[[Axes], Any]
    check: Callable[[Any], None] | None
    table: Table | None = None
    takes: tuple[Callable[[Any], Any], str] | None = None
    seconds: float | None = None
    refused: dict[tuple[type, str], str] = field(default_factory=dict)
    given: list[int] = field(default_factory=list)  # hints asked for so far

    @property
    def heading(self) -> str:
        """The heading of the exercise in its notebook."""
        points = "1 point" if self.points == 1 else f"{self.points} points"
        return f"## {self.number} · {self.title} ({points}, {self.minutes} minutes)"

    @property
    def solved(self) -> Callable:
        """The solution of an exercise that is made of one."""
        assert self.table
        return self.table.solution

    def __repr__(self) -> str:  # a notebook shows neither hints nor mistakes
        return self.heading.removeprefix("## ")

    def __call__(self, answer) -> None:
        """Check an answer; raises `CheckFailed` with what is probably wrong with it."""
        if answer is None or answer is ...:
            raise CheckFailed(f"Exercise {self.number} has no answer yet.")
        with contained(), refused(self.refused):
            within(self.seconds or SECONDS, lambda: self._run(answer))
        print(f"Exercise {self.number}: right.")

    def _run(self, answer) -> None:
        fits, said = self.takes or (
            lambda one: callable(one) and not isinstance(one, type),
            "Hand over the function itself: its name, without brackets behind it. You hand over "
            "{given}.",
        )
        expect(fits(answer), said.format(given=show(answer)))
        try:
            if self.table:
                self.table(answer)
            if self.check:
                self.check(answer if self.takes else guarded(answer))
        except (CheckFailed, Stopped):
            raise
        except BaseException as error:  # also what an answer raises where it is only looked at
            raise CheckFailed(
                f"The check cannot make sense of this answer: it {stops_with(error)} Does yours "
                "give back what the exercise asks for?"
            ) from error

    def hint(self, number: int | None = None) -> None:
        """Show the next hint, or the one of this number: 1 and 2 in words, 3 as a figure."""
        if number is None:
            number = min(len(self.given) + 1, 3)
        if number not in (1, 2, 3):
            raise ValueError(f"hint {number}: there are 1, 2 and 3")
        if number not in self.given:
            self.given.append(number)
        if number < 3:
            print(f"Hint {number} of 3: {self.words[number - 1]}")
            return
        from IPython.display import Image, display

        print("Hint 3 of 3: what the solution gives.")
        display(Image(self.picture()))

    def picture(self) -> bytes:
        """The third hint, as a PNG file's bytes."""
        figure = Figure(figsize=(5.5, 3.4), layout="constrained")
        ax = figure.subplots()
        self.figure(ax)
        if ax.lines and not ax.patches and ax.get_aspect() == "auto":  # no map, no bars
            ax.grid(alpha=0.3)
        if ax.get_legend_handles_labels()[1] and not ax.get_legend():
            ax.legend(fontsize="small")
        return png(figure, dpi=90)


def exercise(heading: str, *hints: str, figure: Callable[[Axes], Any], **options):
    """Make an exercise of a check: a function that takes the answer and raises `CheckFailed`.

    Arguments:
        heading: as in the notebook, "1.2 · Title (2 points, 10 minutes)".
        hints: two in words.
        figure: the third hint.
        options: `takes`, `seconds` and `refused` of `Exercise`.
    """

    def register(check: Callable[[Any], None]) -> Exercise:
        return _registered(check, heading, hints, figure, check, **options)

    return register


def solution(
    heading: str,
    *hints: str,
    figure: Callable[[Axes, Callable], Any],
    also: Callable[[Callable], None] | None = None,
    **options,
):
    """Make an exercise of its solution: an answer must give the same as this function.

    Arguments:
        figure: the third hint, drawn on an Axes with the solution.
        also: a property that no single call shows; a check of an answer that gives the same.
        options: `rules`, `mistakes` and others of `Table`; `seconds` and `refused` of `Exercise`.
    """
    own = {name: options.pop(name) for name in ("seconds", "refused") if name in options}

    def register(solved: Callable) -> Exercise:
        drawn, table = functools.partial(figure, solved=solved), Table(solved, **options)
        return _registered(solved, heading, hints, drawn, also, table=table, **own)

    return register


def _registered(named: Callable, heading: str, hints, figure, check, **options) -> Exercise:
    """An exercise with the name and the words of a function, among all others."""
    found = re.fullmatch(r"([\d.]+) · (.+) \((\d+) points?, (\d+) minutes\)", heading)
    if not found:
        raise ValueError(f'{heading!r} is not like "1.2 · Title (2 points, 10 minutes)"')
    number, title, points, minutes = found.groups()
    made = Exercise(number, title, int(points), int(minutes), hints, figure, check, **options)
    functools.update_wrapper(made, named, updated=())
    EXERCISES[named.__name__] = made
    return made
