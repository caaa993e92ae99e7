"""Exercises of notebook 2, shadows."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.given import shadow
from uavdh_lite.shadowing import line_of_sight
from uavdh_lite.streams import Use, stream


def off_the_line(start, end, cell):
    """Twice the cell's distance from the line, and the limit, both times the ray's length."""
    rows, cols, r, c = end[0] - start[0], end[1] - start[1], cell[0] - start[0], cell[1] - start[1]
    return 2 * abs(rows * c - cols * r), abs(rows) + abs(cols)


def between(start, end, cell):
    return all(min(a, b) <= x <= max(a, b) for a, b, x in zip(start, end, cell, strict=True))


DRAWN = [tuple(map(tuple, c)) for c in stream(Use.EXERCISE, 2).integers(0, 9, (400, 3, 2)).tolist()]
TOUCHING = [c for c in DRAWN if between(*c) and len({*off_the_line(*c)}) == 1 and c[0] != c[1]]
APART = [case for case in DRAWN if case not in TOUCHING]
# Every corner that a ray of up to ten rows and columns touches, in all four directions
TOUCHING += [
    ((0, 0), (down * R, right * C), (down * r, right * c))
    for R, C in np.ndindex(11, 11)
    for r, c in np.ndindex(R + 1, C + 1)
    if 2 * abs(R * c - C * r) == R + C > 0
    for down in (1, -1)
    for right in (1, -1)
]


@exercise(
    "2.1 · Does the ray cross the cell? (1 point, 10 minutes)",
    rules={
        "The segment begins and ends in the middle of a cell, so it crosses both cells. For them "
        "R·c − C·r is 0, which is less than (|R| + |C|) / 2.": [
            ((2, 3), (4, 8), (2, 3)),
            ((2, 3), (4, 8), (4, 8)),
        ],
        "If both ends are the same point, only that cell is crossed. Then R and C are 0, "
        "so nothing is less than (|R| + |C|) / 2: treat this case separately.": [
            ((4, 6), (4, 6), (4, 6)),
            ((4, 6), (4, 6), (4, 7)),
        ],
        "Along a row or a column the segment runs through the middle of each cell between its "
        "ends, and through no other. Compare products, so that no slope is needed.": [
            ((3, 2), (3, 7), (3, 5)),
            ((3, 2), (3, 7), (4, 5)),
            ((6, 4), (1, 4), (3, 5)),
        ],
        "A cell that is on the line beyond an end of the segment is not crossed: only cells in the "
        "rectangle between the two ends can be.": [
            ((2, 2), (4, 4), (6, 6)),
            ((3, 5), (3, 8), (3, 1)),
            ((3, 3), (0, 0), (4, 4)),
            ((2, 2), (5, 6), (2, 1)),
            ((2, 2), (5, 6), (5, 7)),
            ((2, 2), (6, 5), (1, 2)),
        ],
        "Measure rows and columns from start. The cell's centre must be near the line, on either "
        "side of it: |R·c − C·r| less than (|R| + |C|) / 2. No other distance will do.": [
            case for case in APART if case[0][0] <= case[1][0] and case[0][1] <= case[1][1]
        ],
        "A ray may go up or left: R or C is then negative, and R·c − C·r may be, too. Comparisons "
        "and sums must take care of the signs; |R + C| is not |R| + |C|.": APART,
        "A segment that only touches a cell at a corner does not cross its open interior. Compare "
        "with <, not <=, and in whole numbers: rounded ones cannot tell touching from crossing.": [
            ((1, 1), (4, 4), (1, 2)),
            ((0, 0), (7, 21), (3, 8)),
            *TOUCHING,
        ],
        "A segment may cut off a tiny corner of a cell, or miss the cell by a hair. Points sampled "
        "along the ray miss such a corner: compare whole numbers.": [
            ((0, 0), (m, m + 1), cell) for m in (9, 100, 10**6) for cell in ((0, 1), (1, 0))
        ],
    },
)
def crosses(start, end, cell):
    """`crosses(start, end, cell)`: does the segment cross the open interior of the cell?"""
    distance, limit = off_the_line(start, end, cell)
    return between(start, end, cell) and (start == end or distance < limit)


def town(size, device, *buildings):
    """Arguments of `shadow_map`: a city of so many cells a side with these buildings, a device."""
    cells = np.zeros((size, size), bool)
    cells[tuple(np.array(buildings, int).reshape(-1, 2).T)] = True
    return cells, device


@exercise(
    "2.2 · A shadow map (2 points, 10 minutes)",
    rules={
        "Without buildings nothing is hidden, not even the device's own cell: everything is False, "
        "in an array of Booleans such as np.zeros(shape, bool).": [(1, (0, 0)), (2, (1, 0))],
        "A building that the ray crosses hides everything behind it, and a UAV over a building is "
        "hidden, too: the map is True where the link is blocked.": [
            (1, (0, 0), (0, 0)),
            (3, (2, 1), (1, 0), (1, 1), (1, 2)),
        ],
        "A ray through the corner that two diagonal buildings share is blocked. One that only "
        "touches one building at a corner is not.": [
            (2, (0, 0), (0, 1)),
            (3, (0, 0), (1, 2)),
            (2, (1, 0), (0, 0), (1, 1)),
            (2, (0, 0), (0, 1), (1, 0)),
            (5, (3, 0), (1, 1), (2, 2), (3, 3)),
        ],
        "Every cell has its own ray, in any city.": [
            (7, at, (1, 2), (2, 3), (4, 3), (5, 4)) for at in ((1, 4), (5, 2), (0, 0), (6, 5))
        ],
    },
    mistakes={
        "Rows and columns are swapped: the map is indexed [row, col], and a cell is (row, col).": (
            lambda buildings, device: shadow(buildings, device).T
        ),
        "That is the line of sight. The shadow map is True where the link is blocked.": (
            lambda buildings, device: ~shadow(buildings, device)
        ),
    },
    case=town,
)
def shadow_map(buildings, device):
    """`shadow_map(buildings, device)`: (M, M) bool, True where the link is blocked."""
    return shadow(buildings, device)


def table(size, *blocked):
    """A table in which all cells see each other, but for these places; or the one that is given."""
    if isinstance(size, np.ndarray):
        return (size,)
    sight = np.full((size,) * 4, True)
    for place in blocked:
        sight[place] = False
    return (sight,)


def count_asymmetric(sight):
    pairs = sight.reshape(len(sight) ** 2, -1)
    return float(np.triu(pairs != pairs.T).sum())


def called_table(sight):
    blocked = np.argwhere(~sight).tolist()
    where = f"False at {blocked[:2]}{' and elsewhere' * (len(blocked) > 2)}"
    return f"asymmetric_share(sight), with {where if blocked else 'True everywhere'},"


BUILDINGS = stream(Use.EXERCISE, 3).random((7, 7)) < 0.25
RANDOM = {m: stream(Use.EXERCISE, m).random((m,) * 4) for m in (2, 4)}


@exercise(
    "2.3 · How asymmetric is a table? (2 points, 10 minutes)",
    rules={
        "If both directions of every pair agree, the share is 0, whether both are clear or both "
        "blocked. A cell forms no pair with itself, [i, j, i, j]. Note that .T reverses all 4 "
        "axes: reshape first.": [2, 3, (2, (0, 1, 0, 1)), line_of_sight(BUILDINGS)],
        "There are n (n − 1) / 2 unordered pairs of different cells, with n = M². A pair is "
        "asymmetric if exactly one of its two directions is blocked. Divide the number of these by "
        "the number of all pairs.": [(2, (0, 1, 1, 0)), (3, (2, 1, 0, 2))],
        "It must work for any table.": [RANDOM[2] < 0.5, RANDOM[2] < 0.9, RANDOM[4] < 0.5],
    },
    mistakes={
        "Pairs of a cell with itself are in your count: there are n (n − 1) / 2 pairs of different "
        "cells, not n².": lambda sight: 2 * count_asymmetric(sight) / len(sight) ** 4,
        "Your answer is twice the share: the matrix shows each asymmetric pair twice, at [i, j] "
        "and at [j, i].": lambda sight: 2 * asymmetric_share.solution(sight),
    },
    case=table,
    call=called_table,
)
def asymmetric_share(sight):
    """`asymmetric_share(sight)`: share of unordered pairs of cells that depend on direction."""
    n = len(sight) ** 2
    return count_asymmetric(sight) / (n * (n - 1) / 2)
