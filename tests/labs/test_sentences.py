"""What is said of flights is what the flights did: facts, and the sentences made of them."""

import re
from itertools import pairwise

import pytest

NORTH, EAST, SOUTH, WEST, HOVER, LAND = range(6)
WHO = """const whoIs = (name) => ({ name, title: name, subject: name, you: name === "you" });
const [one, two, you] = ["one", "two", "you"].map(whoIs);
const say = words_js.sentence;"""


# Where a flight was flown: home is everywhere, and another action would bring 2 units
WHERE = """{ mission: { fading: () => 0 }, environment: { timeToLand: Array(9).fill(0),
    drawFading: () => 0, transition: () => ({ outcome: { uploaded: [2] } }) } }"""


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
        **more,
    }


@pytest.mark.parametrize(
    ("first", "second", "part"),
    [
        (flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 32, 42), 4),  # two ways
        (flown(0, 1, 2, 12, 22, 23, 24), flown(0, 10, 20, 21, 22, 23, 24), None),
        (flown(0, 1, 2, 12, 22, 23, 24),
         flown(0, 10, 20, 21, 22, 32, 42, left=[9, 9, 9, 6, 6, 6, 6]), 0),  # it has got something
        (flown(0, 1, 2, 3), flown(0, 10, 11, 12), 0),  # they end near each other
        (flown(0, 1, 2, 3, 4), flown(0, 1, 2, 3, 4, 4), 3),  # one stays longer
        (flown(0), flown(0, 1), None),  # one has not begun
    ],
)  # fmt: skip
def test_flights_part_where_they_are_near_and_act_differently_for_the_last_time(
    modules, first, second, part
):
    assert modules("(both) => compare_js.parting(...both, 10)", [first, second]) == part


def test_steps_without_data_are_counted_and_the_longest_stretch_that_leads_nowhere_is_found(
    modules,
):
    cells = [0, 1, 2, 1, 2, 2, 2, 2, 2, 2]
    flight = flown(*cells, left=[9, 9, 9, 9, 9, 9, 8, 8, 8, 8])
    flight["action"] = [EAST, EAST, WEST, EAST, HOVER, HOVER, HOVER, LAND, LAND]
    flight["intervened"] = [False] * 7 + [True, False]  # a refused landing brings nothing, too
    lost = {"first": 0, "last": 5, "gained": 0, "hovers": 1, "turns": 3}  # it flies there first
    for step, count, stretch in ((0, 7, lost), (3, 4, None)):
        found = modules(
            "(it) => compare_js.idle(...it).filter((each) => each).length", [flight, step]
        )
        assert found == count
        assert modules("(it) => compare_js.astray(...it)", [flight, step]) == stretch


RESULT = {"landed": True, "ended": True, "steps": 10, "collected": 5.0, "return": 3.0}
VERDICTS = [
    ({}, {"return": 3.2}, "Nearly level."),
    ({"ended": False}, {}, "One flight is still in the air."),
    ({"steps": 0, "ended": False}, {}, "One flight has not begun: fly it in the tool Fly."),
    ({"return": 9}, {"landed": False, "return": -150},
     "One wins, because two crashes: all that was collected is lost."),
    ({"return": 9, "collected": 9.4}, {"steps": 8},
     "One wins: 4.4 units more, home 2 steps later."),
    ({"return": 8.0, "collected": 4.5, "steps": 9}, {},
     "One wins by 5.0 in return, although it brings 0.5 units less, "
     "because fewer actions are refused."),
    ({"return": 3.6, "collected": 4.5, "steps": 7}, {},
     "One wins by 0.6 in return, although it brings 0.5 units less, "
     "because it is home 3 steps sooner."),
    ({"return": 3.6, "collected": 5.04}, {}, "One wins: fewer refusals."),
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
        ends: [{ who: you, device: 1, by: 7 }, { who: one, home: true }] },
      { kind: "idle", who: you, count: 9, other: one, others: 2 },
      { kind: "astray", who: you, first: 0, last: 5, gained: 0, hovers: 1, turns: 3 },
      { kind: "astray", who: one, first: 4, last: 9, gained: 0.25, hovers: 5, turns: 0 },
      { kind: "leaves", who: you, device: 0, more: 2.25, unused: 0, other: one, first: 4, last: 4 },
      { kind: "crash", who: one, other: you }]"""
    assert modules(f"() => {{ {WHO} return {facts}.map(say); }}") == [
        "At step 4, you want to land and may not and get your first 2 units from device 1 "
        "by step 7, while one hovers and goes home.",
        "From then on you spend 9 steps that bring less than 0.1 units each; one spends 2.",
        "From step 1 to 5 you gain nothing: you hover in 1 of these steps, "
        "and you fly to and fro in 3 of these steps.",
        "From step 5 to 9 one gains only 0.3 units: it hovers all the while.",
        "In the end you leave 2.3 units more at device 0; one collects there in step 5.",
        "One wins, because you crash: all that was collected is lost.",
    ]


@pytest.mark.parametrize("wanted", [1, -1, 0])
def test_a_duel_is_what_was_asked_for_and_its_reasons_are_what_the_flights_did(tell, wanted):
    tell("city", name="manhattan")
    scene = tell("duel", wanted=wanted)
    panel, flights = scene["panel"], scene["film"]["flights"]
    ahead = panel["results"][0]["return"] - panel["results"][1]["return"]
    assert abs(ahead) < 0.5 if wanted == 0 else wanted * ahead > 2
    winner = {1: "The DDQN agent wins", -1: "Greedy wins", 0: "Nearly level"}[wanted]
    assert panel["verdict"].startswith(winner)
    part, why = panel["parting"], " ".join(panel["why"])
    assert panel["why"][0].startswith(f"At step {part + 1}, ") and part in panel["look"]
    soon = []
    for flight in flights:
        before = flight["left"][part][:-1]
        given = [[a - b for a, b in zip(before, left[:-1], strict=True)] for left in flight["left"]]
        when = next((k for k in range(part, len(given)) if max(given[k]) >= 2), None)
        if when is not None:
            soon.append((str(given[when].index(max(given[when]))), str(when)))
    clauses = re.findall(r"gets its first 2 units from device (\d) by step (\d+)", why)
    assert clauses == soon or (not clauses and len({device for device, _ in soon}) <= 1)
    said = r"leaves ([\d.]+) units more at device (\d).*; .* collects there "
    said += r"(?:from step (\d+) to|in step) (\d+)"
    for amount, device, first, last in re.findall(said, why):
        left = [[each[int(device)] for each in flight["left"]] for flight in flights]
        loser, winner = sorted(left, key=lambda each: -each[-1])
        assert loser[-1] - winner[-1] == pytest.approx(float(amount), abs=0.051)
        first, last = int(first or last), int(last)
        assert winner[first - 1] - winner[last] > float(amount) - 0.25  # they came in these steps
        for outside in (first - 1, last + 1):  # and the device gives none in the next ones
            assert outside in (0, len(winner)) or winner[outside - 1] - winner[outside] < 0.1


@pytest.mark.parametrize("number", range(4))
def test_what_an_agent_chooses_and_why_is_what_its_flight_shows(tell, number):
    tell("city", name="manhattan")
    for _ in range(number):
        tell("new")
    scene = tell("tool", tool="think")
    panel, (flight,) = scene["panel"], scene["film"]["flights"]
    left, path = flight["left"], flight["path"]
    assert any("because device" in each for each in panel["says"])
    for step, text in enumerate(panel["says"]):
        values = panel["values"][step]
        best, second = sorted(values, reverse=True)[:2]
        assert text.startswith(panel["actions"][values.index(best)])
        instead = r"(, which would bring [\d.]+ units in this step)?"
        gap = float(re.search(rf"([\d.]+) ahead of (\w+){instead}\.$", text)[1])
        assert gap == pytest.approx(best - second, abs=0.051) or best - second < 0.01
        found = re.search(r"device (\d).* gives ([\d.]+) units (in this|within (\d+)) step", text)
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
            assert ("because" in text) == (steps <= 3) != ("on the way to" in text)


def test_the_closest_call_has_something_at_stake_or_says_that_it_has_not(modules):
    flight = flown(0, 1, 2, 3, left=[9, 9, 0, 0])
    call, values = "(flight) => think_js.closestCall(flight)", [[5, 1], [5, 4], [5, 4.9]]
    assert modules(call, flight | {"values": values}) == {"step": 1, "gap": 1, "stake": True}
    said = f"(flight) => [1, 2].map((k) => think_js.choice(flight, k, {WHERE}).instead)"
    calls = flight | {"values": [[5, 1], [5, 4.9], [5, 4.9]], "states": [0, 0, 0]}
    assert modules(said, calls) == [2, None]
    waits = flown(0, 0, 1, 2, left=[9, 9, 9, 0]) | {"values": [[5, 1]] * 3}
    assert modules(said.replace("instead", "reason").replace("1, 2", "0, 1"), waits) == [
        None,
        {"kind": "gives", "device": 0, "amount": 9, "within": 2, "way": False, "back": False},
    ]  # hovering does not bring what comes from flying on
    done = flown(0, 1, 2, 3, left=[0, 0, 0, 0])
    found = modules(call, done | {"values": values})
    assert found["step"] == 2 and found["stake"] is False


def test_a_gain_is_named_first_and_a_landing_says_since_when_all_is_collected(modules):
    flight = flown(0, 1, 0, 1, 1, left=[9, 9, 5, 0, 0])
    flight["action"][3] = LAND
    values = [[5, 4]] * 4
    why = f"(it) => [1, 2, 3].map((k) => words_js.sentence(think_js.choice(it, k, {WHERE})))"
    back, last, land = modules(why, flight | {"values": values})
    assert back.startswith("west, because device 0 gives 4.0 units in this step, back to where it")
    assert last.startswith("east, because device 0 gives 5.0 units in this step, back")
    assert land.startswith("land, because all data is collected;")
    later = flown(0, 1, 1, 1, left=[9, 0, 0, 0])
    later["action"][2] = LAND
    said = modules(why.replace(", 3]", "]"), later | {"values": values})[1]
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
        "points": [{"steps": 5000 * k, "landed": s, "collected_and_landed": s} for k, s in points]
    }


def told(modules, *runs):
    script = "(runs) => race_js.raceFacts(runs, 100).map(words_js.sentence)"
    return [each.replace("\N{NO-BREAK SPACE}", " ") for each in modules(script, list(runs))]


def test_a_race_says_where_they_learned_to_land_and_how_they_ended(modules):
    blue, orange = run_of(0, 0.93, 0.3, 0.92), run_of(0, 0.9, 0, 0, 0)
    kinks = modules(
        "(runs) => runs.map(race_js.kinkOf)", [blue, orange, run_of(1, 1), run_of(0.2, 0.5)]
    )
    assert kinks == [3, None, None, 1]
    first = "Blue learns to land for good here, after 15,000 steps: 30 of 100 before, 92 then."
    forgot = "After 5,000 steps 93 landed, but it forgot how."
    never = "Orange has not learned to land for good."
    brings = "lands {0} of 100 and brings {0} % of the data home"
    end = f"Blue wins: blue {brings.format(92)}; orange {brings.format(0)}."
    assert told(modules, blue, orange) == [first, forgot, never, end]
    assert told(modules, orange, blue)[-1].startswith("Orange wins")
    assert told(modules, run_of(1, 0.5))[0] == "Blue lands from the start."
    assert told(modules, blue, blue)[-1].startswith("In the end: blue lands 92")
