"""A city from the footprints of buildings: GeoJSON, as Overpass Turbo or QGIS write it.

Needs the extra `footprints`. The data of OpenStreetMap is under the Open Database License.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uavdh_lite.beyond.cities import FREE, LANDING, LOW, TALL
from uavdh_lite.city import MAX_SIZE, City, connected_parts
from uavdh_lite.config import option, require, shown
from uavdh_lite.errors import CityError, InputError, extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EARTH_RADIUS_M = 6_371_009.0  # of a sphere with the Earth's mean radius
BUILDING = "building", "building:part", "building_part"  # a polygon with one of these tags is one
LEVELS = "building:levels", "building_levels", "levels", "num_floors"  # the last is Overture's
ABSENT = "", "no", "false", "none", "null", "nan", "0", "0.0"  # values that say the same as no tag
NUMBER = r"(\d+(?:\.\d+)?)\s*"
METRES = re.compile(rf"{NUMBER}(?:m|metres?|meters?)?")
FEET = re.compile(rf"{NUMBER}(?:'|′|ft|feet|foot)\s*(?:{NUMBER}(?:\"|″|''|in|inch|inches))?")
TEXT = r'"((?:[^"\\]|\\.)*)"'
PAIRS = re.compile(rf"{TEXT}\s*(?:=>|:)\s*{TEXT}")  # tags as one text, as GDAL writes them
FOOT_M, INCH_M = 0.3048, 0.0254
USED = "used as buildings"
NO_BUILDING = "left out: no building"
UNDERGROUND = "left out: underground, or on a layer below 0"
OUTSIDE = "left out: outside the city"
TOO_SMALL = "left out: no cell that they touch is half built on"

OTHERS = {  # how files begin that are not GeoJSON, and what they are
    b"version https://git-lfs": "a pointer of Git LFS and not the file: run git lfs pull",
    b"PK\x03\x04": "a ZIP archive: unpack it",
    b"<": "XML or HTML, as OpenStreetMap's own files, KML, GML and a server's error pages are",
}


@dataclass(frozen=True)
class Raster:
    """How footprints become cells.

    Raises `InputError` for a value outside its bounds.
    """

    centre: tuple[float, float] = option(
        (0.0, 0.0), "the middle of the city: latitude and longitude, degrees"
    )
    cells: int = option(16, "cells on a side", ge=2, le=MAX_SIZE)
    cell_size_m: float = option(10.0, "side of a cell, m", gt=0)
    altitude_m: float = option(10.0, "height at which the UAV flies, m", gt=0)
    storey_m: float = option(3.0, "height of a storey, for buildings with `building:levels`", gt=0)
    assumed_m: float | None = option(
        None, "height of a building that has no other, m; none: higher than the UAV flies", gt=0
    )
    landing: tuple[float, float] | None = option(
        None, "latitude and longitude of the landing zone; none: the middle"
    )
    landing_cells: int = option(6, "cells of the landing zone, the free ones nearest to it", ge=1)

    def __post_init__(self):
        require(self, "footprints")

    def cells_of(self, degrees: np.ndarray) -> np.ndarray:
        """Points (..., 2) of longitude and latitude, as column and row; whole numbers are the
        middles of cells. The cylinder that touches the sphere at the centre is unrolled."""
        latitude, longitude = self.centre
        shift = np.asarray(degrees)[..., :2] - (longitude, latitude)
        shift[..., 0] = (shift[..., 0] + 180) % 360 - 180  # the short way, also across 180°
        cell = np.radians(1) * EARTH_RADIUS_M / self.cell_size_m  # cells in a degree
        return self.cells / 2 - 0.5 + shift * (cell * np.cos(np.radians(latitude)), -cell)


@dataclass(frozen=True, eq=False)
class Footprints:
    """A city, and what became of every feature of the file that it was made from.

    | field | meaning |
    | --- | --- |
    | `city` | the city |
    | `features` | how many features were used as buildings, and how many left out, by the reason |
    | `heights` | how many of those used have their height from which tag, or an assumed one |
    | `shapes` | the buildings in the city, also those underground, as shapely's geometries in |
    | | columns and rows; and what became of each, as in `features` |
    """

    city: City
    features: Counter[str]
    heights: Counter[str]
    shapes: list[tuple[Any, str]]

    @property
    def table(self) -> str:
        """The two counts as text, a line each."""
        rows = [*self.features.items()]
        rows += [(f"height: {name}", number) for name, number in self.heights.items()]
        return "\n".join(f"{number:>7}  {name}" for name, number in rows)

    def draw(self, ax: "Axes") -> None:
        """Draw the city with the outlines over it: those that became no cell in red."""
        import shapely

        from uavdh_lite.plotting import RED, draw_city

        draw_city(ax, self.city)
        for shape, fate in self.shapes:
            for line in shapely.get_parts(shapely.boundary(shapely.get_parts(shape))):
                colour = "black" if fate.startswith(USED) else RED
                ax.plot(*shapely.get_coordinates(line).T, color=colour, linewidth=1)
        ax.set_title("outlines: black became cells, red did not", fontsize="small")


def city_of_footprints(path: str | Path, raster: Raster) -> Footprints:
    """The city in a file of GeoJSON, and what became of each of its features.

    The file holds a FeatureCollection, a Feature or a geometry, or one of these a line.

    A cell is a tall building if half of it or more is covered by what is higher than the UAV flies;
    else a low one if half of it or more is built on. A building's height is its `height`, else
    `building:levels` storeys, else the assumed one. Unless a height is to be assumed, a building of
    unknown height is higher than the UAV flies, at whatever altitude. Polygons count as buildings
    if they have the tag `building` or `building:part`, or all of them if no feature knows one of
    these; what lies underground is left out. A tag that is null, empty, false, `no` or 0 is absent.

    Raises `InputError` that names the file if it is not GeoJSON or has no building at the centre,
    `CityError` if there is no room for a landing zone or a device, and `MissingExtra` without
    shapely.
    """
    with extra("footprints"):
        import shapely

    path, half = Path(path), raster.cells * raster.cell_size_m / 2
    read = [_read(path, number, feature) for number, feature in enumerate(_features(path))]
    shapes, tags = np.array([shape for shape, _ in read]), [each for _, each in read]
    tagged = any(tag in BUILDING for each in tags for tag in each)
    used = USED if tagged else f"{USED}, as every polygon: no feature has the tag building"
    fate = np.array([_left_out(*each, tagged) for each in read], object)
    fate[fate == ""] = used
    if not (fate == used).any():
        found = ", ".join(f"{number} {why}" for why, number in Counter(fate).items())
        raise InputError(f"{path}: no buildings among its features ({found})")
    corners = shapely.get_coordinates(shapes[fate == used])
    east, north = np.abs(corners).max(axis=0)
    if east > 360 or north > 90:
        raise InputError(
            f"{path}: coordinates up to {east:g}, {north:g} are not longitude and latitude in "
            "degrees: export it in the coordinate system EPSG:4326 (WGS 84), longitude first"
        )

    edges = np.arange(raster.cells) - 0.5
    squares = shapely.box(*np.meshgrid(edges, edges), *np.meshgrid(edges + 1, edges + 1))
    shapes = shapely.make_valid(shapely.transform(shapes, raster.cells_of))
    which, cell = shapely.STRtree(squares.ravel()).query(shapes, predicate="intersects")
    touches = shapely.area(shapely.intersection(shapes[which], squares.flat[cell])) > 1e-6
    shown = np.setdiff1d(which[touches], np.flatnonzero(fate == NO_BUILDING))
    which, cell = (each[touches & (fate[which] == used)] for each in (which, cell))
    inside = np.unique(which)
    if not len(inside):
        (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
        raise InputError(
            f"{path}: no building within {half:g} m of the centre {raster.centre}; its buildings "
            f"lie between {south:.5f}, {west:.5f} and {north:.5f}, {east:.5f} (latitude, "
            "longitude): give a --centre there"
        )
    heights = {i: _height(tags[i], raster) for i in inside}
    tall = [i for i in inside if heights[i][0] > raster.altitude_m]
    tall_share, built_share = (
        shapely.area(shapely.intersection(squares, shapely.union_all(shapes[rows])))
        for rows in (tall, inside)
    )
    near = raster.cells_of(np.array((raster.landing or raster.centre)[::-1]))[::-1]
    if np.abs(near - (raster.cells - 1) / 2).max() > raster.cells / 2:
        raise InputError(f"footprints: landing {raster.landing} is outside the city")
    city = city_of_shares(path.stem, tall_share, built_share, raster.landing_cells, near)
    became = np.unique(which[city.buildings.flat[cell]])
    fate[np.setdiff1d(np.flatnonzero(fate == used), inside)] = OUTSIDE
    fate[np.setdiff1d(inside, became)] = TOO_SMALL
    sources = Counter(heights[i][1] for i in became)
    return Footprints(city, Counter(fate), sources, [(shapes[i], fate[i]) for i in shown])


def city_of_shares(
    name: str, tall: np.ndarray, built: np.ndarray, landing: int, near: Any = None
) -> City:
    """A city from how much of each cell is covered, with a landing zone.

    Arguments:
        tall: (M, M), the share of each cell with what is higher than the UAV flies.
        built: (M, M), the share that is built on at all.
        landing: cells of the landing zone: the free ones nearest to `near`, of all from which the
            UAV gets to most of the city.
        near: row and column, by default the middle.

    Raises `CityError` if not so many cells are free.
    """
    kinds = np.where(tall >= 0.5, TALL, np.where(built >= 0.5, LOW, FREE))
    near = (len(kinds) - 1) / 2 if near is None else near
    parts = connected_parts(kinds != TALL)
    free = np.argwhere((kinds == FREE) & parts[-1]) if parts else np.empty((0, 2), int)
    if len(free) < landing:
        raise CityError(
            f"{name}: {len(free)} free cells for a landing zone of {landing}: move the centre, or "
            "make the cells smaller"
        )
    nearest = np.hypot(*(free - near).T).argsort(kind="stable")[:landing]
    kinds[tuple(free[nearest].T)] = LANDING
    return City.from_kinds(name, kinds)


def _features(path: Path) -> Iterator[Any]:
    """The features of a file, as they are."""
    content = path.read_bytes()
    for start, what in OTHERS.items():
        if content.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(start):
            raise InputError(f"{path}: {what}; expected GeoJSON")
    text = content.decode(json.detect_encoding(content), "replace").strip()
    try:
        try:
            parts = [json.loads(text)]
        except json.JSONDecodeError as error:  # one a line, or RFC 8142 with a mark before each
            if error.msg != "Extra data" and not text.startswith("\x1e"):
                raise
            parts = [json.loads(line) for line in re.split("[\r\n\x1e]+", text) if line]
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON, or damaged ({error})") from None
    for part in parts:
        part = part if isinstance(part, dict) else {}
        if part.get("type") == "Feature":
            yield part
        elif isinstance(part.get("features"), list):
            yield from part["features"]
        elif "coordinates" in part or "geometries" in part:
            yield {"geometry": part}
        else:
            kind = f" of type {shown(part['type'])}" if "type" in part else ""
            raise InputError(
                f"{path}: JSON{kind}, but no GeoJSON: for Overpass JSON, run osmtogeojson, or "
                "choose Export, GeoJSON in Overpass Turbo"
            )


def _read(path: Path, number: int, feature: Any) -> tuple[Any, dict[str, str]]:
    """The polygons of a feature as one shape, in degrees, and its tags."""
    import shapely.geometry

    try:
        tags = _tags(feature)
        if not feature["geometry"]:
            return shapely.MultiPolygon(), tags
        with np.errstate(invalid="ignore"):  # found in the next line
            shape = shapely.geometry.shape(feature["geometry"])
        if not np.isfinite(shapely.get_coordinates(shape)).all():
            raise ValueError("a coordinate is not a finite number")
        parts = np.array([shape])
        while (shapely.get_type_id(parts) > shapely.GeometryType.POLYGON).any():
            parts = shapely.get_parts(parts)  # of what has several, or a collection
        polygons = parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]
        return shapely.multipolygons(polygons), tags
    except Exception as error:  # shapely raises many types for odd coordinates
        raise InputError(f"{path}: feature {number} is broken ({error})") from None


def _tags(feature: dict) -> dict[str, str]:
    """What a feature says of itself: by tag, its text in lower case; empty if absent."""
    properties = feature.get("properties") or {}
    tags: dict[str, str] = {}
    inside = properties.get("tags"), properties.get("other_tags"), feature.get("tags")
    for found in (properties, *inside):
        pairs = dict(PAIRS.findall(found)) if isinstance(found, str) else found
        for tag, value in pairs.items() if isinstance(pairs, dict) else ():
            text = str(value).strip().lower()
            tags[tag] = tags.get(tag) or ("" if text in ABSENT else text)
    return tags


def _left_out(shape: Any, tags: dict[str, str], tagged: bool) -> str:
    """Why a feature is none of the city's buildings; empty if it is one."""
    if tagged and not any(tags.get(tag) for tag in BUILDING):
        return NO_BUILDING
    if shape.is_empty:
        return "left out: a point, a line or no geometry"
    below = re.match("-[0.]*[1-9]", tags.get("layer", "")) or tags.get("is_underground")
    return UNDERGROUND if below or tags.get("location") == "underground" else ""


def _height(tags: dict[str, str], raster: Raster) -> tuple[float, str]:
    """The height of a building, m, and which tag gave it."""
    for tag, unit_m in (("height", 1.0), *((tag, raster.storey_m) for tag in LEVELS)):
        text = tags.get(tag, "").replace(",", ".")
        if found := METRES.fullmatch(text):
            height_m = float(found[1]) * unit_m
        elif found := FEET.fullmatch(text):
            height_m = float(found[1]) * FOOT_M + float(found[2] or 0) * INCH_M
        else:
            continue
        if height_m > 0:
            return height_m, tag
    return np.inf if raster.assumed_m is None else raster.assumed_m, "assumed"
