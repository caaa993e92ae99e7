"""Exercises of notebook 2, shadow ray tracing."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.checks.table import Table, edit
from uavdh_lite.course.checks.values import number, truth, truths
from uavdh_lite.plotting import ORANGE
from uavdh_lite.shadowing import crossed_cells, line_of_sight
from uavdh_lite.streams import Use, stream


def _crosses(start, end, cell):
    """Whether the segment between two cell centres crosses the open interior of a cell."""
    rows, cols = end[0] - start[0], end[1] - start[1]
    r, c = cell[0] - start[0], cell[1] - start[1]
    inside = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    return inside and (start == end or 2 * abs(rows * c - cols * r) < abs(rows) + abs(cols))


def _draw_crosses(ax):
    start, end = (0, 0), (3, 5)
    cells = [cell for cell in np.ndindex(5, 7) if _crosses(start, end, cell)]
    for row, col in cells:
        ax.fill_between([col - 0.5, col + 0.5], row - 0.5, row + 0.5, color="#9DC3E6")
    ax.plot([start[1], end[1]], [start[0], end[0]], "o-", color="black")
    ax.set(xlim=(-0.5, 6.5), ylim=(4.5, -0.5), aspect="equal", yticks=range(5))
    ax.set_xticks(np.arange(6) + 0.5, minor=True)
    ax.set_yticks(np.arange(4) + 0.5, minor=True)
    ax.grid(which="minor")
    ax.set(xlabel="column", ylabel="row", title=f"True in the {len(cells)} blue cells")


TOUCHING = (
    "A segment that only touches a cell at a corner does not cross its open interior. Compare with "
    "< instead of <=, and in whole numbers: rounded ones cannot tell touching from crossing."
)


def _crosses_cases():
    touches = edit(") < abs", ") <= abs", "start == end or ", "").of(_crosses)
    drawn = stream(Use.EXERCISE, 2).integers(0, 9, (300, 3, 2)).tolist()
    others = [tuple(map(tuple, case)) for case in drawn]
    signs = [
        (start, end, cell)
        for start, end in (((4, 5), (1, 3)), ((4, 2), (2, 5)), ((1, 5), (3, 2)), ((5, 5), (2, 6)))
        for cell in np.ndindex(6, 7)
    ]
    plain = [case for case in (*signs, *others) if _crosses(*case) or not touches(*case)]
    return {
        "The segment begins and ends in the middle of a cell, so it crosses these two cells too. "
        "Measure rows and columns from start.": [
            *(((2, 3), (4, 8), (2, 3)), ((2, 3), (4, 8), (4, 8)), ((1, 0), (3, 2), (1, 0))),
            *(((0, 0), (2, 5), (0, 0)), ((0, 0), (2, 5), (2, 5))),
        ],
        "Along a row or a column the segment runs through the middle of each cell between its "
        "ends, and through no other; no slope is needed, compare products.": [
            *(((3, 2), (3, 7), (3, 5)), ((3, 2), (3, 7), (4, 5)), ((1, 4), (6, 4), (2, 4))),
            *(((6, 4), (1, 4), (3, 5)), ((0, 0), (0, 4), (0, 2)), ((0, 0), (3, 0), (1, 1))),
        ],
        "If both ends are the same point, it lies inside its cell and no other.": [
            *(((4, 6), (4, 6), (4, 6)), ((4, 6), (4, 6), (4, 7)), ((0, 0), (0, 0), (0, 0))),
            *(((0, 0), (0, 0), (1, 0)), ((4, 6), (4, 6), (3, 6))),
        ],
        "Not all cells of the rectangle between the two ends are crossed: the cell's centre must "
        "be near the line, by the condition of the exercise.": [
            *(((1, 1), (7, 6), (1, 6)), ((1, 1), (7, 6), (7, 1)), ((8, 2), (3, 9), (3, 3))),
            *(((0, 0), (4, 5), (0, 3)), ((0, 0), (4, 5), (3, 1)), ((0, 0), (4, 6), (1, 3))),
        ],
        "A cell that is on the line beyond an end of the segment is not crossed: only cells in the "
        "rectangle between the two ends can be.": [
            *(((2, 2), (4, 4), (6, 6)), ((3, 5), (3, 8), (3, 1)), ((5, 5), (7, 9), (3, 1))),
            *(((0, 0), (0, 3), (0, 4)), ((0, 0), (3, 1), (4, 1)), ((3, 3), (0, 0), (4, 4))),
        ],
        "The cell's centre must be near enough to the line, by the condition of the exercise: "
        "|R·c − C·r| less than (|R| + |C|) / 2. No other distance will do.": [
            case for case in plain if (np.subtract(case[1], case[0]) >= 0).all()
        ],
        "A ray may go up or left: R and C are then negative, and so may R·c − C·r be. Comparisons "
        "and sums must take care of the signs (min, max, abs).": plain,
        TOUCHING: [
            *(((1, 1), (4, 4), (1, 2)), ((1, 1), (4, 4), (3, 2)), ((6, 1), (2, 5), (5, 1))),
            *(((0, 0), (3, 9), (1, 1)), ((0, 0), (3, 9), (0, 2)), ((2, 9), (9, 2), (4, 8))),
            ((0, 0), (7, 21), (3, 8)),
            *(case for case in (*signs, *others) if case not in set(plain)),
        ],
        "A segment that cuts off only a small corner of a cell crosses it. Points sampled along "
        "the ray step over it, and so does Bresenham's line: compare whole numbers.": [
            *(((0, 0), (100, 101), (0, 1)), ((0, 0), (9, 10), (0, 1)), ((70, 3), (0, 74), (70, 4))),
            ((0, 0), (10**6, 10**6 + 1), (0, 1)),
        ],
        "A segment that misses a cell by a hair does not cross it: no tolerance is needed, nor "
        "sampled points, if you compare whole numbers.": [
            *(((0, 0), (100, 101), (1, 0)), ((0, 0), (9, 10), (1, 0)), ((70, 3), (0, 74), (69, 3))),
            ((0, 0), (10**6, 10**6 + 1), (1, 0)),
        ],
    }


def _and_for_points(*texts):
    """A mistake, and the same with points that cross no cell."""
    return edit(*texts), edit(*texts, "start == end or", "start != end and")


CROSSES = Table(
    _crosses,
    _crosses_cases,
    mistakes={
        "You forget the factor 2 before |R·c − C·r|.": _and_for_points("2 * abs", "abs"),
        "|R + C| is not |R| + |C|: on the way up or left R or C is negative, and they cancel.": (
            _and_for_points("abs(rows) + abs(cols)", "abs(rows + cols)")
        ),
        "R·c − C·r may be negative: take its absolute value.": _and_for_points("2 * abs", "2 * "),
        TOUCHING: _and_for_points(") < abs", ") <= abs"),
    },
    read=truth,
    errors={"ZeroDivision": "A ray along a row or a column has no slope one way."},
)


@exercise(
    "2.1 · Does the ray cross the cell? (1 point, 10 minutes)",
    "The tutorial's segment begins at (0, 0): move yours there. Which numbers may then be "
    "negative, and what is the rectangle? What does the condition say if R = C = 0?",
    "(R, C) is end minus start, (r, c) is cell minus start, by rows and columns. The rectangle "
    "is min(R, 0) <= r <= max(R, 0), and the same with c and C. If R = C = 0 it is one cell, "
    "and the condition, 0 < 0, must not be asked.",
    figure=_draw_crosses,
    table=CROSSES,
)
def crosses(answer) -> None:
    """`crosses(start, end, cell)`: does the segment cross the open interior of the cell?"""


def _blocked(buildings, device, cell, diagonal=True, touching=False, ends=True):
    """Whether the link from a device to a UAV is blocked, and what blocks it."""
    rows, cols = cell[0] - device[0], cell[1] - device[1]
    crossed = [(r + device[0], c + device[1]) for r, c in crossed_cells(rows, cols).tolist()]
    for one in crossed:
        if buildings[one] and (ends or one not in (device, cell)):
            return f"the ray crosses the building {one}"
    for r, c in crossed if diagonal or touching else ():
        for side in (-1, 1):
            if (r + 1, c + side) in crossed:
                corner = [(r, c + side), (r + 1, c)]
                both = [buildings[one] for one in corner]
                if all(both) or (touching and any(both)):
                    shared = "the ray goes through the corner that the buildings {} and {} share"
                    return shared.format(*corner)
    return ""


def _shadow_map(buildings, device):
    shadow = np.zeros(buildings.shape, bool)
    for cell in np.ndindex(shadow.shape):
        shadow[cell] = bool(_blocked(buildings, device, cell))
    return shadow


def _town(text):
    return np.array([[sign == "#" for sign in line] for line in text.split()])


def _random_town(seed, size, device):
    buildings = stream(Use.EXERCISE, seed).random((size, size)) < 0.2
    buildings[device] = False
    return buildings, device


SLOPES = "....... ..#.... ...#... ....... ...#... ....#.. ......."  # shared corners, slopes 1 to 3


def _shadow_cases():
    def corner(size, at, *buildings):
        town = np.zeros((size, size), bool)
        for place in buildings:
            town[place] = True
        return town, at

    border = [  # the corner lies at the border, or the device or the UAV does
        *(corner(2, (0, 0), (0, 1), (1, 0)), corner(3, (2, 0), (1, 0), (2, 1))),
        *(corner(3, (0, 2), (0, 1), (1, 2)), corner(4, (3, 3), (2, 3), (3, 2))),
    ]
    return {
        "Without buildings nothing is hidden, nor is the device's own cell: all is False.": [
            (np.zeros((size, size), bool), at)
            for size, at in ((1, (0, 0)), (2, (1, 0)), (3, (0, 2)), (5, (2, 2)))
        ],
        "A building that the ray crosses hides all behind it; the UAV's own cell counts, too. "
        "Cells are counted from the device, rows first.": [
            *(corner(3, (0, 0), (0, 1)), corner(3, (2, 1), (1, 1)), corner(4, (1, 3), (2, 0))),
            *((_town(".... .#.. #... ...."), (1, 0)), corner(5, (0, 4), (1, 2), (3, 4))),
        ],
        "A ray that only touches one building at a corner is not hidden by it.": [
            *(corner(2, (0, 0), (0, 1)), corner(3, (0, 0), (1, 2)), corner(4, (3, 0), (2, 0))),
        ],
        "A ray through the corner that two diagonally adjacent buildings share is hidden.": [
            *border,
            (_town("..... .#... ..#.. ...#. ....."), (3, 0)),
        ],
        "The crossed cells are not sorted along the ray, and rays of any slope pass through "
        "corners, not those at 45° alone.": [
            *((_town(SLOPES), at) for at in ((1, 4), (5, 2), (0, 0), (6, 5))),
            (_town("...... .#.... ..#... .....# .#..#. ......"), (0, 3)),
        ],
        "It must hold in any city.": [
            _random_town(*town)
            for town in (
                (1, 7, (2, 5)),
                (4, 8, (6, 1)),
                (5, 9, (4, 7)),
                (6, 3, (0, 1)),
                (7, 6, (5, 5)),
            )
        ],
    }


def _hidden(buildings, device, place):
    cell = tuple(place)
    reason = _blocked(buildings, device, cell)
    return f"A UAV over {cell} is {'hidden: ' + reason if reason else 'seen'}."


BLOCKED = "_blocked(buildings, device, cell"
SHADOW = Table(
    _shadow_map,
    _shadow_cases,
    mistakes={
        "It is True where there is line of sight: that is no shadow.": edit("bool(", "not ("),
        "Rows and columns are swapped: index [row, col], and the device is (row, col) too.": (
            edit("return shadow", "return shadow.T")
        ),
        "Rows and columns are swapped: the device is given as (row, col), not as (x, y).": (
            edit(BLOCKED, "_blocked(buildings.T, device, cell", "return shadow", "return shadow.T")
        ),
        "You block each ray that touches a building at a corner. One building there is only "
        "touched; it takes both, on either side of the ray.": (
            edit(BLOCKED, f"{BLOCKED}, touching=True")
        ),
        "You leave out the shared corners: a ray between two buildings that touch there is "
        "hidden.": edit(BLOCKED, f"{BLOCKED}, diagonal=False"),
        "A UAV over a building sees through it in your map: the cells at both ends of the segment "
        "are crossed too.": edit(BLOCKED, f"{BLOCKED}, ends=False"),
        "The device's own cell is dark in your map: nothing is between the device and a UAV right "
        "above it, unless the cell is a building.": (
            edit("return shadow", "shadow[device] = True; return shadow")
        ),
        "crossed_cells counts from (0, 0): add the device's row and column to what it gives, or "
        "you look at buildings somewhere else.": (
            edit(BLOCKED, "(buildings[tuple(crossed_cells(*np.subtract(cell, device)).T)].any()")
        ),
    },
    read=truths,
    where=_hidden,
    errors={
        "out of bounds": "You look beyond the grid: only cells from the device to the UAV matter.",
    },
)


def _draw_shadow(ax):
    buildings = np.zeros((9, 9), bool)
    buildings[[3, 4, 5, 6, 7, 7], [2, 3, 5, 4, 1, 2]] = True
    device = (5, 1)
    shadow = ~line_of_sight(buildings)[device]
    slipping = shadow & ~edit(BLOCKED, f"{BLOCKED}, diagonal=False").of(_shadow_map)(
        buildings, device
    )
    ax.imshow(0.75 * shadow + 0.25 * buildings, cmap="gray_r", vmin=0, vmax=1.4)
    for mask, marker, label in (
        (buildings, "s", "building"),
        (slipping, "x", "hidden by a shared corner only"),
    ):
        rows, cols = np.nonzero(mask)
        ax.plot(cols, rows, marker, color="black", ms=11 if marker == "s" else 6, label=label)
    ax.plot(device[1], device[0], "X", color=ORANGE, mec="white", ms=11, label="device")
    ax.set(xlabel="column", ylabel="row", title="grey: where the shadow map is True")
    ax.set(xticks=range(0, 9, 2), yticks=range(0, 9, 2))
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small")


@exercise(
    "2.2 · A shadow map from scratch (3 points, 35 minutes)",
    "For each cell of the city, list the cells that its ray crosses, and move them to where "
    "the device is. A ray goes through a corner where two crossed cells touch diagonally.",
    "If (r, c) and (r + 1, c + 1) are both crossed, look at (r, c + 1) and (r + 1, c): if both "
    "are buildings, the link is blocked. The same for (r, c) and (r + 1, c − 1). No other "
    "geometry is needed.",
    figure=_draw_shadow,
    table=SHADOW,
)
def shadow_map(answer) -> None:
    """`shadow_map(buildings, device)`: (M, M) bool, True where the link is blocked."""


def _asymmetric_share(sight):
    n = len(sight) ** 2
    pairs = sight.reshape(n, n)
    return np.triu(pairs != pairs.T).sum() / (n * (n - 1) / 2)


def _draw_asymmetric(ax):
    densities = np.linspace(0, 0.6, 9)
    cities = [stream(Use.EXERCISE, 0).random((12, 12)) < density for density in densities]
    for method, style in (("exact", "o-"), ("bresenham", "s-")):
        share = [_asymmetric_share(line_of_sight(city, method)) for city in cities]
        ax.plot(100 * densities, 100 * np.array(share), style, label=method)
    ax.set(xlabel="cells that are buildings, %", ylabel="asymmetric pairs, %")
    ax.set_title("random cities, 12 cells a side")


def _southeast(sight):
    """Whether the pairs whose first cell is above and left of the second are asymmetric."""
    rows, cols, other_rows, other_cols = np.indices(sight.shape)
    chosen = (rows < other_rows) & (cols < other_cols)
    return (sight != sight.transpose(2, 3, 0, 1))[chosen]


def _asymmetric_cases():
    def table(size, *blocked, fill=True):
        sight = np.full((size,) * 4, fill)
        for place in blocked:
            sight[place] = not fill
        return (sight,)

    generator = stream(Use.EXERCISE, 7)
    drawn = [generator.random((size,) * 4) < share for size in (2, 3, 4) for share in (0.5, 0.9)]
    buildings = stream(Use.EXERCISE, 3).random((7, 7)) < 0.25
    return {
        "Where all pairs agree, the share is 0: what differs counts, not what is seen.": [
            *(table(2), table(3, fill=False), table(2, (0, 1, 1, 0), (1, 0, 0, 1))),
            (line_of_sight(buildings),),
        ],
        "One of the n (n − 1) / 2 unordered pairs of different cells is asymmetric if one "
        "direction is blocked and the other is not, whichever of the two; n is M².": [
            *(table(2, (0, 1, 1, 0)), table(2, (1, 0, 0, 1)), table(2, (0, 0, 1, 1), fill=False)),
            *(table(3, (2, 1, 0, 2)), table(3, (0, 0, 0, 2), (2, 2, 0, 0))),
        ],
        "A cell and itself are no pair: what stands at [i, j, i, j] does not matter.": [
            *(table(2, (0, 1, 0, 1)), table(2, (0, 0, 0, 0), (0, 0, 1, 0))),
        ],
        "It must hold for any table.": [
            (np.tril(np.ones((9, 9), bool)).reshape(3, 3, 3, 3),),
            *((sight,) for sight in drawn),
            (line_of_sight(buildings, "bresenham"),),
        ],
        "A large table has more asymmetric pairs than 16 bits can count.": [
            (generator.random((24,) * 4) < 0.5,),
        ],
    }


DIFFERING, ALL = "np.triu(pairs != pairs.T)", "(n * (n - 1) / 2)"


def _counted(what, of="(n * (n - 1))"):
    """A mistake in what differs, where each pair is counted twice."""
    return edit(DIFFERING, what, ALL, of)


ASYMMETRIC = Table(
    _asymmetric_share,
    _asymmetric_cases,
    mistakes={
        "Pairs of a cell with itself are in your count: there are n (n − 1) / 2 pairs of different "
        "cells, not n² or n (n + 1) / 2.": (
            *(_counted("(pairs != pairs.T)", "n**2"), edit("n - 1", "n + 1")),
        ),
        "Yours is twice the share: the matrix shows each asymmetric pair twice, at [i, j] and at "
        "[j, i].": edit("np.triu", ""),
        "Yours is half the share or less: if you count each pair once, divide by the number of "
        "unordered pairs, n (n − 1) / 2.": (edit(ALL, "n**2"), edit(ALL, "(n * (n - 1))")),
        "That is the share of the symmetric pairs.": edit("return", "return 1 -"),
        "That is the number of pairs: divide by the number of all pairs.": (
            *(edit(f"/ {ALL}", ""), edit(f"/ {ALL}", "", "np.triu", "")),
        ),
        "A share is between 0 and 1, not in percent.": edit("return", "return 100 *"),
        ".T of an array with four axes reverses them all, so rows change places with columns. Only "
        "the two cells may: reshape to (n, n) first, or transpose(2, 3, 0, 1).": (
            _counted("(sight != sight.T)")
        ),
        "sight.T reverses all four axes, so rows change places with columns: reshape to (n, n) "
        "first. And leave the pairs of a cell with itself out of the count.": (
            _counted("(sight != sight.T)", "n**2")
        ),
        "You swap row and column within each cell: swap the two cells, transpose(2, 3, 0, 1).": (
            _counted("(sight != sight.transpose(1, 0, 3, 2))")
        ),
        "You count one direction only: a pair is asymmetric whichever of its two cells sees the "
        "other, and is not seen by it.": (
            edit("pairs != pairs.T", "pairs & ~pairs.T"),
            edit(DIFFERING, "np.tril(pairs & ~pairs.T)"),
        ),
        "You take only pairs of which one cell is above *and* to the left of the other. Number the "
        "cells, row · M + col, and take all with number 1 < number 2.": (
            edit(DIFFERING, "_southeast(sight)"),
            edit(f"{DIFFERING}.sum() / {ALL}", "_southeast(sight).mean()"),
        ),
    },
    read=number,
)


@exercise(
    "2.3 · How asymmetric is a table? (2 points, 12 minutes)",
    "Make the table a square matrix, one row and one column for each cell. Where does it "
    "differ from its transpose? How many unordered pairs are there?",
    "With n = M² cells, reshape to (n, n) and compare with .T: each asymmetric pair shows up "
    "twice. There are n (n − 1) / 2 unordered pairs of different cells.",
    figure=_draw_asymmetric,
    table=ASYMMETRIC,
)
def asymmetric_share(answer) -> None:
    """`asymmetric_share(sight)`: share of unordered pairs of cells that depend on direction."""
