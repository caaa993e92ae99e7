"""Footprints of buildings become a city."""

import json
import math

import numpy as np
import pytest

from uavdh_lite.bridges.footprints import Raster, city_of_footprints, city_of_shares
from uavdh_lite.city import City
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.storage import data_folder

pytest.importorskip("shapely")

CAMPUS = data_folder() / "places" / "campus.geojson"
CENTRE = (50.0, 8.0)
DRAWN = """
. . . . . . . . . . . . . . . .
. . B B B B B . . . B B . . . .
. . B B B B B . . . B B . . . .
. . B . . B B . . . B B . b . .
. . B B B B B . . . B B . b b .
. . B B B B B . . . . . . . . .
. . . . . . . L L . . . . . . .
. . . . . . . L L . . . . . . .
. . . . . . . L L . . . . . . .
. . . . . . . . . . . . . . B .
. B . . . . . . . . . b . . B .
. B . . . B B . B . . . . . . .
. B . . . B B . B . . . . . . .
. B B B . B B . B . . b b b b .
. . . . . . . . . . . b b b b .
. . . . . . . . . . . . . . . .
"""  # a courtyard, halls of two parts, a canteen that is turned; a park and a square are free


def degrees(x, y, centre=CENTRE):
    """Longitude and latitude of a point, m to the east and to the north of the centre."""
    metres = 6_371_009 * math.pi / 180  # of a degree
    return [centre[1] + x / (metres * math.cos(math.radians(centre[0]))), centre[0] + y / metres]


def square(west, south, side, **properties):
    corners = [(0, 0), (side, 0), (side, side), (0, side), (0, 0)]
    ring = [degrees(west + x, south + y) for x, y in corners]
    return feature("Polygon", [ring], **properties)


def feature(kind, coordinates, **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.fixture
def made(tmp_path):
    """A function that makes a city of 4×4 cells from features, and says where heights come from."""

    def make(*features, **options):
        path = tmp_path / "town.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        return city_of_footprints(
            path, Raster(**{"centre": CENTRE, "cells": 4, "landing_cells": 1, **options})
        )

    return make


def test_the_campus_is_as_drawn():
    city, sources = city_of_footprints(CAMPUS, Raster(CENTRE))
    assert city.name == "campus"
    assert city.text == City.from_text("campus", DRAWN).text
    assert sources == {"height": 4, "building:levels": 3, "assumed": 1}


def test_a_centre_one_cell_to_the_north_east_moves_the_city_by_a_cell():
    longitude, latitude = degrees(10, 10)
    city, moved = (
        city_of_footprints(CAMPUS, Raster(centre))[0] for centre in (CENTRE, (latitude, longitude))
    )
    for layer in ("buildings", "no_fly"):
        here, there = getattr(city, layer), getattr(moved, layer)
        assert np.array_equal(here[:-1, 1:], there[1:, :-1])


@pytest.mark.parametrize(
    ("properties", "kind", "source"),
    [
        ({"height": "10"}, "b", "height"),  # not higher than the UAV flies
        ({"height": "10.1"}, "B", "height"),
        ({"height": 11}, "B", "height"),
        ({"height": "9.5 m", "building:levels": "9"}, "b", "height"),
        ({"height": "high", "building:levels": "3"}, "b", "building:levels"),
        ({"building:levels": "4"}, "B", "building:levels"),
        ({"height": "40'"}, "B", "assumed"),
        ({"height": "0", "building:levels": None}, "B", "assumed"),
    ],
)
def test_the_height_comes_from_the_first_property_that_has_one(made, properties, kind, source):
    city, sources = made(square(-20, 10, 10, building="yes", **properties))
    assert city.text.split()[0] == f"{kind}..." and sources == {source: 1}


@pytest.mark.parametrize("altitude_m", [10.0, 12.0, 40.0])
def test_a_building_of_unknown_height_is_higher_than_the_uav_unless_a_height_is_assumed(
    made, altitude_m
):
    unknown = square(-20, 10, 10, building="yes")
    city, sources = made(unknown, altitude_m=altitude_m)
    assert city.text.split()[0] == "B..." and sources == {"assumed": 1}
    lower, _ = made(unknown, altitude_m=altitude_m, assumed_m=altitude_m - 1)
    assert lower.text.split()[0] == "b..."


def test_half_of_a_cell_decides(made):
    """The parts of tall and low buildings add up to what is built on."""
    tall, low = {"building": "yes", "height": "20"}, {"building": "yes", "height": "5"}
    city, _ = made(
        square(-20, 10, 7.2, **tall),  # 52 %
        square(-10, 10, 7.0, **tall),  # 49 %
        square(0, 10, 6.5, **tall),  # 42 % of it tall
        square(6.5, 16.5, 3.5, **low),  # and 12 % low: built on, but not tall
        square(10, 10, 7.2, **low),
        square(10, 10, 7.2, **low),  # the same again: not twice as much
    )
    assert city.text.split()[0] == "B.bb"


def test_without_a_tag_every_polygon_is_a_building_and_with_one_only_those(made):
    plain = [square(-20, 10, 10, name="a"), square(-10, 10, 10, height="3")]
    assert made(*plain)[0].text.split()[0] == "Bb.."
    assert made(*plain, square(0, 10, 10, building="yes"))[0].text.split()[0] == "..B."
    part = square(0, 10, 10, **{"building:part": "yes"})
    assert made(*plain, part, square(10, 10, 10, building="no"))[0].text.split()[0] == "..B."


def test_a_ring_that_crosses_itself_and_one_given_twice_do_no_harm(made):
    corners = [(-20, 10), (-10, 20), (-10, 10), (-20, 20), (-20, 10)]  # two triangles: half a cell
    bow_tie = feature("Polygon", [[degrees(*corner) for corner in corners]])
    city, _ = made(bow_tie, square(0, 10, 10), square(0, 10, 10))
    assert city.text.split()[0] in ("B.B.", "..B.")


def test_the_landing_zone_is_free_and_near_the_point_and_not_in_a_courtyard(made):
    longitude, latitude = degrees(15, -15)
    city, _ = made(square(-20, 10, 10), landing=(latitude, longitude))
    assert city.text.split()[3] == "...L"
    tall = np.zeros((5, 5))
    tall[1:4, 1:4] = 1
    tall[2, 2] = 0  # the middle, which the UAV cannot leave
    zone = city_of_shares("court", tall, tall, 2).landing
    assert not zone[2, 2] and zone.sum() == 2


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[1, 2]", "no JSON object"),
        ('{"type": "FeatureCollection", "features": {}}', "no list of features"),
        ({"elements": [{"type": "way"}]}, "export it as GeoJSON"),  # Overpass' own JSON
        ([], "0 features and no polygon"),
        ([feature("Point", [8.0, 50.0])], "1 features and no polygon"),
        ([square(0, 0, 10), {"geometry": 7}], "feature 1 is broken"),
        ([3], "feature 0 is broken"),
        ([feature("Polygon", [])], "no polygon"),
        ([feature("Polygon", [[]])], "no polygon|feature 0 is broken"),
        ([feature("MultiPolygon", [])], "no polygon"),
        ([feature("Polygon", [[[8, 50], [8, 51], [10**400, 51], [8, 50]]])], "feature 0 is broken"),
        ([feature("Polygon", [[[8, 50], [8.1, 50]]])], "feature 0 is broken"),
        ([feature("Polygon", [["a", "b", "c", "d"]])], "feature 0 is broken"),
        ([feature("Polygon", [[[8, 50], [8, 51], [9, math.nan], [8, 50]]])], "finite"),
        ([feature("Polygon", [[[5e5, 5e6], [5e5, 6e6], [6e5, 6e6], [5e5, 5e6]]])], "EPSG:4326"),
        ([feature("Polygon", [[[50, 8], [50.0001, 8], [50, 8.0001], [50, 8]]])], "swap"),
        ([feature("Polygon", [[[9, 50], [9, 51], [10, 51], [9, 50]]])], "no building within 20 m"),
        ([square(-20, -20, 40)], "0 free cells for a landing zone of 1"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, content, named):
    path = tmp_path / "bad.geojson"
    if isinstance(content, list):
        content = {"type": "FeatureCollection", "features": content}
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=named) as error:
        city_of_footprints(path, Raster(CENTRE, cells=4, landing_cells=1))
    assert "bad" in str(error.value)


@pytest.mark.parametrize(
    "wrong", [{"centre": (95.0, 8.0)}, {"landing": (8.0, 200.0)}, {"cells": 1}, {"assumed_m": -1.0}]
)
def test_bad_options_are_named(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Raster(**{"centre": CENTRE, **wrong})


def test_a_landing_zone_outside_the_city_is_refused(made):
    longitude, latitude = degrees(21, 0)
    with pytest.raises(InputError, match=r"landing .* is outside the city"):
        made(square(-20, 10, 10), landing=(latitude, longitude))


def test_a_byte_order_mark_does_no_harm(tmp_path):
    path = tmp_path / "campus.geojson"
    path.write_bytes(b"\xef\xbb\xbf" + CAMPUS.read_bytes())
    city = city_of_footprints(path, Raster(CENTRE))[0]
    assert city.text == City.from_text("campus", DRAWN).text


def test_too_few_cells_for_the_landing_zone_is_an_error_of_the_city():
    with pytest.raises(CityError, match="full: 1 free"):
        city_of_shares("full", 1 - np.eye(1), np.zeros((1, 1)), 2)
