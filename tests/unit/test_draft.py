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
from uavdh_lite.labs.draft import BRUSHES, MIRRORS, UPLOAD_BYTES, Draft, History, rectangle


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
    assert np.flatnonzero(draft.city("mine").landing).tolist() == [0]


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
        (b"not a picture", "city: not a readable PNG"),
        (b"", "city: not a readable PNG"),
        (bytes(UPLOAD_BYTES + 1), "100,001 bytes, at most 100,000"),
        (image(np.full((4, 4, 3), 112)), "city: pixel row 0, column 0 is #707070"),
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


def test_a_region_is_what_touches_and_is_alike():
    draft = Draft(
        City.from_text(
            "c",
            """
        L . B .
        . B . .
        B . . B
        . . B B
    """,
        ).kinds
    )
    assert draft.region((0, 0)) == [(0, 0)]
    assert draft.region((0, 1)) == [(0, 1)]  # corners do not touch
    assert draft.region((3, 0)) == [
        (0, 3), (1, 2), (1, 3), (2, 1), (2, 2), (3, 0), (3, 1),
    ]  # fmt: skip
    assert draft.region((2, 3)) == [(2, 3), (3, 2), (3, 3)]
    assert draft.region((4, 0)) == draft.region((-1, 0)) == []


@given(st.integers(4, 7), st.sampled_from(list(MIRRORS)), st.data())
def test_mirrored_cells_look_the_same_from_the_other_side(size, mirror, data):
    cell = st.tuples(st.integers(0, size - 1), st.integers(0, size - 1))
    cells = data.draw(st.lists(cell, min_size=1, max_size=4))
    draft = Draft.blank(size)
    for each in draft.mirrored(cells, mirror):
        draft.paint(each, "tall building")
    painted = draft.buildings
    assert all(painted[each] for each in cells)
    for axis in MIRRORS[mirror]:
        assert (painted == np.flip(painted, axis)).all()
    assert painted.sum() <= len(set(cells)) * 2 ** len(MIRRORS[mirror])
    if mirror == "left and right":
        row, col = cells[0]
        assert painted[row, size - 1 - col]


def test_a_rectangle_has_any_two_corners():
    expected = [(1, 2), (1, 3), (2, 2), (2, 3), (3, 2), (3, 3)]
    for corner, opposite in (((1, 2), (3, 3)), ((3, 2), (1, 3)), ((3, 3), (1, 2))):
        assert rectangle(corner, opposite) == expected
    assert rectangle((1, 1), (1, 1)) == [(1, 1)]


def test_history_goes_back_and_forth_and_forgets_what_was_undone():
    history = History(most=3)
    assert history.move(-1) is None and history.move(1) is None
    states = [np.full((4, 4), k) for k in range(5)]
    for state in states[:2]:
        history.record(state)
    states[1][0, 0] = 9  # what is kept is a copy
    assert (history.move(-1) == 0).all() and history.move(-1) is None
    assert (history.move(1) == 1).all() and not history.can(1)
    history.move(-1)
    history.record(states[2])
    assert history.move(1) is None  # 1 was undone
    history.record(states[3], new=False)  # in place of 2
    assert (history.move(-1) == 0).all() and (history.move(1) == 3).all()
    history.record(states[4])
    history.record(states[2])  # a fourth: the first is forgotten
    assert [history.move(-1)[0, 0] for _ in range(2)] == [4, 3] and history.move(-1) is None
