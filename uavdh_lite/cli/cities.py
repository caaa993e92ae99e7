"""`cities`: draw random cities."""

from pathlib import Path


def cities(
    *,
    count: int = 8,
    seed: int = 0,
    out: Path = Path("cities"),
    size: int = 16,
    largest: int | None = None,
    kind: tuple[str, ...] | None = None,
    figure: Path | None = None,
) -> None:
    """Draw random cities, and write a PNG of each.

    Arguments:
        count: how many.
        seed: of the random numbers; a larger count begins with the same cities.
        out: the folder for the cities.
        size: cells on a side.
        largest: cells on a side of the largest; then --size is those of the smallest.
        kind: kinds of city: blocks, scattered, courtyards, old_town; all of them if not given.
        figure: a picture of all of them.
    """
    from uavdh_lite.city_generator import CityGenerator

    sizes = size, size if largest is None else largest
    generator = CityGenerator(sizes) if kind is None else CityGenerator(sizes, kinds=kind)
    drawn = generator.draw(count, seed)
    out.mkdir(parents=True, exist_ok=True)
    for city in drawn.cities:
        path = out / f"{city.name}.png"
        city.save(path)
        print(f"{path}  buildings {city.buildings.mean():.0%}, no-fly {city.no_fly.mean():.0%}")
    if figure is not None:
        from matplotlib.figure import Figure

        from uavdh_lite.plotting import draw_cities, save_figure

        columns = min(6, count)
        rows = -(-count // columns)
        page = Figure(figsize=(2 * columns, 2.15 * rows), layout="constrained")
        draw_cities(page, drawn, columns)
        save_figure(page, figure)
        print(figure)
