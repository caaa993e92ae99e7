"""Checks for the exercises: `checks.rate_from_snr(rate)`, and `checks.rate_from_snr.hint()`.

A check takes an answer, prints that it is right, or raises `CheckFailed` with what is probably
wrong with it. `EXERCISES` has them all by name, in the order of the notebooks.
"""

from uavdh_lite.course.checks.exercise import EXERCISES, CheckFailed, Exercise

# isort: off
from uavdh_lite.course.checks import first_flight, channel, shadowing, environment, observation  # noqa: F401
from uavdh_lite.course.checks import ddqn, training, ablation, evaluation, scenarios, labs  # noqa: F401
from uavdh_lite.course.checks import beyond, any_city  # noqa: F401
# isort: on

__all__ = ["EXERCISES", "CheckFailed", "Exercise", *EXERCISES]
globals().update(EXERCISES)
