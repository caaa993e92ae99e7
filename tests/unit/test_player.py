"""What Python writes for the player; `tests/browser/test_player_page.py` plays it."""

import json
import re
from dataclasses import replace
from html import escape

import numpy as np
import pytest
from strategies import renumbered

from uavdh_lite.city import City
from uavdh_lite.environment import EAST, HOVER, LAND, NORTH, WEST, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.missions import Mission
from uavdh_lite.player import film, play
from uavdh_lite.plotting import device_colour
from uavdh_lite.streams import Use, stream

FLIGHT = [EAST, EAST, HOVER, NORTH, WEST, WEST, LAND]  # there is a building to the north


def flight(cities, actions=FLIGHT, city=0, device=(2, 3), data=1.5, flying_time=9):
    """A flight with two devices; of three places, the first is empty."""
    environment = Environment(cities)
    places = [device, (2, 4)]
    own = environment.cities[city]
    start = Mission(own, (2, 0), places, [data, 2.5], flying_time, max_devices=3).state
    start = renumbered(start, own.size, environment.size)
    turned = {
        name: np.roll(getattr(start, name), 1, axis=1)
        for name in ("device_cells", "data_initial", "data_left")
    }
    start = replace(start, city=np.array([city], np.int16), **turned)
    actions = iter(actions)
    policy = FunctionPolicy(lambda state: np.array([next(actions)]))
    flights = fly(environment, policy, start, stream(Use.TEST, 0))
    return environment, flights.trajectory(0)


def test_a_film_has_the_city_the_devices_and_every_step(corridor):
    environment, trajectory = flight(corridor)
    made = film(environment, {"": trajectory})
    assert made["city"] == corridor.text.split("\n")
    assert [(each["number"], each["cell"]) for each in made["devices"]] == [
        (1, (2, 3)),
        (2, (2, 4)),
    ]
    assert [each["colour"] for each in made["devices"]] == [device_colour(1), device_colour(2)]
    (flown,) = made["flights"]
    assert flown["path"] == [(2, col) for col in (0, 1, 2, 2, 2, 1, 0, 0)]
    *data, time = zip(*flown["left"], strict=True)
    assert np.allclose(np.transpose(data), trajectory.data_left[:, 1:], atol=1e-5)
    assert list(time) == [9, 8, 7, 6, 5, 4, 3, 2]
    assert flown["refused"] == ["", "", "", "north", "", "", ""] and flown["end"] == "landed"
    collected = 4 - trajectory.data_left[-1].sum()
    assert flown["ending"] == (
        f"Landed after 7 of 9 units of time, with {collected:.1f} of 4.0 units of data."
    )
    assert json.loads(json.dumps(made))["title"] == "Flight over corridor"


def test_the_cells_that_a_device_cannot_see_are_marked():
    city = City.from_text("wall", "L.B..\n..B..\n..B..\n.....\n.....")
    environment, trajectory = flight(city, [HOVER] * 9, device=(1, 1))
    device, _ = film(environment, {"": trajectory})["devices"]
    marked = np.array([[sign == "#" for sign in row] for row in device["hidden"]])
    assert (marked == ~environment.sight[0, 6].reshape(5, 5)).all() and marked[1, 3]


def test_a_flight_that_does_not_land_crashes_or_is_still_in_the_air(corridor):
    environment, crashed = flight(corridor, [HOVER] * 9)
    assert repr(play(environment, crashed)).startswith(
        "Flight over corridor. Crashed, because the time ran out, after 9 of 9 units of time, with "
    )
    flying = replace(crashed, time_left=crashed.time_left + 1)
    (flown,) = film(environment, {"": flying})["flights"]
    assert flown["end"] == "in the air" and flown["ending"].startswith("In the air after 9 of 10")


def test_a_smaller_city_of_several_is_shown_as_it_is_alone(corridor):
    large = City.from_text("large", "\n".join(["L......"] + ["......."] * 6))
    among, trajectory = flight((large, corridor), city=1)
    alone, same = flight(corridor)
    assert film(among, {"": trajectory}) == film(alone, {"": same})


NAMES = ["</script><script>alert(1)</script>", "\"><img src=x onerror='alert(1)'>", "a & b é ×"]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_text_and_the_page_loads_nothing(name, corridor, tmp_path):
    city = City(name, corridor.landing, corridor.no_fly, corridor.buildings)
    environment, trajectory = flight(city)
    player = play(environment, {name: trajectory})
    player.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("<script") == text.count("</script") == 2 and "<img" not in text
    assert f"<title>Flight over {escape(name)}</title>" in text
    assert f"<p>{escape(repr(player))}</p>" in text  # what is there without scripts
    data = re.search(r'<script type="application/json">(.*?)</script>', text)[1]
    assert json.loads(data) == json.loads(json.dumps(player.film))
    assert not re.search(r"https?:|@import|url\(|\beval\b|new Function", text)
    assert player._repr_html_() in text


def test_flights_that_do_not_go_together_are_refused(corridor):
    environment, trajectory = flight(corridor)
    for change in ({"device": (2, 2)}, {"data": 3.0}, {"flying_time": 12}):
        with pytest.raises(InputError, match="of one mission"):
            play(environment, {"a": trajectory, "b": flight(corridor, **change)[1]})
