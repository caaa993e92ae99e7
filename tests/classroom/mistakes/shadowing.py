"""Wrong answers to the exercises of notebook 2, and what the message must say of each."""

from itertools import pairwise, product

import numpy as np

from uavdh_lite.shadowing import crossed_cells


def inside(start, end, cell):
    return all(min(a, b) <= x <= max(a, b) for a, b, x in zip(start, end, cell, strict=True))


def doubled_distance(start, end, cell):
    rows, cols = end[0] - start[0], end[1] - start[1]
    return 2 * abs(rows * (cell[1] - start[1]) - cols * (cell[0] - start[0])), abs(rows) + abs(cols)


def touching(start, end, cell):
    distance, limit = doubled_distance(start, end, cell)
    return inside(start, end, cell) and distance <= limit


def without_factor(start, end, cell):
    distance, limit = doubled_distance(start, end, cell)
    return cell == start if start == end else inside(start, end, cell) and distance < 2 * limit


def sum_of_signs(start, end, cell):
    distance, _ = doubled_distance(start, end, cell)
    limit = abs(sum(end) - sum(start))
    return cell == start if start == end else inside(start, end, cell) and distance < limit


def down_right(start, end, cell):
    (rows, cols), (r, c) = np.subtract(end, start), np.subtract(cell, start)
    near = 2 * abs(rows * c - cols * r) < abs(rows) + abs(cols) or start == end
    return bool(0 <= r <= rows and 0 <= c <= cols and near)


def not_shifted(start, end, cell):
    (rows, cols), (r, c) = np.subtract(end, start), cell
    near = 2 * abs(rows * c - cols * r) < abs(rows) + abs(cols)
    return cell == start if start == end else bool(inside(start, end, cell) and near)


def infinite(start, end, cell):
    if start == end:
        return cell == start
    distance, limit = doubled_distance(start, end, cell)
    return distance < limit


def no_single_point(start, end, cell):
    distance, limit = doubled_distance(start, end, cell)
    return inside(start, end, cell) and distance < limit


def sampled(start, end, cell):
    share = np.linspace(0, 1, 200)
    rows = np.rint(start[0] + share * (end[0] - start[0]))
    cols = np.rint(start[1] + share * (end[1] - start[1]))
    return bool(((rows == cell[0]) & (cols == cell[1])).any())


def slope(start, end, cell):
    steepness = (end[0] - start[0]) / (end[1] - start[1])
    return abs(cell[0] - start[0] - steepness * (cell[1] - start[1])) < 0.5


def south_east_only(start, end, cell):
    if start == end:
        return cell == start
    distance, limit = doubled_distance(start, end, cell)
    ordered = start[0] <= cell[0] <= end[0] or start[0] >= cell[0] >= end[0]
    return ordered and start[1] <= cell[1] <= end[1] and distance < limit


def shadow(buildings, device, corners="both", ends=True, moved=True):
    result = np.zeros_like(buildings)
    for row, col in np.ndindex(buildings.shape):
        rows, cols = row - device[0], col - device[1]
        cells = [tuple(cell) for cell in crossed_cells(rows, cols).tolist()]
        if moved:
            cells = [(r + device[0], c + device[1]) for r, c in cells]
        looked_at = [c for c in cells if ends or c not in ((row, col), tuple(device))]
        result[row, col] = any(buildings[cell] for cell in looked_at)
        pairs = pairwise(cells) if corners == "sorted" else product(cells, cells)
        for a, b in pairs if corners != "45°" or abs(rows) == abs(cols) else ():
            if abs(a[0] - b[0]) == 1 and abs(a[1] - b[1]) == 1 and corners:
                beside = [buildings[a[0], b[1]], buildings[b[0], a[1]]]
                result[row, col] |= any(beside) if corners == "any" else all(beside)
    return result


def shifted_device(buildings, device):
    result = shadow(buildings, device)
    result[device] = True
    return result


def loses_buildings(buildings, device):
    result = shadow(buildings, device)
    buildings |= result
    return result


def square(sight):
    return sight.reshape(len(sight) ** 2, -1)


def in_16_bits(sight):
    both = (square(sight) != square(sight).T).sum(dtype=np.uint16)
    return both / (len(sight) ** 2 * (len(sight) ** 2 - 1))


def different(sight):
    return (square(sight) != square(sight).T).sum()


def one_way(sight, ordered):
    cells = [divmod(k, len(sight)) for k in range(len(sight) ** 2)]
    pairs = [(a, b) for a, b in product(cells, cells) if ordered(a, b)]
    return sum(sight[a + b] and not sight[b + a] for a, b in pairs) / len(pairs)


def south_east(sight):
    count = 0
    for i, j, k, m in np.ndindex(sight.shape):
        count += i < k and j < m and sight[i, j, k, m] != sight[k, m, i, j]
    return count / (len(sight) ** 2 * (len(sight) ** 2 - 1) / 2)


def half_its_length(start, end, cell):
    (rows, cols), (r, c) = (np.subtract(one, start).tolist() for one in (end, cell))
    inside = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    length = np.hypot(rows, cols)
    return inside and bool(length == 0 or abs(rows * c - cols * r) / length < 0.5)


def row_in_the_middle(start, end, cell):
    (rows, cols), (r, c) = (np.subtract(one, start).tolist() for one in (end, cell))
    inside = min(rows, 0) <= r <= max(rows, 0) and min(cols, 0) <= c <= max(cols, 0)
    return inside and (cols == 0 or abs(c * rows / cols - r) < 0.5)


MISTAKES = {
    "crosses": [
        (touching, "only touches a cell at a corner"),
        (without_factor, "forget the factor 2"),
        (sum_of_signs, "is not .R. . .C."),
        (down_right, "A ray may go up or left|through the middle of each"),
        (not_shifted, "Measure rows and columns from start"),
        (infinite, "beyond an end of the segment"),
        (half_its_length, "No other distance will do"),
        (row_in_the_middle, "No other distance will do"),
        (sampled, "sampled along the ray step over|interior"),
        (inside, "Not all cells of the rectangle"),
        (slope, "stops with ZeroDivision.*no slope"),
        (no_single_point, "both ends are the same point"),
        (south_east_only, "A ray may go up or left|through the middle of each"),
        (lambda start, end, cell: crossed_cells(1, 1), "one truth value"),
    ],
    "shadow_map": [
        (lambda b, d: shadow(b, d).T, "Rows and columns are swapped"),
        (lambda b, d: ~shadow(b, d), "where there is no line of sight"),
        (
            lambda b, d: shadow(b, d, corners=""),
            "corner that two diagonally adjacent buildings share is hidden",
        ),
        (lambda b, d: shadow(b, d, corners="45°"), "rays of any slope"),
        (lambda b, d: shadow(b, d, corners="sorted"), "not sorted along the ray"),
        (lambda b, d: shadow(b, d, corners="any"), "it takes both"),
        (lambda b, d: shadow(b, d, ends=False), "a UAV over a building is hidden, too"),
        (shifted_device, "nor is the device's own cell"),
        (lambda b, d: shadow(b, d, corners="", moved=False), r"counts from \(0, 0\)"),
        (lambda b, d: shadow(b, d).astype(int), "array of Booleans"),
        (lambda b, d: shadow(b, d).ravel(), "has the shape"),
        (loses_buildings, "changes what it is given"),
        (lambda b, d: np.zeros_like(b), "is hidden: the ray crosses the building"),
    ],
    "asymmetric_share": [
        (lambda s: (square(s) != square(s).T).mean(), "with itself"),
        (
            lambda s: different(s) / (len(s) ** 2 * (len(s) ** 2 - 1) / 2),
            "each asymmetric pair twice",
        ),
        (lambda s: np.triu(square(s) != square(s).T).mean(), "by the number of all pairs"),
        (lambda s: (s != s.T).sum() / (len(s) ** 2 * (len(s) ** 2 - 1)), "reverses them all"),
        (lambda s: (s != s.T).mean(), "reverses them all"),
        (lambda s: square(s) != square(s).T, "one number is expected"),
        (lambda s: different(s) // 2, "by the number of all pairs"),
        (lambda s: one_way(s, lambda i, j: i < j), "exactly one of its two directions"),
        (lambda s: one_way(s, lambda i, j: i > j), "exactly one of its two directions"),
        (south_east, "exactly one of its two directions"),
        (lambda s: s.mean(), "whether they are seen or blocked"),
        (lambda s: different(s) / len(s) ** 3, "expected"),
        (in_16_bits, "16 bits"),
    ],
}
