"""The session: what each event makes of the stage, links and files, and what is refused."""

import base64
import json
import re

import numpy as np
import pytest
from PIL import Image

from uavdh_lite.beyond.measured import load_place
from uavdh_lite.channel import rate
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.missions import Mission, as_json, mission_from_json
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder

SAVED = """async () => {
    const found = [];
    lab.post = ({ kind, blob }) => kind === "file" && found.push(blob);
    await lab.hear({ kind: "save", what: "WHAT" });
    const bytes = new Uint8Array(await found[0].arrayBuffer());
    return btoa(String.fromCharCode(...bytes));
}"""
LANDING = np.argwhere(load_city("village").landing).tolist()


RANDOM = """async ([seed, count]) => {
    const random = () => { // mulberry32
        let t = (seed += 0x6d2b79f5);
        t = Math.imul(t ^ (t >>> 15), t | 1);
        t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
        return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
    const pick = (list) => list[Math.floor(random() * list.length)];
    const whole = (least, most) => least + Math.floor(random() * (most - least + 1));
    const cell = () => [whole(-1, 8), whole(-1, 8)];
    const names = [...Object.keys(lab.shelf.cities), ...Object.keys(lab.agents), "greedy", "you"];
    const usual = {
        action: () => pick(["north", "east", "south", "west", "hover", "land"]),
        by: () => pick([-1, 1]),
        cell,
        cells: () => [cell(), cell()],
        device: () => whole(-1, 3),
        file: () => new File([pick(["", "{}", "[", "null"])], pick(["a.json", "a.safetensors"])),
        name: () => pick(names),
        point: () => [whole(0, 1), whole(0, 1)],
        sign: () => pick([..."LN.BbT"]),
        step: () => whole(-1, 40),
        tool: () => pick(["fly", "compare", "think", "channel", "paint", "watch"]),
        value: () => pick([whole(-1, 40), 7.5, 1e9]),
        wanted: () => whole(-1, 1),
        what: () => pick(["stage", "mission", "png"]),
        which: () => whole(0, 1),
    };
    const odd = [undefined, null, NaN, -1, 1.5, Infinity, "", "x", "7", "__proto__", "constructor",
        true, [], [[]], [0], [1.5, 2], [99, 99], ["0", "1"], [null, null], {}];
    const looks = { layer: "value", centred: true, runs: [whole(0, 4), whole(0, 4)] };
    const kinds = ["add", "again", "cancel", "city", "data", "fly", "hold", "look", "many", "move",
        "new", "open", "paint", "policy", "race", "remove", "save", "see", "shadow", "show", "time",
        "tool", "undo", "values", "duel", "toString", "constructor", undefined, ""];
    const answers = { works: 0, refused: [], changed: [] };
    for (let k = 0; k < count; k += 1) {
        const told = { kind: pick(kinds) };
        for (const [name, value] of Object.entries(usual))
            if (random() < 0.9) told[name] = random() < 0.1 ? pick(odd) : value();
        if (told.kind === "see") [told.name, told.value] = pick(Object.entries(looks));
        const before = lab.stage;
        let scene = null;
        lab.post = (answer) => { scene = answer.scene ?? scene; };
        await lab.hear(told);
        const { refused } = scene; // each message has an answer
        if (refused) answers.refused.push([JSON.stringify(told), refused]);
        else answers.works += 1;
        if (refused && lab.stage !== before) answers.changed.push(JSON.stringify(told));
    }
    return answers;
}"""


@pytest.fixture
def opened(tell):
    """A function that opens a file's content and returns the next scene."""

    def opened(name, content, refused="", **more):
        content = content if isinstance(content, bytes) else json.dumps(content).encode()
        return tell("open", refused, name=name, base64=base64.b64encode(content).decode(), **more)

    return opened


@pytest.fixture
def saved(modules):
    """A function that returns the content of a saved file."""
    return lambda what: base64.b64decode(modules(SAVED.replace("WHAT", what)))


def mission_of(scene):
    names = ("city", "start", "devices", "flyingTime")
    return {name: scene["state"][name] for name in names}


def test_an_event_changes_what_it_names_and_nothing_else(tell):
    before = mission_of(tell("show", step=2))
    cell = before["devices"][0]["cell"]
    moved = tell("move", device=0, cell=[7, 7])
    assert moved["state"]["devices"][0] == {"cell": [7, 7], "data": before["devices"][0]["data"]}
    assert moved["state"]["step"] == -1
    assert tell("move", device=0, cell=cell)["state"]["devices"] == before["devices"]
    assert tell("data", device=0, value=7)["state"]["devices"][0]["data"] == 7
    assert tell("time", value=30)["state"]["flyingTime"] == 30
    assert tell("move", device=-1, cell=[0, 0])["state"]["start"] == [0, 0]
    assert tell("look", device=0)["state"]["device"] == 0


def test_a_drag_is_one_change_and_none_if_it_ends_on_a_building(tell):
    before = tell("fly", action="hover")
    building = [2, 4]
    for cell in ([7, 7], building, [7, 6]):
        there = tell("move", device=0, cell=cell, drag=1)["state"]["devices"][0]["cell"]
        assert there == ([7, 7] if cell == building else cell)
    back = tell("move", device=0, cell=building, drag=1, ends=True, refused="is a building")
    assert mission_of(back) == mission_of(before) and back["state"]["flown"] == "h"
    assert len(back["past"]["others"]) == len(before["past"]["others"])
    tell("move", device=0, cell=building, drag=2, ends=True, refused="is a building")
    drag = [tell("move", device=0, cell=cell, drag=3) for cell in ([7, 7], [7, 6])]
    assert len(drag[0]["past"]["others"]) == len(before["past"]["others"]) + 1
    assert drag[1]["past"] is None  # it is told when it changes
    assert mission_of(tell("undo", by=-1)) == mission_of(before)


def test_undo_brings_a_mission_back_and_redo_takes_it_again(tell):
    before = mission_of(tell("new"))
    after = mission_of(tell("new"))
    assert before != after
    tell("tool", tool="think")
    tell("see", name="layer", value="buildings")
    undone = tell("undo", by=-1)
    assert mission_of(undone) == before and undone["state"]["tool"] == "think"
    assert undone["state"]["looks"]["layer"] == "buildings"
    assert mission_of(tell("undo", by=1)) == after
    tell("undo", by=1, refused="nothing more to redo")


def test_a_city_is_found_as_it_was_left(tell):
    tell("new")
    tell("policy", which=0, name="greedy")
    tell("tool", tool="fly")
    left = tell("fly", action="south")["state"]
    assert left["policies"] == ["greedy", "random"]
    tell("city", name="manhattan")
    tell("tool", tool="compare")
    back = tell("city", name="village")["state"]
    assert back == left | {"tool": "compare"}
    tell("tool", tool="fly")
    assert tell("undo", by=-1)["state"]["flown"] == ""  # its moves, too
    assert mission_of(tell("new")) != mission_of({"state": left})


def test_undo_takes_back_moves_of_the_flight_in_fly_and_elsewhere_the_mission(
    modules, tell, opened, saved
):
    def flown(scene):
        return scene["state"]["city"], scene["state"]["flown"]

    tell("tool", tool="fly")
    for action in ("hover", "south", "hover"):
        scene = tell("fly", action=action)
    tell("policy", which=1, name="random")
    back = tell("undo", by=-1)
    assert flown(back) == ("village", "hs") and back["state"]["policies"][1] == "random"
    assert back["film"]["flights"][0]["path"] == scene["film"]["flights"][0]["path"][:-1]
    again = tell("undo", by=1)
    assert again["film"]["flights"][0] == scene["film"]["flights"][0]
    tell("again")
    assert flown(tell("undo", by=-1)) == ("village", "hsh")  # pressed by mistake
    tell("city", name="manhattan")
    tell("fly", action="hover")
    tell("fly", action="south")
    for there in (("manhattan", "h"), ("manhattan", ""), ("village", "hsh"), ("village", "hs")):
        assert flown(tell("undo", by=-1)) == there
    tell("tool", tool="compare")
    assert flown(tell("undo", by=1)) == ("manhattan", "hs")
    assert flown(tell("undo", by=-1)) == ("village", "hsh")
    last = tell("undo", by=1)
    assert last["state"]["redo"] is False
    tell("tool", tool="fly")
    opened("a.json", json.loads(saved("stage")))
    assert flown(tell("undo", by=-1)) == ("manhattan", "h")  # of a flight that was opened, too
    tell("undo", by=1)
    modules("(past) => lab.recall(past)", last["past"])  # as after a reload
    assert flown(tell("undo", by=-1)) == ("manhattan", "h")
    tell("tool", tool="compare")
    assert flown(tell("undo", by=-1)) == ("village", "hsh")  # past all moves of the same mission


IMPOSSIBLE = [
    ("move", {"device": 0, "cell": [2, 4]},
     "Not moved: row 2, column 4 is a building. Devices stand on open ground or in"),
    ("move", {"device": 0, "cell": [0, 0]}, "row 0, column 0 is a landing zone."),
    ("move", {"device": 0, "cell": [-1, 0]}, "outside the city of 8 × 8 cells"),
    ("move", {"device": -1, "cell": [2, 4]}, "building. The start may be wherever"),
    ("data", {"device": 0, "value": -1}, "must be 0 to below"),
    ("time", {"value": 0}, "flying time 0: must be at least 1"),
    ("time", {"value": 501}, "this page allows at most 500 units of time"),
    ("paint", {"cells": LANDING, "sign": "."}, "no start and landing zone"),
    ("open", {"link": "abc"}, "this link is damaged"),
]  # fmt: skip


def test_what_cannot_be_is_refused_with_the_reason_and_changes_nothing(tell):
    before = mission_of(tell("show", step=0))
    for kind, values, said in IMPOSSIBLE:
        assert mission_of(tell(kind, refused=said, **values)) == before


def test_painting_moves_what_stands_there_to_the_nearest_cell(tell):
    tell("city", name="empty 8 × 8")
    scene = tell("paint", cells=[[5, 5], [5, 6]], sign="B")
    name = scene["state"]["city"]
    assert scene["film"]["city"][5] == ".....BB." and name.startswith("my_city")
    again = tell("paint", cells=[[5, 5]], sign="B")
    assert again["state"] == scene["state"] and again["version"] == scene["version"]
    row, col = scene["state"]["devices"][0]["cell"]
    painted = tell("paint", cells=[[row, col]], sign="B")
    there = painted["state"]["devices"][0]["cell"]
    assert abs(there[0] - row) + abs(there[1] - col) == 1
    moved = "What stood there has moved: {} to row {}, column {}."
    assert painted["note"] == moved.format("device 0", *there) and scene["note"] == ""
    start = painted["state"]["start"]
    walls = tell("paint", cells=[start], sign="N")
    other = walls["state"]["start"]
    assert other != start and max(other) <= 1  # another landing cell
    assert walls["note"] == moved.format("the start", *other)
    tell("city", name="empty 12 × 12")
    second = tell("paint", cells=[[5, 5]], sign="B")["state"]  # the first one is kept
    assert {name, second["city"]} <= {*second["cities"]} and name != second["city"]
    assert tell("city", name=name)["film"]["city"] == walls["film"]["city"]
    assert tell("paint", cells=[[7, 7]], sign="B")["state"]["city"] == name


def test_what_is_wrong_with_a_mission_is_said(tell):
    tell("city", name="empty 8 × 8")
    device = tell("move", device=0, cell=[6, 6])["state"]["devices"]
    for k in reversed(range(1, len(device))):
        tell("remove", device=k)
    around = [[r, c] for r in (5, 6, 7) for c in (5, 6, 7) if (r, c) != (6, 6)]
    said = tell("paint", cells=around, sign="B")["warnings"]
    assert said == [
        "No way leads from the landing zone to row 6, column 6.",
        "Device 0 is sealed in: it cannot be seen from any cell that the UAV can reach, and what "
        "comes through the walls is little.",
    ]
    tell("move", device=0, cell=[1, 6])
    outside = tell("move", device=-1, cell=[7, 0])
    assert "starts outside the landing zone" in outside["warnings"][-1]
    absent = "The DDQN agent was not trained for this city, and cannot fly here."
    assert outside["state"]["absent"] == absent
    short = tell("time", value=3)["warnings"][-1]
    assert short == "A flying time of 3 is too short: the way home alone takes 7."
    assert tell("time", value=7)["warnings"][-1] == "In a flying time of 7, it can only fly home."
    tell("add", cell=[3, 3])
    none = "Device 0 has no data: nothing is to be had there."
    assert none in tell("data", device=0, value=0)["warnings"]
    assert tell("tool", tool="watch")["warnings"] == []  # which is about the village
    tell("tool", tool="compare")
    assert tell("city", name="village")["warnings"] == []
    tell("city", name="munich")  # where walls let through what the traced rays say
    (said,) = (it for it in tell("move", device=0, cell=[0, 0])["warnings"] if "Device 0" in it)
    found = re.search(r"sealed in.*, best over row (\d+), column (\d+): ([\d.]+) units a", said)
    row, col, amount = found.groups()
    there = load_place("munich")
    rates = np.where(there.time_to_land[0] <= 256, there.rate_map(0).ravel(), 0)
    best = rates[16 * int(row) + int(col)]
    assert best > 0.94 * rates.max() and best == pytest.approx(float(amount), rel=0.06)  # half dB


def test_a_flight_by_hand_is_the_mission_flown_so_and_is_ranked_at_its_end(tell):
    tell("tool", tool="fly")
    scene = tell("fly", action="hover")
    you, ghost = scene["film"]["flights"]
    assert you["end"] == "in the air" and len(you["path"]) == 2 and ghost["name"] == "greedy"
    home = tell("fly", action="land")["panel"]
    assert home["you"]["landed"] and len(home["ranking"]) == 1
    tell("fly", action="hover", refused="this flight is over")
    tell("again")
    for _ in range(scene["state"]["flyingTime"]):
        crashed = tell("fly", action="hover")["panel"]
    landed = [each["landed"] for each in crashed["ranking"]]
    assert landed == [True, False]  # the best first
    tell("policy", which=0, name="you")
    assert tell("tool", tool="compare")["panel"]["verdict"].startswith("Greedy wins")
    for kind in ("duel", "many"):  # your flight is of this mission alone
        tell(kind, wanted=1, refused="choose two agents, because your flight")
    assert tell("new")["panel"]["why"] == []  # the flight of a new mission has not begun


def test_nobody_is_the_own_rival(tell, opened, saved):
    tell("tool", tool="fly")
    assert tell("policy", which=1, name="random")["state"]["policies"] == ["greedy", "random"]
    tell("city", name="manhattan")
    tell("policy", which=1, name="manhattan_ddqn")
    there = tell("city", name="open_field")["state"]["policies"]  # where the agent is none
    assert there == ["random", "greedy"]
    twice = json.loads(saved("stage")) | {"policies": ["greedy", "greedy"]}
    assert opened("a.json", twice)["state"]["policies"] == ["random", "greedy"]


def test_a_table_of_a_hundred_missions_belongs_to_its_pair(tell):
    many = tell("many")["panel"]["many"]
    assert [row["who"]["name"] for row in many] == ["random", "greedy"]
    assert many[1]["landed"][0] == 100  # greedy always comes home
    for low, mean, high in ((row["both"][1], row["both"][0], row["both"][2]) for row in many):
        assert 0 <= low <= mean <= high <= 100
    assert "many" not in tell("policy", which=0, name="greedy")["panel"]


def test_a_file_is_opened_though_the_step_is_kept_meanwhile_and_gives_way_to_what_is_done_later(
    modules, tell, saved
):
    tell("city", name="manhattan")
    stage = saved("stage").decode()
    script = """async ([stage, ...later]) => {
        lab.post = () => {};
        const open = lab.hear({ kind: "open", file: new File([stage], "a.json") });
        await Promise.all([open, ...later.map((told) => lab.hear(told))]);
        return [lab.stage.mission.city.name, lab.work];
    }"""
    city, show = {"kind": "city", "name": "open_field"}, {"kind": "show", "step": 0}
    for later, there in (([show], "manhattan"), ([city, show], "open_field")):
        tell("city", name="village")
        assert modules(script, [stage, *later]) == [there, None]


def test_a_device_that_is_chosen_while_a_duel_is_looked_for_stays_chosen(modules, tell):
    script = """async () => {
        lab.post = () => {};
        const duel = lab.hear({ kind: "duel", wanted: -1 });
        await Promise.all([duel, lab.hear({ kind: "look", device: 1 })]);
        return [lab.stage.device, lab.stage.mission.seed > 0];
    }"""
    there = tell("city", name="manhattan")["state"]  # at least two devices in each mission
    assert there["absent"] == ""
    said = "device 0 cannot stand at row {}, column {}: device 1 is there"
    cell = there["devices"][1]["cell"]
    tell("move", device=0, cell=cell, refused=said.format(*cell))
    assert modules(script) == [1, True]


def test_what_takes_long_is_ended_by_what_is_done_meanwhile(modules, tell):
    script = """async () => {
        const answers = [];
        lab.post = (answer) => answers.push(answer);
        const long = lab.hear({ kind: "many" });
        const other = lab.hear({ kind: "cancel" });
        await Promise.all([long, other]);
        const scenes = answers.flatMap(({ scene }) => scene ?? []);
        return scenes.map(({ refused, panel }) => [refused, Boolean(panel.many)]);
    }"""
    assert modules(script) == [["", False], ["", False]]
    said = "Not done: the flight of 100 missions was ended by what was done meanwhile."
    assert modules(script.replace("cancel", "new")) == [["", False], [said, False]]
    going = script.replace('"cancel"', '"tool", tool: "channel"')
    assert modules(going)[-1][0] == "" and modules("() => lab.extra.many.length") == 2


def test_a_search_that_finds_nothing_says_what_to_do_and_goes_on_when_it_is_asked_again(
    modules, tell
):
    for number in (1, 2):
        said = "random wins none of the next 200 missions here: press it again to look at 200 more"
        tell("duel", wanted=1, refused=said)
        assert modules("() => lab.tried.to") == 200 * number
    rule = tell("show", step=-1)["panel"]["rule"]
    ahead, units, steps, level = map(float, re.findall(r"[\d.]+\d|\d", rule))
    assert ahead == units == 2 and level == 0.5 and (steps - 1) * 0.2 <= ahead < steps * 0.2


def test_a_change_that_ends_a_flight_a_last_device_and_a_saved_file_are_named(modules, tell):
    for action in ("hover", "south"):
        tell("fly", action=action)
    said = "Your flight of 2 steps belongs to the mission before this change: ↶ brings both back."
    for cell in ([7, 7], [7, 6]):
        assert tell("move", device=0, cell=cell, drag=9)["note"] == said
    assert tell("undo", by=-1)["state"]["flown"] == "hs"
    assert tell("new")["note"] == ""
    assert tell("save", what="stage")["note"] == "Saved as village_stage.json."
    for k in reversed(range(1, len(tell("show", step=-1)["state"]["devices"]))):
        tell("remove", device=k)
    tell("remove", device=0, refused="the last device stays: a mission here has 1 to 2")


def test_the_ledger_of_the_radio_link_is_that_of_python(tell):
    scene = tell("tool", tool="channel")
    panel, device = scene["panel"], scene["state"]["devices"][0]["cell"]
    environment = Environment(load_city("village"))
    loss, building, snr = (np.array(panel[name]) for name in ("pathLoss", "building", "snr"))
    assert np.allclose(panel["transmit"] - loss - building, snr)
    cell = device[0] * 8 + device[1]
    assert ((building > 1e-6) == ~environment.sight[0, cell]).all()
    assert panel["distance"][cell] == 10  # the altitude
    assert np.allclose(panel["rate"], rate(snr))
    low, high = panel["range"]
    assert low < snr.min() and snr.max() < high
    shadow = tell("shadow", cell=[4, 0])["panel"]["shadow"]["rows"]
    assert [sign == "." for sign in "".join(shadow)] == environment.sight[0, 32].tolist()
    assert tell("shadow", cell=[2, 4])["panel"]["shadow"]["rows"] == []  # a building


def test_a_mission_goes_to_python_and_back_and_a_stage_keeps_everything(tell, opened, saved):
    tell("new")
    tell("fly", action="hover")
    tell("policy", which=0, name="random")
    tell("policy", which=1, name="you")
    tell("tool", tool="channel")
    tell("hold", cell=[2, 7])
    looks = {"layer": "value", "centred": True, "metric": "collected_and_landed", "runs": [3, 1]}
    for name, value in looks.items():
        tell("see", name=name, value=value)
    kept = tell("show", step=1)["state"]
    assert kept["looks"] == looks and kept["held"] == [2, 7]
    stage, mission = json.loads(saved("stage")), json.loads(saved("mission"))
    assert as_json(mission_from_json(mission)) == mission == stage["mission"]
    drawn = Mission.draw(find_scenario("village"), load_city("village"), 1)
    assert as_json(drawn) == mission
    tell("hold", cell=[2, 8], refused="hold: cell [2,8] does not fit here")
    assert tell("city", name="manhattan")["state"]["held"] is None  # its cells are others
    assert opened("a.json", stage)["state"] == kept | {"undo": True, "redo": False}
    tell("tool", tool="watch")
    flies = tell("race", point=[0, 2])
    with_point = json.loads(saved("stage"))
    tell("see", name="runs", value=[0])
    back = opened("a.json", with_point)
    assert back["state"]["point"] == [0, 2] and back["film"] == flies["film"]
    assert opened("a.json", stage)["state"]["point"] is None
    older = {name: stage[name] for name in stage if name not in ("looks", "point", "held")}
    assert opened("a.json", older)["state"]["looks"]["runs"] == [0, 1]
    fresh = opened("mission.json", mission)["state"]
    assert fresh["policies"] == ["random", "greedy"] and fresh["flown"] == ""


def test_of_several_files_the_first_is_opened_and_this_is_said(tell, opened, saved):
    mission = saved("mission")
    tell("city", name="manhattan")
    scene = opened("a.json", mission, others=1)
    assert scene["note"] == "Only a.json was opened: open one file at a time."
    assert scene["state"]["city"] == "village"


def test_a_city_goes_into_a_picture_and_back(tell, opened, saved, tmp_path):
    rows = tell("city", name="manhattan")["film"]["city"]
    content = saved("png")
    (tmp_path / "city.png").write_bytes(content)
    assert load_city(tmp_path / "city.png").text.split() == rows
    tell("city", name="village")
    assert opened("city.PNG", content)["film"]["city"] == rows
    opened("city.png", b"no picture", refused="not a readable PNG")
    Image.new("RGB", (8, 8), (200, 30, 99)).save(tmp_path / "photo.png")
    wrong = (tmp_path / "photo.png").read_bytes()
    opened("photo.png", wrong, refused="photo.png: pixel row 0, column 0 is #c81e63")


def test_a_checkpoint_that_is_opened_flies_and_is_a_rival(opened, tell):
    content = (data_folder() / "checkpoints" / "open_field_ddqn.safetensors").read_bytes()
    state = opened("mine.safetensors", content)["state"]
    assert state["policies"] == ["mine", "greedy"] and state["city"] == "open_field"
    assert ["mine", "mine"] in state["known"]
    opened("mine.safetensors", content[:5000], refused="not an agent of this package")


WRONG = [
    ("version", 2, "another version of the labs (2; this page reads 1): open it there, or"),
    ("version", None, "another version of the labs (null; this page"),
    ("format", "x", "neither a saved page"),
    ("tool", 7, "opens the tool 7, which this page does not have"),
    ("policies", ["greedy"], "which two fly"),
    ("policies", ["greedy", 1], "which two fly"),
    ("looks", 5, "does not say how one looks at the map"),
    ("looks", {"layer": "x"}, 'chooses the layer "x", which this page does not have'),
    ("looks", {"runs": [1, 1]}, "training runs that this page does not have"),
    ("looks", {"runs": [0, 99]}, "training runs that this page does not have"),
    ("point", [0, 99], "point [0,99] of a training, of which no agent flies here"),
    ("point", ["0", "1"], 'point ["0","1"] of a training'),
    ("flown", "nx", "other letters"),
    ("flown", 5, "other letters"),
    ("flown", "x" * 500, 'a flight "xxxx'),
    ("step", 1.5, "must be a whole number"),
    ("step", -2, "must be a whole number from -1"),
    ("held", [0, 8], "holds the cell [0,8], which this city"),
    ("device", 5, "this file shows device 5: here it must be a whole number from 0"),
    ("device", True, "must be a whole number"),
    ("mission", None, "the mission is missing in this file: save the page again"),
    ("mission", {"version": 99}, "another version of the labs (99; this page reads 1)"),
    ("mission", {"flying_time": 501}, "this page allows at most 500 units of time"),
    ("mission", {"flying_time": 0}, "the flying time: 0 must be a whole number from 1 to 500."),
    ("mission", {"devices": [{"cell": [7, 7], "data": "x"}]}, "the data of device 0: must be"),
    ("mission", {"devices": [5]}, "device 0: must be an object. Correct this in the file, or"),
    ("mission", {"city": {"name": "x", "rows": ["LZ", ".."]}}, "row 0 of the city: only . (o"),
    ("mission", {"devices": []}, "devices: must be a list of 1 or more"),
    ("mission", {"devices": [{"cell": [7, 7], "data": 1}] * 3}, "this scenario takes 1 to 2;"),
]


def test_a_file_with_a_wrong_entry_is_refused(opened, saved):
    stage = json.loads(saved("stage"))
    for entry, value, said in WRONG:
        value = stage[entry] | value if entry == "mission" and value else value
        assert len(opened("a.json", stage | {entry: value}, refused=said)["refused"]) < 300


def test_a_rival_that_is_not_there_is_named_and_a_point_flies_over_its_city_alone(
    tell, opened, saved
):
    stage = json.loads(saved("stage"))
    scene = opened("a.json", stage | {"policies": ["foo", "random"]})
    said = "“foo” cannot fly over village on this page, so random and greedy do."
    assert scene["note"] == said and scene["state"]["policies"] == ["random", "greedy"]
    twice = opened("a.json", stage | {"policies": ["greedy", "greedy"]})
    assert twice["note"] == "A rival cannot fly against itself, so random and greedy do."
    stage["mission"]["city"]["name"] = "x" * 41
    opened("a.json", stage, refused="city.name: at most 40 letters")
    tell("city", name="manhattan")
    elsewhere = json.loads(saved("stage")) | {"tool": "watch", "point": [0, 0]}
    opened("a.json", elsewhere, refused="point [0,0] of a training, of which no agent flies here")


def test_what_is_no_file_of_the_labs_is_refused(opened):
    opened("photo.jpg", b"\xff\xd8{", refused=r"(.json), a city (.png) or an agent (.safetensors)")
    opened("a.json", [1], refused="neither a saved page nor a mission")
    opened("a.json", b'{"format": "uavdh_lite sta', refused="cut off: save it again")
    opened("a.json", b" " * 1_000_001, refused="too large")


@pytest.mark.parametrize("seed", range(3))
def test_a_random_message_is_refused_with_the_reason_or_works(modules, tell, seed):
    answers = modules(RANDOM, [seed, 300])
    assert [each for each in answers["refused"] if "did not work" in each[1]] == []
    assert answers["changed"] == []
    assert answers["works"] > 75 and len(answers["refused"]) > 75
    before = mission_of(tell("new"))
    assert mission_of(tell("new")) != before
