"""What the stage shows: one mission, who flies it, and what one looks at.

A `Stage` never changes. `changed` makes the next one from what somebody does in the browser. As
JSON it is the saved file, and packed into letters it is the page's address.
"""

import base64
import io
import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uavdh_lite.city import SIGNS, City, load_city, shipped_cities
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.missions import FORMAT as MISSION_FORMAT
from uavdh_lite.missions import LARGEST, Mission, as_json, mission_from_json
from uavdh_lite.policies import agents_for, policies_for
from uavdh_lite.scenario import Scenario, find_scenario

FORMAT, VERSION = "uavdh_lite stage", 1
TOOLS = ("fly", "compare", "think", "channel", "paint", "train")
LETTERS = "neswhl"  # of the actions, in their order
YOU = "you"
EMPTY = {"empty 8 × 8": 8, "empty 12 × 12": 12, "empty 16 × 16": 16}
STORY = 114  # the mission that the stage begins with
MOST_FLOWN = 400  # actions by hand


@dataclass(frozen=True, eq=False)
class Stage:
    """One mission and how it is looked at.

    | field | meaning |
    | --- | --- |
    | `policies` | names of the two that fly it; `you` is the flight by hand |
    | `tool` | one of `TOOLS` |
    | `flown` | the actions that were flown by hand, in `LETTERS` |
    | `step` | the step that is shown; −1 for the last |
    | `device` | the device whose radio link is shown |

    Raises `InputError` for a tool, an action or a device that there is not. `known_policies` says
    who can fly over a city.
    """

    mission: Mission
    policies: tuple[str, str]
    tool: str = "compare"
    flown: str = ""
    step: int = -1
    device: int = 0

    def __post_init__(self):
        _require(self.tool in TOOLS, f"tool {self.tool!r}: choose one of {', '.join(TOOLS)}")
        _require(set(self.flown) <= set(LETTERS), f"flown has other letters than {LETTERS}")
        _require(len(self.flown) <= MOST_FLOWN, f"flown has more than {MOST_FLOWN} actions")
        places = len(self.mission.devices)
        _require(0 <= self.device < places, f"device {self.device}: there are {places}")
        _require(self.step >= -1, f"step {self.step}: must be at least -1")

    @classmethod
    def of(cls, mission: Mission, tool: str = "compare") -> "Stage":
        """The stage of a mission, with the agent and greedy."""
        return cls(mission, usual_policies(mission.city), tool)

    def with_mission(self, mission: Mission) -> "Stage":
        """The same look at another mission; what was flown by hand was flown in the old one."""
        policies = self.policies
        if mission.city is not self.mission.city:
            known, usual = known_policies(mission.city), usual_policies(mission.city)
            before = usual_policies(self.mission.city)
            policies = tuple(
                name if name in known and name != old else new
                for name, old, new in zip(policies, before, usual, strict=True)
            )
        device = min(self.device, len(mission.devices) - 1)
        return replace(self, mission=mission, policies=policies, flown="", step=-1, device=device)

    def as_json(self) -> dict[str, Any]:
        """What the saved file holds."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "tool": self.tool,
            "mission": as_json(self.mission),
            "policies": list(self.policies),
            "flown": self.flown,
            "step": self.step,
            "device": self.device,
        }

    @property
    def link(self) -> str:
        """The state in letters that may stand in an address."""
        text = json.dumps(self.as_json(), separators=(",", ":"))
        return base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


def known_policies(city: City, *names: str) -> list[str]:
    """Who can fly over a city; raises `InputError` if one of these names cannot."""
    known = [*policies_for(Environment(city)), YOU]
    for name in names:
        choices = ", ".join(known)
        _require(name in known, f"{name!r} does not fly over this city: take {choices}")
    return known


def usual_policies(city: City) -> tuple[str, str]:
    """The agent and its rival: the paper's method where it is trained for the city."""
    agents = agents_for(Environment(city))
    ours = next((name for name in agents if name.endswith("_ddqn")), None)
    return ours or next(iter(agents), "random"), "greedy"


def scenario_of(city: City) -> Scenario:
    """What missions over a city are drawn from; over a painted one, time to cross it twice."""
    if city.name in shipped_cities() and load_city(city.name).fingerprint == city.fingerprint:
        return find_scenario(city.name)
    most, time = min(3, city.open_to_devices.sum()), (2 * city.size, 4 * city.size)
    return Scenario(city.name, devices=(1, most), flying_time=time)


def random_mission(city: City, number: int) -> Mission:
    """A random mission over a city."""
    return Mission.draw(scenario_of(city), city, number)


def read_link(link: str) -> Stage:
    """The stage of a link; `InputError` says why it cannot be opened."""
    try:
        packed = base64.urlsafe_b64decode(link + "=" * (-len(link) % 4))
        packer = zlib.decompressobj()
        text = packer.decompress(packed, LARGEST).decode()
        _require(packer.eof, "cut off")
    except (ValueError, zlib.error):
        raise InputError("this link is damaged: copy it again, as a whole") from None
    return read_file(text)


def read_file(text: str) -> Stage:
    """The stage of a saved file, or of a mission's file."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("this file is no JSON: open one that was saved here") from None
    _require(isinstance(values, dict), "this file holds no stage and no mission")
    if values.get("format") == MISSION_FORMAT:
        return Stage.of(mission_from_json(values))
    told = values.get("format"), values.get("version")
    _require(told == (FORMAT, VERSION), f"this file holds no stage and no mission: {told[0]!r}")
    policies = values.get("policies")
    pair = isinstance(policies, list) and len(policies) == 2
    _require(pair and all(isinstance(name, str) for name in policies), "policies: give two names")
    mission = mission_from_json(values.get("mission"))
    known_policies(mission.city, *policies)
    return Stage(
        mission,
        tuple(policies),
        _text(values.get("tool")),
        _text(values.get("flown")),
        _whole(values.get("step"), "step"),
        _whole(values.get("device"), "device"),
    )


def changed(stage: Stage, kind: str, values: dict[str, Any]) -> Stage:
    """The stage after something was done in the browser; `InputError` says why it was not."""
    return CHANGES[kind](stage, **values)


def _city(stage: Stage, name: str) -> Stage:
    if name in EMPTY:
        size = EMPTY[name]
        kinds = np.zeros((size, size), np.uint8)
        kinds[:2, :2] = 3  # a landing zone, without which there is no city
        return stage.with_mission(random_mission(City.from_kinds("my_city", kinds), 0))
    _require(name in shipped_cities(), f"no city {name!r}")
    return stage.with_mission(random_mission(load_city(name), 0))


def _move(stage: Stage, device: int, cell: list) -> Stage:
    """Move a device, or with −1 the start."""
    mission, cell = stage.mission, _cell(cell)
    if device == -1:
        return stage.with_mission(replace(mission, start=cell))
    return stage.with_mission(mission.move(_device(stage, device), cell))


def _data(stage: Stage, device: int, value: float) -> Stage:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    _require(number and np.isfinite(value), f"data {value!r}: must be a number")
    return stage.with_mission(stage.mission.fill(_device(stage, device), float(value)))


def _policy(stage: Stage, which: int, name: str) -> Stage:
    _require(which in (0, 1), f"policy {which!r}: there are two")
    policies = list(stage.policies)
    policies[which] = _text(name)
    if stage.tool == "think" and policies[0] == policies[1]:  # who thinks does not fly twice
        policies[1 - which] = stage.policies[which]
    known_policies(stage.mission.city, *policies)
    return replace(stage, policies=tuple(policies), step=-1)


def _fly(stage: Stage, action: str) -> Stage:
    return replace(stage, flown=stage.flown + LETTERS[ACTIONS.index(action)])


def _paint(stage: Stage, cells: list, sign: str) -> Stage:
    """Paint cells with one of the city's signs; what stands there moves to the nearest cell."""
    mission = stage.mission
    kinds = mission.city.kinds.copy()
    _require(len(_text(sign)) == 1 and sign in SIGNS, f"sign {sign!r}: choose one of {SIGNS}")
    for cell in map(_cell, cells):
        _require(all(0 <= axis < len(kinds) for axis in cell), f"{cell} is outside of the city")
        kinds[cell] = SIGNS.index(sign)
    city = City.from_kinds("my_city", kinds)
    devices: list[tuple[int, int]] = []
    for device in mission.devices:
        free = city.open_to_devices.copy()
        free[tuple(np.array(devices, int).reshape(-1, 2).T)] = False
        _require(free.any(), "no cell is left for the devices: leave some free")
        devices.append(_nearest(free, device))
    start = _nearest(city.landing, mission.start) if city.no_fly[mission.start] else mission.start
    return stage.with_mission(replace(mission, city=city, devices=tuple(devices), start=start))


def _open(stage: Stage, text: str = "", link: str = "", picture: str = "") -> Stage:
    """Open a saved file, a link, or a city's PNG in base64."""
    if picture:
        content = io.BytesIO(base64.b64decode(_text(picture)))
        city = replace(City.load(content), name="my_city")
        return stage.with_mission(random_mission(city, 0))
    return read_link(_text(link)) if link else read_file(_text(text))


CHANGES: dict[str, Callable[..., Stage]] = {
    "city": _city,
    "move": _move,
    "data": _data,
    "policy": _policy,
    "fly": _fly,
    "paint": _paint,
    "open": _open,
    "tool": lambda stage, tool: replace(stage, tool=_text(tool)),
    "show": lambda stage, step: replace(stage, step=_whole(step, "step")),
    "look": lambda stage, device: replace(stage, device=_device(stage, device)),
    "again": lambda stage: replace(stage, flown=""),
    "new": lambda stage: stage.with_mission(
        random_mission(stage.mission.city, stage.mission.seed + 1)
    ),
    "add": lambda stage, cell: stage.with_mission(stage.mission.add(_cell(cell))),
    "remove": lambda stage, device: stage.with_mission(
        stage.mission.remove(_device(stage, device))
    ),
    "time": lambda stage, value: stage.with_mission(
        replace(stage.mission, flying_time=_whole(value, "flying time"))
    ),
}


def _nearest(mask: np.ndarray, cell: tuple[int, int]) -> tuple[int, int]:
    cells = np.argwhere(mask)
    row, col = cells[np.abs(cells - cell).sum(axis=1).argmin()]
    return int(row), int(col)


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise InputError(otherwise)


def _text(value: Any) -> str:
    _require(isinstance(value, str), f"{value!r} is no text")
    return value


def _whole(value: Any, name: str) -> int:
    given = name if value is None else f"{name} {value!r}"  # None: the field is empty
    _require(type(value) is int, f"{given}: must be a whole number")
    return value


def _cell(value: Any) -> tuple[int, int]:
    _require(isinstance(value, list) and len(value) == 2, f"{value!r} is no cell")
    row, col = value
    return _whole(row, "row"), _whole(col, "column")


def _device(stage: Stage, device: Any) -> int:
    there = len(stage.mission.devices)
    found = 0 <= _whole(device, "device") < there
    _require(found, f"device {device}: there are {there}")
    return device
