"""An agent: a trained network, and everything needed to fly with it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.city import Cities, City, one_city
from uavdh_lite.ddqn import only_allowed
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation
from uavdh_lite.quantile import QuantileNetwork
from uavdh_lite.recipe import Recipe
from uavdh_lite.scenario import Scenario
from uavdh_lite.symmetry import mean_over_symmetries

CHUNK = 256  # states a forward pass: more would only spill out of the processor's cache

NETWORK = (
    "observation",
    "data_scale",
    "time_scale",
    "pooling",
    "local_size",
    "kernels",
    "kernel_size",
    "strides",
    "hidden",
    "layer_norm",
    "leak",
    "quantiles",
)
"""The fields of a recipe on which `build` depends."""


def build(recipe: Recipe, city: City | Cities, size: int = 0) -> tuple[Observation, QNetwork]:
    """The observation and the untrained network of a recipe for a city, or for several.

    The network is made for cities of up to `size` cells on a side, or for the largest given.
    The weights come from torch's global generator; wrap the call in `torch.random.fork_rng` to
    leave it unchanged.
    """
    observation = Observation(
        city,
        recipe.observation,
        recipe.data_scale,
        recipe.time_scale,
        recipe.pooling,
        recipe.local_size,
        size,
    )
    layers = (
        observation.map_shapes(),
        recipe.kernels,
        recipe.kernel_size,
        recipe.strides,
        recipe.hidden,
        recipe.layer_norm,
        recipe.leak,
    )
    if recipe.quantiles:
        return observation, QuantileNetwork(*layers, quantiles=recipe.quantiles)
    return observation, QNetwork(*layers)


def choices(environment: Environment, state: State) -> Tensor | None:
    """What a learner chooses from: the allowed actions, (B, 6) bool; None, for all of them,
    without the failsafe.
    """
    if not environment.failsafe:
        return None
    return torch.from_numpy(environment.allowed_actions(state))


@dataclass(frozen=True, eq=False)
class Agent:
    """The greedy policy of a network: `agent(state)` gives the actions, (B,) ints.

    Trained with the failsafe, it chooses among the allowed actions, in any environment.

    | field | meaning |
    | --- | --- |
    | `network`, `observation` | the network and what it sees, on one device |
    | `recipe`, `scenario` | what it was trained with |
    | `city` | the city that it flies over, or the cities that it was trained in |
    | `training` | seed, cities, environment steps, validation metrics, command, versions |
    | `symmetric` | act on the mean Q-values over the eight symmetries |
    """

    network: nn.Module
    observation: Observation
    recipe: Recipe
    scenario: Scenario
    city: City | Cities
    training: dict = field(default_factory=dict)
    symmetric: bool = False

    @torch.no_grad()
    def q_values(self, state: State) -> Tensor:
        """Q-values of all actions, (B, 6), on the CPU."""
        return self._in_chunks(self.network, state)

    @torch.no_grad()
    def returns(self, state: State) -> Tensor | None:
        """Quantiles of each action's return at the levels of `midpoints`, (B, 6, N), on the CPU.

        Their mean is the Q-value. None if the network learned the mean alone.
        """
        if not isinstance(self.network, QuantileNetwork):
            return None
        return self._in_chunks(self.network.quantiles, state)

    def _in_chunks(self, head: Callable[[list[Tensor], Tensor], Tensor], state: State) -> Tensor:
        chunks = (state[start : start + CHUNK] for start in range(0, len(state), CHUNK))
        return torch.cat([self._values(head, chunk).cpu() for chunk in chunks])

    def _values(self, head: Callable[[list[Tensor], Tensor], Tensor], state: State) -> Tensor:
        observation = self.observation
        if not self.symmetric:
            return head(*observation(state))
        time = observation.time(state)
        return mean_over_symmetries(
            lambda maps: head(observation.views(maps), time), observation.full_map(state)
        )

    def __call__(self, state: State) -> np.ndarray:
        return only_allowed(self.q_values(state), self.allowed(state)).argmax(dim=1).numpy()

    @cached_property
    def environment(self) -> Environment:
        """The city or cities, with the failsafe if the recipe has it."""
        return Environment(self.city, failsafe=self.recipe.failsafe)

    def allowed(self, state: State) -> Tensor | None:
        """The actions it chooses from, (B, 6) bool; without the failsafe None, for all of them.

        It never took the other actions in training, so their Q-values mean nothing.
        """
        return choices(self.environment, state)

    def knows(self, city: City | Cities) -> bool:
        """Whether it was trained for this city: in it, or in many of its size or larger ones."""
        if city.fingerprint == self.city.fingerprint:
            return True
        return self.training.get("cities", 1) > 1 and city.size <= self.observation.size

    def over(self, city: City | Cities) -> "Agent":
        """The same network over another city, or several; a smaller one lies in no-fly cells.

        Raises `InputError` for a larger city: the network's first fully connected layer is made
        for maps of one size only.
        """
        if city.fingerprint == self.city.fingerprint:
            return self
        size = self.observation.size
        if city.size > size:
            raise InputError(
                f"this agent was trained for cities of up to {size} cells on a side "
                f"({self.city.name}), {city.name} has {city.size}: train one for it"
            )
        observation, _ = build(self.recipe, city, size)
        device = next(self.network.parameters()).device
        return replace(self, city=city, observation=observation.to(device))


def saliency(agent: Agent, state: State) -> np.ndarray:
    """How much the best action's Q-value depends on each cell of what the network sees; (W, W).

    This is the magnitude of gradient times input, summed over the layers of the observation's
    `full_map`: to first order, how much the Q-value would change if the cell were empty.

    Arguments:
        state: a batch of one.
    """
    observation = agent.observation
    layers = observation.full_map(state).requires_grad_()
    q_values = agent.network(observation.views(layers), observation.time(state)).cpu()
    best = only_allowed(q_values, agent.allowed(state)).max()
    (gradient,) = torch.autograd.grad(best, layers)
    return (gradient * layers.detach())[0].abs().sum(0).cpu().numpy()


def value_map(agent: Agent, state: State) -> np.ndarray:
    """The largest Q-value if the UAV were over each cell, all else equal; (M, M).

    It is NaN in cells over which the UAV may not fly.

    Arguments:
        state: a batch of one.
    """
    city = one_city(agent.city)
    cells = city.flight_cells
    elsewhere = replace(state[np.zeros(len(cells), int)], uav_cell=cells.astype(np.int16))
    values = np.full(city.size**2, np.nan)
    q_values = only_allowed(agent.q_values(elsewhere), agent.allowed(elsewhere))
    values[cells] = q_values.max(dim=1).values
    return values.reshape(city.size, city.size)
