"""Pairs of places, near or far, for the three networks of notebook 5."""

import numpy as np
import torch
from torch import Tensor

from uavdh_lite.streams import Use, stream

SIDE = 16  # cells of the city
REACH = 3  # near means that row and column differ by no more than this
HALF = 4000  # pairs that are near, and as many that are far


def near_pairs() -> tuple[Tensor, Tensor, Tensor]:
    """8000 places of a UAV and a device: is the device near? The first half of them are.

    Returns: the maps in place, (8000, 2, 16, 16), a 1 at the device and in another layer a 1 at
        the UAV; the centred maps, (8000, 1, 31, 31), a 1 where the device is, seen from the UAV in
        the middle; the answers, (8000,), +1 for near and −1 for far.
    """
    uav, device = stream(Use.EXERCISE).integers(SIDE, size=(2, 10 * HALF, 2))
    near = abs(uav - device).max(axis=1) <= REACH
    pairs = np.r_[np.flatnonzero(near)[:HALF], np.flatnonzero(~near)[:HALF]]
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
