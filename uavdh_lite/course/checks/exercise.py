"""What all exercises share: an answer is asked all cases, compared, and told what is wrong."""

import copy
import io
import re
import sys
import traceback
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from uavdh_lite.course.checks.values import difference, show, unchanged
from uavdh_lite.course.given import Unfit

EXERCISES: dict[str, "Exercise"] = {}
"""All exercises by the name of their check, in the order of the notebooks."""

LIBRARY = tuple(str(place) for place in (Path(__file__).parents[2], sys.prefix, sys.base_prefix))
KINDS = {Callable: "function, without brackets", type: "class", str: "string"}  # that are taken
MOST_LINES = 20  # of what an answer prints
KIND = r", but .* (is|are) expected$"  # what is said of a value of another kind


class CheckFailed(AssertionError):
    """An answer is not right yet; the message says what is probably wrong with it."""

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
        also: what is wrong with an answer that gives the right values, or "".
        case: makes the arguments of what stands in the rules.
        ask: how an answer is asked, if it is not called with the arguments.
        call: what a message calls a case, if not the function with its arguments.
        takes: what an answer has to be.
        secret: whether messages keep the right value back.
        tolerance: relative difference that is none.
    """

    heading: str
    solution: Callable
    rules: dict[str, list] = field(default_factory=dict)
    mistakes: dict[str, Callable] = field(default_factory=dict)
    also: Callable[..., str] = lambda answer: ""
    case: Callable[..., tuple] = lambda *row: row
    ask: Callable = lambda answer, *case: answer(*case)
    call: Callable[..., str] | None = None
    takes: type = Callable  # type: ignore[assignment]
    secret: bool = False
    tolerance: float = 1e-6

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

    def wrong_with(self, answer) -> str:
        """What is to be said of an answer; "" if it is right."""
        self.printed = io.StringIO()  # by an answer with cases; one that trains may print at once
        if answer is None or answer is ...:
            return f"Exercise {self.number} has no answer yet."
        if not isinstance(answer, self.takes) or isinstance(answer, type) != (self.takes is type):
            kind = KINDS.get(self.takes, self.takes.__name__)
            return f"Hand over a {kind}. You handed over {show(answer)}."
        home = str(getattr(answer, "__module__", ""))
        if answer is self.solution or (home.startswith("uavdh_lite.") and "checks" not in home):
            return f"That is the library's own, from {home}. Write it yourself."
        try:
            with redirect_stdout(self.printed) if self.rules else nullcontext():
                return self._wrong_case(answer) or self.also(answer)
        except Unfit as failed:
            return str(failed)
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
        return [self.ask(self.solution, *case) for _, case in self.cases()]

    def _wrong_case(self, answer) -> str:
        """The mistake that an answer makes, or the rule whose case fails first."""
        cases, right = self.cases(), self._right
        given = [self._asked(answer, case) for _, case in cases]
        told = list(map(self._told, given, right))
        for k in reversed(range(len(cases))):  # once more, in another order
            if self._told(self._asked(answer, cases[k][1]), right[k]) != told[k]:
                said = f"{self._called(answer, cases[k][1])} does not always give the same"
                return f"{said}. A result must not depend on earlier calls or on chance of its own."
        if not any(told):
            return ""
        for sentence, mistake in self.mistakes.items():
            same = (self._outcome(mistake, copy.deepcopy(case)) for _, case in cases)
            if not any(map(self._told, given, same)):
                return sentence
        wrong = [k for k, said in enumerate(told) if said]
        own = [k for k in wrong if cases[k][0] == cases[wrong[0]][0]]  # of the same rule
        # The smallest case; one that gives a value says more than one that stops
        k = min(own, key=lambda k: (isinstance(given[k], BaseException), len(repr(cases[k][1]))))
        self._asked(answer, cases[k][1])  # what it prints in this case is shown
        said = re.sub(", expected .*", ", which is not right", told[k]) if self.secret else told[k]
        said = f"{self._called(answer, cases[k][1])} {said}."
        early = TypeError | RuntimeError if cases[k][0] == cases[0][0] else NameError
        if isinstance(given[k], NameError | early) or re.search(KIND, told[k]):
            return said  # a slip, or a value of another kind, which no rule explains
        if given[k] is None and not any(value is None for value in right):
            return f"{said} Is there a `return` in every branch?"
        return f"{said} {cases[k][0]}"

    def _asked(self, answer, case: tuple):
        """What an answer gives in a case, or the error that it raises; it must change nothing."""
        own = copy.deepcopy(case)
        self.printed.seek(0)
        self.printed.truncate()
        result = self._outcome(answer, own)
        if not unchanged(own, case):
            said = "changes what it is given. Work on a copy: `x = x + 1`, not `x += 1`"
            raise Unfit(f"{self._called(answer, case)} {said} or `x.sort()`.")
        return result

    def _outcome(self, answer, case: tuple):
        try:
            return self.ask(answer, *case)
        except (Unfit, NotImplementedError):
            raise
        except (Exception, SystemExit) as error:
            return error

    def _told(self, given, right) -> str:
        """What is said of an outcome, next to the right one or to that of a mistake."""
        if isinstance(given, BaseException):
            return _stops(given)
        try:
            return difference(given, right, self.tolerance)
        except Exception:  # a value of the student's own that refuses to be looked at
            return f"returns {show(given)}, which cannot be compared"

    def _called(self, answer, case: tuple) -> str:
        if self.call:
            return self.call(*case)
        name = getattr(answer, "__name__", None)
        name = name if isinstance(name, str) and name.isidentifier() else "your function"
        return f"{name}({', '.join(show(argument, None) for argument in case)})"


def exercise(heading: str, **options) -> Callable[[Callable], Exercise]:
    """Make an exercise of its solution, whose name becomes that of the check; see `Exercise`.

    Raises `ValueError` if another exercise has this name or number.
    """

    def made(solution: Callable) -> Exercise:
        one = Exercise(heading, solution, **options)
        for name, other in EXERCISES.items():
            again = other.solution.__module__ == "__main__"  # a cell that is run once more
            if not again and (name == solution.__name__ or other.number == one.number):
                found = f"{other.number} is checks.{name}: take another name and number"
                raise ValueError(f"{heading!r}, checks.{solution.__name__}: {found}")
        EXERCISES[solution.__name__] = one
        return one

    return made


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
