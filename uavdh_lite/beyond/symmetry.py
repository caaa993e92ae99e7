"""The eight symmetries of the square: turned and mirrored maps are the same task.

A mission over a turned or mirrored city has the same best flight, turned or mirrored.
"""

from torch import Tensor

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
