"""Random cities, as many as a training or a test needs; equal seeds give equal cities.

Where the buildings stand depends on the kind of city:

| kind | what |
| --- | --- |
| `blocks` | streets cross at right angles; some blocks have an alley or a missing corner |
| `scattered` | houses of up to four cells on a side, with a gap around each |
| `courtyards` | closed blocks around a yard, which one or two gates lead into; walls |
| `old_town` | small blocks, narrow lanes that end at others, a market square |

Then come what all kinds have: low buildings, no-fly zones, landing zones. What the UAV could not
reach becomes part of the buildings or no-fly zones around it, so all cells over which it may fly
are connected.
"""

import re
from dataclasses import dataclass

import numpy as np

from uavdh_lite import registry
from uavdh_lite.city import SIGNS, City, connected_parts, grow
from uavdh_lite.config import option, require
from uavdh_lite.environment import MAX_CITIES
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream

FREE, NO_FLY, LOW, LANDING, TALL = (SIGNS.index(sign) for sign in ".NbLB")

OPEN_LAND = 0.25  # probability that one side is left without buildings
LOW_SHARE = (0.0, 0.5)  # least and most share of the buildings that are low
NO_FLY_ZONES = (0, 3)  # least and most number of them
LANDING_ZONES = (1, 3)
LEAST_BUILT = 0.12  # share of cells with buildings
MOST_CUT_OFF = 0.03  # share of cells that become no-fly zone or building because nobody gets there


# Where the buildings stand. Each function gives the number of the building in each cell, from 1 on,
# 0 for none; (M, M) ints.


def blocks(size: int, generator: np.random.Generator) -> np.ndarray:
    """A grid of streets, with the same widths all over a city, and what the blocks become."""
    buildings = np.zeros((size, size), int)
    widest, avenue = _whole(generator, 3, 5), _whole(generator, 1, 2)

    def spans() -> list[slice]:
        """The blocks along one side."""
        start, found = _whole(generator, 0, 2), []
        while start < size - 1:
            end = min(start + _whole(generator, 2, widest), size)
            found.append(slice(start, end))
            start = end + (avenue if generator.random() < 0.4 else 1)
        return found

    rows, cols = spans(), spans()
    for row in rows:
        for col in cols:
            block = buildings[row, col]
            height, width = block.shape
            number = buildings.max() + 1
            block[:] = number
            use = generator.random()
            if use < 0.12:  # a square or a park
                block[:] = 0
            elif use < 0.32 and max(height, width) >= 3:  # two buildings and an alley
                along = block if height >= width else block.T
                alley = generator.integers(1, len(along) - 1)
                along[alley], along[alley + 1 :] = 0, number + 1
            elif use < 0.5 and min(height, width) >= 2:  # a missing corner
                corner = np.rot90(block, _whole(generator, 0, 3))
                corner[: len(corner) // 2, : corner.shape[1] // 2] = 0
    return buildings


def scattered(size: int, generator: np.random.Generator) -> np.ndarray:
    buildings = np.zeros((size, size), int)
    _add_houses(buildings, generator.uniform(0.15, 0.28), 4, generator)
    return buildings


def courtyards(size: int, generator: np.random.Generator) -> np.ndarray:
    """Closed blocks first, then walls, then houses in what is left."""
    buildings = np.zeros((size, size), int)
    for _ in range(max(1, round(generator.uniform(2.5, 5) * size**2 / 256))):
        shape = generator.integers(5, min(9, size - 2), 2, endpoint=True)
        block = _find_room(buildings, shape, generator)
        if block is None:
            continue
        block[:] = buildings.max() + 1
        inside = block[1:-1, 1:-1]
        inside[:] = 0
        walls = block[0, 1:-1], block[-1, 1:-1], block[1:-1, 0], block[1:-1, -1]
        for _ in range(_whole(generator, 1, 2)):  # gates
            side = walls[generator.integers(4)]
            side[generator.integers(len(side))] = 0
        if min(inside.shape) >= 5 and generator.random() < 0.6:
            inside[2:-2, 2:-2] = block.max()
    for _ in range(round(generator.uniform(1, 4) * size**2 / 256)):
        length = _whole(generator, 4, max(5, size // 2))
        shape = np.array((1, length) if generator.random() < 0.5 else (length, 1))
        wall = _find_room(buildings, shape, generator)
        if wall is not None:
            wall[:] = buildings.max() + 1
            if length >= 6:  # a gap, so that a long wall is not always in the way
                wall.reshape(-1)[generator.integers(2, length - 2)] = 0
    _add_houses(buildings, (buildings > 0).mean() + 0.05, 2, generator)
    return buildings


def old_town(size: int, generator: np.random.Generator) -> np.ndarray:
    """Blocks that were split again and again by lanes, so that no lane leads far; without some of
    their corners, without the market square, and without what is too far from the centre."""
    buildings = np.zeros((size, size), int)
    todo, blocks = [buildings], []
    while todo:
        block = todo.pop()
        longest = max(block.shape)
        if longest >= 6 or (longest >= 4 and generator.random() < 0.35):
            along = block if block.shape[0] == longest else block.T
            lane = _whole(generator, 2, longest - 2)
            todo += [along[:lane], along[lane + 1 :]]
        else:
            blocks.append(block)
    for number, block in enumerate(blocks, 1):
        block[:] = number
        for _ in range(_whole(generator, 0, 2)):
            if min(block.shape) >= 2:
                np.rot90(block, _whole(generator, 0, 3))[0, 0] = 0
    centre = generator.uniform(0.35, 0.65, 2) * (size - 1)
    numbers = np.arange(len(blocks)) + 1
    middles = [np.argwhere(buildings == number).mean(axis=0) for number in numbers]
    distance = np.hypot(*(np.array(middles) - centre).T)
    gone = distance > generator.uniform(0.5, 0.75) * size
    gone[distance.argmin()] = True  # the market square
    buildings[np.isin(buildings, numbers[gone])] = 0
    return buildings


def _add_houses(
    buildings: np.ndarray, share: float, longest: int, generator: np.random.Generator
) -> None:
    """Put houses with a gap around them until this share of all cells has buildings, or no room
    is found any more."""
    while (buildings > 0).mean() < share:
        shape = generator.integers(1, longest, 2, endpoint=True)
        shape = np.maximum(shape, 2 if shape.sum() < 3 and longest > 2 else 1)
        house = _find_room(buildings, shape, generator)
        if house is None:
            return
        house[:] = buildings.max() + 1


def _find_room(
    buildings: np.ndarray, shape: np.ndarray, generator: np.random.Generator
) -> np.ndarray | None:
    """The cells of a random rectangle with a cell's gap to all buildings; None without room."""
    corners = np.argwhere(_rectangles_without(buildings > 0, shape, gap=1))
    if not len(corners):
        return None
    row, col = corners[generator.integers(len(corners))]
    return buildings[row : row + shape[0], col : col + shape[1]]


def _rectangles_without(mask: np.ndarray, shape: np.ndarray, gap: int = 0) -> np.ndarray:
    """For each north-west corner, whether a rectangle there, and `gap` cells around it, have no
    cell of `mask`; (M − rows + 1, M − cols + 1) bool."""
    window = tuple(shape + 2 * gap)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(mask, gap), window)
    return np.logical_not(windows.any(axis=(2, 3)))


BUILDERS = {builder.__name__: builder for builder in (blocks, scattered, courtyards, old_town)}


# What all kinds have.


def _clear_one_side(buildings: np.ndarray, generator: np.random.Generator) -> None:
    """Take away what stands on a quarter to a half of the map, from one side."""
    depth = round(generator.uniform(0.25, 0.5) * len(buildings))
    np.rot90(buildings, _whole(generator, 0, 3))[:depth] = 0


def _add_no_fly_zones(cells: np.ndarray, count: int, generator: np.random.Generator) -> None:
    """Rectangles over which the UAV may not fly; buildings in them count as tall."""
    longest = 2 + len(cells) // 5
    for _ in range(count):
        rows, cols = generator.integers(2, longest, 2, endpoint=True)
        row = generator.integers(0, len(cells) - rows, endpoint=True)
        col = generator.integers(0, len(cells) - cols, endpoint=True)
        zone = cells[row : row + rows, col : col + cols]
        zone[:] = np.where(np.isin(zone, (LOW, TALL)), TALL, NO_FLY)


def _close_what_is_cut_off(cells: np.ndarray) -> int:
    """Let only the largest connected part be flown over; returns how many cells were cut off.

    What is cut off becomes no-fly zone if it touches one, and building otherwise.
    """
    *smaller, _ = connected_parts((cells != NO_FLY) & (cells != TALL))
    for part in smaller:
        cells[part] = NO_FLY if (grow(part) & (cells == NO_FLY)).any() else TALL
    return int(np.sum(smaller))


def _add_landing_zones(cells: np.ndarray, count: int, generator: np.random.Generator) -> bool:
    """Landing zones on free cells, most of them at the edge of the map, far from each other.

    Returns whether there is room for all of them.
    """
    size = len(cells)
    for _ in range(count):
        shape = generator.integers((1, 2), (2, 4), endpoint=True)
        shape = shape if generator.random() < 0.5 else shape[::-1]
        room = _rectangles_without(cells != FREE, shape)
        row, col = np.indices(room.shape)
        for other in np.argwhere(cells == LANDING):
            room &= np.maximum(abs(row - other[0]), abs(col - other[1])) > size // 3
        at_edge = np.zeros_like(room)
        at_edge[[0, -1]] = at_edge[:, [0, -1]] = True
        if generator.random() < 0.8 and (room & at_edge).any():
            room &= at_edge
        corners = np.argwhere(room)
        if not len(corners):
            return False
        row, col = corners[generator.integers(len(corners))]
        cells[row : row + shape[0], col : col + shape[1]] = LANDING
    return True


def _draw_city(kind: str, size: int, generator: np.random.Generator) -> np.ndarray:
    """The kinds of the cells; (M, M) ints. Of all tries, about half or more become a city."""
    while True:
        buildings = BUILDERS[kind](size, generator)
        if generator.random() < OPEN_LAND:
            _clear_one_side(buildings, generator)
        low_share = generator.uniform(*LOW_SHARE)
        low = generator.random(buildings.max() + 1) < low_share
        cells = np.where(buildings == 0, FREE, np.where(low[buildings], LOW, TALL))
        _add_no_fly_zones(cells, _whole(generator, *NO_FLY_ZONES), generator)
        cut_off = _close_what_is_cut_off(cells)
        room = _add_landing_zones(cells, _whole(generator, *LANDING_ZONES), generator)
        built = np.isin(cells, (LOW, TALL)).mean()
        if room and built >= LEAST_BUILT and cut_off <= MOST_CUT_OFF * size**2:
            return cells


def _whole(generator: np.random.Generator, least: int, most: int) -> int:
    """A whole number, both ends included."""
    return int(generator.integers(least, most, endpoint=True))


@dataclass(frozen=True)
class CityGenerator:
    """Draws random cities; raises `InputError` for an impossible size or an unknown kind."""

    size: int = option(16, "cells on a side", ge=8, le=100)
    kinds: tuple[str, ...] = option(tuple(BUILDERS), "kinds of city, equally likely")
    smallest: int | None = option(
        None,
        "every other city has from this to `size` cells on a side; none: all have `size`",
        ge=8,
    )

    def __post_init__(self):
        require(self, "cities")
        if self.smallest is not None and self.smallest > self.size:
            raise InputError(f"cities of {self.smallest} to {self.size} cells: write 8-16, say")
        if not self.kinds or not set(self.kinds) <= set(BUILDERS):
            raise InputError(f"kinds of city {self.kinds}: choose from {', '.join(BUILDERS)}")

    def draw(self, count: int, seed: int) -> tuple[City, ...]:
        """The first `count` cities of this seed; more of them begin with the same ones."""
        if not 1 <= count <= MAX_CITIES:
            raise InputError(f"{count} cities: must be from 1 to {MAX_CITIES}")
        generator = stream(Use.CITY, seed)
        cities = []
        for number in range(count):
            kind = self.kinds[generator.integers(len(self.kinds))]
            size = self.size
            if self.smallest is not None and generator.random() < 0.5:
                size = _whole(generator, self.smallest, size)
            cells = _draw_city(kind, size, generator)
            cities.append(City.from_kinds(f"{kind}_{seed}_{number}", cells))
        return tuple(cities)


def random_cities(name: str) -> tuple[City, ...]:
    """The cities of `COUNT:SEED`, or with so many cells on a side of `COUNT:SEED:SIZE` or
    `COUNT:SEED:SMALLEST-SIZE`; raises `CityError` for anything else."""
    found = re.fullmatch(r"(\d{1,9}):(\d{1,19})(?::(?:(\d{1,9})-)?(\d{1,9}))?", name)
    if found is None:
        raise CityError(
            f"random:{name:.80}: write random:COUNT:SEED, random:COUNT:SEED:SIZE or 8-SIZE"
        )
    count, seed, smallest, size = (int(part or 0) for part in found.groups())
    return CityGenerator(size or CityGenerator.size, smallest=smallest or None).draw(count, seed)


ANY_CITY = Scenario(
    "any_city", "random:3000:0:8-16", devices=(1, 6), data=(1.0, 25.0), flying_time=(20, 70)
)

registry.register("cities", "random", random_cities)
registry.register("scenario", ANY_CITY.name, ANY_CITY)
