"""`city`: a real place as a city, from the footprints of its buildings."""

from pathlib import Path
from typing import Annotated

from matplotlib.figure import Figure

from uavdh_lite.bridges.footprints import Raster, city_of_footprints
from uavdh_lite.cli.options import named, options_of, output, with_values
from uavdh_lite.plotting import save_figure

OUTLINES = "-outlines.svg"


def city(
    footprints: Path,
    /,
    *,
    values: options_of(Raster(), "City") = None,  # type: ignore[valid-type]
    out: Annotated[Path | None, named(".png")] = None,
) -> None:
    """Make a city from the footprints of buildings.

    Says what became of each feature, and draws the outlines over the cells, in NAME-outlines.svg.

    Arguments:
        footprints: GeoJSON, as Overpass Turbo or QGIS write it from OpenStreetMap.
        out: the city's PNG, by default city.png.
    """
    raster = with_values(Raster(), values)
    found, figure = city_of_footprints(footprints, raster), Figure(figsize=(7, 7.2))
    found.draw(figure.subplots())
    with output(out, "city", ".png", OUTLINES) as out:
        outlines = out.with_name(out.stem + OUTLINES)
        found.city.save(out)
        save_figure(figure, outlines)
    free = found.city.open_to_devices.sum()
    print(f"{found.city.text}\n{out}: {raster.cells} × {raster.cells} cells, {free} for devices")
    print(f"{outlines}: the outlines of its buildings over its cells")
    print(f"What became of the features of {footprints}:\n{found.table}")
