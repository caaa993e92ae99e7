"""What an answer returns: compared with the solution's value, and shown in a message.

The solution's value says what is expected: for an `int` a whole number, for a `float` one number of
any type, for a tuple or list as many values in any sequence, for an array or tensor the same.
"""

import re
from contextlib import suppress

import numpy as np


def difference(given, right, tolerance: float = 1e-6) -> str:
    """What tells a value from the right one, such as "gives 3, expected 4"; "" if nothing does.

    A relative difference of `tolerance` is none; float32 has fewer digits.
    """
    if given is None or right is None:
        return "" if given is right else _two(given, right)
    if isinstance(right, str):
        return "" if isinstance(given, str) and given == right else _two(given, right)
    if isinstance(right, tuple | list):
        parts = list(given) if isinstance(given, tuple | list) or _is_array(given) else []
        if len(parts) != len(right):
            return f"gives {show(given)}, but {len(right)} values are expected"
        for number, pair in enumerate(zip(parts, right, strict=True), 1):
            if said := difference(*pair, tolerance):
                kind = said.replace(", but ", f" as value {number}, but ")
                return kind if kind != said else _two(given, right)
        return ""
    one, other = _array(given), _array(right)
    if wanted := _wanted(given, right, one):
        return f"gives {show(given)}, but {wanted} is expected"
    if one.shape != other.shape:
        return f"has the shape {one.shape}, expected {other.shape}"
    smallest = 2e-7  # what float32 may be off next to 1
    if np.float32 in (one.dtype, other.dtype):
        tolerance = max(tolerance, 1e-4)
        smallest = max(smallest, 1e-6 * np.abs(other).max(initial=0))
    far = ~np.isclose(one.astype(float), other.astype(float), tolerance, smallest, equal_nan=True)
    if far.any() and one.size > 12:
        place = tuple(np.argwhere(far)[0].tolist())
        return _two(one[place], other[place], f" at {list(place)}")
    return _two(one, other) if far.any() else ""


def _two(given, right, where: str = "") -> str:
    """Both values, with as many digits as it takes to tell them apart."""
    texts = [(show(given, digits), show(right, digits)) for digits in range(4, 18)]
    one, other = next((pair for pair in texts if pair[0] != pair[1]), texts[0])
    return f"gives {one}{where}, expected {other}"


def _wanted(given, right, one: np.ndarray) -> str:
    """What kind of value is expected, if the given one is of another."""
    kind, single = one.dtype.kind, one.ndim == 0
    if isinstance(right, bool | np.bool_):
        return "" if single and kind in "biu" and one in (0, 1) else "True or False"
    if isinstance(right, int | np.integer):
        return "" if single and kind in "iuf" and one == np.rint(one) else "a whole number"
    if hasattr(right, "detach"):
        return "" if hasattr(given, "detach") else "a torch tensor"
    if np.ndim(right) == 0:
        return "" if single and kind in "biuf" else "one number"
    kinds, wanted = ("b", "Booleans") if right.dtype == bool else ("biuf", "numbers")
    found = one.dtype if _is_array(given) else f"a {type(given).__name__}"
    return "" if _is_array(given) and kind in kinds else f"an array of {wanted}, not {found},"


def _is_array(value) -> bool:
    return isinstance(value, np.ndarray | np.generic) or hasattr(value, "detach")


def _array(value) -> np.ndarray:
    return np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)


def unchanged(value, case) -> bool:
    """Whether arguments are still what they are in the case."""
    if isinstance(case, tuple | list):
        return len(value) == len(case) and all(map(unchanged, value, case))
    if _is_array(case):
        return np.array_equal(_array(value), _array(case))
    return not isinstance(case, float | int) or value == case


def show(value, digits: int | None = 4) -> str:
    """A value in a message: floats to so many digits, or all; large arrays by their shape."""
    if isinstance(value, float):
        whole = len(f"{abs(value):.0f}") if abs(value) < 1e15 else 0  # 100000, not 1e+05
        text = f"{value:.{max(digits, whole)}g}" if digits else repr(float(value))
        return text.removesuffix(".0")
    if isinstance(value, np.random.Generator):
        return "generator"
    if _is_array(value):
        array = _array(value)
        if array.size > 24:
            return f"<array of shape {array.shape}>"
        short = array.dtype == np.float32  # 0.1 is 0.1, not 0.10000000149
        return show((array.astype(str).astype(float) if short else array).tolist(), digits)
    with suppress(Exception):  # lists that contain themselves, values without a text
        if isinstance(value, tuple | list) and len(value) <= 30:
            inside = ", ".join(show(part, digits) for part in value)[:400]
            comma = "," * (len(value) == 1)
            return f"[{inside}]" if isinstance(value, list) else f"({inside}{comma})"
        text = " ".join(repr(value[:80] if isinstance(value, str) else value).split())
        return re.sub(" at 0x[0-9a-f]+", "", text)[:80]  # of an object, which is another each time
    return f"a {type(value).__name__}"
