"""The labs, driven through their controls as a person would, without a browser."""

import base64
import datetime
import html
import io
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from uavdh_lite import labs
from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.channel import rate
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, LAND
from uavdh_lite.evaluation import evaluate
from uavdh_lite.labs import (
    ChannelLab,
    CityLab,
    FlyLab,
    Labs,
    MissionLab,
    ThinkLab,
    TrainingLab,
)
from uavdh_lite.labs.channel import plain
from uavdh_lite.labs.city import told_average
from uavdh_lite.labs.draft import Draft, scenario_of
from uavdh_lite.labs.fly import HARD, KEYS, YOU
from uavdh_lite.labs.insight import value_map
from uavdh_lite.labs.links import decode, encode
from uavdh_lite.labs.think import BELOW, Thoughts
from uavdh_lite.missions import HandFlight, Mission, as_json, environment_of, read_mission
from uavdh_lite.policies import find_policy, policies_for
from uavdh_lite.scenario import find_scenario
from uavdh_lite.shadowing import line_of_sight


def read(picture):
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def pixels(widget):
    return read(widget.value)


def tell(widget, **told):
    """A message from the widget's part in the browser."""
    widget._handle_custom_msg(told, [])


def drag(lab, start, end):
    """The mouse pressed in a cell of a map and released in another."""
    tell(lab.stage, kind="drop", **{"from": list(start), "to": list(end)})


def click(lab, cell):
    drag(lab, cell, cell)


def point(canvas, ax, cell, kind="click", pressed=False):
    """The mouse over the middle of a cell that is drawn in an Axes."""
    x, y = ax.transData.transform((cell[1], cell[0]))
    tell(canvas.picture, kind=kind, x=x, y=canvas.figure.bbox.height - y, pressed=pressed)


def last(lab):
    """The last step of the flights that are shown."""
    return max(int(flights.steps[0]) for flights in lab.flights.values())


@pytest.fixture
def lab():
    return MissionLab("manhattan")


def test_labs_are_imported_when_they_are_asked_for():
    code = (
        "import sys, uavdh_lite.labs; "
        "print([name for name in sys.modules if 'ipy' in name or '.labs.' in name])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert set(labs.__all__) < set(dir(labs))
    for name in labs.__all__:
        assert getattr(labs, name).__name__ == name
    with pytest.raises(ImportError, match="cannot import name 'NoLab'"):
        from uavdh_lite.labs import NoLab  # noqa: F401


def test_menus_and_tables_say_who_is_an_agent(lab):
    assert ("manhattan agent", "manhattan") in lab.policy.options
    assert ("greedy", "greedy") in lab.other.options
    assert lab.charts.title.get_text() == "manhattan agent"
    assert ">manhattan agent</div>" in lab.stage.drawing


def test_the_first_picture(lab):
    assert lab.stage.drawing.count('class="flight"') == 1
    assert "<script>" not in lab.stage.drawing  # the stage plays it, the page runs nothing
    assert "manhattan agent" in lab.numbers.value
    assert lab.stage.step == last(lab) > 0 and lab.stage.begin == -1
    assert lab.stage.most == {"data": 20, "time": 70}
    alt = lab.charts.canvas.picture.alt
    assert "Charts of manhattan agent" in alt and "device 0 0.0 of 19.2" in alt


def test_clicks_add_move_and_remove_devices(lab):
    before = lab.mission.devices
    click(lab, (8, 8))
    assert lab.mission.devices == (*before, (8, 8))
    assert all(f">device {k}<" in lab.stage.drawing for k in range(len(lab.mission.data)))
    lab.click.value = "move"
    click(lab, (8, 8))
    assert "now click its new cell" in lab.message.value
    click(lab, (7, 1))
    assert lab.mission.devices == (*before, (7, 1))
    lab.click.value = "remove"
    click(lab, (7, 1))
    assert lab.mission.devices == before
    assert f">device {len(before)}<" not in lab.stage.drawing


def test_devices_and_the_start_are_dragged_whatever_a_click_does(lab):
    before, start = lab.mission.devices, lab.mission.start
    assert lab.click.value == "add"
    drag(lab, before[0], (8, 8))
    assert lab.mission.devices == ((8, 8), *before[1:])
    drag(lab, start, (0, 8))
    assert lab.mission.start == (0, 8)
    drag(lab, (7, 1), (7, 2))  # nothing there to drag
    assert lab.mission.devices == ((8, 8), *before[1:])
    drag(lab, (8, 8), (2, 2))  # onto a building
    assert "device 0 was not moved: there is a building at row 2, column 2" in lab.message.value
    assert lab.mission.devices == ((8, 8), *before[1:])
    drag(lab, (8, 8), (-3, 8))  # released outside of the map
    assert lab.mission.devices == ((8, 8), *before[1:])


def test_every_policy_and_the_return_are_explained(lab):
    words = lab.children[-1].value
    for policy, _ in lab.policy.options:
        assert f"<dt>{policy.split()[-1]}</dt>" in words
    assert "less 0.2 for each step" in words and "crash costs 150" in words


def test_a_click_sets_the_start(lab):
    lab.click.value = "start"
    click(lab, (8, 8))
    assert lab.mission.start == (8, 8)
    assert lab.flights["manhattan"].start.uav_cell[0] == 8 * 16 + 8


def test_what_cannot_be_is_said_and_changes_nothing(lab):
    mission, drawing = lab.mission, lab.stage.drawing
    click(lab, (2, 2))
    assert "not added: there is a building at row 2, column 2" in lab.message.value
    assert lab.mission is mission and lab.stage.drawing == drawing
    lab.click.value = "remove"
    click(lab, (15, 0))
    assert "no device here" in lab.message.value and lab.mission is mission
    lab.click.value = "add"
    click(lab, (8, 8))
    assert "device" not in lab.message.value and (8, 8) in lab.mission.devices


def test_bars_change_the_mission(lab):
    tell(lab.stage, kind="time", value=12)
    assert lab.mission.flying_time == 12
    assert lab.flights["manhattan"].start.time_left[0] == 12
    tell(lab.stage, kind="data", device=0, value=2.5)
    assert lab.mission.data[0] == 2.5
    lab.seed.value = 9
    assert lab.mission.seed == 9
    lab.draw.click()  # the next mission, with its own fading, as in the city editor
    assert lab.mission.seed == lab.seed.value == lab.number.value == 1
    assert f"of {lab.mission.flying_time}<" in lab.stage.drawing


def test_the_numbers_follow_the_step(lab):
    trajectory = lab.flights["manhattan"].trajectory(0)
    charts = lab.charts.canvas.picture
    seen = set()
    for step in (0, last(lab) // 2, last(lab)):
        lab.stage.step = step
        assert f"{trajectory.time_left[step]} of" in lab.numbers.value
        assert f"After step {step} " in charts.alt
        seen.add(charts.value)
    assert len(seen) == 3


def test_two_policies_meet_the_same_mission_and_fading(lab):
    lab.other.value = "manhattan"  # the same twice is one flight
    assert list(lab.flights) == ["manhattan"]
    lab.other.value = "greedy"
    assert list(lab.flights) == ["manhattan", "greedy"]
    assert lab.stage.drawing.count('class="flight"') == 2 and "greedy" in lab.numbers.value
    first, second = (f.start for f in lab.flights.values())
    assert first is second
    lab.third.value = "genie"
    assert list(lab.flights) == ["manhattan", "greedy", "genie"]
    assert lab.stage.drawing.count('class="flight"') == 3
    lab.other.value = "none"
    assert list(lab.flights) == ["manhattan", "genie"]


def test_a_sentence_says_which_flight_was_better(lab):
    assert lab.sentence.value == ""  # one flight: no comparison
    lab.policy.value = "greedy"
    told = {}
    for other in ("genie", "random", "manhattan"):
        lab.other.value = other
        told[other] = lab.sentence.value
        one, two = lab.flights.values()
        assert one.end.landed[0] and two.end.landed[0]
        more = one.end.data_collected.sum() - two.end.data_collected.sum()
        sooner = two.steps[0] - one.steps[0]
        if abs(more) >= 0.05:
            assert f"{abs(more):.1f} data units {'more' if more > 0 else 'fewer'}" in told[other]
        if sooner:
            assert f"landed {abs(sooner)} unit" in told[other]
            assert ("sooner" if sooner > 0 else "later") in told[other]
    assert len(set(told.values())) == 3
    lab.other.value = "random"
    tell(lab.stage, kind="time", value=37)
    for seed in range(30):
        lab.seed.value = seed
        if not lab.flights["random"].end.landed[0]:
            break
    winner, compared = lab.sentence.value.split("<br>")
    assert compared == "greedy landed, random crashed."
    returns = {name: f"{each.returns[0]:.2f}" for name, each in lab.flights.items()}
    told = f"Best return: greedy {returns['greedy']}; random {returns['random']}."
    assert winner == f"<b>{told}</b>"
    lab.policy.value, lab.third.value = "genie", "greedy"
    winner, *others = lab.sentence.value.split("<br>")
    best = max(lab.flights, key=lambda name: lab.flights[name].returns[0])
    assert winner.startswith(f"<b>Best return: {best} ")
    assert winner.endswith("</b> random crashed, greedy landed.")  # those who are compared with
    assert len(others) == 2 and all(other.startswith("genie ") for other in others)
    assert lab.numbers.value.count("(best)") == 1


def test_flights_that_are_equally_good_all_win(lab):
    lab.other.value = "greedy"
    (one, two), same = lab.flights, next(iter(lab.flights.values()))
    lab.flights = {one: same, two: same}
    assert "Both have the same return" in lab._sentences()
    assert lab._table().count("(best)") == 2


def test_one_guesses_before_the_flights_are_seen(lab):
    lab.other.value = "greedy"
    told = lab.sentence.value
    lab.guess.value = True
    for _ in range(2):
        assert lab.stage.step == 0 and lab.charting.layout.display == "none"
        assert "Guess first" in lab.sentence.value and "return" not in lab.sentence.value
        assert lab.numbers.value.count("<td>?</td>") == 6
        lab.stage.step = last(lab) - 1
        assert "Guess first" in lab.sentence.value
        lab.stage.step = last(lab)  # they have been played
        assert "return" in lab.sentence.value and lab.charting.layout.display is None
        assert "?" not in lab.numbers.value
        lab.stage.step = 3
        assert "return" in lab.sentence.value
        lab.draw.click()  # and one guesses again
    lab.guess.value = False
    lab.number.value = 0
    assert lab.sentence.value == told and lab.stage.step == last(lab)


def test_another_city_keeps_with_whom_one_compares(lab):
    lab.other.value, lab.third.value = "greedy", "manhattan_ddqn"
    lab.city.value = "village"
    chosen = [control.value for control in (lab.policy, lab.other, lab.third)]
    assert chosen == [lab.policy.options[0][1], "greedy", "none"]
    lab.third.value = lab.policy.options[1][1]
    lab.city.value = "manhattan"
    assert lab.policy.value == "manhattan" and lab.other.value == "greedy"


@pytest.mark.parametrize("wrong", [-3, 10**6 + 1])
def test_numbers_of_missions_and_of_fading_that_are_none_are_not_taken(lab, wrong):
    lab.number.value = 5
    mission = lab.mission
    for box, name in ((lab.number, "mission"), (lab.seed, "fading")):
        box.value = wrong
        assert f"no {name} no. {wrong}" in lab.message.value and "still no. 5" in lab.message.value
        assert box.value == 5 and lab.mission is mission
        lab.click.value = "move" if lab.click.value == "add" else "add"
        assert "no." not in lab.message.value


@pytest.mark.parametrize("city", ["village", "open_field", "harbour"])
def test_every_city_flies(lab, city):
    lab.city.value = city
    assert lab.mission.city.name == city
    assert lab.environment.city.name == city
    assert {("greedy", "greedy"), ("genie", "genie")} < set(lab.policy.options)
    assert len(lab.flights) == 1


def bars(lab):
    """Where the bars end; 0 for those without length."""
    drawn = [bar for _, bar in lab.charts.changing]
    return [round(bar.get_x() + bar.get_width(), 4) * (bar.get_width() != 0) for bar in drawn]


def test_thoughts_are_the_agents_at_each_step():
    lab = ThinkLab("manhattan")
    agent = lab.charts.agent
    assert lab.stage.step == 0
    for step in (0, 5, last(lab)):
        lab.stage.step = step
        state = lab.charts.states[min(step, len(lab.charts.states) - 1)]
        q = agent.q_values(state)[0] * agent.allowed(state)[0]  # no bars for what is not allowed
        assert bars(lab)[:6] == pytest.approx(q.tolist(), abs=1e-3)
        assert sum(bars(lab)[6:]) == pytest.approx(1, abs=1e-3)


def test_q_values_are_drawn_on_the_map_and_their_gap_is_told():
    lab = ThinkLab("manhattan")
    states, agent = lab.charts.states, lab.charts.agent
    assert len(lab.stage.q_values) == len(states)
    for step in (0, len(states) // 2, len(states) - 1):
        sizes, allowed = lab.stage.q_values[step], agent.allowed(states[step])[0].tolist()
        q = agent.q_values(states[step])[0]
        assert [size is not None for size in sizes] == allowed
        ranked = sorted(range(6), key=lambda action: float(q[action]) if allowed[action] else -1e9)
        assert sizes[ranked[-1]] == 1 and max(size or 0 for size in sizes) == 1
        lab.stage.step = step
        assert f"Next: {ACTIONS[ranked[-1]]}" in lab.sentence.value
        if step:
            (flown,) = next(iter(lab.flights.values())).history[step - 1].action
            assert f"Last step: {ACTIONS[flown]}. " in lab.sentence.value
        assert f"{ACTIONS[ranked[-1]]}" in lab.charts.canvas.picture.alt
        if sum(allowed) > 1:
            gap = float(q[ranked[-1]] - q[ranked[-2]])
            assert f"to {ACTIONS[ranked[-2]]} as the next best, is {gap:.2f}." in lab.sentence.value


def test_ranges_of_returns_are_drawn_for_agents_that_have_learned_them():
    lab = ThinkLab("manhattan")
    lab.stage.step = 4
    returns, (half, most) = lab.charts.returns, lab.charts.ranges
    assert returns.shape[1:] == (6, 32)
    assert returns.mean(2)[lab.charts.q.isfinite()].numpy() == pytest.approx(
        lab.charts.q[lab.charts.q.isfinite()].numpy(), abs=1e-3
    )
    (allowed,) = lab.charts.q[4].isfinite().nonzero(as_tuple=True)
    for lines, levels in ((half, (0.25, 0.75)), (most, (0.1, 0.9))):
        segments = np.array(lines.get_segments())
        np.testing.assert_allclose(segments[:, 0, 1], allowed.numpy() + BELOW, rtol=1e-6)
        expected = np.quantile(returns[4, allowed].numpy(), levels, axis=1).T
        assert segments[:, :, 0] == pytest.approx(expected, abs=1e-3)
    lab.policy.value = "manhattan_ddqn"
    assert lab.charts.returns is None and lab.charts.bars.get_title("left") == "Q-values"


def test_actions_that_the_failsafe_forbids_have_no_bars():
    agent = load_agent("manhattan")
    flights = evaluate(agent.environment, agent, agent.scenario, 1, seed=0)
    thoughts = Thoughts()
    thoughts.set_flight("safe", flights, agent, last=0)
    forbidden = 0
    for step in range(0, flights.steps[0], 5):
        thoughts.show(step)
        allowed = agent.environment.allowed_actions(thoughts.states[step])[0]
        widths = np.array([bar.get_width() for _, bar in thoughts.changing]).reshape(2, 6)
        assert not widths[:, ~allowed].any() and np.isfinite(widths).all()
        forbidden += (~allowed).sum()
    assert forbidden


def test_the_temperature_levels_the_policy_and_leaves_the_flight():
    lab = ThinkLab("manhattan")
    cold, flights, picture = bars(lab), lab.flights, lab.charts.canvas.picture.value
    lab.temperature.value = 10
    assert max(bars(lab)[6:]) < max(cold[6:]) and bars(lab)[:6] == cold[:6]
    assert lab.flights is flights and lab.charts.canvas.picture.value != picture


def test_policies_without_q_values_are_not_offered():
    lab = ThinkLab("manhattan")
    assert [name for _, name in lab.policy.options] == policies_for(lab.environment)[:-3]
    lab.policy.value = "manhattan_ddqn_early"
    lab.city.value = "village"
    assert [name for _, name in lab.policy.options] == ["any_city"] == list(lab.flights)
    lab.stage.step = last(lab)
    assert "Last step: land. The flight is over" in lab.sentence.value


def test_a_city_without_an_agent_says_so(tmp_path):
    CityGenerator(20).draw(1, seed=3)[0].save(tmp_path / "mine.png")
    lab = ThinkLab(str(tmp_path / "mine.png"))
    assert lab.charts.agent is None and list(lab.flights) == ["greedy"]
    assert "greedy has no Q-values" in lab.charts.bars.texts[0].get_text()
    assert lab.stage.q_values == [] and lab.sentence.value == ""
    lab.stage.step = 1
    lab.closest.click()
    assert lab.stage.step == 0
    lab.city.value = "village"
    assert lab.charts.agent is not None


def test_the_axis_of_q_values_fits_them_and_says_where_it_begins():
    lab = ThinkLab("manhattan")
    lab.closest.click()
    thoughts, q = lab.charts, lab.charts.q[lab.stage.step]
    low, high = thoughts.bars.get_xlim()
    best = q[q.isfinite()]
    assert low < best.min() and best.max() < high < 2 * best.max()
    assert low > 0 and thoughts.begins.get_text() == "does not begin at 0"
    less = [text.get_text() for text in thoughts.less]
    expected = [float(q.max() - each) for each in q.tolist()]
    assert less == [f"−{each:.2f}" if 0 < each < np.inf else "" for each in expected]
    for step in range(len(thoughts.states)):
        thoughts.show(step)
        low, high = thoughts.bars.get_xlim()
        assert low < thoughts.q[step].max() < high
        assert bool(thoughts.begins.get_text()) == (not low < 0 < high)


def test_saliency_has_the_citys_outline_and_both_maps_a_scale():
    lab = ThinkLab("village")
    lab.stage.step = 3
    thoughts, size = lab.charts, lab.environment.city.size
    row, col = divmod(int(thoughts.states[3].uav_cell[0]), size)
    middle = thoughts.agent.observation.width // 2
    buildings = lab.environment.city.buildings
    assert buildings[1:3, 4:6].all() and buildings.sum() == 8  # two of 2 × 2 cells
    lines = np.array(thoughts.outline.get_segments())
    assert len(lines) == 2 * 8
    corner = np.array((4 - 0.5 - col, 1 - 0.5 - row)) + middle
    assert (np.abs(lines - corner).sum(-1) < 1e-6).any()
    ends = [text.get_text().replace("−", "-") for text in thoughts.ends]
    worth = value_map(thoughts.agent, thoughts.states[3])
    assert ends[0] == "0.0" and float(ends[1]) > 0
    assert [float(end) for end in ends[2:]] == pytest.approx(
        [np.nanmin(worth), np.nanmax(worth)], abs=0.051
    )


def test_flying_by_hand_with_buttons_and_keys():
    lab = FlyLab("village", seed=3)
    before = lab.stage.drawing
    start = lab.flight.state.uav_cell[0]
    lab.buttons[ACTIONS.index("south")].click()
    assert lab.flight.state.uav_cell[0] == start + 8
    tell(lab.stage, kind="key", key="ArrowUp")
    assert lab.flight.state.uav_cell[0] == start
    tell(lab.stage, kind="key", key="q")  # no such key: nothing happens
    assert len(lab.flight.flights().history) == 2
    assert lab.stage.drawing != before and lab.score.value == ""
    assert lab.stage.begin == 1 and lab.stage.steering[:-1] == list(KEYS)  # the last step plays
    tell(lab.stage, kind="key", key="Enter")
    assert lab.flight.ended and "landed" in lab.message.value
    assert all(name in lab.score.value for name in ("you", "greedy", "genie", "random"))
    shown = lab.stage.drawing
    lab.buttons[0].click()  # over is over
    assert lab.stage.drawing == shown
    lab.again.click()
    assert not lab.flight.ended and lab.score.value == ""


def test_hard_missions_are_hard_for_greedy_and_come_in_turn():
    environment, collected = environment_of("manhattan"), {"greedy": [], "genie": []}
    for seed in HARD:
        mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
        for name, shares in collected.items():
            flights = mission.fly(environment, find_policy(name, environment, mission.seed))
            shares.append(flights.records()["collected_and_landed"][0])
    assert max(collected["greedy"]) < 0.71 and min(collected["genie"]) > 0.99
    lab = FlyLab("village")
    seen = []
    for _ in range(len(HARD) + 1):
        lab.hard.click()
        seen.append(lab.seed.value)
    assert seen == [*HARD, HARD[0]] and lab.environment.city.name == "manhattan"
    assert "nearest device first" in lab.message.value and "The city is" not in lab.message.value
    lab.city.value = "village"
    lab.hard.click()
    assert "The city is now manhattan." in lab.message.value


def test_the_session_keeps_scores_of_missions_flown_for_the_first_time():
    lab = FlyLab("village", seed=3)
    flown = []
    for seed in (3, 4, 3):
        lab.seed.value = seed
        lab.again.click()
        tell(lab.stage, kind="key", key=" ")
        tell(lab.stage, kind="key", key="Enter")
        flown.append(lab.flight.flights())
    assert len(lab.scores["you"]) == len(lab.scores["genie"]) == 2
    returns = [float(flights.returns[0]) for flights in flown[:2]]
    assert [score[1] for score in lab.scores["you"]] == returns
    ratio = np.mean([flights.end.collected[0] for flights in flown[:2]])  # both landed
    row = f"<td>you</td><td>2</td><td>{ratio:.0%}</td><td>{np.mean(returns):.2f}</td>"
    assert row in lab.session.value
    ranks = [lab.session.value.index(f"<td>{name}</td>") for name in ("genie", "you")]
    assert ranks == sorted(ranks)


def test_the_safety_controller_speaks():
    lab = FlyLab("village", seed=3)
    for _ in range(9):
        lab.buttons[ACTIONS.index("north")].click()
    assert "north is refused, for the map ends there" in lab.message.value
    assert "a unit of time and 1 of the return" in lab.message.value
    lab.seed.value = 4
    assert "refused" not in lab.message.value


@pytest.mark.parametrize(
    ("start", "action", "reason"),
    [
        ((3, 0), "east", "a no-fly zone is there"),
        ((1, 3), "east", "a tall building is there"),
        ((4, 0), "land", "this is no landing zone"),
        ((5, 7), "east", "the map ends there"),
    ],
)
def test_a_refusal_says_what_is_in_the_way(start, action, reason):
    lab = FlyLab("village")
    mission = replace(lab.flight.mission, start=start)
    lab.flight = HandFlight(lab.environment, mission)
    lab.act(ACTIONS.index(action))
    assert f"Step 1: {action} is refused, for {reason}" in lab.message.value


def fly_as(lab, name):
    """Fly as a policy does, by hand."""
    policy = find_policy(name, lab.environment, lab.flight.mission.seed)
    flown = lab.flight.mission.fly(lab.environment, policy)
    for action in flown.trajectory(0).action:
        lab.act(int(action))
    return float(flown.returns[0])


def test_your_flight_gets_a_verdict():
    lab = FlyLab("village")
    yours = fly_as(lab, "greedy")
    best = max(float(each.returns[0]) for each in lab._results.values())
    behind = f"{best - yours:.1f} behind any_city agent and genie."  # both have as much
    assert f"Your return is {yours:.2f}, {behind}" in lab.verdict.value
    assert "The tab Mission" in lab.verdict.value and "mission 0 of village" in lab.verdict.value
    lab.again.click()
    fly_as(lab, "genie")
    assert f"is {best:.2f}: nobody has more; any_city agent and genie as much." in lab.verdict.value
    lab.again.click()
    lab.act(LAND)
    assert "behind greedy. The best has 10.80: any_city agent and genie." in lab.verdict.value


def test_the_ranking_is_sorted_and_yours_stands_out():
    lab = FlyLab("village")
    fly_as(lab, "greedy")
    for shown, caption in ((lab.score.value, "this mission"), (lab.session.value, "this session")):
        names = re.findall("<tr[^>]*><td>([^<]+)</td>", shown)
        assert names == ["any_city agent", "genie", "greedy", "you", "random"]
        assert f"<caption>{caption}" in shown and shown.count('class="uavdh-you"') == 1


def test_another_flight_is_played_next_to_yours():
    lab = FlyLab("village")
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


def test_each_step_says_what_it_brought():
    lab = FlyLab("village")
    before = lab.flight.state.data_left[0]
    lab.act(ACTIONS.index("south"))
    (uploaded,) = (before - lab.flight.state.data_left[0])[before > 0]
    assert 0 < uploaded < 0.1
    said = f"Step 1: flies south; device 0 uploads {uploaded:.1g} units."
    assert f"{lab.flight.state.time_left[0]} units of time left. {said}" in lab.message.value
    lab.act(ACTIONS.index("hover"))
    assert "Step 2: hovers; " in lab.message.value


def test_a_step_is_taken_back_and_the_fading_stays():
    lab = FlyLab("village")
    actions = [ACTIONS.index(name) for name in ("south", "hover", "hover")]
    assert lab.undo.disabled
    for action in actions:
        lab.act(action)
    left = lab.flight.state.data_left
    tell(lab.stage, kind="key", key="z")
    lab.undo.click()
    assert lab.flight.state.time_left[0] == lab.flight.mission.flying_time - 1
    for action in actions[1:]:
        lab.act(action)
    assert (lab.flight.state.data_left == left).all()
    tell(lab.stage, kind="key", key="Enter")  # refused: this is no landing zone
    tell(lab.stage, kind="key", key="z")
    lab.act(ACTIONS.index("north"))
    lab.act(LAND)
    assert lab.flight.ended and lab.scores == {} and lab.session.value == ""
    assert "You took a key back" in lab.verdict.value
    lab.take_back()  # the landing itself
    assert not lab.flight.ended and lab.score.value == "" and lab.stage.refused == []
    for _ in range(9):
        lab.take_back()
    assert lab.undo.disabled and "no step to take back" in lab.message.value


def test_any_mission_can_be_flown_by_hand(tmp_path):
    lab, there = FlyLab("village", linked=True), MissionLab("manhattan")
    pick(there, 8, 8)
    data = json.dumps(as_json(there.mission)).encode()
    lab.act(ACTIONS.index("south"))
    flight = lab.flight
    for broken, reason in {
        b"no": "not a JSON file",
        b"\xff": "not a JSON file",
        b" " * 1_000_001: "no mission is that large",
    }.items():
        upload_to(lab, broken, "<i>.json")
        assert reason in lab.message.value and "&lt;i&gt;.json: " in lab.message.value
        assert "Your flight is as it was" in lab.message.value and lab.flight is flight
    for broken in ("x", encode(b"{}"), encode(b"\xff")):
        lab.open_link(broken)
        assert "the link holds no mission" in lab.message.value and lab.flight is flight
    upload_to(lab, data)
    assert set_by(lab.flight.mission) == set_by(there.mission)
    assert lab.city.value == "manhattan" and "changed" in lab.changed.value
    lab.act(LAND)
    assert "the mission of the same file" in lab.verdict.value
    lab.again.click()  # the same mission
    assert set_by(lab.flight.mission) == set_by(there.mission)
    code = re.search('href="#fly=([^"]+)"', lab.take_home.value)[1]
    other = FlyLab("village")
    other.open_link(code)
    assert set_by(other.flight.mission) == set_by(there.mission)
    assert other.take_home.value == ""
    flight = other.flight
    other.open_link(code)  # it is being flown
    assert other.flight is flight
    other.tell_link(True)
    assert "Link copied" in other.message.value
    painted = City.from_text("mine", environment_of("village").city.text.replace("#", "."))
    other.show(replace(FlyLab("village").flight.mission, city=painted))
    assert other.environment.city.fingerprint == painted.fingerprint


def test_each_lab_explains_its_words():
    for made, some in (
        (ThinkLab, ("Q-value", "action gap", "temperature", "saliency", "genie")),
        (FlyLab, ("return", "refused", "genie")),
        (ChannelLab, ("SNR", "slot", "LoS, NLoS")),
        (CityLab, ("tall building", "shadow", "mirror", "greedy", "100 missions")),
        (TrainingLab, ("collected", "updates", "environment steps", "failsafe", "recipe")),
    ):
        said = made().children[-1].value
        assert all(f"<dt>{word}</dt>" in said for word in some), made


def test_a_crash_is_called_one():
    lab = FlyLab("village", seed=3)
    while not lab.flight.ended:
        lab.buttons[ACTIONS.index("hover")].click()
    assert "crashed" in lab.message.value and "<td>crashed</td>" in lab.score.value


def test_the_channel_lab_follows_clicks_and_sliders():
    lab = ChannelLab("manhattan")

    def click_map(cell):
        point(lab.canvas, lab.map, cell, "down", pressed=True)

    click_map((4, 7))
    lab.click.value = "UAV"
    click_map((4, 4))
    assert (lab.device, lab.uav) == ((4, 7), (4, 4))
    assert "line of sight" in lab.numbers.value and "0.65 data units" in lab.numbers.value
    assert "device in cell (4, 7), UAV over (4, 4)" in lab.canvas.picture.alt
    numbers = [text.get_text().strip() for text in lab._draw_scale(lab.rates.get_clim()[1])]
    assert numbers == ["0", "1.57", "3.14"]
    assert lab.bar.images[0].get_cmap().name == lab.rates.get_cmap().name
    assert lab.bar.images[0].get_array()[0] == 1  # the largest is at the top
    while lab.bar.texts:
        lab.bar.texts[0].remove()
    for sentence in re.findall("<div>(.*?)</div>", lab.numbers.value):
        assert sentence in lab.canvas.picture.alt
    picture = lab.canvas.picture.value
    click_map((7, 4))
    assert "no line of sight" in lab.numbers.value
    assert lab.canvas.picture.value != picture
    blocked = lab.numbers.value
    lab.constants["path_loss_exponent_nlos"].value = 5
    assert lab.numbers.value != blocked
    lab.constants["fading_nlos_db"].value = 3
    assert "± 3.0 dB" in lab.numbers.value
    assert len(lab.map.lines) == len(lab.curve.lines) == len(lab.bar.texts) == 0  # nothing piles up
    lab.city.value = "village"
    assert lab.uav == (0, 0)


def stroke(lab, cell, kind="down", pressed=True):
    point(lab.canvas, lab.ax, cell, kind, pressed)


def test_painting_a_city_says_at_once_what_it_lacks():
    lab = CityLab("village")
    lab.size.value = 6
    lab.blank.click()
    assert lab.draft.size == 6
    assert lab.canvas.picture.alt == "A city of 6×6 cells: 36 free."
    assert (
        "no start and landing zone" in lab.message.value
        and lab.fly.disabled
        and lab.following.disabled
    )
    lab.brush.value = "landing zone"
    picture = lab.canvas.picture.value
    stroke(lab, (0, 0))
    assert "landing" not in lab.message.value and not (lab.fly.disabled or lab.following.disabled)
    assert lab.canvas.picture.value != picture
    lab.brush.value = "tall building"
    stroke(lab, (3, 3))
    stroke(lab, (3, 4), kind="move")  # drawn over, button down
    stroke(lab, (5, 5), kind="move", pressed=False)
    assert np.argwhere(lab.draft.buildings).tolist() == [[3, 3], [3, 4]]


def test_rectangles_fills_and_mirrors_are_painted_and_each_stroke_is_undone_at_once():
    lab = CityLab("open_field")
    start = lab.draft.kinds.copy()
    assert lab.undo.disabled and lab.redo.disabled
    lab.tool.value = "rectangle"
    stroke(lab, (12, 2))
    stroke(lab, (14, 6), kind="move")
    stroke(lab, (13, 4), kind="move")  # back again: it shrinks
    assert np.argwhere(lab.draft.kinds != start).tolist() == [
        [12, 2], [12, 3], [12, 4], [13, 2], [13, 3], [13, 4],
    ]  # fmt: skip
    lab.brush.value, lab.tool.value = "low building", "fill"
    stroke(lab, (13, 3))
    stroke(lab, (0, 15), kind="move")  # a fill is where it began
    low = lab.draft.buildings & ~lab.draft.no_fly
    before = Draft(start)
    assert (low & ~(before.buildings & ~before.no_fly)).sum() == 6
    lab.undo.click()
    assert lab.draft.buildings[13, 3] and lab.draft.no_fly[13, 3]  # tall again
    tell(lab.canvas.picture, kind="key", key="z")
    assert (lab.draft.kinds == start).all() and lab.undo.disabled
    lab.redo.click()
    tell(lab.canvas.picture, kind="key", key="y")
    assert not lab.draft.no_fly[13, 3] and lab.redo.disabled
    lab.tool.value, lab.brush.value, lab.mirror.value = "brush", "no-fly zone", "both"
    stroke(lab, (15, 5))
    assert lab.draft.no_fly[[15, 15, 0, 0], [5, 10, 5, 10]].all()


def test_a_rectangle_can_be_picked_by_numbers():
    lab = CityLab("village")
    lab.size.value = 5
    lab.blank.click()
    lab.tool.value = "rectangle"
    pick(lab, 1, 1)
    assert "opposite corner" in lab.message.value and not lab.draft.buildings.any()
    pick(lab, 2, 3)
    assert lab.draft.buildings.sum() == 6 and lab.draft.buildings[1:3, 1:4].all()
    pick(lab, 4, 4)
    lab.tool.value = "brush"  # the corner is forgotten
    assert "opposite corner" not in lab.message.value
    pick(lab, 4, 0)
    assert lab.draft.buildings.sum() == 7
    lab.undo.click()
    lab.undo.click()
    lab.undo.click()  # before the blank city
    assert (lab.draft.kinds == City.load("village").kinds).all()
    assert lab.picker.row.max == 7


def test_random_cities_are_all_different_and_too_small_ones_are_refused():
    lab = CityLab("village")
    lab.size.value = 10
    drawn = []
    for _ in range(2):
        lab.random.click()
        drawn.append(lab.draft.kinds)
        assert lab.draft.size == 10 and not lab.fly.disabled
    assert (drawn[0] != drawn[1]).any()
    lab.size.value = 5
    lab.random.click()
    assert "at least 8 cells" in lab.message.value and lab.draft.size == 10


def test_the_mouse_shows_the_shadow_of_a_device_under_it():
    lab = CityLab("village")
    plain = lab.canvas.picture.value
    sight = environment_of("village").sight[0]
    stroke(lab, (2, 3), kind="move", pressed=False)
    shown = lab.canvas.picture.value
    draft = lab.draft
    seen = sight[2 * 8 + 3].reshape(8, 8)[~draft.buildings].mean()
    assert f"sees {seen:.0%}" in lab.seen.value and shown != plain
    assert (draft.kinds == City.load("village").kinds).all()  # looking paints nothing
    building = tuple(np.argwhere(draft.buildings)[0])
    stroke(lab, building, kind="move", pressed=False)
    assert lab.seen.value == "" and (pixels(lab.canvas.picture) == read(plain)).all()
    stroke(lab, (2, 3), kind="move", pressed=False)
    assert lab.canvas.picture.value == shown and len(lab.ax.images) == len(lab.ax.lines) == 0
    stroke(lab, (4, 4))  # painting: the shadow is that of the new city
    stroke(lab, (2, 3), kind="move", pressed=False)
    after = line_of_sight(lab.draft.buildings)[2, 3][~lab.draft.buildings].mean()
    assert f"sees {after:.0%}" in lab.seen.value


def test_the_agent_and_planners_fly_in_a_painted_city_and_it_can_be_taken_home():
    lab = CityLab("village")
    stroke(lab, (7, 6))  # a city that nobody has seen
    assert lab.policy.value == "any_city"
    for policy in ("any_city", "genie", "greedy"):
        lab.policy.value = policy
        lab.fly.click()
        flights = 1 if policy == "greedy" else 2  # the policy, and greedy
        assert lab.stage in lab.side.children and lab.stage.begin == 0
        assert lab.stage.drawing.count('class="flight"') == flights
        assert lab.result.value.count("landed after") == flights
    assert "train --from any_city --city my_city.png" in lab.take_home.value
    coded = lab.take_home.value.split("base64,")[1].split('"')[0]
    assert (Draft.from_png(base64.b64decode(coded)).kinds == lab.draft.kinds).all()
    stroke(lab, (7, 7))
    assert lab.stage not in lab.side.children  # the flight was in another city


def test_they_fly_the_same_mission_again_after_each_stroke():
    lab = CityLab("village")
    lab.at_once.value = True
    first, told = lab._mission, lab.result.value
    assert lab.stage in lab.side.children and told.count("landed after") == 2
    wall = [(5, 0), (5, 1), (5, 2)]  # the shortest way to the device
    for k, cell in enumerate(wall):
        stroke(lab, cell, kind="move" if k else "down")
    assert lab.result.value == told  # while the mouse is down, nobody waits for a flight
    stroke(lab, wall[-1], kind="up")
    assert lab._mission.devices == first.devices and lab._mission.seed == first.seed
    assert lab._mission.city.kinds.tolist() == lab.draft.kinds.tolist()
    assert lab.result.value != told
    lab.undo.click()
    assert lab.result.value == told
    stroke(lab, first.devices[0])  # a building where a device is: another mission
    stroke(lab, first.devices[0], kind="up")
    assert first.devices[0] not in lab._mission.devices and "landed" in lab.result.value
    lab.blank.click()
    assert lab.stage not in lab.side.children and lab.result.value == ""
    lab.at_once.value = False
    lab.base.value = "village"
    assert lab.stage not in lab.side.children


def test_over_a_large_city_only_planners_fly():
    lab = CityLab("village")
    assert lab.policy.value == "any_city"
    lab.base.value = "harbour"
    assert lab.policy.value == "harbour"  # its own agent
    stroke(lab, (31, 31))
    assert [name for _, name in lab.policy.options] == ["greedy", "genie", "random"]
    assert "train --city my_city.png --devices 1 3" in lab.take_home.value
    lab.base.value = "open_field"
    assert lab.policy.value == "greedy"  # what was chosen stays chosen
    assert lab.policy.options[0] == ("open_field agent", "open_field")


def test_the_mission_lab_takes_a_city_of_ones_own(tmp_path):
    city = CityGenerator(12).draw(1, seed=3)[0]
    city.save(tmp_path / "mine.png")
    lab = MissionLab(str(tmp_path / "mine.png"))
    assert lab.policy.value == "any_city" and lab.flights["any_city"].end.landed[0]
    assert lab.environment.city.fingerprint == city.fingerprint


def upload_to(lab, data, name="x.png"):
    """A file that was chosen in the browser's dialog."""
    lab.upload.value = [
        {
            "name": name,
            "type": "",
            "size": len(data),
            "content": memoryview(data),
            "last_modified": datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC),
        }
    ]


def test_uploads_are_taken_or_refused_with_a_reason():
    lab = CityLab("village")

    def upload(data):
        upload_to(lab, data)

    upload(Draft(City.load("open_field").kinds).png())
    assert lab.draft.size == 16 and "<b" not in lab.message.value
    upload(b"nonsense <script>")
    assert "not a readable PNG" in lab.message.value and "<script>" not in lab.message.value
    assert "x.png" in lab.message.value and lab.upload.value == ()
    assert "mend the file, and open it again" in lab.message.value
    upload(Draft.blank(60).png())  # no city, and larger than the editor
    assert lab.draft.size == 16
    large = Draft.blank(60)
    large.paint((0, 0), "landing zone")
    upload(large.png())
    assert "60 cells on a side: at most 50 fit this editor" in lab.message.value
    assert lab.draft.size == 16


def test_a_link_opens_its_city_on_the_labs_page():
    labs = Labs()
    assert list(labs.made) == ["Mission"]
    painted = CityLab("open_field", linked=True)
    stroke(painted, (7, 6))
    code = re.search('href="#(city=[^"]*)"', painted.take_home.value)[1]
    assert len(code) < 500
    labs.address.value = code
    lab = labs.made["City"]
    assert labs.titles[labs.selected_index] == "City" and lab._linked
    assert (lab.draft.kinds == painted.draft.kinds).all() and lab.base.value == "my city"
    labs.address.value = "elsewhere"
    lab.open_link(code.removeprefix("city="))  # the lab's own link
    assert "in the address bar" in lab.message.value
    assert (lab.draft.kinds == painted.draft.kinds).all()
    for broken, told in {
        "city=" + code[5:41]: "the link: not a readable PNG",
        code[:42]: "part of it is missing",
        code[:40]: "the link: not a readable PNG",
        "city=%3Cscript": "the link holds no city",
        "city=é": "the link holds no city",
        "city=": "the link: not a readable PNG",
    }.items():
        labs.address.value = broken
        assert told in lab.message.value and "Copy it again" in lab.message.value, broken
        assert (lab.draft.kinds == painted.draft.kinds).all()
    stroke(lab, (7, 6))
    lab.blank.click()
    assert "#city" not in lab.take_home.value  # no landing zone yet
    assert "#city" not in CityLab().take_home.value  # in a notebook, nothing reads the address


@pytest.mark.parametrize("title", ["Mission", "Watch it think", "Fly it yourself"])
def test_a_painted_city_is_flown_in_the_other_labs(title):
    page = Labs()
    open_tab(page, title)
    lab = page.made[title]
    before = lab.environment
    lab.city.value = "my city"
    assert "no city of yours yet. Paint one in the tab City" in lab.message.value
    assert lab.city.value == "manhattan" and lab.environment is before
    open_tab(page, "City")
    city = page.made["City"]
    stroke(city, (7, 6))
    open_tab(page, title)
    lab.city.value = "my city"
    assert lab.environment.city.fingerprint == city.draft.city().fingerprint
    mission = lab.flight.mission if title == "Fly it yourself" else lab.mission
    city.fly.click()
    assert set_by(mission) == set_by(city._mission)  # equal numbers, equal missions
    shown = lab.stage.drawing
    open_tab(page, "City")
    stroke(city, (7, 7))
    open_tab(page, title)  # it is taken up as it is now
    assert lab.environment.city.fingerprint == city.draft.city().fingerprint
    assert lab.stage.drawing != shown
    last = lab.environment
    open_tab(page, "City")
    city.blank.click()
    open_tab(page, title)
    assert "your city is not finished" in lab.message.value
    assert "at least one cell blue" in lab.message.value
    assert lab.environment is last and lab.city.value == "my city"
    lab.city.value = "village"
    lab.city.value = "my city"
    assert "your city is not finished" in lab.message.value and lab.city.value == "village"
    assert lab.environment.city.name == "village"


def test_radio_links_are_traced_in_a_painted_city():
    page = Labs()
    open_tab(page, "Channel")
    lab = page.made["Channel"]
    lab.city.value = "my city"
    assert "no city of yours yet" in lab.message.value and lab.city.value == "manhattan"
    open_tab(page, "City")
    stroke(page.made["City"], (7, 6))
    open_tab(page, "Channel")
    lab.city.value = "my city"
    assert lab.environment.city.buildings[7, 6] and lab.message.value == ""
    assert "Rates over my_city" in lab.canvas.picture.alt


def open_tab(page, title):
    page.selected_index = page.titles.index(title)


def test_a_painted_city_keeps_the_mission_that_was_set_in_it_if_it_can():
    page = Labs()
    open_tab(page, "City")
    open_tab(page, "Mission")
    lab, city = page.made["Mission"], page.made["City"]
    lab.city.value = "my city"
    lab.other.value = "genie"
    click(lab, (7, 0))
    kept = set_by(lab.mission)
    stroke(city, (7, 7))
    open_tab(page, "City")
    open_tab(page, "Mission")
    assert set_by(lab.mission) == kept and lab.other.value == "genie"
    assert lab.mission.city.buildings[7, 7] and lab.undo.disabled
    stroke(city, (7, 0))  # on the device
    open_tab(page, "City")
    open_tab(page, "Mission")
    assert (7, 0) not in lab.mission.devices and "genie" in lab.flights
    assert "my city" not in MissionLab().city.options  # in a notebook, there is no city editor


def test_changes_of_a_mission_are_undone_and_numbers_are_typed(lab):
    drawn = Mission.draw(find_scenario("manhattan"), lab.environment.city, 0)
    assert lab.undo.disabled and lab.redo.disabled and lab.number.value == 0
    click(lab, (8, 8))
    tell(lab.stage, kind="time", value=25)
    lab.undo.click()
    assert (8, 8) in lab.mission.devices and lab.mission.flying_time == drawn.flying_time
    tell(lab.stage, kind="undo", by=-1)
    assert set_by(lab.mission) == set_by(drawn) and lab.undo.disabled
    tell(lab.stage, kind="undo", by=-1)  # there is nothing before
    lab.redo.click()
    tell(lab.stage, kind="undo", by=1)
    assert lab.mission.flying_time == 25 and lab.redo.disabled
    assert lab.flights["manhattan"].start.time_left[0] == 25
    lab.number.value = 5
    fifth = Mission.draw(find_scenario("manhattan"), lab.environment.city, 5)
    assert set_by(lab.mission) == set_by(fifth) and lab.seed.value == fifth.seed
    lab.draw.click()
    assert lab.number.value == 6
    lab.undo.click()
    lab.undo.click()
    assert lab.number.value == 0 and lab.mission.flying_time == 25
    click(lab, (2, 2))  # refused: nothing to undo, and what was undone can still be redone
    lab.redo.click()
    assert lab.number.value == 5
    lab.city.value = "village"
    assert lab.undo.disabled and lab.redo.disabled and lab.number.value == 0


def test_errors_say_how_to_put_them_right(lab):
    def told(change):
        change()
        return lab.message.value

    first, second = lab.mission.devices[:2]
    row, col = second
    said = f"device 0 was not moved: there is device 1 at row {row}, column {col}"
    assert said in told(lambda: drag(lab, first, second))
    said = "row 16, column 0 is outside of the map, where rows and columns go from 0 to 15"
    assert f"device 0 was not moved: {said}" in told(lambda: drag(lab, first, (16, 0)))
    assert f"not added: {said}" in told(lambda: click(lab, (16, 0)))
    assert "not added: there is a landing zone at" in told(lambda: click(lab, (0, 0)))
    assert "the start was not moved: there is a tall building at row 2, column 2" in told(
        lambda: drag(lab, lab.mission.start, (2, 2))
    )
    for cell in ((8, 8), (7, 7), (7, 8)):
        said = told(lambda cell=cell: click(lab, cell))
    assert "not added: this scenario has 1 to 5 devices, and 5 are on the map" in said
    lab.click.value = "remove"
    for cell in lab.mission.devices:
        said = told(lambda cell=cell: click(lab, cell))
    assert "not removed: this scenario has 1 to 5 devices, and only one is on the map" in said
    assert "click on one" in told(lambda: click(lab, (15, 0)))


def test_a_link_opens_its_mission_on_the_labs_page():
    there = MissionLab("village", linked=True)
    click(there, (7, 0))
    code = re.search('href="#(mission=[^"]*)"', there.take_home.value)[1]
    page = Labs()
    lab = page.made["Mission"]
    click(lab, (8, 8))
    page.address.value = code
    assert lab.city.value == "village" and set_by(lab.mission) == set_by(there.mission)
    assert (7, 0) in lab.mission.devices and lab.undo.disabled
    lab.open_link(code.removeprefix("mission="))  # the lab's own link
    assert "in the address bar" in lab.message.value
    saved = lab.take_home.value.split("base64,")[1].split('"')[0]
    same = read_mission(base64.b64decode(saved).decode())
    assert set_by(same) == set_by(lab.mission)
    for broken in (code[:40], "mission=%3Cscript", "mission=é", "mission=", code[:-8]):
        page.address.value = broken
        assert "the link holds no mission" in lab.message.value, broken
        assert "Copy it again" in lab.message.value
        assert set_by(lab.mission) == set_by(there.mission)
    for side in (10, 11):  # links to missions in cities that nobody has
        (city,) = CityGenerator(side).draw(1, seed=3)
        own = Mission.draw(scenario_of(city), city, 4)
        text = json.dumps(as_json(own)).encode()
        page.address.value = f"mission={base64.b64encode(text).decode()}"
        assert lab.city.value == "the link's city" and set_by(lab.mission) == set_by(own)
        assert lab.environment.city.fingerprint == city.fingerprint
    lab.draw.click()
    assert lab.mission.city.size == 11
    assert 'href="#' not in MissionLab().take_home.value  # in a notebook, nothing reads the address


def test_charts_show_whichever_policy_is_asked_for(lab):
    assert lab.charted.layout.display == "none"  # one flight: nothing to choose
    lab.other.value, lab.third.value = "greedy", "random"
    assert lab.charted.layout.display is None
    assert [name for _, name in lab.charted.options] == ["manhattan", "greedy", "random"]
    first = lab.charts.canvas.picture.value
    lab.stage.step = 3
    for name in ("greedy", "random"):
        lab.charted.value = name
        left = lab.flights[name].trajectory(0).data_left
        assert (lab.charts.left == left).all() and lab.charts.canvas.picture.value != first
        assert f"Charts of {name}" in lab.charts.canvas.picture.alt
        assert "After step 3" in lab.charts.canvas.picture.alt
    click(lab, (8, 8))
    assert lab.charted.value == "random"  # it stays chosen
    lab.third.value = "none"
    assert lab.charted.value == "manhattan" and "manhattan" in lab.charts.canvas.picture.alt


def test_painted_cities_and_running_trainings_are_work_that_can_be_lost():
    page = Labs()
    for title in ("City", "Training"):
        open_tab(page, title)
    city, training = page.made["City"], page.made["Training"]
    assert page.address.painted == "" and not page.address.training
    stroke(city, (7, 6))
    assert (Draft.from_png(decode(page.address.painted)).kinds == city.draft.kinds).all()
    city.undo.click()
    assert page.address.painted == ""  # as it came
    city.redo.click()
    assert page.address.painted == city._code
    city.size.value = 8
    city.random.click()
    assert page.address.painted == ""
    training.running = True
    assert page.address.training


def pick(lab, row, column):
    """A click by numbers instead of the mouse."""
    lab.picker.row.value, lab.picker.column.value = row, column
    lab.picker.button.click()


def set_by(mission):
    """What a mission consists of, but for its city."""
    return mission.start, mission.devices, mission.data, mission.flying_time, mission.seed


def test_missions_in_a_painted_city_are_set_by_hand_and_have_numbers():
    lab = CityLab("village")
    lab.fly.click()
    drawn = lab._mission
    device, free = drawn.devices[0], (7, 0)
    drag(lab, device, free)
    assert lab._mission.devices[0] == free and "landed" in lab.result.value
    drag(lab, drawn.start, (0, 0))
    assert lab._mission.start == (0, 0)
    click(lab, (7, 7))
    assert (7, 7) in lab._mission.devices
    click(lab, (7, 7))
    assert (7, 7) not in lab._mission.devices
    tell(lab.stage, kind="data", device=0, value=3.5)
    tell(lab.stage, kind="time", value=20)
    assert lab._mission.data[0] == 3.5 and lab._mission.flying_time == 20
    before = lab._mission
    building = tuple(np.argwhere(lab.draft.buildings)[0].tolist())
    drag(lab, free, building)
    assert "stands on a building" in lab.message.value and lab._mission == before
    lab.fly.click()  # the number that is shown
    assert lab.number.value == 0 and set_by(lab._mission) == set_by(drawn)
    lab.following.click()
    assert lab.number.value == 1 and lab._mission != before
    lab.number.value = 0
    assert set_by(lab._mission) == set_by(drawn)
    lab.blank.click()  # no landing zone: nothing to fly in
    lab.number.value = 2
    assert "no start and landing zone" in lab.message.value


def test_many_missions_say_more_than_one_and_find_where_greedy_fails():
    lab = CityLab("open_field")
    lab.policy.value = "any_city"
    lab.many.click()
    assert "Over 100 missions" in lab.result.value and "behind in" in lab.result.value
    assert all(line.endswith(".") for line in lab.result.value.split("<br>"))
    city = lab.draft.city()
    drawn = Mission.draw(scenario_of(city), city, lab.number.value)
    assert set_by(lab._mission) == set_by(drawn)
    stroke(lab, (7, 7))
    assert lab.result.value == ""


def test_averages_are_told_in_plain_sentences():
    greedy = np.array([1.0, 1.0, 0.4, 0.9])
    told = told_average("any_city", {"any_city": np.array([1.0, 1, 1, 0.8]), "greedy": greedy})
    assert told == (
        "Over 4 missions, collected and landed: any_city agent 95%, greedy 82%. Greedy fails in 1: "
        "it brings home less than half. The any_city agent is ahead of greedy in 1, behind in 1. "
        "Furthest behind: greedy in mission 2, the any_city agent in mission 3."
    )
    scores = {"any_city": np.array([0.0, 1.0, 0.5, 1.0]), "greedy": greedy}
    told = told_average("any_city", scores)
    assert "ahead of greedy in 2, behind in 1. It is behind on average, as" in told
    assert "it is behind by more than it is ahead." in told
    assert "Furthest" not in told_average("greedy", {"greedy": greedy})
    assert "Furthest" not in told_average("genie", {"genie": greedy, "greedy": greedy})


def test_three_policies_fly_in_the_city_and_are_averaged():
    lab = CityLab("village")
    lab.fly.click()
    assert lab.stage.drawing.count('class="flight"') == 2
    mission = lab._mission
    lab.third.value = "genie"
    assert lab.stage.drawing.count('class="flight"') == 3 and lab._mission == mission
    assert "genie: landed" in lab.result.value
    lab.many.click()
    assert re.search(r"any_city agent \d+%, greedy \d+%, genie \d+%\.", lab.result.value)
    stroke(lab, (7, 7))
    assert lab.third.value == "genie" and lab.stage not in lab.side.children


def test_flights_come_back_with_the_city_that_they_were_in():
    lab = CityLab("village")
    assert lab.base.options[0] == "my city"
    lab.fly.click()
    told = lab.result.value
    stroke(lab, (7, 7))
    assert lab.stage not in lab.side.children and lab.base.value == "my city"
    lab.undo.click()
    assert lab.stage in lab.side.children and lab.result.value == told
    lab.redo.click()
    assert lab.stage not in lab.side.children
    lab.fly.click()
    lab.undo.click()
    lab.redo.click()
    assert lab.stage in lab.side.children and lab.draft.buildings[7, 7]
    painted = lab.draft.kinds.copy()
    lab.base.value = "open_field"
    lab.base.value = "my city"
    assert (lab.draft.kinds == painted).all() and lab.unsaved
    lab.blank.click()
    assert lab.at_once.disabled and lab.fly.disabled
    lab.base.value = "village"
    assert not lab.at_once.disabled


def test_the_channel_goes_back_to_the_paper_and_shows_small_rates():
    lab = ChannelLab("village")
    paper = lab.channel
    lab.constants["altitude_m"].value = 60
    assert lab.channel != paper
    lab.paper.click()
    assert lab.channel == paper
    lab.logarithmic.value = True
    low, high = lab.curve.get_ylim()
    assert lab.curve.get_yscale() == "log" and 0 < low < 1e-3 < high
    said = [text.get_text().strip() for text in lab._draw_scale(lab.rates.get_clim()[1])]
    assert said[:-1] == ["0.00001", "0.0001", "0.001", "0.01", "0.1"]
    dark, bright = (lab.rates.cmap(lab.rates.norm(each)) for each in (0.0005, 0.05))
    assert np.abs(np.subtract(dark, bright)).max() > 0.3  # a cell in a shadow is not like the rest
    lab.logarithmic.value = False
    assert lab.curve.get_ylim()[0] == 0


def test_a_drag_takes_what_is_under_the_mouse_and_the_boxes_follow():
    lab = ChannelLab("village")

    def move(start, *cells):
        point(lab.canvas, lab.map, start, "down", pressed=True)
        for cell in cells:
            point(lab.canvas, lab.map, cell, "move", pressed=True)

    device, uav = lab.device, lab.uav
    assert (lab.click.value, lab.picker.row.value) == ("device", device[0])
    move(uav, (3, 0), (5, 0))
    assert (lab.device, lab.uav) == (device, (5, 0))
    move(device, (7, 7), (7, 9.5), (6, 7))  # beyond the map and back
    assert (lab.device, lab.uav) == ((6, 7), (5, 0))
    move((0, 3), (0, 4))  # begins at neither: what is chosen
    assert (lab.device, lab.uav) == ((0, 4), (5, 0))
    lab.click.value = "UAV"
    assert (lab.picker.row.value, lab.picker.column.value) == (5, 0)
    move((0, 5), (5, 0), (1, 0))
    assert lab.uav == (1, 0) and (lab.picker.row.value, lab.picker.column.value) == (1, 0)
    move((0, 4), (1, 0))
    assert lab.device == lab.uav == (1, 0)
    move((1, 0), (2, 0))  # both: what is chosen
    assert (lab.device, lab.uav) == ((1, 0), (2, 0))


def test_the_channel_says_how_far_a_device_is_heard_and_what_the_mouse_points_at():
    lab = ChannelLab("manhattan")
    size = lab.environment.city.size
    for sight in (True, False):
        squared = lab.reach(sight) ** 2 + lab.channel.altitude_m**2
        assert rate(lab.channel.mean_snr_db(squared, sight, size)) == pytest.approx(0.1, rel=1e-3)
        assert f"{lab.reach(sight):.0f} m" in lab.numbers.value
    lab.constants["altitude_m"].value = 100
    assert "nowhere behind a building" in lab.numbers.value
    lab.paper.click()
    lab.click.value = "UAV"
    lab.clicked((8, 4))
    told = re.search(r"([\d.]+) data units a slot", lab.numbers.value)[1]
    point(lab.canvas, lab.map, (8, 4), "move")
    assert f"row 8, column 4: {told} data units a slot" in lab.seen.value
    lab.look_at(lab.curve, 3.0, 3.0)
    assert lab.seen.value == ""
    shown = lab.rates.get_array()
    city = lab.environment.city
    assert (shown.mask == (city.buildings & city.no_fly)).all()  # the radio passes no-fly zones


def test_small_rates_are_written_plainly():
    for value, said in {3.1415: "3.14", 0.652: "0.65", 0.000451: "0.0005", 1e-9: "0"}.items():
        assert plain(value) == said
    assert plain(1e-5) == "0.00001" and plain(0.0) == "0"


def test_the_closest_call_has_the_smallest_gap_while_there_is_data():
    lab = ThinkLab("manhattan")
    lab.closest.click()
    q = lab.charts.q.topk(2, dim=1).values
    gaps, states = (q[:, 0] - q[:, 1]).tolist(), lab.charts.states
    with_data = [step for step in range(len(gaps)) if states[step].data_left.sum() > 0]
    assert with_data != list(range(len(gaps)))
    assert lab.stage.step == min(with_data, key=lambda step: gaps[step])


def test_what_is_not_allowed_is_said(lab):
    think = ThinkLab("manhattan")
    for step in (0, 5):
        think.stage.step = step
        texts = [text.get_text() for text in think.charts.numbers[: len(ACTIONS)]]
        allowed = think.charts.q[step].isfinite().tolist()
        assert [text != "not allowed" for text in texts] == allowed


def test_cells_can_be_picked_by_numbers(lab):
    before = lab.mission.devices
    pick(lab, 8, 8)
    assert lab.mission.devices == (*before, (8, 8))
    channel = ChannelLab("village")
    assert "In a mission" not in channel.numbers.value
    pick(channel, 1, 4)
    assert "devices do not stand on buildings" in channel.numbers.value
    pick(channel, 2, 5)
    assert channel.device == (2, 5)
    pick(channel, 50, 5)  # outside: the last row
    assert channel.device == (7, 5)
    city = CityLab("village")
    pick(city, 7, 7)
    assert city.draft.buildings[7, 7]


def test_the_page_makes_each_lab_when_it_is_opened():
    labs = Labs()
    assert list(labs.made) == ["Mission"]
    for index, title in enumerate(labs.titles):
        labs.selected_index = index
        assert labs.children[index].children[-1] is labs.made[title]
    mission = labs.made["Mission"]
    labs.selected_index = 0
    assert labs.made["Mission"] is mission


def test_a_quick_stroke_leaves_no_gaps():
    """A browser reports only some of the places that a fast mouse passes."""
    lab = CityLab("open_field")
    stroke(lab, (15, 1))
    stroke(lab, (15, 14), kind="move")
    assert lab.draft.buildings[15, 1:15].all() and not lab.draft.buildings[15, [0, 15]].any()
    before = lab.draft.kinds.copy()
    stroke(lab, (12, 5))  # pressed again: no line from the last cell
    assert np.argwhere(lab.draft.kinds != before).tolist() == [[12, 5]]


def test_a_city_can_be_chosen_again_and_a_flight_is_told(lab):
    city = CityLab("village")
    stroke(city, (7, 7))
    assert city.base.value == "my city" and city.draft.buildings[7, 7]
    city.base.value = "village"
    assert not city.draft.buildings[7, 7]
    city.fly.click()
    assert "landed after" in city.result.value and "data units collected" in city.result.value


def test_random_takes_off_with_the_default_seed(lab):
    """Its first action is not the fading's first number."""
    lab.policy.value = "random"
    assert lab.flights["random"].steps[0] > 1


def test_the_channel_axes_follow_the_rates():
    lab = ChannelLab("manhattan")
    low = lab.curve.get_ylim()[1]
    lab.constants["cell_edge_snr_db"].value = 10
    high = lab.curve.get_ylim()[1]
    assert high > 2 * low
    lab.constants["cell_edge_snr_db"].value = -15
    assert lab.curve.get_ylim()[1] < high


def test_a_click_outside_the_city_moves_nothing():
    lab = ChannelLab("village")
    before = lab.device, lab.uav
    for cell in ((-1, 3), (3, 8)):
        lab.clicked(cell)
    assert (lab.device, lab.uav) == before


DARK = {"paper": "#212121", "ink": "#ffffff"}


@pytest.mark.parametrize("made", [MissionLab, ThinkLab, ChannelLab, CityLab, TrainingLab])
def test_figures_have_the_colours_of_the_page_and_maps_keep_theirs(made):
    lab = made()
    canvas = {
        MissionLab: lambda: lab.charts.canvas,
        ThinkLab: lambda: lab.charts.canvas,
        TrainingLab: lambda: lab.curves,
    }.get(made, lambda: lab.canvas)()
    light = pixels(canvas.picture)
    assert (light[0, 0] == 255).all() and (light == 0).all(axis=2).any()
    canvas.picture.page = DARK
    dark = pixels(canvas.picture)
    assert (dark[0, 0] == 33).all() and (dark == 255).all(axis=2).any()
    assert dark.shape == light.shape
    if made is CityLab:  # the paper of the map
        x, y = lab.ax.transData.transform((7, 0)).round().astype(int)
        row = int(canvas.figure.bbox.height) - y
        assert (light[row, x] == 255).all() and (dark[row, x] == 255).all()
    canvas.picture.page = {"paper": "no colour", "ink": "#000000"}
    assert (pixels(canvas.picture) == dark).all()
    canvas.picture.page = {"paper": "#ffffff", "ink": "#000000"}
    assert (pixels(canvas.picture) == light).all()


def test_a_legend_and_a_run_are_drawn_again_in_dark_colours(lab):
    canvas = lab.charts.canvas
    canvas.picture.page = DARK
    lab.stage.step = 3  # what is drawn later has the colours, too
    assert all(cursor.get_color() == "#ffffff" for cursor in lab.charts.cursors)
    assert lab.charts.axes[-1].get_legend().get_frame().get_facecolor()[:3] == (33 / 255,) * 3


def test_the_uav_is_marked_in_all_that_the_network_sees():
    lab = ThinkLab("manhattan")
    middle = lab.charts.agent.observation.width // 2
    for step in (0, 6):
        lab.stage.step = step
        places = [(mark.get_xdata()[0], mark.get_ydata()[0]) for mark in lab.charts.marks]
        assert places[:-1] == [(middle, middle)] * 6
        row, col = divmod(int(lab.charts.states[step].uav_cell[0]), 16)
        assert places[-1] == (col, row)


def test_what_is_cut_off_the_bars_is_marked_and_numbers_lie_beside_them():
    lab = ThinkLab("manhattan")
    lab.stage.step = 2
    thoughts = lab.charts
    allowed = thoughts.q[2].isfinite()
    assert allowed.sum() > 3  # the best three are in sight
    row = int(thoughts.q[2].where(allowed, torch.inf).argmin())
    thoughts.q = thoughts.q.clone()
    thoughts.q[2, row] = -50
    thoughts.show(2)
    (edge, *others), places = thoughts.cut.get_xdata(), thoughts.cut.get_ydata()
    assert edge == thoughts.bars.get_xlim()[0] > 0 and set(others) <= {edge}
    assert any(abs(place - row) < 0.2 for place in places)
    allowed = thoughts.q[2].isfinite().tolist()
    places = [text.get_position()[0] for text in thoughts.numbers[:6]]  # in widths of the axes
    assert all(place > 1 for place, may in zip(places, allowed, strict=True) if may)


def test_a_click_next_to_a_map_counts_for_the_nearest_cell_and_one_further_off_for_none():
    channel, city = ChannelLab("village"), CityLab("village")
    before = channel.device
    point(channel.canvas, channel.map, (3, 8.4), "down", pressed=True)  # the map ends at 7.5
    assert channel.device == before
    point(channel.canvas, channel.map, (3, 7.9), "down", pressed=True)
    assert channel.device == (3, 7) and channel.message.value == ""
    point(channel.canvas, channel.map, (-0.9, 4), "down", pressed=True)
    assert channel.device == (0, 4)
    stroke(city, (7.5, 6))  # exactly at the edge
    stroke(city, (8.5, 3))
    assert city.draft.buildings[7, 6] and not city.draft.buildings[7, 3]


def test_a_changed_mission_is_not_called_by_its_number_alone(lab):
    lab.number.value = 7
    assert lab.changed.value == ""
    first = lab.mission.devices[0]
    free = (8, 8)
    assert free not in lab.mission.devices
    for change in (
        lambda: drag(lab, first, free),
        lambda: tell(lab.stage, kind="time", value=lab.mission.flying_time + 1),
        lambda: tell(lab.stage, kind="data", device=0, value=1.5),
        lambda: click(lab, (0, 8)),
    ):
        change()
        assert "changed" in lab.changed.value and "number 7" in lab.changed.value
        lab.undo.click()
        assert lab.changed.value == ""
    lab.redo.click()
    assert "changed" in lab.changed.value
    click_away = lab.mission.devices[-1]
    lab.click.value = "remove"
    click(lab, click_away)  # as it was, although by hand
    assert lab.changed.value == ""
    lab.seed.value = 3  # the fading has a box of its own
    assert lab.changed.value == ""
    drag(lab, first, free)
    lab.draw.click()
    assert lab.number.value == 8 and lab.changed.value == ""


def test_a_changed_mission_is_marked_in_the_city_editor_too():
    lab = CityLab("village")
    lab.fly.click()
    assert lab.changed.value == ""
    device = lab._mission.devices[0]
    drag(lab, device, (7, 0))
    assert "changed" in lab.changed.value
    drag(lab, (7, 0), device)
    assert lab.changed.value == ""
    drag(lab, device, (7, 0))
    stroke(lab, (7, 7))  # the flights are gone
    assert lab.changed.value == ""


def test_a_link_that_is_clicked_is_copied_and_that_is_said():
    page = Labs()
    mission = page.made["Mission"]
    value = f"mission={mission._code()}"
    tell(page.address, value=value, copied=True)
    assert "Link copied" in mission.message.value
    page.address.value = value  # the address follows the link
    assert "Link copied" in mission.message.value
    tell(page.address, value=value, copied=False)
    assert mission.message.value.count("The link is in the address bar") == 1
    tell(page.address, value="city=x", copied=True)  # that lab is not open
    open_tab(page, "City")
    tell(page.address, value="city=x", copied=True)
    assert "Link copied" in page.made["City"].message.value


def test_links_are_url_safe_and_old_ones_open_too():
    for data in (b"", b"a", b"ab", bytes(range(256))):
        code = encode(data)
        assert re.fullmatch("[A-Za-z0-9_-]*", code) and decode(code) == data
        assert decode(base64.b64encode(data).decode()) == data
    page = Labs()
    painted = CityLab("open_field")
    stroke(painted, (7, 6))
    page.address.value = f"city={base64.b64encode(painted.draft.png()).decode()}"
    city = page.made["City"]
    assert (city.draft.kinds == painted.draft.kinds).all()


def test_a_citys_link_has_the_mission_that_is_flown_in_it():
    there = CityLab("village", linked=True)

    def code():
        return html.unescape(re.search('href="#(city=[^"]*)"', there.take_home.value)[1])

    stroke(there, (7, 6))
    assert "mission" not in code()
    there.number.value = 4
    drag(there, there._mission.devices[0], (7, 0))
    flown, link = there._mission, code()
    assert re.fullmatch("[A-Za-z0-9_=&-]*", link)
    page = Labs()
    page.address.value = link
    lab = page.made["City"]
    assert (lab.draft.kinds == there.draft.kinds).all()
    assert set_by(lab._mission) == set_by(flown) and lab.stage in lab.side.children
    assert lab.number.value == 4 and "changed" in lab.changed.value
    assert lab._address() == link.removeprefix("city=")
    for broken in (link[:-7], link.split("&")[0] + "&mission=", link + "&mission=x"):
        page.address.value = "elsewhere"
        page.address.value = broken
        assert "the city of the link is here, its mission is not" in lab.message.value, broken
        assert (lab.draft.kinds == there.draft.kinds).all()
    start = encode(b'{"start": [1, 4]}')
    page.address.value = f"{link.split('&')[0]}&mission={start}"
    assert "its mission is not" in lab.message.value
    stroke(there, (7, 7))  # the flights are gone
    assert "mission" not in code()


def test_missions_are_saved_to_a_file_and_opened_from_one():
    there = MissionLab("village")
    click(there, (7, 0))
    data = base64.b64decode(there.take_home.value.split("base64,")[1].split('"')[0])
    lab = MissionLab("manhattan")
    upload_to(lab, data, "mine.json")
    assert lab.city.value == "village" and set_by(lab.mission) == set_by(there.mission)
    assert lab.upload.value == () and lab.message.value.endswith("></span>")
    for broken, reason in {
        b"<b>nonsense": "not a JSON file",
        b"\xff\xfe": "not a JSON file",
        b"{}": "is a required property",
        data.replace(b"7, 0", b"7, 1"): "changed since it was saved",
        b" " * 1_000_001: "no mission is that large",
    }.items():
        upload_to(lab, broken, "<i>.json")
        assert reason in lab.message.value and "&lt;i&gt;.json: " in lab.message.value
        assert "Your mission is as it was" in lab.message.value
        assert set_by(lab.mission) == set_by(there.mission)


def test_a_refused_move_is_shown_at_the_uav():
    lab = FlyLab("village")
    mission = replace(lab.flight.mission, start=(1, 3))
    lab.flight = HandFlight(lab.environment, mission)
    lab.act(ACTIONS.index("east"))
    assert lab.stage.refused == [0, 1]
    lab.act(ACTIONS.index("land"))
    assert lab.stage.refused == [0, 0]
    lab.act(ACTIONS.index("hover"))
    assert lab.stage.refused == []


def test_the_stage_answers_whatever_comes_of_a_message(lab):
    before = lab.stage.answered
    drag(lab, lab.mission.devices[0], (2, 2))  # refused
    tell(lab.stage, kind="time", value=30)
    assert lab.stage.answered == before + 2 and lab.stage.size == 16
