"""What a network looks at, and what it expects where: for the lab that shows an agent thinking."""

from dataclasses import replace

import numpy as np
import torch

from uavdh_lite.agent import Agent
from uavdh_lite.environment import State


def saliency(agent: Agent, state: State) -> np.ndarray:
    """How much the largest Q-value depends on each cell of what the network sees; (W, W).

    This is the magnitude of gradient times input, summed over the layers of the map: to first
    order, how much the Q-value would change if the cell were empty.

    Arguments:
        state: a batch of one.
    """
    layers, *others = agent.observation(state)
    layers = layers.requires_grad_()
    (gradient,) = torch.autograd.grad(agent.network(layers, *others).max(), layers)
    return (gradient * layers.detach())[0].abs().sum(0).cpu().numpy()


def value_map(agent: Agent, state: State) -> np.ndarray:
    """The largest Q-value if the UAV were over each cell, all else equal; (M, M).

    It is NaN in cells over which the UAV may not fly.

    Arguments:
        state: a batch of one.
    """
    environment = agent.environment
    cells = np.flatnonzero(~environment.no_fly[state.city[0]])
    elsewhere = replace(state[np.zeros(len(cells), int)], uav_cell=cells.astype(np.int16))
    values = np.full(environment.size**2, np.nan)
    values[cells] = agent.q_values(elsewhere).max(dim=1).values
    return values.reshape(environment.size, environment.size)
