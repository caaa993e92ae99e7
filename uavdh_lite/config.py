"""Configuration fields that carry their own help and bounds."""

import dataclasses
import math
from typing import Any

from uavdh_lite.errors import InputError


def option(
    default: Any,
    help: str,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
) -> Any:
    """A dataclass field with a default, one line of help for the command line, and bounds.

    Arguments:
        ge, gt, le: the value, or each number of a tuple, must be ≥, > or ≤ this. None is always
            allowed.
    """
    return dataclasses.field(
        default=default, metadata={"help": help, "bounds": {"ge": ge, "gt": gt, "le": le}}
    )


def require_bounds(config: Any, name: str) -> None:
    """Check every `option` of a configuration; `InputError` names it, the field and the bound."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if "help" not in field.metadata or value is None:
            continue
        for number in value if isinstance(value, tuple) else (value,):
            expected = _violated(number, **field.metadata["bounds"])
            if expected:
                raise InputError(f"{name}: {field.name} is {value}, must be {expected}")


def _violated(value: Any, ge, gt, le) -> str | None:
    """What the value must be, or None if it is."""
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    low = (ge is None or value >= ge) and (gt is None or value > gt)
    if low and (le is None or value <= le):
        return None
    at_least = f"at least {ge}" if ge is not None else f"above {gt}" if gt is not None else ""
    return " and ".join(
        part for part in (at_least, f"at most {le}" if le is not None else "") if part
    )
