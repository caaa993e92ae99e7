"""The shadow maps of the authors' code: fans of Bresenham's lines. Notebook 13 compares them."""

import numpy as np


def bresenham_fans(buildings: np.ndarray) -> np.ndarray:
    """Line of sight as `line_of_sight` gives it, but by fans of lines: not exact, not symmetric.

    A line from each cell to every border cell sees all that it meets before a building. All lines
    advance together, one step along the row or the column at a time.

    Arguments:
        buildings: (M, M) bool.

    Returns: (M, M, M, M) bool, `[device_row, device_col, uav_row, uav_col]`.
    """
    size = len(buildings)
    row, col = np.divmod(np.arange(size**2), size)
    border = np.flatnonzero((np.minimum(row, col) == 0) | (np.maximum(row, col) == size - 1))
    start, goal = (a.ravel() for a in np.meshgrid(np.arange(size**2), border, indexing="ij"))
    row, col = start // size, start % size
    goal_row, goal_col = goal // size, goal % size
    row_step, col_step = np.sign(goal_row - row), np.sign(goal_col - col)
    col_distance, row_distance = np.abs(goal_col - col), -np.abs(goal_row - row)
    error = col_distance + row_distance
    sight = np.zeros((size**2, size**2), bool)
    blocked = buildings.ravel()
    while True:
        here = row * size + col
        ahead = ~blocked[here]
        sight[start[ahead], here[ahead]] = True
        ahead &= here != goal
        if not ahead.any():
            return sight.reshape((size,) * 4)
        start, goal, row, col, row_step, col_step, col_distance, row_distance, error = (
            a[ahead]
            for a in (start, goal, row, col, row_step, col_step, col_distance, row_distance, error)
        )
        along_row = 2 * error - row_distance > col_distance - 2 * error
        col = col + np.where(along_row, col_step, 0)
        row = row + np.where(along_row, 0, row_step)
        error = error + np.where(along_row, row_distance, col_distance)
