"""The eight symmetries of the square: turned and mirrored maps are the same task.

A mission over a turned or mirrored city has the same best flight, turned or mirrored. A network
need not know that: the mean of its Q-values over the eight views does (equivariant ensembles,
Theile et al., IROS 2024).
"""

from collections.abc import Callable

import torch
from torch import Tensor

from uavdh_lite.city import Cities, City, as_cities
from uavdh_lite.environment import HOVER, LAND

SYMMETRIES = [(turns, mirrored) for mirrored in (False, True) for turns in range(4)]


def turned(maps: Tensor, turns: int, mirrored: bool) -> Tensor:
    """The maps, (..., W, W): mirrored left to right, then turned to the left by right angles."""
    maps = maps.flip(-1) if mirrored else maps
    return maps.rot90(turns, (-2, -1)).contiguous()


def turned_cities(city: City | Cities) -> Cities:
    """The city or cities as they are, and after them their seven other views."""
    cities = list(as_cities(city).cities)
    for turns in range(4):
        for mirrored in (False, True):
            if turns or mirrored:
                view = f"turned_{turns}" + "_mirrored" * mirrored
                for one in as_cities(city).cities:
                    kinds = turned(torch.tensor(one.kinds), turns, mirrored).numpy()
                    cities.append(City.from_kinds(f"{one.name}_{view}", kinds))
    return Cities(tuple(cities))


def turned_actions(turns: int, mirrored: bool) -> list[int]:
    """For each action, which one it is on the turned map.

    North, east, south and west have the numbers 0 to 3. A mirror swaps east and west; a turn to
    the left makes north of east, so it takes 1 from a number.
    """
    moves = (0, 3, 2, 1) if mirrored else (0, 1, 2, 3)
    return [*((move - turns) % 4 for move in moves), HOVER, LAND]


def mean_over_symmetries(q_values: Callable[[Tensor], Tensor], maps: Tensor) -> Tensor:
    """The mean Q-values of the actions over the eight views of the maps; (B, 6).

    Arguments:
        q_values: gives Q-values, (B, 6), for maps, (B, C, W, W); or quantiles of the return,
            (B, 6, N), and their means are returned.
        maps: (B, C, W, W), with an odd W if they are centred on a cell.
    """
    views = [
        q_values(turned(maps, *symmetry))[:, turned_actions(*symmetry)] for symmetry in SYMMETRIES
    ]
    return torch.stack(views).mean(dim=0)
