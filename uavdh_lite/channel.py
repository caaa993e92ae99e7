"""The radio channel: log-distance path loss with shadow fading, LoS or NLoS (paper, eq. 1, 2)."""

import math
from dataclasses import dataclass

import numpy as np

from uavdh_lite.config import option, require


@dataclass(frozen=True)
class Channel:
    """The constants of the channel; the paper's values are the defaults."""

    cell_size_m: float = option(10.0, "side of a grid cell, m", gt=0)
    altitude_m: float = option(10.0, "height of the UAV above the devices, m", gt=0)
    cell_edge_snr_db: float = option(-15.0, "SNR at ground level from the centre to a corner, dB")
    path_loss_exponent_los: float = option(2.27, "path loss exponent with line of sight", ge=0)
    path_loss_exponent_nlos: float = option(3.64, "path loss exponent without line of sight", ge=0)
    fading_variance_los_db2: float = option(2.0, "variance of the fading with LoS, dB²", ge=0)
    fading_variance_nlos_db2: float = option(5.0, "variance of the fading without LoS, dB²", ge=0)
    slots: int = option(4, "communication slots in a mission slot, δ", ge=1, le=1000)

    def __post_init__(self):
        require(self, "channel")

    def transmit_snr_db(self, size: int) -> float:
        """P/σ² in dB, from the cell-edge SNR of a city of size×size cells.

        The cell-edge SNR holds at ground level between the map's centre and an unobstructed
        device at distance √2·M·c/2. The same factor serves LoS and NLoS links.
        """
        edge_m = math.sqrt(2) * size * self.cell_size_m / 2
        return self.cell_edge_snr_db + 10 * self.path_loss_exponent_los * math.log10(edge_m)

    def path_loss_db(self, squared_distance_m2, line_of_sight):
        """10 α log10 d in dB, from squared 3-D distances; arrays of one shape.

        The square saves a root: 10 log10 d = 5 log10 d².
        """
        exponents = 5 * self.path_loss_exponent_los, 5 * self.path_loss_exponent_nlos
        return _by_sight(line_of_sight, *exponents) * np.log10(squared_distance_m2)

    def fading_db(self, standard_normal, line_of_sight):
        """Shadow fading η in dB from standard normal draws; arrays of one shape."""
        spreads = math.sqrt(self.fading_variance_los_db2), math.sqrt(self.fading_variance_nlos_db2)
        return standard_normal * _by_sight(line_of_sight, *spreads)


def _by_sight(line_of_sight, los, nlos):
    """One constant where there is line of sight, the other where there is none; float32."""
    return np.where(line_of_sight, np.float32(los), np.float32(nlos))


def rate(snr_db):
    """Data units in one communication slot at this SNR: log2(1 + SNR) (eq. 1)."""
    return np.log2(1 + 10 ** (snr_db / 10))
