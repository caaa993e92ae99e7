"""The radio link of one device to every cell, without fading."""

from typing import Any

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.labs.flights import Hangar, grid
from uavdh_lite.labs.state import Stage


def scene(stage: Stage, hangar: Hangar) -> dict[str, Any]:
    """The ledger of each cell: distance, what is left of the signal, and what a building costs.

    | entry | meaning |
    | --- | --- |
    | `transmit` | the SNR at a distance of 1 m, dB |
    | `distance` | from the device to a UAV over the cell, m |
    | `path_loss` | with a line of sight, dB |
    | `building` | what the buildings in between cost, dB; 0 with a line of sight |
    | `snr` | what is left, dB |
    | `dearest` | the cell over which a building costs most data |
    | `rate` | data units a slot |
    | `range` | SNRs over this city from the weakest to the strongest, in steps of 10 dB |
    | `fading` | its standard deviation with a line of sight and without one, dB |
    """
    environment = hangar.environment
    city, channel = environment.cities[0], environment.channel
    size = city.size
    row, col = stage.mission.devices[stage.device]
    rows, cols = np.indices((size, size))
    ground_m2 = ((rows - row) ** 2 + (cols - col) ** 2) * channel.cell_size_m**2
    squared = np.float32(ground_m2 + channel.altitude_m**2)
    sight = environment.sight[0, row * size + col].reshape(size, size)
    free = channel.path_loss_db(squared, np.ones_like(sight))
    loss = channel.path_loss_db(squared, sight)
    transmit = channel.transmit_snr_db(city.own_size)
    with_and_without = (rate(np.float32(transmit) - each) for each in (free, loss))
    lost = np.where(city.no_fly, -1, np.subtract(*with_and_without))
    ends = np.float32([2 * ((size - 1) * channel.cell_size_m) ** 2, 0]) + channel.altitude_m**2
    weakest, strongest = transmit - channel.path_loss_db(ends, np.array([False, True]))
    return {
        "device": stage.device,
        "range": [int(10 * np.floor(weakest / 10)), int(10 * np.ceil(strongest / 10))],
        "dearest": divmod(int(lost.argmax()), size),
        "transmit": round(transmit, 1),
        "distance": grid(np.sqrt(squared), 1),
        "path_loss": grid(free, 2),
        "building": grid(loss - free, 2),
        "snr": grid(transmit - loss, 2),
        "rate": grid(rate(np.float32(transmit) - loss), 5),
        "fading": [
            round(float(np.sqrt(variance)), 1)
            for variance in (channel.fading_variance_los_db2, channel.fading_variance_nlos_db2)
        ],
    }


def shadow(hangar: Hangar, cell: tuple[int, int]) -> list[str]:
    """For each row of the city, `#` where a device in this cell would be out of sight.

    No row for a cell that is a building, or outside.
    """
    city, size = hangar.environment.cities[0], hangar.environment.size
    if not all(0 <= axis < size for axis in cell) or city.buildings[cell]:
        return []
    hidden = ~hangar.environment.sight[0, cell[0] * size + cell[1]].reshape(size, size)
    return ["".join(".#"[int(each)] for each in row) for row in hidden]
