"""Exercises of notebook 4, what the network sees."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream

SMALL, CORNER = np.arange(1.0, 10.0).reshape(3, 3), np.array([[0.0, 3], [0, 0]])
SQUARES = {n: stream(Use.EXERCISE, n).integers(1, 9, (n, n)) for n in (1, 2, 4, 5, 8, 9)}
FRACTIONS = {n: stream(Use.EXERCISE, n).uniform(0, 9, (n, n)).round(3) for n in (2, 3, 6)}


@exercise(
    "4.1 · Centre a layer (2 points, 12 minutes)",
    rules={
        "The map has (2M − 1)×(2M − 1) cells, with the UAV's in the middle, at (M − 1, M − 1).": [
            (SMALL, (1, 1), 0.0),
            (SMALL, (0, 2), 0.0),
            (SQUARES[8], (0, 6), 0),
        ],
        "Outside the city the map is `outside`, which may be any number; zeros of the layer "
        "stay.": [(SMALL, (1, 0), 1), (SMALL, (1, 0), 7.0), (CORNER, (1, 0), 4.0)],
        "Make a map of floats, np.full(shape, outside, float), or take layer.astype(float): either "
        "the layer or `outside` may have fractions while the other has none.": [
            (FRACTIONS[2], (1, 0), 2),
            (FRACTIONS[6], (1, 4), 6),
            (SQUARES[2], (0, 1), 0.5),
            (FRACTIONS[2] < 4, (1, 0), 0.5),
        ],
        "M may be any number. With M = 1 the map is the layer.": [(SQUARES[1], (0, 0), 0)],
    },
    mistakes={
        "The shift goes the wrong way: if the UAV is further north, the city lies further "
        "south.": lambda layer, uav, outside: centre.solution(
            layer, [len(layer) - 1 - u for u in uav], outside
        ),
        "Rows and columns are swapped: the UAV is at (row, col).": (
            lambda layer, uav, outside: centre.solution(layer, uav[::-1], outside)
        ),
    },
)
def centre(layer, uav, outside):
    """`centre(layer, uav, outside)`: (2M − 1, 2M − 1), the UAV's cell in the middle."""
    m = len(layer)
    wide = np.full((7 * m, 7 * m), outside, float)
    wide[3 * m : 4 * m, 3 * m : 4 * m] = layer
    row, col = (3 * m + u - m + 1 for u in uav)
    return wide[row : row + 2 * m - 1, col : col + 2 * m - 1]


def scattered(size, uav, count):
    """Arguments of `data_layer` for so many devices in a city of this size."""
    generator = stream(Use.EXERCISE, 10 * size + count)
    cells = generator.permutation(size * size)[:count]
    places = [divmod(int(cell), size) for cell in cells]
    return size, uav, places, generator.uniform(1, 20, count).round(1)


@exercise(
    "4.2 · The devices on the map (2 points, 12 minutes)",
    rules={
        "The map has (2M − 1)×(2M − 1) cells. On it, a device is as far from the middle, (M − 1, "
        "M − 1), as its cell is from the UAV's, and its data goes there; all else is 0.": [
            (3, (1, 1), 1),
            (3, (0, 2), 2),
            (4, (3, 1), 2),
        ],
        "There may be any number of devices, even none, and one may be right below the UAV.": [
            (3, (2, 0), 0),
            (3, (1, 2), 9),
            (1, (0, 0), 1),
            (16, (15, 0), 40),
        ],
    },
    mistakes={
        "Your map shows the city's own cells: shift them so that the UAV is in the middle.": (
            lambda size, uav, devices, data: data_layer.solution(
                size, (size - 1, size - 1), devices, data
            )
        ),
        "The signs are the wrong way round: a device further south than the UAV lies below the "
        "middle, one further east to the right of it.": (
            lambda *case: data_layer.solution(*case)[::-1, ::-1]
        ),
        "Rows and columns are swapped: places are (row, col).": (
            lambda *case: data_layer.solution(*case).T
        ),
    },
    case=scattered,
)
def data_layer(size, uav, devices, data):
    """`data_layer(size, uav, devices, data)`: the centred layer “data left”, (2M − 1, 2M − 1)."""
    layer = np.zeros((2 * size - 1, 2 * size - 1))
    for (row, col), left in zip(devices, data, strict=True):
        layer[row - uav[0] + size - 1, col - uav[1] + size - 1] = left
    return layer
