"""What is in the page; `tests/browser/test_player.py` plays it."""

import base64
import json
import re
from dataclasses import dataclass
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from uavdh_lite.city import Cities, City
from uavdh_lite.environment import EAST, HOVER, LAND, NORTH, WEST, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import fly
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.plotting import LANDING, LOW, NO_FLY, TALL, device_colour
from uavdh_lite.scenario import SCENARIOS, place
from uavdh_lite.streams import Use, stream

FLIGHT = [EAST, EAST, HOVER, NORTH, WEST, WEST, LAND]  # there is a building to the north
LARGEST, USUAL = 500_000, 60_000  # bytes


def flight(city, actions, data=1.5, device=(2, 3), flying_time=9, failsafe=False):
    environment = Environment(city, failsafe=failsafe)
    start = place(city, (2, 0), [device, (2, 4)], [data, 2.5], flying_time, max_devices=3)
    actions = iter(actions)
    flown = fly(
        *(environment, lambda state: np.array([next(actions)]), start, stream(Use.TEST, 0)),
        record=True,
    )
    return environment, flown.trajectory(0)


def greedy(name, seed):
    environment = environment_of(name)
    mission = Mission.draw(SCENARIOS[name], environment.city, seed)
    return environment, mission.fly(environment, Greedy(environment)).trajectory(0)


@dataclass
class Part(HTMLParser):
    """What a browser reads: tags with their attributes, and text."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.texts = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.texts.append(data)


def data_of(player):
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', player.html)[1])


def maps(player):
    """The map of each flight, as the elements of an SVG."""
    images = [about for tag, about in Part(player.html).tags if tag == "img" and about["alt"]]
    decoded = (base64.b64decode(about["src"].partition("base64,")[2]) for about in images)
    return [ElementTree.fromstring(svg) for svg in decoded]


def elements(svg, name, **attributes):
    wanted = {key.replace("_", "-"): value for key, value in attributes.items()}
    return [
        each
        for each in svg.iter(f"{{http://www.w3.org/2000/svg}}{name}")
        if all(each.get(key) == value for key, value in wanted.items())
    ]


def covered(path, size):
    """The cells of a path made of rectangles."""
    mask = np.zeros((size, size), bool)
    for x, y, cells in re.findall(r"M(\S+) (\S+?)h(\d+)v1", path.get("d")):
        col, row = round(float(x) + 0.5), round(float(y) + 0.5)
        mask[row, col : col + int(cells)] = True
    return mask


def test_the_page_has_the_data_of_every_step(corridor):
    environment, trajectory = flight(corridor, FLIGHT)
    (film,) = data_of(play(environment, trajectory))["flights"]
    assert film["x"] == [0, 1, 2, 2, 2, 1, 0, 0] and film["y"] == [2] * 8
    *data, time = film["left"]
    assert time == trajectory.time_left.tolist()
    assert np.allclose(np.transpose(data), trajectory.data_left[:, :2], atol=1e-5)
    assert len(data) == 2  # of three places, one is empty


def test_each_step_has_its_sentence(corridor):
    environment, trajectory = flight(corridor, FLIGHT, data=0.5)
    (film,) = data_of(play(environment, trajectory))["flights"]
    start, first, *_, refused, _, _, end = film["says"]
    assert start == "Starts with 9 units of time."
    assert first.startswith("Step 1: flies east; device 0 uploads ")
    assert film["says"][3].startswith("Step 3: hovers; device 1 uploads ")
    assert refused.startswith("Step 4: may not fly north here, and hovers; ")
    collected = 3 - trajectory.data_left[-1].sum()
    assert end == f"Landed after 7 of 9 units of time, with {collected:.1f} of 3.0 units of data."
    uploaded = trajectory.data_left[0, 0] - trajectory.data_left[1, 0]
    assert f"device 0 uploads {uploaded:.1f} units" in first


def test_the_ending_says_whether_it_landed(corridor):
    environment, trajectory = flight(corridor, [HOVER] * 9)
    crashed = play(environment, trajectory)
    assert crashed.endings[0].startswith("Crashed: not landed after 9 units of time, with ")
    assert repr(crashed) == f"Flight over corridor. {crashed.endings[0]}"
    hand = HandFlight(environment, Mission(corridor, (2, 0), ((2, 3),), (5.0,), 9))
    before = play(environment, hand.flights().trajectory(0))
    assert before.endings == (
        "In the air after 0 of 9 units of time, with 0.0 of 5.0 units of data.",
    )
    hand.step(EAST)
    after = play(environment, hand.flights().trajectory(0))
    assert after.endings[0].startswith("In the air after 1 of 9")
    marks = [len(elements(maps(player)[0], "g", data_from="8.5")) for player in (crashed, after)]
    assert marks == [1, 0]


def test_a_flight_that_the_failsafe_lands_has_landed(corridor):
    environment, trajectory = flight(corridor, [EAST] + [HOVER] * 3, flying_time=4, failsafe=True)
    assert trajectory.landed and trajectory.action[-1] == HOVER
    player = play(environment, trajectory)
    assert player.endings[0].startswith("Landed after 4 of 4")
    says = data_of(player)["flights"][0]["says"]
    assert "flies west" in says[3]  # what it did, not what was chosen
    (map_,) = maps(player)
    assert not elements(map_, "g", data_from="3")  # no ring: it does not hover there


def test_the_picture_has_an_arrow_for_each_move_and_rings_for_hovering(corridor):
    environment, trajectory = flight(corridor, FLIGHT)
    (map_,) = maps(play(environment, trajectory))
    uploads = trajectory.data_left[:-1] - trajectory.data_left[1:]
    arrows = {
        each.get("data-from"): each for each in elements(map_, "path") if each.get("data-from")
    }
    assert list(arrows) == ["0", "1", "4", "5"]
    for step, arrow in arrows.items():
        served = uploads[int(step)]
        expected = device_colour(served.argmax()) if served.max() > 0 else "#000"
        assert arrow.get("fill") == expected
    rings = [each for each in elements(map_, "g") if each.get("data-from") in ("2", "3")]
    assert [(ring.get("data-until"), ring.get("visibility")) for ring in rings] == [
        ("3", "hidden"),  # the second one takes its place
        (None, None),
    ]
    assert [elements(ring, "text")[0].text for ring in rings] == ["1×", "2×"]
    (uav,) = [each for each in elements(map_, "g") if each.get("data-uav") is not None]
    assert uav.get("transform") == "translate(0 2)"


def breadth(arrow):
    """How wide an arrow's shaft is: twice the way from its corner to the line of its tip."""
    first, *others = (
        tuple(map(float, point)) for point in re.findall(r"(-?[\d.]+) (-?[\d.]+)", arrow.get("d"))
    )
    corners = np.cumsum([first, *others], axis=0)
    return np.abs(corners[0] - corners[-1]).max()


def test_a_thousandth_does_not_look_like_a_full_upload(corridor):
    environment, trajectory = flight(corridor, [EAST, EAST, EAST, WEST, WEST, WEST, LAND], data=50)
    left = np.array([50, 50 - 0.004, 46, 46, 44, 44, 44, 44])
    trajectory.data_left[:, 0] = left
    trajectory.data_left[:, 1] = 2.5
    (map_,) = maps(play(environment, trajectory))
    arrows = [each for each in elements(map_, "path") if each.get("data-from")]
    tiny, full, none, half, *_ = map(breadth, arrows)
    assert full > 4 * tiny and none == tiny and tiny < half < full
    assert [arrow.get("fill") for arrow in arrows[:3]] == [device_colour(0)] * 2 + ["#000"]


def test_the_map_has_the_colours_and_cells_of_the_figures():
    city = City.from_text("drawn", "LL.N\n..bB\n.b.B\n....")
    environment = Environment(city)
    mission = Mission(city, (0, 0), ((1, 1), (3, 3)), (5.0, 6.0), 9)
    (map_,) = maps(play(environment, mission.fly(environment, Greedy(environment)).trajectory(0)))
    tall = city.buildings & city.no_fly
    for style, mask in (
        (LANDING, city.landing),
        (LOW, city.buildings & ~tall),
        (TALL, tall),
        (NO_FLY, city.no_fly & ~tall),
    ):
        kind = [p for p in elements(map_, "path", fill=style["facecolor"]) if "v1h" in p.get("d")]
        assert any((covered(path, 4) == mask).all() for path in kind), style
        if "hatch" in style:
            (hatch,) = elements(map_, "path", stroke=style["edgecolor"])
            assert hatch.get("d").count("M") % mask.sum() == 0
    for k, cell in enumerate((5, 15)):
        (shadow,) = elements(map_, "path", data_shadow=str(k))
        hidden = ~environment.line_of_sight[cell].reshape(4, 4)
        assert (covered(shadow, 4) == hidden).all() and hidden.any()
        assert shadow.get("visibility") == "hidden"


@pytest.mark.parametrize("seed", range(3))
def test_labels_keep_clear_of_the_route(seed):
    environment, trajectory = greedy("manhattan", seed)
    (map_,) = maps(play(environment, trajectory))
    row, col = np.divmod(trajectory.uav_cell, 16)
    for device in elements(map_, "g"):
        if device.get("data-device") is None:
            continue
        x, y = map(int, re.findall(r"\d+", device.get("transform")))
        (label,) = elements(device, "text")
        middle = x + float(label.get("x")), y + float(label.get("y")) - 0.25
        assert np.hypot(col - middle[0], row - middle[1]).min() > 0.45
        assert -0.5 < middle[0] < 15.5 and -0.5 < middle[1] < 15.5


def test_flights_side_by_side_have_one_scale(corridor):
    environment, east = flight(corridor, FLIGHT)
    _, stays = flight(corridor, [HOVER] * 9)
    player = play(environment, {"east": east, "stays": stays})
    data = data_of(player)
    assert len(data["flights"]) == len(maps(player)) == 2
    each = [(f.data_left[:-1] - f.data_left[1:]).max() for f in (east, stays)]
    assert data["most"] == pytest.approx(max(each)) and each[0] != pytest.approx(each[1])
    assert player.endings[1].startswith("stays: Crashed")


NAMES = ["</script><script>alert(1)</script>", "\"><img src=x onerror='alert(1)'>", "a & b é ×"]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_text(name, corridor, tmp_path):
    city = City(name, corridor.landing, corridor.no_fly, corridor.buildings)
    environment, trajectory = flight(city, FLIGHT)
    player = play(environment, {name: trajectory})
    player.save(tmp_path / "page.html")
    page = Part((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert [tag for tag, _ in page.tags].count("script") == 2
    assert not any("onerror" in about or about.get("src") == "x" for _, about in page.tags)
    assert name in page.texts and f"Flight over {name}" in page.texts  # heading, title
    (about,) = [about for tag, about in page.tags if tag == "img" and about["alt"]]
    assert about["alt"] == f"{name}, over {name}: {player.endings[0].removeprefix(f'{name}: ')}"


def test_the_page_loads_nothing_and_claims_no_names(corridor, tmp_path):
    """Whatever else is on its page, and however often the player is, nothing is mixed up."""
    environment, trajectory = flight(corridor, FLIGHT)
    player = play(environment, trajectory)
    player.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert player.html in text and player._repr_html_() == player.html
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    for tag, about in Part(text).tags:
        assert "id" not in about, tag
        assert about.get("src", "data:").startswith("data:") and "href" not in about
    assert not re.search(r"https?:|//\w+\.|@import|url\(|\beval\b|new Function|\bwindow\b", text)
    assert not any("id" in each.attrib for each in maps(player)[0].iter())


@pytest.mark.parametrize(("name", "most"), [("manhattan", USUAL), ("harbour", LARGEST)])
def test_the_size_is_small(name, most):
    environment, trajectory = greedy(name, 1)
    assert len(play(environment, trajectory).html) < most


def test_a_flight_over_one_of_several_cities(corridor):
    other = City.from_text("other", "L..\n.B.\n...")
    environment = Environment(Cities((other, corridor)))
    state = place(environment.cities[1], (2, 0), [(2, 3)], [4.0], 9, max_devices=2)
    first = environment.cities.first_cell[1]
    moved = type(state)(
        *(
            value + first if name in ("uav_cell", "device_cells") else value
            for name, value in vars(state).items()
        )
    )
    trajectories = [
        fly(world, Greedy(world), start, stream(Use.TEST, 0), record=True).trajectory(0)
        for world, start in ((environment, moved), (Environment(corridor), state))
    ]
    among = play(environment, trajectories[0])
    assert among.html == play(Environment(corridor), trajectories[1]).html


def test_flights_that_do_not_go_together_are_refused(corridor):
    environment, trajectory = flight(corridor, FLIGHT)
    with pytest.raises(InputError, match="no flight to play"):
        play(environment, {})
    for change, what in (
        ({"device": (2, 2)}, "devices"),
        ({"data": 3.0}, "data"),
        ({"flying_time": 12}, "flying time"),
    ):
        _, other = flight(corridor, FLIGHT, **change)
        with pytest.raises(InputError, match=f"flight 'b' has another {what} than the first one"):
            play(environment, {"a": trajectory, "b": other})
    with pytest.raises(InputError, match="the flight does not fit small: is it over another city"):
        play(Environment(City.from_text("small", "L..\n...\n...")), trajectory)
    walls = City.from_text("walls", "BBBBB\nBBBBB\nLN...\n.BBBB\nBBBBB")
    with pytest.raises(InputError, match="the flight does not fit walls"):
        play(Environment(walls), trajectory)


def test_flights_over_two_cities_are_refused(corridor):
    cities = Cities((corridor, City.from_text("other", "L..\n.B.\n...")))
    environment = Environment(cities)
    starts = []
    for city, first in zip(cities.cities, cities.first_cell, strict=True):
        state = place(city, divmod(int(city.landing_cells[0]), city.size), [(2, 2)], [4.0], 9, 2)
        vars(state).update(uav_cell=state.uav_cell + first, device_cells=state.device_cells + first)
        starts.append(state)
    flights = [
        fly(environment, Greedy(environment), start, stream(Use.TEST, 0), record=True).trajectory(0)
        for start in starts
    ]
    with pytest.raises(InputError, match="flight 'b' is over other, the first one over corridor"):
        play(environment, dict(zip("ab", flights, strict=True)))
