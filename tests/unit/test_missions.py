"""Missions that a person sets, saves and shares.

Files: round trips, exact replays, and what is wrong with one that holds no mission.
"""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.missions import SCHEMA, HandFlight, Mission, load_mission, save_mission
from uavdh_lite.planners import Greedy
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream

VILLAGE = City.load("village")


@pytest.fixture(scope="module")
def environment():
    return Environment(City.load("manhattan"))


@pytest.fixture
def mission(environment):
    return Mission(environment.city, (0, 0), ((4, 4), (7, 9)), (10.0, 5.0), 40)


def test_a_drawn_mission_is_the_scenarios(environment):
    scenario = SCENARIOS["manhattan"]
    drawn = Mission.draw(scenario, environment.city, 3)
    state = scenario.sample(environment.city, 1, stream(Use.MISSION, 3))
    assert drawn.flying_time == state.time_left[0]
    assert len(drawn.devices) == (state.data_initial > 0).sum()
    assert drawn.data == pytest.approx(state.data_initial[state.data_initial > 0], abs=0.05)
    assert (drawn.state.device_cells[0, : len(drawn.devices)]).tolist() == (
        state.device_cells[0, : len(drawn.devices)].tolist()
    )


def test_what_is_given_is_not_drawn(environment):
    scenario, city = SCENARIOS["manhattan"], environment.city
    drawn = Mission.draw(scenario, city, 3)
    timed = Mission.draw(scenario, city, 3, start=(0, 1), flying_time=50)
    assert (timed.start, timed.flying_time) == ((0, 1), 50)
    assert (timed.devices, timed.data) == (drawn.devices, drawn.data)
    moved = Mission.draw(scenario, city, 3, devices=((4, 4), *drawn.devices[1:]))
    assert moved.devices[0] == (4, 4) and moved.data == drawn.data
    for number in range(1, 6):
        cells = ((4, 4), (7, 9), (8, 8), (8, 1), (8, 2))[:number]
        data = Mission.draw(scenario, city, 3, devices=cells).data
        assert len(data) == number and all(5 <= amount <= 20 for amount in data)
    assert Mission.draw(scenario, city, 3, devices=cells[:1], data=(7.0,)).data == (7.0,)
    with pytest.raises(InputError, match="1 devices but 2 amounts of data"):
        Mission.draw(scenario, city, 3, devices=cells[:1], data=(7.0, 8.0))


def test_changes_leave_the_mission_as_it_was(mission):
    assert mission.add((8, 8), 3).devices == ((4, 4), (7, 9), (8, 8))
    assert mission.add((8, 8), 3).data == (10.0, 5.0, 3)
    assert mission.move(0, (8, 8)).devices == ((8, 8), (7, 9))
    assert mission.remove(0).devices == ((7, 9),) and mission.remove(0).data == (5.0,)
    assert mission.devices == ((4, 4), (7, 9))
    assert mission.device_at((7, 9)) == 1 and mission.device_at((0, 5)) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.add((2, 2)), "device 2 stands on a building"),
        (lambda m: m.add((0, 1)), "device 2 stands in the landing zone"),
        (lambda m: m.add((4, 4)), "where another device stands"),
        (lambda m: m.move(5, (8, 8)), "no device 5: there are 2"),
        (lambda m: m.remove(0).remove(0), "0 devices: this scenario takes 1 to 5"),
        (lambda m: m.add((8, 1)).add((8, 2)).add((8, 3)).add((8, 4)), "6 devices"),
    ],
)
def test_what_cannot_be_flown_is_named(mission, change, message):
    with pytest.raises(InputError, match=message):
        change(mission)


@pytest.mark.parametrize("name", ["manhattan", "greedy", "genie", "random"])
def test_a_flight_depends_on_mission_and_seed_alone(environment, mission, name):
    first, second = (
        mission.fly(environment, find_policy(name, environment, 7)).trajectory(0) for _ in range(2)
    )
    assert (first.uav_cell == second.uav_cell).all()
    assert (first.uploaded == second.uploaded).all()


@pytest.mark.parametrize("name", ["manhattan", "manhattan_ddqn"])
def test_a_flight_by_hand_is_the_policys_with_the_same_actions(environment, mission, name):
    flown = mission.fly(environment, find_policy(name, environment))
    by_hand = HandFlight(environment, mission)
    for action in flown.trajectory(0).action:
        by_hand.step(int(action))
    assert by_hand.ended
    ours, theirs = by_hand.flights(), flown
    for metric, values in theirs.records().items():
        assert ours.records()[metric] == pytest.approx(values, rel=1e-5), metric
    assert (ours.trajectory(0).uploaded == theirs.trajectory(0).uploaded).all()
    with pytest.raises(InputError, match="this flight is over"):
        by_hand.step(0)


def test_a_flight_by_hand_can_be_looked_at_before_its_first_step(environment, mission):
    trajectory = HandFlight(environment, mission).flights().trajectory(0)
    assert trajectory.uav_cell.tolist() == [0] and len(trajectory.action) == 0


@pytest.fixture
def original():
    return Mission(VILLAGE, (0, 0), ((4, 1), (0, 7)), (15.0, 0.1 + 0.2), 24, seed=2**40)


def same(one, other):
    assert one.city.fingerprint == other.city.fingerprint and one.city.name == other.city.name
    for name in ("start", "devices", "data", "flying_time", "seed", "max_devices"):
        assert getattr(one, name) == getattr(other, name), name


def test_round_trip_and_replay(original, tmp_path):
    save_mission(tmp_path / "m.json", original)
    again = load_mission(tmp_path / "m.json")
    same(again, original)
    environment = Environment(VILLAGE)
    flights = [m.fly(environment, Greedy(environment)).trajectory(0) for m in (original, again)]
    for name in ("uav_cell", "data_left", "uploaded", "reward"):
        assert np.array_equal(getattr(flights[0], name), getattr(flights[1], name)), name


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(sorted(set(SCENARIOS) - {"any_city", "any_size"})))
def test_every_random_mission_survives(tmp_path_factory, seed, scenario):
    preset = SCENARIOS[scenario]
    mission = Mission.draw(preset, City.load(preset.city), seed)
    path = tmp_path_factory.mktemp("missions") / "m.json"
    save_mission(path, mission)
    same(load_mission(path), mission)


def test_the_schema_is_one_and_the_files_follow_it(original, tmp_path):
    schema = json.loads(SCHEMA.read_text())
    Draft202012Validator.check_schema(schema)
    save_mission(tmp_path / "m.json", original)
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
def test_what_is_wrong_is_named(original, tmp_path, change, message):
    path = tmp_path / "m.json"
    save_mission(path, original)
    values = json.loads(path.read_text())
    del values["sha256"]
    path.write_text(json.dumps({**values, **change}))
    with pytest.raises(InputError, match=rf"m\.json: .*{message}"):
        load_mission(path)


def test_a_changed_file_is_noticed_and_an_edited_one_is_read(original, tmp_path):
    path = tmp_path / "m.json"
    save_mission(path, original)
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


def test_what_is_in_a_cell_is_dragged_and_devices_are_filled():
    mission = Mission.draw(SCENARIOS["village"], City.load("village"), 0)
    (device, *others), free = mission.devices, (7, 0)
    moved = mission.drag(device, free)
    assert moved.devices == (free, *others) and moved.start == mission.start
    begun = mission.drag(mission.start, (0, 0))
    assert begun.start == (0, 0) and begun.devices == mission.devices
    assert mission.drag(free, (6, 0)) is mission  # nothing is there
    assert mission.fill(0, 3.5).data == (3.5, *mission.data[1:])
    with pytest.raises(InputError, match="no device 9"):
        mission.fill(9, 1.0)
