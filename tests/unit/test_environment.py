import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import ReferenceEpisode, exact_sight
from strategies import cities

from uavdh_lite.channel import Channel
from uavdh_lite.channel import rate as mean_rate
from uavdh_lite.city import City
from uavdh_lite.environment import (
    ACTIONS,
    EAST,
    HOVER,
    LAND,
    NORTH,
    SOUTH,
    WEST,
    Environment,
    Rewards,
    State,
)
from uavdh_lite.scenario import Scenario

CITY = City.from_text(
    "by hand",
    """
    L . . . .
    . b . N .
    . . . . .
    . B . . .
    L . . . .
    """,
)
# From (1, 0) the building hides the device at (0, 2); from (0, 0) it does not.
CORNER = City.from_text("corner", "L . . . / . b . . / . . . . / . . . .".replace("/", "\n"))
SCENARIO = Scenario("drawn", devices=(1, 4), data=(0.5, 15.0), flying_time=(3, 40))


def assert_equal(first, second):
    """Two states, or two outcomes."""
    for field in fields(first):
        assert np.array_equal(getattr(first, field.name), getattr(second, field.name)), field.name


# The library beside the reference


def compare(state, outcome, episodes, results, size):
    """One step of the whole batch, all at once."""
    found = np.stack([state.uav_cell, state.time_left, state.landed, state.ended], axis=1)
    assert found.tolist() == [[e.row * size + e.col, e.time, e.landed, e.ended] for e in episodes]
    for name in ("served", "intervened", "landed", "crashed", "flew"):
        assert getattr(outcome, name).tolist() == [result[name] for result in results], name
    np.testing.assert_allclose(state.data_left, [e.left for e in episodes], rtol=1e-4, atol=1e-3)
    terms = Rewards().terms(outcome)
    for name, values in {"uploaded": outcome.uploaded, **terms}.items():
        expected = [result[name] for result in results]
        np.testing.assert_allclose(values, expected, rtol=1e-4, atol=1e-3, err_msg=name)
    assert np.array_equal(Rewards()(outcome), sum(terms.values()))


@given(
    st.lists(cities(2), min_size=1, max_size=3),
    st.integers(1, 5),
    st.floats(1, 50),
    st.integers(0, 2**32),
)
@settings(derandomize=True, deadline=None, max_examples=40)
def test_batched_steps_equal_the_scalar_reference(drawn, slots, altitude, seed):
    """Each episode of the reference knows its own city alone."""
    generator, channel = np.random.default_rng(seed), Channel(slots=slots, altitude_m=altitude)
    environment = Environment(tuple(drawn), channel)
    devices = min(4, *(city.open_to_devices.sum() for city in drawn))
    scenario = replace(SCENARIO, devices=(1, devices))
    state = scenario.sample(environment, 12, generator)
    sights = [exact_sight(city.buildings) for city in drawn]
    episodes = [
        ReferenceEpisode(
            drawn[one.city[0]],
            channel,
            sights[one.city[0]],
            divmod(int(one.uav_cell[0]), environment.size),
            int(one.time_left[0]),
            [divmod(cell, environment.size) for cell in one.device_cells[0].tolist()],
            one.data_left[0].tolist(),
        )
        for one in (state[[i]] for i in range(12))
    ]
    while not state.ended.all():
        # landing is tried seldom, so that episodes last
        action = generator.choice(6, 12, p=[0.19, 0.19, 0.19, 0.19, 0.2, 0.04])
        fading = environment.draw_fading(state, generator)
        after, outcome = environment.transition(state, action, fading)
        pairs = zip(episodes, action, fading, strict=True)
        results = [episode.step(int(a), f) for episode, a, f in pairs]
        compare(after, outcome, episodes, results, environment.size)
        for name in ("device_cells", "data_initial", "city"):
            assert np.array_equal(getattr(after, name), getattr(state, name))
        state = after


def test_fading_draws_are_standard_normal_for_every_slot_and_device(generator):
    environment = Environment(CITY, Channel(slots=3))
    state = Scenario("five", devices=(5, 5)).sample(environment, 4000, generator)
    flat = environment.draw_fading(state, generator).reshape(4000, 15).astype(float)
    assert np.abs(flat.mean(0)).max() < 5 / math.sqrt(4000)
    assert np.abs(flat.T @ flat / 4000 - np.eye(15)).max() < 5 * math.sqrt(2 / 4000)


def test_actions_are_in_the_order_of_the_specification():
    assert ACTIONS == ("north", "east", "south", "west", "hover", "land")
    assert (NORTH, EAST, SOUTH, WEST, HOVER, LAND) == (0, 1, 2, 3, 4, 5)


# Tables, and states


def test_a_map_of_rates_agrees_with_a_uav_that_hovers(generator):
    """Over an embedded city, too, whose constants are those of its own size."""
    environment = Environment((City.load("village"), City.load("manhattan")))
    state = Scenario("one", devices=(1, 1)).sample_anywhere(environment, 60, generator, 0)
    snr_db = environment.snr_db(state, state.uav_cell, np.zeros((60, 4, 1), np.float32))
    for row, city in enumerate(state.city):
        rates = environment.rate_map(state.device_cells[row, 0], city)
        expected = rates.flat[state.uav_cell[row]]
        assert mean_rate(snr_db[row]) == pytest.approx(expected, rel=1e-3, abs=1e-6)


@given(st.lists(cities(2), min_size=1, max_size=3))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_the_way_home_is_a_shortest_one(drawn):
    environment = Environment(tuple(drawn))
    home, way = environment.landing_distance, environment.way_home
    assert (way[home == 0] == LAND).all() and (way[home < 0] == HOVER).all()
    city, cell = np.nonzero(home > 0)
    taken = city, cell, way[city, cell]
    assert not environment.forbidden[taken].any()
    assert np.array_equal(home[city, environment.next_cell[taken]], home[city, cell] - 1)
    assert np.array_equal(environment.time_to_land[city, cell], home[city, cell] + 1)


def test_states_are_taken_apart_and_put_together(generator):
    state = SCENARIO.sample(Environment((CITY, CORNER)), 5, generator)
    assert_equal(State.concatenate([state[:2], state[2:]]), state)
    swapped = state.with_rows([0, 4], state[[4, 0]])
    assert_equal(swapped, state[[4, 1, 2, 3, 0]])
    assert not np.array_equal(swapped.data_left, state.data_left)


def test_of_landing_cells_that_are_equally_near_the_way_leads_to_the_first():
    """To the west, although east comes first among the actions."""
    city = City.from_text("both", ". . . \n L . L \n . . .")
    way = Environment(city).way_home[0].reshape(3, 3)
    assert way[:, 1].tolist() == [SOUTH, WEST, NORTH] and way[1, 0] == way[1, 2] == LAND
