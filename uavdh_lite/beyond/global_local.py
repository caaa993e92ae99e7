"""Two maps instead of one: the whole map coarsely, its middle in full (Theile et al., 2021).

On larger cities one map at full resolution makes a large network. So the network averages the
centred map over cells of g×g, and cuts out the l×l cells around the UAV. Each of the two goes
through its own convolutions.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from uavdh_lite.network import WholeFrame, convolutions, fully_connected


class GlobalLocalNetwork(nn.Module):
    """Q-values of all actions from the centred map: `network(map, time) -> (B, 6)`.

    Arguments:
        pooling: g, cells that the coarse map averages over, along a side.
        local_size: l, cells on a side of the map around the UAV; odd.
        The others are those of `QNetwork`.
    """

    def __init__(
        self,
        map_shape: tuple[int, int, int],
        pooling: int,
        local_size: int,
        kernels: int = 16,
        kernel_size: int = 5,
        strides: tuple[int, ...] = (1, 1),
        hidden: tuple[int, ...] = (256, 256, 256),
        layer_norm: bool = False,
        leak: float = 0.0,
    ):
        super().__init__()
        channels, width, _ = map_shape
        self.pooling, self.local_size = pooling, local_size
        self.whole = WholeFrame(width, kernel_size, strides, pooling)
        self.middle = WholeFrame(local_size, kernel_size, strides)
        self.convolutions = nn.ModuleList()
        features = 1  # the flying time
        for side in (self.whole.side // pooling, self.middle.side):
            layers, found = convolutions(channels, side, kernels, kernel_size, strides, leak)
            self.convolutions.append(layers)
            features += found
        self.head = fully_connected(features, hidden, layer_norm, leak)

    def forward(self, map: Tensor, time: Tensor) -> Tensor:
        margin = (map.shape[-1] - self.local_size) // 2
        inside = slice(margin, margin + self.local_size)
        coarse = avg_pool2d(self.whole(map), self.pooling)
        maps = (coarse, self.middle(map[:, :, inside, inside]))
        pairs = zip(self.convolutions, maps, strict=True)
        return self.head(torch.cat([*(layers(one) for layers, one in pairs), time], dim=1))
