"""Values from outside are checked here: first their type, then their bounds.

What fits together is checked by the configuration itself, after `require`.
"""

import math
import operator
from dataclasses import field, fields, is_dataclass
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import numpy as np

from uavdh_lite.errors import InputError

BOUNDS = {
    "ge": ("at least", operator.ge),
    "gt": ("above", operator.gt),
    "le": ("at most", operator.le),
}
PLAIN = bool, int, float, str


def option(default: Any, help: str, **bounds: float) -> Any:
    """A dataclass field with a default, one line of help for the command line, and bounds.

    Arguments:
        bounds: `ge`, `gt` and `le`: the value, or each number of a tuple, must be ≥, > or ≤ this.
            None is never compared.
    """
    return field(default=default, metadata={"help": help, "bounds": bounds})


def require(config: Any, name: str) -> None:
    """Check the type of each field of a configuration, then its bounds.

    A value of another type that says the same becomes one of the field's type: a list a tuple, a
    number of numpy one of Python, and 3 the float 3.0.

    Raises `InputError` that names the configuration, the field, what was found and what is right.
    """
    for each in fields(config):
        found = getattr(config, each.name)
        try:
            value = as_type(found, each.type)
        except (TypeError, OverflowError):
            right = each.type.__name__ if isinstance(each.type, type) else str(each.type)
        else:
            object.__setattr__(config, each.name, value)
            right = _right_bounds(value, each.metadata.get("bounds"))
        if right:
            raise InputError(f"{name:.80}: {each.name} is {shown(found)}, must be {right}")


def require_name(name: str, kind: str) -> None:
    """Raise `InputError` unless a name, which a file may bring, can be a part of a file's name."""
    if not name.isprintable() or not 1 <= len(name) <= 50 or set(name) & set('/\\:*?"<>|'):
        raise InputError(
            f"{kind} {shown(name)}: its name must have 1 to 50 characters that can be printed, and "
            'none of / \\ : * ? " < > |'
        )


def _right_bounds(value: Any, bounds: dict[str, float] | None) -> str:
    """What a value, or each number of a tuple, must be and is not; empty if it is all right."""
    values = value if isinstance(value, tuple) else (value,)
    numbers = [n for n in values if type(n) in (int, float)]
    if bounds is None or not numbers:
        return ""
    if not all(math.isfinite(n) for n in numbers if type(n) is float):
        return "a finite number"
    if not all(BOUNDS[bound][1](n, to) for n in numbers for bound, to in bounds.items()):
        return " and ".join(f"{BOUNDS[bound][0]} {to}" for bound, to in bounds.items())
    return ""


def as_type(value: Any, hint: Any) -> Any:
    """The value as an annotated type: a class, `Literal`, a tuple of these, or one `| None`.

    Raises TypeError if it is of another, and OverflowError for a number that no float can hold.
    """
    parts = get_args(hint)
    if isinstance(hint, UnionType):
        return None if value is None else as_type(value, parts[0])
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if get_origin(hint) is tuple and isinstance(value, list | tuple):
        hints = parts[:1] * len(value) if parts[-1] is ... else parts
        if len(hints) == len(value):
            return tuple(map(as_type, value, hints))
    elif get_origin(hint) is Literal:
        if type(value) is str and value in parts:
            return value
    elif hint is float and type(value) is int:
        return float(value)
    elif isinstance(hint, type) and is_dataclass(hint) and isinstance(value, dict):
        return from_json(hint, value, hint.__name__.lower())
    elif type(value) is hint or (hint not in PLAIN and isinstance(value, hint)):
        return value  # so True is no whole number
    raise TypeError


def shown(value: Any) -> str:
    """A value in an error: on one line, and not long."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"


def differences(one: Any, other: Any) -> str:
    """Which numbers a configuration has otherwise than another one, in words; empty if none."""
    there, parts = vars(other), []
    for name, value in vars(one).items():
        if is_dataclass(value):
            parts.append(differences(value, there[name]))
        elif value != there[name]:
            both = (" to ".join(f"{n:g}" for n in np.atleast_1d(v)) for v in (value, there[name]))
            parts.append(f"{name} {', not '.join(both)}")
    return "; ".join(filter(None, parts))


def from_json(config: type, values: Any, name: str) -> Any:
    """A configuration from JSON values; `InputError` names a field that is missing or unknown."""
    try:
        return config(**values)
    except TypeError as error:
        raise InputError(f"{name}: {error}") from None
