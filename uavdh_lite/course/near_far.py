"""Pairs of places, near or far, for the three networks of notebook 5."""

import numpy as np
import torch
from torch import Tensor

from uavdh_lite.streams import Use, stream

SIDE = 16  # cells of the city


def near_pairs(count: int = 8000, reach: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    """Places of a UAV and a device: is the device near? The first half of them are.

    Arguments:
        reach: near means that row and column differ by no more than this.

    Returns: the maps in place, (count, 2, 16, 16), a 1 at the device and in another layer a 1 at
        the UAV; the centred maps, (count, 1, 31, 31), a 1 where the device is, seen from the UAV in
        the middle; the answers, (count,), +1 for near and −1 for far.
    """
    uav, device = stream(Use.EXERCISE).integers(SIDE, size=(2, 5 * count, 2))
    near = abs(uav - device).max(axis=1) <= reach
    half = count // 2
    pairs = np.r_[np.flatnonzero(near)[:half], np.flatnonzero(~near)[:half]]
    uav, device = uav[pairs], device[pairs]
    in_place = _maps(device, uav, side=SIDE)
    centred = _maps(device - uav + SIDE - 1, side=2 * SIDE - 1)
    return in_place, centred, torch.tensor(2.0 * near[pairs] - 1)


def _maps(*places: np.ndarray, side: int) -> Tensor:
    """A layer for each array of places, (count, 2), with a single 1 in each map."""
    maps = torch.zeros(len(places[0]), len(places), side, side)
    for layer, cells in enumerate(places):
        maps[torch.arange(len(cells)), layer, cells[:, 0], cells[:, 1]] = 1
    return maps
