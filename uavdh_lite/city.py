"""The city: a square grid of cells with three Boolean layers, stored as a PNG."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from uavdh_lite.errors import CityError
from uavdh_lite.storage import data_folder, write_atomically

MAX_SIZE = 100  # cells on a side; the line-of-sight table holds size**4 bytes

# Each row is a kind of cell: its sign in a text drawing, its colour in a PNG (the palette of the
# authors' code, so that their maps load unchanged), and the layers that it sets.
KINDS = (
    # sign, colour, (landing, no_fly, building)
    (".", (0, 0, 0), (False, False, False)),  # free
    ("N", (255, 0, 0), (False, True, False)),  # no-fly zone
    ("b", (0, 255, 0), (False, False, True)),  # building that may be flown over
    ("L", (0, 0, 255), (True, False, False)),  # start and landing zone
    ("B", (255, 255, 0), (False, True, True)),  # building that may not be flown over
)
SIGNS = "".join(sign for sign, _, _ in KINDS)
ON, OFF = 224, 31  # a channel counts as set from ON upwards, as not set from OFF downwards


def read_only(array: np.ndarray) -> np.ndarray:
    """A view that cannot be written to, for an array that several callers share."""
    view = array.view()
    view.setflags(write=False)
    return view


COLOURS = read_only(np.array([colour for _, colour, _ in KINDS], np.uint8))
LAYERS = read_only(np.array([layers for _, _, layers in KINDS]))


@dataclass(frozen=True, eq=False)
class City:
    """A city of M×M cells; arrays are indexed `[row, col]`, north is row − 1, east is col + 1.

    The arrays are read-only. A cell also has one number, `row * M + col`.

    | field | shape | meaning |
    | --- | --- | --- |
    | `landing` | (M, M) bool | start and landing zone |
    | `no_fly` | (M, M) bool | cells the UAV may not enter: no-fly zones and tall buildings |
    | `buildings` | (M, M) bool | cells that block radio links |

    Raises `CityError` if the layers are not square or differ in shape, if there is no landing cell,
    if a landing cell is also a building or a no-fly cell or is walled in by them, or if no device
    fits.
    """

    name: str
    landing: np.ndarray
    no_fly: np.ndarray
    buildings: np.ndarray

    def __post_init__(self):
        for layer in ("landing", "no_fly", "buildings"):
            copy = np.array(getattr(self, layer), bool)
            object.__setattr__(self, layer, read_only(copy))
        self._check()

    def _check(self) -> None:
        shape = self.landing.shape
        if len(shape) != 2 or shape[0] != shape[1]:
            size = " × ".join(map(str, shape[::-1]))  # width first
            raise CityError(f"{self.name}: a city must be square, this one is {size} cells")
        if self.no_fly.shape != shape or self.buildings.shape != shape:
            raise CityError(f"{self.name}: the layers landing, no_fly, buildings differ in shape")
        if shape[0] > MAX_SIZE:
            raise CityError(f"{self.name}: {shape[0]} cells on a side, at most {MAX_SIZE} fit")
        if not self.landing.any():
            raise CityError(f"{self.name}: no start and landing zone; paint at least one cell blue")
        both = self.landing & (self.no_fly | self.buildings)
        if both.any():
            raise CityError(
                f"{self.name}: {_first(both)} is landing zone and no-fly or building: choose one"
            )
        walled_in = self.landing & ~grow(~self.no_fly)
        if walled_in.any() and shape[0] > 1:
            raise CityError(
                f"{self.name}: landing cell {_first(walled_in)} lies inside a no-fly zone: "
                "the UAV cannot leave it; free a cell to its north, east, south or west"
            )
        if not self.device_cells.size:
            raise CityError(
                f"{self.name}: no cell for a device: all are buildings or landing zone; free one"
            )

    @property
    def size(self) -> int:
        """M, the number of cells on a side."""
        return self.landing.shape[0]

    @cached_property
    def device_cells(self) -> np.ndarray:
        """The cells on which a device may stand: neither building nor landing zone; (n,) ints."""
        return read_only(np.flatnonzero(~self.buildings & ~self.landing))

    @cached_property
    def flight_cells(self) -> np.ndarray:
        """The cells that the UAV may enter; (n,) ints."""
        return read_only(np.flatnonzero(~self.no_fly))

    @cached_property
    def landing_cells(self) -> np.ndarray:
        """The cells of the start and landing zone; (n,) ints."""
        return read_only(np.flatnonzero(self.landing))

    @cached_property
    def landing_distance(self) -> np.ndarray:
        """Moves from each cell to the nearest landing cell; (M, M) ints, −1 if none is reachable.

        Landing there takes one more unit of time.
        """
        distance = np.where(self.landing, 0, -1)
        reached, moves = self.landing, 0
        while True:
            grown = grow(reached) & ~self.no_fly | reached
            moves += 1
            new = grown & ~reached
            if not new.any():
                return read_only(distance)
            distance[new] = moves
            reached = grown

    @cached_property
    def alone(self) -> "Cities":
        """The set that has only this city."""
        return Cities((self,))

    @cached_property
    def kinds(self) -> np.ndarray:
        """The kind of each cell, an index into `KINDS`; (M, M) uint8.

        A landing cell is never anything else, so the kinds say as much as the three layers.
        """
        kinds = self.landing * 3 + self.no_fly + self.buildings * (2 + self.no_fly)
        return read_only(kinds.astype(np.uint8))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the layers: equal for equal cities, whatever their names."""
        return hashlib.sha256(bytes([self.size]) + self.kinds.tobytes()).hexdigest()

    @property
    def text(self) -> str:
        """The city drawn with the signs of `KINDS`, one line per row; `City.from_text` reads it."""
        return "\n".join("".join(SIGNS[kind] for kind in row) for row in self.kinds)

    @classmethod
    def from_kinds(cls, name: str, kinds: np.ndarray) -> "City":
        """The city with these kinds of cells, (M, M) indices into `KINDS`."""
        layers = LAYERS[kinds]
        return cls(name, layers[..., 0], layers[..., 1], layers[..., 2])

    @classmethod
    def from_text(cls, name: str, text: str) -> "City":
        """The city drawn with the signs of `KINDS`, one line per row; blanks are ignored."""
        rows = ["".join(line.split()) for line in text.strip().splitlines()]
        for r, row in enumerate(rows):
            if len(row) != len(rows):
                raise CityError(f"{name}: {len(rows)} rows, but row {r} has {len(row)} cells")
            for c, sign in enumerate(row):
                if sign not in SIGNS:
                    raise CityError(f"{name}: row {r}, column {c}: {sign!r} is none of {SIGNS}")
        return cls.from_kinds(name, np.array([[SIGNS.index(sign) for sign in row] for row in rows]))

    @classmethod
    def load(cls, path: str | Path) -> "City":
        """Read a city from a PNG file; a bare name such as `manhattan` means a shipped city."""
        path = Path(path)
        if path.suffix == "" and not path.exists():
            path = _shipped(path.name)
        kinds = _read_kinds(path)
        try:
            return cls.from_kinds(path.stem, kinds)
        except CityError as error:
            raise CityError(f"{path}: {str(error).removeprefix(f'{path.stem}: ')}") from None

    def save(self, path: str | Path) -> None:
        """Write the city as a PNG, one pixel per cell, atomically."""
        image = Image.fromarray(COLOURS[self.kinds])
        write_atomically(path, lambda temporary: image.save(temporary, format="PNG"))


@dataclass(frozen=True, eq=False)
class Cities:
    """C cities of any sizes as one world, in which every episode has its own city.

    The cells are numbered on from city to city: cell (row, col) of city c, of M cells on a side,
    has the number `first_cell[c] + row * M + col`. So a cell's number says its city, too. The
    arrays are read-only, and have an entry for each of the n cells of all cities.

    | field | shape | meaning |
    | --- | --- | --- |
    | `cities` | tuple of C | the cities |
    | `first_cell`, `sizes` | (C,) ints | the number of a city's first cell; its cells on a side |
    | `city`, `row`, `col` | (n,) ints | the city of each cell, an index, and its place there |
    | `landing`, `no_fly`, `buildings` | (n,) bool | the layers of `City` |
    | `landing_distance` | (n,) ints | moves to the nearest landing cell, −1 if there is no path |

    Raises `CityError` if there is none.
    """

    cities: tuple[City, ...]

    def __post_init__(self):
        object.__setattr__(self, "cities", tuple(self.cities))
        if not self.cities:
            raise CityError("a set of cities needs at least one")

    @classmethod
    def load(cls, folder: str | Path) -> "Cities":
        """The cities of all PNG files in a folder, in the order of their names."""
        paths = sorted(Path(folder).glob("*.png"))
        if not paths:
            raise CityError(f"{folder}: no PNG files in it")
        return cls(tuple(map(City.load, paths)))

    def __len__(self) -> int:
        return len(self.cities)

    def __getitem__(self, index: int) -> City:
        return self.cities[index]

    @property
    def name(self) -> str:
        """The name of the only city, or how many there are."""
        return self.cities[0].name if len(self) == 1 else f"{len(self)} cities"

    @cached_property
    def size(self) -> int:
        """M, the number of cells on a side of the largest city."""
        return int(self.sizes.max())

    @cached_property
    def sizes(self) -> np.ndarray:
        return read_only(np.array([city.size for city in self.cities]))

    @cached_property
    def first_cell(self) -> np.ndarray:
        return read_only(np.cumsum(self.sizes**2) - self.sizes**2)

    @cached_property
    def cell_type(self) -> np.dtype:
        """The type of a cell's number in a `State`: int16, or int32 if that is too small."""
        return np.promote_types(np.int16, np.min_scalar_type(-len(self.city)))

    @cached_property
    def city(self) -> np.ndarray:
        return read_only(np.repeat(np.arange(len(self)), self.sizes**2))

    @cached_property
    def row(self) -> np.ndarray:
        return read_only(self.within // self.sizes[self.city])

    @cached_property
    def col(self) -> np.ndarray:
        return read_only(self.within % self.sizes[self.city])

    @cached_property
    def within(self) -> np.ndarray:
        """The number that each cell has in its city alone, `row * M + col`; (n,) ints."""
        return read_only(np.arange(len(self.city)) - self.first_cell[self.city])

    @cached_property
    def landing(self) -> np.ndarray:
        return self._layer("landing")

    @cached_property
    def no_fly(self) -> np.ndarray:
        return self._layer("no_fly")

    @cached_property
    def buildings(self) -> np.ndarray:
        return self._layer("buildings")

    @cached_property
    def landing_distance(self) -> np.ndarray:
        return self._layer("landing_distance")

    def _layer(self, name: str) -> np.ndarray:
        return read_only(np.concatenate([getattr(city, name).ravel() for city in self.cities]))

    def alike(self, pairs: int) -> Iterator[np.ndarray]:
        """The cities in groups of one size, as indices, for tables over all pairs of cells.

        Arguments:
            pairs: how many pairs of cells a group may have; more only if it is a single city.
        """
        for size in np.unique(self.sizes):
            same = np.flatnonzero(self.sizes == size)
            many = max(1, pairs // int(size) ** 4)
            yield from (same[first : first + many] for first in range(0, len(same), many))

    @cached_property
    def device_cells(self) -> "CellsByCity":
        """The cells on which a device may stand."""
        return self._by_city(~self.buildings & ~self.landing)

    @cached_property
    def landing_cells(self) -> "CellsByCity":
        """The cells of the start and landing zones."""
        return self._by_city(self.landing)

    @cached_property
    def home_cells(self) -> "CellsByCity":
        """The cells from which the UAV can reach a landing zone."""
        return self._by_city(self.landing_distance >= 0)

    def _by_city(self, mask: np.ndarray) -> "CellsByCity":
        cells = np.flatnonzero(mask)
        counts = np.bincount(self.city[cells], minlength=len(self))
        return CellsByCity(*map(read_only, (cells, np.cumsum(counts) - counts, counts)))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the cities' fingerprints; of one city, its own."""
        if len(self) == 1:
            return self.cities[0].fingerprint
        return hashlib.sha256(
            "".join(city.fingerprint for city in self.cities).encode()
        ).hexdigest()


class CellsByCity(NamedTuple):
    """Some cells of a set of cities: in city c `counts[c]` of `cells`, from `starts[c]` on."""

    cells: np.ndarray
    starts: np.ndarray
    counts: np.ndarray


def one_city(city: City | Cities) -> City:
    """The city where there is only one; raises `CityError` for several."""
    if isinstance(city, Cities):
        raise CityError(f"{city.name}: name one of them, or another (--city)")
    return city


def as_cities(city: City | Cities) -> Cities:
    """A set of cities; that of one, for one city."""
    return city if isinstance(city, Cities) else city.alone


def shipped_cities() -> list[str]:
    """The names of the cities that come with the package."""
    return sorted(path.stem for path in (data_folder() / "cities").glob("*.png"))


def _shipped(name: str) -> Path:
    if name not in shipped_cities():
        shipped = ", ".join(shipped_cities())
        raise CityError(f"no city named {name!r}: give the path of a PNG, or one of {shipped}")
    return data_folder() / "cities" / f"{name}.png"


def _read_kinds(path: Path) -> np.ndarray:
    """The kinds of the PNG's pixels, (rows, columns) indices into `KINDS`."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            if max(image.size) > MAX_SIZE:  # known from the header: nothing large is decoded
                width, height = image.size
                raise CityError(
                    f"{path}: {width} × {height} pixels, at most {MAX_SIZE} on a side fit"
                )
            image.verify()  # tests the checksums; afterwards the file must be opened again
        with Image.open(path, formats=["PNG"]) as image:
            pixels = np.asarray(image.convert("RGBA"))
    except FileNotFoundError:
        raise CityError(f"{path}: no such file") from None
    except CityError:
        raise
    except Exception as error:  # Pillow raises many types for damaged files
        raise CityError(f"{path}: not a readable PNG file ({error})") from None
    on, off = pixels[..., :3] >= ON, pixels[..., :3] <= OFF
    matches = (on[:, :, None] == (COLOURS > 0)).all(-1)
    clear = (on | off).all(-1) & (pixels[..., 3] == 255)
    unknown = ~matches.any(-1) | ~clear
    if unknown.any():
        row, col = np.argwhere(unknown)[0]
        red, green, blue, alpha = pixels[row, col]
        shown = f"#{red:02x}{green:02x}{blue:02x}" + ("" if alpha == 255 else f" (alpha {alpha})")
        known = ", ".join("#{:02x}{:02x}{:02x}".format(*colour) for colour in COLOURS)
        raise CityError(
            f"{path}: pixel row {row}, column {col} is {shown}, not one of {known} "
            f"(a channel counts as ff from {ON} up and as 00 up to {OFF})"
        )
    return matches.argmax(-1)


def grow(mask: np.ndarray) -> np.ndarray:
    """The cells that have a neighbour in `mask` to their north, east, south or west."""
    padded = np.pad(mask, 1)
    return padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]


def _first(mask: np.ndarray) -> str:
    row, col = np.argwhere(mask)[0]
    return f"row {row}, column {col}"
