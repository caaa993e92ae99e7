"""With the failsafe nobody crashes; without it nothing changes."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import cities

from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, LAND, Environment, Rewards
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.scenario import SCENARIOS, Scenario
from uavdh_lite.streams import Use, stream


@st.composite
def starts(draw, most_spare_time=12):
    """A city, and episodes that start anywhere from which a landing is possible."""
    city = draw(cities(2))
    home = city.landing_distance.ravel()
    cells = draw(st.lists(st.sampled_from(np.flatnonzero(home >= 0).tolist()), min_size=1))
    spare = [draw(st.integers(0, most_spare_time)) for _ in cells]
    state = Scenario("drawn", devices=(1, 1)).sample(city, len(cells), stream(Use.TEST))
    return city, replace(
        state,
        uav_cell=np.array(cells, np.int16),
        time_left=(home[cells] + 1 + np.array(spare)).astype(np.int16),
    )


def plain_and_safe(city):
    return Environment(city), Environment(city, failsafe=True)


@given(starts(), st.data())
@settings(derandomize=True, deadline=None, max_examples=100)
def test_no_policy_crashes_from_where_a_landing_is_possible(start, data):
    city, state = start
    environment, generator = Environment(city, failsafe=True), stream(Use.TEST, 1)
    action = st.lists(st.integers(0, 5), min_size=len(state), max_size=len(state))
    while not state.ended.all():
        state, outcome = environment.step(state, np.array(data.draw(action)), generator)
        assert not outcome.crashed.any()
        assert not (outcome.sent_home & (outcome.intervened | ~outcome.flew)).any()
    assert state.landed.all()


@given(starts(), st.integers(0, 5))
@settings(derandomize=True, deadline=None, max_examples=100)
def test_no_stubborn_policy_crashes(start, action):
    """Whoever wants the same all the time, off the map or into a wall, is brought home too."""
    city, state = start
    environment = Environment(city, failsafe=True)
    flights = fly(environment, lambda s: np.full(len(s), action), state, stream(Use.TEST))
    assert flights.end.landed.all()
    if action == HOVER:  # as long as it can: home with the last unit of time
        assert (flights.end.time_left == 0).all()


def landings(environment, most):
    """Whether a landing is possible, `[time left, cell]`, by trying all actions one by one."""
    cells = environment.city.size**2
    possible = np.zeros((most + 1, cells), bool)
    for time in range(1, most + 1):
        for cell in range(cells):
            if environment.city.landing.flat[cell]:
                possible[time, cell] = True
            for action in range(5):
                if not environment.forbidden[cell, action]:
                    possible[time, cell] |= possible[time - 1, environment.next_cell[cell, action]]
    return possible


@given(cities(2))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_it_replaces_what_makes_a_landing_impossible_and_nothing_else(city):
    """Every cell, time left and action, against a search that tries everything."""
    plain, safe = plain_and_safe(city)
    most = int(city.landing_distance.max()) + 4
    possible = landings(plain, most)
    cells = [cell for cell in city.flight_cells for _ in range(most) for _ in range(6)]
    times = [time for _ in city.flight_cells for time in range(1, most + 1) for _ in range(6)]
    action = np.tile(np.arange(6), len(cells) // 6)
    state = Scenario("one", devices=(1, 1)).sample(city, len(cells), stream(Use.TEST))
    state = replace(state, uav_cell=np.array(cells, np.int16), time_left=np.array(times, np.int16))
    fading = plain.draw_fading(state, stream(Use.FADING))
    after, outcome = plain.transition(state, action, fading)
    _, safe_outcome = safe.transition(state, action, fading)
    lost = possible[times, cells] & ~after.landed & ~possible[after.time_left, after.uav_cell]
    assert np.array_equal(safe_outcome.sent_home, lost)
    assert not outcome.sent_home.any()

    each = (np.arange(len(cells)), action)
    assert np.array_equal(plain.allowed_actions(state)[each], ~outcome.intervened)
    assert np.array_equal(safe.allowed_actions(state)[each], ~outcome.intervened & ~lost)
    assert safe.allowed_actions(state).any(axis=1).all()


@given(starts(3), st.integers(0, 2**32))
@settings(derandomize=True, deadline=None, max_examples=100)
def test_a_step_is_that_of_the_way_home_or_the_one_without_the_failsafe(start, seed):
    city, state = start
    plain, safe = plain_and_safe(city)
    action = stream(Use.TEST, seed).integers(0, 6, len(state))
    fading = plain.draw_fading(state, stream(Use.FADING, seed))
    after, outcome = safe.transition(state, action, fading)
    instead = np.where(outcome.sent_home, safe.way_home[state.uav_cell], action)
    expected, plain_outcome = plain.transition(state, instead, fading)
    for field in fields(after):
        assert np.array_equal(getattr(after, field.name), getattr(expected, field.name))
    assert np.array_equal(Rewards()(outcome), Rewards()(plain_outcome)), "it costs nothing"


@given(cities(2))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_the_way_home_is_a_shortest_one(city):
    environment = Environment(city)
    home, way = city.landing_distance.ravel(), environment.way_home
    assert (way[home == 0] == LAND).all() and (way[home < 0] == HOVER).all()
    cells = np.flatnonzero(home > 0)
    assert not environment.forbidden[cells, way[cells]].any()
    assert (home[environment.next_cell[cells, way[cells]]] == home[cells] - 1).all()


def test_it_leaves_alone_what_cannot_land_any_more():
    """Two moves from the zone with two units of time, and where no way leads home."""
    city = City.from_text("cut off", "L . . \n N N N \n . . .")
    plain, safe = plain_and_safe(city)
    state = Scenario("one", devices=(1, 1)).sample(city, 2, stream(Use.TEST))
    time = np.array([2, 9], np.int16)
    state = replace(state, uav_cell=np.array([2, 8], np.int16), time_left=time)
    assert np.array_equal(safe.allowed_actions(state), plain.allowed_actions(state))
    flights = fly(safe, lambda s: np.full(len(s), HOVER), state, stream(Use.TEST))
    assert not flights.end.landed.any() and not flights.sent_home.any()


def test_the_records_say_whether_there_was_a_failsafe():
    plain, safe = plain_and_safe(City.load("manhattan"))
    scenario = SCENARIOS["manhattan"]
    without = evaluate(plain, Random(0), scenario, 100, seed=0).records()
    assert "sent_home" not in without and without["has_landed"].mean() < 0.95
    records = evaluate(safe, Random(0), scenario, 100, seed=0).records()
    assert (records["has_landed"] == 1).all() and records["sent_home"].sum() > 20


@pytest.mark.parametrize("name", ["manhattan", "village"])
def test_greedy_never_needs_it(name):
    plain, safe = plain_and_safe(City.load(name))
    scenario = SCENARIOS[name]
    expected = evaluate(plain, Greedy(plain), scenario, 300, seed=0).records()
    records = evaluate(safe, Greedy(safe), scenario, 300, seed=0).records()
    assert not records.pop("sent_home").any()
    assert all(np.array_equal(records[metric], expected[metric]) for metric in expected)
