"""Recipes: all that a training run depends on, except the scenario and the seed."""

from dataclasses import asdict, dataclass, replace
from typing import Any

from uavdh_lite.config import option, require_bounds
from uavdh_lite.environment import Rewards
from uavdh_lite.errors import InputError


@dataclass(frozen=True)
class Recipe:
    """The constants of a training run; the defaults are the paper's.

    Where the paper gives none, it is that of the authors' code: `crash_reward`, Adam's amsgrad.
    `failsafe`, `quantiles` and `advantage_learning` go beyond the paper.
    """

    name: str
    steps: int = option(1_000_000, "environment steps in all, including the prefill", ge=1)
    # What the network sees
    observation: str = option("centred", "maps: centred, non_centred or global_local")
    data_scale: float = option(1.0, "data on the maps is divided by this, data units", gt=0)
    time_scale: float = option(1.0, "the flying time is divided by this, units of time", gt=0)
    pooling: int = option(
        3, "global map: average over cells of this side (global_local only)", ge=1
    )
    local_size: int = option(17, "local map: cells a side (global_local only)", ge=1)
    turned: bool = option(
        False, "learn in the eight turned and mirrored versions of the city, and fly by all eight"
    )
    # What keeps it safe
    failsafe: bool = option(
        False, "the safety controller brings the UAV home in time; landing is not learned"
    )
    # Network
    kernels: int = option(16, "kernels of each convolution", ge=1)
    kernel_size: int = option(5, "side of a kernel, cells", ge=1)
    strides: tuple[int, ...] = option((1, 1), "stride of each convolution", ge=1)
    hidden: tuple[int, ...] = option((256, 256, 256), "units of each fully connected layer", ge=1)
    layer_norm: bool = option(False, "LayerNorm in each fully connected layer, before its ReLU")
    leak: float = option(0.0, "slope of the ReLUs below 0; 0: plain ReLUs", ge=0)
    quantiles: int = option(
        0, "quantiles learned of each action's return (QR-DQN); 0: its mean alone (DDQN)", ge=0
    )
    # Learning
    discount: float = option(0.95, "discount factor γ", ge=0, le=1)
    return_steps: int = option(
        1, "steps n whose rewards are summed before the target's Q-value", ge=1
    )
    target_update_rate: float = option(
        0.005, "soft update rate τ of the target network", gt=0, le=1
    )
    learning_rate: float = option(3e-5, "Adam's learning rate at the start", gt=0)
    learning_rate_end: float = option(3e-5, "learning rate at the end; linear in between", ge=0)
    amsgrad: bool = option(True, "Adam's amsgrad variant")
    huber_delta: float | None = option(
        None, "errors above this count linearly in the loss; none: squared", gt=0
    )
    advantage_learning: float = option(
        0.0, "share α of the action gap that is taken from the targets", ge=0, le=0.99
    )
    batch_size: int = option(128, "transitions in a minibatch", ge=1)
    # Experience
    environments: int = option(
        1, "episodes flown at a time; one update for each step of them all", ge=1
    )
    replay_capacity: int = option(50_000, "transitions in the replay memory", ge=1)
    replay_prefill: int = option(
        25_000, "transitions of a random policy before the first update", ge=1
    )
    temperature: float = option(0.1, "temperature β of the softmax policy at the start", gt=0)
    temperature_end: float = option(0.1, "temperature from the end of its decay on", gt=0)
    temperature_decay: float = option(
        0.5, "share of the run in which the temperature decays, linearly", ge=0, le=1
    )
    crash_reward: float = option(-150.0, "reward for running out of time, r_crash, at the start")
    crash_reward_end: float = option(-150.0, "r_crash from the end of its growth on")
    crash_reward_growth: float = option(
        0.5, "share of the run in which r_crash changes, linearly", ge=0, le=1
    )
    movement_reward: float = option(-0.2, "reward for every step that does not land, r_mov")
    exploring_starts: float = option(
        0.0, "share of episodes that start in mid-flight, anywhere", ge=0, le=1
    )
    exploring_spare_time: int = option(
        5, "flying time that these have left at least, beyond the way home", ge=0
    )
    # Validation: the agent kept is the one with the highest return in these
    validation_interval: int = option(50_000, "environment steps between greedy validations", ge=1)
    validation_episodes: int = option(
        1000, "scenarios flown in each validation, always the same", ge=1
    )

    def __post_init__(self):
        require_bounds(self, f"recipe {self.name}")
        if self.quantiles and self.huber_delta is None:
            raise InputError(
                f"recipe {self.name}: huber_delta is None, must be a number with quantiles"
            )
        if self.environments > self.batch_size:
            raise InputError(
                f"recipe {self.name}: environments is {self.environments}, must be at most "
                f"batch_size, {self.batch_size}: every minibatch holds the newest of each"
            )
        if self.replay_prefill > self.replay_capacity:
            raise InputError(
                f"recipe {self.name}: replay_prefill is {self.replay_prefill}, must be at most "
                f"replay_capacity, {self.replay_capacity}"
            )

    def rewards_at(self, steps: int) -> Rewards:
        """The rewards that the agent learns from after this many environment steps."""
        over = self.crash_reward_growth * self.steps
        crash = _ramp(self.crash_reward, self.crash_reward_end, steps, over)
        return Rewards(crash=crash, movement=self.movement_reward)

    def temperature_at(self, steps: int) -> float:
        """β after this many environment steps."""
        over = self.temperature_decay * self.steps
        return _ramp(self.temperature, self.temperature_end, steps, over)

    def learning_rate_at(self, steps: int) -> float:
        """The learning rate after this many environment steps."""
        return _ramp(self.learning_rate, self.learning_rate_end, steps, self.steps)

    def as_json(self) -> dict:
        """The fields as JSON values; `Recipe.from_json` undoes it."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict) -> "Recipe":
        """The recipe with these fields; lists become tuples."""
        fields: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in values.items()
        }
        return cls(**fields)


def _ramp(start: float, end: float, step: float, over: float) -> float:
    """Linear from `start` at step 0 to `end` at step `over`, and `end` from then on."""
    share = min(step / over, 1.0) if over > 0 else 1.0
    return start + (end - start) * share


PAPER = Recipe("paper")

LITE = Recipe(
    "lite",
    steps=2_000_000,
    data_scale=20.0,
    time_scale=10.0,
    strides=(3, 1),
    layer_norm=True,
    leak=0.1,
    return_steps=3,
    learning_rate=6e-4,
    learning_rate_end=0.0,
    amsgrad=False,
    huber_delta=10.0,
    environments=32,
    replay_capacity=200_000,
    replay_prefill=10_000,
    temperature=2.0,
    temperature_decay=0.25,
    crash_reward=-10.0,
    crash_reward_end=-150.0,
    crash_reward_growth=1.0,
    movement_reward=-0.1,
    exploring_starts=0.5,
    validation_interval=100_000,
)
"""The same algorithm, made to learn within minutes on a CPU. These are its deviations from the
paper and their reasons; the site's results say what each is worth, as far as that was measured:

- `steps`: twice the paper's, in a hundredth of the time.
- `data_scale`, `time_scale`: the first layers learn best from inputs of the order of 1.
- `strides` 3 and 1: a tenth of the weights; an update takes a sixth of the time.
- `layer_norm`: keeps the hidden layers' scale steady while the targets move.
- `leak`: with plain ReLUs most kernels of the convolutions fall silent and stay silent.
- `return_steps` 3: rewards reach earlier states with a third of the updates.
- `learning_rate` twenty times the paper's, falling to 0: fast at first, settled at the end.
- `amsgrad` off: it comes from the authors' code, not the paper, and makes no difference here.
- `huber_delta` 10: a crash no longer drowns the small differences that decide between actions.
- `environments` 32 with one update for each step of all: each transition is used 4 times, not 128.
  Flying costs little next to an update, and fresh experience teaches more than old.
- `replay_capacity` four times the paper's, at 60 bytes per transition, and a shorter
  `replay_prefill`: with the paper's values, short runs stay far behind.
- `temperature` 2, falling to 0.1 over the first quarter: the policy explores while the Q-values are
  still wrong. Then it flies what it has learned, since a three-step return is that of the policy
  that flies.
- `crash_reward` −10, growing to the −150 of `PAPER` over the run: while a crash costs little the
  agent learns to fly far, later to be home in time. With −150 from the start it first learns to
  land at once, and stays with that. With −60 at the end a crash can pay off: 25 steps ahead it
  weighs 0.95²⁵ · 60 = 17, less than the data of one device.
- `movement_reward` −0.1: with −0.2 the agent leaves distant devices that hold little, on the open
  field.
- `exploring_starts`: half of the episodes start under way, so that late states are seen early. This
  helps a lot on the open field, and costs a little in short runs on `manhattan`.
- `validation_interval` twice the paper's, like the steps.
"""

SMALL = replace(
    LITE,
    name="small",
    steps=48_000,
    kernels=8,
    kernel_size=3,
    strides=(2, 2),
    hidden=(128, 128),
    learning_rate=2e-3,
    batch_size=64,
    environments=16,
    replay_capacity=40_000,
    replay_prefill=2_000,
    temperature=1.0,
    crash_reward=-5.0,
    crash_reward_end=-20.0,
    crash_reward_growth=0.75,
    validation_interval=8_000,
    validation_episodes=200,
)
"""`LITE` for the small city `village`: it trains in half a minute, to learn how training works."""

QUANTILE = replace(
    LITE,
    name="quantile",
    steps=1_500_000,
    observation="global_local",
    data_scale=5.0,
    failsafe=True,
    kernel_size=3,
    strides=(1, 2),
    quantiles=8,
    discount=0.97,
    huber_delta=1.0,
    advantage_learning=0.8,
    crash_reward=PAPER.crash_reward,
    exploring_starts=0.0,
)
"""`LITE` with ideas from beyond the paper, and without what they make unnecessary:

- `failsafe`: nothing crashes, so the agent need not learn from crashes. It needs no `crash_reward`
  that grows, and no `exploring_starts`.
- `quantiles` 8, with `huber_delta` as their κ: the distribution of the return is a richer target
  than its mean. 8 learn sooner than 32.
- `advantage_learning` 0.8: the gaps between the best action and the others become five times as
  wide, so that errors of the network no longer decide.
- `observation` in two resolutions, with kernels of 3×3 and a first stride of 1: the network sees
  each cell near the UAV, and the rest of the city coarsely. A first stride of 3 over the whole map
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
    learning_rate=2e-4,
    replay_prefill=5_000,
    temperature=0.1,
    validation_interval=10_000,
    validation_episodes=500,
)
"""`QUANTILE` for an agent that flies well already, so that it learns one city by heart
(`train --from any_city`): smaller steps, and no time spent on exploring."""

RECIPES = {recipe.name: recipe for recipe in (PAPER, LITE, SMALL, QUANTILE, FINE_TUNE)}


def find_recipe(name: str) -> Recipe:
    """The recipe of this name; raises `InputError` with the known names."""
    if name not in RECIPES:
        raise InputError(f"unknown recipe {name!r}: choose one of {', '.join(RECIPES)}")
    return RECIPES[name]
