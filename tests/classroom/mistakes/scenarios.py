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


def caught(city):
    """Breadth first; off the grid only an IndexError counts."""
    distance = np.where(city.landing, 0, -1)
    queue = [tuple(cell) for cell in np.argwhere(city.landing)]
    for row, col in queue:
        for down, right in FOUR:
            r, c = row + down, col + right
            try:
                if distance[r, c] < 0 and not city.no_fly[r, c]:
                    distance[r, c] = distance[row, col] + 1
                    queue.append((r, c))
            except IndexError:
                continue
    return distance


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


def painted(text, **cells):
    """The city with other signs in some cells: r0c3="L"."""
    rows = [list(row) for row in text.split()]
    for cell, sign in cells.items():
        row, col = cell[1:].split("c")
        rows[int(row)][int(col)] = sign
    return "\n".join("".join(row) for row in rows)


HOME = "\n".join("".join(".NbLB"[kind] for kind in row) for row in City.load("manhattan").kinds)
NOWHERE = HOME.replace("L", ".")
EMPTY = "\n".join(["." * 16] * 16)
ISLAND = painted(HOME, r14c0="N", r15c1="N")
# One landing cell and a wall below it, its gap at the far end: the ways are too long
LONG = painted(NOWHERE, r0c0="L", **{f"r2c{c}": "N" for c in (0, 1, 4, 7, 8, 11, 14)})

MISTAKES = {
    "reachable": [
        (lambda city: flooded(city, city.no_fly, EIGHT), "diagonally"),
        (lambda city: flooded(city, city.no_fly & False, FOUR), "No-fly cells.* have −1"),
        (lambda city: flooded(city, city.no_fly | city.buildings, FOUR), "Low buildings"),
        (
            lambda city: flooded(city, city.no_fly, FOUR, check=False),
            "off the grid there is nothing",
        ),
        (caught, "without an IndexError"),
        (marked(0), "have −1"),
        (marked(99), "have −1"),
        (depth_first, "The shortest way counts"),
        (lambda city: city.landing_distance, "write the search yourself"),
        (lambda city: flooded(city, city.no_fly, FOUR).ravel(), r"has the shape \(4,\)"),
        (lambda city: flooded(city, city.no_fly, FOUR) * 1.0, "make it an array of ints"),
    ],
    "defeat": [
        (HOME, "The agent is too good.*cells changed: 0.* points behind"),
        ("", "put an L"),
        (HOME[:-17], "of 16×16 cells: 15 rows, but row 0 has 16"),
        (HOME.replace("LL", "LLL", 1), "of 16×16 cells: 16 rows, but row 0 has 17"),
        (NOWHERE, "put an L"),
        (painted(HOME, r4c4="X"), "no valid city of .*: row 4, column 4: 'X' is none of"),
        (painted(EMPTY, r0c0="L"), r"in \d+ of its 256 cells; at most 16"),
        (ISLAND, r"from 1 of the cells .* from \[\[15, 0\]\]"),
        (LONG, "The greedy planner's CRAL is"),
        ("L .\n. .", "has 2 rows and columns; it must have 16"),
        (City.load("manhattan"), "as one text"),
    ],
}
