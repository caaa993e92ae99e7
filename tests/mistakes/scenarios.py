"""Wrong answers to the exercises of notebook 9, and what the message must say of each."""

import numpy as np

from uavdh_lite.city import City


def flooded(city, closed, moves, check=True):
    """Distances by repeated sweeps, with choices that a student may get wrong."""
    size = city.size
    big = 10**6
    distance = np.where(city.landing, 0, big)
    for _ in range(size * size):
        before = distance.copy()
        for row in range(size):
            for col in range(size):
                if closed[row, col]:
                    continue
                for down, right in moves:
                    r, c = row + down, col + right
                    if check and not (0 <= r < size and 0 <= c < size):
                        continue
                    r, c = r % size, c % size
                    distance[row, col] = min(distance[row, col], distance[r, c] + 1)
        if (before == distance).all():
            break
    return np.where(distance >= big, -1, distance)


FOUR = [(-1, 0), (1, 0), (0, -1), (0, 1)]
EIGHT = [*FOUR, (-1, -1), (-1, 1), (1, -1), (1, 1)]


def depth_first(city):
    distance = np.where(city.landing, 0, -1)
    stack = [tuple(cell) for cell in np.argwhere(city.landing)]
    while stack:
        row, col = stack.pop()
        for down, right in FOUR:
            r, c = row + down, col + right
            inside = 0 <= r < city.size and 0 <= c < city.size
            if inside and not city.no_fly[r, c] and distance[r, c] < 0:
                distance[r, c] = distance[row, col] + 1
                stack.append((r, c))
    return distance


def marked(value):
    def reachable(city):
        distance = flooded(city, city.no_fly, FOUR)
        return np.where(distance < 0, value, distance)

    return reachable


def drawn(size, **cells):
    """A city of free cells, with other signs in some: r0c3="L"."""
    rows = [["."] * size for _ in range(size)]
    for cell, sign in cells.items():
        row, col = cell[1:].split("c")
        rows[int(row)][int(col)] = sign
    return "\n".join("".join(row) for row in rows)


HOME = "\n".join("".join(".NbLB"[kind] for kind in row) for row in City.load("manhattan").kinds)
ISLAND = drawn(16, r0c0="L", r5c4="N", r5c6="N", r4c5="N", r6c5="N")
# A wall between the landing zone and the city, its gap at the far end: the ways are too long
LONG = drawn(16, r0c0="L", **{f"r1c{c}": "B" for c in range(15)})

MISTAKES = {
    "reachable": [
        (lambda city: flooded(city, city.no_fly, EIGHT), "diagonally"),
        (lambda city: flooded(city, city.no_fly & False, FOUR), "through no-fly cells"),
        (lambda city: flooded(city, city.no_fly | city.buildings, FOUR), "Low buildings"),
        (lambda city: flooded(city, city.no_fly, FOUR, check=False), "joined at its edges"),
        (marked(0), "as if they were landing zone"),
        (marked(99), "must have −1; you give 99"),
        (depth_first, "There is a shorter way"),
        (lambda city: city.landing_distance, "write the search yourself"),
        (lambda city: flooded(city, city.no_fly, FOUR).ravel(), r"the shape \(36,\)"),
        (lambda city: flooded(city, city.no_fly, FOUR) * 1.0, "make it an int array"),
    ],
    "defeat": [
        (HOME, "The agent is too good: .* points behind"),
        (drawn(8, r0c0="L"), "8 × 8 cells"),
        (drawn(16), "no valid city.*no start and landing zone"),
        (drawn(16, r0c0="X"), "no valid city.*'X' is none of"),
        (ISLAND, "from 1 of the cells .* row 5, column 5"),
        (LONG, "planner collects .* points less"),
        (City.load("manhattan"), "as one text"),
    ],
}
