"""A check as data: cases by the rule that they test, and what typical mistakes would give."""

import copy
import inspect
import textwrap
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from uavdh_lite.course.checks.trial import (
    CheckFailed,
    expect,
    guarded,
    name_of,
    stops_with,
)
from uavdh_lite.course.checks.values import (
    Unreadable,
    called,
    differing,
    first_difference,
    numbers,
    show,
)

CHANGED = (
    "{call}: your function changes what it is given. That belongs to the caller: only read it, "
    "and make something new for the result."
)
ALONE = "The result must depend on the arguments alone, not on earlier calls or on chance."


@dataclass(frozen=True)
class Outcome:
    """What a call led to: a value, or why there is none."""

    value: np.ndarray | None
    problem: str = ""
    error: BaseException | None = None


@dataclass(frozen=True)
class Edit:
    """A mistake as a change of the solution's code, below the line of its `def`."""

    changes: tuple[tuple[str, str], ...]

    def of(self, solution: Callable) -> Callable:
        """The solution with this mistake in it."""
        source = "\n" + textwrap.dedent(inspect.getsource(solution))
        signature, code = source[source.index("\ndef ") + 1 :].split("\n", 1)  # no decorators
        for old, new in self.changes:
            if old not in code:
                raise ValueError(f"{solution.__name__} has no {old!r} to be changed")
            code = code.replace(old, new)
        names: dict[str, Callable] = {}
        exec(f"{signature}\n{code}", solution.__globals__, names)
        return names[solution.__name__]


def edit(*texts: str) -> Edit:
    """A mistake: what stands in the solution's code, and what stands there instead, in turns."""
    return Edit(tuple(zip(texts[::2], texts[1::2], strict=True)))


def by_rule(questions: dict[str, Callable[..., Any]], cases: Iterable[tuple]) -> dict[str, list]:
    """Cases under the last of the rules whose question is true of them."""
    rules: dict[str, list] = {rule: [] for rule in questions}
    for case in cases:
        rules[[rule for rule, asked in questions.items() if asked(*case)][-1]].append(case)
    return rules


@dataclass(eq=False)
class Table:
    """What a function must give back. Call the table with the function to check it.

    Arguments:
        solution: the right function.
        rules: the cases: arguments, a tuple if there are several, by the rule that they test, a
            sentence; from what is basic to what is special. Or a function that makes them.
        among: if there are many cases, these; then `rules` has questions, see `by_rule`.
        mistakes: by what to say of it, a function that makes the mistake, or the `edit` of the
            solution that does, or a tuple of these if there are several ways. It is named only if
            one agrees with the answer on every case.
        read: turns what the answer gives back into an array, or raises `Unreadable`.
        tolerance: relative. smallest: absolute.
        errors: what to say, besides the rule, if an answer stops with an error whose message has
            this text in it.
        shown: makes of an array that was read what a message shows.
        why: says of a case, and of a place in an array, what the expected value comes from.
        again: whether each case is asked twice.
        call: makes of a case what a message calls it, if not the function with its arguments.
        made: makes the arguments of what stands in the rules.
    """

    solution: Callable
    rules: dict[str, Any] | Callable[[], dict[str, list]]
    mistakes: dict[str, Callable | Edit | tuple] = field(default_factory=dict)
    read: Callable[[Any], np.ndarray] = numbers
    tolerance: float = 1e-6
    smallest: float = 1e-9
    errors: dict[str, str] = field(default_factory=dict)
    shown: Callable[[np.ndarray], Any] | None = None
    why: Callable[..., str] | None = None
    again: bool = True
    call: Callable[..., str] | None = None
    made: Callable[..., tuple] = lambda *case: case
    among: Iterable[tuple] | None = None

    @cached_property
    def cases(self) -> list[tuple[str, tuple]]:
        """All cases, each with its rule."""
        rules = self.rules() if callable(self.rules) else self.rules
        rules = by_rule(rules, self.among) if self.among else rules
        return [
            (rule, self.made(*case) if isinstance(case, tuple) else self.made(case))
            for rule, several in rules.items()
            for case in several
        ]

    @cached_property
    def right(self) -> list[Outcome]:
        """What the solution gives in each case."""
        return [self.outcome(self.solution, case) for _, case in self.cases]

    @cached_property
    def each_mistake(self) -> list[tuple[str, Callable]]:
        """What to say of each function that makes a mistake, and the function."""
        found = []
        for message, made in self.mistakes.items():
            for mistake in made if isinstance(made, tuple) else (made,):
                with suppress(OSError):  # installed without sources: rules only
                    edited = isinstance(mistake, Edit)
                    found.append((message, mistake.of(self.solution) if edited else mistake))
        return found

    def __call__(self, answer: Callable) -> None:
        """Check a function.

        Raises:
            CheckFailed: with the mistake, or with the smallest case that fails and its rule.
        """
        given = [self.ask(answer, k, k % 2 == 1) for k in range(len(self.cases))]
        wrong = [k for k, right in enumerate(self.right) if not self.same(given[k], right)]
        if not wrong:
            for k in reversed(range(len(given) if self.again else 0)):
                self._ask_again(answer, k, given[k])
            return
        order = [*wrong, *(k for k in range(len(given)) if k not in set(wrong))]
        for message, mistake in self.each_mistake:
            if all(self.same(given[k], self.outcome(mistake, self.cases[k][1])) for k in order):
                raise CheckFailed(message)
        own = [k for k in wrong if self.cases[k][0] == self.cases[wrong[0]][0]]
        k = min(own, key=lambda k: _extent(self.cases[k][1]))
        if self.again and not given[k].problem:
            self._ask_again(answer, k, given[k])
        raise CheckFailed(self._failure(self._called(answer, self.cases[k][1]), k, given[k]))

    def _ask_again(self, answer: Callable, k: int, given: Outcome) -> None:
        """Ask a case once more: it must give the same."""
        other = self.ask(answer, k, k % 2 == 0)
        if not self.same(other, given):
            said = other.problem or differing(other.value, given.value)
            said = said.replace("expected", "at first it gave")
            call = self._called(answer, self.cases[k][1])
            raise CheckFailed(f"{call}: asked again after other calls, it {said}. {ALONE}")

    def by_hand(self, place: str, given, case: tuple) -> None:
        """Check what was worked out by hand for a case; the message does not say what is right."""
        expect(given is not None and given is not ..., f"{place} has no number yet.")
        own = self.outcome(lambda *_: given, case)
        if self.same(own, self.outcome(self.solution, case)):
            return
        said = own.problem or f"{show(given)} is not right."
        mistakes = (text for text, f in self.each_mistake if self.same(own, self.outcome(f, case)))
        raise CheckFailed(f"{place}: {said} {next(mistakes, self.cases[0][0])}")

    def _called(self, answer: Callable, case: tuple) -> str:
        return self.call(*case) if self.call else called(name_of(answer), case)

    def _failure(self, call: str, k: int, given: Outcome) -> str:
        """What is said of the case that fails."""
        rule, case = self.cases[k]
        right = self.right[k].value
        if given.problem:
            known = [text for part, text in self.errors.items() if part in given.problem]
            return " ".join([f"{call} {given.problem}", *known, rule])
        if (
            given.value.shape != right.shape
            and "O" not in given.value.dtype.kind + right.dtype.kind
        ):
            asked = f"expected {right.shape}" if right.ndim else "one number is expected"
            return f"{call} has the shape {given.value.shape}, {asked}. {rule}"
        said = differing(given.value, right)
        if self.shown:
            gives, expected = (show(self.shown(value)) for value in (given.value, right))
            said = f"gives {gives}, expected {expected}"
        why = f" {self.why(*case, first_difference(given.value, right))}" if self.why else ""
        return f"{call} {said}. {rule}{why}"

    def ask(self, answer: Callable, k: int, read_only: bool) -> Outcome:
        """The outcome of a student's function, which must leave its arguments as they are."""
        rule, case = self.cases[k]
        given = tuple(_copied(argument, read_only) for argument in case)
        asked = guarded(answer, self.call(*case) if self.call else "", rule, none=True)
        outcome = self.outcome(asked, given, students=True)
        changed = any(not _equal(one, other) for one, other in zip(given, case, strict=True))
        read = isinstance(outcome.error, ValueError) and "read-only" in str(outcome.error)
        if changed or read:
            raise CheckFailed(CHANGED.format(call=self._called(answer, case)))
        return outcome

    def outcome(self, function: Callable, case: tuple, students: bool = False) -> Outcome:
        """What a function gives in a case."""
        try:
            value = function(*case)
        except CheckFailed as failed:
            if failed.__cause__ is None:
                raise
            return Outcome(None, stops_with(failed.__cause__), failed.__cause__)
        except Exception as error:
            return Outcome(None, stops_with(error), error)
        shared = isinstance(value, np.ndarray) and any(
            isinstance(argument, np.ndarray) and np.shares_memory(value, argument)
            for argument in case
        )
        expect(
            not (students and shared),
            "You return an array that you were given, or a view of it. What changes one of them "
            "later changes the other. Make a new array.",
        )
        try:
            return Outcome(self.read(value))
        except Unreadable as problem:
            if value is None:
                said = "gives back None: is a `return` missing, at the end or in one branch?"
                return Outcome(None, said)
            return Outcome(None, f"gives back {show(value)}; {problem}")

    def same(self, one: Outcome, other: Outcome) -> bool:
        """Whether two outcomes are the same value, or the same kind of failure."""
        if one.value is None or other.value is None:
            kinds = (type(one.error), one.value is None), (type(other.error), other.value is None)
            return kinds[0] == kinds[1] and (one.error is not None or one.problem == other.problem)
        kinds = one.value.dtype.kind + other.value.dtype.kind
        if one.value.shape != other.value.shape or not set(kinds) <= set("biuf"):
            return np.array_equal(one.value, other.value)
        return bool(
            np.allclose(one.value, other.value, self.tolerance, self.smallest, equal_nan=True)
        )


def _extent(case: tuple) -> tuple[int, int]:
    """How large a case is: arrays, tensors and cities by their size, then the text of the call."""
    sizes = [a.numel() if hasattr(a, "numel") else getattr(a, "size", 0) for a in case]
    return sum(sizes), len(called("", case))


def _copied(argument, read_only: bool):
    if isinstance(argument, np.ndarray):
        argument = argument.copy()
        argument.flags.writeable = not read_only
        return argument
    if hasattr(argument, "detach"):
        return argument.clone()
    if isinstance(argument, np.random.Generator):
        return copy.deepcopy(argument)
    if isinstance(argument, list):
        return [_copied(part, read_only) for part in argument]
    return argument


def _equal(one, other) -> bool:
    if isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=other.dtype.kind == "f")
    if hasattr(other, "detach"):
        return bool(one.shape == other.shape and ((one == other) | (one != one)).all())
    if isinstance(other, list):
        return len(one) == len(other) and all(map(_equal, one, other))
    return not isinstance(other, float | int | str) or one == other
