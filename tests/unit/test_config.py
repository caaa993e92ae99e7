"""Fields that explain themselves and know their bounds."""

import math
from dataclasses import dataclass, replace

import pytest

from uavdh_lite.config import option, require_bounds
from uavdh_lite.errors import InputError


@dataclass(frozen=True)
class Sample:
    share: float = option(0.5, "a share", ge=0, le=1)
    width: float = option(1.0, "a width", gt=0)
    counts: tuple[int, ...] = option((1, 2), "counts", ge=1)
    limit: float | None = option(None, "a limit, or none", gt=0)
    free: float = option(-3.0, "any number")

    def __post_init__(self):
        require_bounds(self, "sample")


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("share", -0.1, "at least 0 and at most 1"),
        ("share", 1.1, "at least 0 and at most 1"),
        ("width", 0.0, "above 0"),
        ("counts", (1, 0), "at least 1"),
        ("limit", 0.0, "above 0"),
        ("free", math.nan, "a finite number"),
        ("width", math.inf, "a finite number"),
    ],
)
def test_a_value_out_of_bounds_is_named(field, value, expected):
    with pytest.raises(InputError) as caught:
        replace(Sample(), **{field: value})
    assert str(caught.value) == f"sample: {field} is {value}, must be {expected}"


def test_bounds_themselves_are_inside():
    Sample(share=0.0), Sample(share=1.0), Sample(counts=(1,)), Sample(limit=1e-9), Sample(free=-1e9)
