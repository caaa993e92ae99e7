"""Q-learning in a city of 4 × 4 cells: a table, and a network in its place."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.ddqn import soft_update
from uavdh_lite.environment import MOVES
from uavdh_lite.streams import Use, stream

START = (3, 0)
CELLS = torch.cartesian_prod(torch.arange(4.0), torch.arange(4.0))  # (16, 2), row by row

Step = Callable[[tuple[int, int], int], tuple[tuple[int, int], float, bool]]


def small_city(device: tuple[int, int] = (0, 3), price: float = 0.2, moves=MOVES[:4]) -> Step:
    """`step(cell, action)`: the next cell, the reward, and whether the episode ended.

    A step costs `price`. At the device 10 data units are collected, and there the episode ends.
    """

    def step(cell: tuple[int, int], action: int) -> tuple[tuple[int, int], float, bool]:
        row, col = np.clip(np.add(cell, moves[action]), 0, 3).tolist()
        at_device = (row, col) == device
        return (row, col), 10.0 * at_device - price, at_device

    return step


def flights_of(step: Step, count: int) -> Tensor:
    """The steps of random flights, a row each: cell, action, reward, next cell, ended; (n, 7)."""
    rows, generator = [], stream(Use.EXERCISE, count)
    for _ in range(count):
        cell, ended = START, False
        while not ended:
            action = int(generator.integers(4))
            after, reward, ended = step(cell, action)
            rows.append((*cell, action, reward, *after, ended))
            cell = after
    return torch.tensor(rows, dtype=torch.float32)


def learn_table(
    step: Step,
    start: tuple[int, int],
    flights: int,
    gamma: float,
    alpha: float,
    generator: np.random.Generator,
) -> np.ndarray:
    """The Q-values of all cells and moves after so many random flights, (4, 4, 4)."""
    q = np.zeros((4, 4, 4))
    for _ in range(flights):
        cell, ended = start, False
        while not ended:
            action = int(generator.integers(4))
            after, reward, ended = step(cell, action)
            y = reward if ended else reward + gamma * q[after].max()
            q[cell][action] += alpha * (y - q[cell][action])
            cell = after
    return q


def learn_network(
    memory: Tensor, gamma: float, tau: float, updates: int
) -> tuple[nn.Module, list[float]]:
    """A network from cells, (B, 2), to Q-values, (B, 4), and the value of `START` at each update.

    Arguments:
        memory: the steps of `flights_of`.
        tau: of the target network; 1 for targets by the network itself.
    """
    online, target = (
        nn.Sequential(nn.Linear(2, 64), nn.ReLU(), nn.Linear(64, 4)) for _ in range(2)
    )
    target.load_state_dict(online.state_dict())
    optimiser, path = torch.optim.Adam(online.parameters(), lr=0.01), []
    for _ in range(updates):
        batch = memory[torch.randint(len(memory), (32,))]
        cell, action, reward, after, ended = batch.split([2, 1, 1, 2, 1], dim=1)
        with torch.no_grad():
            y = reward + gamma * (1 - ended) * target(after).amax(1, keepdim=True)
        loss = ((y - online(cell).gather(1, action.long())) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        soft_update(target, online, tau)
        path.append(online(torch.tensor(START).float()).max().item())
    return online, path
