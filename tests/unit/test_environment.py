import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import ReferenceEpisode, cached_line_of_sight
from strategies import cities

from uavdh_lite.channel import Channel
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
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.scenario import Scenario, place

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


def random_city(size, generator):
    while True:
        kinds = generator.choice(5, (size, size), p=[0.55, 0.1, 0.15, 0.1, 0.1])
        try:
            return City.from_kinds("random", kinds)
        except CityError:
            continue


def same_state(first, second):
    return all(
        np.array_equal(getattr(first, field.name), getattr(second, field.name))
        for field in fields(first)
    )


# The library beside the reference


def compare(state, outcome, episodes, results, size):
    """One step of the whole batch, all at once."""
    cells = [episode.row * size + episode.col for episode in episodes]
    assert state.uav_cell.tolist() == cells
    assert state.time_left.tolist() == [episode.time for episode in episodes]
    assert state.landed.tolist() == [episode.landed for episode in episodes]
    assert state.ended.tolist() == [episode.ended for episode in episodes]
    for name in ("served", "intervened", "landed", "crashed"):
        assert getattr(outcome, name).tolist() == [result[name] for result in results], name
    uploaded = [result["uploaded"] for result in results]
    np.testing.assert_allclose(outcome.uploaded, uploaded, rtol=1e-4, atol=1e-5)
    left = [episode.left for episode in episodes]
    np.testing.assert_allclose(state.data_left, left, rtol=1e-4, atol=1e-3)
    terms = Rewards().terms(outcome)
    assert set(terms) == set(results[0]["terms"])
    for name, values in terms.items():
        expected = [result["terms"][name] for result in results]
        np.testing.assert_allclose(values, expected, rtol=1e-4, atol=1e-5, err_msg=name)
    rewards = [result["reward"] for result in results]
    np.testing.assert_allclose(Rewards()(outcome), rewards, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize(
    "size, slots, altitude",
    [
        (5, 1, 10.0),
        (6, 4, 10.0),
        (7, 2, 35.0),
        (8, 3, 2.5),
        (9, 4, 20.0),
        (10, 5, 10.0),
        (11, 3, 50.0),
        (12, 4, 10.0),
    ],
)
def test_batched_steps_equal_the_scalar_reference(size, slots, altitude):
    generator = np.random.default_rng(size)
    city = random_city(size, generator)
    channel = Channel(slots=slots, altitude_m=altitude)
    environment = Environment(city, channel)
    scenario = Scenario("random", devices=(1, 4), data=(0.5, 15.0), flying_time=(3, 60))
    state = scenario.sample(city, 40, generator)
    initial = state
    sight = cached_line_of_sight(city.buildings)
    episodes = [
        ReferenceEpisode(
            city,
            channel,
            sight,
            divmod(int(state.uav_cell[i]), size),
            int(state.time_left[i]),
            [divmod(cell, size) for cell in state.device_cells[i].tolist()],
            state.data_left[i].tolist(),
        )
        for i in range(len(state))
    ]

    steps = []
    while not all(episode.ended for episode in episodes) or len(steps) < 62:
        # landing is tried seldom, so that episodes last
        action = generator.choice(6, len(state), p=[0.19, 0.19, 0.19, 0.19, 0.2, 0.04])
        fading = environment.draw_fading(state, generator)
        before = [(episode.row, episode.col) for episode in episodes]
        state, outcome = environment.transition(state, action, fading)
        results = [
            episode.step(int(a), f) for episode, a, f in zip(episodes, action, fading, strict=True)
        ]
        compare(state, outcome, episodes, results, size)
        steps += [results]

        # the SNR of all devices, served or not, of one episode
        i = len(steps) % len(episodes)
        after = episodes[i].row, episodes[i].col
        cells = np.ravel_multi_index(np.array([before[i], after]).T, city.landing.shape)
        one = slice(i, i + 1)
        snr_db = environment.snr_db(state.device_cells[one], cells[:1], cells[1:], fading[one])
        expected = [
            [
                10 * math.log10(episodes[i].snr(device, before[i], after, slot, float(normal)))
                for device, normal in zip(episodes[i].devices, fading[i, slot - 1], strict=True)
            ]
            for slot in range(1, slots + 1)
        ]
        np.testing.assert_allclose(snr_db[0], expected, rtol=1e-5, atol=1e-4)

    assert np.array_equal(state.device_cells, initial.device_cells)
    assert np.array_equal(state.data_initial, initial.data_initial)
    flat = [result for results in steps for result in results]
    for name in ("landed", "crashed", "intervened"):
        assert any(result[name] for result in flat), f"no step {name}"
    assert any(len(set(result["served"])) > 1 for result in flat) or slots == 1
    assert {sight(device, cell) for device in episodes[0].devices for cell in before} == {0, 1}


def test_an_episode_does_not_depend_on_the_others_of_its_batch(generator):
    environment = Environment(CITY)
    state = Scenario("two", devices=(2, 2), flying_time=(5, 9)).sample(CITY, 6, generator)
    kept = replace(state, **{f.name: getattr(state, f.name).copy() for f in fields(state)})
    action = np.arange(6)
    fading = environment.draw_fading(state, generator)
    together, outcome = environment.transition(state, action, fading)
    assert same_state(state, kept), "the step changed its input"
    for i in range(6):
        one = slice(i, i + 1)
        alone, single = environment.transition(state[one], action[one], fading[one])
        assert same_state(alone, together[one])
        assert all(
            np.array_equal(getattr(single, f.name), getattr(outcome, f.name)[one])
            for f in fields(single)
        )


def test_fading_draws_are_standard_normal_for_every_slot_and_device(generator):
    environment = Environment(CITY, Channel(slots=3))
    state = Scenario("five", devices=(5, 5)).sample(CITY, 4000, generator)
    fading = environment.draw_fading(state, generator)
    assert fading.shape == (4000, 3, 5)
    flat = fading.reshape(4000, 15).astype(float)
    covariance = flat.T @ flat / 4000
    assert np.abs(flat.mean(0)).max() < 5 / math.sqrt(4000)
    assert np.abs(covariance - np.eye(15)).max() < 5 * math.sqrt(2 / 4000)
    assert not np.array_equal(fading, environment.draw_fading(state, generator))


# Limit cases by hand


def start(uav, devices=((2, 4),), data=(5.0,), flying_time=10, city=CITY):
    return place(city, uav, list(devices), list(data), flying_time, max_devices=4)


def step(state, action, city=CITY, **channel):
    """One step without fading: the state after it, the outcome, the reward, its terms."""
    environment = Environment(city, Channel(**channel))
    fading = np.zeros((1, environment.channel.slots, state.data_left.shape[1]), np.float32)
    state, outcome = environment.transition(state, np.array([action]), fading)
    terms = {name: float(value[0]) for name, value in Rewards().terms(outcome).items()}
    return state, outcome, float(Rewards()(outcome)[0]), terms


def rate(distance_m, size, exponent=2.27):
    """Mean rate of the paper's channel: the SNR is −15 dB from the centre to a corner (LoS)."""
    edge = math.sqrt(2) * size * 10 / 2
    return math.log2(1 + 10**-1.5 * edge**2.27 * distance_m**-exponent)


def test_actions_are_in_the_order_of_the_specification():
    assert ACTIONS == ("north", "east", "south", "west", "hover", "land")
    assert (NORTH, EAST, SOUTH, WEST, HOVER, LAND) == (0, 1, 2, 3, 4, 5)
    for action, cell in enumerate([(1, 2), (2, 3), (3, 2), (2, 1), (2, 2)]):
        state, outcome, _, terms = step(start((2, 2)), action)
        assert divmod(int(state.uav_cell[0]), 5) == cell
        assert state.time_left[0] == 9 and not outcome.intervened[0]
        assert terms["movement"] == pytest.approx(-0.2) and terms["safety"] == 0


@pytest.mark.parametrize(
    "uav, action",
    [
        pytest.param((0, 2), NORTH, id="off the grid to the north"),
        pytest.param((2, 4), EAST, id="off the grid to the east"),
        pytest.param((4, 2), SOUTH, id="off the grid to the south"),
        pytest.param((2, 0), WEST, id="off the grid to the west"),
        pytest.param((0, 0), NORTH, id="off the grid at the first cell"),
        pytest.param((4, 4), EAST, id="off the grid at the last cell"),
        pytest.param((1, 2), EAST, id="into a no-fly cell"),
        pytest.param((2, 3), NORTH, id="into a no-fly cell from below"),
        pytest.param((3, 0), EAST, id="into a tall building"),
        pytest.param((2, 1), SOUTH, id="into a tall building from above"),
        pytest.param((2, 2), LAND, id="landing outside the zone"),
        pytest.param((1, 1), LAND, id="landing on a low building"),
    ],
)
def test_forbidden_actions_become_hovering_with_a_penalty(uav, action):
    state, outcome, reward, terms = step(start(uav), action)
    assert outcome.intervened[0] and not outcome.landed[0] and not outcome.crashed[0]
    assert state.uav_cell[0] == uav[0] * 5 + uav[1] and state.time_left[0] == 9
    assert terms["movement"] + terms["safety"] == pytest.approx(-1.2)
    hovered, hovering, hover_reward, _ = step(start(uav), HOVER)
    assert same_state(state, hovered) and np.array_equal(outcome.uploaded, hovering.uploaded)
    assert outcome.uploaded.sum() > 0 and reward == pytest.approx(hover_reward - 1.0)


def test_a_low_building_may_be_flown_over_but_hides_all_devices():
    state, outcome, _, _ = step(start((1, 0), [(1, 2)]), EAST)
    assert state.uav_cell[0] == 6 and not outcome.intervened[0]
    state, outcome, _, _ = step(start((1, 1), [(1, 2)]), HOVER)
    distance = math.sqrt(10**2 + 10**2)
    assert outcome.uploaded[0] == pytest.approx([rate(distance, 5, 3.64)] * 4, rel=1e-4)


def test_landing_in_the_zone_ends_the_episode_without_upload_at_no_cost():
    state, outcome, reward, terms = step(start((0, 0), [(0, 1)]), LAND)
    assert outcome.landed[0] and state.landed[0] and state.ended[0]
    assert not outcome.crashed[0] and not outcome.intervened[0]
    assert (outcome.served == -1).all() and (outcome.uploaded == 0).all()
    assert reward == 0 and set(terms.values()) == {0.0}
    assert state.time_left[0] == 9 and state.data_left[0, 0] == 5


def test_landing_with_the_last_unit_of_time_is_no_crash():
    state, outcome, reward, _ = step(start((0, 0), flying_time=1), LAND)
    assert state.landed[0] and state.time_left[0] == 0 and not outcome.crashed[0] and reward == 0


@pytest.mark.parametrize("action, expected", [(HOVER, -150.2), (EAST, -150.2), (LAND, -151.2)])
def test_out_of_time_is_a_crash_without_upload(action, expected):
    state, outcome, reward, terms = step(start((2, 3), flying_time=1), action)
    assert outcome.crashed[0] and not outcome.landed[0] and not state.landed[0]
    assert state.ended[0] and state.time_left[0] == 0
    assert (outcome.served == -1).all() and (outcome.uploaded == 0).all()
    assert state.data_left[0, 0] == 5 and terms["crash"] == -150
    assert reward == pytest.approx(expected, abs=1e-4)


def test_out_of_time_over_the_landing_zone_is_a_crash_too():
    _, outcome, reward, _ = step(start((0, 0), flying_time=1), HOVER)
    assert outcome.crashed[0] and reward == pytest.approx(-150.2, abs=1e-4)


@pytest.mark.parametrize("action", range(6))
@pytest.mark.parametrize("last, flying_time", [(LAND, 8), (HOVER, 1)])
def test_an_ended_episode_stays_as_it_is_with_no_reward(last, flying_time, action):
    ended, _, _, _ = step(start((0, 0), flying_time=flying_time), last)
    state, outcome, reward, terms = step(ended, action)
    assert same_state(state, ended)
    assert reward == 0 and set(terms.values()) == {0.0}
    assert (outcome.served == -1).all() and (outcome.uploaded == 0).all()
    flags = (outcome.intervened, outcome.landed, outcome.crashed, outcome.flew)
    assert not any(flag[0] for flag in flags)


def test_an_empty_device_is_never_served():
    _, outcome, _, _ = step(start((2, 2), [(2, 2), (2, 4)], [0.0, 5.0]), HOVER)
    assert (outcome.served == 1).all()
    distance = math.sqrt(20**2 + 10**2)
    assert outcome.uploaded[0] == pytest.approx([rate(distance, 5)] * 4, rel=1e-4)


def test_nothing_is_served_when_nothing_is_left():
    state = start((2, 2), [(2, 2), (2, 4)], [5.0, 5.0])
    state, outcome, reward, _ = step(replace(state, data_left=0 * state.data_left), HOVER)
    assert (outcome.served == -1).all() and (outcome.uploaded == 0).all()
    assert reward == pytest.approx(-0.2)


def test_the_device_with_the_highest_snr_is_served_not_the_nearest():
    # the second device is nearer but behind the low building; fading may turn the order round
    state = start((0, 1), [(0, 4), (2, 1)], [5.0, 5.0])
    _, outcome, _, _ = step(state, HOVER)
    assert (outcome.served == 0).all()
    environment = Environment(CITY)
    fading = np.zeros((1, 4, 4), np.float32)
    fading[0, 2, 1] = 10
    _, outcome = environment.transition(state, np.array([HOVER]), fading)
    assert outcome.served[0].tolist() == [0, 0, 1, 0]


def test_an_upload_is_capped_by_what_is_left_and_then_the_next_device_has_its_turn():
    full = rate(10, 5)
    state, outcome, reward, _ = step(start((2, 2), [(2, 2), (2, 4)], [1.5 * full, 9.0]), HOVER)
    other = rate(math.sqrt(20**2 + 10**2), 5)
    assert outcome.served[0].tolist() == [0, 0, 1, 1]
    assert outcome.uploaded[0] == pytest.approx([full, full / 2, other, other], rel=1e-4)
    assert state.data_left[0, 0] == 0
    assert reward == pytest.approx(1.5 * full + 2 * other - 0.2, rel=1e-4)


# From (1, 0) the building hides the device at (0, 2); from (0, 0) it does not.
CORNER = City.from_text("corner", "L . . . / . b . . / . . . . / . . . .".replace("/", "\n"))


@pytest.mark.parametrize(
    "slots, entered",
    [(1, [1]), (2, [1, 1]), (3, [0, 1, 1]), (4, [0, 1, 1, 1]), (5, [0, 0, 1, 1, 1])],
)
@pytest.mark.parametrize("uav, action", [((1, 0), NORTH), ((0, 0), SOUTH)])
def test_half_way_counts_as_in_the_cell_being_entered(uav, action, slots, entered):
    state = start(uav, [(0, 2)], [50.0], city=CORNER)
    _, outcome, _, _ = step(state, action, CORNER, slots=slots)
    expected = []
    for slot in range(1, slots + 1):
        row = uav[0] + slot / slots * (-1 if action == NORTH else 1)
        distance = math.sqrt((10 * row) ** 2 + 20**2 + 10**2)
        visible = bool(entered[slot - 1]) == (action == NORTH)
        expected.append(rate(distance, 4, 2.27 if visible else 3.64))
    assert outcome.uploaded[0] == pytest.approx(expected, rel=1e-4)


# Properties


@st.composite
def flights(draw):
    """An environment, three starts, and actions for three episodes."""
    city = draw(cities(3))
    most = draw(st.integers(1, min(5, len(city.device_cells))))
    least = draw(st.integers(1, most))
    low, high = sorted(draw(st.tuples(st.floats(0.01, 30), st.floats(0.01, 30))))
    shortest = draw(st.integers(1, 30))
    time = (shortest, shortest + draw(st.integers(0, 10)))
    scenario = Scenario("drawn", devices=(least, most), data=(low, high), flying_time=time)
    channel = Channel(slots=draw(st.integers(1, 5)), altitude_m=draw(st.floats(1, 50)))
    actions = draw(st.lists(st.tuples(*[st.integers(0, 5)] * 3), min_size=1, max_size=40))
    return Environment(city, channel), scenario, np.array(actions), draw(st.integers(0, 2**32))


@given(flights())
@settings(derandomize=True, deadline=None, max_examples=100)
def test_every_flight_keeps_the_rules(flight):
    environment, scenario, actions, seed = flight
    city, size = environment.city, environment.city.size
    generator = np.random.default_rng(seed)
    state = scenario.sample(city, 3, generator)
    collected = np.zeros(state.data_left.shape)
    for action in actions:
        before = state
        fading = environment.draw_fading(state, generator)
        state, outcome = environment.transition(state, action, fading)
        flying = ~before.ended
        assert (outcome.flew == flying).all()

        # the flight
        assert (state.time_left == before.time_left - flying).all()
        assert (state.time_left >= 0).all()
        assert ((state.uav_cell >= 0) & (state.uav_cell < size**2)).all()
        assert not city.no_fly.flat[state.uav_cell].any()
        rows, cols = np.divmod(state.uav_cell, size) - np.array(np.divmod(before.uav_cell, size))
        assert (abs(rows) + abs(cols) <= flying).all()
        assert (city.landing.flat[state.uav_cell] | ~state.landed).all()
        assert (state.landed == (before.landed | outcome.landed)).all()
        assert (outcome.crashed == (flying & (state.time_left == 0) & ~state.landed)).all()

        # the uploads: one device a slot, which has data; none in the step that ends the episode
        assert outcome.served.shape == outcome.uploaded.shape == fading.shape[:2]
        assert (outcome.uploaded >= 0).all()
        assert ((outcome.served >= 0) | (outcome.uploaded == 0)).all()
        assert ((outcome.served == -1) | ~state.ended[:, None]).all()
        for episode, slot in np.argwhere(outcome.served >= 0):
            device = outcome.served[episode, slot]
            had = before.data_left[episode, device]
            assert had > 0 and outcome.uploaded[episode, slot] <= had
            collected[episode, device] += outcome.uploaded[episode, slot]

        # the data
        assert np.array_equal(state.device_cells, before.device_cells)
        assert np.array_equal(state.data_initial, before.data_initial)
        assert (state.data_left >= 0).all() and (state.data_left <= before.data_left).all()
        np.testing.assert_allclose(state.data_left + collected, state.data_initial, atol=1e-3)
        np.testing.assert_allclose(state.data_collected, collected, atol=1e-3)
        ratio = collected.sum(1) / state.data_initial.sum(1)
        np.testing.assert_allclose(state.collection_ratio, ratio, rtol=1e-3, atol=1e-3)


# Starts of one's own


def test_a_placed_start_is_as_given():
    state = place(CITY, (4, 0), [(2, 4), (1, 3)], [5.0, 0.0], 12, max_devices=3)
    assert len(state) == 1 and state.uav_cell.tolist() == [20]
    assert state.time_left.tolist() == [12] and not state.landed[0] and not state.ended[0]
    assert state.device_cells[0, :2].tolist() == [14, 8], "a device may stand in a no-fly zone"
    assert state.data_left.tolist() == state.data_initial.tolist() == [[5.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    "change, message",
    [
        ({"devices": [(2, 4), (1, 1)]}, r"device 1 .*building.*\(1, 1\)"),
        ({"devices": [(3, 1), (2, 4)]}, r"device 0 .*building.*\(3, 1\)"),
        ({"devices": [(2, 4), (4, 0)]}, r"device 1 .*landing zone.*\(4, 0\)"),
        ({"devices": [(2, 4), (2, 4)]}, r"device 1 .*\(2, 4\).*another device"),
        ({"devices": [(2, 5), (2, 4)]}, r"device 0 .*\(2, 5\).*outside"),
        ({"devices": [(2, 4), (-1, 0)]}, r"device 1 .*\(-1, 0\).*outside"),
        ({"data": [5.0, -1.0]}, r"device 1 .*-1.* data"),
        ({"data": [math.nan, 5.0]}, r"device 0 .*nan data"),
        ({"data": [5.0, math.inf]}, r"device 1 .*inf data"),
        ({"data": [0.0, 0.0]}, r"no device has data"),
        ({"data": [5.0]}, r"2 devices but 1 "),
        ({"devices": [], "data": []}, r"0 devices"),
        ({"flying_time": 0}, r"flying time 0"),
        ({"flying_time": -3}, r"flying time -3"),
        ({"max_devices": 1}, r"2 devices.* 1; take some away$"),
        ({"uav": (1, 3)}, r"UAV .*\(1, 3\).*no-fly"),
        ({"uav": (3, 1)}, r"UAV .*\(3, 1\).*no-fly"),
        ({"uav": (5, 0)}, r"UAV .*\(5, 0\).*outside"),
    ],
)
def test_an_impossible_start_names_the_device_or_cell(change, message):
    good = {
        "city": CITY,
        "uav": (0, 0),
        "devices": [(2, 4), (4, 4)],
        "data": [5.0, 5.0],
        "flying_time": 10,
        "max_devices": 4,
    }
    place(**good)
    with pytest.raises(InputError, match=message):
        place(**good | change)


def test_concatenated_states_are_one_batch(corridor):
    first, second = (place(corridor, (2, 0), [(2, 3)], [5.0], time, 2) for time in (40, 39))
    both = State.concatenate([first, second])
    assert len(both) == 2 and both.time_left.tolist() == [40, 39]
    assert (both.device_cells == first.device_cells).all()
