"""Combined experience replay of compact states; maps are never stored."""

from dataclasses import dataclass

import numpy as np

from uavdh_lite.environment import State


@dataclass(frozen=True)
class Batch:
    """A minibatch of transitions, each over up to n steps.

    | field | shape | meaning |
    | --- | --- | --- |
    | `state` | B states | s(t) |
    | `action` | (B,) int64 | a(t) |
    | `reward` | (B,) float32 | r(t) + γ r(t+1) + … over m ≤ n steps |
    | `discount` | (B,) float32 | γ^m, or 0 if the episode ended within the m steps |
    | `next_state` | B states | s(t+m); meaningless where the discount is 0 |
    """

    state: State
    action: np.ndarray
    reward: np.ndarray
    discount: np.ndarray
    next_state: State


class Replay:
    """A ring buffer of the last `capacity` transitions of N environments stepped together.

    A **row** holds what one step of all environments began with and did; the row after it holds
    what followed, so a state is stored once. The newest states, without an action yet, are in the
    row `head`. A transition can be drawn once the n steps whose rewards it sums are stored. The
    ring for n = 3:

    ```text
    row    …  head − 5   head − 4   head − 3 │ head − 2   head − 1 │ head
              can be drawn                   │ n − 1 not yet       │ no action yet
    ```

    Combined experience replay (Zhang and Sutton, 2017) puts the newest transition into every
    minibatch; with N environments, the newest N: those of row head − n.

    Arguments:
        capacity: transitions in all, rounded up to whole steps of all N.
        environments: N.
        max_devices: K of the states.
        discount: γ.
        return_steps: n; fewer steps are summed only if the episode ends.
    """

    def __init__(
        self,
        capacity: int,
        environments: int,
        max_devices: int,
        discount: float,
        return_steps: int = 1,
    ):
        self.discount, self.return_steps = np.float32(discount), return_steps
        rows = -(-capacity // environments) + return_steps  # n more, which cannot be drawn yet
        lead, devices = (rows, environments), (rows, environments, max_devices)
        self.states: dict[str, np.ndarray] = {
            "uav_cell": np.zeros(lead, np.int16),
            "time_left": np.zeros(lead, np.int16),
            "device_cells": np.zeros(devices, np.int16),
            "data_initial": np.zeros(devices, np.float32),
            "data_left": np.zeros(devices, np.float32),
            "landed": np.zeros(lead, bool),
            "city": np.zeros(lead, np.int16),
        }
        self.action = np.zeros(lead, np.int8)
        self.reward = np.zeros(lead, np.float32)
        self.terminal = np.zeros(lead, bool)
        self.head = 0
        self.filled = 0  # rows with an action

    def __len__(self) -> int:
        """The number of transitions that can be drawn."""
        return max(self.filled - self.return_steps + 1, 0) * self.action.shape[1]

    def state_dict(self) -> dict[str, np.ndarray]:
        """All that is stored, by name; only `place` is a copy."""
        return {
            **self.states,
            "action": self.action,
            "reward": self.reward,
            "terminal": self.terminal,
            "place": np.array([self.head, self.filled]),
        }

    def load_state_dict(self, arrays: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` gave, for a memory of the same size."""
        for name, array in self.state_dict().items():
            array[:] = arrays[name]
        self.head, self.filled = arrays["place"].tolist()

    def add(self, state: State, action: np.ndarray, reward: np.ndarray, next_state: State) -> None:
        """Store one step of all N environments; the oldest step makes room.

        `next_state` is what followed, before new episodes replace those that ended. The new ones
        are the `state` of the next call, which overwrites it.
        """
        self._write(self.head, state)
        self.action[self.head] = action
        self.reward[self.head] = reward
        self.terminal[self.head] = next_state.ended
        self.head = (self.head + 1) % len(self.action)
        self._write(self.head, next_state)
        self.filled = min(self.filled + 1, len(self.action) - 1)

    def _write(self, row: int, state: State) -> None:
        for name, array in self.states.items():
            array[row] = getattr(state, name)

    def _read(self, row: np.ndarray, column: np.ndarray) -> State:
        row = row % len(self.action)
        return State(**{name: array[row, column] for name, array in self.states.items()})

    def sample(self, size: int, generator: np.random.Generator) -> Batch:
        """Draw `size` different transitions: the newest of each environment, then others uniformly.

        There must be as many: `size` is at most `len(self)`.
        """
        rows, environments = self.action.shape
        others = generator.choice(len(self) - environments, size - environments, replace=False)
        before, column = np.divmod(np.r_[:environments, environments + others], environments)
        row = self.head - self.return_steps - before
        reward, discount = np.zeros(size, np.float32), np.ones(size, np.float32)
        after = row.copy()
        for k in range(self.return_steps):
            here = (row + k) % rows, column
            reward += discount * self.reward[here]
            after += discount > 0
            discount *= self.discount * ~self.terminal[here]
        action = self.action[row % rows, column].astype(np.int64)
        return Batch(self._read(row, column), action, reward, discount, self._read(after, column))
