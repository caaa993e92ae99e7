"""Exercises of notebook 2, shadow ray tracing."""

import numpy as np

from uavdh_lite.course.checks.exercise import CheckFailed, close, compare, exercise, expect
from uavdh_lite.plotting import ORANGE
from uavdh_lite.shadowing import crossed_cells, line_of_sight
from uavdh_lite.streams import Use, stream


def _crosses(start, end, cell):
    """Whether the segment between two cell centres crosses the open interior of a cell."""
    crossed = crossed_cells(end[0] - start[0], end[1] - start[1]) + start
    return list(cell) in crossed.tolist()


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


def _touches(start, end, cell):
    """Whether the segment has a point in the cell, its edges and corners included."""
    (rows, cols), (r, c) = np.subtract(end, start), np.subtract(cell, start)
    return 2 * abs(rows * c - cols * r) <= abs(rows) + abs(cols) and all(
        min(a, b) <= x <= max(a, b) for a, b, x in zip(start, end, cell, strict=True)
    )


def _within(start, end, cell, formula):
    """Whether the cell is in the rectangle and the formula of R, C, r, c holds."""
    (rows, cols), (r, c) = (np.subtract(one, start).tolist() for one in (end, cell))
    inside = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    return inside and formula(rows, cols, r, c)


FORMULAS = {
    "You forget the factor 2: it is twice |R·c − C·r| that must be below |R| + |C|.": (
        lambda rows, cols, r, c: abs(rows * c - cols * r) < abs(rows) + abs(cols)
    ),
    "|R + C| is not |R| + |C|: on the way up or left R or C is negative, and they cancel.": (
        lambda rows, cols, r, c: 2 * abs(rows * c - cols * r) < abs(rows + cols)
    ),
    "R·c − C·r may be negative: take its absolute value.": (
        lambda rows, cols, r, c: 2 * (rows * c - cols * r) < abs(rows) + abs(cols)
    ),
}
TOUCHING = (
    "The segment only touches that cell at a corner, which is not crossing its open interior. "
    "Compare with < instead of <=, and in whole numbers: rounded ones cannot tell touching from "
    "crossing."
)
RAYS = (
    # what is asked, what to say of it, and the (start, end, cell) that ask it
    (
        "The segment begins and ends in the middle of a cell, so it crosses these two cells too. "
        "Are rows and columns measured from start?",
        [((2, 3), (4, 8), (2, 3)), ((2, 3), (4, 8), (4, 8)), ((5, 5), (5, 2), (5, 2))],
    ),
    (
        "Along a row or a column the segment runs through the middle of each cell between its "
        "ends, and through no other.",
        [
            ((3, 2), (3, 7), (3, 5)),
            ((3, 2), (3, 7), (4, 5)),
            ((1, 4), (6, 4), (2, 4)),
            ((6, 4), (1, 4), (3, 5)),
        ],
    ),
    (
        "Both ends are the same point, in the middle of one cell: it lies inside that cell and no "
        "other.",
        [((4, 6), (4, 6), (4, 6)), ((4, 6), (4, 6), (4, 7))],
    ),
    (
        "Not all cells of the rectangle between the two ends are crossed: ask how far the cell's "
        "centre is from the line.",
        [((1, 1), (7, 6), (1, 6)), ((1, 1), (7, 6), (7, 1)), ((8, 2), (3, 9), (3, 3))],
    ),
    (
        "That cell is on the line, but beyond the end of the segment: only cells in the rectangle "
        "between the two ends can be crossed.",
        [((2, 2), (4, 4), (6, 6)), ((3, 5), (3, 8), (3, 1)), ((5, 5), (7, 9), (3, 1))],
    ),
    (
        "Up and left R and C are negative: do comparisons and sums take care of their signs?",
        [
            (start, end, cell)
            for start, end in (((4, 5), (1, 3)), ((4, 2), (2, 5)), ((1, 5), (3, 2)))
            for cell in np.ndindex(6, 7)
            if _crosses(start, end, cell) or not _touches(start, end, cell)
        ],
    ),
    (
        TOUCHING,
        [
            ((1, 1), (4, 4), (1, 2)),
            ((1, 1), (4, 4), (3, 2)),
            ((6, 1), (2, 5), (5, 1)),
            ((0, 0), (3, 9), (1, 1)),
            ((0, 0), (3, 9), (0, 2)),
            ((2, 9), (9, 2), (4, 8)),
            ((0, 0), (7, 21), (3, 8)),
        ],
    ),
    (
        "The segment cuts off only a small corner of that cell, and that counts. Points sampled "
        "along the ray step over it, and so does Bresenham's line: compare whole numbers.",
        [((0, 0), (100, 101), (0, 1)), ((0, 0), (9, 10), (0, 1)), ((70, 3), (0, 74), (70, 4))],
    ),
    (
        "The segment misses that cell, if only by a hair: no tolerance is needed, nor sampled "
        "points, if you compare whole numbers.",
        [((0, 0), (100, 101), (1, 0)), ((0, 0), (9, 10), (1, 0)), ((70, 3), (0, 74), (69, 3))],
    ),
)


@exercise(
    "2.1",
    "Does the ray cross the cell?",
    points=1,
    minutes=10,
    hints=(
        "The tutorial's segment begins at (0, 0): move yours there. Which numbers may then be "
        "negative, and what is the rectangle? What does the condition say if R = C = 0?",
        "(R, C) is end minus start, (r, c) is cell minus start, by rows and columns. The rectangle "
        "is min(R, 0) <= r <= max(R, 0), and the same with c and C. If R = C = 0 it is one cell, "
        "and the condition, 0 < 0, must not be asked.",
    ),
    figure=_draw_crosses,
)
def crosses(answer) -> None:
    """`crosses(start, end, cell)`: does the segment cross the open interior of the cell?"""

    def ask(start, end, cell):
        try:
            value = answer(start, end, cell)
        except CheckFailed as failed:
            if not isinstance(failed.__cause__, ZeroDivisionError):
                raise
            raise CheckFailed(
                f"From {start} to {end} you divide by zero: a ray along a row or a column has no "
                "slope one way. Compare products instead of dividing."
            ) from None
        expect(
            np.ndim(value) == 0 and isinstance(value, bool | np.bool_ | int),
            f"One truth value is expected, True or False; you give back {value!r}.",
        )
        return bool(value)

    cases = [
        (case, message, k < 6) for k, (message, several) in enumerate(RAYS) for case in several
    ]
    for drawn in stream(Use.EXERCISE, 2).integers(0, 9, (300, 3, 2)).tolist():
        case = tuple(tuple(cell) for cell in drawn)
        touching = not _crosses(*case) and _touches(*case)
        cases.append((case, TOUCHING if touching else "Draw it on squared paper.", not touching))
    wrong = [one for one in cases if ask(*one[0]) != _crosses(*one[0])]
    if not wrong:
        return
    for message, formula in FORMULAS.items():
        moving = [case for case, *_ in cases if case[0] != case[1]]
        if all(ask(*case) == _within(*case, formula) for case in moving):
            raise CheckFailed(message)
    (start, end, cell), message, either_way = wrong[0]
    (rows, cols), (r, c) = (np.subtract(one, start).tolist() for one in (end, cell))
    right = _crosses(start, end, cell)
    if either_way and any(start) and ask((0, 0), (rows, cols), (r, c)) == right:
        message = "Moved so that it starts at (0, 0), yours is right: measure all cells from start."
    elif either_way and start != end and ask(end, start, cell) == right:
        message = (
            f"The other way round, from {end} to {start}, yours is right. A ray may go up or left: "
            "is there a `min`, `max` or `abs` missing?"
        )
    raise CheckFailed(
        f"From {start} to {end}, that is, R = {rows} and C = {cols}, and the cell {cell} it is "
        f"{right}, you say {not right}. {message}"
    )


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
                    return (
                        "the ray goes through the corner that the buildings {} and {} share".format(
                            *corner
                        )
                    )
    return ""


def _shadow_map(buildings, device, **rule):
    shadow = np.zeros(buildings.shape, bool)
    for cell in np.ndindex(shadow.shape):
        shadow[cell] = bool(_blocked(buildings, device, cell, **rule))
    return shadow


def _device_dark(buildings, device):
    shadow = _shadow_map(buildings, device)
    shadow[device] = True
    return shadow


def _not_moved(buildings, device):
    """The cells are left relative to the device; negative indices wrap round."""
    shadow = np.zeros(buildings.shape, bool)
    for row, col in np.ndindex(shadow.shape):
        crossed = crossed_cells(row - device[0], col - device[1])
        shadow[row, col] = buildings[tuple(crossed.T)].any()
    return shadow


def _town(text):
    return np.array([[sign == "#" for sign in line] for line in text.split()])


def _random_town(seed, size, device):
    buildings = stream(Use.EXERCISE, seed).random((size, size)) < 0.2
    buildings[device] = False
    return buildings, device


TOWNS = (
    (_town(".... .#.. #... ...."), (1, 0)),
    (_town("..... .#... ..#.. ...#. ....."), (3, 0)),
    (_town("...... .#.... ..#... .....# .#..#. ......"), (0, 3)),
    # Through shared corners at slopes of 1 to 3, down left and up right
    (_town("....... ..#.... ...#... ....... ...#... ....#.. ......."), (1, 4)),
    (_town("....... ..#.... ...#... ....... ...#... ....#.. ......."), (5, 2)),
    _random_town(1, 7, (2, 5)),
    _random_town(4, 8, (6, 1)),
    _random_town(5, 9, (4, 7)),
)


def _draw_shadow(ax):
    buildings = np.zeros((9, 9), bool)
    buildings[[3, 4, 5, 6, 7, 7], [2, 3, 5, 4, 1, 2]] = True
    device = (5, 1)
    shadow = ~line_of_sight(buildings)[device]
    slipping = shadow & ~_shadow_map(buildings, device, diagonal=False)
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
    "2.2",
    "A shadow map from scratch",
    points=3,
    minutes=35,
    hints=(
        "For each cell of the city, list the cells that its ray crosses, and move them to where "
        "the device is. A ray goes through a corner where two crossed cells touch diagonally.",
        "If (r, c) and (r + 1, c + 1) are both crossed, look at (r, c + 1) and (r + 1, c): if both "
        "are buildings, the link is blocked. The same for (r, c) and (r + 1, c − 1). No other "
        "geometry is needed.",
    ),
    figure=_draw_shadow,
)
def shadow_map(answer) -> None:
    """`shadow_map(buildings, device)`: (M, M) bool, True where the link is blocked."""
    mistakes = {
        "It is True where there is line of sight: the shadow is where the link is blocked.": (
            lambda b, d: ~_shadow_map(b, d)
        ),
        "Rows and columns are swapped: index [row, col], and the device is (row, col) too.": (
            lambda b, d: _shadow_map(b, d).T
        ),
        "Rows and columns are swapped: the device is given as (row, col), not as (x, y).": (
            lambda b, d: _shadow_map(b.T, d).T
        ),
        "You block each ray that touches a building at a corner. One building there is only "
        "touched; it takes both, on either side of the ray.": (
            lambda b, d: _shadow_map(b, d, touching=True)
        ),
        "A UAV over a building sees through it in your map: the cells at both ends of the segment "
        "are crossed too.": lambda b, d: _shadow_map(b, d, ends=False),
        "The device's own cell is dark in your map: nothing is between the device and a UAV right "
        "above it, unless the cell is a building.": _device_dark,
        "crossed_cells counts from (0, 0): add the device's row and column to what it gives, or "
        "you look at buildings somewhere else.": _not_moved,
    }
    given = []
    for buildings, device in TOWNS:
        shadow, copy = None, buildings.copy()
        try:
            shadow = np.asarray(answer(copy, device))
        except CheckFailed as failed:
            if isinstance(failed.__cause__, IndexError):
                raise CheckFailed(
                    f"{failed} Do you look beyond the grid? No cell outside the rectangle from the "
                    "device to the UAV matters."
                ) from None
            raise
        expect(
            shadow.shape == buildings.shape,
            f"The map has one entry for each cell, {buildings.shape}; yours has the shape "
            f"{shadow.shape}.",
        )
        expect(
            shadow.dtype == bool,
            f"The map is an array of Booleans; yours has the dtype {shadow.dtype}.",
        )
        expect(
            (copy == buildings).all(),
            "Your function changes the array `buildings` that it is given: make an array of your "
            "own for the result.",
        )
        given.append(shadow)
    solved = [~line_of_sight(buildings)[device] for buildings, device in TOWNS]
    wrong = [k for k in range(len(TOWNS)) if (given[k] != solved[k]).any()]
    if not wrong:
        return
    for message, mistake in mistakes.items():
        if all(np.array_equal(given[k], mistake(*TOWNS[k])) for k in wrong):
            raise CheckFailed(message)
    buildings, device = TOWNS[wrong[0]]
    cell = tuple(np.argwhere(given[wrong[0]] != solved[wrong[0]])[0].tolist())
    where = [tuple(one) for one in np.argwhere(buildings).tolist()]
    reason = _blocked(buildings, device, cell) or "the ray crosses no building"
    corner = (
        " The crossed cells are not sorted along the ray, and rays of any slope pass through "
        "corners, not those at 45° alone."
    )
    raise CheckFailed(
        f"With the device at {device} and buildings at {where}, a UAV over {cell} is "
        f"{'hidden' if solved[wrong[0]][cell] else 'seen'}: {reason}. Yours says the opposite."
        f"{corner if 'corner' in reason else ''}"
    )


def _asymmetric_share(sight):
    cells = len(sight) ** 2
    pairs = np.asarray(sight).reshape(cells, cells)
    return np.triu(pairs != pairs.T).sum() / (cells * (cells - 1) / 2)


def _draw_asymmetric(ax):
    densities = np.linspace(0, 0.6, 9)
    cities = [stream(Use.EXERCISE, 0).random((12, 12)) < density for density in densities]
    for method, style in (("exact", "o-"), ("bresenham", "s-")):
        share = [_asymmetric_share(line_of_sight(city, method)) for city in cities]
        ax.plot(100 * densities, 100 * np.array(share), style, label=method)
    ax.set(xlabel="cells that are buildings, %", ylabel="asymmetric pairs, %")
    ax.set_title("random cities, 12 cells a side")
    ax.legend()
    ax.grid(alpha=0.3)


@exercise(
    "2.3",
    "How asymmetric is a table?",
    points=2,
    minutes=12,
    hints=(
        "Make the table a square matrix, one row and one column for each cell. Where does it "
        "differ from its transpose? How many unordered pairs are there?",
        "With n = M² cells, reshape to (n, n) and compare with .T: each asymmetric pair shows up "
        "twice. There are n (n − 1) / 2 unordered pairs of different cells.",
    ),
    figure=_draw_asymmetric,
)
def asymmetric_share(answer) -> None:
    """`asymmetric_share(sight)`: share of unordered pairs of cells that depend on direction."""

    def matrix(sight):
        return sight.reshape(len(sight) ** 2, -1)

    def differing(sight):
        return (matrix(sight) != matrix(sight).T).sum()

    def southeast(sight):
        """Whether the pairs whose first cell is above and left of the second are asymmetric."""
        rows, cols, other_rows, other_cols = np.indices(sight.shape)
        chosen = (rows < other_rows) & (cols < other_cols)
        return (sight != sight.transpose(2, 3, 0, 1))[chosen]

    def pairs(sight):
        return len(sight) ** 2 * (len(sight) ** 2 - 1) / 2

    mistakes = {
        "Pairs of a cell with itself are in your count: there are n (n − 1) / 2 pairs of different "
        "cells, not n².": lambda s: differing(s) / s.size,
        "Yours is twice the share: the matrix shows each asymmetric pair twice, at [i, j] and at "
        "[j, i].": lambda s: differing(s) / pairs(s),
        "Yours is half the share or less: if you count each pair once, divide by the number of "
        "unordered pairs, n (n − 1) / 2.": lambda s: differing(s) / 2 / s.size,
        "Yours is half the share: if you count each pair once, divide by the unordered pairs, "
        "n (n − 1) / 2, not by the ordered ones.": lambda s: differing(s) / 4 / pairs(s),
        "Pairs of a cell with itself are in your count of pairs: n (n − 1) / 2, not n (n + 1) / "
        "2.": lambda s: differing(s) / 2 / (pairs(s) + len(s) ** 2),
        "That is the share of the symmetric pairs.": lambda s: 1 - _asymmetric_share(s),
        "That is the number of pairs: divide by the number of all pairs.": (
            lambda s: differing(s) / 2
        ),
        "That is the number of pairs, each counted twice: divide by the number of all pairs.": (
            differing
        ),
        "A share is between 0 and 1, not in percent.": lambda s: 100 * _asymmetric_share(s),
        ".T of an array with four axes reverses them all, so rows change places with columns. Only "
        "the two cells may: reshape to (n, n) first, or transpose(2, 3, 0, 1).": (
            lambda s: (s != s.T).sum() / 2 / pairs(s)
        ),
        "sight.T reverses all four axes, so rows change places with columns: reshape to (n, n) "
        "first. And leave the pairs of a cell with itself out of the count.": (
            lambda s: (s != s.T).mean()
        ),
        "You swap row and column within each cell: swap the two cells, transpose(2, 3, 0, 1).": (
            lambda s: (s != s.transpose(1, 0, 3, 2)).sum() / 2 / pairs(s)
        ),
        "You count one direction only: a pair is asymmetric too if the first cell does not see the "
        "second, but the second sees the first.": (
            lambda s: np.triu(matrix(s) & ~matrix(s).T).sum() / pairs(s)
        ),
        "You count one direction only: a pair is asymmetric too if the first cell sees the second, "
        "but the second does not see the first.": (
            lambda s: np.tril(matrix(s) & ~matrix(s).T).sum() / pairs(s)
        ),
        "You take only pairs of which one cell is above *and* to the left of the other. Number the "
        "cells, row · M + col, and take all with number 1 < number 2.": (
            lambda s: southeast(s).sum() / pairs(s)
        ),
        "You take only pairs of which one cell is above *and* to the left of the other, also to "
        "divide by: number the cells, and take all with number 1 < number 2.": (
            lambda s: southeast(s).mean()
        ),
    }
    buildings = stream(Use.EXERCISE, 3).random((7, 7)) < 0.25
    generator = stream(Use.EXERCISE, 7)
    one_way = np.ones((2, 2, 2, 2), bool)
    one_way[0, 1, 1, 0] = False  # one of 6 pairs
    lower = np.tril(np.ones((9, 9), bool)).reshape(3, 3, 3, 3)
    tables = [one_way, lower, line_of_sight(buildings, "bresenham"), line_of_sight(buildings)]
    tables += [generator.random((size,) * 4) < 0.5 for size in (2, 3, 4)]
    expect(
        np.ndim(answer(tables[3].copy())) == 0,
        "One number is expected, the share of the pairs; you give back an array.",
    )
    expect(
        close(answer(np.ones((3,) * 4, bool)), 0.0),
        "Where all cells see each other, no pair depends on the direction: the share is 0, and "
        "yours is not. Asked for is not what is seen, but what differs.",
    )

    def ask(sight):
        return answer(sight.copy())

    ask.__name__ = getattr(answer, "__name__", "your function")
    try:
        compare(ask, _asymmetric_share, [(table,) for table in tables], mistakes)
    except CheckFailed as failed:
        sight = next((one for one in tables if not close(ask(one), _asymmetric_share(one))), None)
        if "<array" not in str(failed) or not _asymmetric_share(sight):
            raise
        pair = np.argwhere(sight & ~sight.transpose(2, 3, 0, 1))[0].tolist()
        a, b = tuple(pair[:2]), tuple(pair[2:])
        raise CheckFailed(
            f"{failed} One of its asymmetric pairs: a device in {a} is seen from {b}, but a device "
            f"in {b} is not seen from {a}."
        ) from None
