"""Exercises of notebook 4, map centring."""

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.values import array_of_numbers, or_none, pair
from uavdh_lite.plotting import BLUE
from uavdh_lite.streams import Use, stream


def _draw_city_cell(ax, solved):
    size, uav = 5, (1, 3)
    for place in np.ndindex(2 * size - 1, 2 * size - 1):
        cell = solved(place, uav, size)
        text = "–" if cell is None else "{},{}".format(*cell)
        ax.text(*place[::-1], text, ha="center", va="center", fontsize=7)
    ax.plot(size - 1, size - 1, "s", mfc="none", mec=BLUE, ms=17)
    ax.set(xlim=(-0.5, 8.5), ylim=(8.5, -0.5), aspect="equal", xticks=range(9), yticks=range(9))
    ax.set(xlabel="column of the map", ylabel="row of the map")
    ax.set_title(f"M = {size}, UAV over {uav}: the cells of the city")


PLACES = [
    *(((7, 7), (3, 5), 8), ((3, 3), (2, 1), 4)),
    *(
        (place, uav, size)
        for size in (2, 3)
        for place in np.ndindex(2 * size - 1, 2 * size - 1)
        for uav in np.ndindex(size, size)
    ),
]
CELL = "p + u - size + 1"


@solution(
    "4.1 · From the map back to the city (1 point, 8 minutes)",
    "Which cell of the city is in the middle of the map? Then count from the middle.",
    "The UAV's cell is in the middle of the map, (M − 1, M − 1). So the city's row is "
    "place[0] − (M − 1) + uav[0]; it exists if it is from 0 to M − 1. The same for columns.",
    figure=_draw_city_cell,
    rules={
        "The UAV's cell is in the middle of the map, at (M − 1, M − 1). It is inside the city, "
        "as any cell with row and column from 0 to M − 1.": lambda *case: True,
        "A place so many rows below the middle, and so many columns to its right, shows the "
        "cell as far from the UAV's: count from (M − 1, M − 1). Row 0 and column 0 are in the "
        "city, and so are row M − 1 and column M − 1.": lambda place, uav, size: size < 4,
        "A place whose row or column would be below 0, or M or more, is outside the city: "
        "None. (numpy would take a negative one.)": lambda *case: not city_cell.solved(*case),
    },
    among=PLACES,
    mistakes={
        "That is the other direction, from the city to the map: here the place in the map is given "
        "and the cell of the city is wanted.": edit(CELL, "p - u + size - 1"),
        "The shift goes the wrong way: east stays east.": edit(CELL, "u - p + size - 1"),
        "You are off by one: the middle is M − 1, counted from 0.": edit(CELL, "p + u - size"),
        "Rows and columns change places in yours: place, uav and result are all (row, col).": (
            *(edit("(place, uav", "(place, uav[::-1]"), edit("(place, uav", "(place[::-1], uav")),
        ),
    },
    read=or_none(pair),
)
def city_cell(place, uav, size):
    """`city_cell(place, uav, size)`: the cell at a place of the centred map, None outside."""
    cell = tuple(p + u - size + 1 for p, u in zip(place, uav, strict=True))
    return cell if min(cell) >= 0 and max(cell) < size else None


def _draw_centre(ax, solved):
    uav = (2, 11)
    ax.imshow(solved(City.load("manhattan").no_fly, uav, 1), cmap="magma_r", vmin=0, vmax=1.5)
    ax.plot(15, 15, "+", color=BLUE, ms=12, mew=2)
    ax.set(xlabel="column of the map", ylabel="row of the map", xticks=(0, 15, 30))
    ax.set(yticks=(0, 15, 30), title=f"no-fly layer, UAV over {uav}, 1 outside")


SMALL = np.arange(1.0, 10.0).reshape(3, 3)
LAYERS = {n: stream(Use.EXERCISE, n).integers(1, 9, (n, n)) for n in (1, 2, 4, 5, 8, 9)}
FRACTIONS = {n: stream(Use.EXERCISE, n).uniform(0, 9, (n, n)).round(3) for n in (2, 3, 6)}


def _place(layer, uav, outside, place):
    cell = city_cell.solved(place, uav, len(layer))
    shows = "is outside the city" if cell is None else f"shows the city's cell {cell}"
    return f"With M = {len(layer)} and the UAV over {uav}, the place {place} of the map {shows}."


CORNER = "u - m + 1"


@solution(
    "4.2 · Centre a layer (2 points, 14 minutes)",
    "Begin with a map that has the value `outside` everywhere. Where does the city's corner "
    "(0, 0) come to lie if the UAV's cell is in the middle?",
    "The city's cell (0, 0) goes to (M − 1 − uav[0], M − 1 − uav[1]), and the M×M cells from "
    "there on are the layer. Or surround the layer by M − 1 cells on all sides (np.pad) and "
    "cut out the 2M − 1 rows from uav[0] on, and as many columns from uav[1] on.",
    figure=_draw_centre,
    rules={
        "The map has (2M − 1)×(2M − 1) cells, the UAV's in the middle, at (M − 1, M − 1); M may be "
        "any number.": [
            *((SMALL, uav, 0.0) for uav in ((1, 1), (0, 2), (2, 0), (2, 1), (0, 1))),
            *((LAYERS[1], (0, 0), 0), (LAYERS[4], (1, 3), 0), (LAYERS[5], (4, 2), 0)),
            *((LAYERS[8], (0, 6), 0), (LAYERS[9], (7, 5), 0)),
        ],
        "Everywhere outside the city the map is `outside`, any number; zeros of the layer stay.": [
            *((SMALL, (1, 0), 1), (SMALL, (1, 0), 7.0), (np.array([[0.0, 3], [0, 0]]), (1, 0), 4.0))
        ],
        "Make a map of floats, np.full(shape, outside, float), or layer.astype(float) first: the "
        "layer or `outside` may be a fraction, and the other a whole number or a Boolean.": [
            *((FRACTIONS[2], (1, 0), 2), (FRACTIONS[6], (1, 4), 6), (LAYERS[2], (0, 1), 0.5)),
            *(
                (LAYERS[5], (4, 1), 2),
                (FRACTIONS[2] < 4, (1, 0), 0.5),
                (FRACTIONS[3] < 4, (2, 0), 3),
            ),
        ],
    },
    mistakes={
        "The shift goes the wrong way: where the UAV is further north, the city lies further "
        "south.": (edit(CORNER, "-u"), edit(CORNER, "u - 2 * m + 2")),
        "Rows and columns are swapped: the UAV is at (row, col).": edit("in uav", "in uav[::-1]"),
    },
    read=array_of_numbers,
    why=_place,
    errors={
        "broadcast": "The layer does not fit where you put it: the UAV's cell goes to M − 1, so "
        "the city begins in row M − 1 − uav[0], and reaches M cells further.",
    },
)
def centre(layer, uav, outside):
    """`centre(layer, uav, outside)`: (2M − 1, 2M − 1), the UAV's cell in the middle."""
    m = len(layer)
    wide = np.pad(layer.astype(float), 3 * m, constant_values=outside)
    row, col = (3 * m + u - m + 1 for u in uav)
    return wide[row : row + 2 * m - 1, col : col + 2 * m - 1]


def _draw_weights(ax, solved):
    convolution, layer = "convolution, 16 kernels of 5×5", "fully connected"
    rows = [[convolution, "5×31×31", "16×27×27"], [convolution, "16×27×27", "16×23×23"]]
    rows += [["list, and the flying time", "16×23×23 and 1", "8465"], [layer, "8465", "256"]]
    rows += [[layer, "256", "256"], [layer, "256", "256"], [layer, "256", "6"]]
    centred = {"loc": "center", "cellLoc": "center", "colWidths": (0.5, 0.25, 0.25)}
    ax.table(rows, colLabels=["part", "gets", "gives"], **centred).scale(1, 1.6)
    ax.axis("off")
    ax.set_title("shapes in the paper's network, M = 16")


def _parts(layers, size, kernels, kernel_size, strides, hidden, _):
    """What the layers have, one by one."""
    side, parts = 2 * size - 1, []
    for stride in strides:
        parts.append(f"{kernels}·({layers}·{kernel_size}² + 1)")
        side, layers = (side - kernel_size) // stride + 1, kernels
    width = kernels * side**2 + 1
    listed = (
        f"After the convolutions {side}×{side} cells are left, so the list has {width} numbers."
    )
    for neurons in (*hidden, 6):
        parts.append(f"{neurons}·({width} + 1)")
        width = neurons
    return f"{listed} Layer by layer: {' + '.join(parts)}."


HIDDEN = (9,), (30, 8), (8, 9, 10, 7)
STEP = "(side - kernel_size) // stride + 1"


@solution(
    "4.3 · How many weights? (3 points, 25 minutes)",
    "Follow the shape of the map through the network, as in a table: layers and side before "
    "and after each convolution, then the length of the list, then layer by layer. Each kernel "
    "and each neuron has a bias.",
    "A convolution has c·k·k weights and one bias a kernel, where c is the number of layers "
    "that it gets, and leaves (side − k) // stride + 1 cells a side. The list has kernels · "
    "side² numbers and the flying time. From n to m neurons: n·m + m. The output has 6.",
    figure=_draw_weights,
    rules={
        "A kernel has a weight for each cell of its square and each layer that it sees, a neuron "
        "one for each number that it is given. The list has the numbers of all kernels, and the "
        "flying time is one more; the output has 6 values. Each kernel and each neuron, those of "
        "the output too, has a bias of its own.": [
            *((2, 2, 3, 2, (1,), (4,)), (1, 2, 1, 1, (1,), (1,)), (3, 3, 2, 3, (1,), (5,))),
            *((4, 2, 7, 2, (1,), (3, 2)), (5, 5, 2, 9, (1,), (4,)), (1, 1, 6, 1, (1,), (2,))),
        ],
        "(side − kernel_size) // stride + 1 cells a side are left: kernels lie wholly inside. "
        "Divide side − kernel_size by the stride and round down, and add the 1 after that.": [
            *((2, 3, 4, 2, (2,), (6,)), (2, 3, 4, 2, (3,), (6,)), (2, 3, 4, 2, (4,), (6,))),
            *((3, 12, 9, 3, (3,), (20,)), (2, 9, 3, 4, (6,), (8,))),
        ],
        "A second convolution sees as many layers as the first has kernels, and has its own "
        "stride, and so on, for any number of convolutions and hidden layers. The paper's "
        "network has 2,308,854.": [
            *((5, 16, 16, 5, (1, 1), (256, 256, 256)), (4, 13, 8, 4, (3, 2), (64, 32))),
            *((4, 16, 9, 3, s, h) for s in ((1,), (2, 1), (1, 2, 2)) for h in HIDDEN),
        ],
    },
    mistakes={
        "The flying time is missing: it is one more number in the list.": edit("2 + 1", "2"),
        "Biases are missing. Each kernel and each neuron, those of the output too, has one.": (
            *(edit("+ kernels", ""), edit("+ neurons", "")),
            edit("+ kernels", "", "+ neurons", ""),
        ),
        "The map has 2M − 1 cells a side, neither M nor 2M.": (
            *(edit("2 * size - 1", "size"), edit("2 * size - 1", "2 * size")),
        ),
        "Each convolution makes the map smaller: without padding a kernel fits at (side − "
        "kernel_size) // stride + 1 places a side.": (
            *(edit(STEP, "-(-side // stride)"), edit(STEP, "side // stride"), edit(STEP, "side")),
            edit(STEP, "(side + 2 * (kernel_size // 2) - kernel_size) // stride + 1"),
        ),
    },
    tolerance=1e-9,
    why=_parts,
)
def network_weights(layers, size, kernels, kernel_size, strides, hidden):
    """`weights(layers, size, kernels, kernel_size, strides, hidden)`: of the centred Q-network."""
    side, channels, total = 2 * size - 1, layers, 0
    for stride in strides:
        total += kernels * channels * kernel_size**2 + kernels
        side = (side - kernel_size) // stride + 1
        channels = kernels
    width = kernels * side**2 + 1
    for neurons in (*hidden, 6):
        total += width * neurons + neurons
        width = neurons
    return total
