"""Missions as JSON files, to keep, share and replay an exact episode, its fading included.

`schemas/mission.schema.json` describes the format. The city is in the file, so that the episode
stays the same wherever and whenever it is flown, and a checksum, which shows damage. Who edits a
file by hand takes the entry `sha256` out.
"""

import hashlib
import json
from pathlib import Path

from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match

from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.mission import Mission
from uavdh_lite.tables import write_json

FORMAT, VERSION = "uavdh_lite mission", 1
SCHEMA = Path(__file__).parent / "schemas" / "mission.schema.json"
LARGEST = 1_000_000  # bytes; the largest city takes a hundredth of that


def save_mission(path: str | Path, mission: Mission) -> None:
    """Write a mission; atomically."""
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
    write_json(path, {**values, "sha256": _digest(values)})


def load_mission(path: str | Path) -> Mission:
    """Read a mission; `InputError` names the file and what is wrong in it."""
    path = Path(path)
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: {path.stat().st_size} bytes: no mission is that large")
    try:
        values = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a JSON file: {error}") from None
    try:
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
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _digest(values: dict) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _check(values) -> None:
    """Raise `InputError` with the place and the reason unless the values are as the schema says."""
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    error = best_match(Draft202012Validator(schema).iter_errors(values))
    if error is not None:
        place = error.json_path.removeprefix("$").removeprefix(".") or "the file"
        message = error.message if len(error.message) <= 200 else f"{error.message[:200]}..."
        raise InputError(f"{place}: {message}")
