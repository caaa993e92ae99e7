"""The city editor: cities are painted, flown in, saved and shared."""

import re

import numpy as np
import pytest
from driving import click, drag, file_of, link_of, pick, pixels, set_by, stroke, tell, upload

from uavdh_lite.city import City
from uavdh_lite.labs import CityLab, Labs
from uavdh_lite.labs.city import told_average
from uavdh_lite.labs.draft import Draft, scenario_of
from uavdh_lite.labs.links import encode
from uavdh_lite.missions import Mission
from uavdh_lite.shadowing import line_of_sight


@pytest.fixture
def lab():
    return CityLab("village")


def flights(lab):
    """How many flights are shown."""
    return lab.stage.drawing.count('class="flight"') if lab.stage in lab.side.children else 0


def test_painting_a_city_says_at_once_what_it_lacks(lab):
    lab.size.value = 6
    lab.blank.click()
    assert lab.draft.size == 6 and lab.canvas.picture.alt == "A city of 6×6 cells: 36 free."
    assert "no start and landing zone" in lab.message.value
    lab.number.value = 2
    assert "no start and landing zone" in lab.message.value and flights(lab) == 0
    flying = lab.fly, lab.following, lab.at_once
    assert all(button.disabled for button in flying)
    lab.brush.value = "landing zone"
    picture = lab.canvas.picture.value
    stroke(lab, (0, 0))
    assert "landing" not in lab.message.value and lab.canvas.picture.value != picture
    assert not any(button.disabled for button in flying)
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
    changed = np.argwhere(lab.draft.kinds != start).tolist()
    assert changed == [[row, col] for row in (12, 13) for col in (2, 3, 4)]
    lab.brush.value, lab.tool.value = "low building", "fill"
    stroke(lab, (13, 3))
    stroke(lab, (0, 15), kind="move")  # a fill is where it began
    assert np.argwhere(lab.draft.kinds != start).tolist() == changed
    assert not lab.draft.no_fly[12:14, 2:5].any()
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


def test_a_rectangle_is_picked_by_numbers(lab):
    before = lab.draft.kinds.copy()
    lab.size.value = 5
    lab.blank.click()
    lab.tool.value = "rectangle"
    pick(lab, 1, 1)
    assert "opposite corner" in lab.message.value and not lab.draft.buildings.any()
    pick(lab, 2, 3)
    assert lab.draft.buildings.sum() == 6 and lab.draft.buildings[1:3, 1:4].all()
    for _ in range(2):
        lab.undo.click()  # to before the blank city
    assert (lab.draft.kinds == before).all() and lab.picker.row.max == 7


def test_a_quick_stroke_leaves_no_gaps_and_one_at_the_edge_counts():
    """A browser reports only some of the places that a fast mouse passes."""
    lab = CityLab("open_field")
    stroke(lab, (15, 1))
    stroke(lab, (15, 14), kind="move")
    assert lab.draft.buildings[15, 1:15].all() and not lab.draft.buildings[15, [0, 15]].any()
    before = lab.draft.kinds.copy()
    stroke(lab, (12, 5))  # pressed again: no line from the last cell
    stroke(lab, (3, 15.9))  # the map ends at 15.5
    stroke(lab, (5, 16.6))
    assert np.argwhere(lab.draft.kinds != before).tolist() == [[3, 15], [12, 5]]


def test_random_cities_are_all_different_and_too_small_ones_are_refused(lab):
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


def test_the_mouse_shows_the_shadow_of_a_device_under_it(lab):
    def look(cell):
        stroke(lab, cell, kind="move", pressed=False)

    def share():
        sight = line_of_sight(lab.draft.buildings)[2, 3]
        return f"sees {sight[~lab.draft.buildings].mean():.0%}"

    plain = pixels(lab.canvas.picture)
    look((2, 3))
    shown = lab.canvas.picture.value
    assert share() in lab.seen.value and (pixels(lab.canvas.picture) != plain).any()
    assert (lab.draft.kinds == City.load("village").kinds).all()  # looking paints nothing
    look(tuple(np.argwhere(lab.draft.buildings)[0]))
    assert lab.seen.value == "" and (pixels(lab.canvas.picture) == plain).all()
    look((2, 3))
    assert lab.canvas.picture.value == shown and len(lab.ax.images) == len(lab.ax.lines) == 0
    before = share()
    stroke(lab, (4, 4))  # painting: the shadow is that of the new city
    look((2, 3))
    assert share() != before and share() in lab.seen.value


def test_policies_fly_in_a_painted_city_and_it_can_be_taken_home(lab):
    stroke(lab, (7, 6))  # a city that nobody has seen
    assert lab.policy.value == "any_city"
    for policy in ("any_city", "genie", "greedy"):
        lab.policy.value = policy
        lab.fly.click()
        assert flights(lab) == (1 if policy == "greedy" else 2)  # the policy, and greedy
        assert lab.stage.begin == 0 and lab.result.value.count("landed after") == flights(lab)
    mission, lab.policy.value, lab.third.value = lab._mission, "any_city", "genie"
    assert flights(lab) == 3 and lab._mission == mission and "genie: landed" in lab.result.value
    assert "train --from any_city --city my_city.png" in lab.take_home.value
    assert (Draft.from_png(file_of(lab)).kinds == lab.draft.kinds).all()
    stroke(lab, (7, 7))
    assert flights(lab) == 0 and lab.third.value == "genie"  # the flight was in another city


def test_over_a_large_city_only_planners_fly(lab):
    lab.base.value = "harbour"
    assert lab.policy.value == "harbour"  # its own agent
    stroke(lab, (31, 31))
    assert [name for _, name in lab.policy.options] == ["greedy", "genie", "random"]
    assert "train --city my_city.png --devices 1 3" in lab.take_home.value
    lab.base.value = "open_field"
    assert lab.policy.value == "greedy"  # what was chosen stays chosen
    assert lab.policy.options[0] == ("open_field agent", "open_field")


def test_they_fly_the_same_mission_again_after_each_stroke(lab):
    lab.at_once.value = True
    first, told = lab._mission, lab.result.value
    assert flights(lab) == told.count("landed after") == 2
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
    assert flights(lab) == 0 and lab.result.value == ""


def test_flights_and_the_painted_city_come_back(lab):
    lab.fly.click()
    told = lab.result.value
    stroke(lab, (7, 7))
    assert flights(lab) == 0 and lab.base.value == "my city"
    lab.undo.click()
    assert flights(lab) == 2 and lab.result.value == told
    lab.redo.click()
    assert flights(lab) == 0
    painted = lab.draft.kinds.copy()
    lab.base.value = "open_field"
    lab.base.value = "my city"
    assert (lab.draft.kinds == painted).all() and lab.unsaved
    lab.base.value = "village"
    assert not lab.draft.buildings[7, 7]


def test_missions_in_a_painted_city_are_set_by_hand_and_have_numbers(lab):
    lab.fly.click()
    drawn = lab._mission
    device, free = drawn.devices[0], (7, 0)
    assert lab.changed.value == ""
    drag(lab, device, free)
    assert lab._mission.devices[0] == free and "landed" in lab.result.value
    assert "changed" in lab.changed.value
    drag(lab, free, device)
    assert lab.changed.value == ""
    drag(lab, device, free)
    drag(lab, drawn.start, (0, 0))
    assert lab._mission.start == (0, 0)
    for there in (True, False):
        click(lab, (7, 7))
        assert ((7, 7) in lab._mission.devices) == there
    tell(lab.stage, kind="data", device=0, value=3.5)
    tell(lab.stage, kind="time", value=20)
    assert lab._mission.data[0] == 3.5 and lab._mission.flying_time == 20
    before = lab._mission
    drag(lab, free, np.argwhere(lab.draft.buildings)[0].tolist())
    assert "stands on a building" in lab.message.value and lab._mission == before
    lab.fly.click()  # the number that is shown
    assert lab.number.value == 0 and set_by(lab._mission) == set_by(drawn)
    lab.following.click()
    assert lab.number.value == 1 and set_by(lab._mission) != set_by(drawn)
    lab.number.value = 0
    assert set_by(lab._mission) == set_by(drawn)


def test_many_missions_say_more_than_one_and_find_where_greedy_fails():
    lab = CityLab("open_field")
    lab.policy.value, lab.third.value = "any_city", "random"
    lab.many.click()
    assert re.search(r"any_city agent \d+%, greedy \d+%, random \d+%\.", lab.result.value)
    city = lab.draft.city()
    drawn = Mission.draw(scenario_of(city), city, lab.number.value)
    assert set_by(lab._mission) == set_by(drawn)
    stroke(lab, (7, 7))
    assert lab.result.value == ""


def test_averages_say_who_is_ahead_how_often_and_on_average():
    greedy = np.array([1.0, 1.0, 0.4, 0.9])
    scores = {"any_city": np.array([0.0, 1.0, 0.5, 1.0]), "greedy": greedy}
    told = told_average("any_city", scores)
    assert "any_city agent 62%, greedy 82%. Greedy fails in 1" in told
    assert "ahead of greedy in 2, behind in 1. It is behind on average" in told
    assert "greedy in mission 2, the any_city agent in mission 0" in told
    assert "Furthest" not in told_average("greedy", {"greedy": greedy})


def test_uploads_are_taken_or_refused_with_a_reason(lab):
    upload(lab, Draft(City.load("open_field").kinds).png())
    assert lab.draft.size == 16 and "<b" not in lab.message.value
    large = Draft.blank(60)
    large.paint((0, 0), "landing zone")
    for broken, reason in (
        (b"nonsense <script>", "not a readable PNG"),
        (Draft.blank(60).png(), "no start and landing zone"),
        (large.png(), "60 cells on a side: at most 50"),
    ):
        upload(lab, broken)
        assert reason in lab.message.value and "&lt;i&gt;.x" in lab.message.value
        assert "<script>" not in lab.message.value and lab.upload.value == ()
        assert lab.draft.size == 16


def test_a_link_opens_its_city_with_the_mission_that_is_flown_in_it():
    there = CityLab("village", linked=True)
    stroke(there, (7, 6))
    bare = link_of(there)
    assert "mission" not in bare
    there.number.value = 4
    drag(there, there._mission.devices[0], (7, 0))
    link = link_of(there)
    assert re.fullmatch("[A-Za-z0-9_=&-]*", link) and len(link) < 700
    page = Labs()
    page.address.value = link
    lab = page.made["City"]
    assert page.titles[page.selected_index] == "City" and lab.base.value == "my city"
    assert (lab.draft.kinds == there.draft.kinds).all() and flights(lab) == 2
    assert set_by(lab._mission) == set_by(there._mission)
    assert lab.number.value == 4 and "changed" in lab.changed.value
    for mission in (link.split("mission=")[1][:-7], "", "x", encode(b'{"start": [1, 4]}')):
        page.address.value = f"{bare}&mission={mission}"
        assert "the city of the link is here, its mission is not" in lab.message.value, mission
        assert (lab.draft.kinds == there.draft.kinds).all()
    for broken, told in {
        "city=" + bare[5:41]: "not a readable PNG",
        bare[:42]: "part of it is missing",
        "city=%3Cscript": "the link holds no city",
        "city=é": "the link holds no city",
        "city=": "not a readable PNG",
    }.items():
        page.address.value = broken
        assert told in lab.message.value and "Copy it again" in lab.message.value, broken
        assert (lab.draft.kinds == there.draft.kinds).all()
    stroke(there, (7, 7))  # the flights are gone
    assert "mission" not in link_of(there)
    there.blank.click()
    assert "#city" not in there.take_home.value  # no landing zone yet
    assert "#city" not in CityLab().take_home.value  # in a notebook, nothing reads the address
