"""The session: what each event makes of the stage, what tools find, files, what is refused."""

import base64
import io
import json
import re
from dataclasses import asdict, dataclass, replace

import numpy as np
import pytest
from PIL import Image

from uavdh_lite.beyond.measured import MeasuredEnvironment, believing
from uavdh_lite.beyond.symmetry import in_eight_views
from uavdh_lite.channel import Channel, rate
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.labs import Lab
from uavdh_lite.labs.page import data
from uavdh_lite.missions import HandFlight, Mission, as_json, mission_from_json
from uavdh_lite.observation import Observation
from uavdh_lite.planners import Greedy
from uavdh_lite.recipe import Recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder

LEARNED = """async (seed) => {
    const { city: { name, rows } } = lab.stage.mission;
    const scenario = state_js.scenarioOf(lab.stage.mission.city, lab.shelf);
    const dials = { ...lab.data.recipe, double: true, frozen: false, seed };
    const trainer = new training_js.Trainer({ city: { name, rows }, scenario, dials });
    const agents = [[0, checkpoint_js.partsOf(trainer)]];
    await lab.hear({ kind: "learned", which: 0, agents, step: 0 });
}"""
TAKEN = """() => {
    const { city: { name, rows } } = lab.stage.mission;
    const scenario = state_js.scenarioOf(lab.stage.mission.city, lab.shelf);
    const [found, dials] = [[], { ...lab.data.recipe, double: true, frozen: false, seed: 5 }];
    const run = new run_js.Run({ city: { name, rows }, scenario, dials }, (it) => found.push(it));
    run.hear({ kind: "take", base64: lab.data.trained });
    run.hear({ kind: "save" });
    return found.at(-1).bytes.toBase64();
}"""
SAVED = """async () => {
    const found = [];
    lab.post = ({ kind, content }) => kind === "file" && found.push(content);
    await lab.hear({ kind: "save", what: "WHAT" });
    return new Uint8Array(await new Blob(found).arrayBuffer()).toBase64();
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
    tell("move", device=0, cell=[6, 5])
    for k in (6, 7):  # keys say by how much, though presses before are not answered yet
        assert tell("move", device=0, by=[0, 1])["state"]["devices"][0]["cell"] == [6, k]
    tell("tool", tool="think")
    for k in (6, 5):
        assert tell("whatIf", device=0, by=[0, -1])["panel"]["whatIf"]["moved"] == {"0": [6, k]}


def test_a_drag_is_one_change_and_ends_where_a_device_may_stand(modules, tell):
    before, building = tell("fly", action="hover"), [2, 4]
    count = modules("() => lab.history.length")
    for cell in ([7, 7], building, [7, 6]):
        there = tell("move", device=0, cell=cell, drag=1)["state"]["devices"][0]["cell"]
        assert there == ([7, 7] if cell == building else cell)
    back = tell("move", device=0, cell=building, drag=1, ends=True, refused="on a building")
    assert back["state"]["devices"][0]["cell"] == [7, 6] and back["state"]["flown"] == ""
    assert modules("() => lab.history.length") == count + 1
    undone = tell("undo", by=-1)
    assert mission_of(undone) == mission_of(before) and undone["state"]["flown"] == "h"


def test_undo_brings_a_mission_back_or_a_move_and_a_city_is_found_as_it_was_left(tell):
    before = mission_of(tell("new"))
    after = mission_of(tell("new"))
    tell("tool", tool="think")
    undone = tell("undo", by=-1)
    assert before != after and mission_of(undone) == before and undone["state"]["tool"] == "think"
    assert mission_of(tell("undo", by=1)) == after
    tell("undo", by=1, refused="nothing more to redo")
    tell("tool", tool="fly")
    for action in ("hover", "south"):
        left = tell("fly", action=action)["state"]
    tell("city", name="manhattan")
    assert tell("city", name="village")["state"] == left
    tell("again")
    assert tell("undo", by=-1)["state"]["flown"] == "hs"  # pressed by mistake


IMPOSSIBLE = [
    ("move", {"device": 0, "cell": [2, 4]}, "Not moved: device 0 at (2, 4) stands on a building"),
    ("move", {"device": 0, "cell": [0, 0]}, "in the landing zone"),
    ("move", {"device": 0, "cell": [-1, 0]}, "outside the city of 8 × 8 cells"),
    ("move", {"device": -1, "cell": [2, 4]}, "a building"),
    ("whatIf", {"device": 0, "cell": [2, 4]}, "on a building"),
    ("data", {"device": 0, "value": -1}, "must be 0 to below"),
    ("time", {"value": 0}, "flying time 0: must be at least 1"),
    ("time", {"value": 501}, "this page allows at most 500"),
    ("open", {"link": "abc"}, "this link is damaged"),
    ("open", {"link": "eJwDAAAAAAE"}, ""),
]  # fmt: skip


def test_what_cannot_be_is_refused_with_the_reason_and_changes_nothing(modules, tell):
    left = "() => { window.left = 0; window.onunhandledrejection = () => { window.left += 1; }; }"
    modules(left)
    before = mission_of(tell("show", step=0))
    for kind, values, said in IMPOSSIBLE:
        assert mission_of(tell(kind, refused=said or "Not done", **values)) == before
    assert modules("() => new Promise((done) => setTimeout(() => done(window.left), 50))") == 0


def test_painting_leaves_what_stands_there_and_a_painted_city_is_kept(tell):
    tell("city", name="empty 8 × 8")
    scene = tell("paint", cells=[[5, 5], [5, 6]], sign="B")
    name, state = scene["state"]["city"], scene["state"]
    assert scene["film"]["city"][5] == ".....BB." and name.startswith("my_city")
    row, _ = state["devices"][0]["cell"]
    walls = tell("paint", cells=[[row, c] for c in range(8)] + [state["start"]], sign="B")
    signs = ["L" if [row, c] == state["start"] else "B" for c in range(8)]
    for device in state["devices"]:
        if device["cell"][0] == row:
            signs[device["cell"][1]] = "."
    assert walls["film"]["city"][row] == "".join(signs)
    assert mission_of(walls) == mission_of(scene)
    tell("city", name="empty 12 × 12")
    second = tell("paint", cells=[[5, 5]], sign="B")["state"]
    assert {name, second["city"]} <= {*second["cities"]} and name != second["city"]
    assert tell("city", name=name)["film"]["city"] == walls["film"]["city"]
    tell("add", refused="this scenario takes 1 to 3")
    for k in range(110):  # more than can be undone
        tell("time", value=40 + k)
    tell("city", name="village")
    for k in range(110):
        assert name in tell("time", value=40 + k)["state"]["cities"]
    tell("city", name=name)
    for _ in state["devices"][1:]:
        tell("remove", device=0)
    tell("remove", device=0, refused="the last device stays")
    tell("add")
    assert [d["data"] for d in tell("data", device=1, value=0)["state"]["devices"]][1:] == [0]


def test_a_flight_by_hand_is_the_mission_flown_so(tell):
    tell("tool", tool="fly")
    scene = tell("fly", action="hover")
    you, ghost = scene["film"]["flights"]
    assert you["end"] == "in the air" and len(you["path"]) == 2 and ghost["name"] == "greedy"
    home = tell("fly", action="land")["panel"]
    assert home["you"]["landed"] and home["ghost"]["landed"]
    tell("fly", action="hover", refused="this flight is over")
    tell("again")
    for _ in range(scene["state"]["flyingTime"]):
        crashed = tell("fly", action="hover")["panel"]
    assert crashed["headline"].startswith("You crash; greedy brings ")
    tell("policy", which=0, name="you")
    assert tell("tool", tool="compare")["panel"]["headline"] == crashed["headline"]
    for kind in ("duel", "many"):  # your flight is of this mission alone
        tell(kind, wanted=1, refused="choose two agents, because your flight")
    assert tell("policy", which=1, name="you")["state"]["policies"] == ["greedy", "you"]


YOU, IT = ({"subject": name, "you": name == "you"} for name in ("you", "the agent"))
LANDED = {"landed": True, "ended": True, "collected": 9.0, "steps": 20, "return": 5.0}
HEADLINES = [
    ({"collected": 9.04}, {}, "Level: as much data in as many steps."),
    ({}, {"collected": 10.5, "steps": 22}, "The agent brings 1.5 units more, 2 steps later."),
    ({"collected": 10.0, "steps": 19}, {}, "You bring 1.0 units more, 1 step sooner."),
    ({"steps": 25}, {}, "The agent lands 5 steps sooner, with as much data."),
    ({"landed": False}, {}, "You crash; the agent brings 9.0 units home."),
    ({"landed": False}, {"landed": False}, "Both crash: no data comes home."),
    ({"landed": False, "ended": False}, {}, "One flight is still in the air."),
]


def test_the_difference_of_two_flights_is_said_in_one_sentence(modules):
    said = "([who, results]) => compare_js.headline(who, results)"
    for one, other, expected in HEADLINES:
        assert modules(said, [[YOU, IT], [LANDED | one, LANDED | other]]) == expected
    parts = "(actions) => compare_js.parting(...actions.map((action) => ({ action })))"
    assert [modules(parts, [[1, 2], other]) for other in ([1], [1, 3])] == [None, 1]


def test_a_cause_is_said_only_of_what_was_tried(tell):
    """The other's action where they part, flown on by itself: greedy here is that of Python."""
    city, told = load_city("village"), 0
    greedy = Greedy(Environment(city))
    tell("tool", tool="compare")
    for seed in range(1, 9):
        panel = tell("new")["panel"]
        found = re.search(r"greedy (?:flown )?(\w+) at step .* brought (\S+) units", panel["cause"])
        if not found:
            continue
        flight = HandFlight(greedy.environment, Mission.draw(find_scenario("village"), city, seed))
        for step in range(flight.mission.flying_time):
            if flight.ended:
                break
            action = int(greedy.act(flight.state)[0])
            if step == panel["parting"]:
                action = ACTIONS.index(
                    {"hovered": "hover", "landed": "land"}.get(found[1], found[1])
                )
            flight.step(action)
        end = flight.flights().trajectory(0)
        assert found[2] == f"{(end.data_left[0] - end.data_left[-1]).sum():.1f}"
        told += 1
    assert told > 0


def test_think_tells_what_the_network_answers_without_a_device_or_with_more_time(tell):
    tell("city", name="manhattan")
    tell("tool", tool="think")
    tell("policy", which=0, name="manhattan_ddqn")
    scene = tell("why", step=5)
    city = load_city("manhattan")
    agent = load_agent("manhattan_ddqn")
    agent.network.half().float()  # the weights that the page has
    flier = agent.over(city)
    mission = Mission.draw(find_scenario("manhattan"), city, 0)
    flight = HandFlight(flier.environment, mission)
    for _ in range(5):
        flight.step(int(flier.act(flight.state)[0]))
    state = flight.state
    values = flier.q_values(state)[0].numpy()
    assert scene["panel"]["values"][5] == pytest.approx(values, abs=0.01)
    assert scene["panel"]["expected"][5] == pytest.approx(values.max(), abs=0.01)
    came, (*_, reward) = scene["panel"]["came"], flight.flights().trajectory(0).reward
    assert came[4] == pytest.approx(reward + agent.recipe.discount * came[5], abs=1e-3)
    why = scene["panel"]["why"]
    assert why["step"] == 5 and why["devices"]
    for each in why["devices"]:
        initial, left = state.data_initial.copy(), state.data_left.copy()
        initial[0, each["device"]] = left[0, each["device"]] = 0
        other = flier.q_values(replace(state, data_initial=initial, data_left=left))[0].numpy()
        assert each["worth"] == pytest.approx(values.max() - other.max(), abs=0.02)
        assert each["action"] == other.argmax()
    longer = flier.q_values(replace(state, time_left=state.time_left + 10))[0].numpy()
    assert why["time"] == longer.argmax()
    later = tell("whatIf", time=10)["panel"]
    assert later["other"][5] == pytest.approx(longer, abs=0.01) and later["values"][5] is not None
    tell("whatIf", device=0, away=True)
    moved = tell("whatIf", device=1, cell=[7, 7])
    assert moved["panel"]["whatIf"] == {"away": [0], "moved": {"1": [7, 7]}, "time": 10}
    assert moved["film"]["devices"][1]["cell"] == [7, 7]
    assert moved["state"]["devices"][1]["cell"] != [7, 7]  # the mission is as it was
    assert tell("whatIf", clear=True)["panel"]["other"] is None


def test_a_hundred_missions_are_drawn_anew_and_their_interval_is_students(modules, tell):
    first, second = (tell("many")["panel"]["many"] for _ in range(2))
    assert [row["who"]["name"] for row in first["rows"]] == ["random", "greedy"]
    assert abs(first["from"] - second["from"]) >= 100 and first["rows"] != second["rows"]
    assert first["difference"][2] < 0  # greedy is ahead
    assert first["rows"][0]["both"][0] + second["rows"][0]["both"][0] < 36  # most crash
    assert "many" not in tell("policy", which=0, name="manhattan")["panel"]
    values = np.random.default_rng(0).normal(60, 20, 100)
    found = modules("(values) => world_js.studentInterval(values)", values.tolist())
    half = 1.9842169 * values.std(ddof=1) / 10
    assert found == pytest.approx([values.mean(), values.mean() - half, values.mean() + half])


@pytest.mark.parametrize("later", ["cancel", "new", "look", "learned"])
def test_what_takes_long_ends_when_something_else_is_done(modules, later):
    script = """async (later) => {
        const scenes = [];
        lab.post = (told) => told.kind === "scene" && scenes.push(told.scene);
        const long = lab.hear({ kind: "many" });
        await Promise.all([long, lab.hear({ kind: later, device: 0, agents: [] })]);
        return scenes.map(({ refused, panel }) => [refused, Boolean(panel.many)]);
    }"""
    modules("() => { lab.extra = {}; }")
    assert modules(script, later) == [["", False], ["", later in ("look", "learned")]]


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


def test_a_mission_goes_to_python_and_back_and_a_stage_keeps_everything(tell, opened, saved):
    tell("new")
    tell("fly", action="hover")
    tell("policy", which=0, name="random")
    tell("policy", which=1, name="you")
    tell("tool", tool="channel")
    tell("see", name="value", value=True)
    tell("see", name="centred", value=True)
    kept = tell("show", step=1)["state"]
    stage, mission = json.loads(saved("stage")), json.loads(saved("mission"))
    assert as_json(mission_from_json(mission)) == mission == stage["mission"]
    drawn = Mission.draw(find_scenario("village"), load_city("village"), 1)
    assert as_json(drawn) == mission
    tell("city", name="manhattan")
    assert opened("a.json", stage)["state"] == kept | {"undo": True, "redo": False}
    mission["city"]["name"] = "odd\u0007\u2028\u00a0 name"
    assert opened("mission.json", mission)["state"]["city"] == mission_from_json(mission).city.name
    fresh = opened("mission.json", stage["mission"])["state"]
    assert fresh["policies"] == ["random", "greedy"] and fresh["flown"] == ""


def picture(pixels):
    file = io.BytesIO()
    Image.fromarray(np.uint8(pixels)).save(file, "PNG")
    return file.getvalue()


def test_a_city_goes_into_a_picture_and_back_and_white_is_ground(tell, opened, saved, tmp_path):
    rows = tell("city", name="manhattan")["film"]["city"]
    content = saved("png")
    (tmp_path / "city.png").write_bytes(content)
    assert load_city(tmp_path / "city.png").text.split() == rows
    pixels = np.array(Image.open(tmp_path / "city.png").convert("RGB"))
    pixels[(pixels == 0).all(axis=-1)] = 255
    for painted in (content, picture(pixels)):
        tell("city", name="village")
        assert opened("city.PNG", painted)["film"]["city"] == rows
    exif, turned = Image.Exif(), io.BytesIO()
    exif[0x0112] = 6  # turned to the right
    Image.fromarray(pixels).save(turned, "PNG", exif=exif)
    assert opened("city.png", turned.getvalue())["film"]["city"] == rows
    opened("city.png", b"no picture", refused="not a readable PNG")
    for colour, said in (((200, 30, 99), "#c81e63"), ((0, 0, 0, 0), "#00000000 (not opaque)")):
        wrong = picture(np.full((8, 8, len(colour)), colour))
        opened("photo.png", wrong, refused=f"photo.png: pixel row 0, column 0 is {said}")


def test_agents_are_told_apart_by_their_weights_and_not_by_their_names(opened, tell):
    folder = data_folder() / "checkpoints"
    one, other = (
        (folder / f"{name}.safetensors").read_bytes() for name in ("manhattan_ddqn", "manhattan")
    )
    tell("city", name="manhattan")
    known = tell("tool", tool="compare")["state"]["known"]
    flights = []
    for content in (one, other, one):
        scene = opened("best.safetensors", content)
        flights.append(scene["film"]["flights"][0]["path"])
    assert flights[0] == flights[2] != flights[1]
    titles = [title for _, title in scene["state"]["known"]]
    assert len(titles) == len(known) + 2 == len({*titles}) and titles[0].startswith("best")
    named = opened("manhattan_ddqn.safetensors", other)["state"]  # displaces no other
    assert {*map(tuple, known)} <= {*map(tuple, named["known"])}
    scene = opened("greedy.safetensors", one)  # is not taken for the rule
    titles = [title for _, title in scene["state"]["known"]]
    assert len(titles) == len({*titles})
    opened("mine.safetensors", one[:50], refused="not an agent of this package")
    for damaged in (one[:5000], one[:-60_000] + bytes(50_000) + one[-10_000:]):
        opened("mine.safetensors", damaged, refused="damaged, its checksum is wrong; copy or train")


def yours(scene):
    return [name for name, title in scene["state"]["known"] if title == "your agent"]


def test_each_city_keeps_your_agent_and_a_saved_page_means_no_later_one(
    modules, tell, opened, saved
):
    modules(LEARNED, 0)
    [first] = yours(tell("tool", tool="compare"))
    scene = tell("policy", which=0, name=first)
    stage = json.loads(saved("stage"))
    tell("city", name="empty 8 × 8")
    modules(LEARNED, 1)
    assert yours(tell("look", device=0)) != [first]
    back = tell("city", name="village")
    assert yours(back) == [first] == back["state"]["policies"][:1] and back["film"] == scene["film"]
    modules(LEARNED, 2)  # goes on to fly where the one before did
    [second] = yours(again := tell("look", device=0))
    assert second != first and again["state"]["policies"][0] == second
    note = opened("page.json", stage)["note"]
    assert note == "“your agent” cannot fly here, so others do."
    modules(LEARNED, 0)
    assert opened("page.json", stage)["state"]["policies"][0] == first


def test_what_was_taken_is_saved_with_the_run_that_it_came_from(modules, tell, tmp_path):
    (tmp_path / "taken.safetensors").write_bytes(base64.b64decode(modules(TAKEN)))
    taken = load_agent(tmp_path / "taken.safetensors")
    trained = load_agent(data_folder() / "labs" / "village.safetensors")
    names = ("steps", "updates", "seed")
    assert [taken.training[name] for name in names] == [trained.training[name] for name in names]
    assert taken.recipe.steps == trained.recipe.steps


def test_a_run_that_has_ended_goes_on_where_it_is_given_more_steps(modules, tell):
    run = TAKEN.replace("seed: 5 }", "seed: 5, steps: 16 }").partition("run.hear")[0]
    run += """run.hear({ kind: "step" });
        const ended = run.trainer.finished;
        run.hear({ kind: "turn", dials: { steps: 1e6 } });
        const goes = run.going;
        run.hear({ kind: "stop" });
        return [ended, goes, run.going];
    }"""
    assert modules(run) == [True, True, False]


def over_own(name, sign):
    """An agent of an own city of this name."""
    city = load_city("village")
    own = City.from_text(name, city.text[:-1] + sign)
    agent = load_agent(data_folder() / "labs" / "village.safetensors")
    scenario = replace(agent.scenario, devices=(1, 1), flying_time=(77, 77))
    return replace(agent.over(own), trained_in=(own,), scenario=scenario)


def test_cities_of_one_name_are_told_apart_by_their_cells(tell, opened, tmp_path):
    one, two = over_own("village", "B"), over_own("village", "N")
    told = data({"one": one, "two": two, "greedy": one})
    cities = {city["name"]: city["rows"][-1][-1] for city in told["cities"]}
    of = [(each["city"], cities[each["city"]]) for each in told["agents"]]
    assert of == [("village_2", "B"), ("village_3", "N"), ("village_2", "B")]
    first, second, third = (each["digest"] for each in told["agents"])
    assert first == third != second
    save_agent(tmp_path / "one.safetensors", one)
    scene = opened("one.safetensors", (tmp_path / "one.safetensors").read_bytes())
    assert scene["state"]["city"] == "village_2" and scene["state"]["flyingTime"] == 77
    mission = as_json(Mission.draw(two.scenario, two.city, 0))
    for _ in range(2):
        state = opened("mission.json", mission)["state"]
        assert state["city"] == "village_3" and {"village", "village_2"} <= {*state["cities"]}
    assert tell("city", name="village_2")["film"]["city"][-1][-1] == "B"


class Blind(Observation):
    pass


@dataclass(frozen=True)
class BlindRecipe(Recipe):
    def observation_for(self, environment, size=0):
        return Blind(environment, self.observation, self.data_scale, self.time_scale, size)


def test_an_agent_that_the_page_would_fly_otherwise_is_refused(opened, tmp_path):
    agent, imitation = load_agent("manhattan_ddqn"), load_agent("manhattan")
    recipe = BlindRecipe(**asdict(agent.recipe))
    blind = replace(agent, recipe=recipe, observation=recipe.observation_for(agent.environment))
    save_agent(tmp_path / "blind.safetensors", blind)
    content = (tmp_path / "blind.safetensors").read_bytes()
    opened("blind.safetensors", content, refused="cannot fly agents of the recipe kind BlindRecipe")
    level = np.zeros((256, 256))
    belief = MeasuredEnvironment(imitation.city, mean_snr_db=level)
    high = replace(agent.environment.channel, altitude_m=50.0)
    for odd, said in (
        (blind, "no BlindRecipe"),
        (in_eight_views(imitation), "no EightViews"),
        (believing(imitation, belief), "no MeasuredEnvironment"),
        (agent.over(agent.city, high), "one channel, .* altitude_m 10, not 50"),
        (agent.over(load_city("open_field")), "not trained for open_field"),
    ):
        with pytest.raises(InputError, match=said):
            Lab(agent=odd)
    with pytest.raises(InputError, match="not trained for open_field"):
        Lab(city="open_field", agent="manhattan_ddqn")


def test_an_agent_over_another_channel_than_the_pages_is_refused(opened, tmp_path):
    agent, file = load_agent("manhattan_ddqn"), tmp_path / "quiet.safetensors"
    quiet = replace(agent.scenario, channel=Channel(cell_edge_snr_db=-25.0))
    save_agent(file, replace(agent, scenario=quiet))
    opened(file.name, file.read_bytes(), refused="another radio channel than the page's")
    with pytest.raises(InputError, match="cell_edge_snr_db -15, not -25"):
        data({"usual": agent, "quiet": load_agent(file)})


def test_an_agents_city_is_known_by_its_cells_and_a_lab_flies_there_alone():
    agent = load_agent("manhattan_ddqn")
    renamed = replace(agent, trained_in=(replace(agent.city, name="mine"),))
    assert data({"it": renamed})["agents"][0]["city"] == "manhattan"
    for city in (None, "manhattan"):
        assert '"version":1,"city":{"name":"manhattan"' in Lab(city=city, agent=renamed).page
    with pytest.raises(InputError, match="not trained for village"):
        Lab(city="village", agent=renamed)


WRONG = [
    ("version", 2, "not of version 1 of the labs"),
    ("format", "x", "neither a saved page"),
    ("mission", None, "this is no mission of version 1"),
    ("mission", {"flying_time": 501}, "this page allows at most 500"),
    ("mission", {"devices": [{"cell": [7, 7], "data": "x"}]}, "device 0 has x data units"),
    ("mission", {"devices": [5]}, "damaged"),
    ("mission", {"start": [0.5, 0]}, "(0.5, 0) is outside the city"),
    ("mission", {"city": {"name": "x", "rows": ["LZ", ".."]}}, "row 0, column 1: 'Z' is none"),
    ("mission", {"seed": -1}, "seed -1"),
]


def test_a_file_with_a_wrong_entry_or_of_another_kind_is_refused(opened, saved):
    stage = json.loads(saved("stage"))
    for entry, value, said in WRONG:
        value = stage[entry] | value if entry == "mission" and value else value
        assert len(opened("a.json", stage | {entry: value}, refused=said)["refused"]) < 300
    odd = {"policies": ["foo", "random"], "tool": 7, "step": -2, "device": 5, "flown": "x"}
    scene = opened("a.json", stage | odd)
    assert scene["note"] == "“foo” cannot fly here, so others do."
    assert scene["state"]["policies"] == ["random", "greedy"] and scene["state"]["tool"] == "fly"
    assert [scene["state"][name] for name in ("step", "device", "flown")] == [-1, 0, ""]
    opened("photo.jpg", b"\xff\xd8{", refused="a city (.png) or an agent (.safetensors)")
    opened("a.json", [1], refused="neither a saved page nor a mission")
    opened("a.json", b'{"format": "uavdh_lite sta', refused="cut off: save it again")
