"""The state of the stage: what each event makes of it, links and files, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.city import City, load_city, shipped_cities
from uavdh_lite.errors import InputError
from uavdh_lite.labs.state import (
    EMPTY,
    Stage,
    changed,
    random_mission,
    read_file,
    read_link,
    scenario_of,
)
from uavdh_lite.missions import Mission, as_json

CITY = City.from_text("toy", "LL..\n....\n.B..\n....")


@pytest.fixture
def stage():
    mission = Mission(CITY, (0, 0), ((0, 3), (3, 0)), (4.0, 9.0), 12, seed=5, max_devices=3)
    return Stage.of(mission, "channel")


def after(stage, kind, **values):
    return changed(stage, kind, values)


def test_an_event_changes_what_it_names_and_nothing_else(stage):
    moved = after(stage, "move", device=1, cell=[3, 3])
    assert moved.mission.devices == ((0, 3), (3, 3)) and moved.tool == "channel"
    assert stage.mission.devices == ((0, 3), (3, 0))  # it never changes itself
    assert after(stage, "move", device=-1, cell=[2, 0]).mission.start == (2, 0)
    assert after(stage, "data", device=0, value=7).mission.data == (7.0, 9.0)
    assert after(stage, "time", value=30).mission.flying_time == 30
    assert after(stage, "add", cell=[3, 3]).mission.devices[2] == (3, 3)
    assert after(stage, "remove", device=0).mission.devices == ((3, 0),)
    assert after(stage, "tool", tool="fly").mission is stage.mission
    assert after(stage, "look", device=1).device == 1
    assert after(stage, "policy", which=1, name="random").policies == ("any_city", "random")


def test_what_was_flown_by_hand_stays_until_the_mission_changes(stage):
    flown = after(after(replace(stage, step=3), "fly", action="east"), "fly", action="land")
    assert flown.step == 3  # of the other tools
    assert flown.flown == "el" and after(flown, "tool", tool="think").flown == "el"
    assert after(flown, "again").flown == "" == after(flown, "time", value=9).flown


def test_a_new_mission_is_the_next_number_over_the_same_city():
    first = Stage.of(random_mission(load_city("village"), 3))
    second = after(first, "new")
    assert second.mission.city is first.mission.city
    assert second.mission.seed == first.mission.seed + 1
    again = random_mission(first.mission.city, second.mission.seed)
    assert as_json(again) == as_json(second.mission)


@pytest.mark.parametrize("city", shipped_cities())
def test_every_shipped_city_has_its_scenario_and_rivals_that_know_it(stage, city):
    there = after(stage, "city", name=city)
    assert scenario_of(there.mission.city).city == city
    assert there.policies[1] == "greedy" and there.policies[0] != "greedy"


@pytest.mark.parametrize("name, size", EMPTY.items())
def test_an_empty_city_can_be_painted(stage, name, size):
    empty = after(stage, "city", name=name)
    assert empty.mission.city.size == size
    painted = after(empty, "paint", cells=[[5, 5], [5, 6]], sign="B").mission.city
    assert np.argwhere(painted.kinds == 4).tolist() == [[5, 5], [5, 6]]
    assert painted.name == "my_city"


def test_painting_moves_what_stands_there_to_the_nearest_cell(stage):
    painted = after(stage, "paint", cells=[[0, 3]], sign="B").mission
    assert painted.devices[0] in ((0, 2), (1, 3)) and painted.devices[1] == (3, 0)
    walls = after(stage, "paint", cells=[[0, 0]], sign="N").mission
    assert walls.start == (0, 1)  # the landing cell that is left


@pytest.mark.parametrize(
    "kind, values, said",
    [
        ("move", {"device": 0, "cell": [2, 1]}, "device 0 at (2, 1) stands on a building"),
        ("move", {"device": 0, "cell": [0, 1]}, "stands in the landing zone"),
        ("move", {"device": 0, "cell": [3, 0]}, "where another device stands"),
        ("move", {"device": 0, "cell": [-1, 0]}, "outside the city of 4 × 4 cells"),
        ("move", {"device": 0, "cell": [1.5, 0]}, "row 1.5: must be a whole number"),
        ("move", {"device": 2, "cell": [3, 3]}, "device 2: there are 2"),
        ("move", {"device": -1, "cell": [2, 1]}, "a building"),
        ("data", {"device": 0, "value": float("nan")}, "must be a number"),
        ("data", {"device": 0, "value": -1}, "must be 0 to below"),
        ("data", {"device": 0, "value": True}, "must be a number"),
        ("time", {"value": 0}, "flying time 0: must be at least 1"),
        ("time", {"value": 3.5}, "flying time 3.5: must be a whole number"),
        ("time", {"value": None}, "must be a whole number"),
        ("city", {"name": "atlantis"}, "no city 'atlantis'"),
        ("policy", {"which": 0, "name": "manhattan"}, "does not fly over this city"),
        ("policy", {"which": 2, "name": "greedy"}, "there are two"),
        ("tool", {"tool": "sing"}, "choose one of"),
        ("paint", {"cells": [[9, 9]], "sign": "B"}, "outside"),
        ("paint", {"cells": [[0, 0]], "sign": "LB"}, "choose one of"),
        ("paint", {"cells": [[0, 0], [0, 1]], "sign": "."}, "no start and landing zone"),
        ("open", {"text": "{"}, "no JSON"),
        ("open", {"text": "[1]"}, "no stage and no mission"),
        ("open", {"link": "abc"}, "this link is damaged"),
        ("open", {"picture": "AAAA"}, "not a readable PNG"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(stage, kind, values, said):
    with pytest.raises(InputError) as refused:
        after(stage, kind, **values)
    assert said in str(refused.value)


def test_no_more_devices_than_there_is_room_for(stage):
    full = after(stage, "add", cell=[3, 3])
    with pytest.raises(InputError, match="takes 1 to 3"):
        after(full, "add", cell=[3, 2])
    with pytest.raises(InputError, match="add one"):
        after(after(stage, "remove", device=0), "remove", device=0)


def equal(one, other):
    return one.as_json() == other.as_json()


def test_a_link_and_a_file_keep_everything(stage):
    flown = after(after(stage, "fly", action="hover"), "policy", which=1, name="you")
    kept = replace(flown, step=1, device=1)
    assert equal(read_link(kept.link), kept)
    assert equal(read_file(json.dumps(kept.as_json())), kept)
    assert read_link(kept.link).mission.city.fingerprint == CITY.fingerprint
    assert set(kept.link) <= set("-_") | set(map(chr, range(48, 123)))


def test_a_file_of_a_mission_opens_with_the_usual_rivals(stage):
    opened = read_file(json.dumps(as_json(stage.mission)))
    assert as_json(opened.mission) == as_json(stage.mission)
    assert opened.policies == ("any_city", "greedy")


@pytest.mark.parametrize("cut", [1, 5, 40])
def test_a_damaged_link_is_refused(stage, cut):
    with pytest.raises(InputError, match="this link is damaged"):
        read_link(stage.link[:-cut])


@pytest.mark.parametrize(
    "entry, value, said",
    [
        ("version", 2, "no stage"),
        ("tool", 7, "is no text"),
        ("tool", "sing", "choose one of"),
        ("policies", ["greedy"], "give two names"),
        ("policies", ["greedy", "harbour"], "does not fly over this city"),
        ("flown", "nx", "other letters"),
        ("flown", "h" * 401, "more than 400"),
        ("step", 1.0, "must be a whole number"),
        ("step", -2, "must be at least -1"),
        ("device", 2, "there are 2"),
        ("device", True, "must be a whole number"),
        ("mission", None, "the file"),
    ],
)
def test_a_file_with_a_wrong_entry_is_refused(stage, entry, value, said):
    with pytest.raises(InputError) as refused:
        read_file(json.dumps(stage.as_json() | {entry: value}))
    assert said in str(refused.value)
