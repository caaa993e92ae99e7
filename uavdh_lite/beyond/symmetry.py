"""The eight symmetries of the square: turned and mirrored maps are the same task.

A mission over a turned or mirrored city has the same best flight, turned or mirrored. A network
that has learned from all eight views of a map still answers a little differently in each. So an
agent may fly by the mean of its eight answers (Theile et al., arXiv 2403.12856).
"""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.agent import Agent
from uavdh_lite.environment import HOVER, LAND
from uavdh_lite.errors import InputError

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


def in_view(
    network: nn.Module, turns: int, mirrored: bool, map: Tensor, time: Tensor, *masks: Tensor
) -> Tensor:
    """What a network answers that is shown the turned map and masks, for the actions as they are on
    the map itself; (B, 6)."""
    action = turned_actions(turns, mirrored)
    masks = tuple(mask[:, np.argsort(action)] for mask in masks)
    return network(turned(map, turns, mirrored), time, *masks)[:, action]


class EightViews(nn.Module):
    """The mean of a network's answers in the eight views of its map; (B, 6)."""

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, *seen: Tensor) -> Tensor:
        views = [in_view(self.network, *symmetry, *seen) for symmetry in SYMMETRIES]
        return torch.stack(views).mean(dim=0)


def in_eight_views(agent: Agent) -> Agent:
    """The agent that flies by the mean over the eight views; it takes several times as long.

    Raises `InputError` for an agent that has not learned from all views.
    """
    if not getattr(agent.recipe, "all_views", False):
        raise InputError(f"an agent of the recipe {agent.recipe.name} has learned from one view")
    return replace(agent, network=EightViews(agent.network))
