from itertools import product

import numpy as np
import pytest
from reference import ray, reference_bresenham, reference_line_of_sight

from uavdh_lite.errors import InputError
from uavdh_lite.shadowing import line_of_sight


def grid(text):
    return np.array([[sign == "#" for sign in line] for line in text.split()])


def random_buildings(size, density, seed):
    return np.random.default_rng(seed).random((size, size)) < density


CITIES = [(1, 0.0), (2, 0.5), (3, 0.2), (5, 0.3), (7, 0.1), (8, 0.6), (10, 0.05), (11, 0.25)]


@pytest.mark.parametrize("size, density", CITIES)
def test_exact_equals_rational_arithmetic_for_every_pair(size, density):
    buildings = random_buildings(size, density, seed=size)
    sight = line_of_sight(buildings)
    assert sight.shape == (size,) * 4 and sight.dtype == bool
    walls = buildings.tolist()
    for a, b, c, d in product(range(size), repeat=4):
        assert sight[a, b, c, d] == reference_line_of_sight(walls, (a, b), (c, d)), (a, b, c, d)


@pytest.mark.parametrize("density", [0.02, 0.05, 0.1])
def test_exact_equals_rational_arithmetic_for_long_segments(density):
    size = 30
    buildings = random_buildings(size, density, seed=1)
    sight = line_of_sight(buildings)
    walls = buildings.tolist()
    pairs = np.random.default_rng(2).integers(0, size, (1000, 4)).tolist()
    seen = [reference_line_of_sight(walls, (a, b), (c, d)) for a, b, c, d in pairs]
    assert 50 < sum(seen) < 950
    assert [bool(sight[tuple(pair)]) for pair in pairs] == seen


@pytest.mark.parametrize("size, density", CITIES)
def test_exact_is_symmetric(size, density):
    sight = line_of_sight(random_buildings(size, density, seed=100 + size))
    assert (sight == sight.transpose(2, 3, 0, 1)).all()


def test_without_buildings_all_cells_see_each_other():
    for method in ("exact", "bresenham"):
        assert line_of_sight(np.zeros((6, 6), bool), method).all()


def test_a_cell_sees_itself_unless_it_is_a_building_which_sees_nothing():
    sight = line_of_sight(grid("... .#. ..."))
    assert sight[0, 0, 0, 0] and not sight[1, 1].any() and not sight[:, :, 1, 1].any()


def both(buildings, first, second):
    """Line of sight both ways, which must agree with each other and the reference."""
    sight = line_of_sight(buildings)
    answer = reference_line_of_sight(buildings, first, second)
    assert sight[first + second] == sight[second + first] == answer
    return answer


@pytest.mark.parametrize("text", [".#. ... ...", "... #.. ...", ".#. ..# ..."])
def test_touching_a_corner_does_not_block(text):
    assert both(grid(text), (0, 0), (1, 1))
    assert both(grid(text), (0, 0), (2, 2))


def test_two_diagonal_buildings_leave_no_gap_at_their_corner():
    gap = grid(".#.. #... .... ....")
    assert not both(gap, (0, 0), (1, 1)) and not both(gap, (0, 0), (3, 3))
    assert not both(gap[:, ::-1], (0, 3), (3, 0))
    assert both(grid(".#.. ..#. .... ...."), (0, 0), (3, 3))  # at two corners, on two sides


def test_a_building_on_the_diagonal_blocks():
    assert not both(grid(".... .#.. .... ...."), (0, 0), (3, 3))


def test_the_corner_in_the_middle_of_a_slanted_segment():
    # from (0, 0) to (3, 1) the segment passes through the corner of the four cells in the middle
    assert not both(grid(".... .#.. #... ...."), (0, 0), (3, 1))
    assert both(grid(".... .#.. .... ...."), (0, 0), (3, 1))
    assert not both(grid(".... #... .... ...."), (0, 0), (3, 1))
    assert not both(grid(".... .... .#.. ...."), (0, 0), (3, 1))


def test_a_segment_through_the_edge_between_two_cells_is_blocked_by_either():
    assert not both(grid(".#. ... ..."), (0, 0), (1, 2))
    assert not both(grid("... .#. ..."), (0, 0), (1, 2))
    assert both(grid("..# #.. ###"), (0, 0), (1, 2))


def test_a_straight_line_along_a_wall_does_not_block():
    walls = grid("##### ..... ##### ..... .....")
    assert both(walls, (1, 0), (1, 4))
    assert both(walls, (3, 0), (3, 4))
    assert both(walls.T, (0, 1), (4, 1))
    assert not both(walls, (1, 0), (3, 0))


def test_a_building_beyond_the_end_of_the_segment_does_not_block():
    walls = grid("#...# ..... ..... ..... #...#")
    assert both(walls, (0, 1), (0, 3))
    assert both(walls, (1, 1), (3, 3))
    assert not both(walls, (0, 1), (0, 4))


def test_a_ray_of_the_fan_by_hand():
    assert ray((0, 0), (0, 2)) == [(0, 0), (0, 1), (0, 2)]
    assert ray((2, 1), (0, 1)) == [(2, 1), (1, 1), (0, 1)]
    # err = 0: 2·0 + 1 > 1 − 2·0 is false, so the row advances; then err = 1 and the column does
    assert ray((0, 0), (1, 1)) == [(0, 0), (1, 0), (1, 1)]
    assert ray((1, 1), (0, 0)) == [(1, 1), (0, 1), (0, 0)]


@pytest.mark.parametrize("size, density", [*CITIES, (12, 0.15)])
def test_bresenham_equals_a_slow_fan_of_rays(size, density):
    buildings = random_buildings(size, density, seed=200 + size)
    sight = line_of_sight(buildings, "bresenham")
    assert sight.shape == (size,) * 4 and sight.dtype == bool
    walls = buildings.tolist()
    for device in product(range(size), repeat=2):
        seen = set(map(tuple, np.argwhere(sight[device]).tolist()))
        assert seen == reference_bresenham(walls, device), device


def test_bresenham_is_not_symmetric():
    # the ray between the corners goes by the lower left one way, by the upper right the other
    sight = line_of_sight(grid(".# .."), "bresenham")
    assert sight[0, 0, 1, 1] and not sight[1, 1, 0, 0]
    exact = line_of_sight(grid(".# .."))
    assert exact[0, 0, 1, 1] and exact[1, 1, 0, 0]


def test_unknown_method_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"guess.*exact.*bresenham"):
        line_of_sight(np.zeros((3, 3), bool), "guess")


@pytest.mark.parametrize("shape", [(3, 4), (4, 3), (9,), (2, 2, 3)])
def test_an_array_that_is_not_square_is_refused(shape):
    with pytest.raises(InputError, match="square"):
        line_of_sight(np.zeros(shape, bool))


@pytest.mark.parametrize("method", ["exact", "bresenham"])
def test_several_cities_at_once_are_as_each_alone(method, generator):
    buildings = generator.random((2, 3, 6, 6)) < 0.3
    sight = line_of_sight(buildings, method)
    assert sight.shape == (2, 3, 6, 6, 6, 6)
    for index in np.ndindex(2, 3):
        assert np.array_equal(sight[index], line_of_sight(buildings[index], method))
