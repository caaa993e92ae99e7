"""An agent: a trained network, and everything needed to fly with it."""

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.channel import Channel
from uavdh_lite.city import City, fingerprint_of
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Policy, in_flight
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import Recipe
from uavdh_lite.scenario import Scenario

CHUNK = 256  # states a forward pass: more would only spill out of the processor's cache


@dataclass(frozen=True, eq=False)
class Agent(Policy):
    """The greedy policy of a network (eq. 9): the action with the largest Q-value, whatever comes.

    The rule `Greedy` is another thing: it looks at no network, and goes for the nearest device.

    | field | meaning |
    | --- | --- |
    | `network`, `observation` | the network and what it sees, on one device |
    | `recipe`, `scenario` | what it was trained with |
    | `training` | seed, environment steps, validation metrics, command, versions |
    | `trained_in` | the cities that it was trained in; by default those that it flies over |
    """

    network: nn.Module
    observation: Observation
    recipe: Recipe
    scenario: Scenario
    training: dict = field(default_factory=dict)
    trained_in: tuple[City, ...] = ()

    def __post_init__(self):
        object.__setattr__(self, "trained_in", self.trained_in or self.cities)

    @property
    def environment(self) -> Environment:
        """What it flies in."""
        return self.observation.environment

    @property
    def cities(self) -> tuple[City, ...]:
        """The cities that it flies over."""
        return self.environment.cities

    @property
    def city(self) -> City:
        """The city that it flies over; raises `InputError` if there are several."""
        if len(self.cities) > 1:
            raise InputError(
                f"this agent flies over {len(self.cities)} cities: choose one, with "
                "agent.over(city), on the command line with --city"
            )
        return self.cities[0]

    @torch.no_grad()
    def q_values(self, state: State) -> Tensor:
        """Q-values of all actions, (B, 6), on the CPU."""
        chunks = [state[start : start + CHUNK] for start in range(0, len(state), CHUNK)]
        return torch.cat([self.network(*self.observation(chunk)).cpu() for chunk in chunks])

    def act(self, state: State) -> np.ndarray:
        """The actions with the largest Q-values, (B,) ints; `hover` where the episode is over."""
        return in_flight(state, lambda flying: self.q_values(flying).argmax(dim=1).numpy())

    def knows(self, cities: tuple[City, ...]) -> bool:
        """Whether it was trained for these cities: in them, or in many that are as large."""
        own = self.trained_in
        if fingerprint_of(cities) == fingerprint_of(own):
            return True
        largest = max(city.size for city in cities)
        return len(own) > 1 and largest <= max(city.size for city in own)

    def over(self, city: City | tuple[City, ...], channel: Channel | None = None) -> "Agent":
        """The same network over another city, or several, no larger than it was made for.

        The radio channel stays its own unless another is given.

        Raises `InputError` for a larger city: the network's first fully connected layer is made
        for maps of one size only.
        """
        channel, size = channel or self.environment.channel, self.observation.size
        environment = self.recipe.environment_for(city, channel)
        if environment.size > size:
            names = ", ".join(city.name for city in environment.cities[:3])
            raise InputError(
                f"this agent was trained for cities of up to {size} cells on a side, here are "
                f"{environment.size} ({names}): train one for them"
            )
        observation = self.recipe.observation_for(environment, size)
        return replace(self, observation=observation.to(next(self.network.parameters()).device))
