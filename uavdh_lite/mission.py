"""A mission that a person sets, step by step, and the policies that can fly it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import City
from uavdh_lite.environment import Environment, Outcome, Rewards, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Policy, fly
from uavdh_lite.planners import Genie, Greedy, Random
from uavdh_lite.scenario import Scenario, place

Cell = tuple[int, int]


@cache
def environment_of(city: str) -> Environment:
    """The environment of a shipped city, made once."""
    return Environment(City.load(city))


@dataclass(frozen=True, eq=False)
class Mission:
    """One episode: start, devices and their data, flying time, and the seed of the fading.

    Every change gives a new mission. One that cannot be flown raises `InputError`.

    | field | meaning |
    | --- | --- |
    | `start`, `devices` | cells as (row, column) |
    | `data` | data units of each device |
    | `flying_time` | units of time |
    | `max_devices` | how many devices there may be |
    """

    city: City
    start: Cell
    devices: tuple[Cell, ...]
    data: tuple[float, ...]
    flying_time: int
    seed: int = 0
    max_devices: int = 5

    def __post_init__(self):
        self.state  # noqa: B018 (raises what is wrong with it)

    @classmethod
    def draw(cls, scenario: Scenario, city: City, seed: int) -> "Mission":
        """A random mission of a scenario."""
        state = scenario.sample(city, 1, np.random.default_rng(seed))
        used = np.flatnonzero(state.data_initial[0] > 0)

        def cell(number) -> Cell:
            return divmod(int(number), city.size)

        return cls(
            city,
            cell(state.uav_cell[0]),
            tuple(cell(number) for number in state.device_cells[0, used]),
            tuple(round(float(amount), 1) for amount in state.data_initial[0, used]),
            int(state.time_left[0]),
            seed,
            scenario.max_devices,
        )

    @cached_property
    def state(self) -> State:
        """The first state, a batch of one."""
        return place(
            self.city,
            self.start,
            list(self.devices),
            list(self.data),
            self.flying_time,
            self.max_devices,
        )

    def fly(self, environment: Environment, policy: Policy) -> Flights:
        """The flight of a policy, every step kept; equal seeds meet equal fading."""
        return fly(environment, policy, self.state, np.random.default_rng(self.seed), record=True)

    def device_at(self, cell: Cell) -> int | None:
        """The device in this cell, or None."""
        return self.devices.index(cell) if cell in self.devices else None

    def add(self, cell: Cell, data: float = 10.0) -> "Mission":
        """One device more."""
        return replace(self, devices=(*self.devices, cell), data=(*self.data, data))

    def move(self, device: int, cell: Cell) -> "Mission":
        """The same device somewhere else."""
        self._require(device)
        devices = list(self.devices)
        devices[device] = cell
        return replace(self, devices=tuple(devices))

    def remove(self, device: int) -> "Mission":
        """One device fewer; those after it move up."""
        self._require(device)
        rest = [k for k in range(len(self.devices)) if k != device]
        return replace(
            self,
            devices=tuple(self.devices[k] for k in rest),
            data=tuple(self.data[k] for k in rest),
        )

    def _require(self, device: int) -> None:
        if not 0 <= device < len(self.devices):
            raise InputError(f"no device {device}: there are {len(self.devices)}")


class HandFlight:
    """A mission flown step by step, each action chosen when it is due.

    It meets the same fading as any policy that flies the mission.

    | attribute | meaning |
    | --- | --- |
    | `state` | where the flight is now, a batch of one |
    | `ended` | whether it has landed or run out of time |
    """

    def __init__(self, environment: Environment, mission: Mission):
        self.environment, self.mission = environment, mission
        self.state = mission.state
        self._generator = np.random.default_rng(mission.seed)
        self._history: list[tuple[State, np.ndarray, Outcome, np.ndarray]] = []

    @property
    def ended(self) -> bool:
        return bool(self.state.ended[0])

    def step(self, action: int) -> Outcome:
        """Take one action, an index into `ACTIONS`; `InputError` after the end."""
        if self.ended:
            raise InputError("this flight is over: start another one")
        fading = self.environment.draw_fading(self.state, self._generator)
        taken = np.array([action])
        after, outcome = self.environment.transition(self.state, taken, fading)
        self._history.append((self.state, taken, outcome, Rewards()(outcome)))
        self.state = after
        return outcome

    def flights(self) -> Flights:
        """What was flown so far."""
        return Flights.of_steps(self.mission.state, self.state, self._history)


def pilots(environment: Environment) -> dict[str, Callable[[int], Policy]]:
    """The policies that can fly over this city, by name, each made for a mission's seed.

    The shipped agents know only the city that they were trained in; the planners know any.
    """

    def always(policy: Policy) -> Callable[[int], Policy]:
        return lambda seed: policy

    makers = {
        f"agent {name}": always(_shipped(name))
        for name in shipped_agents()
        if _shipped(name).city.fingerprint == environment.city.fingerprint
    }
    makers["greedy"] = always(Greedy(environment))
    makers["genie"] = lambda seed: Genie(environment)
    # A stream of its own: the fading is drawn from the seed alone
    makers["random"] = lambda seed: Random(np.random.default_rng([seed, 1]))
    return makers


@cache
def _shipped(name: str) -> Agent:
    return load_agent(name)
