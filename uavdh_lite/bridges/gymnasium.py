"""The environment for Gymnasium, single and as a batch; importing this registers both."""

from collections.abc import Callable
from typing import Any

import numpy as np

from uavdh_lite.city import load_cities
from uavdh_lite.config import shown
from uavdh_lite.environment import ACTIONS, Environment, Rewards, State
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights, FunctionPolicy, Policy, Step
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream

with extra("gym"):
    import gymnasium
    from gymnasium import spaces
    from gymnasium.error import ResetNeeded
    from gymnasium.vector import (
        AutoresetMode,
        VectorActionWrapper,
        VectorEnv,
        VectorObservationWrapper,
    )
    from gymnasium.vector.utils import batch_space

ID = "uavdh_lite/DataHarvesting-v0"
WRAPPERS: tuple = (gymnasium.ActionWrapper, gymnasium.ObservationWrapper)
WRAPPERS += (VectorActionWrapper, VectorObservationWrapper)


class DataHarvesting(gymnasium.Env):
    """A UAV collects data from devices in a city and must land in time (Bayerlein et al., 2020).

    **Actions**, `Discrete(6)`: north, east, south, west, hover, land. Each takes one unit of flying
    time. The safety controller hovers instead of a move off the grid or into a no-fly cell, and
    instead of a landing outside the landing zone. `action_masks()` tells learners with masks.

    **Observations**, a `Dict` of float32 between 0 and 1; M is the side of the largest city:

    | key | shape, W = 2M − 1 | what |
    | --- | --- | --- |
    | `map` | (5, W, W) | landing zone, no-fly zone, buildings, data left, data collected |
    | `time` | (1,) | remaining flying time over the scenario's longest |

    Data is divided by the most that a device of the scenario has. The map is centred on the UAV.
    With `observation="non_centred"` it stays in place, and a sixth layer marks the position.

    **Rewards**: the sum of the terms of `Rewards`.

    **Start**: drawn from the scenario, or the `State` in `reset(options={"start": state})`.

    **End**: terminated when the UAV lands, or when its flying time reaches 0. Never truncated: the
    flying time is part of the task, and of the observation.

    **Info**: `landed`, `collected`, `collected_and_landed` and `time_left` so far, and what
    `Outcome.counts` says of the step.

    Arguments:
        scenario: a preset's name, or a `Scenario`.
        observation: `centred` or `non_centred`.
        environment: instead of one over the scenario's city; it has other cities, or other rules.
        render_mode: with `rgb_array`, `render()` draws the flight so far.

    Before the first `reset` there is no episode: what needs one raises Gymnasium's `ResetNeeded`.
    """

    state: State | None = None
    metadata = {"render_modes": ["rgb_array"], "render_fps": 8}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | Scenario = "manhattan",
        observation: str = "centred",
        rewards: Rewards = Rewards(),  # noqa: B008 (frozen)
        environment: Environment | None = None,
        render_mode: str | None = None,
    ):
        self.scenario = find_scenario(scenario) if isinstance(scenario, str) else scenario
        self.environment = environment or Environment(
            load_cities(self.scenario.city), self.scenario.channel
        )
        self.rewards, self.render_mode = rewards, render_mode
        most_data, most_time = self.scenario.data[1], self.scenario.flying_time[1]
        self._observation = Observation(self.environment, observation, most_data, most_time)
        shapes = {"map": self._observation.map_shape, "time": (1,)}
        boxes = [(name, spaces.Box(0.0, 1.0, shape)) for name, shape in shapes.items()]
        self.observation_space = spaces.Dict(boxes)
        self.action_space = spaces.Discrete(len(ACTIONS))
        _seed(self)

    def observe(self, state: State) -> dict[str, np.ndarray]:
        """What is seen of B episodes, (B, ...) arrays by name."""
        map, time = self._observation(state)
        return {"map": map.numpy(), "time": time.numpy()}

    def _seen(self) -> dict[str, np.ndarray]:
        return {name: array[0] for name, array in self.observe(_begun(self)).items()}

    def action_masks(self) -> np.ndarray:
        """The actions that the safety controller would not replace; (6,) bool."""
        return self.environment.allowed_actions(_begun(self))[0]

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        super().reset(seed=seed)
        if seed is not None:
            _seed(self, seed)
        self.state = self._start = self.starts(1, self.np_random, options)
        self._history: list[Step] = []
        return self._seen(), _values(_info(self.state))

    def starts(self, count: int, generator: np.random.Generator, options: dict | None) -> State:
        """The first states of so many episodes: those of the options, or else drawn."""
        if unknown := (options or {}).keys() - {"start"}:
            raise InputError(f"options {', '.join(map(str, unknown))}: a reset has start alone")
        start = (options or {}).get("start")
        if start is None:
            return self.scenario.sample(self.environment, count, generator)
        if not isinstance(start, State) or len(start) != count:
            raise InputError(f"start is {shown(start)}: expected a State of {count} episodes")
        environment, city = self.environment, start.city[:, None]
        cells = np.c_[start.uav_cell, start.device_cells]
        known = (cells >= 0) & (cells < environment.size**2)
        known &= (city >= 0) & (city < len(environment.cities))
        if not known.all() or environment.no_fly[city, cells][:, 0].any():
            raise InputError("start with the UAV over a no-fly cell, or in no cell of its city")
        if (~environment.open_to_devices[city, cells[:, 1:]] & (start.data_initial > 0)).any():
            raise InputError("start with a device on a building or in the landing zone")
        seen = self.observe(start)  # below 0 for odd data
        parts = [{name: all_[i] for name, all_ in seen.items()} for i in range(count)]
        inside = all(map(self.observation_space.contains, parts))
        if start.ended.any() or not start.data_initial.any(axis=1).all() or not inside:
            raise InputError(
                f"start that is over, without data, or outside the observation space of scenario "
                f"{self.scenario.name}: more time or data than it has, or data that is no number"
            )
        return start

    def step(self, action: int) -> tuple[dict, float, bool, bool, dict]:
        before, actions = _begun(self), np.array([action])
        self.state, outcome = self.environment.step(before, actions, self.np_random)
        reward = self.rewards(outcome)
        self._history.append(Step(before, actions, outcome, reward))
        info = _info(self.state) | outcome.counts()
        return self._seen(), float(reward[0]), bool(self.state.ended[0]), False, _values(info)

    def render(self) -> np.ndarray | None:
        """The flight so far, an (height, width, 3) uint8 picture; None without a render mode."""
        if self.render_mode is None:
            return None
        end = _begun(self)
        from matplotlib.figure import Figure

        from uavdh_lite.plotting import draw_trajectory, pixels

        figure = Figure(figsize=(6, 6.4), layout="constrained")
        flight = Flights(self._start, end, self._history).trajectory(0)
        draw_trajectory(figure.subplots(), self.environment, flight)
        return pixels(figure)


class VectorDataHarvesting(VectorEnv):
    """`num_envs` episodes of `DataHarvesting` in one batch, much faster than one by one.

    Observations, rewards and infos are those of single environments, stacked; an entry of `info`
    that not every episode has comes with a mask, `_NAME`, as from `SyncVectorEnv`.

    **Autoreset** is Gymnasium's `NEXT_STEP`: the step after an episode's last one ignores the
    action, has reward 0 and begins the next episode. `vectorization_mode="sync"` has other modes.

    **Seed**: all episodes draw from one stream, so equal seeds and equal numbers of episodes give
    equal flights, but not those of single environments with the seeds seed, seed + 1, ...

    The options are those of `DataHarvesting`. A batch is not drawn: `vectorization_mode="sync"` is.
    """

    state: State | None = None

    def __init__(self, num_envs: int = 1, **options: Any):
        self.one, self.num_envs = DataHarvesting(**options), num_envs
        self.environment, self.observe = self.one.environment, self.one.observe
        self.metadata = {**self.one.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.single_observation_space = self.one.observation_space
        self.single_action_space = self.one.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        _seed(self)

    def action_masks(self) -> np.ndarray:
        """The actions that the safety controller would not replace; (num_envs, 6) bool."""
        return self.environment.allowed_actions(_begun(self))

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        super().reset(seed=seed)
        if seed is not None:
            _seed(self, seed)
        self.state = self.one.starts(self.num_envs, self.np_random, options)
        return self.observe(self.state), _masked(_info(self.state), np.ones(self.num_envs, bool))

    def step(self, actions: np.ndarray) -> tuple[dict, np.ndarray, np.ndarray, np.ndarray, dict]:
        before = _begun(self)
        over = before.ended  # these begin anew, whatever their actions
        after, outcome = self.environment.step(before, actions, self.np_random)
        reward, ended = self.one.rewards(outcome).astype(float), after.ended & ~over
        if over.any():
            start = self.one.starts(int(over.sum()), self.np_random, None)
            after = after.with_rows(over, start)
        self.state = after
        info = _masked(_info(after), np.ones_like(over)) | _masked(outcome.counts(), ~over)
        return self.observe(after), reward, ended, np.zeros_like(ended), info


def _seed(env: Any, seed: int | None = None) -> None:
    """Give an environment its generator and the seed, which `reset` takes, too; any one if None."""
    if seed is None:
        seed = int(np.random.SeedSequence().generate_state(1, np.uint64)[0]) >> 1
    env._np_random, env._np_random_seed = stream(Use.GYMNASIUM, seed), seed


def _begun(env: DataHarvesting | VectorDataHarvesting) -> State:
    """The state of the episodes."""
    if env.state is None:
        raise ResetNeeded("no episode has begun: call reset() first")
    return env.state


def _info(state: State) -> dict[str, np.ndarray]:
    collected = state.collected.astype(float)
    return {
        "landed": state.landed,
        "collected": collected,
        "collected_and_landed": collected * state.landed,
        "time_left": state.time_left.astype(int),
    }


def _values(arrays: dict) -> dict:
    """The numbers of one episode as Python has them: vector environments stack these alone."""
    return {name: array[0].item() for name, array in arrays.items()}


def _masked(arrays: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    """The arrays, and for each the mask of the episodes that it is of, `_NAME`."""
    return {**arrays, **{f"_{name}": rows for name in arrays}}


def as_policy(env: gymnasium.Env | VectorEnv, predict: Callable, masked: bool = False) -> Policy:
    """A policy of this library from a function of a `DataHarvesting`'s observations.

    With it, agents of other libraries are evaluated like ours. For Stable-Baselines3:
    `as_policy(env, lambda seen: model.predict(seen, deterministic=True)[0])`, and for MaskablePPO
    `as_policy(env, lambda seen, masks: model.predict(seen, action_masks=masks)[0], masked=True)`.

    Arguments:
        predict: takes a batch of observations, (B, ...) arrays by name; gives (B,) actions.
        masked: give it the allowed actions, too, (B, 6) bool.

    Raises `InputError` if a wrapper changes actions or observations: here `predict` must do that.
    """
    one: Any = env.unwrapped  # a DataHarvesting, or a batch of them
    around: Any = env
    while around is not one:
        if isinstance(around, WRAPPERS):
            name = type(around).__name__
            raise InputError(f"{name} would be left out: let predict do what it does")
        around = around.env

    def act(state: State) -> np.ndarray:
        masks = [one.environment.allowed_actions(state)] if masked else []
        actions = predict(one.observe(state), *masks)
        if isinstance(actions, tuple):
            raise InputError(
                "predict gave a tuple, expected (B,) actions: of Stable-Baselines3's, take the "
                "first entry, model.predict(...)[0]"
            )
        return actions

    return FunctionPolicy(act, one.environment)


gymnasium.register(
    id=ID,
    entry_point="uavdh_lite.bridges.gymnasium:DataHarvesting",
    vector_entry_point="uavdh_lite.bridges.gymnasium:VectorDataHarvesting",
)
