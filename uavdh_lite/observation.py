"""What the network sees: maps for a whole batch, built from compact states on the agent's device.

B is the batch size and M the number of cells on a side of the city. A map of W = 2M − 1 cells on a
side shows the whole city wherever the UAV is.
"""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, pad

from uavdh_lite.city import City
from uavdh_lite.environment import State
from uavdh_lite.errors import InputError

KINDS = ("centred", "non_centred", "global_local")
LAYERS = ("landing zone", "no-fly zone", "buildings", "data left", "data collected")


class Observation(nn.Module):
    """Builds the network's input for one city: `observation(state) -> (maps, time)`.

    | kind | maps |
    | --- | --- |
    | `centred` | one, (B, 5, W, W): the layers shifted so that the UAV is in the middle (III-C) |
    | `non_centred` | one, (B, 6, W, W): the layers in place and a one-hot layer of the position |
    | `global_local` | two: the centred map average-pooled by `pooling`, (B, 5, W//g, W//g), and its middle, `local_size` cells on a side, at full resolution, (B, 5, l, l) |

    The layers are those of `LAYERS`. Outside the city the no-fly zone is 1 and all else is 0. In the
    non-centred map the city is in the middle, or half a cell north-west of it. `time`, (B, 1), is
    the remaining flying time. Data is divided by `data_scale`, time by `time_scale`.

    The city's own layers are buffers that follow `.to(device)`; they are not part of the
    `state_dict`, because checkpoints keep the city itself.
    """  # noqa: E501

    in_place: Tensor
    windows: Tensor

    def __init__(
        self,
        city: City,
        kind: str = "centred",
        data_scale: float = 1.0,
        time_scale: float = 1.0,
        pooling: int = 3,
        local_size: int = 17,
    ):
        super().__init__()
        if kind not in KINDS:
            raise InputError(f"unknown observation {kind!r}: choose one of {', '.join(KINDS)}")
        self.kind, self.data_scale, self.time_scale = kind, data_scale, time_scale
        self.pooling, self.local_size = pooling, local_size
        self.size = city.size
        self.width = 2 * city.size - 1
        if kind == "global_local" and not (local_size % 2 == 1 and local_size <= self.width):
            raise InputError(
                f"local_size {local_size}: must be odd and at most {self.width} for this city"
            )
        layers = np.stack([city.landing, city.no_fly, city.buildings]).astype(np.float32)
        self.before = (self.size - 1) // 2  # cells west and north of the city when not centred
        before, after = self.before, self.size - 1 - self.before
        in_place = _surround(layers, before, after)
        wide = _surround(layers, self.size - 1, self.size - 1).to(torch.uint8)
        # The window that starts at (row, col) of the widened city has that cell in its middle.
        windows = wide.unfold(1, self.width, 1).unfold(2, self.width, 1).permute(1, 2, 0, 3, 4)
        self.register_buffer("in_place", in_place, persistent=False)
        self.register_buffer("windows", windows.flatten(0, 1).contiguous(), persistent=False)

    def map_shapes(self) -> list[tuple[int, int, int]]:
        """The (channels, rows, columns) of each map."""
        if self.kind == "global_local":
            pooled = self.width // self.pooling
            return [(5, pooled, pooled), (5, self.local_size, self.local_size)]
        return [(5 if self.kind == "centred" else 6, self.width, self.width)]

    def forward(self, state: State) -> tuple[list[Tensor], Tensor]:
        device = self.in_place.device
        uav = torch.tensor(state.uav_cell, device=device).long()
        devices = torch.tensor(state.device_cells, device=device).long()
        data = torch.from_numpy(np.stack([state.data_left, state.data_collected], axis=1))
        data = data.to(device) / self.data_scale
        time = torch.tensor(state.time_left, device=device).float()[:, None] / self.time_scale
        if self.kind == "non_centred":
            return [self.in_place_map(uav, devices, data)], time
        centred = self.centred_map(uav, devices, data)
        if self.kind == "centred":
            return [centred], time
        margin = (self.width - self.local_size) // 2
        inside = slice(margin, margin + self.local_size)
        return [avg_pool2d(centred, self.pooling), centred[:, :, inside, inside]], time

    def centred_map(self, uav: Tensor, devices: Tensor, data: Tensor) -> Tensor:
        """All layers shifted so that the UAV's cell is in the middle; (B, 5, W, W)."""
        shift_row, shift_col = self.size - 1 - uav // self.size, self.size - 1 - uav % self.size
        city = self.windows.index_select(0, uav)
        return self._maps(city, devices, data, shift_row, shift_col)

    def in_place_map(self, uav: Tensor, devices: Tensor, data: Tensor) -> Tensor:
        """All layers in place, and one that marks the UAV's cell; (B, 6, W, W)."""
        shift = torch.full_like(uav, self.before)
        maps = self._maps(self.in_place, devices, data, shift, shift, layers=len(LAYERS) + 1)
        maps.flatten(2)[:, -1].scatter_(1, self._place(uav, shift, shift)[:, None], 1.0)
        return maps

    def _maps(
        self,
        city: Tensor,
        devices: Tensor,
        data: Tensor,
        row: Tensor,
        col: Tensor,
        layers: int = len(LAYERS),
    ) -> Tensor:
        """The city's layers, data left and collected at the devices' cells shifted by (row, col),
        and zeros; (B, layers, W, W)."""
        cells = self._place(devices, row[:, None], col[:, None])
        maps = data.new_zeros(len(devices), layers, self.width, self.width)
        maps[:, :3] = city
        maps.flatten(2)[:, 3:5].scatter_add_(2, cells[:, None].expand(-1, 2, -1), data)
        return maps

    def _place(self, cells: Tensor, row: Tensor, col: Tensor) -> Tensor:
        """The index in a flattened map of cells of the city, shifted by (row, col)."""
        return (cells // self.size + row) * self.width + cells % self.size + col


def _surround(layers: np.ndarray, before: int, after: int) -> Tensor:
    """The city's layers with no-fly cells around them."""
    padded = pad(torch.from_numpy(layers), (before, after, before, after))
    outside = pad(torch.zeros(layers.shape[1:]), (before, after, before, after), value=1.0)
    padded[1] += outside
    return padded
