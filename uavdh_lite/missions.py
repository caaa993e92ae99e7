"""A mission that a person sets, flies and shares.

A mission file is JSON; `schemas/mission.schema.json` describes it. It holds the city, so the
episode stays the same wherever and whenever it is flown, and a checksum, which reveals damage. If
you edit a file by hand, delete the entry `sha256`.
"""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import Environment, Outcome, Rewards, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Policy, Step, fly
from uavdh_lite.scenario import Scenario, place
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use, stream

FORMAT, VERSION = "uavdh_lite mission", 2  # version 1 drew its fading from another stream
SCHEMA = Path(__file__).parent / "schemas" / "mission.schema.json"
LARGEST = 1_000_000  # bytes; the largest city takes a hundredth of that
Cell = tuple[int, int]


@cache
def environment_of(city: str) -> Environment:
    """The environment of a shipped city, made once."""
    return Environment(City.load(city))


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
    max_devices: int = 5

    def __post_init__(self):
        self.state  # noqa: B018 (raises what is wrong with it)

    @classmethod
    def draw(
        cls,
        scenario: Scenario,
        city: City,
        seed: int,
        start: Cell | None = None,
        devices: tuple[Cell, ...] | None = None,
        data: tuple[float, ...] | None = None,
        flying_time: int | None = None,
    ) -> "Mission":
        """A random mission of a scenario; what is given is not drawn."""
        generator = stream(Use.MISSION, seed)
        state = scenario.sample(city, 1, generator)
        used = np.flatnonzero(state.data_initial[0] > 0)

        def cell(number) -> Cell:
            return divmod(int(number), city.size)

        if devices is None:
            devices = tuple(cell(number) for number in state.device_cells[0, used])
        if data is None:
            drawn = state.data_initial[0, used]
            if len(devices) != len(drawn):
                drawn = generator.uniform(*scenario.data, len(devices))
            data = tuple(round(float(amount), 1) for amount in drawn)
        return cls(
            city,
            cell(state.uav_cell[0]) if start is None else start,
            devices,
            data,
            int(state.time_left[0]) if flying_time is None else flying_time,
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

    @property
    def fading(self) -> np.random.Generator:
        """A new generator of this mission's fading, as it is at the start."""
        return stream(Use.FADING, self.seed)

    def fly(self, environment: Environment, policy: Policy) -> Flights:
        """Fly a policy and keep every step; missions with equal seeds have equal fading."""
        return fly(environment, policy, self.state, self.fading, record=True)

    def device_at(self, cell: Cell) -> int | None:
        """The device in this cell, or None."""
        return self.devices.index(cell) if cell in self.devices else None

    def add(self, cell: Cell, data: float = 10.0) -> "Mission":
        """The mission with one more device."""
        return replace(self, devices=(*self.devices, cell), data=(*self.data, data))

    def move(self, device: int, cell: Cell) -> "Mission":
        """The mission with this device in another cell."""
        self._require(device)
        devices = list(self.devices)
        devices[device] = cell
        return replace(self, devices=tuple(devices))

    def drag(self, start: Cell, end: Cell) -> "Mission":
        """The mission with the device, or else the start, that is in one cell in another one."""
        device = self.device_at(start)
        if device is not None:
            return self.move(device, end)
        return replace(self, start=end) if start == self.start else self

    def fill(self, device: int, amount: float) -> "Mission":
        """The mission with this much data at a device, data units."""
        self._require(device)
        data = list(self.data)
        data[device] = amount
        return replace(self, data=tuple(data))

    def remove(self, device: int) -> "Mission":
        """The mission without this device; those after it move up."""
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
    """A mission flown step by step, with each action chosen when it is due.

    It has the same fading as any policy that flies the mission.

    | attribute | meaning |
    | --- | --- |
    | `state` | where the flight is now, a batch of one |
    | `ended` | whether it has landed or run out of time |
    """

    def __init__(self, environment: Environment, mission: Mission):
        self.environment, self.mission = environment, mission
        self.state = mission.state
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
        self._history.append(Step(self.state, taken, outcome, Rewards()(outcome)))
        self.state = after
        return outcome

    def flights(self) -> Flights:
        """The flight so far."""
        return Flights.of_steps(self.mission.state, self.state, self._history)


def save_mission(path: str | Path, mission: Mission) -> None:
    """Write a mission, atomically."""
    write_json(path, as_json(mission))


def as_json(mission: Mission) -> dict:
    """What a mission's file holds."""
    values = {
        "format": FORMAT,
        "version": VERSION,
        "city": {"name": mission.city.name, "rows": mission.city.text.split()},
        "start": list(mission.start),
        "devices": [
            {"cell": list(cell), "data": data}
            for cell, data in zip(mission.devices, mission.data, strict=True)
        ],
        "flying_time": mission.flying_time,
        "seed": mission.seed,
        "max_devices": mission.max_devices,
    }
    return {**values, "sha256": _digest(values)}


def load_mission(path: str | Path) -> Mission:
    """Read a mission; `InputError` names the file and what is wrong in it."""
    path = Path(path)
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: {path.stat().st_size} bytes: no mission is that large")
    try:
        return read_mission(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a JSON file: {error}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_mission(text: str) -> Mission:
    """The mission that is written in a file; `InputError` says what is wrong in it."""
    try:
        values = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a JSON file: {error}") from None
    if isinstance(values, dict) and values.get("version") == 1:
        raise InputError(
            "of version 1, whose fading came from other random streams: its flight would "
            'differ; to fly it all the same, set "version" to 2 and take the entry "sha256" out'
        )
    _check(values)
    expected = values.pop("sha256", None)
    if expected not in (None, _digest(values)):
        raise InputError(
            "changed since it was saved: its sha256 is another; if you meant to edit it, take "
            "that entry out"
        )
    city = City.from_text(values["city"]["name"], "\n".join(values["city"]["rows"]))
    return Mission(
        city,
        tuple(values["start"]),
        tuple(tuple(device["cell"]) for device in values["devices"]),
        tuple(float(device["data"]) for device in values["devices"]),
        values["flying_time"],
        values["seed"],
        values["max_devices"],
    )


def _digest(values: dict) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _check(values) -> None:
    """Raise `InputError` with the place and the reason unless the values are as the schema says."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    error = best_match(Draft202012Validator(schema).iter_errors(values))
    if error is not None:
        field = error.json_path.removeprefix("$").removeprefix(".") or "the file"
        message = error.message if len(error.message) <= 200 else f"{error.message[:200]}..."
        raise InputError(f"{field}: {message}")
