"""A city from the footprints of buildings: GeoJSON, as Overpass Turbo or QGIS write it.

Needs the extra `footprints`. The data of OpenStreetMap is under the Open Database License.
"""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavdh_lite.beyond.cities import FREE, LANDING, LOW, TALL
from uavdh_lite.city import MAX_SIZE, City, connected_parts
from uavdh_lite.config import option, require
from uavdh_lite.errors import CityError, InputError, extra
from uavdh_lite.storage import read_json

EARTH_RADIUS_M = 6_371_009.0  # of a sphere with the Earth's mean radius
LARGEST = 100_000_000  # bytes; the buildings of a large town
BUILDING = "building", "building:part"  # a polygon with one of these, and not `no`, is one
NUMBER = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(?:m|metres|meters)?\s*")
Point = tuple[float, float]


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
        for name in ("centre", "landing"):
            place = getattr(self, name)
            if place is not None and not (abs(place[0]) < 90 and abs(place[1]) <= 180):
                raise InputError(f"footprints: {name} is {place}: give latitude, then longitude")

    def metres(self, degrees: np.ndarray) -> np.ndarray:
        """Points (..., 2) of longitude and latitude, as x to the east and y to the north of the
        centre, m: the cylinder that touches the sphere there, unrolled."""
        latitude, longitude = self.centre
        shift = np.radians(np.asarray(degrees)[..., :2] - (longitude, latitude))
        return EARTH_RADIUS_M * shift * (np.cos(np.radians(latitude)), 1)


def city_of_footprints(path: str | Path, raster: Raster) -> tuple[City, Counter[str]]:
    """The city in a GeoJSON file, and how many of its buildings have their height from where.

    A cell is a tall building if half of it or more is covered by what is higher than the UAV flies;
    else a low one if half of it or more is built on. A building's height is its `height`, else
    `building:levels` storeys, else the assumed one; the second result counts these three. Unless a
    height is to be assumed, a building of unknown height is higher than the UAV flies, at whatever
    altitude. Polygons count as buildings if they have the property `building` or `building:part`,
    or all of them if none has.

    Raises `InputError` that names the file if it is not GeoJSON or has no building at the centre,
    `CityError` if there is no room for a landing zone or a device, and `MissingExtra` without
    shapely.
    """
    with extra("footprints"):
        import shapely

    path = Path(path)
    buildings = _buildings(path)
    corners = np.concatenate([shapely.get_coordinates(shape) for shape, _ in buildings])
    _require_degrees(path, corners, raster)
    half = raster.cells * raster.cell_size_m / 2
    near = None
    if raster.landing is not None:
        right, up = raster.metres(np.array(raster.landing[::-1]))
        if max(abs(right), abs(up)) > half:
            raise InputError(
                f"footprints: landing {raster.landing} is outside the city: it has {half:g} m "
                f"on each side of the centre {raster.centre}"
            )
        near = ((half - up) / raster.cell_size_m - 0.5, (half + right) / raster.cell_size_m - 0.5)
    edges = np.linspace(-half, half, raster.cells + 1)
    west, north = np.meshgrid(edges[:-1], edges[:0:-1])
    squares = shapely.box(west, north - raster.cell_size_m, west + raster.cell_size_m, north)
    city, sources = shapely.box(-half, -half, half, half), Counter[str]()
    tall: list[Any] = []
    low: list[Any] = []
    for shape, properties in buildings:
        shape = shapely.make_valid(shapely.transform(shape, raster.metres))
        if shape.intersects(city):
            height, source = _height(properties, raster)
            sources[source] += 1
            (tall if height > raster.altitude_m else low).append(shape)
    if not sources:
        (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
        raise InputError(
            f"{path}: no building within {half:g} m of the centre {raster.centre}; its buildings "
            f"lie between {south:.5f}, {west:.5f} and {north:.5f}, {east:.5f} (latitude, longitude)"
        )
    tall_share, built_share = (
        shapely.area(shapely.intersection(squares, shapely.union_all(shapes)))
        / raster.cell_size_m**2
        for shapes in (tall, tall + low)
    )
    return city_of_shares(path.stem, tall_share, built_share, raster.landing_cells, near), sources


def city_of_shares(
    name: str, tall: np.ndarray, built: np.ndarray, landing: int, near: Point | None = None
) -> City:
    """A city from how much of each cell is covered, with a landing zone.

    Arguments:
        tall: (M, M), the share of each cell with what is higher than the UAV flies.
        built: (M, M), the share that is built on at all.
        landing: cells of the landing zone: the free ones nearest to `near`, of all from which the
            UAV gets to most of the city.
        near: (row, column), by default the middle.

    Raises `CityError` if not so many cells are free.
    """
    kinds = np.where(tall >= 0.5, TALL, np.where(built >= 0.5, LOW, FREE))
    near = near or ((len(kinds) - 1) / 2,) * 2
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


def _buildings(path: Path) -> list[tuple[Any, dict]]:
    """The buildings of a file: shape, in degrees, and properties."""
    import shapely.errors
    import shapely.geometry

    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: {path.stat().st_size} bytes: export a smaller area")
    content = read_json(path)
    if not isinstance(content.get("features"), list):
        raise InputError(f"{path}: no list of features: export it as GeoJSON")
    polygons = []
    for number, feature in enumerate(content["features"]):
        try:
            geometry, properties = feature["geometry"] or {}, feature.get("properties") or {}
            if geometry.get("type") in ("Polygon", "MultiPolygon"):
                with np.errstate(invalid="ignore"):  # found in the next line
                    shape = shapely.geometry.shape(geometry)
                if not np.isfinite(shapely.get_coordinates(shape)).all():
                    raise ValueError("a coordinate is not a finite number")
                if not shape.is_empty:  # as GeoJSON says "no geometry", too
                    polygons.append((shape, dict(properties)))
        except (
            ValueError,
            TypeError,
            LookupError,
            OverflowError,
            AttributeError,
            shapely.errors.ShapelyError,
        ) as error:
            raise InputError(f"{path}: feature {number} is broken ({error})") from None
    tagged = [one for one in polygons if any(one[1].get(tag, "no") != "no" for tag in BUILDING)]
    if not polygons:
        raise InputError(
            f"{path}: {len(content['features'])} features and no polygon among them: export "
            "buildings, ways and relations, with their geometry"
        )
    return tagged or polygons


def _require_degrees(path: Path, corners: np.ndarray, raster: Raster) -> None:
    """Raise `InputError` unless the corners, (n, 2), can be longitude and latitude."""
    far = np.abs(corners).max(axis=0)
    if far[0] > 180 or far[1] > 90:
        raise InputError(
            f"{path}: coordinates up to {far[0]:g}, {far[1]:g} are not longitude and latitude in "
            "degrees: export it in the coordinate system EPSG:4326 (WGS 84)"
        )
    half = raster.cells * raster.cell_size_m / 2
    near = [
        (np.abs(raster.metres(order)) <= half).all(axis=1).any()
        for order in (corners, corners[:, ::-1])
    ]
    if not near[0] and near[1]:
        raise InputError(
            f"{path}: its coordinates are latitude, longitude; GeoJSON has longitude first: swap "
            "them"
        )


def _height(properties: dict, raster: Raster) -> tuple[float, str]:
    """The height of a building, m, and which property gave it."""
    for name, unit in (("height", 1.0), ("building:levels", raster.storey_m)):
        found = NUMBER.fullmatch(str(properties.get(name, "")))
        if found and float(found[1]) > 0:
            return float(found[1]) * unit, name
    return np.inf if raster.assumed_m is None else raster.assumed_m, "assumed"
