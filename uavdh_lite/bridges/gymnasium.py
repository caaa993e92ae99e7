"""The environment for Gymnasium; importing this registers it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from uavdh_lite.city import load_cities
from uavdh_lite.environment import ACTIONS, Environment, Rewards, State
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights, FunctionPolicy, Policy, Step
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream

with extra("gym"):
    import gymnasium
    from gymnasium import spaces

ID = "uavdh_lite/DataHarvesting-v0"


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
    """

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
        self.environment = environment or Environment(load_cities(self.scenario.city))
        self.rewards, self.render_mode = rewards, render_mode
        most_data, most_time = self.scenario.data[1], self.scenario.flying_time[1]
        self._observation = Observation(self.environment, observation, most_data, most_time)
        shapes = {"map": self._observation.map_shape, "time": (1,)}
        boxes = [(name, spaces.Box(0.0, 1.0, shape)) for name, shape in shapes.items()]
        self.observation_space = spaces.Dict(boxes)
        self.action_space = spaces.Discrete(len(ACTIONS))

    def observe(self, state: State) -> dict[str, np.ndarray]:
        """What is seen of B episodes, (B, ...) arrays by name."""
        map, time = self._observation(state)
        return {"map": map.numpy(), "time": time.numpy()}

    def action_masks(self) -> np.ndarray:
        """The actions that the safety controller would not replace; (6,) bool."""
        return self.environment.allowed_actions(self.state)[0]

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        super().reset(seed=seed)
        if seed is not None:
            self._np_random = stream(Use.GYMNASIUM, seed)  # the property would forget the seed
        start = (options or {}).get("start")
        if start is None:
            start = self.scenario.sample(self.environment, 1, self.np_random)
        elif len(start) != 1:
            raise InputError(f"start of {len(start)} episodes: expected a State of one")
        self.state = self._start = start
        self._history: list[Step] = []
        return _row(self.observe(self.state)), _row(_info(self.state))

    def step(self, action: int) -> tuple[dict, float, bool, bool, dict]:
        before, actions = self.state, np.array([action])
        self.state, outcome = self.environment.step(before, actions, self.np_random)
        reward = self.rewards(outcome)
        self._history.append(Step(before, actions, outcome, reward))
        seen, info = self.observe(self.state), _info(self.state) | outcome.counts()
        return _row(seen), float(reward[0]), bool(self.state.ended[0]), False, _row(info)

    def render(self) -> np.ndarray | None:
        """The flight so far, an (height, width, 3) uint8 picture; None without a render mode."""
        if self.render_mode is None:
            return None
        from matplotlib.figure import Figure

        from uavdh_lite.plotting import draw_trajectory, pixels

        figure = Figure(figsize=(6, 6.4), layout="constrained")
        flight = Flights(self._start, self.state, self._history).trajectory(0)
        draw_trajectory(figure.subplots(), self.environment, flight)
        return pixels(figure)


def _info(state: State) -> dict[str, np.ndarray]:
    return {
        "landed": state.landed,
        "collected": state.collected,
        "collected_and_landed": state.collected * state.landed,
        "time_left": state.time_left,
    }


def _row(arrays: dict) -> dict:
    return {name: array[0] for name, array in arrays.items()}


def as_policy(env: gymnasium.Env, predict: Callable, masked: bool = False) -> Policy:
    """A policy of this library from a function of a `DataHarvesting`'s observations.

    With it, agents of other libraries are evaluated like ours. For Stable-Baselines3:
    `as_policy(env, lambda seen: model.predict(seen, deterministic=True)[0])`, and for MaskablePPO
    `as_policy(env, lambda seen, masks: model.predict(seen, action_masks=masks)[0], masked=True)`.

    Arguments:
        predict: takes a batch of observations, (B, ...) arrays by name; gives (B,) actions.
        masked: give it the allowed actions, too, (B, 6) bool.
    """
    one: Any = env.unwrapped  # a DataHarvesting

    def act(state: State) -> np.ndarray:
        masks = [one.environment.allowed_actions(state)] if masked else []
        return predict(one.observe(state), *masks)

    return FunctionPolicy(act, one.environment)


gymnasium.register(id=ID, entry_point="uavdh_lite.bridges.gymnasium:DataHarvesting")
