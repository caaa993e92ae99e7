"""Copy a planner: learn which action it takes, by cross-entropy, and ask it again where one errs.

The planner is a narrow `Genie`, which searches whole flights with the mean rates. Its flights fill
the replay memory, and the network learns to name its action: the loss is the cross-entropy of a
softmax over the network's outputs. No reward is needed. The flights begin

- at ordinary starts and at exploring starts, as in any training (`exploring_starts`), and
- where the learner itself has flown (`own_starts`): it meets states that the planner avoids, and
  must learn how the planner goes on from there (as in DAgger, Ross et al., AISTATS 2011).

The loop is that of every training: act, step, add, sample, update. Only who acts, and the loss,
are others. A turned or mirrored map is the same task, so each minibatch shows all eight views.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.beyond.symmetry import SYMMETRIES, in_view
from uavdh_lite.ddqn import DDQN
from uavdh_lite.environment import State
from uavdh_lite.evaluation import fly
from uavdh_lite.recipe import Recipe
from uavdh_lite.replay import Batch
from uavdh_lite.scenario import Scenario
from uavdh_lite.training import Trainer

PLANNED_AT_A_TIME = 32  # flights that are planned at a time
EIGHTHS = [slice(first, None, len(SYMMETRIES)) for first in range(len(SYMMETRIES))]


class Cloning(DDQN):
    """The network names the planner's action: its outputs are scores, not returns."""

    def targets(self, batch: Batch) -> Tensor:
        """The planner's actions, (B,)."""
        return self.tensor(batch.action)

    def loss(self, batch: Batch, y: Tensor) -> Tensor:
        """The mean cross-entropy, an eighth of the minibatch in each of the views."""
        seen, pairs = self.observation(batch.state), list(zip(EIGHTHS, SYMMETRIES, strict=True))
        scores = torch.cat(
            [in_view(self.online, *view, *(part[rows] for part in seen)) for rows, view in pairs]
        )
        actions = torch.cat([y[rows] for rows in EIGHTHS])
        return cross_entropy(scores, actions, reduction="none").mean()


class Imitation(Trainer):
    """A training in which a planner flies, and the network learns what it does.

    An environment step is a label. The recipe is an `ImitationRecipe`.
    """

    JSON_STATE = (*Trainer.JSON_STATE, "plans", "waiting")
    recipe: Any
    learner: Cloning

    def __init__(self, scenario: Scenario, recipe: Recipe, *arguments, **options):
        # The planned actions of each environment, and the planned flights that have not begun. Both
        # come first, since the first flights begin in `Trainer.__init__`
        self.plans: list[list[int]] = [[]] * recipe.environments
        self.waiting: list[tuple[bool, list[int], Sequence]] = []
        super().__init__(scenario, recipe, *arguments, **options)

    def _act(self, state: State) -> np.ndarray:
        """The planner's actions."""
        times = state.time_left.tolist()
        return np.array([plan[-time] for plan, time in zip(self.plans, times, strict=True)])

    def _starts(self, environments: np.ndarray) -> State:
        """The starts of flights that are planned."""
        while len(self.waiting) < len(environments):
            self.waiting += self._planned()
        rows = []
        for environment in environments:
            self.from_start[environment], self.plans[environment], row = self.waiting.pop(0)
            rows.append(row)
        self.returns[environments] = 0
        types = [self.replay.states[f.name].dtype for f in fields(State)]
        return State(*map(np.array, zip(*rows, strict=True), types))

    def _planned(self) -> list[tuple[bool, list[int], Sequence]]:
        """Draw starts of every kind and plan their flights: (from a start, actions, state) each."""
        start, drawn = self._draw_starts(PLANNED_AT_A_TIME)
        under_way = drawn < self.recipe.exploring_starts
        own = drawn >= 1 - self.recipe.own_starts * bool(self.updates)  # not before it has learned
        if own.any():
            start = start.with_rows(own, self._own_states(start[own]))
        plans = Genie(self.environment, beam=1, grow=False).plans(start)
        rows = zip(*(getattr(start, f.name).tolist() for f in fields(State)), strict=True)
        return [
            (not other, plan.actions.tolist(), row)
            for other, plan, row in zip((under_way | own).tolist(), plans, rows, strict=True)
            if plan.value > -np.inf  # no landing is possible any more
        ]

    def _own_states(self, start: State) -> State:
        """A random state of each flight that the learner makes from these starts."""
        flights = fly(self.environment, self.agent, start, self.generator)
        step = self.generator.integers(0, flights.steps)
        return State.concatenate([flights.history[t].state[[i]] for i, t in enumerate(step)])
