"""What all exercises share: hints, and checks whose messages say what is probably wrong."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uavdh_lite.plotting import png

EXERCISES: dict[str, "Exercise"] = {}
"""All exercises by the name of their check, in the order of the notebooks."""


class CheckFailed(AssertionError):
    """An answer is not right yet; the message says what is probably wrong with it."""

    def _render_traceback_(self) -> list[str]:
        """What a notebook shows of it: the message alone, not the check's own code."""
        return [f"Not yet. {self}"]


@dataclass(eq=False)
class Exercise:
    """One exercise: call it with the answer to check it; `hint()` gives up to three hints.

    Arguments:
        number: `tutorial.exercise`, such as "1.2".
        minutes: that a student is expected to need.
        words: two hints in words, from vague to nearly there.
        figure: draws what the solution produces on an Axes; the third hint.
    """

    number: str
    title: str
    points: int
    minutes: int
    words: tuple[str, str]
    figure: Callable[[Axes], Any]
    check: Callable[[Any], None]
    given: list[int] = field(default_factory=list)  # hints asked for so far

    @property
    def heading(self) -> str:
        """The heading of the exercise in its notebook."""
        points = "1 point" if self.points == 1 else f"{self.points} points"
        return f"## {self.number} · {self.title} ({points}, {self.minutes} minutes)"

    def __call__(self, answer) -> None:
        """Check an answer; raises `CheckFailed` with what is probably wrong with it."""
        if callable(answer) and not isinstance(answer, type):
            answer = guarded(answer)
        if answer is None or answer is ...:
            raise CheckFailed(f"Exercise {self.number} has no answer yet.")
        self.check(answer)
        print(f"Exercise {self.number}: right.")

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
        self.figure(figure.subplots())
        return png(figure, dpi=90)


def exercise(number: str, title: str, *, points: int, minutes: int, hints, figure):
    """Make an exercise of a check: a function that takes the answer and raises `CheckFailed`."""

    def register(check: Callable[[Any], None]) -> Exercise:
        one = Exercise(number, title, points, minutes, tuple(hints), figure, check)
        functools.update_wrapper(one, check, updated=())
        EXERCISES[check.__name__] = one
        return one

    return register


def expect(holds, message: str) -> None:
    """Raise `CheckFailed` with the message unless it holds."""
    if not holds:
        raise CheckFailed(message)


def close(answer, expected, tolerance: float = 1e-4) -> bool:
    """Whether an answer has the expected shape and values, up to a relative tolerance."""
    try:
        answer = np.asarray(answer, float)
    except (TypeError, ValueError):
        return False
    expected = np.asarray(expected, float)
    same = answer.shape == expected.shape
    return bool(same and np.allclose(answer, expected, tolerance, tolerance * 1e-2, equal_nan=True))


def compare(
    answer: Callable,
    solution: Callable,
    cases: list[tuple],
    mistakes: dict[str, Callable],
    tolerance: float = 1e-4,
) -> None:
    """Compare a function with the solution on all cases; name the mistake if it is a known one.

    Arguments:
        cases: tuples of arguments.
        mistakes: by what to say about it, a function that makes the mistake. The first one that
            gives what the answer gives, wherever the answer is wrong, is named.
        tolerance: relative.
    """
    given = [answer(*case) for case in cases]
    wrong = [k for k, case in enumerate(cases) if not close(given[k], solution(*case), tolerance)]
    if not wrong:
        return
    for message, mistake in mistakes.items():
        if all(close(given[k], mistake(*cases[k]), tolerance) for k in wrong):
            raise CheckFailed(message)
    case, value = cases[wrong[0]], given[wrong[0]]
    expected, name = solution(*case), getattr(answer, "__name__", "your function")
    shapes = np.shape(value), np.shape(expected)
    call = f"{name}({', '.join(map(show, case))})"
    if shapes[0] != shapes[1]:
        raise CheckFailed(f"{call} has the shape {shapes[0]}, expected {shapes[1]}.")
    raise CheckFailed(f"{call} gives {show(value)}, expected {show(expected)}.")


@contextmanager
def replaced(owner: type, name: str, value) -> Iterator[None]:
    """Another value for a class's attribute, such as one that refuses, while an answer runs."""
    kept = vars(owner)[name]
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, kept)


def show(value) -> str:
    """A value in a message: numbers to four digits, large arrays by their shape."""
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, np.ndarray) and value.size > 12:
        return f"<array of shape {value.shape}>"
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=4, separator=", ").replace("\n", "")
    return repr(value)


def guarded(answer: Callable) -> Callable:
    """The student's function, with its errors and a forgotten `return` turned into messages.

    A check that is given one function gets it like this; one that takes several apart does it.
    """

    @functools.wraps(answer)
    def call(*arguments, **keywords):
        name = getattr(answer, "__name__", "your function")
        try:
            result = answer(*arguments, **keywords)
        except NotImplementedError:
            raise CheckFailed(f"{name} is not written yet.") from None
        except CheckFailed:
            raise
        except Exception as error:
            given = ", ".join(map(show, arguments))
            raise CheckFailed(
                f"{name}({given}) stops with {type(error).__name__}: {error}"
            ) from error
        if result is None:
            raise CheckFailed(f"{name} gives back None: is there a `return` at its end?")
        return result

    return call
