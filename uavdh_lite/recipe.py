"""Recipes: all that a training run depends on, except the scenario and the seed."""

from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, Literal

import torch
from torch import nn

from uavdh_lite import registry
from uavdh_lite.channel import Channel
from uavdh_lite.city import City
from uavdh_lite.config import from_json, option, require, require_name
from uavdh_lite.ddqn import DDQN
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation


@dataclass(frozen=True)
class Recipe:
    """The constants of a training run; the defaults make the recipe `paper`.

    The paper's text describes the method and gives none of these numbers. Those that the method has
    are the defaults of the classes in the authors' code; what it does not have is off.

    A subclass may have more fields, and other parts: it overrides the methods that make them, and
    names the class that runs the training. That is a name, since trainings stand above recipes.
    """

    trainer: ClassVar[str] = "uavdh_lite.training:Trainer"  # imported when a training begins

    name: str
    steps: int = option(1_000_000, "environment steps in all, including the prefill", ge=1)
    # What the network sees
    observation: Literal["centred", "non_centred"] = option("centred", "kind of map")
    data_scale: float = option(1.0, "data units by which the data on the maps is divided", gt=0)
    time_scale: float = option(1.0, "units of time by which the flying time is divided", gt=0)
    # Network
    kernels: int = option(16, "kernels of each convolution", ge=1, le=1024)
    kernel_size: int = option(5, "side of a kernel, cells", ge=1, le=199)
    strides: tuple[int, ...] = option((1, 1), "stride of each convolution", ge=1, le=199)
    hidden: tuple[int, ...] = option(
        (256, 256, 256), "units of each fully connected layer", ge=1, le=10_000
    )
    layer_norm: bool = option(False, "LayerNorm in each fully connected layer, before its ReLU")
    leak: float = option(0.0, "slope of the ReLUs below 0; 0: plain ReLUs", ge=0)
    # Learning
    discount: float = option(0.95, "discount factor γ", ge=0, le=1)
    return_steps: int = option(1, "number n of steps whose rewards a target adds", ge=1, le=1000)
    target_update_rate: float = option(0.005, "soft update rate τ of the target", gt=0, le=1)
    learning_rate: float = option(3e-5, "Adam's learning rate at the start", gt=0)
    learning_rate_end: float | None = option(None, "the same at the end; none: constant", ge=0)
    amsgrad: bool = option(True, "Adam's amsgrad variant")
    huber_delta: float | None = option(
        None, "error from which the loss is linear; none: never", gt=0
    )
    batch_size: int = option(128, "transitions in a minibatch", ge=1, le=100_000)
    # Experience
    environments: int = option(1, "episodes at a time; one update follows each step of all", ge=1)
    replay_capacity: int = option(50_000, "transitions in the replay memory", ge=1, le=100_000_000)
    replay_prefill: int = option(25_000, "random transitions before learning begins", ge=1)
    temperature: float = option(0.1, "temperature β of the softmax policy at the start", gt=0)
    temperature_end: float | None = option(None, "β after its decay; none: constant", gt=0)
    temperature_decay: float = option(0.5, "share of the run in which β decays", ge=0, le=1)
    crash_reward: float = option(-150.0, "reward for running out of time, r_crash, at the start")
    crash_reward_end: float | None = option(None, "r_crash after its growth; none: constant")
    crash_reward_growth: float = option(0.5, "share of the run in which r_crash grows", ge=0, le=1)
    movement_reward: float = option(-0.2, "reward for each step without a landing, r_mov")
    exploring_starts: float = option(0.0, "share of episodes that start under way", ge=0, le=1)
    exploring_spare_time: int = option(5, "time that such episodes have beyond the way home", ge=0)
    # Which agent of a run is kept; validation is on the same missions each time
    kept_by: Literal["test_flights", "validation"] = option(
        "test_flights",
        "the agent kept has the highest collected and landed in the last 50 test flights, or the "
        "highest return in validation",
    )
    validation_interval: int = option(50_000, "environment steps between greedy validations", ge=1)
    validation_episodes: int = option(1000, "missions of each validation", ge=1, le=100_000)

    def __post_init__(self):
        require(self, f"recipe {self.name}")
        require_name(self.name, "recipe")
        # A minibatch holds the newest transition of each environment, and no transition twice
        growing = ("environments", "batch_size", "replay_prefill", "replay_capacity")
        for less, more in (*pairwise(growing), ("replay_prefill", "steps")):
            value, most = getattr(self, less), getattr(self, more)
            if value > most:
                raise InputError(
                    f"recipe {self.name}: {less} is {value}, must be at most {more}, {most}"
                )

    def training_rewards_at(self, steps: int) -> Rewards:
        """The rewards that the agent learns from after this many environment steps.

        What is reported has the constants of `Rewards()` instead, so that agents compare.
        """
        over = self.crash_reward_growth * self.steps
        crash = ramp(self.crash_reward, self.crash_reward_end, steps, over)
        return Rewards(crash=crash, movement=self.movement_reward)

    def temperature_at(self, steps: int) -> float:
        """β after this many environment steps."""
        over = self.temperature_decay * self.steps
        return ramp(self.temperature, self.temperature_end, steps, over)

    def learning_rate_at(self, steps: int) -> float:
        """The learning rate after this many environment steps."""
        return ramp(self.learning_rate, self.learning_rate_end, steps, self.steps)

    def environment_for(
        self, city: City | tuple[City, ...], channel: Channel | None = None
    ) -> Environment:
        """What the agent learns in and flies in; with the paper's channel if none is given."""
        return Environment(city, channel or Channel())

    def observation_for(self, environment: Environment, size: int = 0) -> Observation:
        """What the network sees, for cities of up to `size` cells on a side if that is more."""
        return Observation(environment, self.observation, self.data_scale, self.time_scale, size)

    def network_for(self, observation: Observation) -> nn.Module:
        """The network that learns; its weights come from torch's global generator."""
        return QNetwork(observation.map_shape, **self.network_options())

    def network_options(self) -> dict[str, Any]:
        """The constants of the network's layers, by the names that networks give them."""
        names = "kernels", "kernel_size", "strides", "hidden", "layer_norm", "leak"
        return {name: getattr(self, name) for name in names}

    def learner_for(self, observation: Observation, network: nn.Module) -> DDQN:
        """The algorithm that trains the network."""
        optimiser = self.optimiser_for(network)
        return DDQN(observation, network, optimiser, self.target_update_rate, self.huber_delta)

    def optimiser_for(self, network: nn.Module) -> torch.optim.Optimizer:
        """Adam over the network's weights, with the ε of the authors' framework, Keras."""
        return torch.optim.Adam(
            network.parameters(), self.learning_rate, eps=1e-7, amsgrad=self.amsgrad, fused=True
        )

    def as_json(self) -> dict:
        """The fields, and the class as `kind`, as JSON values; `recipe_from_json` undoes it."""
        return {"kind": type(self).__name__, **asdict(self)}


registry.register("recipe kind", "Recipe", Recipe)


def recipe_from_json(values: Any) -> Recipe:
    """The recipe with these fields; `InputError` names the one that is wrong."""
    fields = dict(values) if isinstance(values, dict) else {}
    return from_json(registry.find("recipe kind", fields.pop("kind", None)), fields, "recipe")


def ramp(start: float, end: float | None, step: float, over: float) -> float:
    """Linear from `start` at step 0 to `end` at step `over`, and `end` from then on."""
    if end is None:
        return start
    share = min(step / over, 1.0) if over > 0 else 1.0
    return start + (end - start) * share


PAPER = Recipe("paper")

PLAIN = replace(PAPER, name="plain", kernel_size=4, strides=(3, 1), learning_rate=3e-4)
"""The paper's algorithm and nothing else, with a network that a processor can afford.

It departs from `PAPER` in two things: the first convolution moves by three cells, so that an update
costs about an eighth, with kernels of 4×4, which then cover the map's 31 rows exactly; and the
learning rate fits that.
"""

LITE = replace(
    PAPER,
    name="lite",
    steps=2_000_000,
    data_scale=20.0,
    time_scale=10.0,
    kernel_size=4,
    strides=(3, 1),
    layer_norm=True,
    leak=0.1,
    return_steps=3,
    learning_rate=6e-4,
    learning_rate_end=0.0,
    huber_delta=10.0,
    environments=32,
    crash_reward=-10.0,
    crash_reward_end=-150.0,
    crash_reward_growth=1.0,
    kept_by="validation",
    validation_interval=100_000,
)
"""A strengthened DDQN, made to learn within an hour on one core of a CPU.

It departs from `PAPER` in nine things. Each has its reason in
`docs/project/differences_from_the_paper.md`, and its measurement in `docs/results/recipe.md`.
"""

SMALL = replace(
    PAPER,
    name="small",
    # A village and a minute: a small network, an update for 16 steps, and a rate to match
    steps=144_000,
    kernels=8,
    kernel_size=3,
    strides=(2, 2),
    hidden=(128, 128),
    learning_rate=2e-3,
    learning_rate_end=0.0,  # the last updates settle what the first ones found
    batch_size=64,
    environments=16,
    replay_capacity=40_000,
    replay_prefill=2_000,
    # The one departure that decides: who fears a crash before knowing the data lands at once
    crash_reward=-5.0,
    crash_reward_end=-20.0,
    crash_reward_growth=0.75,
    kept_by="validation",
    validation_interval=24_000,
    validation_episodes=200,
)
"""The paper's algorithm for the small city `village`, where it learns within a minute."""

for recipe in (PAPER, PLAIN, LITE, SMALL):
    registry.register("recipe", recipe.name, recipe)


def find_recipe(name: str) -> Recipe:
    """The recipe of this name; raises `InputError` with the known names."""
    return registry.find("recipe", name)
