"""A session without a browser: what it shows after what was done."""

import base64
import json
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest

from uavdh_lite.channel import rate
from uavdh_lite.environment import EAST, HOVER, LAND, NORTH, SOUTH, WEST
from uavdh_lite.labs import Lab, train
from uavdh_lite.labs.compare import astray, idle, parting, verdict
from uavdh_lite.labs.session import Session
from uavdh_lite.labs.state import read_link

FEWER = [(8.0, 12.0, 20), (9.5, 11.5, 10)]  # return, collected, steps
PATIENCE = 120  # seconds; only a training that never comes takes so long


@pytest.fixture(scope="module")
def shared():
    return Session(city="village")


@pytest.fixture
def lab(shared):
    """The stage with a mission over the village, as it comes."""
    shared.hear({"kind": "city", "name": "village"})
    shared.hear({"kind": "tool", "tool": "compare"})
    return shared


def tell(lab, kind, **values):
    lab.hear({"kind": kind, **values})
    assert lab.scene["refused"] == ""
    json.dumps(lab.scene, allow_nan=False)  # else the browser cannot read it
    return lab.scene["panel"]


def flights(lab):
    return [lab._hangar.flight(lab.stage, name) for name in lab.stage.policies]


@pytest.mark.parametrize("tool", ["fly", "compare", "think", "channel", "paint", "train"])
def test_a_tool_alone_has_no_others(tool):
    scene = Session(tool=tool, city="village").scene
    assert scene["tools"] == [tool] and scene["state"]["tool"] == tool


def test_the_mission_stays_from_tool_to_tool_and_the_film_is_that_of_the_policy(lab):
    tell(lab, "add", cell=[5, 5]) if len(lab.stage.mission.devices) < 2 else None
    mission = lab.stage.mission
    for tool in ("fly", "think", "channel", "paint", "train", "compare"):
        tell(lab, "tool", tool=tool)
        assert lab.stage.mission is mission
        assert len(lab.scene["film"]["devices"]) == len(mission.devices)
    first, second = flights(lab)
    paths = [each["path"] for each in lab.scene["film"]["flights"]]
    size = mission.city.size
    assert paths == [[divmod(int(cell), size) for cell in f.uav_cell] for f in (first, second)]
    version = lab.scene["version"]  # a new one only for another film
    tell(lab, "show", step=2)
    assert lab.scene["version"] == version
    tell(lab, "time", value=lab.stage.mission.flying_time + 1)
    assert lab.scene["version"] > version


def flown(*cells, left=None):
    """A flight over a city of 10 × 10 cells with one device, which gives nothing unless told."""
    moves = {0: HOVER, 1: EAST, -1: WEST, -10: NORTH, 10: SOUTH}
    left = [9.0] * len(cells) if left is None else left
    return SimpleNamespace(
        uav_cell=np.array(cells),
        action=np.array([moves[step] for step in np.diff(cells).tolist()]),
        data_left=np.array(left)[:, None],
    )


def test_flights_part_where_they_are_near_and_act_differently_for_the_last_time():
    east, south = flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 32, 42)
    assert parting(east, south, 10) == 4  # two ways to one place, then they part
    assert parting(east, flown(0, 10, 20, 21, 22, 23, 24), 10) is None
    late = flown(0, 10, 20, 21, 22, 32, 42, left=[9, 9, 9, 6, 6, 6, 6])  # it has got something
    assert parting(east, late, 10) == 0
    assert parting(flown(0, 1, 2, 3), flown(0, 10, 11, 12), 10) == 0  # they end near each other
    assert parting(flown(0, 1, 2, 3, 4), flown(0, 1, 2, 3, 4, 4), 10) == 3  # one stays longer


@pytest.mark.parametrize("wanted", [1, -1, 0])
def test_a_duel_is_what_was_asked_for_as_it_is_shown(wanted):
    lab = Session(city="manhattan")
    panel = tell(lab, "duel", wanted=wanted)
    ahead = panel["results"][0]["return"] - panel["results"][1]["return"]
    assert abs(ahead) < 0.5 if wanted == 0 else wanted * ahead > 2
    winner = {1: "agent wins", -1: "Greedy wins", 0: "level"}[wanted]
    assert winner in panel["verdict"] and panel["parting"] is not None


def test_who_wins_with_less_data_wins_by_the_return():
    both = {"landed": True, "ended": True}
    result = [
        both | dict(zip(("return", "collected", "steps"), each, strict=True)) for each in FEWER
    ]
    told = "Greedy wins by 1.5 in return: 0.5 units less, home 10 steps sooner."
    assert verdict(["genie", "greedy"], result) == told


def test_the_means_of_a_hundred_missions_are_shares_in_per_cent(lab):
    rows = tell(lab, "many")["many"]
    for row in rows:
        mean, low, high = row["landed"]
        assert 0 <= low <= mean <= high <= 100
    assert rows[1]["landed"][0] == 100  # greedy always comes home


def test_q_values_are_those_of_the_agent_and_forbidden_actions_have_none(lab):
    panel = tell(lab, "tool", tool="think")
    name = lab.stage.policies[0]
    flight, agent = lab._hangar.flight(lab.stage, name), lab._hangar.policy(name)
    q = np.array(panel["q"], float)
    assert q.shape == (len(flight.action), 6)
    assert (np.nanargmax(q, axis=1) == flight.action).all()
    first = agent.q_values(flight.start)[0].numpy()
    known = np.isfinite(q[0])
    assert np.allclose(q[0][known], first[known], atol=1e-3) and (first[~known] < -1e6).all()
    assert panel["gaps"][panel["closest"]] == min(panel["gaps"])
    assert panel["note"] == "" and panel["chosen"] == name


@pytest.mark.parametrize("number", range(4))
def test_reasons_are_what_the_flight_does_next(lab, number):
    tell(lab, "tool", tool="think")
    for _ in range(number):
        tell(lab, "new")
    said, left = tell(lab, "show", step=0)["says"], flights(lab)[0].data_left
    assert any("because device" in each for each in said)
    for step, text in enumerate(said):
        found = re.search(r"device (\d).* gives ([\d.]+) units (in this|within (\d+)) step", text)
        enough = [k for k in range(step + 1, len(left)) if (left[step] - left[k]).max() >= 0.5]
        cells = flights(lab)[0].uav_cell
        if "back to where it just was" in text:
            assert cells[step + 1] == cells[step - 1] != cells[step]
            continue
        if not found:
            home = re.search(r"because home is (\d+) units of time away and (\d+) are left", text)
            assert not enough or "hover" in text[:5] or "land" in text[:4] or home
            assert not home or int(home[2]) <= int(home[1]) + 1
            continue
        device, steps = int(found[1]), int(found[4] or 1)
        given = left[step] - left[step + steps]
        assert step + steps == enough[0] and device == given.argmax()
        assert given[device] == pytest.approx(float(found[2]), abs=0.051)
        assert ("because" in text) == (steps <= 3) != ("on the way to" in text)


@pytest.mark.parametrize("planner", ["greedy", "random"])
def test_who_thinks_is_an_agent_and_never_a_planner_under_its_name(lab, planner):
    agent = lab.stage.policies[0]
    tell(lab, "policy", which=0, name=planner)
    panel = tell(lab, "tool", tool="think")
    assert panel["note"].startswith(f"{planner} has no") and panel["chosen"] == ""
    assert {name for name, _ in panel["agents"]} & {"greedy", "genie", "random"} == set()
    assert [each["name"] for each in lab.scene["film"]["flights"]] == [panel["agent"]]
    tell(lab, "policy", which=1, name=agent)
    tell(lab, "policy", which=0, name=agent)
    assert lab.stage.policies == (agent, planner)  # not the same one twice
    tell(lab, "policy", which=1, name="greedy")


@pytest.mark.parametrize("number", range(3))
def test_compare_names_the_device_that_first_gives_something(lab, number):
    for _ in range(number):
        tell(lab, "new")
    panel = tell(lab, "show", step=0)
    clauses = re.findall(r"gets its first 2 units from device (\d) by step (\d+)", panel["why"])
    part, soon = panel["parting"], []
    for flight in flights(lab):
        given = flight.data_left[part] - flight.data_left[part:]
        enough = np.flatnonzero((given >= 2).any(axis=1))
        if len(enough):
            soon.append((str(given[enough[0]].argmax()), str(part + enough[0])))
    assert clauses == soon or (not clauses and len({device for device, _ in soon}) == 1)


@pytest.mark.parametrize("wanted", [1, -1])
def test_compare_says_what_the_loser_left_and_when_the_winner_got_it(wanted):
    lab = Session(city="manhattan")
    panel = tell(lab, "duel", wanted=wanted)
    said = r"leaves ([\d.]+) units more at device (\d).*; .* gets them from step (\d+) to (\d+)"
    amount, *numbers = re.search(said, panel["why"]).groups()
    device, first, last = map(int, numbers)
    winner, loser = (flight.data_left[:, device] for flight in flights(lab)[::wanted])
    assert loser[-1] - winner[-1] == pytest.approx(float(amount), abs=0.051)
    assert winner[first - 1] >= loser[-1] - 0.1 > winner[first]
    assert winner[last] <= winner[-1] + 0.1 < winner[last - 1]
    assert panel["look"][0] == panel["parting"] and first - 1 in panel["look"]


def test_steps_without_data_are_counted_and_the_longest_stretch_that_leads_nowhere_is_found():
    flight = SimpleNamespace(
        uav_cell=np.array([0, 1, 2, 1, 2, 2, 2, 2, 2, 2]),
        action=np.array([EAST, EAST, WEST, EAST, HOVER, HOVER, HOVER, LAND, LAND]),
        intervened=np.array([False] * 7 + [True, False]),
        data_left=np.array([9.0, 9, 9, 9, 9, 9, 8, 8, 8, 8])[:, None],
    )
    for step, count, stretch in ((0, 7, (1, 5)), (3, 4, None)):
        assert idle(flight, step).sum() == count  # a refused landing brings nothing, too
        assert astray(flight, step) == stretch


def test_there_is_a_value_wherever_it_may_fly(lab):
    tell(lab, "tool", tool="think")
    found = tell(lab, "values", step=2)["values"]
    assert found["step"] == 2
    nowhere = [[value is None for value in row] for row in found["values"]]
    assert nowhere == lab.stage.mission.city.no_fly.tolist()


def test_the_ledger_of_the_radio_link_adds_up(lab):
    panel = tell(lab, "tool", tool="channel")
    loss, building, snr = (np.array(panel[k]) for k in ("path_loss", "building", "snr"))
    assert np.allclose(panel["transmit"] - loss - building, snr, atol=0.1)
    row, col = lab.stage.mission.devices[panel["device"]]
    sight = lab._hangar.environment.sight[0, row * 8 + col].reshape(8, 8)
    assert ((building > 0) == ~sight).all()
    assert panel["distance"][row][col] == 10  # the altitude
    low, high = panel["range"]  # the same for each device
    assert low < snr.min() and snr.max() < high and high - low < np.ptp(snr) + 30
    assert np.allclose(panel["rate"], rate(snr), rtol=0.02, atol=1e-4)


def test_the_shadow_of_a_cell_is_what_a_device_there_cannot_see(lab):
    shadow = tell(lab, "shadow", cell=[4, 0])["shadow"]
    sight = lab._hangar.environment.sight[0, 32].reshape(8, 8)
    assert [[sign == "." for sign in row] for row in shadow["rows"]] == sight.tolist()
    building = np.argwhere(lab._hangar.environment.cities[0].buildings)[0].tolist()
    for nowhere in ([99, 0], building):
        assert tell(lab, "shadow", cell=nowhere)["shadow"]["rows"] == []


def test_a_flight_by_hand_is_the_mission_flown_so(lab):
    tell(lab, "tool", tool="fly")
    for action in ("east", "hover"):
        tell(lab, "fly", action=action)
    assert lab._hangar.flight(lab.stage, "you").action.tolist() == [EAST, HOVER]
    you, ghost = lab.scene["film"]["flights"]
    assert you["end"] == "in the air" and len(you["path"]) == 3 and ghost["name"] == "greedy"
    panel = tell(lab, "fly", action="north")
    assert panel["ranking"] == [] and panel["you"]["steps"] == 3


def test_the_ranking_keeps_flights_that_ended_the_best_first(lab):
    tell(lab, "tool", tool="fly")
    tell(lab, "fly", action="land")
    home = tell(lab, "again")["ranking"]
    for _ in range(lab.stage.mission.flying_time):
        panel = tell(lab, "fly", action="hover")
    lab.hear({"kind": "fly", "action": "hover"})
    assert "this flight is over" in lab.scene["refused"]
    assert len(home) == 1 and len(panel["ranking"]) == 2
    assert panel["ranking"][0]["landed"] and not panel["ranking"][1]["landed"]


def test_undo_brings_a_mission_back_and_redo_takes_it_again(lab):
    before, device = lab.stage.mission, lab.stage.mission.devices[0]
    tell(lab, "add", cell=[7, 7]) if len(before.devices) < 2 else tell(lab, "remove", device=1)
    after = lab.stage.mission
    tell(lab, "tool", tool="think")
    tell(lab, "undo", by=-1)
    assert lab.stage.mission is before and lab.stage.tool == "think"
    tell(lab, "undo", by=1)
    assert lab.stage.mission is after and after.devices[0] == device
    lab.hear({"kind": "undo", "by": 1})
    assert "nothing more to undo" in lab.scene["refused"]


def test_a_refusal_leaves_everything_as_it_is(lab):
    before = lab.stage
    for told in (
        {"kind": "move", "device": 0, "cell": [99, 0]},
        {"kind": "x"},
        {},
        {"kind": "duel"},
    ):
        lab.hear(told)
        assert lab.scene["refused"] and lab.stage is before
    tell(lab, "show", step=0)


def test_the_link_opens_the_same_elsewhere(lab):
    tell(lab, "city", name="empty 8 × 8")
    tell(lab, "paint", cells=[[4, 4], [4, 5]], sign="b")
    tell(lab, "policy", which=0, name="random")
    other = Session(city="village")
    tell(other, "open", link=lab.scene["state"]["link"])
    assert other.scene["film"] == lab.scene["film"]
    assert read_link(other.stage.link).as_json() == lab.stage.as_json()


def test_files_are_given_as_they_are_opened():
    given = {}
    lab = Session(city="village", give=given.__setitem__)
    tell(lab, "save", what="stage")
    tell(lab, "save", what="png")
    content = {name: base64.b64decode(each.split(",")[1]) for name, each in given.items()}
    assert json.loads(content["village_stage.json"]) == lab.stage.as_json()
    assert content["village.png"].startswith(b"\x89PNG")


def test_the_widget_hears_and_shows_what_the_session_does(monkeypatch):
    sent = []
    monkeypatch.setattr(Lab, "send", lambda self, told: sent.append(told))
    widget = Lab(tool="channel", city="village")
    assert widget.scene["tools"] == ["channel"]
    widget._handle_custom_msg({"kind": "show", "step": 2}, [])
    assert widget.scene["state"]["step"] == 2
    widget._handle_custom_msg({"kind": "save", "what": "png"}, [])
    assert sent[0]["name"] == "village.png" and sent[0]["address"].startswith("data:image/png;")
    widget.close()


def wait_for(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def test_a_race_takes_turns_and_a_point_shows_its_agent(lab, monkeypatch):
    monkeypatch.setattr(train, "EVERY", 0.0)
    monkeypatch.setattr(train, "EPISODES", 5)
    tell(lab, "tool", tool="train")
    tell(lab, "train", settings=["small", "failsafe"])
    wait_for(lambda: len(lab.scene["panel"]["runs"][0]["points"]) > 2)
    tell(lab, "pause")
    first, second = lab.scene["panel"]["runs"]
    assert not lab.scene["panel"]["running"] and lab.scene["panel"]["error"] == ""
    steps = [[point["steps"] for point in run["points"]] for run in (first, second)]
    assert steps[0] == steps[1] and steps[0][1] == train.TURN * 16
    assert all(point["landed"] == 1 for point in second["points"])  # the failsafe
    tell(lab, "point", run=1, point=0)
    (flown,) = lab.scene["film"]["flights"]
    assert flown["name"] == "orange's agent after 0 steps" and flown["end"] == "landed"
    before = len(first["points"])
    tell(lab, "train", settings=[])  # go on
    wait_for(lambda: len(lab.scene["panel"]["runs"][0]["points"]) > before)
    lab.close()
    assert not lab._race.running


def run_of(*shares):
    points = enumerate(shares)
    keys = ("landed", "collected_and_landed")
    points = [{"steps": 5000 * k, **dict.fromkeys(keys, share)} for k, share in points]
    return train.Run("small", None, points)


def test_a_race_says_where_they_learned_to_land_and_how_they_ended():
    blue, orange = run_of(0, 0.93, 0.3, 0.92), run_of(0, 0.9, 0, 0, 0)
    assert (blue.kink, orange.kink, run_of().kink, run_of(1, 1).kink) == (3, None, None, None)
    assert run_of(0.2, 0.5, 0.5).kink == 1 and train.sentences([run_of()], False) == []
    first = "Blue learns to land for good here, after 15,000 steps: 30 of 100 before, 92 then."
    forgot = "After 5,000 steps 93 landed, but it forgot how."
    never = "Orange has not learned to land for good."
    assert train.sentences([blue, orange], False) == [first, forgot, never]
    assert train.sentences([run_of(1, 0.5)], False) == ["Blue lands from the start."]
    *before, end = (
        each.replace("\N{NO-BREAK SPACE}", " ") for each in train.sentences([blue, orange], True)
    )
    assert before == [first, forgot, never]
    brings = "lands {0} of 100 and brings {0} % of the data home"
    assert end == f"Blue wins: blue {brings.format(92)}; orange {brings.format(0)}."
    assert train.sentences([orange, blue], True)[-1].startswith("Orange wins")
    for level in ([blue, blue], [blue]):
        assert train.sentences(level, True)[-1].startswith("In the end: blue lands 92")


def test_a_race_over_a_large_city_moves_to_the_village_and_equal_runs_have_other_seeds(monkeypatch):
    monkeypatch.setattr(train.Race, "go_on", lambda self: None)
    lab = Session(tool="train", city="manhattan")
    tell(lab, "train", settings=["small", "small"])
    assert lab.stage.mission.city.name == "village"
    assert [run.trainer.seed for run in lab._race.runs] == [0, 1]
