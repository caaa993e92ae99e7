"""Exercises of notebook 4, what the network sees."""

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.plotting import BLUE
from uavdh_lite.streams import Use, stream


def draw_city_cell(ax, city_cell):
    size, uav = 5, (1, 3)
    for place in np.ndindex(2 * size - 1, 2 * size - 1):
        cell = city_cell(place, uav, size)
        text = "–" if cell is None else "{},{}".format(*cell)
        ax.text(*place[::-1], text, ha="center", va="center", fontsize=7)
    ax.plot(size - 1, size - 1, "s", mfc="none", mec=BLUE, ms=17)
    ax.set(xlim=(-0.5, 8.5), ylim=(8.5, -0.5), aspect="equal", xticks=range(9), yticks=range(9))
    ax.set(xlabel="column of the map", ylabel="row of the map")
    ax.set_title(f"M = {size}, UAV over {uav}: the cells of the city")


def from_the_middle(place, uav, size):
    cell = tuple(p + u - size + 1 for p, u in zip(place, uav, strict=True))
    return cell if min(cell) >= 0 and max(cell) < size else None


PLACES = [
    (place, uav, size)
    for size in (2, 3)
    for place in np.ndindex(2 * size - 1, 2 * size - 1)
    for uav in np.ndindex(size, size)
]


@exercise(
    "4.1 · From the map back to the city (1 point, 8 minutes)",
    "Which cell of the city is in the middle of the map? Then count from the middle.",
    "The UAV's cell is in the middle of the map, (M − 1, M − 1). So the city's row is "
    "place[0] − (M − 1) + uav[0]; it exists if it is from 0 to M − 1. The same for columns.",
    figure=draw_city_cell,
    rules={
        "The UAV's cell is in the middle of the map, at (M − 1, M − 1).": [
            *(((7, 7), (3, 5), 8), ((3, 3), (2, 1), 4)),
        ],
        "A place so many rows below the middle, and so many columns to its right, shows the "
        "cell as far from the UAV's: count from (M − 1, M − 1). Row 0 and column 0 are in the "
        "city, and so are row M − 1 and column M − 1.": [
            case for case in PLACES if from_the_middle(*case)
        ],
        "A place whose row or column would be below 0, or M or more, is outside the city: None.": [
            case for case in PLACES if not from_the_middle(*case)
        ],
    },
    mistakes={
        "The shift goes the wrong way: east stays east.": (
            lambda place, uav, size: from_the_middle([2 * size - 2 - p for p in place], uav, size)
        ),
        "Rows and columns change places in yours: place, uav and result are all (row, col).": (
            lambda place, uav, size: from_the_middle(place, uav[::-1], size)
        ),
    },
)
def city_cell(place, uav, size):
    """`city_cell(place, uav, size)`: the cell at a place of the centred map, None outside."""
    return from_the_middle(place, uav, size)


def draw_centre(ax, centre):
    uav = (2, 11)
    ax.imshow(centre(City.load("manhattan").no_fly, uav, 1), cmap="magma_r", vmin=0, vmax=1.5)
    ax.plot(15, 15, "+", color=BLUE, ms=12, mew=2)
    ax.set(xlabel="column of the map", ylabel="row of the map", xticks=(0, 15, 30))
    ax.set(yticks=(0, 15, 30), title=f"no-fly layer, UAV over {uav}, 1 outside")


def centred(layer, uav, outside):
    m = len(layer)
    wide = np.full((7 * m, 7 * m), outside, float)
    wide[3 * m : 4 * m, 3 * m : 4 * m] = layer
    row, col = (3 * m + u - m + 1 for u in uav)
    return wide[row : row + 2 * m - 1, col : col + 2 * m - 1]


SMALL = np.arange(1.0, 10.0).reshape(3, 3)
LAYERS = {n: stream(Use.EXERCISE, n).integers(1, 9, (n, n)) for n in (1, 2, 4, 5, 8, 9)}
FRACTIONS = {n: stream(Use.EXERCISE, n).uniform(0, 9, (n, n)).round(3) for n in (2, 3, 6)}


@exercise(
    "4.2 · Centre a layer (2 points, 12 minutes)",
    "Begin with a map that has the value `outside` everywhere. Where does the city's corner "
    "(0, 0) come to lie if the UAV's cell is in the middle?",
    "The city's cell (0, 0) goes to (M − 1 − uav[0], M − 1 − uav[1]), and the M×M cells from "
    "there on are the layer. Or surround the layer by M − 1 cells on all sides (np.pad) and "
    "cut out the 2M − 1 rows from uav[0] on, and as many columns from uav[1] on.",
    figure=draw_centre,
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
            *((LAYERS[5], (4, 1), 2), (FRACTIONS[2] < 4, (1, 0), 0.5)),
            (FRACTIONS[3] < 4, (2, 0), 3),
        ],
    },
    mistakes={
        "The shift goes the wrong way: where the UAV is further north, the city lies further "
        "south.": lambda layer, uav, outside: centred(
            layer, [len(layer) - 1 - u for u in uav], outside
        ),
        "Rows and columns are swapped: the UAV is at (row, col).": (
            lambda layer, uav, outside: centred(layer, uav[::-1], outside)
        ),
    },
)
def centre(layer, uav, outside):
    """`centre(layer, uav, outside)`: (2M − 1, 2M − 1), the UAV's cell in the middle."""
    return centred(layer, uav, outside)


def draw_convolve(ax, convolve):
    buildings, edge = City.load("manhattan").buildings, np.array([[1.0, -1.0]])
    ax.imshow(convolve(buildings.astype(float), edge, 0.0), cmap="gray_r")
    ax.set(xlabel="column", ylabel="row", title="kernel [[1, −1]], bias 0: the eastern edges")


def windows(layer, kernel, bias, steps=1):
    seen = np.lib.stride_tricks.sliding_window_view(layer, kernel.shape)[::steps, ::steps]
    return (seen * kernel).sum((2, 3)) + bias


def drawn(rows, cols, height, width, bias=0.0):
    generator = stream(Use.EXERCISE, 10 * rows + cols)
    return (*(generator.normal(0, 1, s).round(1) for s in ((rows, cols), (height, width))), bias)


@exercise(
    "4.3 · A kernel moves over a map (2 points, 12 minutes)",
    "Do one place first: lay the kernel on the corner, multiply cell by cell, add up, add the "
    "bias. How many places are there along a side?",
    "There are rows − k + 1 places along the rows. At (i, j) the window is "
    "layer[i : i + k, j : j + k]; its value is (window * kernel).sum() + bias, or 0 if that is "
    "negative.",
    figure=draw_convolve,
    rules={
        "At each place the value is the sum of window times kernel, cell by cell. The kernel lies "
        "wholly inside, so rows − k + 1 places fit.": [
            *((np.ones((2, 2)), np.ones((1, 1)), 0.0), (np.ones((3, 3)), np.ones((2, 2)), 0.0)),
            (np.arange(9.0).reshape(3, 3), np.array([[0.0, 1.0], [2.0, 0.0]]), 0.0),
        ],
        "The kernel is laid on as it is: neither turned nor mirrored.": [
            (np.arange(9.0).reshape(3, 3), np.array([[0.0, 0.0], [1.0, 3.0]]), 0.0),
        ],
        "The bias is added once at every place.": [
            *((np.ones((3, 3)), np.ones((2, 2)), 1.5), (np.ones((2, 2)), np.ones((2, 2)), -3.0)),
        ],
        "ReLU comes last: what is below 0 becomes 0, and nothing else changes.": [
            *((np.ones((2, 2)), np.ones((1, 1)), -2.0), (-np.ones((2, 2)), np.ones((1, 1)), 1.5)),
            *(drawn(4, 4, 2, 2), drawn(5, 5, 3, 3, 0.4)),
        ],
        "Layer and kernel need not be square.": [
            *(drawn(3, 6, 2, 2, 0.3), drawn(6, 4, 2, 3, 0.9), drawn(4, 7, 4, 1, -0.2)),
        ],
    },
    mistakes={
        "ReLU is missing: what is below 0 becomes 0.": windows,
        "ReLU comes after the bias, not before it.": (
            lambda layer, kernel, bias: np.maximum(windows(layer, kernel, 0), 0) + bias
        ),
        "A kernel moves by one cell at a time, not by its own size.": (
            lambda layer, kernel, bias: np.maximum(windows(layer, kernel, bias, len(kernel)), 0)
        ),
    },
)
def convolve(layer, kernel, bias):
    """`convolve(layer, kernel, bias)`: one kernel's map after ReLU, without padding."""
    return np.maximum(windows(layer, kernel, bias), 0)


def draw_weights(ax, _):
    convolution, layer = "convolution, 16 kernels of 5×5", "fully connected"
    rows = [[convolution, "5×31×31", "16×27×27"], [convolution, "16×27×27", "16×23×23"]]
    rows += [["list, and the flying time", "16×23×23 and 1", "8465"], [layer, "8465", "256"]]
    rows += [[layer, "256", "256"], [layer, "256", "256"], [layer, "256", "6"]]
    at = {"loc": "center", "cellLoc": "center", "colWidths": (0.5, 0.25, 0.25)}
    ax.table(rows, colLabels=["part", "gets", "gives"], **at).scale(1, 1.6)
    ax.axis("off")
    ax.set_title("shapes in the paper's network, M = 16")


HIDDEN = (9,), (30, 8), (8, 9, 10, 7)


def count(layers, size, kernels, kernel_size, strides, hidden, side_of=lambda m: 2 * m - 1, time=1):
    side, total = side_of(size), 0
    for stride in strides:
        total += kernels * (layers * kernel_size**2 + 1)
        side, layers = (side - kernel_size) // stride + 1, kernels
    width = kernels * side**2 + time
    for neurons in (*hidden, 6):
        total += neurons * (width + 1)
        width = neurons
    return float(total)


@exercise(
    "4.4 · How many weights? (3 points, 15 minutes)",
    "Follow the shape of the map through the network, as in a table: layers and side before "
    "and after each convolution, then the length of the list, then layer by layer. Each kernel "
    "and each neuron has a bias.",
    "A convolution has c·k·k weights and one bias a kernel, where c is the number of layers "
    "that it gets, and leaves (side − k) // stride + 1 cells a side. The list has kernels · "
    "side² numbers and the flying time. From n to m neurons: n·m + m. The output has 6.",
    figure=draw_weights,
    rules={
        "A kernel has a weight for each cell of its square and each layer that it sees, a neuron "
        "one for each number that it is given. The list has the numbers of all kernels and the "
        "flying time; the output has 6 values. Each kernel and each neuron, those of the output "
        "too, has a bias of its own. Without padding, side − kernel_size + 1 places fit.": [
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
        "The flying time is missing: it is one more number in the list.": (
            lambda *case: count(*case, time=0)
        ),
        "The map has 2M − 1 cells a side, not M.": lambda *case: count(*case, side_of=int),
    },
)
def network_weights(layers, size, kernels, kernel_size, strides, hidden):
    """`weights(layers, size, kernels, kernel_size, strides, hidden)`: of the centred Q-network."""
    return count(layers, size, kernels, kernel_size, strides, hidden)
