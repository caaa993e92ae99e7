"""What an answer gives back: read whatever it is, compared, and shown in a message.

A reader makes an array of what it is for, and raises `Unreadable` for anything else.
"""

from collections.abc import Callable, Iterable
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

Reader = Callable[[Any], np.ndarray]


class Unreadable(ValueError):
    """An answer gives back something else than it should; the message says what it should."""


def numbers(value, depth: int = 5) -> np.ndarray:
    """Numbers of any shape, as an array of floats: lists, arrays, tensors, fractions, Booleans.

    Arguments:
        depth: so many lists may be inside each other.

    Raises:
        Unreadable: for text, None, complex numbers, rows of different lengths and the like.
    """
    if isinstance(value, Real | Decimal) and not isinstance(value, np.generic):
        try:
            return np.asarray(float(value))
        except OverflowError:
            return np.asarray(np.inf if value > 0 else -np.inf)
    try:
        array = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
        if array.dtype.kind in "biuf":
            return array.astype(float)
    except Exception:  # rows of different lengths, tensors in a list
        array = None
    if depth and (type(value) in (list, tuple) or (array is not None and array.ndim)):
        parts = [numbers(part, depth - 1) for part in value]
        if len({part.shape for part in parts}) == 1:
            return np.stack(parts)
        raise Unreadable("expected are numbers, in rows of equal length.")
    raise Unreadable(f"expected are plain numbers.{_hint(value)}")


def number(value) -> np.ndarray:
    """One number; an array of one number is none."""
    array = numbers(value)
    if array.ndim:
        raise Unreadable(f"one number is expected, not an array of the shape {array.shape}.")
    return array


def whole(value) -> np.ndarray:
    """One whole number, an `int` of Python or numpy; 4.0 is none."""
    array = number(value)
    kind = np.asarray(value).dtype.kind if not isinstance(value, int) else "i"
    if kind not in "iu" or isinstance(value, bool):
        raise Unreadable("an int is expected. (math.ceil gives one, np.ceil does not.)")
    return array


def row(count: int, what: str) -> Reader:
    """A reader of so many numbers, and what it says of anything else."""

    def read(value):
        array = numbers(value)
        if array.shape != (count,):
            raise Unreadable(f"{what} expected, not the shape {array.shape}.")
        return array

    return read


pair = row(2, "two numbers are")


def or_none(read: Reader) -> Reader:
    """A reader that takes None, too."""
    return lambda value: np.asarray(None) if value is None else read(value)


def one_of(*names: str) -> Reader:
    """A reader of one of these texts."""

    def read(value):
        if not (isinstance(value, str) and value in names):
            raise Unreadable(f"expected is one of {', '.join(names)}, as text.")
        return np.asarray(str(value))

    return read


def truth(value) -> np.ndarray:
    """True or False; 1 and 0 count as such."""
    array = np.asarray(value) if isinstance(value, bool | int | np.bool_ | np.integer) else None
    array = _bare(value) if array is None else array
    if array is None or array.ndim or array.dtype.kind not in "biu" or array not in (0, 1):
        raise Unreadable("one truth value is expected, True or False.")
    return array.astype(bool)


def truths(value) -> np.ndarray:
    """An array of Booleans; one of 0 and 1 is none."""
    array = _bare(value)
    if array is None or array.dtype != bool:
        kind = "" if array is None else f", not of {array.dtype}"
        raise Unreadable(f"an array of Booleans is expected{kind}.")
    return array.astype(bool)


def array_of_numbers(value) -> np.ndarray:
    """An array or tensor of numbers; a list is none."""
    array = numbers(value)
    if _bare(value) is None:
        raise Unreadable("an array is expected, not a list: np.array makes one.")
    return array


def _bare(value) -> np.ndarray | None:
    """An array or tensor as an array; None if it is neither."""
    if hasattr(value, "detach"):
        value = value.detach().cpu().numpy()
    return value if isinstance(value, np.ndarray | np.generic) else None


def _hint(value) -> str:
    if hasattr(value, "__next__"):
        return " That is a generator: is there a `yield`, or is list(…) missing?"
    if callable(value):
        return " That is a function: are brackets missing behind its name?"
    return ""


def close(answer, expected, tolerance: float = 1e-4, smallest: float | None = None) -> bool:
    """Whether an answer has the expected shape and values.

    Arguments:
        tolerance: relative; smallest: absolute, a hundredth of the relative one if not given.
    """
    try:
        answer, expected = numbers(answer), numbers(expected)
    except Unreadable:
        return False
    smallest = tolerance * 1e-2 if smallest is None else smallest
    same = answer.shape == expected.shape
    return bool(same and np.allclose(answer, expected, tolerance, smallest, equal_nan=True))


def shorten(text: str, length: int = 80) -> str:
    """A text on one line, cut off if it is long."""
    text = " ".join(text.split())
    return text if len(text) <= length else f"{text[:length]}…"


def show(value, digits: int | None = 4, depth: int = 5) -> str:
    """A value in a message: floats to so many digits, or all; large arrays by their shape."""
    if isinstance(value, bool | np.bool_):
        return str(bool(value))
    if isinstance(value, float | np.floating):
        return f"{value:.{digits}g}" if digits else repr(float(value)).removesuffix(".0")
    if hasattr(value, "detach"):
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray):
        if value.size > 24:
            return f"<array of shape {value.shape}>"
        if value.dtype == np.float32:  # 0.1 is 0.1, not 0.10000000149
            value = np.reshape([float(str(part)) for part in value.ravel()], value.shape)
        return show(value.tolist(), digits)
    if isinstance(value, np.generic):
        return show(value.item(), digits)
    if isinstance(value, np.random.Generator):
        return "generator"
    if depth and type(value) in (list, tuple) and len(value) <= 30:
        inside = ", ".join(show(part, digits, depth - 1) for part in value)
        if isinstance(value, list):
            return f"[{inside}]"
        return f"({inside},)" if len(value) == 1 else f"({inside})"
    try:
        return shorten(repr(value))
    except Exception:  # such as a number with more digits than Python shows
        return f"<{type(value).__name__}>"


def called(name: str, arguments: Iterable[Any]) -> str:
    """The call of a function, its arguments to all their digits."""
    return f"{name}({', '.join(show(argument, None) for argument in arguments)})"


def first_difference(given: np.ndarray, expected: np.ndarray) -> tuple[int, ...]:
    """The first place where two arrays of one shape differ, by more than rounding if possible."""
    unequal = given != expected
    if given.dtype.kind == "f":
        rounded = np.isclose(given, expected, 1e-6, 1e-9, equal_nan=True)
        unequal = unequal & ~rounded if not rounded.all() else unequal
    return tuple(np.argwhere(unequal)[0].tolist())


def differing(given: np.ndarray, expected: np.ndarray) -> str:
    """What is given and what is expected, with as many digits as it takes to tell them apart."""
    where = ""
    if given.size > 12 and given.shape == expected.shape:
        place = first_difference(given, expected)
        where, given, expected = f" at {list(place)}", given[place], expected[place]
    for digits in range(4, 18):
        texts = [show(_plain(value), digits) for value in (given, expected)]
        if texts[0] != texts[1]:
            break
    return f"gives {texts[0]}{where}, expected {texts[1]}"


def _plain(array: np.ndarray) -> Any:
    """Whole numbers as such, so that they show no decimals."""
    array = np.asarray(array)
    if array.dtype.kind not in "iuf":
        return array.tolist()
    is_whole = np.isfinite(array).all() and (array == np.rint(array)).all()
    return (array.astype(int) if is_whole and (abs(array) < 1e15).all() else array).tolist()
