"""What is said of flights is what the flights did: facts, and the sentences made of them."""

import base64
import json
import re
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.labs.page import recorded_races
from uavdh_lite.missions import HandFlight, Mission, as_json
from uavdh_lite.scenario import find_scenario

NORTH, EAST, SOUTH, WEST, HOVER, LAND = range(6)
WHO = """const whoIs = (name) => ({ name, title: name, subject: name, you: name === "you" });
const [one, two, you] = ["one", "two", "you"].map(whoIs);
const say = words_js.sentence;"""


# Where a flight was flown: home is everywhere, and another action would bring 2 units
WHERE = """{ mission: { fading: () => 0, devices: [] }, environment: { timeToLand: Array(9).fill(0),
    drawFading: () => 0, rateMap: () => [...Array(10).keys()],
    transition: () => ({ state: { uavCell: 0, dataLeft: [9] },
        outcome: { uploaded: [2], intervened: false } }) } }"""


HERE = [{"deviceCells": [0]}]


def flown(*cells, left=None, **more):
    """A flight over a city of 10 × 10 cells with one device, which gives nothing unless told."""
    moves = {0: HOVER, 1: EAST, -1: WEST, -10: NORTH, 10: SOUTH}
    steps = [after - before for before, after in pairwise(cells)]
    left = [9.0] * len(cells) if left is None else left
    return {
        "uavCell": list(cells),
        "action": [moves[step] for step in steps],
        "intervened": [False] * len(steps),
        "dataLeft": [[each] for each in left],
        "timeLeft": list(range(20, 20 - len(cells), -1)),
        "reward": [-0.2] * len(steps),
        "landed": True,
        "states": [{"deviceCells": [99]}],
        **more,
    }


@pytest.mark.parametrize(
    ("first", "second", "part"),
    [
        (flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 32, 42), 4),  # two ways
        (flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 23, 24), None),
        (flown(0, 1, 2, 12, 22, 23, 24),
         flown(0, 10, 20, 21, 22, 32, 42, left=[9, 9, 9, 6, 6, 6, 6]), 0),  # it has got something
        (flown(55, 65, 75, 74, 73, 72), flown(46, 56, 66, 76, 86, 96), 2),  # they differ in 3, too
        (flown(0, 1, 2, 3), flown(0, 10, 11, 12), 0),  # they end near each other
        (flown(0, 1, 2, 3, 4), flown(0, 1, 2, 3, 4, 4), 3),  # one stays longer
        (flown(0), flown(0, 1), None),  # one has not begun
    ],
)  # fmt: skip
def test_flights_part_where_they_are_near_and_act_differently_for_the_last_time(
    modules, first, second, part
):
    assert modules("(both) => compare_js.parting(...both, 10)", [first, second]) == part


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        (flown(0, 1, 11, 12, 13), flown(0, 10, 11, 21, 31),
         "They first act differently at step 1, but stay near each other until step 3."),
        (flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 32, 42),
         "They first act differently at step 1, but come near each other again."),
        (flown(0, 1, 2, 12, 22, 23, 24, left=[9, 9, 8, 8, 8, 8, 2], timeLeft=[0] * 7),
         flown(0, 10, 20, 21, 22, 32, 42, timeLeft=[0] * 7),
         "They first act differently at step 1, but come near each other again; before step 5 one "
         "has collected 1.0 units more, in the end 7.0 more."),
        (flown(0, 1, 1, 1, 1, 1, left=[9, 0, 0, 0, 0, 0], reward=[-1] * 5),
         flown(0, 10, left=[9, 0]),
         "Apart from landing, one takes 0 steps that bring 0.1 units or more and 4 that do not, "
         "hovering in steps 2–5, though nothing has been left to collect since step 1; two takes 0 "
         "and 0."),
        (flown(0, 1, 2, 3, left=[9, 9, 8, 8]), flown(0, 10, 20, 30, left=[9, 9, 6.6, 6.6]),
         "At step 1, one flies east and goes home, while two flies south and gets 2.4 units from "
         "device 0 by step 2."),
        (flown(0, 1, 2, 3, left=[9, 6.5, 6, 6]), flown(0, 10, 20, 30),
         "one flies east and gets 2.5 units from device 0 in this step, while two flies south and"),
        (flown(0, 0, 0, 0, 0, 0, 0, 0, left=[9, 8.95, 8.9, 8.85, 8.8, 8.75, 8.7, 6], timeLeft=[0]),
         flown(0, 10, 10, 10, 10, 10, 10, 10, left=[9] * 8, timeLeft=[0]),
         "One spends steps 1–6 hovering; two spends steps 2–7 hovering; none of these steps brings "
         "0.1 units. In the end two leaves 3.0 units more at device 0, with all its time used. At "
         "device 0, one collects 2.7 units in step 7; two collects less than 0.1 units."),
        (flown(0, 1, 2, 3, left=[9, 9, 7.1, 7.1]), flown(0, 10, 20, 30, left=[9, 9, 6.9, 6.9]),
         "From step 1 on they fly different ways, but get about as much from each device."),
        (flown(0, 1, 2, 3, 4, 5, left=[9, 8, 7, 6, 5, 4], reward=[-1] * 5),
         flown(0, 10, left=[9, 1]),
         "In the end one leaves 3.0 units more at device 0. At device 0, two"),
        (flown(0, 1, 2, 3, 2, 1, 0, left=[9, 8, 7, 6, 6, 6, 6], timeLeft=[6, 5, 4, 3, 2, 1, 1]),
         flown(0, 10, 20, 30, 30, 20, 10, 0, left=[9, 8, 7, 6, 4, 3, 3, 3], timeLeft=[0] * 8),
         "In the end one leaves 3.0 units more at device 0, with 1 unit of time unused: one turns "
         "home at step 4, two at step 5. At device 0"),
        (flown(0, *[1] * 9, left=[9, *(8.5 - 0.25 * k for k in range(9))], reward=[-1] * 9),
         flown(0, 10, 20, 21, 21, left=[9, 8, 7, 5.5, 5.5]),
         "One hovers from step 2 to 9, for 0.3 units a step; two flies nearer to the devices and "
         "gets 1.2 on average in each step that brings data."),
        (flown(0, 1, 2), flown(0, 1, 2), "Both fly the same way."),
        (flown(0, 1, 11), flown(0, 10, 11),
         "They first act differently at step 1, but end at the same time in the same cell, with"),
        (flown(0, 1, 2, 3, left=[9, 5, 2, 2]), flown(0, 10, 10, left=[9, 2, 2]),
         "One collects 0.1 units or more for the last time in step 2, from device 0, 3 steps "
         "from home; two collects 0.1 units or more for the last time in step 1, from device 0, 2 "
         "steps from home."),
        (flown(0, 1, 2, 3, left=[9, 5, 0, 0]), flown(0, 10, 10, 10, 10, left=[9, 0, 0, 0, 0]),
         "One has everything after step 2, the last of it from device 0, 3 steps from home; two "
         "has everything after step 1, the last of it from device 0, 2 steps from home, and lands "
         "3 steps later."),
    ],
)  # fmt: skip
def test_what_is_said_of_a_parting_is_what_both_do(modules, first, second, said):
    script = f"""(both) => {{ {WHO} const part = compare_js.parting(...both, 10);
        const way = (_, cell) => 1 + Math.floor(cell / 10) + (cell % 10);
        const where = {{ size: 10, meanSnrDb: [], timeToLand: Array.from({{ length: 100 }}, way) }};
        return compare_js.reasons([one, two], both, part, where).map(say); }}"""
    assert said in " ".join(modules(script, [first, second]))


@pytest.mark.parametrize(
    ("walls", "sealed"), [((88, 89, 98), True), ((88, 89, 97), True), ((88, 89), False)]
)
def test_who_hovers_long_for_a_device_that_no_cell_sees_is_told_so(modules, walls, sealed):
    first = flown(0, *[1] * 9, left=[9, *(8.5 - 0.25 * k for k in range(9))], reward=[-1] * 9)
    second = flown(0, 10, 20, 21, 21, left=[9, 8, 7, 5.5, 5.5])
    signs = ["L", *("B" if cell in walls else "." for cell in range(1, 100))]
    text = "\n".join("".join(signs[row : row + 10]) for row in range(0, 100, 10))
    script = f"""([text, ...both]) => {{ {WHO}
        const where = new world_js.Environment(world_js.City.fromText("it", text));
        return compare_js.reasons([one, two], both, 0, where).map(say).join(" "); }}"""
    said = modules(script, [text, first, second])
    assert "One hovers from step 2 to 9, for 0.3 units a step" in said
    assert sealed == (
        "a step, because device 0 is sealed in: it cannot be seen from any cell that the UAV can "
        "reach; two flies nearer" in said
    )
    idle = flown(0, *[1] * 9, reward=[-1] * 9)  # what it hears is too little to count
    told = "hovering in steps 2–9, when data is left only at device 0, which is sealed in: seen"
    assert sealed == (told in modules(script, [text, idle, second]))


def test_steps_without_data_are_counted_and_the_long_stretches_that_lead_nowhere_are_found(modules):
    cells = [0, 1, 2, 1, 2, 2, 2, 2, 2, 2]
    flight = flown(*cells, left=[9, 9, 9, 9, 9, 9, 8, 8, 8, 8])
    flight["action"] = [EAST, EAST, WEST, EAST, HOVER, HOVER, HOVER, LAND, LAND]
    flight["intervened"] = [False] * 7 + [True, False]  # a refused landing brings nothing, too
    assert modules("(it) => compare_js.idle(it).filter((each) => each).length", flight) == 7
    nowhere = {"stretches": [[1, 4]], "hovers": 1, "turns": 3}  # that of two steps is short
    assert modules("(it) => compare_js.astray(it)", flight) == nowhere


RESULT = {"landed": True, "ended": True, "steps": 10, "collected": 5.0, "return": 3.0}
VERDICTS = [
    ({}, {"return": 3.2}, "Nearly level: both bring 5.0 units in the same time."),
    ({}, {"steps": 8}, "Nearly level: both bring 5.0 units, and two is home 2 steps sooner."),
    ({"collected": 5.4}, {"steps": 9},
     "Nearly level: one brings 0.4 units more, but is home 1 step later."),
    ({}, {"collected": 5.06, "steps": 11},
     "Nearly level: two brings 0.1 units more, but is home 1 step later."),
    ({"landed": False}, {}, "Nearly level."),
    ({"landed": False}, {"landed": False},
     "Both crash, because the time runs out: no data is brought home."),
    ({"ended": False}, {}, "One flight is still in the air."),
    ({"steps": 0, "ended": False}, {}, "One flight has not begun: fly it in the tool Fly."),
    ({"return": 9}, {"landed": False, "return": -150},
     "One wins, because the time runs out before two lands: its data is lost."),
    ({"return": 9, "collected": 9.4}, {"steps": 8},
     "One wins: 4.4 units more, home 2 steps later."),
    ({"return": 5.1, "collected": 5.04}, {}, "One wins: fewer refusals."),
    ({"return": 5.04}, {}, "One is ahead by 2.0 in return: fewer refusals."),  # as the rule says
    ({"return": 3.46, "collected": 5.7, "steps": 11}, {},
     "One is ahead by 0.5 in return: 0.7 units more, home 1 step later."),
    ({"return": 8.0, "collected": 4.5, "steps": 9}, {},
     "One is ahead by 5.0 in return, although it brings 0.5 units less, "
     "because fewer actions are refused."),
    ({"return": 3.6, "collected": 4.5, "steps": 7}, {},
     "One is ahead by 0.6 in return, although it brings 0.5 units less, "
     "because it is home 3 steps sooner."),
    ({"return": 9.5, "collected": 4.54, "steps": 1}, {"collected": 5.0, "steps": 36},
     "One is ahead by 6.5 in return, although it brings 0.5 units less, "
     "because it is home 35 steps sooner."),
    ({"return": 5.4, "collected": 5.36, "steps": 9}, {},
     "One wins: 0.4 units more, home 1 step sooner."),
    ({"return": 5.4, "collected": 4.96, "steps": 9}, {"collected": 5.04},
     "One wins: home 1 step sooner."),
    ({"return": 3.64}, {"return": 2.16}, "One is ahead by 1.4 in return: fewer refusals."),
]  # fmt: skip


@pytest.mark.parametrize(("first", "second", "said"), VERDICTS)
def test_a_verdict_says_who_wins_and_by_what(modules, first, second, said):
    both = [RESULT | first, RESULT | second]
    script = f"(both) => {{ {WHO} return say(compare_js.verdict([one, two], both)); }}"
    assert modules(script, both) == said


def test_sentences_speak_to_the_reader(modules):
    facts = """[
      { kind: "part", step: 3,
        acts: [{ who: you, action: "land", refused: true }, { who: one, action: "hover" }],
        ends: [{ who: you, by: 7, given: [0.96, 2.84, 0.04] }, { who: one, home: true }] },
      { kind: "spends", who: you, spent: { brings: 4, idle: 9 }, other: one,
        others: { brings: 3, idle: 2 }, stretches: [], hovers: 0, turns: 0 },
      { kind: "spends", who: one, spent: { brings: 1, idle: 40 }, other: you,
        others: { brings: 3, idle: 2 }, stretches: [[3, 8], [20, 25]], hovers: 5, turns: 7 },
      { kind: "spends", who: { ...one, thinks: true }, spent: { brings: 1, idle: 40 }, other: you,
        others: { brings: 3, idle: 2 }, stretches: [[3, 8]], hovers: 5, turns: 0 },
      { kind: "leaves", unused: 0,
        devices: [{ device: 0, more: 2.25 }, { device: 2, more: 2 }, { device: 1, more: -1 }],
        loser: { who: you, amount: 0.04, first: -1, last: 9 },
        winner: { who: one, amount: 2.29, first: 4, last: 4 } },
      { kind: "idles", idlers: [{ who: you, stretches: [[4, 34]], hovers: 31, turns: 0 },
        { who: one, stretches: [[14, 29]], hovers: 9, turns: 7 }] },
      { kind: "crash", who: one, other: you }]"""
    assert modules(f"() => {{ {WHO} return {facts}.map(say); }}") == [
        "At step 4, you are refused the landing and get 3.8 units by step 7 "
        "(2.8 from device 1, 1.0 from device 0), while one hovers and goes home.",
        "Apart from landing, you take 4 steps that bring 0.1 units or more and 9 that do not; "
        "one takes 3 and 2.",
        "Apart from landing, one takes 1 step that brings 0.1 units or more and 40 that do not, "
        "hovering or flying to and fro in steps 4–9 and 21–26; you take 3 and 2.",
        "Apart from landing, one takes 1 step that brings 0.1 units or more and 40 that do not, "
        "hovering in steps 4–9; you take 3 and 2. Think shows what it expected there.",
        "In the end you leave 2.3 units more at device 0, 2.0 at device 2 and 1.0 less at device 1."
        " At device 0, one collects 2.3 units in step 5; you collect less than 0.1 units.",
        "You spend steps 5–35 hovering; one spends steps 15–30 hovering or flying to and fro; "
        "none of these steps brings 0.1 units.",
        "One wins, because the time runs out before you land: your data is lost.",
    ]


@pytest.mark.parametrize("wanted", [1, -1, 0])
def test_a_duel_is_what_was_asked_for_and_its_reasons_are_what_the_flights_did(
    modules, tell, wanted
):
    script = "([wanted, both]) => compare_js.isDuel(wanted, both, 0)"
    for by, found in ((2.00001, not wanted), (2.1, True)):  # shown, the first is 2.0 and no more
        both = [RESULT | {"return": RESULT["return"] + by * wanted}, RESULT]
        assert modules(script, [wanted, both]) is found
    tell("city", name="manhattan")
    for _ in range(3):
        check_duel(tell("duel", wanted=wanted), wanted)


def goes_home(environment, cells):
    """For each step whether it leads nearer to the landing, or on over the landing zone."""
    home = environment.time_to_land[0, cells].astype(int)
    over = (home[1:] == 1) & (home[:-1] == 1) & (np.diff(np.array(cells, int)) != 0)
    return (np.diff(home) < 0) | over


def check_shadow(environment, flights, devices, ended, says):
    """What is said of a radio shadow, and of the way home; how often each is said."""
    names = ["the DDQN agent", "greedy"]
    shadow = re.search(
        r"(?:From step (\d+) to|In step) (\d+), (\S.*?) is in the radio shadow of device (\d): "
        r"buildings leave ([\d.]+) of ([\d.]+) units a slot there\. .* gets ([\d.]+) units from "
        r"it, \S.*? (hardly anything|[\d.]+ units)\.",
        says,
    )
    if shadow:
        last, device = int(shadow[2]), int(shadow[4])
        steps = slice((first := int(shadow[1] or last) - 1), last + 1)
        late = names.index(shadow[3])
        hidden, seen = flights[late], flights[1 - late]
        returns = [sum(flight["reward"]) for flight in (hidden, seen)]
        assert returns[0] <= returns[1] + 1e-4
        sight = environment.sight[0, devices[device]]
        assert seen["left"][last - 1][device] >= 0.05  # else nobody hears it any more
        assert not sight[hidden["cells"][steps]].any() and sight[seen["cells"][steps]].all()
        there = hidden["cells"][steps][1:]
        free = replace(environment.channel, path_loss_exponent_nlos=2.27)
        clear = replace(environment, channel=free)
        for world, rate in ((environment, shadow[5]), (clear, shadow[6])):
            mean = float(world.rate_map(devices[device]).ravel()[there].mean())
            assert mean == pytest.approx(float(rate), abs=0.051 if mean > 0.1 else 0.34 * mean)
        gets = [np.subtract(each["left"][first], each["left"][last]) for each in (hidden, seen)]
        some = 0 if shadow[8] == "hardly anything" else float(shadow[8].split()[0])
        assert gets[0][device] == pytest.approx(some, abs=0.051)
        assert gets[1][device] == pytest.approx(float(shadow[7]), abs=0.051)
        most = 4 * clear.rate_map(devices[device]).ravel()[there].sum()
        assert min(most, gets[1][device], hidden["left"][first][device]) - gets[0].sum() > 1.99
        ends = [each["left"][-1][device] for each in (hidden, seen)]
        later = hidden["left"][last][device] - ends[0]
        assert ends[0] - ends[1] > 0.499 or later > 1.99
    turns = re.search(
        r", with (\d+) units? [^:]*: (\S.*?) turns home at step (\d+), [^,.]* step (\d+)\.", says
    )
    if turns:
        fewer = names.index(turns[2])
        for flight, step in zip(
            (flights[fewer], flights[1 - fewer]), turns.groups()[2:], strict=True
        ):
            goes = goes_home(environment, flight["cells"])[:-1]
            step = int(step) - 1
            assert all(goes[step:]) and not any(goes[:step][-1:])
        expected = f"step {turns[4]}. Think shows what it expected at step {turns[3]}."
        assert (expected in says) == (fewer == 0)  # greedy does not think
        assert int(turns[1]) == ended - len(flights[fewer]["action"]) > 0
        assert len(flights[1 - fewer]["action"]) > len(flights[fewer]["action"])
    return shadow is not None, turns is not None


def test_who_brings_as_much_sooner_had_all_sooner_or_was_nearer_home(modules, tell):
    tell("city", name="manhattan")
    script = """([count, kinds]) => Array.from({ length: count }, (_, seed) => {
        const mission = state_js.randomMission(lab.stage.mission.city, seed, lab.shelf);
        const names = ["manhattan_ddqn", "greedy"];
        const who = names.map((name) => flights_js.whoIs(name, lab.agents));
        const { environment } = lab.hangar;
        const flights = names.map((name) => lab.hangar.fly(mission, name));
        const part = compare_js.parting(...flights, environment.size);
        const facts = compare_js.reasons(who, flights, part, environment);
        const said = facts.filter(({ kind }) => kinds.includes(kind));
        const flown = ({ uavCell, action, dataLeft, landed, reward }) =>
            ({ cells: [...uavCell], action: [...action], landed, reward: [...reward],
                left: dataLeft.map((each) => [...each]) });
        return { flights: flights.map(flown), time: mission.flyingTime,
            devices: mission.devices.map((each) => mission.city.cell(each)),
            says: said.map(words_js.sentence).join(" ") };
    })"""
    environment, counts, causes = Environment(load_city("manhattan")), [0, 0], np.zeros(2, int)
    for found in modules(script, [200, ["lasts", "same", "shadow", "leaves"]]):
        flights, says = found["flights"], found["says"]
        causes += check_shadow(environment, flights, found["devices"], found["time"], says)
        one, two = (sum(flight["left"][-1]) for flight in flights)
        home = all(flight["landed"] for flight in flights)
        sooner = len(flights[0]["action"]) != len(flights[1]["action"])
        told = re.findall(
            r"(has everything after|for the last time in) step (\d+), (?:the last of it )?from "
            r"device (\d), (\d+) steps? from home(?:, and lands (\d+) steps? later)?[;.]",
            says,
        )
        assert len(told) == 2 * (home and sooner and abs(one - two) < 0.5)
        for flight, (what, step, device, way, after) in zip(flights, told, strict=False):
            total = [sum(each) for each in flight["left"]]
            k, given = int(step), np.subtract(*flight["left"][int(step) - 1 : int(step) + 1])
            everything = what == "has everything after"
            counts[everything] += 1
            assert everything == (total[-1] < 0.05) and given.argmax() == int(device)
            if everything:
                assert total[k] < 0.05 <= total[k - 1]
            else:
                assert total[k - 1] - total[k] > 0.0999
                assert all(a - b < 0.1 for a, b in pairwise(total[k:]))
            took = len(flight["action"]) - k
            assert environment.time_to_land[0, flight["cells"][k]] == int(way)
            assert took == int(after or way)
        ways = flights[0]["action"] == flights[1]["action"]
        assert ways == ("Both fly the same way." in says)
        if "in the same cell" in says:
            step = int(re.search(r"at step (\d+)", says)[1]) - 1
            first, second = (flight["action"] for flight in flights)
            assert first[:step] == second[:step] and first[step] != second[step]
            assert not sooner and flights[0]["cells"][-1] == flights[1]["cells"][-1]
            assert np.abs(np.subtract(*(flight["left"][-1] for flight in flights))).max() < 0.5
    assert min(*counts, *causes) > 3  # all were seen


def check_level(verdict, names, flights):
    """What a duel that is nearly level says of data and time."""
    totals = [sum(flight["left"][-1][:-1]) for flight in flights]
    steps = [len(flight["path"]) for flight in flights]
    if said := re.search(r"level: (.*) brings ([\d.]+) units more(.*?)\.$", verdict):
        k = int(names[1] in said[1].lower())
        assert totals[1 - k] - totals[k] == pytest.approx(float(said[2]), abs=0.051)
    elif "level: both" in verdict:
        assert totals[0] == pytest.approx(totals[1], abs=0.1)
        k = int(re.search(f"and (the )?{names[1]} is", verdict.lower()) is not None)
    else:
        return
    home = re.search(r"home (\d+) steps? (sooner|later)", verdict)
    assert steps[1 - k] - steps[k] == (
        int(home[1]) * (1 if home[2] == "sooner" else -1) if home else 0
    )


PARTS = r"([\d.]+) (?:units )?from device (\d)"


def check_duel(scene, wanted):
    panel, flights = scene["panel"], scene["film"]["flights"]
    ahead = panel["results"][0]["return"] - panel["results"][1]["return"]
    assert abs(ahead) < 0.5 if wanted == 0 else wanted * ahead > 2
    names = [flight["name"].lower() for flight in flights]
    winner = {1: f"{names[0]} wins", -1: f"{names[1]} wins", 0: "nearly level"}[wanted]
    assert panel["verdict"].lower().removeprefix("the ").startswith(winner)
    check_level(panel["verdict"], names, flights)
    part, why = panel["parting"], " ".join(panel["why"])
    assert part in panel["look"]
    assert re.match(f"At step {part + 1}, .*, while ", why)  # first what is at the ring
    gifts = [
        np.subtract(each["left"][part][:-1], np.array(each["left"])[:, :-1]) for each in flights
    ]
    much = [
        next((k for k, each in enumerate(it) if k > part and max(each) >= 2), 0) for it in gifts
    ]
    by = max(much)  # two amounts are of the same steps
    clauses = re.match(r"At step \d+, (.*?), while (.*?)\.(?: |$)", why).groups()
    given = [it[min(by, len(it) - 1)] for it in gifts]
    for some, clause in zip(given, clauses, strict=True):
        if "gets" in clause:
            assert re.search(rf"by step {by}\b" if by > part + 1 else "in this step", clause)
            named = {int(k): float(it) for it, k in re.findall(PARTS, clause)}
            total = float(re.search(r"gets ([\d.]+) units", clause)[1])
            assert total == pytest.approx(sum(named.values()))
            assert [named.get(k, 0) for k in range(len(some))] == pytest.approx([*some], abs=0.051)
    if any("gets" in clause for clause in clauses):
        assert all("gets" in it for it, when in zip(clauses, much, strict=True) if when)
    else:
        assert len({it.argmax() for it, when in zip(given, much, strict=True) if when}) < 2
    moves = [[*pairwise(flight["path"])] for flight in flights]
    ways = [[[b - a for a, b in zip(*move, strict=True)] for move in each] for each in moves]
    same = [one == other for one, other in zip(*ways, strict=False)]
    where = [[flight["path"][max(k, 0)] for flight in flights] for k in (part - 1, part)]
    before, here = (sum(abs(a - b) for a, b in zip(*two, strict=True)) for two in where)
    assert part == 0 or here == 0 or same[part - 1] or before > 2  # it is the first after that
    named = dict.fromkeys(range(len(flights[0]["left"][0]) - 1), 0.0)
    for clause in re.findall(r" leaves? (.* at device \d)", why):
        loser, winner = sorted(flights, key=lambda each: -sum(each["left"][-1][:-1]))
        for amount, less, device in re.findall(r"([\d.]+) [^\d]*?(less )?at device (\d)", clause):
            named[int(device)] = -float(amount) if less else float(amount)
    if any(named.values()):
        for device, amount in named.items():  # what is not named is little
            more = loser["left"][-1][device] - winner["left"][-1][device]
            assert more == pytest.approx(amount, abs=0.051 if amount else 0.1)
    part_of = r"At device (\d), (.*?) collects (.*?); (.*?) collects (.*?)\."
    for device, *told in re.findall(part_of + "(?: |$)", why):
        for who, what in zip(told[::2], told[1::2], strict=True):
            left = [each[int(device)] for each in flights[names[1] in who.lower()]["left"]]
            if amount := re.match(r"([\d.]+) units (?:from step (\d+) to|in step) (\d+)", what):
                begin, end = int(amount[2] or amount[3]) - 1, int(amount[3])
                assert left[begin] - left[end] == pytest.approx(float(amount[1]), abs=0.051)
                brings = [one - other > 0.099 for one, other in pairwise(left)]
                assert brings[begin] and brings[end - 1] and sum(brings[begin:end]) == sum(brings)
            else:
                assert what == "less than 0.1 units" and left[0] - left[-1] < 0.1
    ahead = r"; before step (\d+) (.*?) has collected ([\d.]+) units more, in the end (\S+) ?(\w*)"
    for step, who, amount, end, more in re.findall(ahead, why):
        one, other = flights if names[0] in who.lower() else flights[::-1]
        at = [sum(other["left"][k][:-1]) - sum(one["left"][k][:-1]) for k in (part, -1)]
        assert int(step) == part + 1 and at[0] == pytest.approx(float(amount), abs=0.051)
        said = 0 if end == "as" else float(end.strip(".")) * (-1 if "less" in more else 1)
        assert at[1] == pytest.approx(said, abs=0.051)
    if since := re.search(r"(.*?) takes .* in steps (\d+).*left to collect since step (\d+);", why):
        lost = flights[names[1] in since[1].rsplit("landing, ")[-1].lower()]
        totals = [sum(left[:-1]) for left in lost["left"]]
        assert totals[int(since[3])] < 0.05 <= totals[int(since[3]) - 1]
        assert int(since[3]) < int(since[2])
    for unused in re.findall(r", with (\d+) units? of time unused", why):
        assert int(unused) == loser["left"][-1][-1] >= winner["left"][-1][-1] + 3
    spends = r"ing, (.*?) takes (\d+) .*? and (\d+) that.*?; .*? takes (\d+) and (\d+)\."
    for who, *counts in re.findall(spends, why):
        order = flights if names[1] not in who.lower() else flights[::-1]
        for flight, brings, nothing in zip(order, counts[::2], counts[1::2], strict=True):
            totals = [sum(left[:-1]) for left in flight["left"]]
            gains = [a - b >= 0.1 for a, b in pairwise(totals)]
            if flight["end"] == "landed":
                gains.pop()
            assert [gains.count(True), gains.count(False)] == [int(brings), int(nothing)]


def brought(environment, mission, actions):
    """Data units that the last of these actions brings, the state after it, if it is refused."""
    flight = HandFlight(environment, mission)
    last = [flight.step(action) for action in actions][-1]
    return float(last.uploaded.sum()), flight.state, bool(last.intervened)


def check_beside(environment, name, compared, states, costs):
    """What is said of the second best action; whether it is said to be better."""
    cells = [int(state.uav_cell[0]) for state in states]
    if states[1].landed[0]:
        assert compared.endswith(", but after land the flight is over")
        return False
    farther = int(np.subtract(*environment.time_to_land[0, cells[::-1]]))
    here, there = (environment.sight[0, states[0].device_cells[0], cell] for cell in cells)
    some = states[0].data_left[0] >= 0.05
    hidden, seen = (np.flatnonzero(each & some) for each in (here & ~there, there & ~here))
    for how, sign in (("longer", 1), ("shorter", -1)):
        said = re.search(rf"the way home is (\d+) steps? {how}", compared)
        assert int(said[1] if said else 0) == max(sign * farther, 0)
    for how, devices in (("hidden", hidden), ("in sight", seen)):
        said = re.search(rf"(device \d(?:(?:, | and )device \d)*) (?:is|are) {how}", compared)
        assert re.findall(r"\d", said[1] if said else "") == [*map(str, devices)]
    assert (costs > 0) == (f"{name} would be refused, which costs 1" in compared)
    assert (costs < 0) == (f"{name} would cost 1 less" in compared)
    likes = farther < 0 or len(seen) or costs < 0
    alone = cells[0] == cells[1] or max(state.data_left.sum() for state in states) < 0.05
    sure = compared.endswith("the network misjudges this")
    if farther > 0 or len(hidden) or costs > 0:
        assert ", but " in compared and not sure
    else:
        unknown = compared.endswith(f": this page cannot tell why {name} is behind")
        assert sure == bool(likes and alone)
        assert unknown == (not likes and " more " not in compared)
    return sure


# One chooses what is worse in all, one is refused and so is the second best of another
@pytest.mark.parametrize(("number", "worse"), [(0, 0), (1, 0), (24, 0), (360, 1), (388, 1)])
def test_what_an_agent_chooses_and_why_is_what_its_flight_shows(tell, number, worse):
    mission = Mission.draw(find_scenario("manhattan"), load_city("manhattan"), number)
    content = base64.b64encode(json.dumps(as_json(mission)).encode()).decode()
    tell("open", name="mission.json", base64=content)
    scene = tell("tool", tool="think")
    panel, (flight,) = scene["panel"], scene["film"]["flights"]
    left, path = flight["left"], flight["path"]
    assert any("because device" in each for each in panel["says"])
    environment, done, sure = Environment(mission.city), [], 0
    for step, text in enumerate(panel["says"]):
        values = panel["values"][step]
        best, second = sorted(values, reverse=True)[:2]
        action, other = (values.index(each) for each in (best, second))
        assert text.startswith(panel["actions"][action])
        gap, name, compared = re.search(r"([\d.]+) ahead of (\w+)(.*)\.$", text).groups()
        assert float(gap) == pytest.approx(best - second, abs=0.051) or best - second < 0.01
        assert name == panel["actions"][other]
        (brings, after, *lost), (instead, there, other_lost) = (
            brought(environment, mission, [*done, each]) for each in (action, other)
        )
        lost.append(other_lost)
        done.append(action)
        if "neither" in compared:
            assert max(brings, instead) < 0.051
        elif said := re.findall(r" ([\d.]+)(?= |$)", compared):
            assert float(said[0]) == pytest.approx(instead, abs=0.051)
            likes = {"not": brings - instead, "more": instead - brings, "much": 0.06}
            assert next(likes[each] for each in likes if f" {each} " in compared) > 0.001
            assert "much" not in compared or brings == pytest.approx(instead, abs=0.101)
        assert bool(compared) or not ("close call" in text or "in this step" in text)
        assert (" is refused: it stays where it is, which costs 1 of the return" in text) == lost[0]
        if compared and ", not " not in compared:
            sure += check_beside(environment, name, compared, (after, there), lost[1] - lost[0])
        found = re.search(
            r"device (\d).* gives ([\d.]+) .*?units (in this|within (\d+)) step", text
        )
        if "on the way home" in text.split(";")[0]:  # and not away again
            cells = np.ravel_multi_index(np.transpose(path[step:-1]), mission.city.kinds.shape)
            assert goes_home(environment, cells).all()
        if "back to where it just was" in text:
            assert path[step + 1] == path[step - 1] != path[step]
            assert found or sum(left[step][:-1]) - sum(left[step + 1][:-1]) < 0.5  # a gain is said
        elif home := re.search(
            r"because home is (\d+) units of time away and (\d+) are left", text
        ):
            assert int(home[2]) <= int(home[1]) + 1
        elif found:
            device, steps = int(found[1]), int(found[4] or 1)
            given = [a - b for a, b in zip(left[step][:-1], left[step + steps][:-1], strict=True)]
            assert given[device] == max(given) == pytest.approx(float(found[2]), abs=0.051)
            assert (
                ("because" in text)
                == (steps == 1)
                != ("on the way to" in text or "waiting" in text)
            )
            assert steps > 1 or brings > instead  # else it is no reason
            if "on the way to" in text:  # where it is heard better
                cell = np.ravel_multi_index(mission.devices[device], mission.city.kinds.shape)
                hears = environment.rate_map(int(cell))
                here, *ahead = (hears[tuple(each)] for each in path[step : step + steps + 1])
                assert max(ahead) > here and path[step + 2] != path[step]
    assert sure == worse


def prospects(environment, state, behind):
    """A function of some of the devices left behind and a weight: the most that can be had by time
    left and cell, and the first action to it."""
    cells = environment.size**2
    uav_cell, action = (each.ravel() for each in np.indices((cells, LAND)))
    batch = state[np.zeros(len(uav_cell), int)]
    batch = replace(batch, uav_cell=uav_cell.astype(np.int16))
    ahead, forbidden = (
        each[0, uav_cell, action] for each in (environment.next_cell, environment.forbidden)
    )
    quiet = np.zeros((len(uav_cell), 4, state.device_cells.shape[1]), np.float32)
    heard = np.log2(1 + 10 ** (environment.snr_db(batch, ahead, quiet) / 10))
    heard = np.minimum(heard, state.data_left)
    ahead = ahead.reshape(cells, LAND)
    landing = environment.time_to_land[0] == 1

    @lru_cache
    def best(devices, weight):
        offer = weight * heard[..., list(devices)].max(-1).sum(-1) - 0.2
        offer = np.where(forbidden, -np.inf, offer).reshape(cells, LAND)
        most, actions = [np.full(cells, -np.inf)], [None]
        for _ in range(int(state.time_left[0])):
            values = np.column_stack([offer + most[-1][ahead], np.where(landing, 0, -np.inf)])
            most.append(values.max(1))
            actions.append(values.argmax(1))
        return most, actions

    return best


# In time for 8.5 units; in time at first, then too late; past two devices; all its time is used
@pytest.mark.parametrize(
    ("number", "said"),
    [(44, "could"), (31, "could none"), (365, "could"), (1, "none"), (6, "left")],
)
def test_on_the_way_home_is_said_what_could_still_have_been_had_in_time(tell, number, said):
    mission = Mission.draw(find_scenario("manhattan"), load_city("manhattan"), number)
    content = base64.b64encode(json.dumps(as_json(mission)).encode()).decode()
    tell("open", name="mission.json", base64=content)
    scene = tell("tool", tool="think")
    environment = Environment(mission.city)
    hand, states = HandFlight(environment, mission), []
    for values in scene["panel"]["values"]:
        states.append(hand.state)
        hand.step(int(np.argmax([-np.inf if each is None else each for each in values])))
    end = hand.state.data_left
    behind = tuple(np.flatnonzero(end[0] >= 0.05))
    cells = [state.uav_cell[0] for state in states]
    away = environment.time_to_land[0, cells].astype(int)
    turns = max([0, *(1 + np.flatnonzero(~goes_home(environment, cells)))])
    goes = [k for k, text in enumerate(scene["panel"]["says"]) if "home" in text.split(";")[0]]
    turns = min([turns, *goes])
    best = prospects(environment, states[turns], behind)
    missed, later, found = scene["panel"]["missed"], (0.0, (), 0), []
    assert len(missed) == len(states) and not any(missed[:turns])
    for step in reversed(range(turns, len(states))):
        bounds, flights = [], [(later[0], later[1], later[2] + 1)]
        for weight in (1, 0.5, 0.25, 0.125):
            state, count = states[step], 0
            most = best(behind, weight)[0][state.time_left[0]][state.uav_cell[0]]
            left = [each.data_left[0, list(behind)].sum() for each in (state, hand.state)]
            bounds.append(most + left[1] - weight * left[0])
            while not state.landed[0]:
                devices = tuple(k for k in behind if state.data_left[0, k] >= 0.05)
                actions = best(devices, weight)[1] if devices else None
                action = actions and actions[state.time_left[0]][state.uav_cell]
                action = environment.way_home[0, state.uav_cell] if action is None else action
                quiet = np.zeros((1, 4, end.shape[1]), np.float32)
                state, count = environment.transition(state, action, quiet)[0], count + 1
            more = (end - state.data_left)[0]
            flights.append((more.sum(), tuple(k for k in behind if more[k] >= 0.05), count))
        gain = [amount - 0.2 * (count - away[step]) for amount, _, count in flights]
        none = min(bounds) + 0.2 * (away[step] - 1) < 0.5
        later = flights[int(np.argmax(gain))] if max(gain) >= 0.5 else (0.0, (), 0)
        assert not (none and later[1])
        text = missed[step]
        assert text.startswith(f"It leaves {end.sum():.1f} units behind. From step {step + 1} on,")
        assert none == ("no flight home in time could collect 0.5 units of them beyond" in text)
        assert bool(later[1]) == ("it could still collect" in text)
        assert ("there may be one" in text) == (not none and not later[1])
        found.append("none" if none else "could" if later[1] else "left")
        if later[1]:
            amount, devices, count = re.search(
                r"collect ([\d.]+) of them from (.*) and be home in time, in (\d+) steps?,", text
            ).groups()
            assert float(amount) == pytest.approx(later[0], abs=0.051)
            assert tuple(map(int, re.findall(r"\d+", devices))) == later[1]
            assert int(count) == later[2] <= states[step].time_left[0]
    assert {*found} == {*said.split()}


def test_the_closest_call_has_something_at_stake_or_says_that_it_has_not(modules):
    flight = flown(0, 1, 2, 3, left=[9, 9, 0, 0])
    call, values = "(flight) => think_js.closestCall(flight)", [[5, 1], [5, 4], [5, 4.9]]
    assert modules(call, flight | {"values": values}) == {
        "step": 1,
        "gap": 1,
        "stake": True,
        "smaller": {"step": 2, "gap": pytest.approx(0.1), "empty": True},
    }
    forced = "() => think_js.closestCall({ values: [[-Infinity, 3]], dataLeft: [[9]] })"
    assert modules(forced) is None  # no choice, so nothing is close
    said = f"([flight, what]) => think_js.choices(flight, {WHERE}).map((each) => each[what])"
    calls = flight | {"values": [[5, 1], [5, 4.9], [5, 4.9]], "states": HERE * 3}
    told = {"brings": 9, "instead": 2, "over": None, "home": 0, "hidden": [], "seen": []}
    told |= {"costs": 0, "alone": False}
    assert modules(said, [calls, "both"]) == [None, told, None]
    waits = flown(0, 0, 1, 2, left=[9, 9, 9, 0]) | {"values": [[5, 1]] * 3, "states": HERE * 3}
    gives = {
        "kind": "gives",
        "device": 0,
        "amount": 9,
        "all": 9,
        "waits": False,
        "back": False,
        "home": False,
    }
    stays = {"kind": "stays", "until": 0, "amount": 0, "rest": 9}
    assert modules(said, [waits, "reason"]) == [
        stays,  # hovering does not bring what comes from flying on
        gives | {"within": 2},
        gives | {"within": 1},
    ]
    done = flown(0, 1, 2, 3, left=[0, 0, 0, 0])
    found = modules(call, done | {"values": values})
    assert found["step"] == 2 and found["stake"] is False and found["smaller"] is None
    goes = flown(0, 1, 2, 3, left=[9, 9, 5, 5]) | {"values": [[5, 1]] * 3, "states": HERE * 3}
    goes["timeLeft"] = [4, 3, 2, 1]
    near = WHERE.replace("Array(9).fill(0)", "[3, 2, 1, 0]").replace("uavCell: 0", "uavCell: 2")
    way = f"(it) => think_js.choices(it, {near}).map(words_js.sentence)"
    first, gains, _ = modules(way, goes)
    assert first.startswith("east, on the way home, which is 3 units of time away; 4 are left;")
    assert gains.startswith(
        "east, because device 0 gives 4.0 units in this step, on the way home; "
    )


def test_a_gain_is_named_first_and_a_landing_says_since_when_all_is_collected(modules):
    flight = flown(0, 1, 0, 1, 1, left=[9, 9, 5, 0, 0])
    flight["action"][3] = LAND
    values, states = [[5, 4]] * 4, HERE * 4
    why = f"(it) => think_js.choices(it, {WHERE}).map(words_js.sentence).slice(1)"
    back, last, land = modules(why, flight | {"values": values, "states": states})
    assert back.startswith("west, because device 0 gives 4.0 units in this step, back to where it")
    assert last.startswith("east, because device 0 gives 5.0 units in this step, back")
    assert land.startswith("land, because all data is collected;")
    later = flown(0, 1, 1, 1, left=[9, 0, 0, 0])
    later["action"][2] = LAND
    said = modules(why, later | {"values": values[1:], "states": states[1:]})[1]
    assert said.startswith("land, because nothing has been left to collect since step 1;")


@pytest.mark.parametrize("planner", ["greedy", "random"])
def test_who_thinks_is_an_agent_and_never_a_planner_under_its_name(tell, planner):
    tell("city", name="manhattan")
    tell("policy", which=0, name=planner)
    scene = tell("tool", tool="think")
    panel = scene["panel"]
    assert panel["instead"]["title"] == planner and panel["name"] == "manhattan_ddqn"
    assert [each["name"] for each in scene["film"]["flights"]] == [panel["agent"]] == ["DDQN agent"]
    tell("policy", which=1, name="manhattan_ddqn")
    after = tell("policy", which=0, name="manhattan_ddqn")  # not the same one twice
    assert after["state"]["policies"] == ["manhattan_ddqn", planner]


def run_of(*shares):
    points = enumerate(shares)
    return {
        "points": [
            {"steps": 5000 * k, "landed": s, "collected_and_landed": s, "time_used": 1 - s / 2}
            for k, s in points
        ]
    }


def told(modules, *runs, metric="landed"):
    script = "([runs, metric]) => race_js.raceFacts(runs, 100, metric).map(words_js.sentence)"
    return [each.replace("\N{NO-BREAK SPACE}", " ") for each in modules(script, [runs, metric])]


def test_a_race_says_where_they_learned_to_land_and_how_they_ended(modules):
    blue, orange = run_of(0, 0.93, 0.3, 0.92), run_of(0, 0.9, 0, 0, 0)
    kinks = modules(
        "(runs) => runs.map(race_js.kinkOf)", [blue, orange, run_of(1, 1), run_of(0.2, 0.5)]
    )
    assert kinks == [3, None, None, 1]
    first = (
        "Blue learns to land for good at its dashed line, after 15,000 steps: "
        "30 of 100 missions landed at the point before, 92 at this one."
    )
    forgot = "Earlier, after 5,000 steps, 93 landed, but it forgot how."
    never = "Orange has not learned to land for good."
    fall, falls = (
        f"After 5,000 steps {run} % of the data home, but after 10,000 only {now} %, its deepest "
        f"fall: it lands in {now} of 100 missions, not in {before} "
        "(choose “collected and landed” to see it)."
        for run, before, now in (("blue brings 93", 93, 30), ("orange brings 90", 90, 0))
    )
    brings = "lands in {0} of 100 missions and brings {0} % of the data home"
    end = f"Blue wins: blue {brings.format(92)}; orange {brings.format(0)}."
    assert told(modules, blue, orange) == [first, forgot, fall, never, falls, end]
    assert told(modules, orange, blue)[-1].startswith("Orange wins")
    seen = told(modules, blue, metric="collected_and_landed")[2]
    assert seen == fall.replace(" (choose “collected and landed” to see it)", "")
    assert told(modules, run_of(1, 0.5))[0] == "Blue lands from the start."
    assert told(modules, blue, blue)[-1].startswith("In the end: blue lands in 92")
    better = run_of(0, 0.9, 1)
    better["points"][2]["collected_and_landed"] = 0.5
    said = (
        "lands in 100 of 100 missions, not in 90, but its flights take 50 % of their time, not 55 %"
    )
    assert said in (why := told(modules, better)[1]) and "because it goes home sooner: it" in why
    better["points"][2]["time_used"] = 0.55
    assert "not in 90, but collects less in about the same time" in told(modules, better)[1]
    sooner = told(modules, run_of(0, 0.9, 0.9), run_of(0, 0, 0.9))
    assert "Blue learns to land 5,000 steps sooner." in sooner
    assert len(told(modules, run_of(0, 0.9, 0.87))) == 2  # hardly less is no fall


def test_the_mission_of_a_race_is_typical_and_it_is_told_what_the_point_brought(modules, tell):
    races = recorded_races()
    tell("city", name="manhattan")
    tell("tool", tool="watch")
    for k, setting in enumerate(races["settings"]):
        tell("see", name="runs", value=[k])
        far = []
        for number, point in enumerate(setting["points"]):
            scene = tell("race", point=[0, number])
            (flight,) = scene["film"]["flights"]
            first, last = (sum(flight["left"][at][:-1]) for at in (0, -1))
            share = (flight["end"] == "landed") * (first - last) / first
            far.append(abs(share - point["collected_and_landed"]))
            home = f"{point['collected_and_landed']:.0%}".replace("%", "\N{NO-BREAK SPACE}%")
            assert scene["panel"]["mean"].endswith(
                f"it lands in {100 * point['landed']:.0f} and brings {home} of the data home."
            )
            assert scene["panel"]["left"]  # undo brings the reader's mission back
        assert np.mean(far) < 0.1 and max(far) < 0.3
    assert tell("undo", by=-1)["state"]["city"] == "manhattan"
    assert not tell("see", name="runs", value=[0])["panel"].get("left")
