"""Cities that are being drawn."""

import contextlib
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from uavdh_lite.city import City
from uavdh_lite.errors import CityError
from uavdh_lite.labs.city import BRUSHES, UPLOAD_BYTES, Draft


def test_brushes_make_the_layers_they_name():
    draft = Draft.blank(4)
    for col, brush in enumerate(("no-fly zone", "low building", "landing zone", "tall building")):
        assert draft.paint((1, col), brush)
        assert not draft.paint((1, col), brush)  # it is that already
    assert draft.no_fly[1].tolist() == [True, False, False, True]
    assert draft.buildings[1].tolist() == [False, True, False, True]
    assert draft.landing[1].tolist() == [False, False, True, False]
    assert draft.paint((1, 0), "free") and not draft.no_fly[1, 0]
    assert not draft.paint((4, 0), "free") and not draft.paint((0, -1), "free")


def test_a_draft_becomes_a_city_when_it_is_one():
    draft = Draft.blank(5)
    with pytest.raises(CityError, match="no start and landing zone"):
        draft.city()
    draft.paint((0, 0), "landing zone")
    assert draft.city("mine").landing_cells.tolist() == [0]


def test_png_round_trip():
    kinds = City.load("manhattan").kinds
    assert (Draft.from_png(Draft(kinds).png()).kinds == kinds).all()


def image(array):
    buffer = io.BytesIO()
    Image.fromarray(np.array(array, np.uint8)).save(buffer, format="PNG")
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"not a picture", "upload.png: not a readable PNG"),
        (b"", "upload.png: not a readable PNG"),
        (bytes(UPLOAD_BYTES + 1), "100,001 bytes, at most 100,000"),
        (image(np.full((4, 4, 3), 112)), "upload.png: pixel row 0, column 0 is #707070"),
        (image(np.zeros((4, 4, 3))), "no start and landing zone"),
        (image(np.zeros((3, 4, 3))), "must be square"),
        (image(np.zeros((101, 101, 3))), "101 × 101 pixels, at most 100"),
    ],
)
def test_what_is_no_city_is_refused(data, message):
    with pytest.raises(CityError, match=message) as caught:
        Draft.from_png(data)
    assert "/tmp" not in str(caught.value)


@given(st.binary(max_size=400))
def test_any_bytes_are_a_city_or_an_error_of_ours(data):
    with contextlib.suppress(CityError):
        Draft.from_png(data)


@given(st.data())
def test_any_strokes_are_a_city_or_an_error_of_ours(data):
    draft = Draft.blank(data.draw(st.integers(1, 6)))
    cells = st.tuples(st.integers(-1, 6), st.integers(-1, 6))
    for cell, brush in data.draw(st.lists(st.tuples(cells, st.sampled_from(list(BRUSHES))))):
        draft.paint(cell, brush)
    try:
        city = draft.city()
    except CityError:
        return
    assert (city.kinds == draft.kinds).all()
