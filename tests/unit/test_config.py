"""Fields that explain themselves and know their bounds."""

import json
import math
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np
import pytest

from uavdh_lite.config import from_json, option, require
from uavdh_lite.errors import InputError


@dataclass(frozen=True)
class Sample:
    share: float = option(0.5, "a share", ge=0, le=1)
    width: float = option(1.0, "a width", gt=0)
    counts: tuple[int, ...] = option((1, 2), "counts", ge=1)
    limit: float | None = option(None, "a limit, or none", gt=0)
    free: float = option(-3.0, "any number")
    either: bool = option(True, "yes or no")
    pair: tuple[int, int] = option((1, 2), "two counts")
    word: Literal["one", "two"] = option("one", "a word")

    def __post_init__(self):
        require(self, "sample")


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
        ("share", "0.5", "a number"),
        ("share", True, "a number"),
        ("counts", (1.5,), "a tuple of any number, each a whole number"),
        ("counts", 3, "a tuple of any number, each a whole number"),
        ("limit", "none", "a number or None"),
        ("either", "no", "True or False"),
        ("either", None, "True or False"),
        ("pair", (1, 2, 3), "a tuple of 2, each a whole number"),
        ("word", "three", "one or two"),
        ("word", ["one"], "one or two"),
    ],
)
def test_a_value_out_of_bounds_is_named(field, value, expected):
    with pytest.raises(InputError) as caught:
        replace(Sample(), **{field: value})
    assert str(caught.value) == f"sample: {field} is {value!r}, must be {expected}"


def test_bounds_are_inside_and_what_says_the_same_becomes_the_type_of_the_field():
    Sample(share=0.0), Sample(share=1.0), Sample(counts=(1,))
    sample = Sample(np.float32(0.5), 2, [np.int64(3)], None, free=np.float64(1), pair=np.arange(2))
    assert sample == Sample(0.5, 2.0, (3,), None, free=1.0, pair=(0, 1))
    values = (sample.share, sample.width, *sample.counts, sample.free, *sample.pair)
    assert [type(value) for value in values] == [float, float, int, float, int, int]


def test_a_long_value_is_cut():
    with pytest.raises(InputError) as caught:
        Sample(counts="a" * 1000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"more": 1}, "'more' is no field"),
        ({"share": 2}, "share is 2"),
        ({"share": 10**400}, "share is 1000"),
        (3, "is 3, must be an object"),
    ],
)
def test_a_file_is_read_or_its_field_is_named(values, named):
    saved = json.loads(json.dumps(asdict(Sample(counts=(3,), limit=2))))
    assert from_json(Sample, saved, "sample") == Sample(counts=(3,), limit=2)
    with pytest.raises(InputError, match=f"sample: {named}"):
        from_json(Sample, values, "sample")
