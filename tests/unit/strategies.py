"""What more than one file of tests draws, and needs."""

from dataclasses import replace

from hypothesis import reject
from hypothesis import strategies as st

from uavdh_lite.city import City
from uavdh_lite.errors import CityError


@st.composite
def cities(draw, least: int):
    """Cities of `least` to 7 cells on a side."""
    size = draw(st.integers(least, 7))
    signs = draw(st.text("....LLNbB", min_size=size**2, max_size=size**2))
    rows = [signs[i : i + size] for i in range(0, size**2, size)]
    try:
        return City.from_text("drawn", "\n".join(rows))
    except CityError:
        reject()


def renumbered(state, own, size):
    """The state with the cells of a city of its own size as an environment of `size` has them."""
    cells = {name: getattr(state, name) for name in ("uav_cell", "device_cells")}
    return replace(state, **{name: cell // own * size + cell % own for name, cell in cells.items()})
