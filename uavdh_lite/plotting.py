"""Figures of cities, flights, maps and training: a function draws on an Axes, or makes a Figure."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke

from uavdh_lite.city import City
from uavdh_lite.environment import LAND, Environment, State
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.storage import write_atomically

# Okabe and Ito's colours, which colour-blind readers can tell apart; not black, which is the colour
# of a step in which nothing is uploaded. The last four devices have the colours that are furthest
# from these and from each other, for readers with red-green blindness, too.
ORANGE, BLUE, GREEN = "#E69F00", "#0072B2", "#009E73"
PINK, VERMILION, SKY_BLUE = "#CC79A7", "#D55E00", "#56B4E9"
WHITE_BELOW = colormaps["viridis"].with_extremes(under="white")
RED = "#C1272D"  # no-fly zones, crashes, errors, wrong answers
DEVICE_COLOURS = (
    *(ORANGE, BLUE, GREEN, PINK, VERMILION, SKY_BLUE),
    *("#664400", "#664466", "#0000EE", "#335544"),
)
Style = dict[str, Any]  # a patch's keyword arguments
CELL_STYLES: dict[str, Style] = {  # in the order of `City.kinds`; the first kind of cell is free
    "no-fly zone": {"facecolor": "none", "edgecolor": RED, "hatch": "////"},
    "low building: may be flown over": {
        "facecolor": "#D9C9A3",
        "edgecolor": "#6B5B35",
        "hatch": "..",
    },
    "start and landing zone": {"facecolor": "#9DC3E6", "edgecolor": "#1F4E79", "hatch": r"\\\\"},
    "tall building": {"facecolor": "#4D4D4D"},
}
SHADOW, DEEPEST = "#AFA3D1", 5  # the ground from which this many devices are hidden, or more
THIN, THICK = 0.05, 0.17  # width of an arrow, cells: for a step without data, and with much
MUCH = 4.0  # data units in a step; more of them make no arrow thicker
ASIDE = 0.14  # of a cell: arrows lie to the right of the path, so that there and back differ
FRAMES_A_SECOND, FRAMES_OF_THE_END = 7, 12  # of an animation; a frame is a step
UAV = Outline.make_compound_path(  # a marker: two arms, and a rotor at each of their ends
    *(Outline([(-1, turn), (1, -turn)]) for turn in (1, -1)),
    *(Outline.circle((x, y), 0.6) for x in (-1, 1) for y in (-1, 1)),
)


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
        depth = np.minimum(shadow_sum / DEEPEST, 1)[..., None]
        ax.imshow(1 - depth * (1 - np.array(to_rgb(SHADOW))), interpolation="nearest", zorder=0)
    for kind, style in enumerate(CELL_STYLES.values(), start=1):
        cells = np.argwhere(city.kinds == kind)
        squares = [Rectangle((col - 0.5, row - 0.5), 1, 1) for row, col in cells]
        ax.add_collection(PatchCollection(squares, zorder=1, linewidth=0, **style))
    size = city.size
    ticks = np.arange(0, size, max(1, round(size / 8)))
    ax.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5, -0.5), aspect="equal")
    ax.set(xticks=ticks, yticks=ticks, xlabel="column", ylabel="row")
    if size <= 32:
        ax.set_xticks(np.arange(0.5, size - 1), minor=True)
        ax.set_yticks(np.arange(0.5, size - 1), minor=True)
        ax.grid(which="minor", color="#DDDDDD", linewidth=0.4, zorder=0.5)
    ax.tick_params(which="both", length=0, labelsize="small")
    return ax


def shadow_sum(environment: Environment, device_cells: np.ndarray, city: int = 0) -> np.ndarray:
    """For each cell of one city, how many of these devices, (n,), it hides; (M, M) ints."""
    hidden = ~environment.sight[city, device_cells]
    return hidden.sum(axis=0).reshape(environment.size, environment.size)


def draw_cities(figure: Figure, cities: Sequence[City], columns: int) -> None:
    """Small maps of cities in an empty figure, `columns` in a row, with their names."""
    rows = -(-len(cities) // columns)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, city in zip(axes, cities, strict=False):
        draw_city(ax, city)
        ax.set(xticks=[], yticks=[], xlabel="", ylabel="")
        ax.set_title(city.name, fontsize="small", parse_math=False)
    for ax in axes[len(cities) :]:
        ax.set_axis_off()


def draw_trajectory(ax: Axes, environment: Environment, trajectory: Trajectory) -> Axes:
    """One flight in the paper's style, over the city shaded by its devices, with its caption."""
    start, number = trajectory.start, int(trajectory.start.city[0])
    city, devices = environment.cities[number], start.device_cells[start.data_initial > 0]
    draw_city(ax, city, shadow_sum(environment, devices, number))
    draw_flight(ax, city, trajectory, environment.size)
    ax.set_xlabel(f"column\n{caption(trajectory)}")
    return ax


def draw_rates(
    ax: Axes,
    environment: Environment,
    device: tuple[int, int],
    limits: tuple[float, float] | None = None,
) -> Axes:
    """Data units a slot, without fading, from a device to a UAV over each cell of the first city.

    Cells that the UAV may not enter stay as on the map.

    Arguments:
        limits: of the colours, for maps that share a bar, which is then left to the caller; cells
            with less, or with nothing, are white.
    """
    city, (low, high) = environment.cities[0], limits or (None, None)
    rates = environment.rate_map(device[0] * environment.size + device[1])
    no_fly = environment.no_fly[0].reshape(rates.shape)
    shown = np.where(no_fly, np.nan, np.maximum(rates, (low or 0) / 2))
    colours = WHITE_BELOW if limits else None  # of all rates, none is below
    picture = draw_city(ax, city).imshow(shown, colours, LogNorm(low, high), zorder=1.5)
    ax.plot(device[1], device[0], "X", color="white", mec="black", ms=12, zorder=6)
    if not limits:
        ax.figure.colorbar(picture, label="data units per slot, logarithmic scale")
    return ax


def draw_links(ax: Axes, distance_m: np.ndarray, snr_db: np.ndarray, model_db: np.ndarray) -> Axes:
    """SNRs of links over their distance, (N,) each, the line fitted to them, and the model's."""
    heard = np.isfinite(snr_db)
    x = 10 * np.log10(distance_m)
    fitted = np.polyval(np.polyfit(x[heard], snr_db[heard], 1), x)
    ax.plot(distance_m, snr_db, ".", ms=1.5, color=BLUE, rasterized=True, label="ray-traced")
    ax.plot(distance_m, model_db, color=ORANGE, lw=3, label="paper")
    ax.plot(distance_m, fitted, color=GREEN, lw=2, label="fitted to the rays")
    below = (heard & (snr_db < -90)).sum()
    ax.set_title(f"not shown: {below} below −90 dB, {(~heard).sum()} without a ray", size="small")
    ax.set(xscale="log", xlabel="3-D distance, m", ylabel="SNR, dB", ylim=(-90, 25))
    ax.set_xticks(ticks := [10, 30, 100], map(str, ticks))
    return ax


def trajectory_figure(environment: Environment, trajectory: Trajectory) -> Figure:
    """One flight in the paper's style, with the legend below it."""
    figure = Figure(figsize=(6.5, 8), layout="constrained")
    draw_trajectory(figure.subplots(), environment, trajectory)
    add_legend(figure, np.flatnonzero(trajectory.start.data_initial[0] > 0))
    return figure


def draw_flight(ax: Axes, city: City, trajectory: Trajectory, size: int) -> Axes:
    """What a flight adds to the map: its path, its devices, start and end.

    Arrows and hover marks have the colour of the device that uploaded most in that step, black if
    none did; the thicker an arrow, the more was uploaded in its step. The number next to a device
    is its data at the start. A hover mark grows with the time spent there. The UAV itself is shown
    while it is in the air.

    Arguments:
        size: cells on a side of the environment.
    """
    path = np.stack(np.divmod(trajectory.uav_cell, size), axis=1)  # row, column
    _draw_path(ax, path, trajectory)
    _draw_devices(ax, city, trajectory.start, size)
    (row, col), (last_row, last_col) = path[0], path[-1]
    ax.plot(col, row, "^", color="white", mec="black", ms=9, zorder=7)
    marker: str | Outline = UAV
    size, colour = 13, "white"
    if trajectory.landed:
        marker, size = "D", 7
    elif trajectory.time_left[-1] <= 0:
        marker, size, colour = "*", 13, RED
    ax.plot(last_col, last_row, marker=marker, color=colour, mec="black", ms=size, zorder=7)
    return ax


def _draw_path(ax: Axes, path: np.ndarray, trajectory: Trajectory) -> None:
    """An arrow for each move, and rings where the UAV hovered."""
    hovered: dict[tuple[int, int], list[str]] = {}  # the colours of the steps by cell
    for step, uploads in enumerate(-np.diff(trajectory.data_left, axis=0)):
        (row, col), (down, right) = path[step], path[step + 1] - path[step]
        colour = device_colour(uploads.argmax()) if uploads.any() else "black"
        if down or right:
            width = THIN + (THICK - THIN) * min(uploads.sum() / MUCH, 1)
            head = 2.5 * width + 0.15  # thin arrows keep a head that one can see
            x, y = col - ASIDE * down, row + ASIDE * right  # y points south here
            shape = {"width": width, "head_width": head, "head_length": head, "linewidth": 0}
            shape |= {"length_includes_head": True, "zorder": 4}
            ax.arrow(x, y, right, down, color=colour, **shape)
        elif trajectory.action[step] != LAND or trajectory.intervened[step]:
            hovered.setdefault((row, col), []).append(colour)
    for (row, col), colours in hovered.items():
        for ring, (colour, count) in enumerate(Counter(colours).items()):
            size = 5 + 3 * ring + 1.5 * np.sqrt(count)
            ax.plot(col, row, "o", mfc="none", mec=colour, zorder=5, ms=size, mew=1.4)


def _draw_devices(ax: Axes, city: City, start: State, size: int) -> None:
    """The devices of an episode with their data at the start."""
    for device in np.flatnonzero(start.data_initial[0] > 0):
        row, col = divmod(int(start.device_cells[0, device]), size)
        colour = device_colour(device)
        ax.plot(col, row, "X", color=colour, mec="white", mew=0.8, ms=11, zorder=6)
        east = col < city.size - 1  # there is room for the number
        ax.annotate(
            f"{start.data_initial[0, device]:.0f}",
            (col, row),
            (7 if east else -7, -13 if row == 0 else 5),
            ha="left" if east else "right",
            textcoords="offset points",
            fontsize="small",
            fontweight="bold",
            color=colour,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
            zorder=8,
        )


def caption(trajectory: Trajectory) -> str:
    """The paper's caption: time used/available; data collected/available."""
    time, data = trajectory.time_left, trajectory.data_left.sum(axis=1)
    return f"Time {time[0] - time[-1]}/{time[0]}; data {data[0] - data[-1]:.1f}/{data[0]:.1f}"


def add_legend(figure: Figure, devices: int | Iterable[int]) -> None:
    """The legend of trajectory figures, below all Axes; `player.js` has the same words.

    Arguments:
        devices: how many, or the numbers of those that are drawn.
    """
    numbers = range(devices) if isinstance(devices, int) else devices
    ground = CELL_STYLES | {"shadow: no line of sight to a device": {"facecolor": SHADOW}}
    move = "move: thicker for more data, in the colour of its device"
    signs: list[tuple[str, str | Outline, Style]] = [
        *((f"device {k}", "X", {"color": device_colour(k), "ms": 10}) for k in numbers),
        ("UAV", UAV, {"mfc": "white", "ms": 12}),
        ("start", "^", {"mfc": "white", "ms": 9}),
        ("landing", "D", {"mfc": "white", "ms": 7}),
        ("crash", "*", {"mfc": RED, "ms": 13}),
        (move, "$→$", {"mfc": "black", "ms": 12}),
        ("hovering", "o", {"mfc": "none", "mew": 1.4, "ms": 8}),
    ]
    handles: list[Artist] = [
        Patch(label=label, linewidth=0, **style) for label, style in ground.items()
    ]
    handles += [
        Line2D([], [], linestyle="none", marker=marker, label=label, **{"color": "black", **style})
        for label, marker, style in signs
    ]
    columns = 3 if figure.get_figwidth() >= 9 else 2
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, fontsize="small", frameon=False
    )


def draw_curves(
    ax: Axes, runs: list[dict[str, np.ndarray]], metric: str, label: str | None = None, **style
) -> Axes:
    """A training curve: the mean over runs, and their 99 % quantile range, by steps.

    Runs that have their rows at different steps have no such mean. Each is a line of its own then.

    Arguments:
        runs: from `read_table`.
        metric: a column's name.
    """
    steps, values = ([run[name] for run in runs] for name in ("steps", metric))
    if all(np.array_equal(own, steps[0]) for own in steps):
        (line,) = ax.plot(steps[0], np.mean(values, axis=0), label=label, **style)
        if len(runs) > 1:
            low, high = np.quantile(values, [0.005, 0.995], axis=0)
            ax.fill_between(steps[0], low, high, color=line.get_color(), alpha=0.35, linewidth=0)
    else:
        for own, of_run in zip(steps, values, strict=True):
            (line,) = ax.plot(own, of_run, label=label, **style)
            style, label = {**style, "color": line.get_color()}, None
    ax.set(xlabel="environment steps", ylabel=metric.replace("_", " "))
    return ax


def draw_study(figure: Figure, table: dict[str, np.ndarray]) -> None:
    """The training curves of a study's variants: return, and collected and landed.

    Arguments:
        table: from `read_table` of a study's `training.csv.gz`.
    """
    axes = figure.subplots(1, 2)
    for variant in dict.fromkeys(table["variant"].tolist()):
        of_variant = table["variant"] == variant
        seeds = [of_variant & (table["seed"] == s) for s in np.unique(table["seed"][of_variant])]
        runs = [{name: column[rows] for name, column in table.items()} for rows in seeds]
        for ax, metric in zip(axes, ("return", "collected_and_landed"), strict=True):
            draw_curves(ax, runs, metric, label=variant.replace("_", " "))
    axes[0].legend()


def draw_maps(
    maps: dict[str, np.ndarray], numbers: bool = False, uav: tuple[int, int] | None = None
) -> Figure:
    """Small pictures of arrays with their names, three in a row: white is 0, blue more, red less.

    Arguments:
        maps: name and values, (rows, columns), of each; tensors will do.
        numbers: write the value of each cell into it.
        uav: the (row, column) to mark in each picture with a triangle.
    """
    rows = -(-len(maps) // 3)
    figure = Figure(figsize=(7, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False).ravel()
    for ax in axes:
        ax.set_axis_off()
    for ax, (name, given) in zip(axes, maps.items(), strict=False):
        values = np.asarray(given)
        most = abs(values).max() or 1
        ax.imshow(values, "RdBu", vmin=-most, vmax=most)
        ax.add_patch(Rectangle((0, 0), 1, 1, transform=ax.transAxes, fill=False, edgecolor="0.5"))
        ax.set_title(name, fontsize="medium")
        if uav:
            ax.plot(uav[1], uav[0], "^", color="black", mec="white", ms=6)
        for (row, col), value in np.ndenumerate(values) if numbers else ():
            colour = "white" if abs(value) > 0.6 * most else "black"
            ax.text(col, row, f"{value.round(1) + 0:g}", ha="center", va="center", color=colour)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file, atomically; the format follows the suffix, which is else `.png`."""
    path = Path(path) if Path(path).suffix else Path(f"{path}.png")
    write_atomically(path, lambda temporary: figure.savefig(temporary, dpi=150))


def pixels(figure: Figure) -> np.ndarray:
    """The picture of a figure, (height, width, 3) uint8."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def save_animation(environment: Environment, trajectory: Trajectory, path: str | Path) -> None:
    """Write a flight as a GIF that plays in any browser, one frame per step, atomically."""
    city = environment.cities[int(trajectory.start.city[0])]
    figure = Figure(figsize=(5, 5.2), dpi=100, layout="constrained")
    ax, last = figure.subplots(), len(trajectory.action)

    def draw(steps: int) -> None:
        names = ("uav_cell", "time_left", "data_left")
        begun = {name: getattr(trajectory, name)[: steps + 1] for name in names}
        flown = replace(trajectory, landed=trajectory.landed and steps == last, **begun)
        ax.clear()
        draw_flight(draw_city(ax, city), city, flown, environment.size)
        ax.set(xlabel=caption(flown), ylabel="", xticks=[], yticks=[])

    frames = [*range(last + 1), *[last] * FRAMES_OF_THE_END]
    film = FuncAnimation(figure, draw, frames, init_func=lambda: None)
    write_atomically(path, lambda temporary: film.save(temporary, PillowWriter(FRAMES_A_SECOND)))
