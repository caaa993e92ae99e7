"""The failsafe: the safety controller brings the UAV home in time, so that nothing crashes.

Commercial drones have such a return-to-home function. The paper has none: its agents learn to land.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.ddqn import draw_actions
from uavdh_lite.environment import LAND, Environment, Outcome, State, checked_actions
from uavdh_lite.observation import Observation


@dataclass(frozen=True)
class SafeOutcome(Outcome):
    """An outcome that says where the way home replaced the action: `sent_home`, (B,) bool."""

    sent_home: np.ndarray

    def counts(self) -> dict[str, np.ndarray]:
        return {**super().counts(), "sent_home": self.sent_home}


@dataclass(frozen=True, eq=False)
class SafeEnvironment(Environment):
    """An `Environment` in which the UAV is home in time, whatever the policy does.

    If an action would make a landing impossible in the time left, the first move of a shortest path
    home replaces it. This costs no reward. So no policy crashes in an episode in which a landing is
    possible at all.
    """

    def allowed_actions(self, state: State) -> np.ndarray:
        """The actions that neither the safety controller nor the failsafe would replace; (B, 6)."""
        return super().allowed_actions(state) & ~self._too_late(state)

    def random_actions(self, state: State, generator: np.random.Generator) -> np.ndarray:
        """Allowed actions, all equally likely; (B,) ints."""
        allowed = torch.from_numpy(self.allowed_actions(state))
        return draw_actions(allowed / allowed.sum(dim=1, keepdim=True), generator)

    def transition(
        self, state: State, action: np.ndarray, fading: np.ndarray
    ) -> tuple[State, Outcome]:
        action = checked_actions(action, len(state))
        sent_home = ~state.ended & self._too_late(state)[np.arange(len(state)), action]
        action = np.where(sent_home, self.way_home[state.city, state.uav_cell], action)
        after, outcome = super().transition(state, action, fading)
        return after, SafeOutcome(**vars(outcome), sent_home=sent_home)

    def _too_late(self, state: State) -> np.ndarray:
        """The actions that miss the last chance to land; (B, 6) bool.

        A refused action counts as `hover`. If no landing is possible any more, there are none.
        """
        city, cell, time_left = state.city, state.uav_cell, state.time_left[:, None]
        possible = self.time_to_land[city, cell][:, None] <= time_left
        after = self.time_to_land[city[:, None], self.next_cell[city, cell]] <= time_left - 1
        after[:, LAND] |= ~self.forbidden[city, cell, LAND]
        return possible & ~after


class SafeObservation(Observation):
    """An observation and, with it, the allowed actions: `(map, time, allowed)`."""

    def forward(self, state: State) -> tuple[Tensor, ...]:
        allowed = torch.from_numpy(self.environment.allowed_actions(state))
        return *super().forward(state), allowed.to(self.surroundings.device)


class MaskedNetwork(nn.Module):
    """Q-values of a network, −∞ for the actions that are not allowed."""

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, map: Tensor, time: Tensor, allowed: Tensor) -> Tensor:
        return self.network(map, time).masked_fill(~allowed, -torch.inf)
