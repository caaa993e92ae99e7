"""Why an agent decides as it does: what a decision hangs on, and what every place is worth."""

import numpy as np
import torch

from uavdh_lite.agent import Agent
from uavdh_lite.environment import State
from uavdh_lite.errors import InputError


def saliency(agent: Agent, state: State) -> np.ndarray:
    """How much the best action's Q-value hangs on each cell of what the network sees; (W, W).

    The magnitude of gradient times input, summed over the layers: how much of the Q-value would
    go, to first order, if what is in the cell were gone.

    Arguments:
        state: a batch of one.

    Raises `InputError` for agents that see two maps (`global_local`).
    """
    maps, time = agent.observation(state)
    if len(maps) != 1:
        raise InputError("saliency needs one map: this agent sees a global and a local one")
    layers = maps[0].requires_grad_()
    (gradient,) = torch.autograd.grad(agent.network([layers], time).max(), layers)
    return (gradient * layers.detach())[0].abs().sum(0).cpu().numpy()


def value_map(agent: Agent, state: State) -> np.ndarray:
    """The largest Q-value if the UAV were over each cell, all else equal; (M, M).

    It is NaN in cells over which the UAV may not fly.

    Arguments:
        state: a batch of one.
    """
    city = agent.city
    cells = city.flight_cells
    elsewhere = state[np.zeros(len(cells), int)]
    elsewhere.uav_cell[:] = cells
    values = np.full(city.size**2, np.nan)
    values[cells] = agent.q_values(elsewhere).max(dim=1).values
    return values.reshape(city.size, city.size)


def step_states(states: list[State]) -> State:
    """The states of one episode's steps, each a batch of one, as one batch."""
    fields = [vars(state) for state in states]
    return State(**{name: np.concatenate([one[name] for one in fields]) for name in fields[0]})
