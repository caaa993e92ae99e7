"""Footprints of buildings become a city, and every feature of their file is accounted for."""

import json
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from uavdh_lite.bridges.footprints import Raster, city_of_footprints, city_of_shares
from uavdh_lite.city import City
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.storage import data_folder

shapely = pytest.importorskip("shapely")

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


def polygon(west, south, side, centre=CENTRE):
    corners = [(0, 0), (side, 0), (side, side), (0, side), (0, 0)]
    return [degrees(west + x, south + y, centre) for x, y in corners]


def feature(kind, coordinates, **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def square(west, south, side, **properties):
    return feature("Polygon", [polygon(west, south, side)], **properties)


def in_row(*properties, side=10):
    """Squares that fill the cells of the first row, from the west."""
    return [square(10 * (k - 2), 20 - side, side, **each) for k, each in enumerate(properties)]


def collection(features, **more):
    return {"type": "FeatureCollection", **more, "features": features}


@pytest.fixture
def made(tmp_path):
    """A function that makes what the module makes, of a 4×4 city, from content of any kind."""

    def make(content, **options):
        path = tmp_path / "town.geojson"
        if isinstance(content, list):
            content = collection(content)
        content = json.dumps(content) if isinstance(content, dict) else content
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        raster = Raster(**{"centre": CENTRE, "cells": 4, "landing_cells": 1, **options})
        return city_of_footprints(path, raster)

    return make


def first_row(found):
    return found.city.text.split()[0]


def test_the_campus_is_as_drawn_and_each_feature_accounted_for():
    found = city_of_footprints(CAMPUS, Raster(CENTRE))
    assert found.city.text == City.from_text("campus", DRAWN).text
    assert found.features == {"used as buildings": 8, "left out: no building": 3}
    assert found.heights == {"height": 4, "building:levels": 3, "assumed": 1}
    assert "  3  left out: no building\n" in found.table and "1  height: assumed" in found.table


YES = {"building": "yes"}
TALL, LOW, PARK = {**YES, "height": "12"}, {**YES, "building:levels": "2"}, {"leisure": "park"}


def osm(tags, **more):
    """Properties with the tags inside, as osmtogeojson and osm2geojson write them."""
    return {"type": "way", "id": 1, "tags": tags, **more}


def lines(features, start="", end="\n"):
    return "".join(start + json.dumps(one, ensure_ascii=False) + end for one in features)


def columns(*rows):
    """Rows with all columns; what a row lacks is null, as a data frame writes it."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [{name: row.get(name) for name in names} for row in rows]


HSTORE, AS_JSON = '"height"=>"12","roof:shape"=>"flat"', '{"building:levels":"2"}'
MICROSOFT = in_row({"height": 12.3, "confidence": -1}, {"height": 5.1, "confidence": 0.9})
GEOMETRIES = [one["geometry"] for one in in_row({}, {})]
NAME = json.dumps(collection(in_row(TALL), name="é"), ensure_ascii=False)
MAKERS = {  # the form in which each writes the same town; *: no tag says what is a building
    "Overpass Turbo": (in_row({"@id": "way/1", **TALL}, {"@id": "way/2", **LOW}, PARK), "Bb.."),
    "osmtogeojson": (in_row(osm(TALL, meta={}, relations=[]), osm(LOW), osm(PARK)), "Bb.."),
    "osm2geojson": ([{**one, "tags": TALL} for one in in_row({})], "B..."),
    "geopandas": (in_row(*columns(TALL, LOW, PARK)), "Bb.."),
    "GDAL, hstore": (in_row({**YES, "other_tags": HSTORE}, {"other_tags": ""}), "B..."),
    "GDAL, JSON": (in_row({"building": None}, {**YES, "other_tags": AS_JSON}), ".b.."),
    "GDAL, clean names": (in_row({"building_part": "yes", "building_levels": 2}, PARK), "b..."),
    "GeoJSONSeq": (lines(in_row({**TALL, "name": "A\u2028B"}, LOW, PARK)), "Bb.."),
    "one feature": (in_row(TALL)[0], "B..."),
    "RFC 8142": (lines(in_row(TALL, LOW, PARK), "\x1e"), "Bb.."),
    "Windows": (b"\xef\xbb\xbf" + lines(in_row(TALL, LOW), end="\r\n\r\n").encode(), "Bb.."),
    "UTF-16": (json.dumps(collection(in_row(TALL, LOW))).encode("utf-16"), "Bb.."),
    "Microsoft": (lines(MICROSOFT), "Bb..*"),
    "Overture": (in_row({"num_floors": 5}, {"num_floors": 2}, {"is_underground": True}), "Bb..*"),
    "OSM Buildings": (in_row({"levels": 5}, {"height": 3.5, "minHeight": 0}), "Bb..*"),
    "PostGIS": ({"type": "GeometryCollection", "geometries": GEOMETRIES}, "BB..*"),
    "United States": (in_row({**YES, "height": "36'"}, {**YES, "height": "26 ft"}, PARK), "Bb.."),
    "old encoding": (NAME.encode("cp1252"), "B..."),
}


@pytest.mark.parametrize("maker", MAKERS)
def test_what_others_write_is_read(made, maker):
    content, row = MAKERS[maker]
    found, (row, *tagless) = made(content), (row[:4], *row[4:])
    assert first_row(found) == row
    assert tagless == ["*"] * any("as every polygon" in what for what in found.features)


OTHERS = {
    "Overpass JSON": ('{"version": 0.6, "elements": [{"type": "way"}]}', "Overpass JSON"),
    "CityJSON": ('{"type": "CityJSON", "CityObjects": {}}', "CityJSON"),
    "LFS": ("version https://git-lfs.github.com/spec/v1\noid sha256:1\n", "git lfs pull"),
    "zip": (b"PK\x03\x04...", "ZIP archive"),
    "XML": ('\n<?xml version="1.0"?><osm/>', "XML or HTML"),
    "half a line": ('{"type": "Feature", "geometry": null}\n{"type": ', "not JSON"),
    "no features": ([], "no buildings among its features"),
    "parks": (in_row(PARK, {"building": None}), "no buildings.*2 left out: no building"),
    "empty rings": ([feature("Polygon", []), feature("Point", [8, 50])], "2 left out: a point"),
    "no polygon": ([square(0, 0, 10), {"geometry": 7}], "feature 1 is broken"),
    "NaN": ([feature("Polygon", [[[8, 50], [8, 51], [9, math.nan], [8, 50]]])], "finite"),
    "metres": ([feature("Polygon", [[[5e5, 5e6], [5e5, 6e6], [6e5, 6e6], [5e5, 5e6]]])], "4326"),
    "full": ([square(-20, -20, 40)], "0 free cells for a landing zone of 1"),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHERS)
def test_what_cannot_be_used_is_named(made, other):
    content, named = OTHERS[other]
    with pytest.raises(InputError, match=named) as error:
        made(content)
    assert "town" in str(error.value)


def test_coordinates_elsewhere_or_swapped_are_said_to_lie_where_they_lie(made):
    for away, there in (([9, 51], "51.00000, 9.00000"), ([50, 8], r"8.00000, 50.00000")):
        corners = [away, [away[0] + 0.01, away[1]], [away[0], away[1] + 0.01], away]
        with pytest.raises(
            InputError, match=rf"no building .*between {there} and .*give a --centre"
        ):
            made([feature("Polygon", [corners])])


@pytest.mark.parametrize(
    "absent", [None, "", " ", False, "No", "false", "null", math.nan, 0, "0", 0.0]
)
def test_a_tag_that_is_absent_empty_or_false_is_absent(made, absent):
    """A park with a null of geopandas is no building, whatever stands in its other columns."""
    found = made(in_row({"building": absent, "height": "30"}, {**YES, "height": absent}, TALL))
    assert first_row(found) == ".BB." and found.heights == {"assumed": 1, "height": 1}
    part = {"building:part": "yes", "building": absent, "is_underground": absent}
    assert first_row(made(in_row(part, TALL))) == "BB.."


@pytest.mark.parametrize(
    ("properties", "kind", "source"),
    [
        ({"height": "10"}, "b", "height"),  # not higher than the UAV flies
        ({"height": "9.5 m", "building:levels": "9"}, "b", "height"),
        ({"height": "9,9"}, "b", "height"),
        ({"height": "32' 10\""}, "B", "height"),  # 10.01 m
        ({"height": "33ft"}, "B", "height"),
        ({"height": "high", "building:levels": "3"}, "b", "building:levels"),
        ({"building:levels": "3,5"}, "B", "building:levels"),
        ({"height": "5;12"}, "B", "assumed"),
        ({"height": "-3"}, "B", "assumed"),
        ({"height": "0", "building:levels": None}, "B", "assumed"),
    ],
)
def test_the_height_comes_from_the_first_tag_that_has_one(made, properties, kind, source):
    found = made(in_row({**YES, **properties}))
    assert first_row(found) == f"{kind}..." and found.heights == {source: 1}


@pytest.mark.parametrize("altitude_m", [10.0, 40.0])
def test_an_unknown_height_is_higher_than_the_uav_unless_one_is_assumed(made, altitude_m):
    assert first_row(made(in_row(YES), altitude_m=altitude_m)) == "B..."
    lower = made(in_row(YES), altitude_m=altitude_m, assumed_m=altitude_m - 1)
    assert first_row(lower) == "b..."


def test_half_of_a_cell_decides_and_what_becomes_no_cell_is_said_and_drawn(made):
    """The parts of tall and low buildings add up to what is built on."""
    tall, low = {**YES, "height": "20"}, {**YES, "height": "5"}
    found = made(
        [
            square(-20, 10, 7.2, **tall),  # 52 %
            square(-10, 10, 7.0, **tall),  # 49 %
            square(0, 10, 6.5, **tall),  # 42 % of it tall
            square(6.5, 16.5, 3.5, **low),  # and 12 % low: built on, but not tall
            square(10, 10, 7.2, **low),
            square(10, 10, 7.2, **low),  # the same again: not twice as much
            square(0, -10, 10, **tall, layer="-1"),
            square(0, 0, 10, **tall, location="underground"),
            square(20, 0, 10, **tall),  # touches the city's edge
            square(-20, -20, 10, **PARK),
            feature("LineString", polygon(0, 0, 5), **tall),
        ]
    )
    assert found.city.text.split()[:3] == ["B.bb", ".L..", "...."]
    assert found.features == {
        "used as buildings": 5,
        "left out: no cell that they touch is half built on": 1,
        "left out: underground, or on a layer below 0": 2,
        "left out: outside the city": 1,
        "left out: no building": 1,
        "left out: a point, a line or no geometry": 1,
    }
    assert found.heights == {"height": 5}
    ax = Figure().subplots()
    found.draw(ax)
    outlines = sorted((line.get_color() == "black", *line.get_xydata()[0]) for line in ax.lines)
    assert [black for black, *_ in outlines] == [False] * 3 + [True] * 5
    west = [min(line.get_xdata()) for line in ax.lines]
    assert min(west) == pytest.approx(-0.5) and max(west) == pytest.approx(2.5)


def test_a_collection_of_shapes_and_a_ring_that_crosses_itself_are_buildings(made):
    tie = [degrees(*corner) for corner in [(-20, 10), (-10, 20), (-10, 10), (-20, 20), (-20, 10)]]
    inner = {"type": "GeometryCollection", "geometries": [square(0, 10, 10)["geometry"]]}
    point = {"type": "Point", "coordinates": degrees(15, 15)}
    nested = {"type": "GeometryCollection", "geometries": [point, inner]}
    found = made([feature("Polygon", [tie]), {**square(0, 0, 1), "geometry": nested}])
    assert first_row(found) in ("B.B.", "..B.")  # two triangles: half a cell


@pytest.mark.parametrize("centre", [(-18.0, 180.0), (-18.0, -180.0), (65.0, 179.9999)])
@pytest.mark.parametrize("split", [False, True])
def test_a_city_lies_across_the_antimeridian(made, centre, split):
    """With longitudes from −180 to 180, or with some beyond."""
    ring = polygon(-20, 10, 40, centre)
    if split:
        ring = [[(longitude + 180) % 360 - 180, latitude] for longitude, latitude in ring]
    assert first_row(made([feature("Polygon", [ring])], centre=centre)) == "BBBB"


def test_the_landing_zone_is_free_and_near_the_point_and_not_in_a_courtyard(made):
    longitude, latitude = degrees(15, -15)
    found = made(in_row(YES), landing=(latitude, longitude))
    assert found.city.text.split()[3] == "...L"
    outside = degrees(21, 0)
    with pytest.raises(InputError, match=r"landing .* is outside the city"):
        made(in_row(YES), landing=(outside[1], outside[0]))
    tall = np.zeros((5, 5))
    tall[1:4, 1:4] = 1
    tall[2, 2] = 0  # the middle, which the UAV cannot leave
    zone = city_of_shares("court", tall, tall, 2).landing
    assert not zone[2, 2] and zone.sum() == 2
    with pytest.raises(CityError, match="full: 1 free"):
        city_of_shares("full", 1 - np.eye(1), np.zeros((1, 1)), 2)
