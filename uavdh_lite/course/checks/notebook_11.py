"""Exercises of notebook 11, any city."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


@dataclass(frozen=True)
class Pilot:
    """A network made by hand: Q-values of a stack of maps, by a rule with a name."""

    name: str
    rule: Callable[[np.ndarray], list]

    def __call__(self, maps):
        maps = np.asarray(maps, float)
        if maps.ndim != 4 or maps.shape[2] != maps.shape[3]:
            said = (
                f"q_of takes a stack of maps, (n, C, W, W), not {maps.shape}: layers[None] is one"
            )
            raise ValueError(said)
        return np.array([self.rule(one) for one in maps], float).reshape(-1, 6)

    def __repr__(self):
        return self.name


def near(one: np.ndarray, down: int, right: int) -> float:
    """The first layer's value so many cells from the middle."""
    middle = one.shape[1] // 2
    return one[0, middle + down, middle + right]


def weighted(one: np.ndarray) -> np.ndarray:
    """Some smooth function of all values, not a linear one."""
    weights = np.sin(1.7 * np.arange(6 * one.size)).reshape(6, one.size)
    return np.tanh(weights @ one.ravel())


STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1), (0, 0))
SAME_FOR_ALL = Pilot("q_same_for_all_maps", lambda one: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
SEES_NEXT = Pilot("q_sees_next_cell", lambda one: [*(near(one, *s) for s in STEPS), one.mean()])
SEES_NORTH_EAST = Pilot(
    "q_north_sees_north_east", lambda one: [near(one, -1, 1), 0, 0, 0, near(one, 0, 0), 0]
)
NETWORK = Pilot("q_network", weighted)


def one_map(q_of, channels, side):
    return q_of, stream(Use.EXERCISE, 10 * channels + side).normal(0, 1, (channels, side, side))


@exercise(
    "11.1 · Turn the map, turn the actions back (3 points, 15 minutes)",
    rules={
        "Here the Q-values are 1 to 6 whatever the map. Over the eight symmetries each move takes "
        "the place of each of the four moves twice, so all four get their mean, 2.5. Hover and "
        "land keep 5 and 6.": [(SAME_FOR_ALL, 1, 3), (SAME_FOR_ALL, 2, 5)],
        "A network that treats all directions alike already gets its own Q-values back. Here the "
        "value of a move is that of the cell to which it leads.": [
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
    mistakes={
        "The moves are turned the wrong way in yours: a quarter turn to the left brings north to "
        "west, so north's Q-value is found at west, not at east.": (
            lambda q_of, layers: symmetric_q.solution(q_of, layers, sign=-1)
        ),
        "You mirror the map, but do not swap the moves: where left and right change places, so do "
        "east and west.": lambda q_of, layers: symmetric_q.solution(
            q_of, layers, swap=(0, 1, 2, 3)
        ),
        "There are eight maps, four turns of the map and four of its mirror image: yours are the "
        "first four.": lambda q_of, layers: symmetric_q.solution(q_of, layers, mirrored=(False,)),
    },
    case=one_map,
)
def symmetric_q(q_of, layers, sign=1, swap=(0, 3, 2, 1), mirrored=(False, True)):
    """`mean_q(q_of, layers)`: the six Q-values, averaged over the eight symmetries."""
    rows = []
    for flip in mirrored:
        for k in range(4):
            one = np.rot90(layers[:, :, ::-1] if flip else layers, k, axes=(1, 2))
            back = np.roll(np.arange(4), sign * k)
            rows.append(q_of(one[None])[0][[*(back[list(swap)] if flip else back), 4, 5]])
    return np.mean(rows, 0)


def usual(values, city):
    return float(1.96 * np.std(values, ddof=1) / np.sqrt(len(values)))


def missions(values, city):
    """Values and their cities; or, if there are fewer, so many missions of each city, at random."""
    if len(values) > len(set(city)):
        return np.array(values), np.array(city)
    generator = stream(Use.EXERCISE, sum(values))
    shared = np.repeat(generator.normal(0.8, 0.1, len(city)), values)
    order = generator.permutation(sum(values))
    drawn = (shared + generator.normal(0, 0.1, sum(values))).round(3)
    return drawn[order], np.repeat(city, values)[order]


def draw_half_width(ax, half_width):
    generator, counts = stream(Use.EXERCISE, 19), (1, 2, 5, 10, 20, 50, 100)
    values = generator.normal(0, 1, (100, 1)) + generator.normal(0, 2, (100, counts[-1]))
    some = [(values[:, :count].ravel(), np.repeat(range(100), count)) for count in counts]
    ax.loglog(counts, [half_width(*one) for one in some], "o-", label="cities drawn at random")
    ax.loglog(counts, [usual(*one) for one in some], "s--", label="as if all were independent")
    ax.set(xlabel="missions in each of 100 cities", ylabel="half-width")


@exercise(
    "11.2 · How sure, if missions share a city? (2 points, 12 minutes)",
    figure=draw_half_width,
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
    mistakes={
        "That is the usual interval, as if all missions were independent: add up the differences "
        "of a city before you square them.": usual,
    },
    case=missions,
)
def clustered_half_width(values, city):
    """`half_width(values, city)`: of the 95 % interval of the mean, cities drawn at random."""
    off = values - np.mean(values)
    sums = np.array([off[city == name].sum() for name in np.unique(city)])
    count, n = len(sums), len(values)
    return float(1.96 * np.sqrt(count / (count - 1) * (sums**2).sum()) / n)
