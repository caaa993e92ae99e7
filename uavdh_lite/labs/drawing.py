"""What the stage of the labs plays: the city and the flights as SVG, made in Python.

`drawing.js` plays it. Each thing that appears in the course of a flight has the steps in which it
is there.
"""

import base64
import html
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, zip_longest
from pathlib import Path

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, MOVES, Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.plotting import (
    GREEN,
    LANDING,
    LOW,
    NO_FLY,
    RED,
    SHADOW,
    TALL,
    Style,
    device_colour,
)

# On a map of 16 × 16 cells, in cells:
ASIDE = 0.16  # arrows lie this far to the right of the path, so that there and back differ
THINNEST, WIDEST = 0.05, 0.3  # an arrow of no upload, and of the largest one
SHADE = {"fill": SHADOW, "fill_opacity": 0.6}
MUCH = 1.0  # data units in a step that the widest arrow stands for at the least
WIDEST_LINK = 0.5  # a line from a device that carries the largest upload
# By the hatches of `plotting`: lines from (x, y) by (dx, dy), from a cell's north-west corner. A
# line of no length is a dot.
HATCHES = {
    LANDING["hatch"]: ((0, 0.5, 0.5, 0.5), (0, 0, 1, 1), (0.5, 0, 0.5, 0.5)),
    NO_FLY["hatch"]: ((0, 0.5, 0.5, -0.5), (0, 1, 1, -1), (0.5, 1, 0.5, -0.5)),
    LOW["hatch"]: tuple((x, y, 0, 0) for x in (0.25, 0.75) for y in (0.25, 0.75)),
}


def draw(environment: Environment, flights: Mapping[str, Trajectory]) -> str:
    """Flights of one mission side by side, each with its name, as HTML for `script`.

    Raises `InputError` if missions or cities differ.
    """
    first = next(iter(flights.values()))
    here = environment.over(int(first.start.city[0]))
    for name, flight in flights.items():
        city = environment.cities[int(flight.start.city[0])]
        _require_mission(name, flight, city, first.start, here.cities[0])
    scene = _Scene(here, tuple(flights.values()))
    title = f"Flight{'s' * (len(flights) > 1)} over {scene.city.name}"
    data = json.dumps(
        {
            "most": scene.most,
            "widest": WIDEST_LINK * scene.scale,
            "flights": [_film(scene, flight) for flight in flights.values()],
        },
        separators=(",", ":"),
    )
    return _tag(
        "div",
        f"<style>{_read('drawing.css')}</style>",
        _tag(
            "div",
            *(_panel(scene, name, flight) for name, flight in flights.items()),
            class_="flights",
        ),
        _legend(scene.city),
        f'<script type="application/json">{data}</script>',
        class_="uavdh-player",
        role="group",
        aria_label=title,
        tabindex=-1,
        data_lm_suppress_shortcuts="true",  # the keys are the player's, not JupyterLab's
    )


def script() -> str:
    """The functions that play what `draw` makes, in JavaScript; `start(root)` begins."""
    return _read("drawing.js")


def _require_mission(
    name: str, flight: Trajectory, city: City, start: State, start_city: City
) -> None:
    """Raise `InputError` unless a flight is over that city, and of the mission that starts so."""
    flown = f"flight {name!r}" if name else "the flight"
    if city.fingerprint != start_city.fingerprint:
        raise InputError(
            f"{flown} is over {city.name}, the first one over {start_city.name}: "
            "flights side by side are over one city"
        )
    cells = np.append(flight.uav_cell, flight.start.device_cells)
    if cells.max() >= city.size**2 or city.no_fly.ravel()[flight.uav_cell].any():
        raise InputError(f"{flown} does not fit {city.name}: is it over another city?")
    for field, what in (
        ("uav_cell", "start"),
        ("device_cells", "devices"),
        ("data_initial", "data"),
        ("time_left", "flying time"),
    ):
        if not np.array_equal(getattr(flight.start, field), getattr(start, field)):
            raise InputError(
                f"{flown} has another {what} than the first one: "
                "flights side by side are of one mission"
            )


@dataclass(frozen=True)
class _Scene:
    """What the maps of all flights have in common."""

    environment: Environment
    flights: tuple[Trajectory, ...]

    @cached_property
    def city(self) -> City:
        return self.environment.cities[0]

    @cached_property
    def start(self) -> State:
        return self.flights[0].start

    @cached_property
    def devices(self) -> list[int]:
        """The devices that have data at the start."""
        return np.flatnonzero(self.start.data_initial[0] > 0).tolist()

    @cached_property
    def scale(self) -> float:
        """The size of signs and letters in cells; 1 on a map of 16 × 16 cells."""
        return float(np.clip(self.city.size / 16, 0.4, 2))

    @property
    def breadth(self) -> float:
        """The breadth of what lies in single cells, such as arrows."""
        return min(self.scale, 1.4)

    @cached_property
    def most(self) -> float:
        """The largest upload of a device in a step, data units, but at least `MUCH`."""
        return max(float(_uploads(flight).max(initial=MUCH)) for flight in self.flights)

    def place(self, cell: int | np.integer) -> tuple[int, int]:
        """x and y of a cell's centre: its column and its row."""
        row, col = divmod(int(cell), self.city.size)
        return col, row


def _uploads(flight: Trajectory) -> np.ndarray:
    """Data units that each device uploaded in each step; (T, K)."""
    return -np.diff(flight.data_left.astype(float), axis=0)


def _film(scene: _Scene, flight: Trajectory) -> dict[str, list]:
    """What changes from step to step: the script's data.

    The UAV's cells; what is left of each device's data, and of the time; and a sentence.
    """
    row, col = np.divmod(flight.uav_cell.astype(int), scene.city.size)
    return {
        "x": col.tolist(),
        "y": row.tolist(),
        "left": [
            *flight.data_left[:, scene.devices].T.astype(float).round(5).tolist(),
            flight.time_left.tolist(),
        ],
        "says": _sentences(scene, flight),
    }


def _sentences(scene: _Scene, flight: Trajectory) -> list[str]:
    """A sentence for the start, for each step, and for how it ended, in place of the last step."""
    sentences = [f"Starts with {flight.time_left[0]} units of time."]
    moves = {tuple(move): name for name, move in zip(ACTIONS, MOVES[:4].tolist(), strict=False)}
    row, col = np.divmod(flight.uav_cell.astype(int), scene.city.size)
    for step, uploads in enumerate(_uploads(flight)):
        moved = moves.get((row[step + 1] - row[step], col[step + 1] - col[step]))
        does = f"flies {moved}" if moved else "hovers"
        if flight.intervened[step]:
            does = f"may not {_verb(flight.action[step])} here, and hovers"
        devices = [
            f"device {k} uploads {_amount(uploads[k])} units"
            for k in scene.devices
            if uploads[k] > 0
        ]
        sentences.append(f"Step {step + 1}: {does}; {', '.join(devices) or 'no upload'}.")
    return [*sentences[: len(flight.action)], _ending(flight)]


def _verb(action: int | np.integer) -> str:
    name = ACTIONS[action]
    return name if name == "land" else f"fly {name}"


def _amount(units: float) -> str:
    return f"{units:.1f}" if units >= 0.1 else f"{units:.1g}"


def _ending(flight: Trajectory) -> str:
    """How a flight ended, as a sentence."""
    used, available = len(flight.action), flight.time_left[0]
    initial = flight.start.data_initial.sum()
    data = f"{initial - flight.data_left[-1].sum():.1f} of {initial:.1f} units of data"
    if flight.landed:
        return f"Landed after {used} of {available} units of time, with {data}."
    if flight.time_left[-1] <= 0:
        return f"Crashed: not landed after {used} units of time, with {data}."
    return f"In the air after {used} of {available} units of time, with {data}."


# From here on: HTML and SVG


def _read(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8").strip()


def _tag(name: str, *inside: str, **attributes: object) -> str:
    """An element. Values are escaped, what is inside is not; `data_from` stands for data-from."""
    written = "".join(
        f' {key.strip("_").replace("_", "-")}="{html.escape(_number(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    return f"<{name}{written}>{''.join(inside)}</{name}>" if inside else f"<{name}{written}/>"


def _number(value: object) -> str:
    """Text as it is; a number with two decimals at most, and as short as SVG lets it be."""
    if not isinstance(value, float):
        return str(value)
    digits = f"{abs(value):.2f}".strip("0").removesuffix(".") or "0"
    return f"-{digits}" if value < 0 and digits != "0" else digits


def _path(*points: tuple[float, float]) -> str:
    """A closed outline: the first point, and from each point to the next."""
    steps = np.diff(np.array(points, float), axis=0, prepend=0).tolist()
    first, *others = (f"{_number(x)} {_number(y)}" for x, y in steps)
    return f"M{first}l{' '.join(others)}z"


def _image(svg: str, alt: str) -> str:
    """A picture that is part of the page; its data are ASCII, which is what `atob` reads."""
    data = base64.b64encode(svg.encode("ascii", "xmlcharrefreplace")).decode()
    return f'<img alt="{html.escape(alt)}" src="data:image/svg+xml;base64,{data}">'


def _panel(scene: _Scene, name: str, flight: Trajectory) -> str:
    """One flight: map, result and bars, as they are at its end."""
    ending, city = _ending(flight), scene.city.name
    label = f"{name}, over {city}: {ending}" if name else f"Flight over {city}: {ending}"
    initial, left = flight.start.data_initial[0], flight.data_left[-1]
    bars = [
        _bar(f"device {k}", left[k], initial[k], initial.max(), device_colour(k), k)
        for k in scene.devices
    ]
    time = flight.time_left
    bars.append(_bar("flying time", time[-1], time[0], time[0], "currentColor", None))
    side = (
        _tag("div", "what is left", class_="heading")
        + "".join(bars)
        + _tag("div", html.escape(ending), class_="says")
    )
    heading = _tag("div", html.escape(name), class_="name") if name else ""
    picture = _image(_map(scene, flight), label)
    return _tag(
        "div",
        heading,
        _tag("div", picture, class_="map"),
        _tag("div", side, class_="side"),
        class_="flight",
    )


def _bar(
    label: str, left: float, initial: float, longest: float, colour: str, device: int | None
) -> str:
    """What is left of something, as a bar and as numbers."""
    digits = 0 if device is None else 1
    fill = _tag("span", "", class_="fill", style=f"width:{left / initial:.2%};background:{colour}")
    track = _tag("span", fill, class_="track", style=f"width:{initial / longest:.1%}")
    number = _tag("span", f"{left:.{digits}f}", class_="left")
    return _tag(
        "div",
        _tag("span", label, class_="what"),
        _tag("span", track, class_="room"),
        _tag("span", f" {number} of {initial:.{digits}f}", class_="number"),
        class_="bar",
        data_device=device,
    )


def _legend(city: City) -> str:
    """The signs of the map, without kinds of cells that the city lacks."""
    cell = np.ones((1, 1), bool)
    signs = [(_cells(cell, style, 1), name) for mask, style, name in _kinds(city) if mask.any()]
    signs += [
        (
            _tag("path", d=_squares(cell), **SHADE),
            "no line of sight to the device pointed at or heard",
        ),
        (_tag("path", d=_cross(1.2), stroke=device_colour(0), stroke_width=0.26), "device"),
        (_triangle(0, 0, 1), "start"),
        (_mark(landed=True), "landed"),
        (_mark(landed=False), "crashed"),
        (
            _arrow((-0.5, 0), (1, 0), 0.3, device_colour(0), 1, aside=0),
            "a step, in the colour of the device heard (black: none)",
        ),
        (_arrow((-0.5, 0), (1, 0), 1, device_colour(0), 1, aside=0), "much data"),
        (_ring((0, 0), 0.2, "#000", 0.75), "hovering"),
    ]
    paper = _tag("rect", x=-0.5, y=-0.5, width=1, height=1, fill="#fff")
    pictures = [_image(_svg("-.5 -.5 1 1", paper, s, width=16, height=16), "") for s, _ in signs]
    names = [name for _, name in signs]
    return _tag(
        "div", *(_tag("span", *pair) for pair in zip(pictures, names, strict=True)), class_="legend"
    )


def _svg(box: str, *inside: str, **attributes: object) -> str:
    return _tag("svg", *inside, xmlns="http://www.w3.org/2000/svg", viewBox=box, **attributes)


def _map(scene: _Scene, flight: Trajectory) -> str:
    """The map with the whole flight as SVG; a unit is a cell, (0, 0) the centre of the first."""
    size, scale = scene.city.size, scene.scale
    side, west, north = size + 1.8 * scale, -0.5 - 1.5 * scale, -0.5 - 0.3 * scale
    return _svg(
        " ".join(map(_number, (west, north, side, side))),
        _tag("rect", x=west, y=north, width=side, height=side, fill="#fff"),
        *_shadows(scene),
        _grid(scene),
        *(_cells(mask, style, scene.breadth) for mask, style, _ in _kinds(scene.city)),
        *_devices(scene),
        _start(scene),
        *_steps(scene, flight),
        *_links(scene),
        _uav(scene, flight),
        font_family="sans-serif",
    )


def _kinds(city: City) -> list[tuple[np.ndarray, Style, str]]:
    """The kinds of cells: where they are, what they look like, and their names."""
    tall = city.buildings & city.no_fly
    return [
        (city.landing, LANDING, "start and landing zone"),
        (
            city.buildings & ~city.no_fly,
            LOW,
            "low building: blocks the radio, may be flown over",
        ),
        (tall, TALL, "tall building"),
        (city.no_fly & ~tall, NO_FLY, "no-fly zone"),
    ]


def _squares(mask: np.ndarray) -> str:
    """The outlines of cells, (M, M) bool: a rectangle for each run in a row."""
    edges = np.diff(np.pad(mask.astype(int), ((0, 0), (1, 1))))
    (rows, starts), (_, ends) = np.argwhere(edges == 1).T, np.argwhere(edges == -1).T
    return "".join(
        f"M{_number(first - 0.5)} {_number(row - 0.5)}h{end - first}v1h{first - end}z"
        for row, first, end in zip(rows, starts.tolist(), ends.tolist(), strict=True)
    )


def _cells(mask: np.ndarray, style: Style, breadth: float) -> str:
    """Cells of a kind, in the style of `plotting`."""
    cells = _tag("path", d=_squares(mask), fill=style["facecolor"])
    if "hatch" not in style:
        return cells
    lines = "".join(
        f"M{_number(x + col - 0.5)} {_number(y + row - 0.5)}l{_number(dx)} {_number(dy)}"
        for row, col in np.argwhere(mask).tolist()
        for x, y, dx, dy in HATCHES[style["hatch"]]
    )
    return cells + _tag(
        "path",
        d=lines,
        fill="none",
        stroke=style["edgecolor"],
        stroke_width=0.09 * breadth,
        stroke_linecap="round" if style is LOW else None,
    )


def _shadows(scene: _Scene) -> list[str]:
    """For each device the cells that it has no line of sight to."""
    sight = scene.environment.sight[0][scene.start.device_cells[0]]
    shape = (scene.city.size,) * 2
    return [
        _tag(
            "path",
            d=_squares(~sight[k].reshape(shape)),
            **SHADE,
            visibility="hidden",
            data_shadow=k,
        )
        for k in scene.devices
    ]


def _grid(scene: _Scene) -> str:
    """The lines between the cells, a frame, and numbers of rows and columns as on the figures."""
    size, scale = scene.city.size, scene.scale
    edges = [edge - 0.5 for edge in range(1, size)] if size <= 32 else []
    lines = "".join(f"M{edge} -.5v{size}M-.5 {edge}h{size}" for edge in edges)
    south, west = size - 0.5, -0.5 - 0.25 * scale
    texts = [
        _tag("text", "column", x=size / 2 - 0.5, y=south + 1.25 * scale),
        _tag("text", "row", transform=f"translate({-0.5 - 1.0 * scale} {size / 2}) rotate(-90)"),
    ]
    for tick in range(0, size, max(1, round(size / 8))):
        texts.append(_tag("text", str(tick), x=tick, y=south + 0.6 * scale))
        texts.append(
            _tag("text", str(tick), x=west, y=tick + 0.17 * scale, text_anchor="end"),
        )
    frame = f"M-.5 -.5h{size}v{size}h-{size}z"
    return (
        _tag("path", d=lines, stroke="#ddd", stroke_width=0.03)
        + _tag("path", d=frame, fill="none", stroke="#888", stroke_width=0.06 * scale)
        + _tag("g", *texts, font_size=0.48 * scale, fill="#333", text_anchor="middle")
    )


def _devices(scene: _Scene) -> list[str]:
    """The devices and their numbers. They lie below the flight, which nothing covers."""
    scale, cross = scene.scale, _cross(scene.scale)
    devices = []
    for k, (label_x, label_y) in zip(scene.devices, _label_places(scene), strict=True):
        x, y = scene.place(scene.start.device_cells[0, k])
        about = f"device {k} at ({y}, {x}), {scene.start.data_initial[0, k]:.1f} units of data"
        number = _tag(
            "text",
            str(k),
            x=label_x,
            y=label_y + 0.25 * scale,
            font_size=0.7 * scale,
            font_weight="bold",
            text_anchor="middle",
            fill=device_colour(k),
            stroke="#fff",
            stroke_width=0.16 * scale,
            paint_order="stroke",
        )
        inside = (
            _tag("title", about),
            _tag("circle", r=0.5 * scale, fill_opacity=0),  # easy to point at
            _tag("path", d=cross, stroke="#fff", stroke_width=0.36 * scale),
            _tag("path", d=cross, stroke=device_colour(k), stroke_width=0.22 * scale),
            number,
        )
        devices.append(_tag("g", *inside, transform=f"translate({x} {y})", data_device=k))
    return devices


def _label_places(scene: _Scene) -> np.ndarray:
    """Where each device's number stands, seen from the device, in cells; (K, 2), x and y.

    Of eight places around it, the one that keeps clearest of the routes, of devices and numbers.
    """
    size, scale = scene.city.size, scene.scale
    routes = [np.array([scene.place(c) for c in flight.uav_cell]) for flight in scene.flights]
    devices = np.array([scene.place(scene.start.device_cells[0, k]) for k in scene.devices])
    between = [(route[1:] + route[:-1]) / 2 for route in routes]
    counts = [route[1:][(route[1:] == route[:-1]).all(axis=1)] for route in routes]
    counts = [count + np.array([0.5, -0.5]) * scale for count in counts]
    taken = np.concatenate([*routes, *between, *counts, devices])
    angles = np.arange(-1, 7) * np.pi / 4  # north-east first
    around = 0.8 * scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    places = []
    for device in devices:
        numbers = device + around
        distance = np.linalg.norm(numbers[:, None] - taken, axis=-1)
        in_the_way = np.maximum(0, 0.75 * scale - distance).sum(axis=1)
        margin = 0.4 * scale - 0.5
        outside = ((numbers < margin) | (numbers > size - 1 - margin)).any(axis=1)
        best = np.argmin(in_the_way + 100 * outside)
        places.append(around[best])
        taken = np.append(taken, numbers[[best]], axis=0)
    return np.array(places)


def _steps(scene: _Scene, flight: Trajectory) -> list[str]:
    """An arrow for each move, and a ring for each step of hovering until the next one there."""
    arrows, rings = [], []
    hovered: dict[int, list[int]] = {}  # the steps by cell
    places = [scene.place(cell) for cell in flight.uav_cell]
    uploads = _uploads(flight)
    shares = uploads.max(axis=1) / scene.most
    colours = [device_colour(step.argmax()) if step.any() else "#000" for step in uploads]
    for step, ((x, y), (to_x, to_y)) in enumerate(pairwise(places)):
        if (to_x, to_y) != (x, y):
            towards = (to_x - x, to_y - y)
            style = (shares[step], colours[step], scene.breadth)
            arrows.append(_arrow((x, y), towards, *style, data_from=step))
        elif not flight.landed or step < len(uploads) - 1:
            hovered.setdefault(flight.uav_cell[step], []).append(step)
    for cell, steps in hovered.items():
        for count, (step, following) in enumerate(zip_longest(steps, steps[1:]), start=1):
            ring = _ring(scene.place(cell), shares[step], colours[step], scene.breadth)
            rings.append(
                _tag(
                    "g",
                    ring + _count(scene, cell, count),
                    data_from=step,
                    data_until=following,
                    visibility=None if following is None else "hidden",
                )
            )
    return arrows + rings


def _width(share: float, breadth: float) -> float:
    """How wide a step is drawn that uploaded this share of the largest upload, cells."""
    return breadth * (THINNEST + (WIDEST - THINNEST) * float(share))


def _arrow(
    start: tuple[float, float],
    towards: tuple[int, int],
    share: float,
    colour: str,
    breadth: float,
    aside: float = ASIDE,
    **attributes: object,
) -> str:
    """An arrow to the next cell, to the right of the line between the centres."""
    (x, y), (right, down) = start, towards
    half = _width(share, breadth) / 2
    head = max(0.14 * breadth, half + 0.06)

    def point(along: float, across: float) -> tuple[float, float]:
        across += breadth * aside
        return x + along * right - across * down, y + along * down + across * right

    side = [(0, half), (0.66, half), (0.66, head)]
    outline = [*side, (1, 0), *((along, -across) for along, across in reversed(side))]
    return _tag("path", d=_path(*(point(*corner) for corner in outline)), fill=colour, **attributes)


def _ring(place: tuple[float, float], share: float, colour: str, breadth: float) -> str:
    (x, y), width = place, _width(share, breadth)
    style = {"fill": "none", "stroke": colour, "stroke_width": width}
    return _tag("circle", cx=x, cy=y, r=0.52 * breadth, **style)


def _count(scene: _Scene, cell: int, count: int) -> str:
    """How often the UAV has hovered in a cell so far, next to the ring."""
    x, y = scene.place(cell)
    inwards = -1 if x > scene.city.size - 1.5 else 1
    return _tag(
        "text",
        f"{count}×",
        x=x + inwards * 0.36 * scene.scale,
        y=y - 0.3 * scene.scale,
        text_anchor="end" if inwards < 0 else None,
        font_size=0.5 * scene.scale,
        font_weight="bold",
        stroke="#fff",
        stroke_width=0.14 * scene.scale,
        paint_order="stroke",
    )


def _links(scene: _Scene) -> list[str]:
    """A line from each device; the script draws it to the UAV while the device uploads."""
    places = [scene.place(scene.start.device_cells[0, k]) for k in scene.devices]
    return [
        _tag(
            "line",
            x1=x,
            y1=y,
            stroke=device_colour(k),
            stroke_opacity=0.75,
            visibility="hidden",
            data_link=k,
        )
        for k, (x, y) in zip(scene.devices, places, strict=True)
    ]


def _start(scene: _Scene) -> str:
    """The triangle where the flight starts."""
    x, y = scene.place(scene.start.uav_cell[0])
    return _triangle(x, y, scene.scale, _tag("title", "start"), data_start=f"{y},{x}")


def _cross(scale: float) -> str:
    """The sign of a device."""
    arm = _number(0.26 * scale)
    return f"M-{arm} -{arm}L{arm} {arm}M-{arm} {arm}L{arm} -{arm}"


def _triangle(x: int, y: int, scale: float, *inside: str, **attributes: object) -> str:
    """The sign of the start."""
    a = 0.34 * scale
    triangle = _path((x, y - a), (x + a, y + 0.8 * a), (x - a, y + 0.8 * a))
    style = {"fill": "#fff", "stroke": "#000", "stroke_width": 0.08 * scale}
    return _tag("path", *inside, d=triangle, **attributes, **style)


def _mark(landed: bool) -> str:
    """The sign of a landing, or of a crash."""
    colour, mark = (
        (GREEN, "M-.16 0L-.04 .13L.17 -.13")
        if landed
        else (RED, "M-.13 -.13L.13 .13M-.13 .13L.13 -.13")
    )
    return _tag("circle", r=0.34, fill=colour, stroke="#fff", stroke_width=0.07) + _tag(
        "path", d=mark, fill="none", stroke="#fff", stroke_width=0.1
    )


def _uav(scene: _Scene, flight: Trajectory) -> str:
    """The UAV at the end of its flight, with a mark that says whether it landed or crashed."""
    x, y = scene.place(flight.uav_cell[-1])
    rotors = [(across, along) for across in (-0.24, 0.24) for along in (-0.24, 0.24)]
    drawn = [
        _tag("path", d="M-.24 -.24L.24 .24M-.24 .24L.24 -.24", stroke="#fff", stroke_width=0.2),
        *(_tag("circle", cx=u, cy=v, r=0.2, fill="#fff") for u, v in rotors),
        _tag("path", d="M-.24 -.24L.24 .24M-.24 .24L.24 -.24", stroke="#000", stroke_width=0.1),
        *(_tag("circle", cx=u, cy=v, r=0.13, fill="#fff", stroke="#000") for u, v in rotors),
        _tag("circle", r=0.13),
    ]
    if flight.landed or flight.time_left[-1] <= 0:
        aside = -0.5 if max(x, y) > scene.city.size - 1.5 else 0.5  # not where hovering is counted
        drawn.append(
            _tag(
                "g",
                _mark(bool(flight.landed)),
                transform=f"translate({aside} {aside})",
                data_from=len(flight.action) - 0.5,
            )
        )
    inside = _tag("g", *drawn, transform=f"scale({_number(scene.scale)})", stroke_width=0.07)
    return _tag("g", inside, transform=f"translate({x} {y})", data_uav="")
