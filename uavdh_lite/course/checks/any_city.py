"""Exercises of notebook 13, any city."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.course.checks.exercise import solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.values import truths
from uavdh_lite.plotting import BLUE
from uavdh_lite.streams import Use, stream

NO_FLY = 1  # of the layers landing, no-fly, buildings


def _random_city(m=9, size=12):
    """A random city's layers, a UAV over its first landing cell, and M."""
    city = CityGenerator(m).draw(1, seed=3)[0]
    layers = np.stack([city.landing, city.no_fly, city.buildings])
    return layers, tuple(np.argwhere(city.landing)[0].tolist()), size


LAYERS = {m: stream(Use.EXERCISE, m).random((3, m, m)) < 0.5 for m in range(1, 8)}


def _draw_small_city(ax, solved):
    layers, uav, size = _random_city()
    seen = solved(layers, uav, size)
    ax.imshow(seen[NO_FLY], cmap="magma_r", vmin=0, vmax=1.5)
    ax.plot(size - 1, size - 1, "+", color=BLUE, ms=12, mew=2)
    ax.set(xlabel="column of the map", ylabel="row of the map", xticks=(0, 11, 22))
    ax.set(yticks=(0, 11, 22), title=f"no-fly layer: m = 9, M = {size}, UAV over {uav}")


def _shown(layers, uav, size, place):
    layer, *cell = place[0], *(k + u - size + 1 for k, u in zip(place[1:], uav, strict=True))
    inside = min(cell) >= 0 and max(cell) < layers.shape[1]
    shows = f"the city's cell {tuple(cell)}" if inside else "a cell outside the city"
    return f"That is layer {layer}; M is {size}, the UAV is over {uav}, so the place shows {shows}."


CORNER = "u - size + 1"


@solution(
    "13.1 · A small city in a large map (2 points, 12 minutes)",
    "Begin with a map as if there were no city at all. Which of its cells shows the city's "
    "cell (0, 0), if the UAV's cell is in the middle?",
    "The city's cell (0, 0) goes to (M − 1 − uav[0], M − 1 − uav[1]), and the m×m cells from "
    "there on are the city. All other cells: no-fly True, landing and buildings False.",
    figure=_draw_small_city,
    rules={
        "The UAV's cell is in the middle of the map, at (M − 1, M − 1). Outside the city only "
        "no-fly, layers[1], is True.": [
            *((LAYERS[2], (0, 1), 2), (LAYERS[2], (1, 0), 2)),
            *((LAYERS[4], (1, 3), 4), (LAYERS[7], (5, 2), 7)),
        ],
        "Every map has 2M − 1 cells on a side, whatever the size m of the city; it may be a single "
        "cell. Inside the city the layers stay as they are.": [
            *((LAYERS[1], (0, 0), 1), (LAYERS[1], (0, 0), 2), (LAYERS[2], (1, 0), 3)),
            *((LAYERS[2], (1, 1), 7), (LAYERS[3], (0, 2), 5), (LAYERS[5], (4, 1), 6)),
            *((LAYERS[6], (2, 5), 11), (np.ones((3, 3, 3), bool), (1, 2), 5), _random_city()),
        ],
    },
    mistakes={
        "The shift goes the wrong way: where the UAV is further north, the city lies further "
        "south.": edit(CORNER, "1 - size - u"),
        "Rows and columns are swapped: the UAV is at (row, col).": edit("in uav", "in uav[::-1]"),
    },
    read=truths,
    why=_shown,
    errors={
        "broadcast": "The city does not fit where you put it. The map has three layers of "
        "(2M − 1) × (2M − 1) cells; the city's row 0 goes to M − 1 − uav[0], its column 0 to "
        "M − 1 − uav[1], and it reaches m cells further, not M."
    },
)
def small_city_map(layers, uav, size):
    """`centred_map(layers, uav, size)`: (3, 2M − 1, 2M − 1) Booleans, the UAV in the middle."""
    m, side, around = layers.shape[1], 2 * size - 1, 4 * size
    wide = np.zeros((3, m + 2 * around, m + 2 * around), bool)
    wide[NO_FLY] = True
    wide[:, around : around + m, around : around + m] = layers
    row, col = (around + u - size + 1 for u in uav)
    return wide[:, row : row + side, col : col + side]


@dataclass(frozen=True)
class Pilot:
    """A network made by hand: Q-values of a stack of maps, by a rule with a name."""

    name: str
    rule: Callable[[np.ndarray], list]

    def __call__(self, maps):
        maps = np.asarray(maps, float)
        if maps.ndim != 4 or maps.shape[2] != maps.shape[3]:
            raise ValueError(f"q_of takes a stack of maps, (n, C, W, W), not {maps.shape}.")
        return np.array([self.rule(one) for one in maps], float).reshape(-1, 6)

    def __repr__(self):
        return self.name


def _next_to(one: np.ndarray, down: int, right: int) -> float:
    """The first layer's value so many cells from the middle."""
    middle = one.shape[1] // 2
    return one[0, middle + down, middle + right]


def _weighted(one: np.ndarray) -> np.ndarray:
    """Some smooth function of all values, not a linear one."""
    weights = np.sin(1.7 * np.arange(6 * one.size)).reshape(6, one.size)
    return np.tanh(weights @ one.ravel())


STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1), (0, 0))
SAME_FOR_ALL = Pilot("q_same_for_all_maps", lambda one: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
SEES_NEXT = Pilot("q_sees_next_cell", lambda one: [*(_next_to(one, *s) for s in STEPS), one.mean()])
SEES_NORTH_EAST = Pilot(
    "q_north_sees_north_east", lambda one: [_next_to(one, -1, 1), 0, 0, 0, _next_to(one, 0, 0), 0]
)
NETWORK = Pilot("q_network", _weighted)

TURNED = np.array([[0, 1, 2, 3, 4, 5], [3, 0, 1, 2, 4, 5], [2, 3, 0, 1, 4, 5], [1, 2, 3, 0, 4, 5]])
"""Which action each becomes in a map turned by np.rot90 so often."""
MIRRORED = np.array([0, 3, 2, 1, 4, 5])


def _map(q_of, channels, side):
    values = stream(Use.EXERCISE, 10 * channels + side).normal(0, 1, (channels, side, side))
    return q_of, values.round(2)


def _draw_symmetric_q(ax, solved):
    layers = stream(Use.EXERCISE, 17).normal(0, 0.4, (2, 5, 5))
    own, mean = NETWORK(layers[None])[0], solved(NETWORK, layers)
    places = np.arange(6)
    ax.bar(places - 0.2, own, 0.4, color="0.7", label="one map")
    ax.bar(places + 0.2, mean, 0.4, color=BLUE, label="mean of eight")
    ax.set_xticks(places, ["north", "east", "south", "west", "hover", "land"])
    ax.set(ylabel="Q-value", title="an untrained network, a random map")
    ax.axhline(0, color="black", lw=0.8)


BACK, MEAN = "TURNED[k][MIRRORED]", "np.mean(rows, 0)"


@solution(
    "13.2 · Turn the map, turn the actions back (3 points, 20 minutes)",
    "Take one turn only, np.rot90(layers, 1, axes=(1, 2)). What was north of the UAV: where is "
    "it now? Which of the six Q-values of that map belongs to north?",
    "After one turn to the left, the Q-values of north, east, south, west are found at "
    "[3, 0, 1, 2]; after k turns at np.roll([0, 1, 2, 3], k). If the map is mirrored before "
    "that, layers[:, :, ::-1], swap what is found for east and for west.",
    figure=_draw_symmetric_q,
    rules={
        "Here the Q-values are 1 to 6 whatever the map. Over the eight symmetries each move takes "
        "the place of each of the four moves twice, so all four get their mean, 2.5. Hover and "
        "land keep 5 and 6.": [(SAME_FOR_ALL, 1, 3), (SAME_FOR_ALL, 2, 5)],
        "A network that treats all directions alike already gets its own Q-values back. (Here the "
        "value of a move is that of the cell to which it leads.)": [
            *((SEES_NEXT, 1, 3), (SEES_NEXT, 3, 7)),
        ],
        "If q_of[north] is the value of the cell north-east of the middle, north gets a quarter of "
        "the mean of the cells north-east and north-west of it. The other moves likewise.": [
            *((SEES_NORTH_EAST, 1, 3), (SEES_NORTH_EAST, 2, 3), (SEES_NORTH_EAST, 1, 7)),
        ],
        "Average the Q-values of all eight maps, each with its moves turned and mirrored back; any "
        "q_of, any number of layers.": [
            *((NETWORK, 1, 3), (NETWORK, 3, 3), (NETWORK, 5, 5), (NETWORK, 2, 9)),
        ],
    },
    made=_map,
    mistakes={
        "The moves are turned the wrong way in yours: a quarter turn to the left brings north to "
        "west, so north's Q-value is found at west, not at east.": edit("TURNED[k]", "TURNED[-k]"),
        "You mirror the map, but do not swap the moves: where left and right change places, so do "
        "east and west.": edit(BACK, "TURNED[k]"),
        "In some of the maps that are mirrored, the moves come back half a turn wrong in yours: "
        "where left and right change places, swap east and west; where top and bottom do, north "
        "and south; and undo the last step first.": (
            *(edit(BACK, "TURNED[k][MIRRORED[TURNED[2]]]"), edit(BACK, "MIRRORED[TURNED[k]]")),
        ),
        "There are eight maps, four turns of the map and four of its mirror image: yours are "
        "fewer.": tuple(edit(MEAN, f"np.mean(rows[{some}], 0)") for some in ("::2", ":2", ":1")),
    },
    errors={"q_of takes": "One map becomes a stack of one by layers[None], several by np.stack."},
)
def symmetric_q(q_of, layers):
    """`mean_q(q_of, layers)`: the six Q-values, averaged over the eight symmetries."""
    rows = []
    for k in range(4):
        turned = np.rot90(layers, k, axes=(1, 2))
        mirrored = np.rot90(np.flip(layers, 2), k, axes=(1, 2))
        rows += [q_of(turned[None])[0, TURNED[k]], q_of(mirrored[None])[0, TURNED[k][MIRRORED]]]
    return np.mean(rows, 0)


def _usual(values, city):
    return 1.96 * np.std(values, ddof=1) / np.sqrt(len(values))


def _evaluation(values, city):
    """Values and their cities; or, if there are fewer, so many missions of each city, at random."""
    if len(values) > len(set(city)):
        return np.array(values), np.array(city)
    generator = stream(Use.EXERCISE, sum(values))
    shared = np.repeat(generator.normal(0.8, 0.1, len(city)), values)
    order = generator.permutation(sum(values))
    drawn = (shared + generator.normal(0, 0.1, sum(values))).round(3)
    return drawn[order], np.repeat(city, values)[order]


def _draw_half_width(ax, solved):
    generator, missions = stream(Use.EXERCISE, 19), (1, 2, 5, 10, 20, 50, 100)
    values = generator.normal(0, 1, (100, 1)) + generator.normal(0, 2, (100, missions[-1]))
    for label, width, style in (
        ("cities drawn at random", solved, "o-"),
        ("as if missions were independent", _usual, "s--"),
    ):
        some = [(values[:, :count].ravel(), np.repeat(range(100), count)) for count in missions]
        ax.loglog(missions, [width(*one) for one in some], style, label=label)
    ax.set(xlabel="missions in each of 100 cities", ylabel="half-width")


@solution(
    "13.3 · How sure, if missions share a city? (2 points, 12 minutes)",
    "Do the example by hand: the mean, the differences from it, one sum for each city. How "
    "does Python find the missions of one city?",
    "off = values − values.mean(). For each `one` in np.unique(city) the sum is "
    "off[city == one].sum(); C is how many sums there are.",
    figure=_draw_half_width,
    rules={
        "Subtract the mean from the values, add up the differences in each city, and square these "
        "sums. Multiply their total by C/(C − 1), take the root, and multiply it by 1.96 / N.": [
            *(([4.0, 6, 1, 1], [0, 0, 1, 1]), ([3, 3, 3], range(3)), ([4] * 6, range(6))),
        ],
        "Cities may have different numbers of missions. The mean is that of all N missions, not of "
        "the cities' means.": [([1, 3], [0, 1]), ([5, 1, 2, 9], [0, 1, 2, 3])],
        "The cities' numbers are names: any ints, in any order. C is how many there are.": [
            *(([2, 3], [7, 4]), ([2, 5, 1], [-1, -2, 10**6]), ([1] * 4, range(4))),
        ],
        "Whole numbers and Booleans are values, too, such as whether each UAV landed.": [
            *(([3, 4, 4, 9, 1], [1, 1, 0, 0, 2]), ([True, True, False, True], [5, 5, 0, 0])),
        ],
    },
    made=_evaluation,
    mistakes={
        "That is the usual interval, as if all missions were independent: add up the differences "
        "of a city before you square them.": (_usual, edit("(sums**2).sum()", "(off**2).sum()")),
    },
)
def clustered_half_width(values, city):
    """`half_width(values, city)`: of the 95 % interval of the mean, cities drawn at random."""
    off = values - np.mean(values)
    sums = np.array([off[city == name].sum() for name in np.unique(city)])
    count, n = len(sums), len(values)
    return 1.96 * np.sqrt(count / (count - 1) * (sums**2).sum()) / n
