"""Recipes with ideas from beyond the paper, and the scenario over many cities."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from torch import nn

from uavdh_lite import registry
from uavdh_lite.beyond.advantage_learning import AdvantageLearning
from uavdh_lite.beyond.failsafe import MaskedNetwork, SafeEnvironment, SafeObservation
from uavdh_lite.beyond.global_local import GlobalLocalNetwork
from uavdh_lite.beyond.imitation import Cloning, Imitation
from uavdh_lite.beyond.quantile import QRDQN, QuantileNetwork
from uavdh_lite.beyond.told import ToldObservation
from uavdh_lite.beyond.views import EightViews
from uavdh_lite.city import City
from uavdh_lite.config import option
from uavdh_lite.ddqn import DDQN
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import LITE, PAPER, Recipe
from uavdh_lite.scenario import Scenario


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
    quantiles: int = option(
        0, "quantiles learned of each action's return (QR-DQN); 0: its mean alone (DDQN)", ge=0
    )
    advantage_learning: float = option(
        0.0, "share α of the action gap that is taken from the targets", ge=0, le=0.99
    )
    views: bool = option(False, "fly by the mean over the eight turned and mirrored maps")

    def __post_init__(self):
        super().__post_init__()
        if self.quantiles and self.huber_delta is None:
            raise InputError(
                f"recipe {self.name}: huber_delta is None, must be a number with quantiles"
            )
        if self.observation != "centred" and (self.views or self.pooling):
            raise InputError(
                f"recipe {self.name}: views and pooling need the observation centred, found "
                f"{self.observation}"
            )

    def environment_for(self, city: City | tuple[City, ...]) -> Environment:
        return SafeEnvironment(city) if self.failsafe else super().environment_for(city)

    def sees(self) -> type[Observation]:
        if self.told:
            return SafeToldObservation if self.failsafe else ToldObservation
        return SafeObservation if self.failsafe else Observation

    def network_for(self, observation: Observation) -> nn.Module:
        outputs = len(ACTIONS) * max(1, self.quantiles)
        options: Any = (self.kernels, self.kernel_size, self.strides, self.hidden)
        options = (*options, self.layer_norm, self.leak, outputs)
        network: nn.Module
        if self.pooling:
            maps = (self.pooling, self.local_size)
            network = GlobalLocalNetwork(observation.map_shape, *maps, *options)
        else:
            network = QNetwork(observation.map_shape, *options)
        network = QuantileNetwork(network) if self.quantiles else network
        return MaskedNetwork(network) if self.failsafe else network

    def flown(self, network: nn.Module) -> nn.Module:
        if not self.views:
            return network
        if isinstance(network, MaskedNetwork):
            return MaskedNetwork(EightViews(network.network))
        return EightViews(network)

    def algorithm(self) -> Callable[..., DDQN]:
        if not self.advantage_learning:
            return QRDQN if self.quantiles else DDQN
        kind = AdvantageQRDQN if self.quantiles else AdvantageDDQN
        return partial(kind, gap_share=self.advantage_learning)


class SafeToldObservation(ToldObservation, SafeObservation):
    """What is told, and which actions are allowed."""


@dataclass(frozen=True)
class ImitationRecipe(BeyondRecipe):
    """A recipe that copies a planner; `environments` fly side by side, a step is a label."""

    own_starts: float = option(
        0.0, "share of the planned flights that begin where the learner has flown", ge=0, le=1
    )

    def algorithm(self) -> Callable[..., DDQN]:
        return Cloning


class AdvantageDDQN(AdvantageLearning, DDQN):
    """Double Q-learning with wider gaps."""


class AdvantageQRDQN(AdvantageLearning, QRDQN):
    """Quantile regression with wider gaps."""


registry.register("recipe kind", "BeyondRecipe", BeyondRecipe)
registry.register("recipe kind", "ImitationRecipe", ImitationRecipe)
registry.register("trainer", "ImitationRecipe", Imitation)

QUANTILE = replace(
    BeyondRecipe(**asdict(LITE)),
    name="quantile",
    steps=1_500_000,
    data_scale=5.0,
    failsafe=True,
    pooling=3,
    kernel_size=3,
    strides=(1, 2),
    quantiles=8,
    discount=0.97,
    huber_delta=1.0,
    advantage_learning=0.8,
    crash_reward=PAPER.crash_reward,
    crash_reward_end=None,
    exploring_starts=0.0,
)
"""`LITE` with ideas from beyond the paper, and without what they make unnecessary:

- `failsafe`: nothing crashes, so the agent need not learn from crashes. It needs no `crash_reward`
  that grows, and no `exploring_starts`.
- `quantiles` 8, with `huber_delta` as their κ: the distribution of the return is a richer target
  than its mean. 8 learn sooner than 32.
- `advantage_learning` 0.8: the gaps between the best action and the others become five times as
  wide, so that errors of the network no longer decide.
- `pooling` 3, two resolutions, with kernels of 3×3 and a first stride of 1: the network sees each
  cell near the UAV, and the rest of the city coarsely. A first stride of 3 over the whole map
  blurs what the UAV has to fly around.
- `data_scale` 5: the average over 3×3 cells makes a device's data nine times as small.
- `discount` 0.97: far data counts for more. It learns more slowly, and wastes less time in the end.
- `steps`: three quarters of `LITE`'s.
"""

FINE_TUNE = replace(
    QUANTILE,
    name="fine_tune",
    steps=100_000,
    quantiles=32,  # those of `any_city`
    views=True,
    learning_rate=2e-4,
    replay_prefill=5_000,
    temperature=0.1,
    validation_interval=10_000,
    validation_episodes=500,
)
"""`QUANTILE` for an agent that flies well already, so that it learns one city by heart
(`train --from any_city`): smaller steps, and no time spent on exploring."""

IMITATION = replace(
    ImitationRecipe(**asdict(LITE)),
    name="imitation",
    steps=600_000,
    data_scale=5.0,
    failsafe=True,
    told=True,
    pooling=3,
    kernel_size=3,
    strides=(1, 2),
    huber_delta=None,
    learning_rate=1e-3,
    batch_size=256,
    replay_capacity=700_000,
    crash_reward=PAPER.crash_reward,
    crash_reward_end=None,
    exploring_starts=0.33,
    own_starts=0.33,
    validation_interval=50_000,
)
"""Copy the genie: a third of its flights begin as missions do, a third in mid-flight, and a third
where the learner has flown. No reward is used."""

for recipe in (QUANTILE, FINE_TUNE, IMITATION):
    registry.register("recipe", recipe.name, recipe)

ANY_CITY = Scenario(
    "any_city", "random:2000:0", devices=(1, 6), data=(1.0, 25.0), flying_time=(20, 70)
)
registry.register("scenario", ANY_CITY.name, ANY_CITY)
