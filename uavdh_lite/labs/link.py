"""The link between a device and a hovering UAV, in all its parts, for the channel lab."""

from dataclasses import dataclass

import numpy as np

from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import City
from uavdh_lite.shadowing import crossed_cells, passed_corners


@dataclass(frozen=True)
class Link:
    """The channel between a device and a UAV that hovers over a cell, without fading.

    | field | meaning |
    | --- | --- |
    | `ground_m`, `distance_m` | distance on the ground and through the air, m |
    | `crossed` | (n, 2), the cells that the ray crosses, starting at the device |
    | `blocked_by` | (m, 2), the buildings that block it: the link is NLoS if there are any |
    | `snr_db`, `rate` | mean SNR, dB, and data units a slot at it |
    | `fading_db` | standard deviation of the shadow fading, dB |
    """

    ground_m: float
    distance_m: float
    crossed: np.ndarray
    blocked_by: np.ndarray
    snr_db: float
    rate: float
    fading_db: float

    @property
    def line_of_sight(self) -> bool:
        return len(self.blocked_by) == 0


def link(city: City, channel: Channel, device: tuple[int, int], uav: tuple[int, int]) -> Link:
    """The link between a device and a UAV in these cells, each (row, column)."""
    rows, cols = uav[0] - device[0], uav[1] - device[1]
    crossed = crossed_cells(rows, cols) + np.array(device)
    corners = passed_corners(rows, cols) + np.array(device)
    closed = city.buildings[corners[..., 0], corners[..., 1]].all(axis=1)
    blocked_by = crossed[city.buildings[crossed[:, 0], crossed[:, 1]]]
    blocked_by = np.concatenate([blocked_by, corners[closed].reshape(-1, 2)])
    ground_m = float(np.hypot(uav[0] - device[0], uav[1] - device[1])) * channel.cell_size_m
    distance_m = float(np.hypot(ground_m, channel.altitude_m))
    sight = len(blocked_by) == 0
    snr_db = float(
        np.float32(channel.transmit_snr_db(city.own_size))
        - channel.path_loss_db(np.float32(distance_m**2), sight)
    )
    return Link(
        ground_m,
        distance_m,
        crossed,
        blocked_by,
        snr_db,
        float(rate(snr_db)),
        float(channel.fading_db(1.0, sight)),
    )
