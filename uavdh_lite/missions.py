"""A mission that a person sets, flies and shares.

A mission file is JSON; `schemas/mission.schema.json` describes it. It holds the city and the seed
of the fading, but no radio channel: that is the environment's.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from uavdh_lite.city import City, described, fingerprint_of, load_city
from uavdh_lite.config import option, require, shown
from uavdh_lite.environment import REPORTED, Environment, Outcome, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Policy, Step, fly
from uavdh_lite.scenario import LEAST_DATA, LIMIT, MAX_DEVICES, Scenario
from uavdh_lite.storage import read_json, write_json
from uavdh_lite.streams import Portable, Use

FORMAT, VERSION = "uavdh_lite mission", 1
Cell = tuple[int, int]


def environment_of(city: str) -> Environment:
    """The environment of a city, by the city's name or its file."""
    return Environment(load_city(city))


def _require_inside(city: City, cell: Cell, what: str) -> None:
    if not all(0 <= axis < city.size for axis in cell):
        raise InputError(
            f"{what} at {tuple(cell)} is outside the city of {city.size} × {city.size} cells: "
            f"rows and columns go from 0 to {city.size - 1}"
        )


@dataclass(frozen=True, eq=False)
class Mission:
    """One episode: start, devices and their data, flying time, and the seed of the fading.

    Every change gives a new mission. A mission that cannot be flown raises `InputError`.

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
    max_devices: int = option(5, "how many devices there may be", ge=1, le=MAX_DEVICES)

    def __post_init__(self):
        require(self, "mission")
        self.state, self.fading  # noqa: B018 (they raise what is wrong)

    @classmethod
    def draw(cls, scenario: Scenario, city: City, seed: int) -> "Mission":
        """A random mission of a scenario; equal seeds draw equal ones in any language."""
        state = scenario.sample(Environment(city), 1, Portable(Use.MISSION, seed))
        used = state.data_initial[0] > 0
        start, *devices = (
            divmod(int(number), city.size)
            for number in (*state.uav_cell, *state.device_cells[0, used])
        )
        amounts = (round(float(amount), 1) for amount in state.data_initial[0, used])
        data = (max(amount, LEAST_DATA) for amount in amounts)
        flying_time = int(state.time_left[0])
        return cls(
            city, start, tuple(devices), tuple(data), flying_time, seed, scenario.max_devices
        )

    @cached_property
    def state(self) -> State:
        """The first state, a batch of one."""
        city, devices, data, places = self.city, self.devices, self.data, self.max_devices
        count = len(devices)
        if not 1 <= count <= places:
            change = "take some away" if devices else "add one"
            raise InputError(f"{count} devices: this scenario takes 1 to {places}; {change}")
        if len(data) != count:
            raise InputError(f"{count} devices but {len(data)} amounts of data: give one each")
        if not 1 <= self.flying_time < LIMIT:
            raise InputError(
                f"flying time {shown(self.flying_time)}: must be at least 1 and below {LIMIT}"
            )
        _require_inside(city, self.start, "the UAV")
        if city.no_fly[tuple(self.start)]:
            there = "a building" if city.buildings[tuple(self.start)] else "a no-fly zone"
            raise InputError(f"the UAV cannot start at {tuple(self.start)}, {there}: move it")
        for k, cell in enumerate(devices):
            _require_inside(city, cell, f"device {k}")
            for where, there in {
                "on a building": city.buildings[tuple(cell)],
                "in the landing zone": city.landing[tuple(cell)],
                "where another device stands": cell in devices[:k],
            }.items():
                if there:
                    raise InputError(f"device {k} at {tuple(cell)} stands {where}: move it")
            if not 0 <= data[k] < LIMIT:
                raise InputError(f"device {k} has {data[k]} data units: must be 0 to below {LIMIT}")
        device_cells = np.zeros((1, places), np.int16)
        data_initial = np.zeros((1, places), np.float32)
        device_cells[0, :count] = [row * city.size + col for row, col in devices]
        data_initial[0, :count] = data
        if not data_initial.any():
            raise InputError("no device has data: give at least one a positive amount, such as 0.1")
        return State(
            uav_cell=np.array([self.start[0] * city.size + self.start[1]], np.int16),
            time_left=np.array([self.flying_time], np.int16),
            device_cells=device_cells,
            data_initial=data_initial,
            data_left=data_initial.copy(),
            landed=np.array([False]),
            city=np.array([0], np.int16),
        )

    @property
    def fading(self) -> Portable:
        """A new generator of this mission's fading, as it is at the start."""
        return Portable(Use.FADING, self.seed)

    def state_in(self, environment: Environment) -> State:
        """The first state; raises `InputError` if the environment has another city."""
        if fingerprint_of(environment.cities) != self.city.fingerprint:
            here, there = described((self.city,)), described(environment.cities)
            fitting = "fly it in Environment(mission.city)"
            raise InputError(f"this mission is over {here}, not over {there}: {fitting}")
        return self.state

    def fly(self, environment: Environment, policy: Policy) -> Flights:
        """Fly a policy and keep every step; missions with equal seeds have equal fading.

        Raises `InputError` if the environment has another city, or if the policy is made for one.
        """
        return fly(environment, policy, self.state_in(environment), self.fading)

    def fill(self, device: int, amount: float) -> "Mission":
        """The mission with this much data at a device, data units."""
        if device not in range(len(self.data)):
            raise InputError(f"no device {shown(device)}: there are 0 to {len(self.data) - 1}")
        return replace(self, data=(*self.data[:device], amount, *self.data[device + 1 :]))


class HandFlight:
    """A mission flown step by step, with each action chosen when it is due.

    It has the same fading as any policy that flies the mission. `InputError` for another city.

    | attribute | meaning |
    | --- | --- |
    | `state` | where the flight is now, a batch of one |
    | `ended` | whether it has landed or run out of time |
    """

    def __init__(self, environment: Environment, mission: Mission):
        self.environment, self.mission = environment, mission
        self.state = mission.state_in(environment)
        self._generator = mission.fading
        self._history: list[Step] = []

    @property
    def ended(self) -> bool:
        return bool(self.state.ended[0])

    def step(self, action: int) -> Outcome:
        """Take one action, an index into `ACTIONS`; `InputError` after the end."""
        if self.ended:
            raise InputError("this flight is over: start another one")
        taken = np.array([action])
        after, outcome = self.environment.step(self.state, taken, self._generator)
        self._history.append(Step(self.state, taken, outcome, REPORTED(outcome)))
        self.state = after
        return outcome

    def flights(self) -> Flights:
        """The flight so far."""
        return Flights(self.mission.state, self.state, list(self._history))


def save_mission(path: str | Path, mission: Mission) -> None:
    """Write a mission, atomically."""
    write_json(path, as_json(mission))


def as_json(mission: Mission) -> dict:
    """What a mission's file holds."""
    pairs = zip(mission.devices, mission.data, strict=True)
    return {
        "format": FORMAT,
        "version": VERSION,
        "city": {"name": mission.city.name, "rows": mission.city.text.split()},
        "start": list(mission.start),
        "devices": [{"cell": list(cell), "data": data} for cell, data in pairs],
        "flying_time": mission.flying_time,
        "seed": mission.seed,
        "max_devices": mission.max_devices,
    }


def load_mission(path: str | Path) -> Mission:
    """Read a mission; `InputError` names the file and what is wrong in it."""
    values = read_json(path)
    try:
        return mission_from_json(values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def mission_from_json(values: Any) -> Mission:
    """The mission that a file holds; `InputError` names what is missing or wrong."""
    try:
        kind = values["format"], values["version"]
        if kind != (FORMAT, VERSION):
            raise InputError(f"format and version are {shown(kind)}, must be {(FORMAT, VERSION)}")
        return Mission(
            City.from_text(values["city"]["name"], "\n".join(values["city"]["rows"])),
            values["start"],
            tuple(device["cell"] for device in values["devices"]),
            tuple(device["data"] for device in values["devices"]),
            values["flying_time"],
            values["seed"],
            values["max_devices"],
        )
    except (LookupError, TypeError) as error:
        raise InputError(f"not the entries of a mission ({error!r})") from None
