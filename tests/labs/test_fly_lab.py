"""The lab in which one flies by hand: keys, refusals, scores and the ranking."""

import re
from dataclasses import replace

import numpy as np
import pytest
from driving import click, key, link_of, set_by

from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, LAND
from uavdh_lite.labs import FlyLab, MissionLab
from uavdh_lite.labs.fly import HARD, KEYS, YOU
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario


@pytest.fixture
def lab():
    return FlyLab("village", seed=3)


def act(lab, *names):
    for name in names:
        lab.act(ACTIONS.index(name))


def fly_as(lab, name):
    """Fly as a policy does, by hand."""
    policy = find_policy(name, lab.environment, lab.flight.mission.seed)
    flown = lab.flight.mission.fly(lab.environment, policy)
    for action in flown.trajectory(0).action:
        lab.act(int(action))
    return float(flown.returns[0])


def test_flying_by_hand_with_buttons_and_keys(lab):
    before, start = lab.stage.drawing, lab.flight.state.uav_cell[0]
    lab.buttons[ACTIONS.index("south")].click()
    assert lab.flight.state.uav_cell[0] == start + 8
    key(lab, "ArrowUp")
    assert lab.flight.state.uav_cell[0] == start
    key(lab, "q")  # no such key: nothing happens
    assert len(lab.flight.flights().history) == 2
    assert lab.stage.drawing != before and lab.score.value == ""
    assert lab.stage.begin == 1 and lab.stage.steering[:-1] == list(KEYS)  # the last step plays
    key(lab, "Enter")
    assert lab.flight.ended and "landed" in lab.message.value
    assert all(name in lab.score.value for name in ("you", "greedy", "genie", "random"))
    shown = lab.stage.drawing
    lab.buttons[0].click()  # over is over
    assert lab.stage.drawing == shown
    lab.again.click()
    assert not lab.flight.ended and lab.score.value == ""
    while not lab.flight.ended:
        act(lab, "hover")
    assert "crashed" in lab.message.value and "<td>crashed</td>" in lab.score.value


def test_each_step_says_what_it_brought():
    lab = FlyLab("village")
    before = lab.flight.state.data_left[0]
    act(lab, "south")
    (uploaded,) = (before - lab.flight.state.data_left[0])[before > 0]
    assert 0 < uploaded < 0.1
    assert f"Step 1: flies south; device 0 uploads {uploaded:.1g} units." in lab.message.value
    assert f"{lab.flight.state.time_left[0]} units of time left" in lab.message.value


@pytest.mark.parametrize(
    ("start", "action", "reason", "where"),
    [
        ((3, 0), "east", "a no-fly zone is there", [0, 1]),
        ((1, 3), "east", "a tall building is there", [0, 1]),
        ((4, 0), "land", "this is no landing zone", [0, 0]),
        ((5, 7), "east", "the map ends there", [0, 1]),
    ],
)
def test_a_refusal_says_what_is_in_the_way_and_is_shown(lab, start, action, reason, where):
    lab.flight = HandFlight(lab.environment, replace(lab.flight.mission, start=start))
    act(lab, action)
    assert f"Step 1: {action} is refused, for {reason}" in lab.message.value
    assert lab.stage.refused == where
    act(lab, "hover")
    assert lab.stage.refused == [] and "refused" not in lab.message.value


def test_a_step_is_taken_back_and_the_fading_stays(lab):
    actions = ("south", "hover", "hover")
    assert lab.undo.disabled
    act(lab, *actions)
    left = lab.flight.state.data_left
    key(lab, "z")
    lab.undo.click()
    assert lab.flight.state.time_left[0] == lab.flight.mission.flying_time - 1
    act(lab, *actions[1:])
    assert (lab.flight.state.data_left == left).all()
    act(lab, "north", "land")
    assert lab.flight.ended and lab.scores == {} and lab.session.value == ""
    assert "You took a key back" in lab.verdict.value
    lab.take_back()  # the landing itself
    assert not lab.flight.ended and lab.score.value == ""
    for _ in range(9):
        lab.take_back()
    assert lab.undo.disabled and "no step to take back" in lab.message.value


def test_your_flight_gets_a_verdict_and_a_place_in_the_ranking():
    lab = FlyLab("village")
    yours = fly_as(lab, "greedy")
    best = max(float(each.returns[0]) for each in lab._results.values())
    behind = f"{best - yours:.1f} behind any_city agent and genie."  # both have as much
    assert f"Your return is {yours:.2f}, {behind}" in lab.verdict.value
    for shown, caption in ((lab.score.value, "this mission"), (lab.session.value, "this session")):
        names = re.findall("<tr[^>]*><td>([^<]+)</td>", shown)
        assert names == ["any_city agent", "genie", "greedy", "you", "random"]
        assert f"<caption>{caption}" in shown and shown.count('class="uavdh-you"') == 1
    lab.again.click()
    fly_as(lab, "genie")
    assert f"is {best:.2f}: nobody has more; any_city agent and genie as much." in lab.verdict.value
    lab.again.click()
    lab.act(LAND)
    assert f"The best has {best:.2f}: any_city agent and genie." in lab.verdict.value


def test_the_session_keeps_scores_of_missions_flown_for_the_first_time(lab):
    flown = []
    for seed in (3, 4, 3):
        lab.seed.value = seed
        lab.again.click()
        key(lab, " ")
        key(lab, "Enter")
        flown.append(lab.flight.flights())
    assert len(lab.scores["you"]) == len(lab.scores["genie"]) == 2
    returns = [float(flights.returns[0]) for flights in flown[:2]]
    assert [score[1] for score in lab.scores["you"]] == returns
    collected = np.mean([flights.end.collected[0] for flights in flown[:2]])  # both landed
    row = f"<td>you</td><td>2</td><td>{collected:.0%}</td><td>{np.mean(returns):.2f}</td>"
    assert row in lab.session.value


def test_another_flight_is_played_next_to_yours(lab):
    assert lab.beside.layout.display == "none"
    fly_as(lab, "greedy")
    assert lab.beside.layout.display is None and YOU not in lab.beside.options
    lab.beside.value = "genie"
    assert lab.stage.begin == 0
    assert all(f">{name}<" in lab.stage.drawing for name in ("your flight", "genie"))
    lab.beside.value = "none"
    assert ">genie<" not in lab.stage.drawing
    lab.beside.value = "genie"
    lab.again.click()
    assert ">genie<" not in lab.stage.drawing and lab.beside.layout.display == "none"


def test_hard_missions_are_hard_for_greedy_and_come_in_turn(lab):
    environment, collected = environment_of("manhattan"), {"greedy": [], "genie": []}
    for seed in HARD:
        mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
        for name, shares in collected.items():
            flights = mission.fly(environment, find_policy(name, environment, mission.seed))
            shares.append(flights.records()["collected_and_landed"][0])
    assert max(collected["greedy"]) < 0.71 and min(collected["genie"]) > 0.99
    seen = []
    for _ in range(len(HARD) + 1):
        lab.hard.click()
        seen.append(lab.seed.value)
    assert seen == [*HARD, HARD[0]] and lab.environment.city.name == "manhattan"


def test_any_mission_can_be_flown_by_hand_and_shared(lab):
    there = MissionLab("manhattan")
    click(there, (8, 8))
    lab._linked = True
    lab.show(there.mission)
    lab.act(LAND)
    assert "the mission of the same file" in lab.verdict.value
    lab.again.click()  # the same mission
    assert set_by(lab.flight.mission) == set_by(there.mission)
    other, code = FlyLab("village"), link_of(lab).removeprefix("fly=")
    for _ in range(2):
        other.open_link(code)
        assert set_by(other.flight.mission) == set_by(there.mission)
        flight = other.flight
    assert other.flight is flight  # the second time, it was being flown
    painted = City.from_text("mine", environment_of("village").city.text.replace("#", "."))
    other.show(replace(FlyLab("village").flight.mission, city=painted))
    assert other.environment.city.fingerprint == painted.fingerprint
