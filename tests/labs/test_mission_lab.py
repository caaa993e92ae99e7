"""The mission lab: missions are set on the map, flown, compared, saved and shared."""

import pytest
from driving import click, drag, file_of, last, pick, set_by, tell, upload

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.labs import FlyLab, MissionLab
from uavdh_lite.labs.draft import scenario_of
from uavdh_lite.labs.links import encode, mission_file
from uavdh_lite.missions import Mission, read_mission
from uavdh_lite.scenario import find_scenario


@pytest.fixture
def lab():
    return MissionLab("manhattan")


def draw(lab, number):
    return Mission.draw(find_scenario("manhattan"), lab.environment.city, number)


def test_the_first_picture_and_those_of_other_steps(lab):
    assert lab.stage.drawing.count('class="flight"') == 1
    assert "<script>" not in lab.stage.drawing  # the stage plays it, the page runs nothing
    assert ("manhattan agent", "manhattan") in lab.policy.options
    assert ("greedy", "greedy") in lab.other.options
    assert ">manhattan agent</div>" in lab.stage.drawing and "manhattan agent" in lab.numbers.value
    assert lab.stage.step == last(lab) > 0 and lab.stage.begin == -1
    assert lab.stage.most == {"data": 20, "time": 70}
    alt = lab.charts.canvas.picture.alt
    assert "Charts of manhattan agent" in alt and "device 0 0.0 of 19.2" in alt
    trajectory = lab.flights["manhattan"].trajectory(0)
    for step in (0, last(lab) // 2):
        lab.stage.step = step
        assert f"{trajectory.time_left[step]} of" in lab.numbers.value
        assert f"After step {step} " in lab.charts.canvas.picture.alt


def test_clicks_and_picked_cells_add_move_and_remove_devices(lab):
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
    lab.click.value = "start"
    pick(lab, 8, 8)
    assert lab.mission.start == (8, 8)
    assert lab.flights["manhattan"].start.uav_cell[0] == 8 * 16 + 8


def test_devices_and_the_start_are_dragged_whatever_a_click_does(lab):
    before = lab.mission.devices
    assert lab.click.value == "add"
    drag(lab, before[0], (8, 8))
    drag(lab, lab.mission.start, (0, 8))
    assert (lab.mission.devices, lab.mission.start) == (((8, 8), *before[1:]), (0, 8))
    drag(lab, (7, 1), (7, 2))  # nothing there to drag
    assert lab.mission.devices == ((8, 8), *before[1:])


def test_what_cannot_be_is_said_and_changes_nothing(lab):
    devices, start = lab.mission.devices, lab.mission.start
    mission, drawing, answered = lab.mission, lab.stage.drawing, lab.stage.answered
    refused = {
        (devices[0], devices[1]): ("device 0 was not moved", "device 1"),
        (devices[0], (2, 2)): ("device 0 was not moved", "building at row 2, column 2"),
        (devices[0], (-3, 8)): ("device 0 was not moved", "outside of the map"),
        (start, (2, 2)): ("the start was not moved", "tall building at row 2, column 2"),
        ((2, 2), (2, 2)): ("not added", "building at row 2, column 2"),
        ((16, 0), (16, 0)): ("not added", "row 16, column 0 is outside of the map"),
        ((0, 0), (0, 0)): ("not added", "landing zone"),
    }
    for cells, said in refused.items():
        drag(lab, *cells)
        assert all(each in lab.message.value for each in said), cells
    assert lab.mission is mission and lab.stage.drawing == drawing and lab.undo.disabled
    assert lab.stage.answered == answered + len(refused)  # the stage waits for an answer
    for cell in ((8, 8), (7, 7), (7, 8)):
        click(lab, cell)
    assert "1 to 5 devices" in lab.message.value and len(lab.mission.devices) == 5
    lab.click.value = "remove"
    assert "not added" not in lab.message.value
    click(lab, (15, 0))
    assert "no device here" in lab.message.value and len(lab.mission.devices) == 5
    for cell in lab.mission.devices:
        click(lab, cell)
    assert "not removed" in lab.message.value and len(lab.mission.devices) == 1


def test_bars_change_the_mission(lab):
    tell(lab.stage, kind="time", value=12)
    assert lab.mission.flying_time == lab.flights["manhattan"].start.time_left[0] == 12
    tell(lab.stage, kind="data", device=0, value=2.5)
    assert lab.mission.data[0] == 2.5
    lab.seed.value = 9
    assert lab.mission.seed == 9
    lab.draw.click()  # the next mission, with its own fading
    assert lab.mission.seed == lab.seed.value == lab.number.value == 1
    assert f"of {lab.mission.flying_time}<" in lab.stage.drawing


@pytest.mark.parametrize("wrong", [-3, 10**6 + 1])
def test_numbers_of_missions_and_of_fading_that_are_none_are_not_taken(lab, wrong):
    lab.number.value = 5
    mission = lab.mission
    for box, name in ((lab.number, "mission"), (lab.seed, "fading")):
        box.value = wrong
        assert f"no {name} no. {wrong}" in lab.message.value
        assert box.value == 5 and lab.mission is mission


def test_changes_are_undone_and_redone(lab):
    assert lab.undo.disabled and lab.redo.disabled
    click(lab, (8, 8))
    tell(lab.stage, kind="time", value=25)
    lab.undo.click()
    assert (8, 8) in lab.mission.devices and lab.mission.flying_time != 25
    for _ in range(2):  # the second time, there is nothing before
        tell(lab.stage, kind="undo", by=-1)
        assert set_by(lab.mission) == set_by(draw(lab, 0)) and lab.undo.disabled
    lab.redo.click()
    tell(lab.stage, kind="undo", by=1)
    assert lab.mission.flying_time == 25 and lab.redo.disabled
    assert lab.flights["manhattan"].start.time_left[0] == 25
    lab.number.value = 5
    assert set_by(lab.mission) == set_by(draw(lab, 5)) and lab.seed.value == draw(lab, 5).seed
    lab.undo.click()
    assert lab.number.value == 0 and lab.mission.flying_time == 25
    click(lab, (2, 2))  # refused: what was undone can still be redone
    lab.redo.click()
    assert lab.number.value == 5
    lab.city.value = "village"
    assert lab.undo.disabled and lab.redo.disabled and lab.number.value == 0


def test_a_changed_mission_is_not_called_by_its_number_alone(lab):
    lab.number.value = 7
    assert lab.changed.value == ""
    first, free = lab.mission.devices[0], (8, 8)
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
    drag(lab, first, free)
    drag(lab, free, first)  # as it was, although by hand
    assert lab.changed.value == ""
    lab.seed.value = 3  # the fading has a box of its own
    assert lab.changed.value == ""


def test_policies_meet_the_same_mission_and_fading_and_any_of_them_has_charts(lab):
    lab.other.value = "manhattan"  # the same twice is one flight
    assert list(lab.flights) == ["manhattan"] and lab.charted.layout.display == "none"
    lab.other.value, lab.third.value = "greedy", "random"
    assert list(lab.flights) == ["manhattan", "greedy", "random"]
    assert lab.stage.drawing.count('class="flight"') == 3 and "greedy" in lab.numbers.value
    assert len({id(flights.start) for flights in lab.flights.values()}) == 1
    assert lab.flights["random"].steps[0] > 1  # its first action is not the fading's first number
    lab.stage.step, first = 3, lab.charts.canvas.picture.value
    for name in ("greedy", "random"):
        lab.charted.value = name
        left = lab.flights[name].trajectory(0).data_left
        assert (lab.charts.left == left).all() and lab.charts.canvas.picture.value != first
        assert f"Charts of {name}" in lab.charts.canvas.picture.alt
    click(lab, (8, 8))
    assert lab.charted.value == "random"  # it stays chosen
    lab.third.value = "none"
    assert lab.charted.value == "manhattan" and "manhattan" in lab.charts.canvas.picture.alt


def test_a_sentence_says_which_flight_was_better(lab):
    assert lab.sentence.value == ""  # one flight: no comparison
    lab.policy.value = "greedy"
    for other in ("genie", "manhattan"):
        lab.other.value = other
        one, two = lab.flights.values()
        assert one.end.landed[0] and two.end.landed[0]
        more = one.end.data_collected.sum() - two.end.data_collected.sum()
        sooner = two.steps[0] - one.steps[0]
        if abs(more) >= 0.05:
            said = f"{abs(more):.1f} data units {'more' if more > 0 else 'fewer'}"
            assert said in lab.sentence.value
        if sooner:
            assert f"landed {abs(sooner)} unit" in lab.sentence.value
            assert ("sooner" if sooner > 0 else "later") in lab.sentence.value
    best = max(lab.flights, key=lambda name: lab.flights[name].returns[0])
    assert lab.sentence.value.startswith(f"<b>Best return: {best} ")
    assert lab.numbers.value.count("(best)") == 1


def test_a_crash_and_equal_flights_are_called_so(lab):
    lab.policy.value, lab.other.value = "greedy", "random"
    tell(lab.stage, kind="time", value=37)
    while lab.flights["random"].end.landed[0]:
        lab.seed.value += 1
    assert lab.sentence.value.endswith("greedy landed, random crashed.")
    lab.flights = dict.fromkeys(lab.flights, lab.flights["greedy"])
    assert "Both have the same return" in lab._sentences()
    assert lab._table().count("(best)") == 2


def test_one_guesses_before_the_flights_are_seen(lab):
    lab.other.value = "greedy"
    told = lab.sentence.value
    lab.guess.value = True
    for _ in range(2):
        assert lab.stage.step == 0 and lab.charting.layout.display == "none"
        assert lab.numbers.value.count("<td>?</td>") == 6
        lab.stage.step = last(lab) - 1
        assert "return" not in lab.sentence.value
        lab.stage.step = last(lab)  # they have been played
        assert "return" in lab.sentence.value and lab.charting.layout.display is None
        assert "?" not in lab.numbers.value
        lab.stage.step = 3
        assert "return" in lab.sentence.value
        lab.draw.click()  # and one guesses again
    lab.guess.value = False
    lab.number.value = 0
    assert lab.sentence.value == told and lab.stage.step == last(lab)


@pytest.mark.parametrize("city", ["village", "open_field", "harbour"])
def test_every_city_flies_and_keeps_with_whom_one_compares(lab, city):
    lab.other.value, lab.third.value = "greedy", "manhattan_ddqn"
    lab.city.value = city
    assert lab.environment.city.name == lab.mission.city.name == city
    assert {("greedy", "greedy"), ("genie", "genie")} < set(lab.policy.options)
    chosen = [control.value for control in (lab.policy, lab.other, lab.third)]
    assert chosen == [lab.policy.options[0][1], "greedy", "none"]
    assert list(lab.flights) == chosen[:2]


def test_a_city_of_ones_own_is_taken_as_it_is_now(tmp_path):
    path, opened = tmp_path / "mine.png", []
    for seed in (3, 4):  # its file was painted anew
        (city,) = CityGenerator(12).draw(1, seed)
        city.save(path)
        lab = MissionLab(str(path))
        assert lab.policy.value == "any_city" and lab.flights["any_city"].end.landed[0]
        assert lab.environment.city.fingerprint == city.fingerprint
        opened.append(city.fingerprint)
    assert opened[0] != opened[1]


def mission_of(lab):
    return lab.mission if isinstance(lab, MissionLab) else lab.flight.mission


@pytest.mark.parametrize("made", [MissionLab, FlyLab])
def test_missions_are_saved_opened_and_refused_with_a_reason(made):
    there = MissionLab("village", linked=True)
    click(there, (7, 0))
    data = file_of(there)
    assert set_by(read_mission(data.decode())) == set_by(there.mission)
    lab = made("manhattan", linked=True)
    upload(lab, data, "mine.json")
    assert lab.city.value == "village" and set_by(mission_of(lab)) == set_by(there.mission)
    assert lab.upload.value == () and "changed" in lab.changed.value
    kept = mission_of(lab)
    for broken, reason in {
        b"<b>nonsense": "not a JSON file",
        b"\xff\xfe": "not a JSON file",
        b"{}": "is a required property",
        data.replace(b'"seed": 0', b'"seed": 0.0'): "seed",
        data.replace(b'"seed": 0', b'"seed": 9223372036854775808'): "seed",
        b" " * 1_000_001: "no mission is that large",
    }.items():
        upload(lab, broken)
        assert reason in lab.message.value and "&lt;i&gt;.x: " in lab.message.value, broken[:20]
        assert mission_of(lab) is kept
    for broken in ("", "x", "%3Cscript", "é", encode(data)[:40], encode(data)[:-8], encode(b"{}")):
        lab.open_link(broken)
        assert "the link holds no mission" in lab.message.value, broken
        assert mission_of(lab) is kept
    for side in (10, 11):  # links to missions in cities that nobody has
        (city,) = CityGenerator(side).draw(1, seed=3)
        own = Mission.draw(scenario_of(city), city, 4)
        lab.open_link(encode(mission_file(own)))
        assert lab.city.value == "the link's city" and set_by(mission_of(lab)) == set_by(own)
        assert lab.environment.city.fingerprint == city.fingerprint
