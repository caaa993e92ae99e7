"""`city`: a real place as a city, from the footprints of its buildings."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveFloat, PositiveInt
from matplotlib.figure import Figure

from uavdh_lite.bridges.footprints import Raster, city_of_footprints
from uavdh_lite.cli.options import named, output, unread
from uavdh_lite.errors import InputError
from uavdh_lite.plotting import save_figure

Pair = Annotated[str, Parameter(allow_leading_hyphen=True)]  # two numbers; the first may be < 0


def city(
    footprints: Path,
    /,
    *,
    centre: Pair,
    cells: PositiveInt = 16,
    cell_size: PositiveFloat = 10.0,
    altitude: PositiveFloat = 10.0,
    storey: PositiveFloat = 3.0,
    assumed: PositiveFloat | None = None,
    landing: Pair | None = None,
    landing_cells: PositiveInt = 6,
    out: Annotated[Path | None, named(".png")] = None,
) -> None:
    """Make a city from the footprints of buildings.

    Says what became of each feature, and draws the outlines over the cells, in NAME-outlines.svg.

    Arguments:
        footprints: GeoJSON, as Overpass Turbo or QGIS write it from OpenStreetMap.
        centre: the city's middle, LATITUDE,LONGITUDE in degrees, such as 50.0,8.0.
        cells: on a side.
        cell_size: side of a cell, m.
        altitude: at which the UAV flies, m; what is higher may not be flown over.
        storey: height of a storey, m, for buildings with building:levels and no height.
        assumed: height of buildings with neither, m. By default they are higher than the UAV flies.
        landing: LATITUDE,LONGITUDE; the free cells nearest to it are the landing zone. By default
            the middle.
        landing_cells: how many of them.
        out: the city's PNG, by default city.png.
    """
    out = output(out, "city.png", footprints)
    raster = Raster(
        _pair("centre", centre),
        cells,
        cell_size,
        altitude,
        storey,
        assumed,
        None if landing is None else _pair("landing", landing),
        landing_cells,
    )
    found, figure = city_of_footprints(footprints, raster), Figure(figsize=(7, 7.2))
    found.draw(figure.subplots())
    outlines = unread(out.with_name(f"{out.stem}-outlines.svg"), footprints)
    found.city.save(out)
    save_figure(figure, outlines)
    free = found.city.open_to_devices.sum()
    print(f"{found.city.text}\n{out}: {cells} × {cells} cells, {free} for devices")
    print(f"{outlines}: the outlines of its buildings over its cells")
    print(f"What became of the features of {footprints}:\n{found.table}")


def _pair(name: str, text: str) -> tuple[float, float]:
    """The two numbers of an option; raises `InputError` if it has no such."""
    try:
        first, second = map(float, text.split(","))
    except ValueError:
        raise InputError(
            f"--{name} {text}: write two numbers and a comma, such as 50.0,8.0"
        ) from None
    return first, second
