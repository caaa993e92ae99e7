"""What the network sees: maps for a whole batch, built from compact states on the agent's device.

B is the batch size and M the number of cells on a side of the largest city, or more if the network
is to see larger ones, too. A map of W = 2M − 1 cells on a side shows the whole city wherever the
UAV is.
"""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from uavdh_lite.city import Cities, City, as_cities
from uavdh_lite.environment import State
from uavdh_lite.errors import InputError

KINDS = ("centred", "non_centred", "global_local")
LAYERS = ("landing zone", "no-fly zone", "buildings", "data left", "data collected")


class Observation(nn.Module):
    """Builds the network's input: `observation(state) -> (maps, time)`.

    | kind | maps |
    | --- | --- |
    | `centred` | one, (B, 5, W, W): the layers shifted so that the UAV is in the middle (III-C) |
    | `non_centred` | one, (B, 6, W, W): the layers in place and a one-hot layer of the position |
    | `global_local` | two: the centred map average-pooled by `pooling`, (B, 5, W//g, W//g), and its middle, `local_size` cells on a side, at full resolution, (B, 5, l, l) |

    The layers are those of `LAYERS`. Outside the city the no-fly zone is 1 and all else is 0; so it
    is around a city that is smaller than M. In the non-centred map the city is in the
    middle, or half a cell north-west of it. `time`, (B, 1), is the remaining flying time. Data is
    divided by `data_scale`, time by `time_scale`.

    The cities' own layers are a buffer that follows `.to(device)`, (C, 3, 3M − 2, 3M − 2) uint8:
    each city with no-fly cells around it, from which all maps are cut. It is not part of the
    `state_dict`, because checkpoints keep the city itself.

    Arguments:
        city: the city of all episodes, or the cities among which their cells say theirs.
        size: M, if it is to be more than the largest city has.
    """  # noqa: E501

    wide: Tensor

    def __init__(
        self,
        city: City | Cities,
        kind: str = "centred",
        data_scale: float = 1.0,
        time_scale: float = 1.0,
        pooling: int = 3,
        local_size: int = 17,
        size: int = 0,
    ):
        super().__init__()
        if kind not in KINDS:
            raise InputError(f"unknown observation {kind!r}: choose one of {', '.join(KINDS)}")
        self.kind, self.data_scale, self.time_scale = kind, data_scale, time_scale
        self.pooling, self.local_size = pooling, local_size
        self.cities = as_cities(city)
        self.size = max(size, self.cities.size)
        self.width = 2 * self.size - 1
        if kind == "global_local" and not (local_size % 2 == 1 and local_size <= self.width):
            raise InputError(
                f"local_size {local_size}: must be odd and at most {self.width} for this city"
            )
        self.register_buffer("wide", torch.from_numpy(self._widened()), persistent=False)

    def _widened(self) -> np.ndarray:
        """The cities' layers with no-fly cells around them; (C, 3, 3M − 2, 3M − 2) uint8.

        So the window of W cells on a side that starts at (row, col) has that cell of the city in
        its middle.
        """
        cities, before = self.cities, self.size - 1
        wide = np.zeros((len(cities), 3, self.width + before, self.width + before), np.uint8)
        wide[:, 1] = 1
        place = cities.city, slice(None), cities.row + before, cities.col + before
        wide[place] = np.stack([cities.landing, cities.no_fly, cities.buildings], axis=1)
        return wide

    def map_shapes(self) -> list[tuple[int, int, int]]:
        """The (channels, rows, columns) of each map."""
        if self.kind == "global_local":
            pooled = self.width // self.pooling
            return [(5, pooled, pooled), (5, self.local_size, self.local_size)]
        return [(5 if self.kind == "centred" else 6, self.width, self.width)]

    def forward(self, state: State) -> tuple[list[Tensor], Tensor]:
        return self.views(self.full_map(state)), self.time(state)

    def time(self, state: State) -> Tensor:
        """The remaining flying time as the network sees it; (B, 1)."""
        return self._tensor(state.time_left).float()[:, None] / self.time_scale

    def full_map(self, state: State) -> Tensor:
        """The whole map at full resolution, of which the network sees its `views`."""
        if self.kind == "non_centred":
            return self.in_place_map(state)
        return self.centred_map(state)

    def views(self, full: Tensor) -> list[Tensor]:
        """The network's maps, from the `full_map`: itself, or the pooled one and its middle."""
        if self.kind != "global_local":
            return [full]
        margin = (self.width - self.local_size) // 2
        inside = slice(margin, margin + self.local_size)
        return [avg_pool2d(full, self.pooling), full[:, :, inside, inside]]

    def centred_map(self, state: State) -> Tensor:
        """All layers shifted so that the UAV's cell is in the middle; (B, 5, W, W)."""
        row, col = self.cities.row[state.uav_cell], self.cities.col[state.uav_cell]
        return self._maps(state, row, col, layers=len(LAYERS))

    def in_place_map(self, state: State) -> Tensor:
        """All layers in place, and one that marks the UAV's cell; (B, 6, W, W)."""
        own_size = self.cities.sizes[self.cities.city[state.uav_cell]]
        corner = self.size - 1 - (self.width - own_size) // 2
        maps = self._maps(state, corner, corner, layers=len(LAYERS) + 1)
        uav = self._tensor(self._place(state.uav_cell, corner, corner))
        maps.flatten(2)[:, -1].scatter_(1, uav[:, None], 1.0)
        return maps

    def _maps(self, state: State, row: np.ndarray, col: np.ndarray, layers: int) -> Tensor:
        """The windows of the wide maps that start at (row, col), (B,) each, with the city's
        layers, data left, data collected, and zeros; (B, layers, W, W)."""
        data = self._tensor(np.stack([state.data_left, state.data_collected], axis=1))
        devices = self._tensor(self._place(state.device_cells, row[:, None], col[:, None]))
        maps = data.new_zeros(len(state), layers, self.width, self.width)
        maps[:, :3] = self._windows(self._tensor(self.cities.city[state.uav_cell]), row, col)
        data = data / self.data_scale
        maps.flatten(2)[:, 3:5].scatter_add_(2, devices[:, None].expand(-1, 2, -1), data)
        return maps

    def _windows(self, city: Tensor, row: np.ndarray, col: np.ndarray) -> Tensor:
        """W×W cells of the wide maps of these cities, from (row, col) on; (B, 3, W, W) uint8.

        A row of a window is a row of a view that has all runs of W cells; nothing is stored twice.
        """
        layers, side = self.wide.shape[1:3]
        runs = self.wide.as_strided((self.wide.numel() - self.width + 1, self.width), (1, 1))
        rows = torch.arange(layers, device=city.device)[:, None] * side
        rows = rows + torch.arange(self.width, device=city.device)
        first = city * layers * side**2 + self._tensor(row * side + col)
        index = first[:, None] + rows.flatten() * side
        return runs.index_select(0, index.flatten()).view(len(city), layers, *(self.width,) * 2)

    def _place(self, cells: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
        """The index in a flattened map of cells of the city, in the window from (row, col) on."""
        down = self.cities.row[cells] + self.size - 1 - row
        return down * self.width + self.cities.col[cells] + self.size - 1 - col

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.tensor(array, device=self.wide.device)
