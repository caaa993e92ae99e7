"""Recipes with ideas from beyond the paper."""

from dataclasses import asdict, dataclass, replace
from typing import ClassVar

from torch import nn

from uavdh_lite import registry
from uavdh_lite.beyond.failsafe import MaskedNetwork, SafeEnvironment, SafeObservation
from uavdh_lite.beyond.global_local import GlobalLocalNetwork
from uavdh_lite.beyond.imitation import Cloning
from uavdh_lite.beyond.told import ToldObservation
from uavdh_lite.channel import Channel
from uavdh_lite.city import City
from uavdh_lite.config import option
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import LITE, PAPER, Recipe, ramp


class SafeToldObservation(ToldObservation, SafeObservation):
    """What is told, and which actions are allowed."""


@dataclass(frozen=True)
class BeyondRecipe(Recipe):
    """A recipe with parts that the paper does not have; each is off by default."""

    failsafe: bool = option(
        False, "the safety controller brings the UAV home in time; landing is not learned"
    )
    told: bool = option(
        False, "three more layers tell what can be computed: expected data, way home, way there"
    )
    pooling: int = option(
        0, "two maps, one averaged over cells of this side; 0: one map, all of it", ge=0
    )
    local_size: int = option(17, "side of the map around the UAV, cells (with pooling)", ge=1)

    def __post_init__(self):
        super().__post_init__()
        if self.pooling and (self.observation != "centred" or self.local_size % 2 == 0):
            raise InputError(
                f"recipe {self.name}: pooling needs the observation centred and an odd local_size"
            )

    def environment_for(
        self, city: City | tuple[City, ...], channel: Channel | None = None
    ) -> Environment:
        if self.failsafe:
            return SafeEnvironment(city, channel or Channel())
        return super().environment_for(city, channel)

    def observation_for(self, environment: Environment, size: int = 0) -> Observation:
        kind = ToldObservation if self.told else Observation
        if self.failsafe:
            kind = SafeToldObservation if self.told else SafeObservation
        return kind(environment, self.observation, self.data_scale, self.time_scale, size)

    def network_for(self, observation: Observation) -> nn.Module:
        network: nn.Module
        if self.pooling:
            maps = (self.pooling, min(self.local_size, observation.width))
            network = GlobalLocalNetwork(observation.map_shape, *maps, **self.network_options())
        else:
            network = super().network_for(observation)
        return MaskedNetwork(network) if self.failsafe else network


@dataclass(frozen=True)
class ImitationRecipe(BeyondRecipe):
    """A recipe that copies a planner, an environment step a label, and may then learn by reward."""

    trainer: ClassVar[str] = "uavdh_lite.beyond.reinforce:Reinforced"
    all_views: ClassVar[bool] = True  # its minibatches show a map turned and mirrored, too

    own_starts: float = option(
        0.0, "share of the planned flights that begin where the learner has flown", ge=0, le=1
    )
    labels: int | None = option(
        None, "environment steps that copy; later steps learn from reward; none: all copy", ge=1
    )
    reward_learning_rate: float = option(1e-4, "learning rate for rewards; it falls to 0", gt=0)

    def learning_rate_at(self, steps: int) -> float:
        labels = self.steps if self.labels is None else min(self.labels, self.steps)
        if steps < labels:
            return ramp(self.learning_rate, self.learning_rate_end, steps, labels)
        return ramp(self.reward_learning_rate, 0.0, steps - labels, self.steps - labels)

    def learner_for(self, observation: Observation, network: nn.Module) -> Cloning:
        return Cloning(observation, network, self.optimiser_for(network), self.target_update_rate)


registry.register("recipe kind", "BeyondRecipe", BeyondRecipe)
registry.register("recipe kind", "ImitationRecipe", ImitationRecipe)

TOLD = replace(
    BeyondRecipe(**asdict(LITE)),
    name="told",
    steps=1_500_000,
    data_scale=5.0,
    failsafe=True,
    told=True,
    pooling=3,
    kernel_size=3,
    strides=(1, 2),
    crash_reward=PAPER.crash_reward,
    crash_reward_end=None,
    exploring_starts=0.0,
)
"""`LITE` with a guarantee and with what can be computed, still learned from reward:

- `failsafe`: nothing crashes, so the agent need not learn from crashes. It needs no `crash_reward`
  that grows, and no `exploring_starts`.
- `told`: where data can be expected, and which way leads where.
- `pooling` 3, two resolutions, with kernels of 3×3 and a first stride of 1: the network sees each
  cell near the UAV, and the rest coarsely. A first stride of 3 over the whole map blurs what the
  UAV has to fly around.
- `data_scale` 5: the average over 3×3 cells makes a device's data nine times as small.
"""

IMITATION = replace(
    ImitationRecipe(**asdict(TOLD)),
    name="imitation",
    steps=2_000_000,
    labels=600_000,
    kernels=32,
    huber_delta=None,
    learning_rate=1e-3,
    batch_size=256,
    replay_capacity=700_000,
    exploring_starts=0.33,
    own_starts=0.33,
    validation_interval=100_000,
)
"""`TOLD`, but it copies the genie, and then learns by reward.

Of the genie's flights a third begin as missions do, a third in mid-flight, and a third where the
learner has flown.
"""

for recipe in (TOLD, IMITATION):
    registry.register("recipe", recipe.name, recipe)
