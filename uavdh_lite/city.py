"""The city: a square grid of cells with three Boolean layers, stored as a PNG."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

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
            size = " × ".join(map(str, shape))
            raise CityError(f"{self.name}: a city must be square, this one is {size} cells")
        if self.no_fly.shape != shape or self.buildings.shape != shape:
            raise CityError(f"{self.name}: the layers landing, no_fly, buildings differ in shape")
        if shape[0] > MAX_SIZE:
            raise CityError(f"{self.name}: {shape[0]} cells on a side, at most {MAX_SIZE} fit")
        if not self.landing.any():
            raise CityError(f"{self.name}: no start and landing zone; paint at least one cell blue")
        both = self.landing & (self.no_fly | self.buildings)
        if both.any():
            raise CityError(f"{self.name}: {_first(both)} is landing zone and no-fly or building")
        walled_in = self.landing & ~_dilate(~self.no_fly)
        if walled_in.any() and shape[0] > 1:
            raise CityError(
                f"{self.name}: landing cell {_first(walled_in)} lies inside a no-fly zone: "
                "the UAV cannot leave it; free a cell to its north, east, south or west"
            )
        if not self.device_cells.size:
            raise CityError(f"{self.name}: no cell for a device: all are buildings or landing zone")

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
            grown = _dilate(reached) & ~self.no_fly | reached
            moves += 1
            new = grown & ~reached
            if not new.any():
                return read_only(distance)
            distance[new] = moves
            reached = grown

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
                    f"{path}: {height} × {width} pixels, at most {MAX_SIZE} on a side fit"
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


def _dilate(mask: np.ndarray) -> np.ndarray:
    """The cells that have a neighbour in `mask` to their north, east, south or west."""
    padded = np.pad(mask, 1)
    return padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]


def _first(mask: np.ndarray) -> str:
    row, col = np.argwhere(mask)[0]
    return f"row {row}, column {col}"
