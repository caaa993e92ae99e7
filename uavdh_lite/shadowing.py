"""Shadow maps: which pairs of cells see each other, and which have a building between them."""

import math

import numpy as np


def line_of_sight(buildings: np.ndarray) -> np.ndarray:
    """Line of sight between all pairs of cells, exact and symmetric.

    It is blocked if the straight segment between the two cell centres crosses the open interior of
    a building cell, or passes exactly between two diagonal buildings through their shared corner.
    Otherwise touching a corner or an edge does not block.

    Arguments:
        buildings: (..., M, M) bool, the cells that block links, of any number of cities.

    Returns: (..., M, M, M, M) bool, `[..., device_row, device_col, uav_row, uav_col]`, True for
        line of sight (LoS), False for non-line of sight (NLoS). A cell that is a building sees
        nothing.
    """
    buildings = np.asarray(buildings, bool)
    *several, size, _ = buildings.shape
    # Only a pair's displacement decides which cells a ray meets. So all pairs with one displacement
    # are computed together, in all cities, which are the last axis here.
    cities = np.ascontiguousarray(np.moveaxis(buildings.reshape(-1, size, size), 0, -1))
    sight = np.empty((size, size, size, size, cities.shape[-1]), bool)
    cells = np.arange(size)
    for rows in range(size):
        for cols in range(-size + 1, size):
            # The cells from which such a ray ends in the city are a rectangle
            height, width, left = size - rows, size - abs(cols), max(-cols, 0)
            blocked = np.zeros((height, width, cities.shape[-1]), bool)
            for row, col in crossed_cells(rows, cols):
                blocked |= cities[row : row + height, left + col : left + col + width]
            for corner in passed_corners(rows, cols):
                first, second = (
                    cities[row : row + height, left + col : left + col + width]
                    for row, col in corner
                )
                blocked |= first & second
            r, c = cells[:height, None], cells[None, left : left + width]
            sight[r, c, r + rows, c + cols] = ~blocked
            sight[r + rows, c + cols, r, c] = ~blocked
    return np.moveaxis(sight, -1, 0).reshape(*several, *(size,) * 4)


def crossed_cells(rows: int, cols: int) -> np.ndarray:
    """The cells whose open interior the segment from (0, 0) to (rows, cols) crosses; (n, 2) ints.

    The segment and the open unit square around (r, c) are convex, so they are disjoint exactly if a
    line separates them: one along the rows, along the columns, or along the segment. The first two
    leave the cells of the segment's bounding box. The third separates them if the square's centre
    is at least half the square's width away from the segment's line, the width as seen along it:
    |rows·c − cols·r| ≥ (|rows| + |cols|) / 2. All of it is integer arithmetic, so it is exact.
    """
    r = np.arange(min(rows, 0), max(rows, 0) + 1)[:, None]
    c = np.arange(min(cols, 0), max(cols, 0) + 1)[None, :]
    crossed = 2 * np.abs(rows * c - cols * r) < max(abs(rows) + abs(cols), 1)
    return np.argwhere(crossed) + np.array([r[0, 0], c[0, 0]])


def passed_corners(rows: int, cols: int) -> np.ndarray:
    """The pairs of cells between which the segment passes through a corner; (n, 2, 2) ints.

    At such a corner the segment from (0, 0) to (rows, cols) leaves one cell and enters the one
    diagonally opposite; the pair is the other two of the four cells there. Let g be the greatest
    common divisor of rows and cols. There are g such corners if rows / g and cols / g are both odd,
    and none otherwise.
    """
    common = max(math.gcd(rows, cols), 1)
    step = np.array([rows, cols]) // common
    if not (step % 2 == 1).all():
        return np.empty((0, 2, 2), int)
    corners = (2 * np.arange(common) + 1)[:, None, None] * step  # doubled, to be whole numbers
    aside = np.sign(step) * np.array([(1, -1), (-1, 1)])
    return (corners + aside) // 2
