"""The city: a square grid of cells with three Boolean layers, stored as a PNG."""

import hashlib
import io
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image

from uavdh_lite import registry
from uavdh_lite.errors import CityError
from uavdh_lite.storage import data_folder, write_atomically

MAX_SIZE = 100  # cells on a side; line of sight takes size**4 bytes

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
KIND_LAYERS = read_only(np.array([layers for _, _, layers in KINDS]))


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
        # From a file: half a character fits into no figure, and a terminal obeys some
        name = "".join(sign if sign.isprintable() else "?" for sign in str(self.name))
        object.__setattr__(self, "name", name)
        for layer in ("landing", "no_fly", "buildings"):
            copy = np.array(getattr(self, layer), bool)
            object.__setattr__(self, layer, read_only(copy))
        shape = self.landing.shape
        if len(shape) != 2 or shape[0] != shape[1]:
            raise CityError(f"{self.name}: a city must be square, this one has the shape {shape}")
        if self.no_fly.shape != shape or self.buildings.shape != shape:
            raise CityError(f"{self.name}: the layers landing, no_fly, buildings differ in shape")
        if shape[0] > MAX_SIZE:
            raise CityError(f"{self.name}: {shape[0]} cells on a side, at most {MAX_SIZE} fit")
        if not self.landing.any():
            raise CityError(f"{self.name}: no start and landing zone; paint at least one cell blue")
        both = self.landing & (self.no_fly | self.buildings)
        if both.any():
            raise CityError(f"{self.name}: {_first(both)} is landing zone and no-fly or building")
        walled_in = self.landing & ~grow(~self.no_fly)
        if walled_in.any():
            raise CityError(
                f"{self.name}: landing cell {_first(walled_in)} lies inside a no-fly zone: "
                "the UAV cannot leave it; free a cell to its north, east, south or west"
            )
        if not self.open_to_devices.any():
            raise CityError(
                f"{self.name}: no cell for a device: all are buildings or landing zone; free one"
            )

    @property
    def size(self) -> int:
        """M, the number of cells on a side."""
        return self.landing.shape[0]

    @cached_property
    def open_to_devices(self) -> np.ndarray:
        """Where a device may stand: neither on a building nor in the landing zone; (M, M) bool."""
        return read_only(~self.buildings & ~self.landing)

    @cached_property
    def landing_distance(self) -> np.ndarray:
        """Moves from each cell to the nearest landing cell; (M, M) ints, −1 if none is reachable.

        Landing there takes one more unit of time.
        """
        return read_only(moves_from(self.landing, ~self.no_fly).astype(int))

    @cached_property
    def kinds(self) -> np.ndarray:
        """The kind of each cell, an index into `KINDS`; (M, M) uint8.

        A landing cell is never anything else, so the kinds say as much as the three layers.
        """
        # L is 3, N is 1, b is 2, and B, which is both, 4
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
        kinds = np.asarray(kinds)
        if kinds.ndim != 2 or kinds.dtype.kind not in "iu" or not np.isin(kinds, range(5)).all():
            raise CityError(f"{name}: kinds must be a square of whole numbers from 0 to 4")
        layers = KIND_LAYERS[kinds]
        return cls(name, layers[..., 0], layers[..., 1], layers[..., 2])

    @classmethod
    def from_text(cls, name: str, text: str) -> "City":
        """The city drawn with the signs of `KINDS`, one line per row; blanks are ignored."""
        text = text.removeprefix("\ufeff").strip()  # the mark with which Windows begins files
        rows = ["".join(line.split()) for line in text.splitlines()]
        if not rows:
            raise CityError(f"{name}: no rows; draw a city with the signs {SIGNS}")
        for r, row in enumerate(rows):
            if len(row) != len(rows):
                raise CityError(f"{name}: {len(rows)} rows, but row {r} has {len(row)} cells")
            for c, sign in enumerate(row):
                if sign not in SIGNS:
                    raise CityError(f"{name}: row {r}, column {c}: {sign!r} is none of {SIGNS}")
        return cls.from_kinds(name, np.array([[SIGNS.index(sign) for sign in row] for row in rows]))

    @classmethod
    def load(cls, source: str | Path) -> "City":
        """Read a city from a PNG: the path of a file, or the name of a shipped city.

        Raises `CityError` that names the file and the pixel if it is not a city. Warns of a part of
        the landing zone from which little of the city can be reached.
        """
        known, path = shipped_cities(), Path(source)
        if str(source) in known:
            path = data_folder() / "cities" / f"{source}.png"
        elif path.suffix == "" and not path.exists():
            choices = f"give a PNG's path, or one of {', '.join(known)}"
            raise CityError(f"no city named {path.name!r}: {choices}")
        kinds = _read_kinds(path)
        try:
            city = cls.from_kinds(path.stem, kinds)
        except CityError as error:
            raise CityError(f"{path}: {error}") from None
        open_cells = np.count_nonzero(~city.no_fly)
        for part in connected_parts(~city.no_fly):
            zone, reached = part & city.landing, np.count_nonzero(part)
            if zone.any() and reached < 0.75 * open_cells:
                warnings.warn(
                    f"{path}: from the landing zone at {_first(zone)}, the UAV reaches only "
                    f"{reached} of the {open_cells} cells without a no-fly zone",
                    stacklevel=2,
                )
        return city

    def save(self, path: str | Path) -> None:
        """Write the city as a PNG, one pixel per cell, atomically."""
        image = Image.fromarray(COLOURS[self.kinds])
        write_atomically(path, lambda temporary: image.save(temporary, format="PNG"))


def load_cities(name: str | Path) -> tuple[City, ...]:
    """The cities of a name: one of a shipped name or a PNG, several of a folder of PNGs.

    An extension may add a source of cities, named before a colon. Raises `CityError` for anything
    else.
    """
    source, colon, rest = str(name).partition(":")
    if colon and source in registry.names("cities"):
        return registry.find("cities", source)(rest)
    if str(name) in shipped_cities() or not Path(name).is_dir():
        return (City.load(name),)
    files = (path for path in Path(name).iterdir() if not path.name.startswith("."))
    paths = sorted(path for path in files if path.suffix.lower() == ".png")
    if not paths:
        raise CityError(f"{name}: no PNG files in this folder; draw a city, one pixel a cell")
    return tuple(map(City.load, paths))


def load_city(name: str | Path) -> City:
    """The city of a name; raises `CityError` if there are several."""
    cities = load_cities(name)
    if len(cities) > 1:
        raise CityError(f"{name}: {len(cities)} cities; name a single one")
    return cities[0]


def fingerprint_of(cities: tuple[City, ...]) -> str:
    """SHA-256 of the cities' fingerprints; of a single one, its own."""
    if len(cities) == 1:
        return cities[0].fingerprint
    return hashlib.sha256("".join(city.fingerprint for city in cities).encode()).hexdigest()


def described(cities: tuple[City, ...]) -> str:
    """Cities in an error: the name of the first, how many there are, and how large they are."""
    size, others = max(city.size for city in cities), " and others" * (len(cities) > 1)
    return f"{cities[0].name}{others} ({len(cities)} of {size} × {size} cells)"


def shipped_cities() -> list[str]:
    """The names of the cities that come with the package."""
    return sorted(path.stem for path in (data_folder() / "cities").glob("*.png"))


def _read_kinds(path: Path) -> np.ndarray:
    """The kinds of a PNG's pixels, (rows, columns) indices into `KINDS`."""
    try:
        content = io.BytesIO(path.read_bytes())
    except OSError as error:
        raise CityError(f"{path}: cannot be read ({error})") from None
    pixels = np.empty((0, 0, 4), np.uint8)
    try:
        image = Image.open(content, formats=["PNG"])
        small = max(image.size) <= MAX_SIZE  # known from the header: nothing large is decoded
        if small:
            image.verify()  # tests the checksums; afterwards the file must be opened again
            pixels = np.asarray(Image.open(content, formats=["PNG"]).convert("RGBA"))
    except Exception:  # Pillow raises many types for damaged files
        raise CityError(f"{path}: not a readable PNG file, or a damaged one") from None
    if not small:
        size = " × ".join(map(str, image.size))
        raise CityError(f"{path}: {size} pixels, at most {MAX_SIZE} on a side fit")
    on, off = pixels[..., :3] >= ON, pixels[..., :3] <= OFF
    matches = (on[:, :, None] == (COLOURS > 0)).all(-1)
    clear = (on | off).all(-1) & (pixels[..., 3] == 255)
    unknown = ~matches.any(-1) | ~clear
    if unknown.any():
        row, col = np.argwhere(unknown)[0]
        shown = pixels[row, col].tobytes().hex()  # red, green, blue and opacity
        shown += "" if shown.endswith("ff") else " (not opaque)"
        known = ", ".join(f"#{colour.tobytes().hex()}" for colour in COLOURS)
        raise CityError(f"{path}: pixel row {row}, column {col} is #{shown}, not one of {known}")
    return matches.argmax(-1)


def grow(mask: np.ndarray) -> np.ndarray:
    """The cells with a neighbour in the mask to the north, east, south or west; (M, M, ...) bool.

    Axes after the first two hold more masks.
    """
    grown = np.zeros_like(mask)
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    return grown


def moves_from(start: np.ndarray, open: np.ndarray) -> np.ndarray:
    """Moves from the cells of `start` to each cell, over open ones; −1 where no path leads.

    All are (M, M, ...), and the moves int16. Axes after the first two hold more masks.
    """
    moves, reached, step = np.full(start.shape, -1, np.int16), start & open, 0
    while reached.any():  # the cells that are this many moves away
        np.copyto(moves, step, where=reached)
        open = open & ~reached
        reached = grow(reached) & open
        step += 1
    return moves


def connected_parts(mask: np.ndarray) -> list[np.ndarray]:
    """The parts of a mask whose cells are connected, (M, M) bool each, the largest one last."""
    left, parts = mask, []
    while left.any():
        first = np.arange(left.size).reshape(left.shape) == left.argmax()
        parts.append(moves_from(first, left) >= 0)
        left = left & ~parts[-1]
    return sorted(parts, key=np.count_nonzero)


def _first(mask: np.ndarray) -> str:
    row, col = np.argwhere(mask)[0]
    return f"row {row}, column {col}"
