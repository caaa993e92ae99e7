"""Mission files: round trips, exact replays, and what is wrong with a file that is none."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from uavdh_lite.city import City
from uavdh_lite.cli.main import main
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.missions import SCHEMA, Mission, load_mission, save_mission
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import SCENARIOS

CITY = City.load("village")


@pytest.fixture
def mission():
    return Mission(CITY, (0, 0), ((4, 1), (0, 7)), (15.0, 0.1 + 0.2), 24, seed=2**40)


def same(one, other):
    assert one.city.fingerprint == other.city.fingerprint and one.city.name == other.city.name
    for name in ("start", "devices", "data", "flying_time", "seed", "max_devices"):
        assert getattr(one, name) == getattr(other, name), name


def test_round_trip_and_replay(mission, tmp_path):
    save_mission(tmp_path / "m.json", mission)
    again = load_mission(tmp_path / "m.json")
    same(again, mission)
    environment = Environment(CITY)
    flights = [m.fly(environment, Greedy(environment)).trajectory(0) for m in (mission, again)]
    for name in ("uav_cell", "data_left", "uploaded", "reward"):
        assert np.array_equal(getattr(flights[0], name), getattr(flights[1], name)), name


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), scenario=st.sampled_from(sorted(SCENARIOS)))
def test_every_random_mission_survives(seed, scenario, tmp_path_factory):
    preset = SCENARIOS[scenario]
    mission = Mission.draw(preset, City.load(preset.city), seed)
    path = tmp_path_factory.mktemp("missions") / "m.json"
    save_mission(path, mission)
    same(load_mission(path), mission)


def test_the_schema_is_one_and_the_files_follow_it(mission, tmp_path):
    schema = json.loads(SCHEMA.read_text())
    Draft202012Validator.check_schema(schema)
    save_mission(tmp_path / "m.json", mission)
    Draft202012Validator(schema).validate(json.loads((tmp_path / "m.json").read_text()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "something else"}, r"format: 'uavdh_lite mission' was expected"),
        ({"version": 3}, "version: 2 was expected"),
        ({"version": 1}, "of version 1, whose fading came from other random streams"),
        ({"start": [0]}, r"start: \[0\] is too short"),
        ({"start": [0, 99]}, r"the UAV at \(0, 99\) is outside the city"),
        ({"devices": []}, r"devices: \[\] should be non-empty"),
        ({"devices": [{"cell": [4, 1], "data": -1}]}, r"devices\[0\].data: -1 is less than"),
        ({"devices": [{"cell": [4, 1], "data": "15"}]}, r"devices\[0\].data: '15' is not of type"),
        ({"devices": [{"cell": [0, 0], "data": 1}]}, r"device 0 stands in the landing zone"),
        ({"flying_time": 0}, "flying_time: 0 is less than the minimum of 1"),
        ({"flying_time": 40_000}, "flying_time: 40000 is greater than"),
        ({"seed": -1}, "seed: -1 is less than"),
        ({"seed": None}, "seed: None is not of type 'integer'"),
        ({"more": 1}, r"the file: Additional properties are not allowed \('more'"),
        ({"city": {"name": "x", "rows": ["L.", "?."]}}, r"city.rows\[1\]: '\?.' does not match"),
        ({"city": {"name": "x", "rows": ["L.", "."]}}, "x: 2 rows, but row 1 has 1 cells"),
        ({"city": {"name": "x", "rows": ["..", ".."]}}, "no start and landing zone"),
    ],
)
def test_what_is_wrong_is_named(mission, tmp_path, change, message):
    path = tmp_path / "m.json"
    save_mission(path, mission)
    values = json.loads(path.read_text())
    del values["sha256"]
    path.write_text(json.dumps({**values, **change}))
    with pytest.raises(InputError, match=rf"m\.json: .*{message}"):
        load_mission(path)


def test_a_changed_file_is_noticed_and_an_edited_one_is_read(mission, tmp_path):
    path = tmp_path / "m.json"
    save_mission(path, mission)
    values = {**json.loads(path.read_text()), "flying_time": 25}
    path.write_text(json.dumps(values))
    with pytest.raises(
        InputError, match=r"m\.json: changed since it was saved.*take that entry out"
    ):
        load_mission(path)
    del values["sha256"]
    path.write_text(json.dumps(values))
    assert load_mission(path).flying_time == 25


@pytest.mark.parametrize(
    "data", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"NaN", b"[]", b"null", b"1" * 5000]
)
def test_foreign_files(tmp_path, data):
    path = tmp_path / "m.json"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"m\.json: "):
        load_mission(path)


def test_a_huge_file_is_not_read(tmp_path):
    path = tmp_path / "m.json"
    path.write_bytes(b" " * 2_000_000)
    with pytest.raises(InputError, match="2000000 bytes: no mission is that large"):
        load_mission(path)


def test_fly_saves_and_replays(tmp_path, capsys):
    file, out = str(tmp_path / "m.json"), str(tmp_path / "f.png")
    arguments = ["fly", "--devices", "4,4", "8,9", "--seed", "5", "--out", out]
    assert main([*arguments, "--save-mission", file]) == 0
    first = capsys.readouterr().out
    assert main(["fly", "--mission", file, "--out", out]) == 0
    assert capsys.readouterr().out == first
    assert load_mission(file).devices == ((4, 4), (8, 9))
