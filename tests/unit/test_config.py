"""Fields that explain themselves and know their bounds."""

import itertools
import math
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
import pytest

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.channel import Channel
from uavdh_lite.config import from_json, option, require
from uavdh_lite.errors import InputError
from uavdh_lite.registry import find

PRESETS = [("scenario", "manhattan"), ("recipe", "lite"), ("recipe", "imitation")]


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
        ("free", 1e16, "0, or of a size from 1e-15 to 1e+15"),
        ("width", 1e-16, "0, or of a size from 1e-15 to 1e+15"),
        ("share", "0.5", "a number"),
        ("share", True, "a number"),
        ("counts", (1.5,), "a tuple of any number, each a whole number"),
        ("counts", 3, "a tuple of any number, each a whole number"),
        ("counts", (True,), "a tuple of any number, each a whole number"),
        ("limit", "none", "a number or None"),
        ("either", "no", "True or False"),
        ("either", 1, "True or False"),
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


def test_bounds_themselves_are_inside():
    Sample(share=0.0), Sample(share=1.0), Sample(counts=(1,)), Sample(limit=1e-9), Sample(free=-1e9)


def test_what_says_the_same_becomes_the_type_of_the_field():
    sample = Sample(np.float32(0.5), 2, [np.int64(3)], None, free=np.float64(1), pair=np.arange(2))
    assert sample == Sample(0.5, 2.0, (3,), None, free=1.0, pair=(0, 1))
    values = (sample.share, sample.width, *sample.counts, sample.free, *sample.pair)
    assert [type(value) for value in values] == [float, float, int, float, int, int]


def test_a_long_value_is_cut():
    with pytest.raises(InputError) as caught:
        Sample(counts=(10**5000, "a" * 1000))
    assert len(str(caught.value)) < 200
    with pytest.raises(InputError, match="share is huge"):
        Sample(share=10**5000)


ODD = [None, True, "\ud800", [None], (2, 1), {}, object(), 1j, -1, 1.5, 1e-300, 1e300, 10**400]
ODD += [math.nan, (1, math.inf), np.array([1.5, 2])]
CONFIGS = [Channel(), CityGenerator(), *(find(kind, name) for kind, name in PRESETS)]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda one: getattr(one, "name", "default"))
def test_an_odd_value_of_any_field_is_refused_by_its_name_or_kept(config):
    """Also where it comes from a file."""
    for field, value in itertools.product((f.name for f in fields(config)), ODD):
        try:
            changed = replace(config, **{field: value})
        except InputError as error:
            words = str(error).replace("_", " ").lower()
            assert field.replace("_", " ").rstrip("s") in words and len(words) < 300
        else:
            assert from_json(type(config), vars(changed), "config") == changed
