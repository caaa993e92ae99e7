"""Learn by reward what a copy cannot know: a policy gradient from flights of one mission.

A copy makes errors that it does not know of, and its planner knows only mean rates. Here the agent
flies each of some missions several times, and draws its actions from the softmax over its scores.
What it did becomes likelier if the flight brought more than the others of its mission did, and less
likely if it brought less: REINFORCE with a leave-one-out baseline (Kool et al., ICLR workshop
2019), and the clipped ratio of PPO (Schulman et al., 2017), since several updates are made from the
same flights. No network has to learn values for that.
"""

import numpy as np
import torch
from torch.nn.functional import cross_entropy
from torch.nn.utils import clip_grad_norm_

from uavdh_lite.beyond.imitation import Imitation
from uavdh_lite.ddqn import draw_actions, softmax_policy
from uavdh_lite.environment import State
from uavdh_lite.evaluation import Flights, FunctionPolicy, fly
from uavdh_lite.training import CURVES

MISSIONS, FLIGHTS = 32, 8  # flown at a time, and how often each
SURE = 0.98  # a choice with a likelier action than this has next to nothing to learn
CLIP = 0.2  # an action that became likelier by more than this share is not pushed any further
LONGEST = 1.0  # norm of the gradient


class Reinforced(Imitation):
    """A training that copies a planner for `recipe.labels` steps, and then learns by reward."""

    def step(self) -> None:
        """A step of the imitation; after it, many flights at once, and updates from all of them."""
        labels = self.recipe.labels
        if labels is None or self.steps < labels:
            super().step()
            if labels is not None and self.steps >= labels:
                self.learner.optimiser.state.clear()  # its moments are of much smaller gradients
        else:
            self._practise()

    def _practise(self) -> None:
        """Fly to the end, and take one gradient step for each minibatch of unsure choices."""
        recipe, generator = self.recipe, self.generator
        self.learner.set_learning_rate(recipe.learning_rate_at(self.steps))
        start = self.scenario.sample(self.environment, MISSIONS, generator)
        flights, unsure, surprise = self._drawn_flights(
            start[np.repeat(np.arange(MISSIONS), FLIGHTS)]
        )
        flown = [~step.state.ended for step in flights.history]
        pairs = list(zip(flights.history, flown, strict=True))
        state = State.concatenate([step.state[rows] for step, rows in pairs])
        action = np.concatenate([step.action[rows] for step, rows in pairs])
        gain = np.concatenate([advantages(flights.returns)[rows] for rows in flown])
        order = generator.permutation(np.flatnonzero(unsure))
        size = recipe.batch_size
        for rows in order[: len(order) // size * size].reshape(-1, size):
            self.losses.append(self._update(state[rows], action[rows], gain[rows], surprise[rows]))
            self.updates += 1
        records = flights.records()
        self.episodes += np.stack([records[name] for name in CURVES], axis=1).tolist()
        self.ended += len(start) * FLIGHTS
        self.steps += len(state)
        self._add_row()

    def _drawn_flights(self, start: State) -> tuple[Flights, np.ndarray, np.ndarray]:
        """Flights of the softmax policy; of each choice, whether it was unsure, and its surprise,
        −log of the action's probability."""
        agent, unsure, surprise = self.agent, [], []

        def draw(state: State) -> np.ndarray:
            shares = softmax_policy(agent.q_values(state), 1.0)
            action = draw_actions(shares, self.generator)
            unsure.append((shares.amax(1) < SURE).numpy())
            surprise.append(-np.log(shares.numpy()[np.arange(len(action)), action]))
            return action

        flights = fly(self.environment, FunctionPolicy(draw), start, self.generator)
        return flights, np.concatenate(unsure), np.concatenate(surprise)

    def _update(
        self, state: State, action: np.ndarray, gain: np.ndarray, surprise: np.ndarray
    ) -> float:
        """One gradient step that makes actions likelier by their gain; returns the loss."""
        learner, weight = self.learner, self.learner.tensor(gain)
        scores = learner.online(*learner.observation(state))
        now = cross_entropy(scores, learner.tensor(action), reduction="none")
        ratio = (learner.tensor(surprise) - now).exp()  # likelier than when drawn; (B,)
        loss = -torch.minimum(ratio * weight, ratio.clamp(1 - CLIP, 1 + CLIP) * weight).mean()
        learner.optimiser.zero_grad()
        loss.backward()
        clip_grad_norm_(learner.online.parameters(), LONGEST)
        learner.optimiser.step()
        return float(loss.detach())


def advantages(returns: np.ndarray) -> np.ndarray:
    """How much more each flight brought than the others of its mission; (MISSIONS·FLIGHTS,).

    In standard deviations of all these differences, so that the size of returns does not matter.
    """
    of_mission = returns.reshape(-1, FLIGHTS)
    others = (of_mission.sum(axis=1, keepdims=True) - of_mission) / (FLIGHTS - 1)
    gain = (of_mission - others).ravel()
    return gain / (gain.std() + np.float32(1e-6))
