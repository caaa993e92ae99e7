from itertools import product

import numpy as np
import pytest
from reference import reference_line_of_sight

from uavdh_lite.shadowing import line_of_sight

CITIES = [(1, 0.0), (2, 0.5), (3, 0.2), (5, 0.3), (8, 0.6), (9, 0.25)]


def grid(text):
    return np.array([[sign == "#" for sign in line] for line in text.split()])


def random_buildings(size, density, seed):
    return np.random.default_rng(seed).random((size, size)) < density


@pytest.mark.parametrize("size, density", CITIES)
def test_exact_equals_rational_arithmetic_for_every_pair_and_is_symmetric(size, density):
    buildings = random_buildings(size, density, seed=size)
    sight = line_of_sight(buildings)
    assert sight.shape == (size,) * 4 and sight.dtype == bool
    assert np.array_equal(sight, sight.transpose(2, 3, 0, 1))
    walls = buildings.tolist()
    for a, b, c, d in product(range(size), repeat=4):
        assert sight[a, b, c, d] == reference_line_of_sight(walls, (a, b), (c, d)), (a, b, c, d)


@pytest.mark.parametrize("density", [0.02, 0.1])
def test_exact_equals_rational_arithmetic_for_long_segments(density):
    buildings = random_buildings(30, density, seed=1)
    sight, walls = line_of_sight(buildings), buildings.tolist()
    pairs = np.random.default_rng(2).integers(0, 30, (1000, 4)).tolist()
    seen = [reference_line_of_sight(walls, (a, b), (c, d)) for a, b, c, d in pairs]
    assert 50 < sum(seen) < 950
    assert [bool(sight[tuple(pair)]) for pair in pairs] == seen


@pytest.mark.parametrize(
    "text, device, uav, seen",
    [
        ("... .#. ...", (0, 0), (0, 0), True),  # a cell sees itself
        ("... .#. ...", (1, 1), (1, 1), False),  # a building sees nothing
        (".#. ... ...", (0, 0), (2, 2), True),  # touching a corner
        (".#. #.. ...", (0, 0), (1, 1), False),  # no gap between two diagonal buildings
        (".... .#.. .... ....", (0, 0), (3, 3), False),  # on the diagonal
        (".... .#.. #... ....", (0, 0), (3, 1), False),  # through the corner in the middle
        (".#. ... ...", (0, 0), (1, 2), False),  # through the edge between two cells
        ("#### .... #### ....", (1, 0), (1, 3), True),  # along a wall
        ("#..# .... .... #..#", (0, 1), (0, 2), True),  # beyond the end
    ],
)
def test_limit_cases_by_hand(text, device, uav, seen):
    """Both ways, and turned by a right angle; the reference agrees."""
    walls = grid(text)
    sight, turned = line_of_sight(walls), line_of_sight(walls.T)
    assert sight[device + uav] == sight[uav + device] == seen
    assert turned[device[::-1] + uav[::-1]] == seen
    assert reference_line_of_sight(walls, device, uav) == seen
