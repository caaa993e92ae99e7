"""Exercises of notebook 4, map centring."""

import itertools

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.checks.table import Table
from uavdh_lite.course.checks.values import number, pair
from uavdh_lite.environment import ACTIONS
from uavdh_lite.plotting import BLUE
from uavdh_lite.streams import Use, stream


def _city_cell(place, uav, size):
    row, col = place[0] + uav[0] - size + 1, place[1] + uav[1] - size + 1
    return (row, col) if 0 <= row < size and 0 <= col < size else None


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


def _shifted(change):
    def mistake(place, uav, size):
        return tuple(change(p, u, size) for p, u in zip(place, uav, strict=True))

    return mistake


def _either_way(mistake):
    """The mistake, and the same with what is then outside of the city left out."""

    def checked(place, uav, size):
        cell = mistake(place, uav, size)
        return cell if min(cell) >= 0 and max(cell) < size else None

    return mistake, checked


def _cell_or_none(value) -> np.ndarray:
    return np.asarray(None) if value is None else pair(value)


CITY_CELL_MISTAKES = {
    "That is the other direction, from the city to the map: here the place in the map is given "
    "and the cell of the city is wanted.": _shifted(lambda p, u, m: p - u + m - 1),
    "The shift goes the wrong way: a place east of the middle is a cell east of the UAV.": (
        _shifted(lambda p, u, m: u - p + m - 1)
    ),
    "You count from the map's corner, but it is the middle of the map, (M − 1, M − 1), where "
    "the UAV is: subtract M − 1.": _shifted(lambda p, u, m: p + u),
    "You are off by one: the middle of a map with 2M − 1 cells a side is M − 1, counted from "
    "0.": _shifted(lambda p, u, m: p + u - m),
    "The middle of the map is at M − 1, not at M // 2: the map has 2M − 1 cells a side.": (
        _shifted(lambda p, u, m: p + u - m // 2)
    ),
    "You leave out where the UAV is: the same place of the map is another cell when it flies "
    "on.": _shifted(lambda p, u, m: p - m + 1),
    "Rows and columns are swapped.": lambda p, u, m: tuple(
        k - m + 1 + one for k, one in zip(p, u[::-1], strict=True)
    ),
    "Rows and columns of the place are swapped.": lambda p, u, m: tuple(
        k - m + 1 + one for k, one in zip(p[::-1], u, strict=True)
    ),
    "Rows and columns change places in yours: the result is (row, col).": (
        lambda p, u, m: tuple(k - m + 1 + one for k, one in zip(p[::-1], u[::-1], strict=True))
    ),
}
CITY_CELL = Table(
    _city_cell,
    _city_cell_cases,
    mistakes={
        "A cell has no negative row or column, though numpy would take it, and none of M or more: "
        "outside the city give back None.": _shifted(lambda p, u, m: p + u - m + 1),
        **{text: _either_way(mistake) for text, mistake in CITY_CELL_MISTAKES.items()},
    },
    read=_cell_or_none,
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
    around = len(layer) - 1
    wide = np.pad(np.asarray(layer, float), around, constant_values=outside)
    return wide[uav[0] : uav[0] + 2 * around + 1, uav[1] : uav[1] + 2 * around + 1]


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
        "A layer of M×M cells gives a map of (2M − 1)×(2M − 1), with the UAV's cell in the middle, "
        "at (M − 1, M − 1).": [
            *((small, uav, 0.0) for uav in ((1, 1), (0, 2), (2, 0), (2, 1), (0, 1))),
            (np.array([[1.0, 2], [3, 4]]), (0, 1), 0),
        ],
        "Everywhere outside the city the map is `outside`, any number; zeros of the layer stay.": [
            *((small, (1, 0), outside) for outside in (1, 7.0, -0.5)),
            (np.array([[0.0, 3], [0, 0]]), (1, 0), 4.0),
            (np.zeros((2, 2)), (0, 0), 2),
        ],
        "Fractions survive: a layer of fractions keeps them, also if `outside` is a whole "
        "number.": [
            (generator.random((size, size)).round(3) * 9, uav, outside)
            for size, uav, outside in ((2, (1, 1), 0), (6, (1, 4), 7), (7, (5, 2), 1))
        ],
        "A layer of whole numbers or of Booleans becomes floats, so that `outside` may be a "
        "fraction.": [
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


def _cut(layer, row, col, outside):
    """The map whose corner is at this cell of the layer, in a wide plain of `outside`."""
    size = len(layer)
    wide = np.pad(np.asarray(layer, float), 3 * size, constant_values=outside)
    row, col, side = 3 * size + row, 3 * size + col, 2 * size - 1
    return wide[row : row + side, col : col + side]


def _moved(change):
    def mistake(layer, uav, outside):
        row, col = (change(u, len(layer)) for u in uav)
        return _cut(layer, row, col, outside)

    return mistake


def _wrapped(layer, uav, outside):
    rows, cols = (np.arange(2 * len(layer) - 1) - len(layer) + 1 + u for u in uav)
    return layer[np.ix_(rows % len(layer), cols % len(layer))]


CENTRE = Table(
    _centre,
    _centre_cases,
    mistakes={
        "The map has the type of its layer in yours, Booleans or whole numbers, and `outside` "
        "may be any number. Make a map of floats: np.full(shape, outside, float), or "
        "layer.astype(float) first.": (
            lambda layer, uav, outside: _centre(layer, uav, np.asarray(outside).astype(layer.dtype))
        ),
        "The shift goes the wrong way: with the UAV in the north-west corner, the city must lie in "
        "the south-east of the map.": _moved(lambda u, m: -u),
        "The shift goes the wrong way: where the UAV is further north, the city lies further "
        "south.": _moved(lambda u, m: u - 2 * m + 2),
        "The city is one cell too far south-east: the middle of 2M − 1 cells is M − 1, counted "
        "from 0.": _moved(lambda u, m: u - m),
        "The city is one cell too far north-west: the middle of 2M − 1 cells is M − 1, counted "
        "from 0.": _moved(lambda u, m: u - m + 2),
        "The city lies always at the same place: it must move so that the UAV's cell is in the "
        "middle.": _moved(lambda u, m: -((m - 1) // 2)),
        "The city lies always in the corner of your map: it must move so that the UAV's cell is in "
        "the middle.": _moved(lambda u, m: 0),
        "Outside the city your map is 0: there it must be the value `outside`.": (
            lambda layer, uav, outside: _centre(layer, uav, 0)
        ),
        "You replace each 0 by `outside`, also those of the layer itself: they must stay 0.": (
            lambda layer, uav, outside: np.where(
                _centre(layer, uav, 0) == 0, outside, _centre(layer, uav, 0)
            )
        ),
        "Outside the city your map is 1: there it must be the value `outside`.": (
            lambda layer, uav, outside: _centre(layer, uav, 1)
        ),
        "Rows and columns are swapped: the UAV is at (row, col).": (
            lambda layer, uav, outside: _centre(layer, uav[::-1], outside)
        ),
        "Rows and columns are swapped: the map is transposed.": (
            lambda layer, uav, outside: _centre(layer, uav, outside).T
        ),
        "The city goes round at the border in yours: beyond its last row comes `outside`, not "
        "its first row. (A negative index takes cells from the other end.)": _wrapped,
        "Your map has whole numbers where the layer has fractions: np.full takes its dtype from "
        "the number that it is given. Make it np.full(shape, outside, float).": (
            lambda layer, uav, outside: np.trunc(_centre(layer, uav, outside))
        ),
    },
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


def _weights(layers, size, kernels, kernel_size, strides, hidden, **wrong):
    """The weights of the network; `wrong` makes mistakes in it."""
    side, channels, total = wrong.get("side", 2 * size - 1), layers, 0
    kernel_biases, biases = (wrong.get(one, lambda n: n) for one in ("kernel_biases", "biases"))
    for stride in strides:
        total += channels * kernels * kernel_size ** wrong.get("dimensions", 2)
        total += kernel_biases(kernels)
        side = wrong.get("step", lambda w, k, s: (w - k) // s + 1)(side, kernel_size, stride)
        channels = wrong.get("channels", kernels)
    width = wrong.get("flat", channels) * side * side + wrong.get("time", 1)
    for out in (*hidden, *wrong.get("outputs", (len(ACTIONS),))):
        total += width * out + biases(out)
        width = out
    return total


def _draw_weights(ax):
    from torch import nn, zeros

    from uavdh_lite.network import QNetwork

    size, rows = 16, []
    network = QNetwork([(5, 2 * size - 1, 2 * size - 1)])
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            module.register_forward_hook(
                lambda module, given, got: rows.append((module, given[0].shape[1:], got.shape[1:]))
            )
    network([zeros(1, 5, 2 * size - 1, 2 * size - 1)], zeros(1, 1))
    names = {nn.Conv2d: "convolution, 16 kernels of 5×5", nn.Linear: "fully connected"}
    cells = [
        [names[type(module)], *("×".join(map(str, shape)) for shape in shapes)]
        for module, *shapes in rows
    ]
    table = ax.table(
        cells,
        colLabels=["part", "gets", "gives"],
        loc="center",
        cellLoc="center",
        colWidths=(0.5, 0.25, 0.25),
    )
    table.scale(1, 1.6)
    ax.axis("off")
    ax.set_title(f"shapes in the paper's network, M = {size}")


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
        "(side − kernel_size) // stride + 1 cells a side are left: a kernel is put only where it "
        "lies wholly inside.": [
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


def _variant(**wrong):
    return lambda *case: _weights(*case, **wrong)


def _without_biases():
    """Counts with no biases, or one a layer, by what to say of them."""
    biases = (
        (lambda count: 0, "The biases{} are missing: each {} has one."),
        (lambda count: 1, "Each {1} has a bias of its own; yours count{0} one a layer only."),
    )
    for wrong, message in biases:
        for of, each, parts in (
            ("", "kernel and each neuron", ("kernel_biases", "biases")),
            (" of the fully connected layers", "neuron", ("biases",)),
            (" of the convolutions", "kernel", ("kernel_biases",)),
        ):
            yield message.format(of, each), _variant(**dict.fromkeys(parts, wrong))


WEIGHTS = Table(
    _weights,
    _weights_cases,
    mistakes={
        **dict(_without_biases()),
        "The biases of the output are missing: its 6 neurons have one each too.": (
            lambda *case: _weights(*case) - len(ACTIONS)
        ),
        "The list has the numbers of all kernels, kernels · side², not side² alone.": (
            _variant(flat=1)
        ),
        "The flying time is missing: it is appended to the flattened map as one more input.": (
            _variant(time=0)
        ),
        "The output layer is missing: one value for each of the 6 actions.": _variant(outputs=()),
        "The output layer has one value in yours, but there are 6 actions.": _variant(outputs=(1,)),
        "The output layer has 5 values in yours, but there are 6 actions: hovering and landing "
        "count too.": _variant(outputs=(5,)),
        "The map has 2M − 1 cells a side, not M.": lambda *case: _weights(*case, side=case[1]),
        "Divide (side − kernel_size) by the stride and round down, then add 1: a kernel that does "
        "not fit any more is left out. Yours rounds up.": (
            _variant(step=lambda w, k, s: -(-(w - k) // s) + 1)
        ),
        "Without padding a convolution loses kernel_size − 1 cells a side: you keep them.": (
            _variant(step=lambda w, k, s: -(-w // s))
        ),
        "There is no padding: a convolution loses kernel_size − 1 cells a side, with a stride it "
        "loses more.": _variant(step=lambda w, k, s: (w + 2 * (k // 2) - k) // s + 1),
        "Each convolution makes the map smaller: without padding a kernel fits at (side − "
        "kernel_size) // stride + 1 places a side.": _variant(step=lambda w, k, s: w),
        "Without padding a convolution loses kernel_size − 1 cells a side: you only divide by the "
        "stride.": _variant(step=lambda w, k, s: w // s),
        "A convolution leaves (side − kernel_size) // stride + 1 cells: the + 1 is missing.": (
            _variant(step=lambda w, k, s: (w - k) // s)
        ),
        "The strides have no effect in yours: with stride s only each s-th place counts.": (
            _variant(step=lambda w, k, s: w - k + 1)
        ),
        "Divide side − kernel_size by the stride and round down, and add the 1 after that: you "
        "divide too late.": _variant(step=lambda w, k, s: (w - k + 1) // s),
        "Divide side − kernel_size by the stride and round down (//), so that the side is a whole "
        "number.": _variant(step=lambda w, k, s: (w - k) / s + 1),
        "The map has 2M − 1 cells a side, not 2M.": lambda *c: _weights(*c, side=2 * c[1]),
        "A kernel is kernel_size × kernel_size weights for each layer that it sees, not "
        "kernel_size.": _variant(dimensions=1),
        "The second convolution sees as many layers as the first has kernels, not the layers of "
        "the map again. The list then has kernels · side² numbers too.": (
            lambda *case: _weights(*case, channels=case[0])
        ),
        "The second convolution sees as many layers as the first has kernels, not the layers of "
        "the map again.": lambda *case: (
            _weights(*case) + sum((case[0] - case[2]) * case[2] * case[3] ** 2 for _ in case[4][1:])
        ),
        "Each kernel has weights for all the layers that it sees, not for one.": (
            lambda *case: (
                _weights(*case)
                + sum(
                    (1 - seen) * case[2] * case[3] ** 2
                    for seen in (case[0], *[case[2]] * (len(case[4]) - 1))[: len(case[4])]
                )
            )
        ),
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
