"""The figures of the paper, each a function that draws on an Axes and returns it."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from PIL import Image

from uavdh_lite.city import Cities, City
from uavdh_lite.environment import LAND, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory, alone
from uavdh_lite.storage import write_atomically

# Okabe and Ito's colours, which colour-blind readers can tell apart; not black, which is the colour
# of a step in which nothing is uploaded.
ORANGE, BLUE, GREEN = "#E69F00", "#0072B2", "#009E73"
PINK, VERMILION, SKY_BLUE = "#CC79A7", "#D55E00", "#56B4E9"
RED = "#C1272D"  # no-fly zones, crashes, errors, wrong answers
DEVICE_COLOURS = (
    *(ORANGE, BLUE, GREEN, PINK, VERMILION, SKY_BLUE),
    *("#8C6D1F", "#5E4FA2", "#A6761D", "#1B9E77"),
)
Style = dict[str, Any]  # a patch's keyword arguments
NO_FLY: Style = {"facecolor": "none", "edgecolor": RED, "hatch": "////", "linewidth": 0}
LANDING: Style = {
    "facecolor": "#9DC3E6",
    "edgecolor": "#1F4E79",
    "hatch": "\\\\\\\\",
    "linewidth": 0,
}
TALL: Style = {"facecolor": "#4D4D4D", "linewidth": 0}
LOW: Style = {"facecolor": "#D9C9A3", "edgecolor": "#6B5B35", "hatch": "..", "linewidth": 0}
SHADOW, DEEPEST = "#AFA3D1", 5  # the ground from which this many devices are hidden, or more
THIN, THICK = 0.05, 0.17  # width of an arrow, cells: nothing uploaded, and as much as in any step
LEVELS = 4  # widths in between
MUCH = 1.0  # data units in a step that the widest arrow stands for at the least


def device_colour(device: int | np.integer) -> str:
    """The colour of a device, the same in every figure."""
    return DEVICE_COLOURS[device % len(DEVICE_COLOURS)]


def draw_city(ax: Axes, city: City, shadow_sum: np.ndarray | None = None) -> Axes:
    """The city as a map, north up; cell (row, col) is a unit square centred at x = col, y = row.

    Arguments:
        shadow_sum: (M, M), for how many devices a cell lies in a building's shadow, from the
            function `shadow_sum`; the more, the deeper the violet.
    """
    if shadow_sum is not None:
        ax.imshow(shadow_colours(shadow_sum), interpolation="nearest", zorder=0)
    tall = city.buildings & city.no_fly
    for mask, style in (
        (city.landing, LANDING),
        (city.buildings & ~city.no_fly, LOW),
        (tall, TALL),
        (city.no_fly & ~tall, NO_FLY),
    ):
        cells = [Rectangle((col - 0.5, row - 0.5), 1, 1) for row, col in np.argwhere(mask)]
        ax.add_collection(PatchCollection(cells, zorder=1, **style))
    ax.set(xlim=(-0.5, city.size - 0.5), ylim=(city.size - 0.5, -0.5), aspect="equal")
    step = max(1, round(city.size / 8))
    ticks = np.arange(0, city.size, step)
    ax.set(xticks=ticks, yticks=ticks, xlabel="column", ylabel="row")
    if city.size <= 32:
        ax.set_xticks(np.arange(0.5, city.size - 1), minor=True)
        ax.set_yticks(np.arange(0.5, city.size - 1), minor=True)
        ax.grid(which="minor", color="#DDDDDD", linewidth=0.4, zorder=0.5)
    ax.tick_params(which="both", length=0, labelsize="small")
    return ax


def shadow_colours(hidden: np.ndarray) -> np.ndarray:
    """Colours from white to `SHADOW` for numbers of hidden devices; (..., 3)."""
    depth = np.sqrt(np.minimum(hidden / DEEPEST, 1))[..., None]
    return 1 - depth * (1 - np.array(to_rgb(SHADOW)))


def draw_cities(figure: Figure, cities: Cities, columns: int) -> None:
    """Small maps of cities in an empty figure, `columns` in a row, with their names."""
    rows = -(-len(cities) // columns)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, city in zip(axes, cities.cities, strict=False):
        draw_city(ax, city)
        ax.set(xticks=[], yticks=[], xlabel="", ylabel="")
        ax.set_title(city.name, fontsize="small")
    for ax in axes[len(cities) :]:
        ax.set_axis_off()


def shadow_sum(environment: Environment, device_cells: np.ndarray) -> np.ndarray:
    """For each cell, how many of these devices, (n,), a UAV there cannot see; (M, M) ints."""
    hidden = ~environment.line_of_sight[device_cells]
    return hidden.sum(axis=0).reshape((environment.city.size,) * 2)


def draw_trajectory(ax: Axes, environment: Environment, trajectory: Trajectory) -> Axes:
    """One flight in the paper's style, over the city shaded by its devices, with its caption."""
    environment, trajectory = alone(environment, trajectory)
    city, start = environment.cities[0], trajectory.start
    used = np.flatnonzero(start.data_initial[0] > 0)
    draw_city(ax, city, shadow_sum(environment, start.device_cells[0][used]))
    draw_flight(ax, city, trajectory)
    ax.set_xlabel(f"column\n{caption(trajectory)}")
    return ax


def draw_flight(
    ax: Axes, city: City, trajectory: Trajectory, steps: int | None = None
) -> list[Artist]:
    """What a flight adds to the map: its path, its devices, start and end; returns the artists.

    Arrows and hover marks have the colour of the device that uploaded most in that step, black if
    none did; the thicker an arrow, the more was uploaded in its step. The number next to a device
    is its data at the start. Arrows are drawn a little to the right of the path, so that there and
    back differ; a hover mark grows with the time spent there.

    Arguments:
        steps: draw only this many steps, and the UAV where it then is; None for all.
    """
    total = len(trajectory.action)
    steps = total if steps is None else min(steps, total)
    row, col = np.divmod(trajectory.uav_cell[: steps + 1], city.size)
    action = trajectory.action[:steps]
    intervened = trajectory.intervened[:steps].astype(bool)  # also of no steps at all
    colours = np.array([_step_colour(trajectory, t) for t in range(steps)], dtype=object)
    down, right = np.diff(row), np.diff(col)
    moved = (down != 0) | (right != 0)
    artists: list[Artist] = []
    widths = _arrow_widths(trajectory)[:steps]
    for width in np.unique(widths[moved]):
        these = moved & (widths == width)
        aside = 0.14  # of a cell, to the right of the direction of flight; y points south here
        artists.append(
            ax.quiver(
                col[:-1][these] - aside * down[these],
                row[:-1][these] + aside * right[these],
                right[these],
                down[these],
                color=list(colours[these]),
                angles="xy",
                scale_units="xy",
                scale=1,
                units="xy",
                width=width,
                headwidth=2 + 0.17 / width,  # thin arrows keep a head that one can see
                headlength=2 + 0.17 / width,
                headaxislength=1.8 + 0.17 / width,
                zorder=4,
            )
        )
    hovered = ~moved & (action != LAND) | intervened
    for cell in np.unique(trajectory.uav_cell[:steps][hovered]):
        here = hovered & (trajectory.uav_cell[:steps] == cell)
        y, x = divmod(int(cell), city.size)
        for ring, colour in enumerate(dict.fromkeys(colours[here])):
            size = 5 + 3 * ring + 1.5 * np.sqrt((here & (colours == colour)).sum())
            artists += ax.plot(x, y, "o", mfc="none", mec=colour, zorder=5, ms=size, mew=1.4)
    artists += _draw_devices(ax, city, trajectory)
    artists += ax.plot(col[0], row[0], "^", color="white", mec="black", ms=9, zorder=7)
    in_the_air = steps < total or (not trajectory.landed and trajectory.time_left[-1] > 0)
    if in_the_air:
        artists += ax.plot(col[-1], row[-1], "o", color="white", mec="black", ms=9, zorder=7)
    elif trajectory.landed:
        artists += ax.plot(col[-1], row[-1], "D", color="white", mec="black", ms=7, zorder=7)
    else:
        artists += ax.plot(col[-1], row[-1], "*", color=RED, mec="black", ms=13, zorder=7)
    return artists


def _arrow_widths(trajectory: Trajectory) -> np.ndarray:
    """The width of each step's arrow, cells: by what it uploaded, in a few levels; (T,).

    The widest is the largest upload of the flight, but at least `MUCH`.
    """
    uploaded = -np.diff(trajectory.data_left.sum(axis=1))
    share = uploaded / uploaded.max(initial=MUCH)
    return THIN + (THICK - THIN) * np.ceil(LEVELS * share) / LEVELS


def _draw_devices(ax: Axes, city: City, trajectory: Trajectory) -> list[Artist]:
    """The devices of an episode with their data at the start, written where the route is not."""
    artists: list[Artist] = []
    start = trajectory.start
    devices = np.flatnonzero(start.data_initial[0] > 0)
    crowd = np.full((city.size + 2, city.size + 2), 1000)  # a border without room
    crowd[1:-1, 1:-1] = 0
    for cells in (trajectory.uav_cell, start.device_cells[0, devices]):
        row, col = np.divmod(cells.astype(int), city.size)
        np.add.at(crowd, (row + 1, col + 1), 1)
    for device in devices:
        y, x = divmod(int(start.device_cells[0, device]), city.size)
        colour = device_colour(device)
        artists += ax.plot(x, y, "X", color=colour, mec="white", mew=0.8, ms=11, zorder=6)
        east, south = min(
            ((1, 0), (-1, 0), (1, 1), (-1, 1)),  # north-east if all are equally good
            key=lambda side: _crowd_at(crowd[y : y + 3, x : x + 3], *side),
        )
        artists.append(
            ax.annotate(
                f"{start.data_initial[0, device]:.0f}",
                (x, y),
                (7 * east, -13 if south else 5),
                ha="right" if east < 0 else "left",
                textcoords="offset points",
                fontsize="small",
                fontweight="bold",
                color=colour,
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
                zorder=8,
            )
        )
    return artists


def _crowd_at(around: np.ndarray, east: int, south: int) -> int:
    """What is in the way of a label in a corner of 3×3 cells: twice in the corner itself."""
    row, col = (2 if south else 0), 1 + east
    return int(2 * around[row, col] + around[row, 1] + around[1, col])


def _step_colour(trajectory: Trajectory, step: int) -> str:
    uploaded = trajectory.data_left[step] - trajectory.data_left[step + 1]
    return device_colour(uploaded.argmax()) if uploaded.max() > 0 else "black"


def caption(trajectory: Trajectory) -> str:
    """The paper's caption: time used/available; data collected/available."""
    used, available = len(trajectory.action), trajectory.time_left[0]
    data = trajectory.start.data_initial.sum()
    collected = data - trajectory.data_left[-1].sum()
    return f"Time {used}/{available}; data {collected:.1f}/{data:.1f}"


def add_legend(figure: Figure, devices: int) -> None:
    """The legend of trajectory figures, below all Axes, for this number of devices."""

    def mark(marker, label, **style):
        return Line2D([], [], linestyle="none", marker=marker, label=label, **style)

    handles = [
        Patch(label="start and landing zone", **LANDING),
        Patch(label="no-fly zone", **NO_FLY),
        Patch(label="tall building", **TALL),
        Patch(label="low building: may be flown over", **LOW),
        Patch(label="shadow, deeper for more devices", facecolor=SHADOW),
        mark("^", "start", mfc="white", mec="black", ms=9),
        mark("D", "landing", mfc="white", mec="black", ms=7),
        mark("*", "crash", mfc=RED, mec="black", ms=13),
        mark("$→$", "move: thicker for more data, black for none", color="black", ms=12),
        mark("o", "hovering", mfc="none", mec="black", mew=1.4, ms=8),
    ]
    handles += [
        mark("X", f"device {k}, and moves while it is served", color=device_colour(k), ms=10)
        for k in range(devices)
    ]
    columns = 3 if figure.get_figwidth() >= 9 else 2
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, fontsize="small", frameon=False
    )


def draw_curves(
    ax: Axes, runs: list[dict[str, np.ndarray]], metric: str, label: str | None = None, **style
) -> Axes:
    """A training curve: the mean over runs and the range that holds 99 % of them, by steps.

    Arguments:
        runs: from `read_table`, all with rows at the same steps.
        metric: a column's name.
    """
    values = np.stack([run[metric] for run in runs])
    steps = runs[0]["steps"]
    (line,) = ax.plot(steps, values.mean(axis=0), label=label, **style)
    if len(runs) > 1:
        low, high = np.quantile(values, [0.005, 0.995], axis=0)
        ax.fill_between(steps, low, high, color=line.get_color(), alpha=0.35, linewidth=0)
    ax.set(xlabel="environment steps", ylabel=metric.replace("_", " "))
    return ax


def draw_study(figure: Figure, table: dict[str, np.ndarray]) -> None:
    """The training curves of a study's variants: cumulative reward, collected and landed.

    Arguments:
        table: from `read_table` of a study's `training.csv.gz`.
    """
    axes = figure.subplots(1, 2)
    for ax, metric in zip(axes, ("cumulative_reward", "collection_ratio_and_landed"), strict=True):
        for variant in dict.fromkeys(table["variant"].tolist()):
            of_variant = table["variant"] == variant
            runs = [
                {
                    name: column[of_variant & (table["seed"] == seed)]
                    for name, column in table.items()
                }
                for seed in np.unique(table["seed"][of_variant])
            ]
            draw_curves(ax, runs, metric, label=variant.replace("_", " "))
    axes[0].legend()


def draw_layers(ax: Axes, layers: list[tuple[str, tuple[int, ...], str]]) -> Axes:
    """A sketch of a network: what comes out of each layer, from left to right.

    Arguments:
        layers: name, shape and colour of each. (C, H, W) is drawn as a stack of C squares, (N,) as
            a bar whose height grows with log N.
    """
    x = 0.0
    for name, shape, colour in layers:
        if len(shape) == 3:
            count, side, _ = shape
            corners = [(x + 0.9 * k, 0.9 * k - side / 2) for k in range(count)]
            size, end = (side, side), x + side + 0.9 * count
        else:
            height = max(4 * np.log2(shape[0]), 1)
            corners, size, end = [(x, -height / 2)], (3, height), x + 3
        for depth, corner in enumerate(corners):
            square = Rectangle(corner, *size, fc=colour, ec="white", lw=0.5, zorder=-depth)
            ax.add_patch(square)
        words = "×".join(map(str, shape)) + "\n" + name
        ax.text((x + end) / 2, -32, words, ha="center", va="top", fontsize="small")
        x = end + (12 if len(shape) == 3 else 22)
    ax.set(xlim=(-8, x), ylim=(-56, 32), aspect="equal")
    ax.axis("off")
    return ax


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file, atomically; the format follows the suffix.

    Raises `InputError` if matplotlib has no format for that suffix.
    """
    formats = figure.canvas.get_supported_filetypes()
    if Path(path).suffix.removeprefix(".").lower() not in formats:
        known = ", ".join(sorted(formats))
        raise InputError(f"{path}: no picture format has this suffix; choose one of {known}")
    write_atomically(path, lambda temporary: figure.savefig(temporary, dpi=150))


def pixels(figure: Figure) -> np.ndarray:
    """The picture of a figure, (height, width, 3) uint8."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def png(picture: Figure | np.ndarray, dpi: int = 100) -> bytes:
    """A figure, or a picture as an (height, width, 3) uint8 array, as a PNG file's bytes."""
    buffer = io.BytesIO()
    if isinstance(picture, Figure):
        picture.savefig(buffer, format="png", dpi=dpi)
    else:
        Image.fromarray(picture).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


def save_animation(
    city: City, trajectory: Trajectory, path: str | Path, step_ms: int = 140
) -> None:
    """Write a flight as a GIF that plays in any browser, one frame per step, atomically.

    Next to the map are the data left at each device and the flying time left.

    Arguments:
        step_ms: how long a step is shown, ms; the last one is shown for three seconds.
    """
    start, steps = trajectory.start, len(trajectory.action)
    used = np.flatnonzero(start.data_initial[0] > 0)
    figure = Figure(figsize=(7, 4.8), dpi=100, layout="constrained")
    ax, bars = figure.subplots(1, 2, width_ratios=(4, 1))
    draw_city(ax, city)
    ax.set(xlabel="", ylabel="", xticks=[], yticks=[])
    labels = [*(f"device {k}" for k in used), "flying time"]
    full = np.array([*trajectory.data_left[0, used], trajectory.time_left[0]], float)
    colours = [*(device_colour(k) for k in used), "black"]
    rows = np.arange(len(labels))
    bars.barh(rows, 1, 0.5, color="#EEEEEE")
    bars.set(xlim=(0, 1), xticks=[], yticks=rows, yticklabels=labels, title="what is left")
    bars.invert_yaxis()
    bars.spines[:].set_visible(False)
    bars.tick_params(length=0)
    frames = []
    for step in range(steps + 1):
        artists: list[Artist] = draw_flight(ax, city, trajectory, step)
        left = np.array([*trajectory.data_left[step, used], trajectory.time_left[step]]) / full
        artists += bars.barh(rows, left, 0.5, color=colours)
        frames.append(Image.fromarray(pixels(figure)).quantize(64, dither=Image.Dither.NONE))
        for artist in artists:
            artist.remove()
    durations = [step_ms] * steps + [3000]
    write_atomically(
        path,
        lambda temporary: frames[0].save(
            temporary, save_all=True, append_images=frames[1:], duration=durations, loop=0
        ),
    )
