"""Random cities, as many as a training or a test needs; equal seeds give equal cities.

Where the buildings stand depends on the kind of city:

| kind | what |
| --- | --- |
| `blocks` | streets cross at right angles; most blocks are full, some have an alley, a missing corner or nothing on them |
| `scattered` | houses of up to four cells on a side, with a gap around each |
| `courtyards` | closed blocks around a yard, which one or two gates lead into; walls; a few houses |
| `old_town` | small blocks, narrow lanes that end at others, a market square, open land around |

Then come what all kinds have: low buildings, no-fly zones, landing zones. What the UAV could not
reach becomes part of the buildings or no-fly zones around it, so all cells over which it may fly
are connected.
"""  # noqa: E501

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uavdh_lite.city import SIGNS, Cities, City, grow
from uavdh_lite.config import option, require_bounds
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.streams import Use, stream

LEAST_BUILT = 0.12  # share of cells with buildings
MOST_CUT_OFF = 0.03  # share of cells that become no-fly zone or building because nobody gets there
MOST_TRIES = 200  # before the parameters count as impossible
RANDOM = "random:"  # what the name of random cities begins with, for `load_city`
FREE, NO_FLY, LOW, LANDING, TALL = (SIGNS.index(sign) for sign in ".NbLB")


@dataclass(frozen=True)
class CityGenerator:
    """Draws random cities; both ends of a range are included.

    Raises `InputError` for a range that is none, or an unknown kind.
    """

    sizes: tuple[int, int] = option((16, 16), "least and most cells on a side", ge=8, le=100)
    kinds: tuple[str, ...] = option(
        ("blocks", "scattered", "courtyards", "old_town"), "kinds of city, equally likely"
    )
    open_land: float = option(
        0.25, "probability that one side is left without buildings", ge=0, le=1
    )
    low_share: tuple[float, float] = option((0.0, 0.5), "share of buildings that are low")
    no_fly_zones: tuple[int, int] = option((0, 3), "number of no-fly zones")
    landing_zones: tuple[int, int] = option((1, 3), "number of landing zones")

    def __post_init__(self):
        require_bounds(self, "cities")
        for name, least, most in (
            ("sizes", 8, 100),
            ("low_share", 0, 1),
            ("no_fly_zones", 0, self.sizes[0]),
            ("landing_zones", 1, self.sizes[0]),
        ):
            low, high = getattr(self, name)
            if not least <= low <= high <= most:
                raise InputError(
                    f"{name} from {low} to {high}: must be from {least} to {most}, "
                    "the first not above the second"
                )
        unknown = [kind for kind in self.kinds if kind not in BUILDERS]
        if unknown or not self.kinds:
            found = repr(unknown[0]) if unknown else "none"
            raise InputError(f"kind of city: {found}; choose from {', '.join(BUILDERS)}")

    def draw(self, count: int, seed: int) -> Cities:
        """The first `count` cities of this seed; more of them begin with the same ones."""
        if count < 1:
            raise InputError(f"{count} cities: must be at least 1")
        generator = stream(Use.CITY, seed)
        cities = []
        for number in range(count):
            kind = self.kinds[generator.integers(len(self.kinds))]
            size = _whole(generator, *self.sizes)  # draws nothing if all cities have one size
            cities.append(self._draw_one(f"{kind}_{seed}_{number}", kind, size, generator))
        return Cities(tuple(cities))

    def _draw_one(self, name: str, kind: str, size: int, generator: np.random.Generator) -> City:
        for _ in range(MOST_TRIES):
            buildings = BUILDERS[kind](size, generator)
            if generator.random() < self.open_land:
                _clear_one_side(buildings, generator)
            low_share = generator.uniform(*self.low_share)
            low = generator.random(buildings.max() + 1) < low_share
            cells = np.where(buildings == 0, FREE, np.where(low[buildings], LOW, TALL))
            _add_no_fly_zones(cells, _whole(generator, *self.no_fly_zones), generator)
            cut_off = _close_what_is_cut_off(cells)
            room = _add_landing_zones(cells, _whole(generator, *self.landing_zones), generator)
            # Hardly a city, or hardly one to fly in: draw it again.
            few = np.isin(cells, (LOW, TALL)).mean() < LEAST_BUILT
            if room and not few and cut_off <= MOST_CUT_OFF * size**2:
                return City.from_kinds(name, cells)
        raise InputError(
            f"no city with these parameters in {MOST_TRIES} tries: "
            "ask for fewer landing zones or no-fly zones, or for a larger size"
        )


def load_city(name: str | Path) -> City | Cities:
    """The city or the cities of a name.

    | name | what |
    | --- | --- |
    | `manhattan` | a shipped city |
    | `my_city.png` | the city of a PNG file |
    | `my_cities` | the cities of all PNG files in this folder |
    | `random:300:1` | the first 300 random cities of seed 1, of 16×16 cells |
    | `random:300:1:24` | the same of 24×24 cells; `random:300:1:8-50`: of 8 to 50 cells a side |

    Raises `CityError` for anything else.
    """
    if str(name).startswith(RANDOM):
        found = re.fullmatch(RANDOM + r"(\d+):(\d+)(?::(\d+)(?:-(\d+))?)?", str(name))
        if found is None:
            raise CityError(
                f"{name}: write random:COUNT:SEED, such as {RANDOM}300:1, or with sizes "
                f"{RANDOM}300:1:24 or {RANDOM}300:1:8-50"
            )
        count, seed, least, most = found.groups()
        sizes = (int(least), int(most or least)) if least else CityGenerator.sizes
        return CityGenerator(sizes).draw(int(count), int(seed))
    return Cities.load(name) if Path(name).is_dir() else City.load(name)


def _whole(generator: np.random.Generator, least: int, most: int) -> int:
    """A whole number, both ends included."""
    return int(generator.integers(least, most, endpoint=True))


# Where the buildings stand. Each function gives the number of the building in each cell, from 1 on,
# 0 for none; (M, M) ints.


def _blocks(size: int, generator: np.random.Generator) -> np.ndarray:
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
                if height >= width:
                    alley = generator.integers(1, height - 1)
                    block[alley], block[alley + 1 :] = 0, number + 1
                else:
                    alley = generator.integers(1, width - 1)
                    block[:, alley], block[:, alley + 1 :] = 0, number + 1
            elif use < 0.5 and min(height, width) >= 2:  # a missing corner
                corner = np.rot90(block, _whole(generator, 0, 3))
                corner[: len(corner) // 2, : corner.shape[1] // 2] = 0
    return buildings


def _scattered(size: int, generator: np.random.Generator) -> np.ndarray:
    buildings = np.zeros((size, size), int)
    share = generator.uniform(0.15, 0.28)
    _add_houses(buildings, share, 4, generator)
    return buildings


def _courtyards(size: int, generator: np.random.Generator) -> np.ndarray:
    """Closed blocks first, then walls, then houses in what is left."""
    buildings = np.zeros((size, size), int)
    most = min(9, size - 2)
    for _ in range(max(1, round(generator.uniform(2.5, 5) * size**2 / 256))):
        shape = generator.integers(5, most, 2, endpoint=True)
        place = _find_room(buildings, shape, generator)
        if place is None:
            continue
        block = buildings[place]
        block[:] = buildings.max() + 1
        inside = block[1:-1, 1:-1]
        inside[:] = 0
        for _ in range(_whole(generator, 1, 2)):
            _open_gate(block, generator)
        if min(inside.shape) >= 5 and generator.random() < 0.6:
            inside[2:-2, 2:-2] = block.max()
    for _ in range(round(generator.uniform(1, 4) * size**2 / 256)):
        length = _whole(generator, 4, max(5, size // 2))
        shape = np.array((1, length) if generator.random() < 0.5 else (length, 1))
        place = _find_room(buildings, shape, generator)
        if place is not None:
            wall = buildings[place]
            wall[:] = buildings.max() + 1
            if length >= 6:  # a gap, so that a long wall is not always in the way
                wall.reshape(-1)[generator.integers(2, length - 2)] = 0
    _add_houses(buildings, (buildings > 0).mean() + 0.05, 2, generator)
    return buildings


def _old_town(size: int, generator: np.random.Generator) -> np.ndarray:
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
    cells = np.argwhere(buildings > 0)
    numbers = buildings[buildings > 0]
    count = np.bincount(numbers)[1:, None]
    middle = np.stack([np.bincount(numbers, axis) for axis in cells.T], axis=1)[1:] / count
    distance = np.hypot(*(middle - centre).T)
    gone = distance > generator.uniform(0.5, 0.75) * size
    gone[distance.argmin()] = True  # the market square
    buildings[np.isin(buildings, np.flatnonzero(gone) + 1)] = 0
    return buildings


def _add_houses(
    buildings: np.ndarray, share: float, longest: int, generator: np.random.Generator
) -> None:
    """Put houses with a gap around them until this share of all cells has buildings, or no room
    is found any more."""
    while (buildings > 0).mean() < share:
        shape = generator.integers(1, longest, 2, endpoint=True)
        shape = np.maximum(shape, 2 if shape.sum() < 3 and longest > 2 else 1)
        place = _find_room(buildings, shape, generator)
        if place is None:
            return
        buildings[place] = buildings.max() + 1


def _find_room(
    buildings: np.ndarray, shape: np.ndarray, generator: np.random.Generator
) -> tuple[slice, slice] | None:
    """A random place for a rectangle with a cell's gap to all buildings; None if there is none."""
    places = np.argwhere(_rectangles_without(buildings > 0, shape, gap=1))
    if not len(places):
        return None
    row, col = places[generator.integers(len(places))]
    return slice(row, row + shape[0]), slice(col, col + shape[1])


def _rectangles_without(mask: np.ndarray, shape: np.ndarray, gap: int = 0) -> np.ndarray:
    """For each north-west corner, whether a rectangle there, and `gap` cells around it, have no
    cell of `mask`; (M − rows + 1, M − cols + 1) bool."""
    padded = np.pad(mask, gap)
    window = tuple(int(length) + 2 * gap for length in shape)
    if min(np.array(padded.shape) - window) < 0:
        return np.zeros((0, 0), bool)
    windows = np.lib.stride_tricks.sliding_window_view(padded, window)
    return np.logical_not(windows.any(axis=(2, 3)))


def _open_gate(block: np.ndarray, generator: np.random.Generator) -> None:
    """A gate in one of the four walls around a yard."""
    wall = (block[0, 1:-1], block[-1, 1:-1], block[1:-1, 0], block[1:-1, -1])[generator.integers(4)]
    wall[generator.integers(len(wall))] = 0


BUILDERS: dict[str, Callable[[int, np.random.Generator], np.ndarray]] = {
    "blocks": _blocks,
    "scattered": _scattered,
    "courtyards": _courtyards,
    "old_town": _old_town,
}


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
    left = (cells != NO_FLY) & (cells != TALL)
    parts = []
    while left.any():
        part = np.zeros_like(left)
        part[tuple(np.argwhere(left)[0])] = True
        while True:
            grown = part | grow(part) & left
            if np.array_equal(grown, part):
                break
            part = grown
        parts.append(part)
        left &= ~part
    parts.sort(key=np.count_nonzero)
    for part in parts[:-1]:
        cells[part] = NO_FLY if (grow(part) & (cells == NO_FLY)).any() else TALL
    return sum(int(np.count_nonzero(part)) for part in parts[:-1])


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
        places = np.argwhere(room)
        if not len(places):
            return False
        row, col = places[generator.integers(len(places))]
        cells[row : row + shape[0], col : col + shape[1]] = LANDING
    return True
