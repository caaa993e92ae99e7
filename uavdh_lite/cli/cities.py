"""`cities`: check cities, draw them, and save random ones."""

from pathlib import Path

from matplotlib.figure import Figure

from uavdh_lite.city import load_cities
from uavdh_lite.experiments.report import table
from uavdh_lite.plotting import draw_cities, save_figure


def cities(source: str, /, *, out: Path = Path("cities.png"), save: Path | None = None) -> None:
    """Check cities and draw them.

    Arguments:
        source: a PNG, a folder of PNGs, the name of a shipped city, or random:COUNT:SEED:SIZE.
        out: the figure.
        save: a folder to write a PNG of each city to.
    """
    found = load_cities(source)
    rows = [["", "cells on a side", "buildings", "no-fly", "cells for devices", "moves home"]]
    for city in found:
        shares = [f"{layer.mean():.0%}" for layer in (city.buildings, city.no_fly)]
        home = f"at most {city.landing_distance.max()}"
        rows.append([city.name, str(city.size), *shares, str(len(city.device_cells)), home])
    print(table(rows))
    if save is not None:
        save.mkdir(parents=True, exist_ok=True)
        for city in found:
            city.save(save / f"{city.name}.png")
    columns = min(6, len(found))
    size = 7 if len(found) == 1 else 2.15  # inches
    figure = Figure(
        figsize=(size * columns, size * -(-len(found) // columns)), layout="constrained"
    )
    draw_cities(figure, found, columns)
    save_figure(figure, out)
    print(out)
