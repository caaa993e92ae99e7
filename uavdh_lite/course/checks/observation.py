"""Exercises of notebook 4, map centring."""

import itertools

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.values import array_of_numbers, number, or_none, pair
from uavdh_lite.plotting import BLUE
from uavdh_lite.streams import Use, stream


def _city_cell(place, uav, size):
    cell = tuple(p + u - size + 1 for p, u in zip(place, uav, strict=True))
    return cell if min(cell) >= 0 and max(cell) < size else None


def _draw_city_cell(ax):
    size, uav = 5, (1, 3)
    for place in np.ndindex(2 * size - 1, 2 * size - 1):
        cell = _city_cell(place, uav, size)
        text = "–" if cell is None else "{},{}".format(*cell)
        colour = "#AAAAAA" if cell is None else "black"
        ax.text(place[1], place[0], text, ha="center", va="center", fontsize=7, color=colour)
    ax.plot(size - 1, size - 1, "s", mfc="none", mec=BLUE, ms=17)
    ax.set(xlim=(-0.5, 8.5), ylim=(8.5, -0.5), aspect="equal", xticks=range(9), yticks=range(9))
    ax.set(xlabel="column of the map", ylabel="row of the map")
    ax.set_title(f"M = {size}, UAV over {uav}: the cells of the city")


def _city_cell_cases():
    generator = stream(Use.EXERCISE, 4)

    def drawn(size):
        place, uav = generator.integers(0, 2 * size - 1, 2), generator.integers(0, size, 2)
        return tuple(place.tolist()), tuple(uav.tolist()), size

    cases = [drawn(size) for size in (2, 3, 4, 5, 7, 8, 16, 17) * 30]
    cases += [((0, 0), (0, 0), 1), ((4, 5), (3, 5), 8), ((9, 2), (3, 5), 8), ((8, 9), (3, 5), 8)]
    inside = [case for case in cases if _city_cell(*case)]

    def at(*rows):
        return [c for c in inside if set(_city_cell(*c)) & {row % c[2] for row in rows}]

    return {
        "The UAV's cell is in the middle of the map, at (M − 1, M − 1).": [
            ((size - 1, size - 1), uav, size)
            for uav, size in (((3, 5), 8), ((2, 1), 4), ((1, 1), 3), ((4, 2), 9))
        ],
        "A place so many rows below the middle, and so many columns to its right, shows the cell "
        "as far from the UAV's: count from (M − 1, M − "
        "1).": [c for c in inside if c not in at(0, -1)],
        "Row 0 and column 0 are in the city, and so are row M − 1 and column M − 1.": at(0, -1),
        "A place whose row or column would be below 0, or M or more, is outside the city: None.": [
            case for case in cases if not _city_cell(*case)
        ],
    }


CELL, IF_INSIDE = "p + u - size + 1", " if min(cell) >= 0 and max(cell) < size else None"


def _either_way(*texts):
    """A mistake, and the same with what is then outside of the city left in."""
    return edit(*texts), edit(*texts, IF_INSIDE, "")


CITY_CELL = Table(
    _city_cell,
    _city_cell_cases,
    mistakes={
        "A cell has no negative row or column, though numpy would take it, and none of M or more: "
        "outside the city give back None.": edit(IF_INSIDE, ""),
        "That is the other direction, from the city to the map: here the place in the map is given "
        "and the cell of the city is wanted.": _either_way(CELL, "p - u + size - 1"),
        "The shift goes the wrong way: east stays east.": _either_way(CELL, "u - p + size - 1"),
        "You count from the map's corner, but it is the middle of the map, (M − 1, M − 1), where "
        "the UAV is: subtract M − 1.": _either_way(CELL, "p + u"),
        "You are off by one: the middle of a map with 2M − 1 cells a side is M − 1, counted from "
        "0.": _either_way(CELL, "p + u - size"),
        "The middle of the map is at M − 1, not at M // 2: the map has 2M − 1 cells a side.": (
            _either_way(CELL, "p + u - size // 2")
        ),
        "You leave out where the UAV is: the same place of the map is another cell when it flies "
        "on.": _either_way(CELL, "p - size + 1"),
        "Rows and columns change places in yours: place, uav and result are all (row, col).": (
            *_either_way("(place, uav", "(place, uav[::-1]"),
            *_either_way("(place, uav", "(place[::-1], uav"),
            *_either_way("(place, uav", "(place[::-1], uav[::-1]"),
        ),
    },
    read=or_none(pair),
)


@exercise(
    "4.1 · From the map back to the city (1 point, 8 minutes)",
    "Which cell of the city is in the middle of the map? Then count from the middle.",
    "The UAV's cell is in the middle of the map, (M − 1, M − 1). So the city's row is "
    "place[0] − (M − 1) + uav[0]; it exists if it is from 0 to M − 1. The same for columns.",
    figure=_draw_city_cell,
    table=CITY_CELL,
)
def city_cell(answer) -> None:
    """`city_cell(place, uav, size)`: the cell at a place of the centred map, None outside."""


def _centre(layer, uav, outside):
    m = len(layer)
    wide = np.pad(layer.astype(float), 3 * m, constant_values=outside)
    row, col = (3 * m + u - m + 1 for u in uav)
    return wide[row : row + 2 * m - 1, col : col + 2 * m - 1]


def _draw_centre(ax):
    from uavdh_lite.observation import Observation
    from uavdh_lite.scenario import place

    city = City.load("manhattan")
    uav = (2, 11)
    state = place(city, uav, devices=[(4, 7)], data=[5], flying_time=40, max_devices=1)
    (maps,), _ = Observation(city, "centred")(state)
    ax.imshow(maps[0, 1].numpy(), cmap="magma_r", vmin=0, vmax=1.5)
    ax.plot(15, 15, "+", color=BLUE, ms=12, mew=2)
    ax.set(xlabel="column of the map", ylabel="row of the map", xticks=(0, 15, 30))
    ax.set(yticks=(0, 15, 30), title=f"no-fly layer, UAV over {uav}, 1 outside")


def _centre_cases():
    generator = stream(Use.EXERCISE, 6)
    small = np.arange(1.0, 10.0).reshape(3, 3)

    def whole(size):
        return generator.integers(1, 9, (size, size))

    return {
        "The map has (2M − 1)×(2M − 1) cells, the UAV's in the middle, at (M − 1, M − 1).": [
            *((small, uav, 0.0) for uav in ((1, 1), (0, 2), (2, 0), (2, 1), (0, 1))),
            (np.array([[1.0, 2], [3, 4]]), (0, 1), 0),
        ],
        "Everywhere outside the city the map is `outside`, any number; zeros of the layer stay.": [
            *((small, (1, 0), outside) for outside in (1, 7.0, -0.5)),
            (np.array([[0.0, 3], [0, 0]]), (1, 0), 4.0),
            (np.zeros((2, 2)), (0, 0), 2),
        ],
        "A layer of fractions keeps them, also if `outside` is a whole number.": [
            (generator.random((size, size)).round(3) * 9, uav, outside)
            for size, uav, outside in ((2, (1, 1), 0), (6, (1, 4), 7), (7, (5, 2), 1))
        ],
        "Whole numbers and Booleans become floats, so that `outside` may be a fraction.": [
            (whole(2), (0, 1), 0.5),
            *((whole(size), (size - 1, 1), outside) for size, outside in ((3, 0.25), (5, 2))),
            *(
                (generator.random((n, n)) < 0.5, (n - 1, 0), v)
                for n, v in ((2, 0.5), (3, 3), (8, 1))
            ),
        ],
        "Rows and columns are not the same, in the layer and in uav; M may be any number.": [
            (np.array([[7.0]]), (0, 0), 1.0),
            *((whole(n), tuple(generator.integers(0, n, 2).tolist()), 0) for n in (4, 5, 8, 9)),
        ],
    }


def _place(layer, uav, outside, place):
    cell = _city_cell(place, uav, len(layer))
    shows = "is outside the city" if cell is None else f"shows the city's cell {cell}"
    return f"With M = {len(layer)} and the UAV over {uav}, the place {place} of the map {shows}."


OUTSIDE, CORNER = "constant_values=outside", "u - m + 1"
CENTRE = Table(
    _centre,
    _centre_cases,
    mistakes={
        "The map has the type of its layer in yours, Booleans or whole numbers, and `outside` "
        "may be any number. Make a map of floats: np.full(shape, outside, float), or "
        "layer.astype(float) first.": edit(".astype(float)", ""),
        "The shift goes the wrong way: where the UAV is further north, the city lies further "
        "south.": (edit(CORNER, "-u"), edit(CORNER, "u - 2 * m + 2")),
        "The city is one cell too far south-east: the middle of 2M − 1 cells is M − 1, counted "
        "from 0.": edit(CORNER, "u - m"),
        "The city is one cell too far north-west: the middle of 2M − 1 cells is M − 1, counted "
        "from 0.": edit(CORNER, "u - m + 2"),
        "The city lies always at the same place: it must move so that the UAV's cell is in the "
        "middle.": (edit(CORNER, "-((m - 1) // 2)"), edit(CORNER, "0")),
        "Outside the city yours is 0, not the value `outside`.": edit(OUTSIDE, "constant_values=0"),
        "You replace each 0 by `outside`, also those of the layer itself: they must stay 0.": (
            edit("return", "wide[wide == 0] = outside; return")
        ),
        "Outside the city yours is 1, not the value `outside`.": edit(OUTSIDE, "constant_values=1"),
        "Rows and columns are swapped: the UAV is at (row, col).": edit("in uav", "in uav[::-1]"),
        "Rows and columns are swapped: the map is transposed.": edit("- 1]", "- 1].T"),
        "The city goes round at the border in yours: beyond its last row comes `outside`, not "
        "its first row. (A negative index takes cells from the other end.)": (
            edit(OUTSIDE, 'mode="wrap"')
        ),
        "Your map has whole numbers where the layer has fractions: np.full takes its dtype from "
        "the number that it is given. Make it np.full(shape, outside, float).": (
            edit("return wide", "return np.trunc(wide)")
        ),
    },
    read=array_of_numbers,
    where=_place,
    errors={
        "broadcast": "The layer does not fit where you put it: the UAV's cell goes to M − 1, so "
        "the city begins in row M − 1 − uav[0], and reaches M cells further.",
    },
)


@exercise(
    "4.2 · Centre a layer (2 points, 14 minutes)",
    "Begin with a map that has the value `outside` everywhere. Where does the city's corner "
    "(0, 0) come to lie if the UAV's cell is in the middle?",
    "The city's cell (0, 0) goes to (M − 1 − uav[0], M − 1 − uav[1]), and the M×M cells from "
    "there on are the layer. Or surround the layer by M − 1 cells on all sides (np.pad) and "
    "cut out the 2M − 1 rows from uav[0] on, and as many columns from uav[1] on.",
    figure=_draw_centre,
    table=CENTRE,
)
def centre(answer) -> None:
    """`centre(layer, uav, outside)`: (2M − 1, 2M − 1), the UAV's cell in the middle."""


def _weights(layers, size, kernels, kernel_size, strides, hidden):
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


def _draw_weights(ax):
    from torch import nn, zeros

    from uavdh_lite.network import QNetwork

    rows, side = [], 31
    network = QNetwork([(5, side, side)])
    names = {nn.Conv2d: "convolution, 16 kernels of 5×5", nn.Linear: "fully connected"}

    def note(module, given, got):
        shapes = ["×".join(map(str, one.shape[1:])) for one in (given[0], got)]
        rows.append([names[type(module)], *shapes])

    for module in network.modules():
        if type(module) in names:
            module.register_forward_hook(note)
    network([zeros(1, 5, side, side)], zeros(1, 1))
    centred = {"loc": "center", "cellLoc": "center", "colWidths": (0.5, 0.25, 0.25)}
    ax.table(rows, colLabels=["part", "gets", "gives"], **centred).scale(1, 1.6)
    ax.axis("off")
    ax.set_title("shapes in the paper's network, M = 16")


def _weights_cases():
    generator = stream(Use.EXERCISE, 1)

    def drawn(convolutions, hidden):
        layers, kernels, kernel_size = (
            int(generator.integers(*r)) for r in ((2, 7), (7, 20), (2, 5))
        )
        strides = tuple(generator.integers(1, 3, convolutions).tolist())
        widths = tuple(generator.integers(8, 99, hidden).tolist())
        return layers, int(generator.integers(14, 24)), kernels, kernel_size, strides, widths

    return {
        "The example of the exercise, counted by hand, has 113, and the paper's network "
        "2,308,854: follow the shape of the map through the network.": [
            (2, 2, 3, 2, (1,), (4,)),
            (5, 16, 16, 5, (1, 1), (256, 256, 256)),
        ],
        "A kernel has a weight for each cell of its square and each layer that it sees, and a "
        "bias; the list has the numbers of all kernels, and the flying time.": [
            *((1, 2, 1, 1, (1,), (1,)), (3, 3, 2, 3, (1,), (5,)), (4, 2, 7, 2, (1,), (3, 2))),
            *((5, 5, 2, 9, (1,), (4,)), (1, 1, 6, 1, (1,), (2,))),
        ],
        "(side − kernel_size) // stride + 1 cells a side are left: kernels lie wholly inside.": [
            *((2, 3, 4, 2, (stride,), (6,)) for stride in (2, 3, 4)),
            *((3, 12, 9, 3, (3,), (20,)), (2, 7, 3, 4, (5,), (8,)), (2, 9, 3, 4, (6,), (8,))),
        ],
        "A second convolution sees as many layers as the first has kernels, and so on.": [
            *((4, 13, 8, 4, (3, 2), (64, 32)), (2, 9, 3, 2, (1, 1, 2), (5,))),
            *((6, 16, 12, 5, (2, 1), (256, 256)), (1, 20, 2, 3, (1, 2, 1, 2), (9,))),
        ],
        "It must hold for any number of convolutions and hidden layers.": [
            drawn(*lengths) for lengths in itertools.product((1, 2, 3), (1, 2, 4))
        ],
    }


KERNELS_BIAS, NEURONS_BIAS = "**2 + kernels", "neurons + neurons"
NO_KERNELS_BIAS, NO_NEURONS_BIAS = (KERNELS_BIAS, "**2"), (NEURONS_BIAS, "neurons")
ONE_KERNELS_BIAS, ONE_NEURONS_BIAS = (KERNELS_BIAS, "**2 + 1"), (NEURONS_BIAS, "neurons + 1")
STEP = "(side - kernel_size) // stride + 1"
WEIGHTS = Table(
    _weights,
    _weights_cases,
    mistakes={
        "The biases are missing: kernels and neurons have them.": (
            edit(*NO_KERNELS_BIAS, *NO_NEURONS_BIAS)
        ),
        "The neurons' biases are missing: each has one.": edit(*NO_NEURONS_BIAS),
        "The kernels' biases are missing: each has one.": edit(*NO_KERNELS_BIAS),
        "Each kernel and each neuron has a bias of its own; yours count one a layer.": (
            edit(*ONE_KERNELS_BIAS, *ONE_NEURONS_BIAS),
            edit(*ONE_NEURONS_BIAS),
            edit(*ONE_KERNELS_BIAS),
        ),
        "The biases of the output are missing.": edit("return total", "return total - 6"),
        "The list has kernels · side² numbers, not side² alone.": edit("kernels * side", "side"),
        "The flying time is missing: it is one more input.": edit("side**2 + 1", "side**2"),
        "The output layer is missing: one value for each of the 6 actions.": edit(", 6)", ",)"),
        "The output layer has one value in yours, but there are 6 actions.": edit(", 6)", ", 1)"),
        "The output layer has 5 values in yours, but there are 6 actions: hovering and landing "
        "count too.": edit(", 6)", ", 5)"),
        "The map has 2M − 1 cells a side, not M.": edit("2 * size - 1", "size"),
        "The map has 2M − 1 cells a side, not 2M.": edit("2 * size - 1", "2 * size"),
        "Divide (side − kernel_size) by the stride and round down, then add 1: a kernel that does "
        "not fit any more is left out. Yours rounds up.": (
            edit(STEP, "-(-(side - kernel_size) // stride) + 1")
        ),
        "Without padding a convolution loses kernel_size − 1 cells a side: you keep them.": (
            edit(STEP, "-(-side // stride)"),
            edit(STEP, "side // stride"),
            edit(STEP, "(side + 2 * (kernel_size // 2) - kernel_size) // stride + 1"),
        ),
        "Each convolution makes the map smaller: without padding a kernel fits at (side − "
        "kernel_size) // stride + 1 places a side.": edit(STEP, "side"),
        "(side − kernel_size) // stride + 1: the + 1 is missing.": (
            edit(" // stride + 1", " // stride")
        ),
        "The strides have no effect: only each s-th place counts.": edit(" // stride", ""),
        "Divide side − kernel_size by the stride and round down, and add the 1 after that: you "
        "divide too late.": edit(STEP, "(side - kernel_size + 1) // stride"),
        "Divide side − kernel_size by the stride and round down (//), so that the side is a whole "
        "number.": edit("//", "/"),
        "A kernel is kernel_size × kernel_size weights for each layer that it sees, not "
        "kernel_size.": edit("kernel_size**2", "kernel_size"),
        "The second convolution sees as many layers as the first has kernels.": (
            edit("channels = kernels", ""),
            edit("channels = kernels", "", "kernels * side", "layers * side"),
        ),
        "A kernel has weights for all the layers that it sees.": edit("* channels ", ""),
    },
    read=number,
    tolerance=1e-9,
)


@exercise(
    "4.3 · How many weights? (3 points, 25 minutes)",
    "Follow the shape of the map through the network, as in a table: layers and side before "
    "and after each convolution, then the length of the list, then layer by layer. Each kernel "
    "and each neuron has a bias.",
    "A convolution has c·k·k weights and one bias a kernel, where c is the number of layers "
    "that it gets, and leaves (side − k) // stride + 1 cells a side. The list has kernels · "
    "side² numbers and the flying time. From n to m neurons: n·m + m. The output has 6.",
    figure=_draw_weights,
    table=WEIGHTS,
)
def network_weights(answer) -> None:
    """`weights(layers, size, kernels, kernel_size, strides, hidden)`: of the centred Q-network."""
