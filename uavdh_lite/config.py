"""Configuration fields that carry their own help and bounds."""

import dataclasses
import math
import operator
from typing import Any

from uavdh_lite.errors import InputError

BOUNDS = {
    "ge": ("at least", operator.ge),
    "gt": ("above", operator.gt),
    "le": ("at most", operator.le),
}


def option(default: Any, help: str, **bounds: float) -> Any:
    """A dataclass field with a default, one line of help for the command line, and bounds.

    Arguments:
        bounds: `ge`, `gt` and `le`: the value, or each number of a tuple, must be ≥, > or ≤ this.
            None is always allowed.
    """
    return dataclasses.field(default=default, metadata={"help": help, "bounds": bounds})


def require_bounds(config: Any, name: str) -> None:
    """Check every `option` of a configuration; `InputError` names it, the field and the bound."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if "help" not in field.metadata or value is None:
            continue
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                raise InputError(f"{name}: {field.name} is {value}, must be a finite number")
            bounds = [(*BOUNDS[kind], bound) for kind, bound in field.metadata["bounds"].items()]
            if not all(holds(number, bound) for _, holds, bound in bounds):
                expected = " and ".join(f"{words} {bound}" for words, _, bound in bounds)
                raise InputError(f"{name}: {field.name} is {value}, must be {expected}")
