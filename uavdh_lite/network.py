"""The Q-network: convolutions over the map, then fully connected layers (paper, Fig. 2)."""

import torch
from torch import Tensor, nn

from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import InputError


class QNetwork(nn.Module):
    """Q-values of all actions from the observation: `network(map, time) -> (B, 6)`.

    The initial weights are those of the authors' framework, Keras: Glorot's uniform ones, and
    biases of 0.

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
        self.convolutions, features = convolutions(map_shape, kernels, kernel_size, strides, leak)
        self.head = fully_connected(features + 1, hidden, layer_norm, leak)
        self.float()  # whatever torch's default is: maps are float32

    def forward(self, map: Tensor, time: Tensor) -> Tensor:
        return self.head(torch.cat([self.convolutions(map), time], dim=1))


def convolutions(
    map_shape: tuple[int, int, int],
    kernels: int,
    kernel_size: int,
    strides: tuple[int, ...],
    leak: float,
) -> tuple[nn.Sequential, int]:
    """Convolutions with their ReLUs, flattened, and the number of features that come out.

    Raises `InputError` if the map is too small for them.
    """
    channels, rows, cols = map_shape
    layers: list[nn.Module] = []
    for stride in strides:
        if min(rows, cols) < kernel_size:
            raise InputError(
                f"a map of {rows}×{cols} cells is too small for a convolution of "
                f"{kernel_size}×{kernel_size}: take smaller kernels or strides"
            )
        convolution = nn.Conv2d(channels, kernels, kernel_size, stride)
        layers += [with_initial_weights(convolution), nn.LeakyReLU(leak)]
        channels = kernels
        rows, cols = ((side - kernel_size) // stride + 1 for side in (rows, cols))
    return nn.Sequential(*layers, nn.Flatten()), channels * rows * cols


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
