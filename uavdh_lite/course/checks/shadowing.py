"""Exercises of notebook 2, shadow ray tracing."""

from itertools import product

import numpy as np

from uavdh_lite.course.checks.exercise import solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.values import truth, truths
from uavdh_lite.plotting import ORANGE
from uavdh_lite.shadowing import crossed_cells, line_of_sight
from uavdh_lite.streams import Use, stream


def _draw_crosses(ax, solved):
    start, end = (0, 0), (3, 5)
    crossed = [[solved(start, end, (row, col)) for col in range(7)] for row in range(5)]
    ax.pcolormesh(crossed, cmap="Blues", vmax=2.5, edgecolors="grey")
    ax.plot([start[1] + 0.5, end[1] + 0.5], [start[0] + 0.5, end[0] + 0.5], "ko-")
    ax.set(aspect="equal", xticks=[], yticks=[], ylim=(5, 0))
    ax.set(xlabel="column", ylabel="row", title=f"True in the {np.sum(crossed)} blue cells")


def _measured(start, end, cell, _):
    (rows, cols), (r, c) = np.subtract(end, start).tolist(), np.subtract(cell, start).tolist()
    return (
        f"Here R = {rows}, C = {cols}, r = {r}, c = {c}, |R·c − C·r| = {abs(rows * c - cols * r)}, "
        f"(|R| + |C|) / 2 = {(abs(rows) + abs(cols)) / 2:g}."
    )


def _crosses_cases():
    touches = edit(") < abs", ") <= abs", "start == end or ", "").of(crosses.solved)
    drawn = stream(Use.EXERCISE, 2).integers(0, 9, (400, 3, 2)).tolist()
    cases = [tuple(map(tuple, case)) for case in drawn]
    touching = [case for case in cases if touches(*case) and not crosses.solved(*case)]
    return {
        "The segment begins and ends in the middle of a cell, so it crosses these two, too. If "
        "both ends are the same point, it crosses that cell and no other. Measure rows and columns "
        "from start.": [
            *(((2, 3), (4, 8), (2, 3)), ((2, 3), (4, 8), (4, 8)), ((4, 6), (4, 6), (4, 6))),
            ((4, 6), (4, 6), (4, 7)),
        ],
        "Along a row or a column the segment runs through the middle of each cell between its "
        "ends, and through no other; no slope is needed, compare products.": [
            *(((3, 2), (3, 7), (3, 5)), ((3, 2), (3, 7), (4, 5)), ((6, 4), (1, 4), (3, 5))),
        ],
        "A cell that is on the line beyond an end of the segment is not crossed: only cells in the "
        "rectangle between the two ends can be.": [
            *(((2, 2), (4, 4), (6, 6)), ((3, 5), (3, 8), (3, 1)), ((3, 3), (0, 0), (4, 4))),
            *(((2, 2), (5, 6), (2, 1)), ((2, 2), (5, 6), (5, 7)), ((2, 2), (6, 5), (1, 2))),
        ],
        "Not all cells of the rectangle between the two ends are crossed. The cell's centre must "
        "be near the line, on either side of it: |R·c − C·r| less than (|R| + |C|) / 2. No other "
        "distance will do.": [
            ((2, 3), (4, 8), (2, 4)),
            *(c for c in cases if c not in touching and (np.subtract(c[1], c[0]) >= 0).all()),
        ],
        "A ray may go up or left: R and C are then negative, and so may R·c − C·r be. Comparisons "
        "and sums must take care of the signs (min, max, abs); |R + C| is not |R| + |C|.": [
            case for case in cases if case not in touching
        ],
        "A segment that only touches a cell at a corner does not cross its open interior. Compare "
        "with < instead of <=, and in whole numbers: rounded ones cannot tell touching from "
        "crossing.": [
            *(((1, 1), (4, 4), (1, 2)), ((0, 0), (7, 21), (3, 8)), *touching),
        ],
        "A segment may cut off a tiny corner of a cell, or miss the cell by a hair. Points sampled "
        "along the ray step over it, and so does Bresenham's line: compare whole numbers.": [
            ((0, 0), (m, m + 1), cell) for m in (9, 100, 10**6) for cell in ((0, 1), (1, 0))
        ],
    }


@solution(
    "2.1 · Does the ray cross the cell? (1 point, 10 minutes)",
    "The tutorial's segment begins at (0, 0): move yours there. Which numbers may then be "
    "negative, and what is the rectangle? What does the condition say if R = C = 0?",
    "(R, C) is end minus start, (r, c) is cell minus start, by rows and columns. The rectangle "
    "is min(R, 0) <= r <= max(R, 0), and the same with c and C. If R = C = 0 it is one cell, "
    "and the condition, 0 < 0, must not be asked.",
    figure=_draw_crosses,
    rules=_crosses_cases,
    mistakes={"You forget the factor 2 before |R·c − C·r|.": edit("2 * abs", "abs")},
    read=truth,
    why=_measured,
    errors={
        "ZeroDivision": "A ray along a row or a column has no slope one way.",
        "allocate": "Do not list the cells of the ray, test the one that is asked for.",
    },
)
def crosses(start, end, cell):
    """`crosses(start, end, cell)`: does the segment cross the open interior of the cell?"""
    rows, cols = end[0] - start[0], end[1] - start[1]
    r, c = cell[0] - start[0], cell[1] - start[1]
    inside = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    return inside and (start == end or 2 * abs(rows * c - cols * r) < abs(rows) + abs(cols))


def _blocked(buildings, device, cell):
    """What blocks the link from a device to a UAV, if anything."""
    crossed = crossed_cells(*np.subtract(cell, device).tolist())
    places = [tuple(one) for one in (crossed + np.array(device)).tolist()]
    for one in places:
        if buildings[one]:
            return f"the ray crosses the building {one}"
    for (r, c), side in product(places, (-1, 1)):
        one, other = (r, c + side), (r + 1, c)
        if (r + 1, c + side) in places and buildings[one] and buildings[other]:
            return f"the ray goes through the corner that the buildings {one} and {other} share"
    return ""


def _town(size, device, *buildings):
    """Arguments of `shadow_map`: a city of so many cells a side with these buildings, a device."""
    cells = np.zeros((size, size), bool)
    cells[tuple(np.array(buildings, int).reshape(-1, 2).T)] = True
    return cells, device


def _hidden(buildings, device, place):
    reason = _blocked(buildings, device, place)
    seen = "seen: its ray crosses no building, and no corner that two buildings share"
    return f"A UAV over {place} is {'hidden: ' + reason if reason else seen}."


BLOCKED = "_blocked(buildings, device, cell"


def _draw_shadow(ax, solved):
    buildings = np.zeros((9, 9), bool)
    buildings[[3, 4, 5, 6, 7, 7], [2, 3, 5, 4, 1, 2]] = True
    device = (5, 1)
    reasons = [[_blocked(buildings, device, (r, c)) for c in range(9)] for r in range(9)]
    shadow, slipping = np.array(reasons) != "", np.char.find(reasons, "corner") >= 0
    ax.imshow(0.75 * shadow + 0.25 * buildings, cmap="gray_r", vmin=0, vmax=1.4)
    ax.plot(*np.nonzero(buildings)[::-1], "ks", ms=11, label="building")
    ax.plot(*np.nonzero(slipping)[::-1], "kx", label="hidden by a shared corner only")
    ax.plot(device[1], device[0], "X", color=ORANGE, mec="white", ms=11, label="device")
    ax.set(xlabel="column", ylabel="row", title="grey: where the shadow map is True")
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small")


@solution(
    "2.2 · A shadow map from scratch (3 points, 35 minutes)",
    "For each cell of the city, list the cells that its ray crosses, and move them to where "
    "the device is. A ray goes through a corner where two crossed cells touch diagonally.",
    "If (r, c) and (r + 1, c + 1) are both crossed, look at (r, c + 1) and (r + 1, c): if both "
    "are buildings, the link is blocked. The same for (r, c) and (r + 1, c − 1). No other "
    "geometry is needed.",
    figure=_draw_shadow,
    rules={
        "Without buildings nothing is hidden, nor is the device's own cell: all is False. (True is "
        "where there is no line of sight.)": [
            *((1, (0, 0)), (2, (1, 0)), (5, (2, 2))),
        ],
        "A building that the ray crosses hides all behind it, and a UAV over a building is hidden, "
        "too. crossed_cells counts from (0, 0): add the device's row and column.": [
            (3, (2, 1), (1, 0), (1, 1), (1, 2)),
            (4, (1, 3), (0, 1), (1, 1), (2, 1), (3, 1)),
        ],
        "A ray through the corner that two diagonally adjacent buildings share is hidden. One that "
        "only touches one building at a corner is not; it takes both.": [
            *((2, (0, 0), (0, 1)), (2, (0, 0), (1, 0)), (3, (0, 0), (1, 2)), (4, (3, 0), (2, 0))),
            *((2, (0, 0), (0, 1), (1, 0)), (2, (1, 0), (0, 0), (1, 1))),
            *(
                (3, (2, 0), (1, 0), (2, 1)),
                (3, (0, 2), (0, 1), (1, 2)),
                (5, (3, 0), (1, 1), (2, 2), (3, 3)),
            ),
        ],
        "The crossed cells are not sorted along the ray, and rays of any slope pass through "
        "corners, not those at 45° alone.": [
            (7, at, (1, 2), (2, 3), (4, 3), (5, 4)) for at in ((1, 4), (5, 2), (0, 0), (6, 5))
        ],
    },
    made=_town,
    mistakes={
        "Rows and columns are swapped: index [row, col], and the device is (row, col) too.": (
            edit("return shadow", "return shadow.T"),
            edit(BLOCKED, "_blocked(buildings.T, device, cell", "return shadow", "return shadow.T"),
        ),
    },
    read=truths,
    why=_hidden,
    errors={
        "out of bounds": "You look beyond the grid. crossed_cells(row − device row, column − "
        "device column) counts its cells from the device. And of a corner between (r, c) and "
        "(r + 1, c ± 1), the other two cells are (r, c ± 1) and (r + 1, c).",
    },
)
def shadow_map(buildings, device):
    """`shadow_map(buildings, device)`: (M, M) bool, True where the link is blocked."""
    shadow = np.zeros(buildings.shape, bool)
    for cell in np.ndindex(shadow.shape):
        shadow[cell] = bool(_blocked(buildings, device, cell))
    return shadow


def _draw_asymmetric(ax, solved):
    densities = np.linspace(0, 0.6, 9)
    cities = [stream(Use.EXERCISE, 0).random((12, 12)) < density for density in densities]
    for method, style in (("exact", "o-"), ("bresenham", "s-")):
        share = [solved(line_of_sight(city, method)) for city in cities]
        ax.plot(100 * densities, 100 * np.array(share), style, label=method)
    ax.set(xlabel="cells that are buildings, %", ylabel="asymmetric pairs, %")
    ax.set_title("random cities, 12 cells a side")


def _table(sight):
    """How a message calls a table: it may have many numbers."""
    blocked = np.argwhere(~sight).tolist()
    places = " and ".join(map(str, blocked)) if len(blocked) < 4 else f"{len(blocked)} places"
    said = f"False only at {places}" if blocked else "True everywhere"
    return f"asymmetric_share(sight), with M = {len(sight)} and {said},"


def _sight(size, *blocked):
    """A table in which all cells see each other, but for these places; or the one that is given."""
    if isinstance(size, np.ndarray):
        return (size,)
    sight = np.full((size,) * 4, True)
    for place in blocked:
        sight[place] = False
    return (sight,)


BUILDINGS = stream(Use.EXERCISE, 3).random((7, 7)) < 0.25
RANDOM = {m: stream(Use.EXERCISE, m).random((m,) * 4) for m in (2, 4, 24)}
DIFFERING, ALL = "np.triu(pairs != pairs.T)", "(n * (n - 1) / 2)"


@solution(
    "2.3 · How asymmetric is a table? (2 points, 12 minutes)",
    "Make the table a square matrix, one row and one column for each cell. Where does it "
    "differ from its transpose? How many unordered pairs are there?",
    "With n = M² cells, reshape to (n, n) and compare with .T: each asymmetric pair shows up "
    "twice. There are n (n − 1) / 2 unordered pairs of different cells.",
    figure=_draw_asymmetric,
    rules={
        "If in every pair both directions agree, the share is 0, whether they are seen or blocked. "
        "A cell and itself, [i, j, i, j], are no pair.": [
            *(2, (2, (0, 1, 1, 0), (1, 0, 0, 1)), line_of_sight(BUILDINGS)),
            *((2, (0, 1, 0, 1)), 3),
        ],
        "There are n (n − 1) / 2 unordered pairs of different cells, n = M². A pair is asymmetric "
        "if exactly one of its two directions is blocked. Divide the number of these by the number "
        "of all pairs.": [
            *((2, (0, 1, 1, 0)), (2, (1, 0, 0, 1)), (3, (2, 1, 0, 2))),
            *((3, (0, 0, 0, 2), (2, 2, 0, 0)), (2, (0, 0, 0, 0), (0, 0, 1, 0))),
        ],
        "It must hold for any table; in a large one 16 bits cannot count the asymmetric pairs.": [
            *(RANDOM[2] < 0.5, RANDOM[2] < 0.9, RANDOM[4] < 0.5, RANDOM[4] < 0.9, RANDOM[24] < 0.5),
            line_of_sight(BUILDINGS, "bresenham"),
        ],
    },
    made=_sight,
    mistakes={
        "Pairs of a cell with itself are in your count: there are n (n − 1) / 2 pairs of different "
        "cells, not n² or n (n + 1) / 2.": (
            *(edit("np.triu", "", ALL, "n**2"), edit("n - 1", "n + 1")),
        ),
        "Yours is twice the share: the matrix shows each asymmetric pair twice, at [i, j] and at "
        "[j, i].": edit("np.triu", ""),
        ".T of an array with four axes reverses them all, so rows change places with columns. Only "
        "the two cells may: reshape to (n, n) first, or transpose(2, 3, 0, 1).": (
            *(edit(DIFFERING, "(sight != sight.T)", ALL, n) for n in ("(n * (n - 1))", "n**2")),
        ),
    },
    call=_table,
    errors={
        "shape": "The square matrix has n = M² rows, one for each cell, where M is len(sight)."
    },
)
def asymmetric_share(sight):
    """`asymmetric_share(sight)`: share of unordered pairs of cells that depend on direction."""
    n = len(sight) ** 2
    pairs = sight.reshape(n, n)
    return np.triu(pairs != pairs.T).sum() / (n * (n - 1) / 2)
