"""The eight symmetries of the square: turned and mirrored maps are the same task.

A mission over a turned or mirrored city has the same best flight, turned or mirrored. A network
need not know that: the mean of its Q-values over the eight views does (equivariant ensembles,
Theile et al., IROS 2024).
"""

import torch
from torch import Tensor, nn

from uavdh_lite.environment import HOVER, LAND

SYMMETRIES = [(turns, mirrored) for mirrored in (False, True) for turns in range(4)]


def turned(maps: Tensor, turns: int, mirrored: bool) -> Tensor:
    """The maps, (..., W, W): mirrored left to right, then turned to the left by right angles."""
    maps = maps.flip(-1) if mirrored else maps
    return maps.rot90(turns, (-2, -1)).contiguous()


def turned_actions(turns: int, mirrored: bool) -> list[int]:
    """For each action, which one it is on the turned map.

    North, east, south and west have the numbers 0 to 3. A mirror swaps east and west; a turn to
    the left makes north of east, so it takes 1 from a number.
    """
    moves = (0, 3, 2, 1) if mirrored else (0, 1, 2, 3)
    return [*((move - turns) % 4 for move in moves), HOVER, LAND]


class EightViews(nn.Module):
    """The mean of a network's Q-values over the eight views: a network like any other.

    Arguments:
        network: takes the map first; it is asked once for each view.
    """

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, map: Tensor, *others: Tensor) -> Tensor:
        return self._mean(self.network, map, *others)

    def quantiles(self, map: Tensor, *others: Tensor) -> Tensor:
        """The mean quantiles of each action's return, (B, 6, N), if the network has some."""
        return self._mean(self.network.quantiles, map, *others)

    @staticmethod
    def _mean(values, map: Tensor, *others: Tensor) -> Tensor:
        views = [
            values(turned(map, *symmetry), *others)[:, turned_actions(*symmetry)]
            for symmetry in SYMMETRIES
        ]
        return torch.stack(views).mean(dim=0)
