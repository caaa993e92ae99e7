import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image
from strategies import cities

from uavdh_lite.city import (
    COLOURS,
    City,
    fingerprint_of,
    load_cities,
    load_city,
    shipped_cities,
)
from uavdh_lite.errors import CityError

DRAWN = City.from_text(
    "drawn",
    """
    L . N .
    . b B .
    . . . .
    . . . L
    """,
)


def test_layers_and_cells_of_a_drawn_city():
    assert np.argwhere(DRAWN.landing).tolist() == [[0, 0], [3, 3]]
    assert np.argwhere(DRAWN.no_fly).tolist() == [[0, 2], [1, 2]]
    assert np.argwhere(DRAWN.buildings).tolist() == [[1, 1], [1, 2]]
    expected = [cell for cell in range(16) if cell not in (0, 5, 6, 15)]
    assert (
        np.flatnonzero(DRAWN.open_to_devices).tolist() == expected
    )  # a device may stand in a no-fly zone


def test_landing_distance_goes_around_what_may_not_be_flown_over():
    city = City.from_text("maze", "L B . N \n . B . B \n . . . N \n N N N .")
    expected = [[0, -1, 6, -1], [1, -1, 5, -1], [2, 3, 4, -1], [-1, -1, -1, -1]]
    assert city.landing_distance.tolist() == expected


@given(cities(2))
@pytest.mark.filterwarnings("ignore:.* reaches only")
@settings(derandomize=True, deadline=None, max_examples=50)
def test_round_trips_keep_every_city(tmp_path_factory, city):
    path = tmp_path_factory.mktemp("city") / "any.png"
    city.save(path)
    for copy in (City.load(path), City.from_text("again", city.text)):
        assert np.array_equal(copy.kinds, city.kinds) and copy.fingerprint == city.fingerprint


@pytest.mark.parametrize("name", shipped_cities())
def test_shipped_cities_are_connected_and_have_low_buildings_and_zones(name):
    city = City.load(name)
    assert (city.landing_distance[~city.no_fly] >= 0).all()
    assert (city.no_fly & ~city.buildings).any()


def test_the_colours_of_the_authors_files_are_read(tmp_path, generator):
    """Other pixel formats, and colours near the palette's, such as the #f9f900 of one map."""
    for mode in ("P", "RGBA"):
        Image.fromarray(COLOURS[DRAWN.kinds]).convert(mode).save(tmp_path / "c.png")
        assert City.load(tmp_path / "c.png").fingerprint == DRAWN.fingerprint
    colours = COLOURS[DRAWN.kinds]
    shift = generator.integers(0, 32, colours.shape)
    near = np.where(colours > 0, 255 - shift, shift).astype(np.uint8)
    Image.fromarray(near).save(tmp_path / "near.png")
    assert City.load(tmp_path / "near.png").fingerprint == DRAWN.fingerprint


@pytest.mark.parametrize("colour", ["ff0020", "00ffff", "808080", "ff0000fe"])
def test_a_wrong_colour_names_file_and_pixel(tmp_path, colour):
    value = list(bytes.fromhex(colour))
    image = Image.fromarray(COLOURS[DRAWN.kinds]).convert("RGBA" if len(value) == 4 else "RGB")
    image.putpixel((1, 2), tuple(value))
    image.save(tmp_path / "odd.png")
    shown = rf"#{colour} \(not opaque\)," if len(value) == 4 else f"#{colour}"
    with pytest.raises(CityError, match=rf"odd\.png: pixel row 2, column 1 is {shown}"):
        City.load(tmp_path / "odd.png")


@pytest.mark.parametrize(
    "text, wrong",
    [
        ("L. .. ..", "square"),
        ("... ... ...", "landing zone"),
        (".N. NLN .N.", "row 1, column 1 lies inside"),
        ("LL bb", "no cell for a device"),
    ],
)
def test_what_is_no_city_is_refused_with_its_file(tmp_path, text, wrong):
    kinds = [[".NbLB".index(sign) for sign in row] for row in text.split()]
    Image.fromarray(COLOURS[np.array(kinds)]).save(tmp_path / "mine.png")
    with pytest.raises(CityError, match=rf"mine\.png: .*{wrong}"):
        City.load(tmp_path / "mine.png")


@pytest.mark.parametrize(
    "name, wrong",
    [
        ("bad.png", r"bad\.png: not a readable PNG"),
        ("huge.png", r"huge\.png: .*at most 100"),
        ("gone.png", r"gone\.png: .*No such"),
        ("atlantis", "'atlantis'.*manhattan"),
        ("empty", "empty: no PNG files"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, name, wrong):
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    Image.new("RGB", (3000, 3000)).save(tmp_path / "huge.png")  # refused by its header
    with pytest.raises(CityError, match=wrong):
        load_cities(tmp_path / name)


def test_a_folder_is_many_cities_in_the_order_of_their_names(tmp_path):
    DRAWN.save(tmp_path / "b.png")
    (tmp_path / "._b.png").write_bytes(b"what macOS keeps about a file")
    City.load("village").save(tmp_path / "a.png")
    found = load_cities(tmp_path)
    assert [city.name for city in found] == ["a", "b"]
    assert fingerprint_of(found) != fingerprint_of(found[::-1])
    assert fingerprint_of(found[1:]) == DRAWN.fingerprint
    assert load_city(tmp_path / "b.png").fingerprint == DRAWN.fingerprint
    with pytest.raises(CityError, match="2 cities"):
        load_city(tmp_path)


def test_a_name_that_no_file_could_hold_becomes_one_that_can():
    """Nor a terminal obey."""
    assert City.from_kinds("M\udcfcn\x1b[2Jchen\n", DRAWN.kinds).name == "M?n?[2Jchen?"


@pytest.mark.parametrize(
    ("text", "warning"),
    [
        ("LN. LN. NN.", r"the UAV reaches only 2 of the 5"),  # walled in together
        ("LLNL NNN. .... ....", r"only 2 of the 12"),  # one of two zones
        ("L.N .NN N.. ", r"only 3 of the 5"),
        ("L.. .N. ..L", None),
    ],
)
def test_a_landing_zone_that_is_walled_in_is_warned_of(tmp_path, text, warning):
    City.from_text("mine", text.replace(" ", "\n")).save(tmp_path / "mine.png")
    if warning is None:
        City.load(tmp_path / "mine.png")  # warnings are errors here
    else:
        with pytest.warns(UserWarning, match=rf"mine\.png: from the landing zone at .*{warning}"):
            City.load(tmp_path / "mine.png")
