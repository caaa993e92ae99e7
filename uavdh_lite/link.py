"""One radio link between a device and a hovering UAV, with all its numbers."""

from dataclasses import dataclass

import numpy as np

from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import City
from uavdh_lite.shadowing import crossed_cells, passed_corners


@dataclass(frozen=True)
class Link:
    """What the channel says about a device and a UAV that hovers over a cell, without fading.

    | field | meaning |
    | --- | --- |
    | `ground_m`, `distance_m` | distance on the ground and through the air, m |
    | `crossed` | (n, 2), the cells that the ray crosses, from the device on |
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
    """The link between a device and a UAV in these cells, (row, column)."""
    rows, cols = uav[0] - device[0], uav[1] - device[1]
    crossed = crossed_cells(rows, cols) + np.array(device)
    corners = passed_corners(rows, cols) + np.array(device)
    closed = city.buildings[corners[..., 0], corners[..., 1]].all(axis=1)
    blocked_by = crossed[city.buildings[crossed[:, 0], crossed[:, 1]]]
    blocked_by = np.concatenate([blocked_by, corners[closed].reshape(-1, 2)])
    ground_m = float(np.hypot(uav[0] - device[0], uav[1] - device[1])) * channel.cell_size_m
    distance_m = float(np.hypot(ground_m, channel.altitude_m))
    sight = len(blocked_by) == 0
    snr_db = float(channel.mean_snr_db(np.float32(distance_m**2), sight, city.size))
    return Link(
        ground_m,
        distance_m,
        crossed,
        blocked_by,
        snr_db,
        float(rate(snr_db)),
        float(channel.fading_db(1.0, sight)),
    )


def rate_map(
    city: City, channel: Channel, line_of_sight: np.ndarray, device: tuple[int, int]
) -> np.ndarray:
    """Data units a slot, without fading, that a UAV gets from a device when hovering; (M, M).

    Arguments:
        line_of_sight: (M², M²), as `Environment.line_of_sight`.
    """
    row, col = np.indices((city.size, city.size))
    ground = ((row - device[0]) ** 2 + (col - device[1]) ** 2) * channel.cell_size_m**2
    sight = line_of_sight[device[0] * city.size + device[1]].reshape(row.shape)
    snr_db = channel.mean_snr_db(np.float32(ground + channel.altitude_m**2), sight, city.size)
    return rate(snr_db)
