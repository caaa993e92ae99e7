"""The Q-network: convolutions over the maps, then fully connected layers (paper, Fig. 2)."""

import torch
from torch import Tensor, nn

from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError


class QNetwork(nn.Module):
    """Q-values of all actions from the observation: `network(maps, time) -> (B, 6)`.

    | part | shape, for the paper's 5 layers of a 16×16 city |
    | --- | --- |
    | map | (B, 5, 31, 31) |
    | convolutions 5×5, no padding, ReLU | (B, 16, 27, 27), (B, 16, 23, 23) |
    | flattened, flying time appended | (B, 8465) |
    | fully connected, (LayerNorm,) ReLU | (B, 256) three times |
    | linear output | (B, 6) |

    With several maps (global and local), each goes through its own convolutions, and the results
    are joined after flattening.

    Arguments:
        map_shapes: (channels, rows, columns) of each map.
        strides: one stride for each convolution.
        layer_norm: normalise each hidden layer before its ReLU.
        leak: slope of the ReLUs below 0; 0 for plain ones.
        outputs: units of the linear output.
    """

    def __init__(
        self,
        map_shapes: list[tuple[int, int, int]],
        kernels: int = 16,
        kernel_size: int = 5,
        strides: tuple[int, ...] = (1, 1),
        hidden: tuple[int, ...] = (256, 256, 256),
        layer_norm: bool = False,
        leak: float = 0.0,
        *,
        outputs: int = len(ACTIONS),
    ):
        super().__init__()

        def relu() -> nn.Module:
            return nn.LeakyReLU(leak) if leak else nn.ReLU()

        self.convolutions = nn.ModuleList()
        width = 1  # the flying time
        for channels, rows, cols in map_shapes:
            layers = []
            for stride in strides:
                if min(rows, cols) < kernel_size:
                    raise InputError(
                        f"a map of {rows}×{cols} cells is too small for a convolution of "
                        f"{kernel_size}×{kernel_size}: take smaller kernels or strides"
                    )
                layers += [nn.Conv2d(channels, kernels, kernel_size, stride), relu()]
                channels = kernels
                rows, cols = ((side - kernel_size) // stride + 1 for side in (rows, cols))
            self.convolutions.append(nn.Sequential(*layers, nn.Flatten()))
            width += channels * rows * cols
        layers = []
        for size in hidden:
            layers.append(nn.Linear(width, size))
            if layer_norm:
                layers.append(nn.LayerNorm(size))
            layers.append(relu())
            width = size
        self.head = nn.Sequential(*layers, nn.Linear(width, outputs))

    def forward(self, maps: list[Tensor], time: Tensor) -> Tensor:
        features = [
            convolution(layers) for convolution, layers in zip(self.convolutions, maps, strict=True)
        ]
        return self.head(torch.cat([*features, time], dim=1))
