"""All labs on one page: tabs, links, a painted city that goes from lab to lab, colours, words."""

import re
import subprocess
import sys

import pytest
from driving import click, link_of, open_tab, pixels, set_by, stroke, tell

from uavdh_lite import labs
from uavdh_lite.labs import ChannelLab, CityLab, Labs, MissionLab, ThinkLab, TrainingLab
from uavdh_lite.labs.draft import Draft
from uavdh_lite.labs.links import decode, encode


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
    with pytest.raises(ImportError, match="NoLab"):
        from uavdh_lite.labs import NoLab  # noqa: F401


def test_the_page_makes_each_lab_when_it_is_opened():
    page = Labs()
    assert list(page.made) == ["Mission"]
    for index, title in enumerate(page.titles):
        assert open_tab(page, title) is page.children[index].children[-1]
    mission = page.made["Mission"]
    assert open_tab(page, "Mission") is mission


def test_every_policy_that_can_be_chosen_is_explained():
    lab = MissionLab()
    explained = re.findall("<dt>(.*?)</dt>", lab.children[-1].value)
    assert {title.split()[-1] for title, _ in lab.policy.options} <= set(explained)


@pytest.mark.parametrize("title", ["Mission", "Watch it think", "Fly it yourself"])
def test_a_painted_city_is_flown_in_the_other_labs(title):
    page = Labs()
    lab = open_tab(page, title)
    before = lab.environment
    lab.city.value = "my city"
    assert "no city of yours yet" in lab.message.value
    assert lab.city.value == "manhattan" and lab.environment is before
    city = open_tab(page, "City")
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
    assert lab.environment is last and lab.city.value == "my city"
    lab.city.value = "village"
    lab.city.value = "my city"
    assert "your city is not finished" in lab.message.value and lab.city.value == "village"


def test_a_painted_city_keeps_the_mission_that_was_set_in_it_if_it_can():
    page = Labs()
    city, lab = open_tab(page, "City"), open_tab(page, "Mission")
    lab.city.value, lab.other.value = "my city", "genie"
    click(lab, (7, 0))
    kept = set_by(lab.mission)
    for painted in ((7, 7), (7, 0)):  # the second is the device's cell
        stroke(city, painted)
        open_tab(page, "City")
        open_tab(page, "Mission")
        assert lab.mission.city.buildings[painted] and lab.undo.disabled
        assert (set_by(lab.mission) == kept) == (painted == (7, 7))
        assert lab.other.value == "genie" and "genie" in lab.flights
    assert "my city" not in MissionLab().city.options  # in a notebook, there is no city editor


def test_a_link_opens_its_mission_and_one_that_is_clicked_is_copied():
    there = MissionLab("village", linked=True)
    click(there, (7, 0))
    page = Labs()
    lab = page.made["Mission"]
    page.address.value = link_of(there)
    assert lab.city.value == "village" and set_by(lab.mission) == set_by(there.mission)
    assert link_of(lab) == link_of(there) and lab.undo.disabled
    page.address.value = "mission="
    assert "the link holds no mission" in lab.message.value
    tell(page.address, value=link_of(lab), copied=True)
    assert "Link copied" in lab.message.value
    page.address.value = link_of(lab)  # the address follows the link
    assert "Link copied" in lab.message.value
    tell(page.address, value=link_of(lab), copied=False)
    assert lab.message.value.count("in the address bar") == 1
    tell(page.address, value="city=x", copied=True)  # that lab is not open
    assert 'href="#' not in MissionLab().take_home.value  # in a notebook, nothing reads the address


def test_links_are_letters_that_mail_and_chats_leave_as_they_are():
    for data in (b"", b"a", b"ab", bytes(range(256))):
        assert re.fullmatch("[A-Za-z0-9_-]*", encode(data)) and decode(encode(data)) == data


def test_painted_cities_and_running_trainings_are_work_that_can_be_lost():
    page = Labs()
    city, training = open_tab(page, "City"), open_tab(page, "Training")
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


DARK = {"paper": "#212121", "ink": "#ffffff"}
FIGURES = {
    MissionLab: lambda lab: lab.charts.canvas,
    ThinkLab: lambda lab: lab.charts.canvas,
    ChannelLab: lambda lab: lab.canvas,
    CityLab: lambda lab: lab.canvas,
    TrainingLab: lambda lab: lab.curves,
}


@pytest.mark.parametrize("made", FIGURES)
def test_figures_have_the_colours_of_the_page_and_maps_keep_theirs(made):
    lab = made()
    canvas = FIGURES[made](lab)
    light = pixels(canvas.picture)
    assert (light[0, 0] == 255).all() and (light == 0).all(axis=2).any()
    canvas.picture.page = DARK
    dark = pixels(canvas.picture)
    assert (dark[0, 0] == 33).all() and (dark == 255).all(axis=2).any()
    assert dark.shape == light.shape
    if made is MissionLab:  # what is drawn later has the colours, too
        lab.stage.step = 3
        assert all(cursor.get_color() == "#ffffff" for cursor in lab.charts.cursors)
        frame = lab.charts.axes[-1].get_legend().get_frame()
        assert frame.get_facecolor()[:3] == (33 / 255,) * 3
        return
    if made is CityLab:  # the paper of the map
        x, y = lab.ax.transData.transform((7, 0)).round().astype(int)
        row = int(canvas.figure.bbox.height) - y
        assert (light[row, x] == 255).all() and (dark[row, x] == 255).all()
    canvas.picture.page = {"paper": "no colour", "ink": "#000000"}
    assert (pixels(canvas.picture) == dark).all()
    canvas.picture.page = {"paper": "#ffffff", "ink": "#000000"}
    assert (pixels(canvas.picture) == light).all()
