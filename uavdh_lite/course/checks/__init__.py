"""Checks for the exercises: `checks.rate_from_snr(rate)`.

A check takes an answer, prints that it is right, or raises `CheckFailed` with what is probably
wrong with it. `EXERCISES` has them all by name. Each module has those of one notebook.
"""

from importlib import import_module
from pathlib import Path

from uavdh_lite.course.checks.exercise import EXERCISES, CheckFailed, Exercise

__all__ = ["EXERCISES", "CheckFailed", "Exercise"]

for page in sorted(Path(__file__).parent.glob("notebook_*.py")):
    import_module(f"{__name__}.{page.stem}")


def __getattr__(name: str) -> Exercise:
    if name in EXERCISES:
        return EXERCISES[name]
    older = "is this package older than your notebook? Install the wheel that came with it"
    raise AttributeError(f"no exercise has a check named {name!r}; {older}")


def __dir__() -> list[str]:
    return [*__all__, *EXERCISES]
