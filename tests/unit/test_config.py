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
        ("share", True, "float"),
        ("counts", (1.5,), "tuple[int, ...]"),
        ("counts", 3, "tuple[int, ...]"),
        ("limit", "none", "float | None"),
        ("either", None, "bool"),
        ("pair", (1, 2, 3), "tuple[int, int]"),
        ("word", "three", "typing.Literal['one', 'two']"),
        ("word", ["one"], "typing.Literal['one', 'two']"),
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


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"more": 1}, ".* unexpected .*'more'"),
        ({"share": 2}, "share is 2"),
        ({"share": 10**400}, r"share is 10{76}…, must be float"),  # cut
        (3, ".* must be a mapping"),
    ],
)
def test_a_file_is_read_or_its_field_is_named(values, named):
    saved = json.loads(json.dumps(asdict(Sample(counts=(3,), limit=2))))
    assert from_json(Sample, saved, "sample") == Sample(counts=(3,), limit=2)
    with pytest.raises(InputError, match=f"sample: {named}"):
        from_json(Sample, values, "sample")
