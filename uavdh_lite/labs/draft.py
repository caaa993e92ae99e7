"""A city that is being painted: its cells, the tools that paint them, and what was there before."""

from collections.abc import Iterable
from copy import copy
from io import BytesIO
from typing import Any

import numpy as np

from uavdh_lite.city import COLOURS, LAYERS, City
from uavdh_lite.errors import CityError
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import png
from uavdh_lite.scenario import Scenario

Cell = tuple[int, int]

BRUSHES = {
    "free": 0,
    "no-fly zone": 1,
    "low building": 2,
    "landing zone": 3,
    "tall building": 4,
}
UPLOAD_BYTES = 100_000
MIRRORS = {  # of which axes, rows or columns, the far side is painted as well
    "no mirror": (),
    "left and right": (1,),
    "top and bottom": (0,),
    "both": (0, 1),
}


class Draft:
    """Kinds of cells on a square grid: a city that may still be incomplete.

    Arguments:
        kinds: (M, M) indices into `city.KINDS`; they are copied.
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

        Raises `CityError` if it has more than `UPLOAD_BYTES`, or if `City.load` refuses it.
        """
        if len(data) > UPLOAD_BYTES:
            raise CityError(
                f"the file has {len(data):,} bytes, at most {UPLOAD_BYTES:,} are read: "
                "one pixel for each cell is enough"
            )
        return cls(City.load(BytesIO(data)).kinds)

    @property
    def size(self) -> int:
        """M, the number of cells on a side."""
        return len(self.kinds)

    @property
    def own_size(self) -> int:
        """As `City.own_size`: a draft has nothing around it."""
        return self.size

    def description(self) -> str:
        """How many cells of each kind there are, as a sentence."""
        counts = {brush: int((self.kinds == kind).sum()) for brush, kind in BRUSHES.items()}
        said = ", ".join(f"{count} {brush}" for brush, count in counts.items() if count)
        return f"A city of {self.size}×{self.size} cells: {said}."

    @property
    def landing(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 0]

    @property
    def no_fly(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 1]

    @property
    def buildings(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 2]

    def paint(self, cell: Cell, brush: str) -> bool:
        """Paint a cell with one of `BRUSHES`; returns whether it changed. Ignores cells outside."""
        row, col = cell
        inside = 0 <= row < self.size and 0 <= col < self.size
        if not inside or self.kinds[row, col] == BRUSHES[brush]:
            return False
        self.kinds[row, col] = BRUSHES[brush]
        return True

    def region(self, cell: Cell) -> list[Cell]:
        """The cells that touch this one, side by side, and are of its kind; none from outside."""
        found, waiting = set(), [cell]
        while waiting:
            row, col = here = waiting.pop()
            inside = 0 <= row < self.size and 0 <= col < self.size
            if here in found or not inside or self.kinds[here] != self.kinds[cell]:
                continue
            found.add(here)
            waiting += [(row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)]
        return sorted(found)

    def mirrored(self, cells: Iterable[Cell], mirror: str) -> list[Cell]:
        """These cells and those opposite them in one of `MIRRORS`."""
        cells = list(cells)
        for axis in MIRRORS[mirror]:
            last = self.size - 1
            cells += [(last - r, c) if axis == 0 else (r, last - c) for r, c in cells]
        return cells

    def city(self, name: str = "my_city") -> City:
        """The city; raises `CityError` if it is incomplete."""
        return City.from_kinds(name, self.kinds)

    def png(self) -> bytes:
        """The PNG file that `City.load` reads, with one pixel for each cell."""
        return png(COLOURS[self.kinds])


def rectangle(corner: Cell, opposite: Cell) -> list[Cell]:
    """All cells of the rectangle with these two corners."""
    (top, bottom), (left, right) = (sorted(ends) for ends in zip(corner, opposite, strict=True))
    return [(r, c) for r in range(top, bottom + 1) for c in range(left, right + 1)]


def scenario_of(city: City) -> Scenario:
    """Missions over a painted city: up to three devices, with time to cross it about twice."""
    most, time = min(3, len(city.device_cells)), (2 * city.size, 4 * city.size)
    return Scenario("my_city", devices=(1, most), flying_time=time)


def is_changed(mission: Mission, drawn: Mission) -> bool:
    """Whether anything but the fading and the city is not as it was drawn."""
    names = "start", "devices", "data", "flying_time"
    return any(getattr(mission, name) != getattr(drawn, name) for name in names)


class History:
    """The states of what is being edited, to go back and forth between them.

    Arguments:
        most: how many are kept; the oldest are forgotten first.
    """

    def __init__(self, most: int = 200):
        self.most, self._states, self._at = most, [], -1

    def record(self, state: Any, new: bool = True) -> None:
        """Remember a state after the current one, or in place of it; what was undone is gone."""
        del self._states[self._at + new :]
        self._states.append(copy(state))
        del self._states[: -self.most]
        self._at = len(self._states) - 1

    def move(self, by: int) -> Any:
        """The state so many steps later, or earlier; None if there is none."""
        if not self.can(by):
            return None
        self._at += by
        return self._states[self._at]

    def can(self, by: int) -> bool:
        """Whether there is a state so many steps later, or earlier."""
        return 0 <= self._at + by < len(self._states)
