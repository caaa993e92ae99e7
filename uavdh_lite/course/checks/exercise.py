"""What all exercises share: an answer is asked all cases, compared, and told what is wrong."""

import io
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.course.checks.values import copied, difference, show, unchanged

EXERCISES: dict[str, "Exercise"] = {}
"""All exercises by the name of their check, in the order of the notebooks."""

LIBRARY = tuple(str(place) for place in (Path(__file__).parents[2], sys.prefix, sys.base_prefix))
KINDS = {Callable: "function, without brackets", type: "class", str: "string"}  # that are taken
MOST_LINES = 20  # of what an answer prints
CHANGED = "changes what it is given. Work on a copy: `x = x + 1`, not `x += 1` or `x.sort()`."


class CheckFailed(AssertionError):
    """An answer is not right yet; the message says what is probably wrong with it."""

    def __init__(self, text: str, seen: bool = True):
        super().__init__(text)
        self.seen = seen  # whether the line in which the answer was stopped says more

    def _render_traceback_(self) -> list[str]:
        """What a notebook shows of it: the message alone."""
        return [f"Not yet. {self}"]


@dataclass(eq=False, repr=False)
class Exercise:
    """One exercise: call it with an answer to check it.

    Arguments:
        heading: as in the notebook, "1.2 · Title (2 points, 10 minutes)".
        solution: the function that is right.
        rules: for each sentence the cases, tuples of arguments, that it explains; plain ones first.
        mistakes: for each sentence a function that makes this mistake; three at most.
        figure: draws what the solution does, for an answer that is right: `figure(ax, solution)`.
        also: what is wrong with an answer that gives the right values, or "".
        case: makes the arguments of what stands in the rules.
        ask: how an answer is asked, if it is not called with the arguments.
        call: what a message calls a case, if not the function with its arguments.
        takes: what an answer has to be.
        secret: whether messages keep the right value back.
        tolerance, smallest: relative and absolute difference that is none.
    """

    heading: str
    solution: Callable
    rules: dict[str, list] = field(default_factory=dict)
    mistakes: dict[str, Callable] = field(default_factory=dict)
    figure: Callable | None = None
    also: Callable[..., str] = lambda answer: ""
    case: Callable[..., tuple] = lambda *row: row
    ask: Callable = lambda answer, *case: answer(*case)
    call: Callable[..., str] | None = None
    takes: type = Callable  # type: ignore[assignment]
    secret: bool = False
    tolerance: float = 1e-6
    smallest: float = 1e-12

    def __post_init__(self):
        found = re.fullmatch(r"([\d.]+) · (.+) \((\d+) points?, (\d+) minutes\)", self.heading)
        if not found:
            raise ValueError(f'{self.heading!r} is not like "1.2 · Title (2 points, 10 minutes)"')
        self.number, self.title = found[1], found[2]
        self.points, self.minutes = int(found[3]), int(found[4])

    def __call__(self, answer) -> None:
        """Check an answer; raises `CheckFailed` with what is probably wrong with it."""
        if wrong := self.wrong_with(answer):
            if said := self.printed.getvalue():  # in the case that failed
                print("\n".join(said.splitlines()[:MOST_LINES])[: 100 * MOST_LINES])
            raise CheckFailed(wrong)
        print(f"Exercise {self.number}: right.")
        ipython = sys.modules.get("IPython")
        if self.figure and ipython and ipython.get_ipython():
            with suppress(KeyboardInterrupt):
                ipython.display.display(self.picture())

    def wrong_with(self, answer) -> str:
        """What is to be said of an answer; "" if it is right."""
        self.printed = io.StringIO()  # by an answer with cases; one that trains may print at once
        if answer is None or answer is ...:
            return f"Exercise {self.number} has no answer yet."
        if not isinstance(answer, self.takes) or isinstance(answer, type) != (self.takes is type):
            kind = KINDS.get(self.takes, self.takes.__name__)
            return f"Hand over a {kind}. You handed over {show(answer)}."
        home = str(getattr(answer, "__module__", ""))
        own = self.takes not in (Callable, type) or home.startswith("uavdh_lite.course.checks.")
        if home.startswith("uavdh_lite.") and (answer is self.solution or not own):
            return f"That is the library's own, from {home}. Write it yourself."
        try:
            with _settings_kept(), redirect_stdout(self.printed) if self.rules else nullcontext():
                return self._wrong_case(answer) or self.also(answer)
        except CheckFailed as failed:
            seen = _line(failed) * failed.seen
            return f"{failed}{seen.replace(', in', ' See', 1)}{'.' * bool(seen)}"
        except KeyboardInterrupt as stopped:
            return f"Interrupted{_line(stopped)}. Is there a loop that never ends?"
        except Exception as error:
            if f"exercise {self.number}" in str(error):  # PyTorch, too, has NotImplementedError
                return f"Exercise {self.number} is not written yet."
            return f"Your answer {_stops(error)}."

    def cases(self) -> list[tuple[str, tuple]]:
        """All cases, each with its rule."""
        rows = [(rule, row) for rule, several in self.rules.items() for row in several]
        return [(rule, self.case(*(row if type(row) is tuple else (row,)))) for rule, row in rows]

    @cached_property
    def _right(self) -> list:
        """What the solution gives in each case: of some exercises that takes a second."""
        with _settings_kept():
            torch.set_default_dtype(torch.float32)
            torch.set_grad_enabled(True)
            return [self.ask(self.solution, *case) for _, case in self.cases()]

    def _wrong_case(self, answer) -> str:
        """The mistake that an answer makes, or the rule whose case fails first."""
        cases = self.cases()
        given = [self._asked(answer, case) for _, case in cases]
        told = list(map(self._told, given, self._right))
        if not any(told):  # once more, in another order
            every = reversed(list(zip(cases, given, self._right, strict=True)))
            later = (self._later(answer, case, one, right) for (_, case), one, right in every)
            return next(filter(None, later), "")
        for sentence, mistake in self.mistakes.items():
            same = (self._asked(mistake, case, read_only=True) for _, case in cases)
            if not any(map(self._told, given, same)):
                return sentence
        wrong = [k for k, said in enumerate(told) if said]
        own = [k for k in wrong if cases[k][0] == cases[wrong[0]][0]]  # of the same rule
        # The smallest case; one that gives a value says more than one that stops
        k = min(own, key=lambda k: (isinstance(given[k], BaseException), len(repr(cases[k][1]))))
        if later := self._later(answer, cases[k][1], given[k], given[k]):
            return later
        if isinstance(given[k], np.ndarray) and sum(one is given[k] for one in given) > 1:
            said = f"{self._called(answer, cases[k][1])} returns the array of another call again"
            return f"{said}. A result must not depend on earlier calls."
        said = re.sub(", expected .*", ", which is not right", told[k]) if self.secret else told[k]
        said = f"{self._called(answer, cases[k][1])} {said}."
        early = TypeError if cases[k][0] == cases[0][0] else NameError
        if isinstance(given[k], NameError | early):
            return said  # a slip that no rule explains, unless it is a TypeError in a later rule
        if re.search(r", but .* (is|are) expected$", told[k]):
            return said  # nor does one explain that the value is of another kind
        if given[k] is None and not any(value is None for value in self._right):
            return f"{said} Is there a `return` in every branch?"
        return f"{said} {cases[k][0]}"

    def _later(self, answer, case: tuple, one, right) -> str:
        """What is wrong if an answer is not right once more, with read-only arrays."""
        again = self._asked(answer, case, read_only=True)
        if self._told(one, one) or not self._told(again, right):
            return ""
        said = f"{self._called(answer, case)} gives {show(one)}, and later {show(again)}."
        return f"{said} A result must not depend on earlier calls or on random numbers of your own."

    def _asked(self, answer, case: tuple, read_only: bool = False):
        """What an answer gives in a case, or the error that it raises; it must change nothing."""
        own = copied(case, read_only)
        if not any(answer is mistake for mistake in self.mistakes.values()):
            self.printed.seek(0)
            self.printed.truncate()
        try:
            with warnings.catch_warnings():
                if read_only:  # and not for the first time: what NumPy warns of is known
                    warnings.simplefilter("ignore")
                result = self.ask(answer, *own)
        except (CheckFailed, NotImplementedError):
            raise
        except (Exception, SystemExit) as error:
            result = error
        read = isinstance(result, ValueError) and "read-only" in str(result)
        if read or not unchanged(own, case):
            raise CheckFailed(f"{self._called(answer, case)} {CHANGED}")
        return result

    def _told(self, given, right) -> str:
        """What is said of an outcome, next to the right one or to that of a mistake."""
        if isinstance(given, BaseException):
            return _stops(given)
        try:
            return difference(given, right, self.tolerance, self.smallest)
        except Exception:  # a value of the student's own that refuses to be looked at
            return f"returns {show(given)}, which cannot be compared"

    def _called(self, answer, case: tuple) -> str:
        if self.call:
            return self.call(*case)
        name = getattr(answer, "__name__", None)
        name = name if isinstance(name, str) and name.isidentifier() else "your function"
        return f"{name}({', '.join(show(argument, None) for argument in case)})"

    def picture(self) -> Figure:
        """The figure of the solution."""
        figure = Figure(figsize=(5.5, 3.4), layout="constrained")
        ax = figure.subplots()
        self.figure(ax, self.solution)
        if ax.get_legend_handles_labels()[1]:
            ax.legend(fontsize="small")
        return figure


def exercise(heading: str, **options) -> Callable[[Callable], Exercise]:
    """Make an exercise of its solution, whose name becomes that of the check; see `Exercise`.

    Raises `ValueError` if another page has an exercise of that name or number.
    """

    def made(solution: Callable) -> Exercise:
        one = Exercise(heading, solution, **options)
        for name, other in EXERCISES.items():
            page = other.solution.__module__
            again = page == solution.__module__ == "__main__"  # a cell that is run once more
            if not again and (name == solution.__name__ or other.number == one.number):
                found = f"{page} has {other.number} as checks.{name}: take another name and number"
                raise ValueError(f"{heading!r}, checks.{solution.__name__}: {found}")
        EXERCISES[solution.__name__] = one
        return one

    return made


@contextmanager
def _settings_kept() -> Iterator[None]:
    """Afterwards PyTorch's default dtype and gradients are what they were."""
    dtype, gradients = torch.get_default_dtype(), torch.is_grad_enabled()
    try:
        yield
    finally:
        torch.set_default_dtype(dtype)
        torch.set_grad_enabled(gradients)


def _stops(error: BaseException) -> str:
    """What an error says, and in which line of the student's it happened."""
    text = " ".join(str(error).split())[:200].rstrip(".")
    return f"stops with {type(error).__name__}{': ' * bool(text)}{text}{_line(error)}"


def _line(error: BaseException) -> str:
    """The last line of the student's own code that the error went through."""
    if where := getattr(error, "where", ""):  # it was raised in another process
        return where
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.line and not f.filename.startswith(LIBRARY)]
    return f", in line {own[-1].lineno}, `{own[-1].line}`" if own else ""
