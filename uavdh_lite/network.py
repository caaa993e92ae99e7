"""The Q-network: convolutions over the map, then fully connected layers (paper, Fig. 2)."""

from math import ceil, prod

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError

NO_FLY_LAYER = 1  # of the map; outside the city it is 1, and every other layer 0


class QNetwork(nn.Module):
    """Q-values of all actions from the observation: `network(map, time) -> (B, 6)`.

    The initial weights are those of the authors' framework, Keras: Glorot's uniform ones, and
    biases of 0.

    The convolutions read every cell of the map: where strides would leave some out, `WholeFrame`
    first adds cells to the south and east.

    | part | shape, for the paper's 5 layers of a 16×16 city |
    | --- | --- |
    | map | (B, 5, 31, 31) |
    | convolutions 5×5, no padding, ReLU | (B, 16, 27, 27), (B, 16, 23, 23) |
    | flattened, flying time appended | (B, 8465) |
    | fully connected, (LayerNorm,) ReLU | (B, 256) three times |
    | linear output | (B, 6) |

    Arguments:
        map_shape: (channels, rows, columns) of the map.
        strides: one stride for each convolution.
        layer_norm: normalise each hidden layer before its ReLU.
        leak: slope of the ReLUs below 0; 0 for plain ones.
    """

    def __init__(
        self,
        map_shape: tuple[int, int, int],
        kernels: int = 16,
        kernel_size: int = 5,
        strides: tuple[int, ...] = (1, 1),
        hidden: tuple[int, ...] = (256, 256, 256),
        layer_norm: bool = False,
        leak: float = 0.0,
    ):
        super().__init__()
        channels, width, _ = map_shape
        self.frame = WholeFrame(width, kernel_size, strides)
        self.convolutions, features = convolutions(
            channels, self.frame.side, kernels, kernel_size, strides, leak
        )
        self.head = fully_connected(features + 1, hidden, layer_norm, leak)

    def forward(self, map: Tensor, time: Tensor) -> Tensor:
        return self.head(torch.cat([self.convolutions(self.frame(map)), time], dim=1))


class WholeFrame(nn.Module):
    """Adds cells as they are outside the city, so that no layer leaves a row or column out.

    They go to the south and east: (B, channels, width, width) becomes (B, channels, side, side),
    with the smallest side that pooling and convolutions divide into whole windows.

    Arguments:
        pooling: cells on a side of the windows that are averaged before the convolutions.

    Raises `InputError` for kernels that are larger than the map.
    """

    def __init__(self, width: int, kernel_size: int, strides: tuple[int, ...], pooling: int = 1):
        super().__init__()
        found = ceil(width / pooling)
        if strides and kernel_size > found:
            raise InputError(
                f"a map of {found}×{found} cells is too small for a convolution of "
                f"{kernel_size}×{kernel_size}: take smaller kernels"
            )
        window = 1  # cells on a side that one place after the last convolution sees
        for stride in reversed(strides):
            window = (window - 1) * stride + kernel_size
        further = ceil((found - window) / prod(strides))  # places
        self.side = pooling * (window + max(further, 0) * prod(strides))

    def forward(self, map: Tensor) -> Tensor:
        more = self.side - map.shape[-1]
        if more == 0:
            return map
        outside = map.new_zeros(map.shape[1], 1, 1)
        outside[NO_FLY_LAYER] = 1
        return pad(map - outside, (0, more, 0, more)) + outside


def convolutions(
    channels: int,
    side: int,
    kernels: int,
    kernel_size: int,
    strides: tuple[int, ...],
    leak: float,
) -> tuple[nn.Sequential, int]:
    """Convolutions with their ReLUs, flattened, and the number of features that come out.

    `side` is that of the map, of which they leave nothing out; see `WholeFrame`.
    """
    layers: list[nn.Module] = []
    for stride in strides:
        convolution = nn.Conv2d(channels, kernels, kernel_size, stride)
        layers += [with_initial_weights(convolution), nn.LeakyReLU(leak)]
        channels, side = kernels, (side - kernel_size) // stride + 1
    return nn.Sequential(*layers, nn.Flatten()), channels * side**2


def fully_connected(
    inputs: int, hidden: tuple[int, ...], layer_norm: bool, leak: float
) -> nn.Sequential:
    """Hidden layers with their ReLUs, and a linear output for each action."""
    layers: list[nn.Module] = []
    for units in hidden:
        layers.append(with_initial_weights(nn.Linear(inputs, units)))
        if layer_norm:
            layers.append(nn.LayerNorm(units))
        layers.append(nn.LeakyReLU(leak))
        inputs = units
    return nn.Sequential(*layers, with_initial_weights(nn.Linear(inputs, len(ACTIONS))))


def with_initial_weights(layer: nn.Conv2d | nn.Linear) -> nn.Module:
    """The layer with Glorot's uniform weights (Glorot and Bengio, 2010) and biases of 0."""
    nn.init.xavier_uniform_(layer.weight)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer
