"""A city that is being drawn, and need not be one yet."""

import io
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from uavdh_lite.city import COLOURS, LAYERS, City
from uavdh_lite.errors import CityError

BRUSHES = {
    "free": 0,
    "no-fly zone": 1,
    "low building": 2,
    "landing zone": 3,
    "tall building": 4,
}
UPLOAD_BYTES = 100_000


class Draft:
    """Kinds of cells on a square grid; the layers of a `City` without its demands.

    Arguments:
        kinds: (M, M) indices into `city.KINDS`.
    """

    def __init__(self, kinds: np.ndarray):
        self.kinds = np.array(kinds, np.uint8)

    @classmethod
    def blank(cls, size: int) -> "Draft":
        """Free cells only."""
        return cls(np.zeros((size, size), np.uint8))

    @classmethod
    def from_png(cls, data: bytes) -> "Draft":
        """The city of an uploaded PNG.

        Raises `CityError` for more than `UPLOAD_BYTES`, and for all that `City.load` refuses.
        """
        if len(data) > UPLOAD_BYTES:
            raise CityError(f"the file has {len(data):,} bytes, at most {UPLOAD_BYTES:,} are read")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "upload.png")
            path.write_bytes(data)
            try:
                return cls(City.load(path).kinds)
            except CityError as error:
                raise CityError(str(error).replace(f"{folder}/", "")) from None

    @property
    def size(self) -> int:
        """M, the number of cells a side."""
        return len(self.kinds)

    @property
    def landing(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 0]

    @property
    def no_fly(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 1]

    @property
    def buildings(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 2]

    def paint(self, cell: tuple[int, int], brush: str) -> bool:
        """Make a cell one of `BRUSHES`; whether that changed it. Cells outside are ignored."""
        row, col = cell
        inside = 0 <= row < self.size and 0 <= col < self.size
        if not inside or self.kinds[row, col] == BRUSHES[brush]:
            return False
        self.kinds[row, col] = BRUSHES[brush]
        return True

    def city(self, name: str = "my_city") -> City:
        """The city, if it is one; `CityError` says what it lacks."""
        return City.from_kinds(name, self.kinds)

    def png(self) -> bytes:
        """The PNG file, one pixel a cell, as `City.load` reads it."""
        buffer = io.BytesIO()
        Image.fromarray(COLOURS[self.kinds]).save(buffer, format="PNG")
        return buffer.getvalue()
