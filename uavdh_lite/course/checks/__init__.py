"""Checks for the exercises: `checks.rate_from_snr(rate)`.

A check takes an answer, prints that it is right, or raises `CheckFailed` with what is probably
wrong with it. `EXERCISES` has them all by name. Each module has those of one notebook.
"""

from uavdh_lite.course.checks.exercise import EXERCISES, CheckFailed, Exercise

# isort: off
from uavdh_lite.course.checks import notebook_00, notebook_01, notebook_02, notebook_03  # noqa: F401
from uavdh_lite.course.checks import notebook_04, notebook_05, notebook_06, notebook_07  # noqa: F401
from uavdh_lite.course.checks import notebook_08, notebook_10, notebook_11, notebook_12  # noqa: F401
from uavdh_lite.course.checks import notebook_13, notebook_14  # noqa: F401
# isort: on

__all__ = ["EXERCISES", "CheckFailed", "Exercise"]


def __getattr__(name: str) -> Exercise:
    if name in EXERCISES:
        return EXERCISES[name]
    older = "is this package older than your notebook? Install the wheel that came with it"
    raise AttributeError(f"no exercise has a check named {name!r}; {older}")


def __dir__() -> list[str]:
    return [*__all__, *EXERCISES]
