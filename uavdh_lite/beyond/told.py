"""Tell the network what can be computed: three more layers of the map.

The environment knows the city and the channel, and a rule such as the greedy one uses both. A
network that sees buildings has to find out by trial where a device is heard, and which way leads
around a block. Three layers say so.

| layer | value of a cell |
| --- | --- |
| expected data | the most that a device would send to a UAV there in one unit of time, at the |
| | mean rate: max over the devices of min(δ · rate, data left), over `data_scale` |
| way home | 1 − moves to the nearest landing zone / 2M, at least 0 |
| way there | 1 − moves from the UAV to the cell / 2M, at least 0 |
"""

from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from uavdh_lite.environment import State
from uavdh_lite.observation import Observation
from uavdh_lite.planners import shortest_paths

TOLD_LAYERS = ("expected data", "way home", "way there")


class ToldObservation(Observation):
    """An `Observation` with the layers of `TOLD_LAYERS` after the others.

    Tables of all pairs of cells, 5·M⁴ bytes a city, are made at the first use.
    """

    @property
    def map_shape(self) -> tuple[int, int, int]:
        channels, rows, cols = super().map_shape
        return channels + len(TOLD_LAYERS), rows, cols

    def _window(self, state: State, top: np.ndarray, left: np.ndarray, channels: int) -> Tensor:
        maps = super()._window(state, top, left, channels + len(TOLD_LAYERS))
        cells = np.arange(self.environment.size**2)
        where = self._tensor(self._in_window(cells, top[:, None], left[:, None]))
        told = maps.flatten(2)[:, channels:]
        told.scatter_(2, where[:, None].expand(-1, len(TOLD_LAYERS), -1), self.told(state))
        return maps

    def told(self, state: State) -> Tensor:
        """The layers that are told, for the cells of the city; (B, 3, n)."""
        first = state.city.astype(int) * self.environment.size**2
        data = self.expected_data(state) / self.data_scale
        home = self._home[self._tensor(state.city.astype(int))]
        there = self._there[self._tensor(first + state.uav_cell)].float() / self._farthest
        return torch.stack([data, home, 1 - there], dim=1)

    def expected_data(self, state: State) -> Tensor:
        """What a unit of time over each cell brings at the mean rate, data units; (B, n)."""
        first = state.city.astype(int)[:, None] * self.environment.size**2
        rows, left = self._tensor(first + state.device_cells), self._tensor(state.data_left)
        most = torch.zeros(len(state), self.environment.size**2, device=left.device)
        for device in range(rows.shape[1]):
            offered = self._data[rows[:, device]].minimum(left[:, device, None])
            torch.maximum(most, offered, out=most)
        return most

    @property
    def _farthest(self) -> int:
        """2M, the number of moves at which a way counts as endless."""
        return 2 * self.size

    @cached_property
    def _data(self) -> Tensor:
        """δ · mean rate, `[city and device's cell, UAV's cell]`; (C·n, n) float32."""
        environment, cells = self.environment, self.environment.size**2
        data = np.zeros((len(environment.cities), cells, cells), np.float32)
        row, col = np.divmod(np.arange(cells), environment.size)
        for number, city in enumerate(environment.cities):
            own = (row < city.size) & (col < city.size)
            for cell in np.flatnonzero(environment.open_to_devices[number]):
                data[number, cell] = environment.rate_map(int(cell), number).ravel() * own
        return self._tensor(environment.channel.slots * data.reshape(-1, cells))

    @cached_property
    def _there(self) -> Tensor:
        """Moves, `[city and start, goal]`, at most 2M; (C·n, n) uint8."""
        size = self.environment.size
        ways = [*map(shortest_paths, self.environment.no_fly.reshape(-1, size, size))]
        return self._tensor(np.concatenate(ways).clip(max=self._farthest).astype(np.uint8))

    @cached_property
    def _home(self) -> Tensor:
        """The layer way home; (C, n) float32."""
        moves = self.environment.landing_distance
        moves = np.where(moves < 0, self._farthest, moves).clip(max=self._farthest)
        return self._tensor((1 - moves / self._farthest).astype(np.float32))
