"""Missions that a person sets, saves and shares."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from uavdh_lite import missions
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.missions import HandFlight, Mission, as_json, load_mission, save_mission
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import MAX_DEVICES, find_scenario
from uavdh_lite.streams import Portable, Use

VILLAGE = City.load("village")
SCHEMA = Path(missions.__file__).parent / "schemas" / "mission.schema.json"
MANHATTAN = Environment(City.load("manhattan"))


@pytest.fixture
def mission():
    return Mission(MANHATTAN.city, (0, 0), ((4, 4), (7, 9)), (10.0, 5.0), 40)


def test_a_state_that_is_placed_by_hand():
    state = Mission(MANHATTAN.city, (0, 1), [(4, 4), (7, 9)], [10.0, 5.0], 40, max_devices=3).state
    assert state.uav_cell.tolist() == [1] and state.time_left.tolist() == [40]
    assert state.device_cells.tolist() == [[4 * 16 + 4, 7 * 16 + 9, 0]]
    assert state.data_initial.tolist() == state.data_left.tolist() == [[10, 5, 0]]
    assert not state.landed.any() and state.city.tolist() == [0]


def test_a_drawn_mission_is_the_scenarios():
    scenario = find_scenario("manhattan")
    drawn = Mission.draw(scenario, MANHATTAN.city, 3)
    state = scenario.sample(MANHATTAN, 1, Portable(Use.MISSION, 3))
    number = (state.data_initial > 0).sum()
    assert drawn.flying_time == state.time_left[0] and len(drawn.devices) == number
    assert drawn.data == pytest.approx(state.data_initial[state.data_initial > 0], abs=0.05)
    cells = drawn.state.device_cells[0, :number]
    assert cells.tolist() == state.device_cells[0, :number].tolist()


def test_a_mission_is_flown_over_its_own_city_alone(mission):
    for city in (VILLAGE, (MANHATTAN.city, VILLAGE)):
        world = Environment(city)
        named = r"over manhattan \(1 of 16 × 16 cells\), not "
        with pytest.raises(InputError, match=named):
            mission.fly(world, find_policy("greedy", world))
        with pytest.raises(InputError, match=named):
            HandFlight(world, mission)


def test_another_amount_leaves_the_mission_as_it_was(mission):
    assert mission.fill(1, 3.5).data == (10.0, 3.5) and mission.data == (10.0, 5.0)


@pytest.mark.parametrize("name", ["manhattan", "random"])
def test_a_flight_by_hand_is_the_policys_with_the_same_actions(mission, name):
    flown = mission.fly(MANHATTAN, find_policy(name, MANHATTAN, 7))
    again = mission.fly(MANHATTAN, find_policy(name, MANHATTAN, 7))
    by_hand = HandFlight(MANHATTAN, mission)
    assert by_hand.flights().trajectory(0).uav_cell.tolist() == [0]  # before its first step
    for action in flown.trajectory(0).action:
        by_hand.step(int(action))
    assert by_hand.ended
    for flights in (by_hand.flights(), again):
        for metric, values in flown.records().items():
            assert flights.records()[metric] == pytest.approx(values, rel=1e-5), metric
        assert (flights.trajectory(0).data_left == flown.trajectory(0).data_left).all()
    with pytest.raises(InputError, match="over"):
        by_hand.step(0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(["manhattan", "village"]))
def test_every_mission_comes_back_from_a_file_that_follows_the_schema(
    tmp_path_factory, seed, scenario
):
    preset = find_scenario(scenario)
    drawn = Mission.draw(preset, City.load(preset.city), seed)
    path = tmp_path_factory.mktemp("missions") / "m.json"
    for mission in (drawn, replace(drawn, seed=2**53 - 1, max_devices=MAX_DEVICES)):
        save_mission(path, mission)
        again = load_mission(path)
        assert again.city.fingerprint == mission.city.fingerprint
        assert as_json(again) == as_json(mission)
        Draft202012Validator(json.loads(SCHEMA.read_text())).validate(as_json(mission))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"format": "something else"}, "format"),
        ({"start": [0]}, "start"),
        ({"start": [0, 99]}, r"\(0, 99\)"),
        ({"devices": [{"cell": [4, 1]}]}, "'data'"),
        ({"devices": 3}, "not the entries"),
        ({"devices": [{"cell": [4, 1], "data": float("nan")}]}, "device 0"),
        ({"flying_time": 24.0}, "flying_time"),
        ({"seed": 2**53}, "seed"),
        ({"city": {"name": "x", "rows": ["L.", "?."]}}, "x: row 1, column 0"),
        ({"city": {"name": "x", "rows": ["..", ".."]}}, "landing zone"),
    ],
)
def test_the_entry_that_is_wrong_is_named(tmp_path, change, named):
    path = tmp_path / "m.json"
    save_mission(path, Mission(VILLAGE, (0, 0), ((4, 1), (0, 7)), (15.0, 0.5), 24))
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=rf"m\.json: .*{named}"):
        load_mission(path)
