"""`city`: check a city and draw it."""

from pathlib import Path


def city(path: str, /, *, out: Path = Path("city.png")) -> None:
    """Check a city's PNG and draw it.

    Arguments:
        path: a PNG, or the name of a shipped city.
        out: the figure.
    """
    from matplotlib.figure import Figure

    from uavdh_lite.city import City
    from uavdh_lite.plotting import draw_city, save_figure

    city = City.load(path)
    farthest = city.landing_distance.max()
    unreachable = int(((city.landing_distance < 0) & ~city.no_fly).sum())
    print(f"{city.name}: {city.size} × {city.size} cells, valid")
    print(f"{len(city.landing_cells)} landing cells, {len(city.flight_cells)} cells to fly over")
    print(f"{len(city.device_cells)} cells for devices")
    print(f"at most {farthest} moves to a landing cell")
    print(f"{unreachable} flight cells without a way to one")
    figure = Figure(figsize=(7, 7), layout="constrained")
    draw_city(figure.subplots(), city)
    save_figure(figure, out)
    print(out)
