import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from uavdh_lite.city import COLOURS, MAX_SIZE, City, shipped_cities
from uavdh_lite.errors import CityError

PICTURE = """
L . N .
. b B .
. . . .
. . . L
"""


def write_png(path, kinds, change=None):
    pixels = COLOURS[np.asarray(kinds)].copy()
    if change:
        (row, col), colour = change
        pixels[row, col] = colour
    Image.fromarray(pixels).save(path)
    return path


def test_layers_and_cells_of_a_drawn_city():
    city = City.from_text("drawn", PICTURE)
    assert city.size == 4
    assert np.argwhere(city.landing).tolist() == [[0, 0], [3, 3]]
    assert np.argwhere(city.no_fly).tolist() == [[0, 2], [1, 2]]
    assert np.argwhere(city.buildings).tolist() == [[1, 1], [1, 2]]
    assert city.landing_cells.tolist() == [0, 15]
    assert 5 in city.flight_cells and 6 not in city.flight_cells  # low and tall building
    assert 2 in city.device_cells  # a device may stand in a no-fly zone
    assert {0, 5, 6, 15}.isdisjoint(city.device_cells)


def test_landing_distance_goes_around_what_may_not_be_flown_over():
    city = City.from_text(
        "maze",
        """
        L B . . .
        . B . N N
        . B . N .
        . . . N N
        . . . . .
        """,
    )
    assert city.landing_distance.tolist() == [
        [0, -1, 8, 9, 10],
        [1, -1, 7, -1, -1],
        [2, -1, 6, -1, -1],  # the cell in the east is walled in
        [3, 4, 5, -1, -1],
        [4, 5, 6, 7, 8],
    ]


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(2, 8).flatmap(lambda n: arrays(np.uint8, (n, n), elements=st.integers(0, 4))))
def test_png_round_trip_keeps_every_valid_city(tmp_path_factory, kinds):
    try:
        city = City.from_kinds("any", kinds)
    except CityError:
        return
    path = tmp_path_factory.mktemp("city") / "any.png"
    city.save(path)
    loaded = City.load(path)
    assert (loaded.kinds == kinds).all()
    assert loaded.fingerprint == city.fingerprint


@pytest.mark.parametrize("mode", ["P", "RGBA"])
def test_other_pixel_formats_of_the_same_colours_load(tmp_path, mode):
    city = City.from_text("drawn", PICTURE)
    Image.fromarray(COLOURS[city.kinds]).convert(mode).save(tmp_path / "c.png")
    assert City.load(tmp_path / "c.png").fingerprint == city.fingerprint


@pytest.mark.parametrize(
    ("name", "size", "landing"),
    [
        ("manhattan", 16, 8),
        ("open_field", 16, 8),
        ("village", 8, 4),
        ("harbour", 32, 20),
        ("metropolis", 50, 24),
    ],
)
def test_shipped_cities_are_valid_and_connected(name, size, landing):
    city = City.load(name)
    assert name in shipped_cities()
    assert city.size == size
    assert len(city.landing_cells) == landing
    assert (city.landing_distance[~city.no_fly] >= 0).all()
    assert (city.no_fly & ~city.buildings).any()


@pytest.mark.parametrize(
    ("colour", "shown"),
    [
        ((255, 0, 32), "#ff0020"),
        ((223, 223, 0), "#dfdf00"),
        ((0, 255, 255), "#00ffff"),
        ((255, 0, 255), "#ff00ff"),
        ((255, 255, 255), "#ffffff"),
        ((128, 128, 128), "#808080"),
    ],
)
def test_wrong_colour_names_file_and_pixel(tmp_path, colour, shown):
    kinds = City.from_text("drawn", PICTURE).kinds
    path = write_png(tmp_path / "odd.png", kinds, ((2, 1), colour))
    with pytest.raises(CityError, match=rf"odd\.png: pixel row 2, column 1 is {shown}.*#0000ff"):
        City.load(path)


@given(
    kinds=arrays(np.uint8, (6, 6), elements=st.integers(0, 4)),
    shift=arrays(np.uint8, (6, 6, 3), elements=st.integers(0, 31)),
)
def test_colours_near_the_palettes_are_read(kinds, shift, tmp_path_factory):
    """As in the authors' 50×50 map, whose buildings are #f9f900."""
    kinds = np.where(kinds == 3, 0, kinds)
    kinds[0] = [3, 0, 0, 0, 0, 0]
    pixels = np.where(COLOURS[kinds] > 0, 255 - shift, shift)
    path = tmp_path_factory.mktemp("near") / "near.png"
    Image.fromarray(pixels.astype(np.uint8)).save(path)
    assert (City.load(path).kinds == kinds).all()


def test_not_square_names_file_and_size(tmp_path):
    path = write_png(tmp_path / "wide.png", [[3, 0, 0], [0, 0, 0]])
    with pytest.raises(CityError, match=r"wide\.png: a city must be square.* 3 × 2 cells"):
        City.load(path)


def test_no_landing_zone_names_file(tmp_path):
    path = write_png(tmp_path / "none.png", np.zeros((3, 3), int))
    with pytest.raises(CityError, match=r"none\.png: no start and landing zone"):
        City.load(path)


def test_landing_cell_inside_a_no_fly_zone_names_file_and_pixel(tmp_path):
    path = write_png(tmp_path / "shut.png", [[0, 1, 0], [1, 3, 1], [0, 1, 0]])
    with pytest.raises(CityError, match=r"shut\.png: landing cell row 1, column 1 lies inside"):
        City.load(path)


def test_overlapping_layers_are_refused():
    layer = np.eye(3, dtype=bool)
    with pytest.raises(CityError, match="row 0, column 0 is landing zone and no-fly"):
        City("both", layer, layer, np.zeros((3, 3), bool))


def test_city_without_room_for_devices_is_refused():
    with pytest.raises(CityError, match="no cell for a device"):
        City.from_text("full", "L L\nb b")


def test_unreadable_file_and_missing_file(tmp_path):
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    with pytest.raises(CityError, match=r"bad\.png: not a readable PNG"):
        City.load(tmp_path / "bad.png")
    with pytest.raises(CityError, match=r"gone\.png: no such file"):
        City.load(tmp_path / "gone.png")
    with pytest.raises(CityError, match=r"not a readable PNG"):
        City.load(tmp_path)
    with pytest.raises(CityError, match=r"no city named 'atlantis'.*manhattan"):
        City.load("atlantis")


def test_too_large_an_image_is_refused_by_its_header(tmp_path):
    Image.new("RGB", (3000, 3000)).save(tmp_path / "huge.png")
    with pytest.raises(CityError, match=r"huge\.png: 3000 × 3000 pixels, at most 100"):
        City.load(tmp_path / "huge.png")


def test_layers_cannot_be_changed():
    city = City.from_text("drawn", PICTURE)
    with pytest.raises(ValueError, match="read-only"):
        city.landing[0, 0] = False


def test_layers_of_different_shapes_and_too_large_a_city_are_refused():
    landing, other = np.ones((4, 4), bool), np.zeros((3, 3), bool)
    with pytest.raises(
        CityError, match=r"odd: the layers landing, no_fly, buildings differ in shape"
    ):
        City("odd", landing, other, other)
    side = MAX_SIZE + 1
    with pytest.raises(CityError, match=f"{side} cells on a side, at most {MAX_SIZE} fit"):
        City("large", *np.zeros((3, side, side), bool))
