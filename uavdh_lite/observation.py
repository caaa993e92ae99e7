"""What the network sees: maps for a whole batch, built from compact states on the agent's device.

B is the batch size, C the number of cities, and M the number of cells on a side of the largest
one, or more if the network is to see larger ones, too. A map of W = 2M − 1 cells on a side shows
the whole city wherever the UAV is.
"""

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError

LAYERS = ("landing zone", "no-fly zone", "buildings", "data left", "data collected")


class Observation(nn.Module):
    """Builds the network's input: `observation(state) -> (map, time)`.

    | kind | map |
    | --- | --- |
    | `centred` | (B, 5, W, W): the layers shifted so that the UAV is in the middle (III-C) |
    | `non_centred` | (B, 6, W, W): the layers in place and a one-hot layer of the position |

    The layers are those of `LAYERS`. Outside the city the no-fly zone is 1 and all else is 0. In
    the non-centred map the city is in the middle, or half a cell north-west of it. `time`, (B, 1),
    is the remaining flying time. Data is divided by `data_scale`, time by `time_scale`.

    The cities' own layers are a buffer that follows `.to(device)`: each city with no-fly cells
    around it, of which every map is a window. It is not part of the `state_dict`, because
    checkpoints keep the cities themselves.

    Arguments:
        environment: of the states to come.
        size: M, if it is to be more than the largest city has.

    Raises `InputError` for another kind.
    """

    surroundings: Tensor  # (C, 3, 3M − 2, 3M − 2) uint8

    def __init__(
        self,
        environment: Environment,
        kind: str = "centred",
        data_scale: float = 1.0,
        time_scale: float = 1.0,
        size: int = 0,
    ):
        super().__init__()
        if kind not in ("centred", "non_centred"):
            raise InputError(f"unknown observation {kind!r}: choose centred or non_centred")
        self.environment, self.kind = environment, kind
        self.data_scale, self.time_scale = data_scale, time_scale
        self.size = max(size, environment.size)
        self.width = 2 * self.size - 1
        self.register_buffer("surroundings", self._surroundings(), persistent=False)

    def _surroundings(self) -> Tensor:
        """The window whose corner is at (row, col) has that cell of the city in its middle."""
        environment, size = self.environment, self.environment.size
        side = self.width + self.size - 1
        layers = np.zeros((len(environment.cities), 3, side, side), np.uint8)
        layers[:, 1] = 1
        inside = slice(self.size - 1, self.size - 1 + size)
        own = (environment.landing, environment.no_fly, environment.buildings)
        layers[:, :, inside, inside] = np.stack(own, axis=1).reshape(-1, 3, size, size)
        return torch.from_numpy(layers)

    @property
    def map_shape(self) -> tuple[int, int, int]:
        """The (channels, rows, columns) of the map."""
        channels = len(LAYERS) + (self.kind == "non_centred")
        return channels, self.width, self.width

    def forward(self, state: State) -> tuple[Tensor, ...]:
        centred = self.kind == "centred"
        time = self._tensor(state.time_left).float()[:, None] / self.time_scale
        return self.centred_map(state) if centred else self.in_place_map(state), time

    def centred_map(self, state: State) -> Tensor:
        """All layers shifted so that the UAV's cell is in the middle; (B, 5, W, W).

        So map[i, j] shows the city's cell UAV + (i, j) − (M − 1, M − 1).
        """
        top, left = np.divmod(state.uav_cell.astype(int), self.environment.size)
        return self._window(state, top, left, channels=5)

    def in_place_map(self, state: State) -> Tensor:
        """All layers in place, and one that marks the UAV's cell; (B, 6, W, W)."""
        size = np.array([city.size for city in self.environment.cities])[state.city]
        corner = self.size - 1 - (self.width - size) // 2
        maps = self._window(state, corner, corner, channels=6)
        uav = self._tensor(self._in_window(state.uav_cell, corner, corner))
        maps.flatten(2)[:, len(LAYERS)].scatter_(1, uav[:, None], 1.0)
        return maps

    def _window(self, state: State, top: np.ndarray, left: np.ndarray, channels: int) -> Tensor:
        """The window of each episode's surroundings with its corner at (top, left), (B,) each: the
        city's layers, data left, data collected, and zeros; (B, channels, W, W)."""
        W, side = self.width, self.surroundings.shape[-1]
        city, layer, row = np.ix_(state.city.astype(int), np.arange(3), np.arange(W))
        # Where each row of each window begins, counted through all surroundings
        first = ((city * 3 + layer) * side + row + top[:, None, None]) * side + left[:, None, None]
        runs = self.surroundings.flatten().unfold(0, W, 1)  # every W cells that follow one another
        shape = len(state), channels, W, W
        maps = torch.zeros(shape, dtype=torch.float32, device=runs.device)
        maps[:, :3] = runs.index_select(0, self._tensor(first.ravel())).view(-1, 3, W, W)
        data = self._tensor(np.stack([state.data_left, state.data_collected], axis=1))
        data = data / self.data_scale
        devices = self._tensor(self._in_window(state.device_cells, top[:, None], left[:, None]))
        maps.flatten(2)[:, 3:5].scatter_add_(2, devices[:, None].expand(-1, 2, -1), data)
        return maps

    def _in_window(self, cells: np.ndarray, top: np.ndarray, left: np.ndarray) -> np.ndarray:
        """The index of the city's cells in a flattened window with its corner at (top, left)."""
        row, col = np.divmod(cells.astype(int), self.environment.size)
        return (row + self.size - 1 - top) * self.width + col + self.size - 1 - left

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.tensor(array, device=self.surroundings.device)
