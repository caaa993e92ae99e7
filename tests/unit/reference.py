"""The specification once more, as slow and plain as can be, for tests to compare with.

One episode, one device, one slot at a time; plain floats in the channel, fractions in the shadow
map. Cells are (row, col).
"""

import math
from fractions import Fraction
from functools import cache

MOVES = [(-1, 0), (0, 1), (1, 0), (0, -1), (0, 0), (0, 0)]
LAND = 5


def reference_line_of_sight(buildings, device, uav) -> bool:
    """Clip the segment between the centres to the open square of each building, exactly.

    And look at every corner of the grid that the segment goes through: are both cells beside its
    way buildings?
    """
    half = Fraction(1, 2)
    height, width = uav[0] - device[0], uav[1] - device[1]
    for corner in range(abs(height)) if width else ():
        row = device[0] + (corner + half) * (1 if height > 0 else -1)
        col = device[1] + (row - device[0]) / height * width
        if (col - half).denominator == 1:
            around = {(int(row + r), int(col + c)) for r in (-half, half) for c in (-half, half)}
            way = 1 if (height > 0) == (width > 0) else -1
            beside = [c for c in around if (c[0] - row) * (c[1] - col) * way < 0]
            if all(buildings[r][c] for r, c in beside):
                return False
    for row in range(min(device[0], uav[0]), max(device[0], uav[0]) + 1):
        for col in range(min(device[1], uav[1]), max(device[1], uav[1]) + 1):
            if not buildings[row][col]:
                continue
            # the points device + t (uav − device) in the square: enter < t < leave
            enter, leave = Fraction(-1), Fraction(2)
            for start, end, centre in ((device[0], uav[0], row), (device[1], uav[1], col)):
                if start == end:
                    continue  # then centre is the same: the loops stay between the two cells
                bounds = [(centre + side - start) / (end - start) for side in (-half, half)]
                enter, leave = max(enter, min(bounds)), min(leave, max(bounds))
            if enter < leave and enter < 1 and leave > 0:
                return False
    return True


def exact_sight(buildings):
    """Of one city: `sight(device, uav)`, each pair computed once."""
    return cache(lambda device, uav: reference_line_of_sight(buildings, device, uav))


class ReferenceEpisode:
    """One episode. `channel` only holds the constants; `sight(device, uav)` says LoS or not."""

    def __init__(self, city, channel, sight, uav, time, devices, data):
        self.size = len(city.landing)
        self.landing, self.no_fly = city.landing, city.no_fly
        self.channel, self.sight = channel, sight
        (self.row, self.col), self.time = uav, time
        self.devices, self.left = devices, data
        self.landed = False

    @property
    def ended(self) -> bool:
        return self.landed or self.time == 0

    def snr(self, device, before, after, slot, normal) -> float:
        """SNR of a device cell in slot 1…δ on the way between two cells."""
        channel = self.channel
        edge = math.sqrt(2) * self.size * channel.cell_size_m / 2
        transmit = 10 ** (channel.cell_edge_snr_db / 10) * edge**channel.path_loss_exponent_los

        part = slot / channel.slots
        rows = before[0] + part * (after[0] - before[0]) - device[0]
        cols = before[1] + part * (after[1] - before[1]) - device[1]
        ground = math.hypot(rows * channel.cell_size_m, cols * channel.cell_size_m)
        distance = math.hypot(ground, channel.altitude_m)

        if self.sight(device, before if 2 * slot < channel.slots else after):
            exponent, variance = channel.path_loss_exponent_los, channel.fading_variance_los_db2
        else:
            exponent, variance = channel.path_loss_exponent_nlos, channel.fading_variance_nlos_db2
        return transmit * distance**-exponent * 10 ** (math.sqrt(variance) * normal / 10)

    def step(self, action, fading) -> dict:
        """One step; `fading[slot][device]` is standard normal."""
        flew, before, moved = not self.ended, (self.row, self.col), False
        landed = flew and action == LAND and bool(self.landing[before])
        if flew and action != LAND:
            row, col = self.row + MOVES[action][0], self.col + MOVES[action][1]
            moved = 0 <= row < self.size and 0 <= col < self.size and not self.no_fly[row][col]
            if moved:
                self.row, self.col = row, col
        self.time -= flew
        self.landed = self.landed or landed
        crashed = flew and self.time == 0 and not landed
        intervened = flew and not landed and not moved

        served, uploaded = [-1] * self.channel.slots, [0.0] * self.channel.slots
        for slot in range(0 if self.ended else self.channel.slots):
            best, best_snr = -1, -1.0
            for index, device in enumerate(self.devices):
                normal = float(fading[slot][index])
                snr = self.snr(device, before, (self.row, self.col), slot + 1, normal)
                if self.left[index] > 0 and snr > best_snr:
                    best, best_snr = index, snr
            if best >= 0:
                served[slot] = best
                uploaded[slot] = min(math.log2(1 + best_snr), self.left[best])
                self.left[best] -= uploaded[slot]

        return {
            "served": served,
            "uploaded": uploaded,
            "intervened": intervened,
            "landed": landed,
            "crashed": crashed,
            "flew": flew,
            "data": 1.0 * sum(uploaded),
            "movement": -0.2 if flew and not landed else 0.0,
            "safety": -1.0 if intervened else 0.0,
            "crash": -150.0 if crashed else 0.0,
        }
