"""The environment for Gymnasium: single and vectorised, over the same simulator."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.city import Cities, City
from uavdh_lite.city_generator import load_city
from uavdh_lite.environment import ACTIONS, Environment, Outcome, Rewards, State
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights, Policy, Step
from uavdh_lite.observation import Observation
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream

with extra("gym"):
    import gymnasium
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

ID = "uavdh_lite/DataHarvesting-v0"
FRAMES_PER_SECOND = 8
PICTURE = (6, 6.4)  # inches of a rendered flight


class _Simulator:
    """What the single and the vectorised environment share: B episodes and their observations."""

    def __init__(
        self,
        scenario: str | Scenario,
        observation: str,
        rewards: Rewards,
        failsafe: bool,
        city: City | Cities | None,
    ):
        self.scenario = find_scenario(scenario) if isinstance(scenario, str) else scenario
        city = load_city(self.scenario.city) if city is None else city
        self.environment = Environment(city, failsafe=failsafe)
        self.rewards = rewards
        self._observation = Observation(
            city, observation, self.scenario.data[1], self.scenario.flying_time[1]
        )
        shapes = self._observation.map_shapes()
        self._names = ("map",) if len(shapes) == 1 else ("global_map", "local_map")
        self.space = spaces.Dict(
            {
                **{
                    name: spaces.Box(0.0, 1.0, shape, np.float32)
                    for name, shape in zip(self._names, shapes, strict=True)
                },
                "time": spaces.Box(0.0, 1.0, (1,), np.float32),
            }
        )

    def starts(self, count: int, generator: np.random.Generator) -> State:
        return self.scenario.sample(self.environment.city, count, generator)

    def start(
        self, options: dict[str, Any] | None, count: int, generator: np.random.Generator
    ) -> State:
        """The start that `reset` was given, or a random one."""
        given = (options or {}).get("start")
        if given is not None and len(given) != count:
            raise InputError(f"start of {len(given)} episodes: expected a State of {count}")
        return self.starts(count, generator) if given is None else given

    def observe(self, state: State) -> dict[str, np.ndarray]:
        """(B, ...) arrays by name."""
        maps, time = self._observation(state)
        arrays = {name: layers.numpy() for name, layers in zip(self._names, maps, strict=True)}
        return {**arrays, "time": time.numpy()}

    def draw(self, figure: Figure, flights: Flights) -> None:
        """Draw a flight, a batch of one, into an empty figure."""
        from uavdh_lite.plotting import draw_trajectory

        draw_trajectory(figure.subplots(), self.environment, flights.trajectory(0))

    def picture(self, flights: Flights) -> np.ndarray:
        """A flight as an (height, width, 3) uint8 picture."""
        from uavdh_lite.plotting import pixels

        figure = Figure(figsize=PICTURE, layout="constrained")
        self.draw(figure, flights)
        return pixels(figure)

    @staticmethod
    def info(state: State, outcome: Outcome | None = None) -> dict[str, np.ndarray]:
        """What `info` holds; (B,) arrays."""
        ratio = state.collection_ratio.astype(np.float64)
        return {
            "collection_ratio": ratio,
            "collection_ratio_and_landed": ratio * state.landed,
            "has_landed": state.landed.copy(),
            "time_left": state.time_left.astype(np.int64),
            "safety_intervention": (
                np.zeros(len(state), bool) if outcome is None else outcome.intervened
            ),
            "sent_home": np.zeros(len(state), bool) if outcome is None else outcome.sent_home,
        }


class DataHarvesting(gymnasium.Env):
    """
    ## Description

    A UAV flies over a city for a limited time and collects data from IoT devices on the ground.
    Buildings block radio links, and tall ones block the way, too. Some zones may not be entered, and
    the UAV must land in time. This is the problem of Bayerlein, Theile, Caccamo and Gesbert, "UAV Path Planning
    for Wireless Data Harvesting: A Deep Reinforcement Learning Approach", Globecom 2020.

    ## Action Space

    `Discrete(6)`. Every action takes one unit of flying time.

    | number | action |
    | --- | --- |
    | 0 | north, one row up |
    | 1 | east, one column to the right |
    | 2 | south |
    | 3 | west |
    | 4 | hover |
    | 5 | land |

    A move off the grid or into a no-fly cell, and a landing outside the landing zone, are replaced
    by hovering (the safety controller). With `failsafe=True` it also replaces an action after which
    the UAV could not land in time by the first move home, and `info["sent_home"]` says so.
    `action_masks()` gives the actions that it would not replace; learners with masks, such as
    MaskablePPO of sb3-contrib, ask for it.

    ## Observation Space

    A `Dict` of float32 arrays between 0 and 1. M is the number of cells on a side of the largest
    city, W = 2M − 1.

    | key | shape | what |
    | --- | --- | --- |
    | `map` | (5, W, W), non-centred (6, W, W) | landing zone, no-fly zone, buildings, data left and data collected over the scenario's most data, (position) |
    | `global_map`, `local_map` | | instead of `map` with `observation="global_local"` |
    | `time` | (1,) | remaining flying time over the scenario's longest |

    ## Rewards

    1 for each data unit collected, −0.2 for each step that does not land, −1 when the safety
    controller intervenes, −150 for running out of flying time in the air: the `Rewards` of the paper.

    ## Starting State

    The number, the places and the data of the devices, the start cell and the flying time are drawn
    from the scenario's ranges. `reset(options={"start": state})` takes a `State` of one episode instead,
    for example from `uavdh_lite.scenario.place`.

    ## Episode End

    Terminated: the UAV lands, or its flying time reaches 0. Never truncated: the flying time is part
    of the task, and of the observation.

    ## Arguments

    | name | default | what |
    | --- | --- | --- |
    | `scenario` | `"manhattan"` | a preset's name, or a `Scenario` |
    | `observation` | `"centred"` | `centred`, `non_centred` or `global_local` |
    | `rewards` | `Rewards()` | the reward's constants |
    | `render_mode` | `None` | `rgb_array`, or `human` for a window |
    | `failsafe` | `False` | whether the safety controller brings the UAV home in time |
    | `city` | `None` | the city instead of the scenario's own; with `Cities`, a random one of them for each episode |

    ```python
    >>> import gymnasium, uavdh_lite.gym
    >>> env = gymnasium.make("uavdh_lite/DataHarvesting-v0", scenario="village")
    >>> observation, info = env.reset(seed=0)
    >>> observation["map"].shape
    (5, 15, 15)

    ```

    ## Vectorised environment

    `gymnasium.make_vec("uavdh_lite/DataHarvesting-v0", num_envs=64,
    vectorization_mode="vector_entry_point")` gives `DataHarvestingVector`, which steps all
    episodes at once.

    ## Version History

    * v0: first version
    """  # noqa: E501

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": FRAMES_PER_SECOND}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | Scenario = "manhattan",
        observation: str = "centred",
        rewards: Rewards = Rewards(),  # noqa: B008 (frozen)
        render_mode: str | None = None,
        failsafe: bool = False,
        city: City | Cities | None = None,
    ):
        _check_mode(render_mode, self.metadata)
        self._simulator = _Simulator(scenario, observation, rewards, failsafe, city)
        self.observation_space = self._simulator.space
        self.action_space = spaces.Discrete(len(ACTIONS))
        self.render_mode = render_mode
        self._state: State | None = None
        self._history: list[Step] = []
        self._window: Figure | None = None

    @property
    def state(self) -> State:
        """The simulator's own state, a batch of one."""
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset() first")
        return self._state

    def action_masks(self) -> np.ndarray:
        """The actions that the safety controller would not replace; (6,) bool."""
        return self._simulator.environment.allowed_actions(self.state)[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None:
            self.np_random = stream(Use.GYMNASIUM, seed)
        start = self._simulator.start(options, 1, self.np_random)
        self._start = self._state = start
        self._history = []
        self._show()
        return self._first(self._simulator.observe(start)), self._first(self._simulator.info(start))

    def step(self, action: int) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        state = self.state
        if state.ended[0]:
            raise gymnasium.error.ResetNeeded("the episode is over: call reset()")
        if not self.action_space.contains(action):
            raise InputError(f"action {action!r}: must be a whole number from 0 to 5")
        taken = np.array([action])
        self._state, outcome = self._simulator.environment.step(state, taken, self.np_random)
        reward = self._simulator.rewards(outcome)
        self._history.append(Step(state, taken, outcome, reward))
        self._show()
        return (
            self._first(self._simulator.observe(self._state)),
            float(reward[0]),
            bool(self._state.ended[0]),
            False,
            self._first(self._simulator.info(self._state, outcome)),
        )

    @staticmethod
    def _first(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
        return {name: array[0] for name, array in arrays.items()}

    def render(self) -> np.ndarray | None:
        """The flight so far: an (height, width, 3) uint8 picture, or None in a window."""
        if self.render_mode != "rgb_array":
            return None
        return self._simulator.picture(self._flights())

    def _flights(self) -> Flights:
        return Flights.of_steps(self._start, self.state, self._history)

    def _show(self) -> None:
        """In the mode `human`, draw the flight in its window."""
        if self.render_mode != "human":
            return
        import matplotlib.pyplot as plt

        if self._window is None:
            self._window = plt.figure(figsize=PICTURE, layout="constrained")
        self._window.clear()
        self._simulator.draw(self._window, self._flights())
        self._window.canvas.draw_idle()
        self._window.canvas.flush_events()
        plt.pause(1 / FRAMES_PER_SECOND)

    def close(self) -> None:
        if self._window is not None:
            import matplotlib.pyplot as plt

            plt.close(self._window)
            self._window = None


class DataHarvestingVector(VectorEnv):
    """`DataHarvesting` for N episodes at once, without a loop over them.

    An episode that ends is replaced in the same step (`AutoresetMode.SAME_STEP`): the observation
    of that step is the new episode's first, `infos["final_obs"]` holds the old one's last and
    `infos["final_info"]` its last info, both where `infos["_final_obs"]` is True. So every step is
    a real transition of every episode; there are no dummy steps to leave out.

    Scenarios and fading of all episodes come from one generator, seeded at `reset`. The arguments
    are those of `DataHarvesting`.
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": FRAMES_PER_SECOND,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Scenario = "manhattan",
        observation: str = "centred",
        rewards: Rewards = Rewards(),  # noqa: B008 (frozen)
        render_mode: str | None = None,
        failsafe: bool = False,
        city: City | Cities | None = None,
    ):
        _check_mode(render_mode, self.metadata)
        self._simulator = _Simulator(scenario, observation, rewards, failsafe, city)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space = self._simulator.space
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._state: State | None = None

    @property
    def state(self) -> State:
        """The simulator's own state, a batch of N."""
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset() first")
        return self._state

    def action_masks(self) -> np.ndarray:
        """The actions that the safety controller would not replace; (N, 6) bool."""
        return self._simulator.environment.allowed_actions(self.state)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None:
            self.np_random = stream(Use.GYMNASIUM, seed)
        start = self._simulator.start(options, self.num_envs, self.np_random)
        self._state = start
        return self._simulator.observe(start), self._masked(self._simulator.info(start))

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        actions = np.asarray(actions)
        if not self.action_space.contains(actions):
            raise InputError(
                f"actions {actions!r}: must be {self.num_envs} whole numbers from 0 to 5"
            )
        state, outcome = self._simulator.environment.step(self.state, actions, self.np_random)
        reward = self._simulator.rewards(outcome).astype(np.float64)
        terminated = state.ended.copy()
        info = self._simulator.info(state, outcome)
        ended = np.flatnonzero(terminated)
        final = {}
        if len(ended):
            final = self._final(state[ended], info, terminated)
            state = state.with_rows(ended, self._simulator.starts(len(ended), self.np_random))
            begun = self._simulator.info(state)
            info = {name: np.where(terminated, begun[name], info[name]) for name in info}
        self._state = state
        truncated = np.zeros(self.num_envs, bool)
        infos = {**self._masked(info), **final}
        return self._simulator.observe(state), reward, terminated, truncated, infos

    def _final(self, last: State, info: dict, terminated: np.ndarray) -> dict[str, Any]:
        """The last observation and info of the ended episodes, at their places."""
        observations = np.full(self.num_envs, None, object)
        arrays = self._simulator.observe(last)
        for row, index in enumerate(np.flatnonzero(terminated)):
            observations[index] = {name: array[row] for name, array in arrays.items()}
        masked = {
            name: np.where(terminated, array, 0).astype(array.dtype) for name, array in info.items()
        }
        return {
            "final_obs": observations,
            "_final_obs": terminated.copy(),
            "final_info": {**masked, **{f"_{name}": terminated.copy() for name in masked}},
            "_final_info": terminated.copy(),
        }

    def _masked(self, info: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """With the mask that Gymnasium wants for each entry: here every episode has one."""
        everywhere = np.ones(self.num_envs, bool)
        return {**info, **{f"_{name}": everywhere.copy() for name in info}}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each episode's state, (height, width, 3) uint8."""
        if self.render_mode is None:
            return None
        states = [self.state[[index]] for index in range(self.num_envs)]
        return tuple(self._simulator.picture(Flights.of_steps(s, s, [])) for s in states)


def as_policy(
    env: gymnasium.Env | VectorEnv, predict: Callable[[dict[str, np.ndarray]], np.ndarray]
) -> Policy:
    """A policy of this library from a function of this environment's observations.

    With it, agents of other libraries are evaluated like ours. For Stable-Baselines3:
    `as_policy(env, lambda batch: model.predict(batch, deterministic=True)[0])`.

    Arguments:
        predict: takes a batch of observations, (B, ...) arrays by name; gives (B,) actions.
    """
    wrapped: Any = env.unwrapped  # a DataHarvesting or a DataHarvestingVector
    simulator: _Simulator = wrapped._simulator
    return lambda state: np.asarray(predict(simulator.observe(state)))


def _check_mode(render_mode: str | None, metadata: dict) -> None:
    if render_mode is not None and render_mode not in metadata["render_modes"]:
        raise InputError(
            f"render_mode {render_mode!r}: choose one of {', '.join(metadata['render_modes'])}"
        )


gymnasium.register(
    id=ID,
    entry_point="uavdh_lite.gym:DataHarvesting",
    vector_entry_point="uavdh_lite.gym:DataHarvestingVector",
)
