"""With the failsafe nobody crashes; without it nothing changes."""

from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import LAND, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream

ONE = Scenario("one", devices=(1, 1))
CUT_OFF = City.from_text("cut off", "L.. \n NNN \n ...")
TWO_ZONES = City.from_text("two zones", "L.N. \n ..b. \n B.N. \n ...L")
MANY = (City.load("village"), City.from_text("tiny", "L. \n .b"), *CityGenerator(9).draw(2, 0))


def everything(environment):
    """Every cell, time left and action of every city, an episode each; the actions."""
    city, cell = np.nonzero(~environment.no_fly)
    most = int(environment.landing_distance.max()) + 3
    place, time, action = np.indices((len(cell), most, 6)).reshape(3, -1)
    changed = {"city": city[place], "uav_cell": cell[place], "time_left": time + 1}
    state = ONE.sample(environment, len(place), stream(Use.TEST))
    return replace(state, **{k: v.astype(np.int16) for k, v in changed.items()}), action


def landings(environment, most):
    """Whether a landing is possible, `[time left, city, cell]`, by trying everything."""
    city = np.arange(len(environment.cities))[:, None, None]
    possible = np.zeros((most + 1, *environment.landing.shape), bool)
    for time in range(1, most + 1):
        later = possible[time - 1][city, environment.next_cell].any(axis=2)
        possible[time] = environment.landing | later
    return possible


@pytest.mark.parametrize("cities", [CUT_OFF, TWO_ZONES, MANY], ids=["cut off", "two", "many"])
def test_it_replaces_what_makes_a_landing_impossible_and_nothing_else(cities):
    """Every cell, time left and action, against a search. So nobody crashes who need not."""
    plain, safe = Environment(cities), SafeEnvironment(cities)
    state, action = everything(plain)
    possible = landings(plain, state.time_left.max())
    fading = plain.draw_fading(state, stream(Use.FADING))
    after, outcome = plain.transition(state, action, fading)
    lost = possible[state.time_left, state.city, state.uav_cell] & ~after.landed
    lost &= ~possible[after.time_left, after.city, after.uav_cell]
    each = np.arange(len(state)), action
    assert np.array_equal(plain.allowed_actions(state)[each], ~outcome.intervened)
    assert np.array_equal(safe.allowed_actions(state)[each], ~outcome.intervened & ~lost)
    assert safe.allowed_actions(state).any(axis=1).all()

    # Instead there is a step of the way home, which costs nothing.
    instead = np.where(lost, plain.way_home[state.city, state.uav_cell], action)
    after, outcome = plain.transition(state, instead, fading)
    found, safe_outcome = safe.transition(state, action, fading)
    assert np.array_equal(safe_outcome.sent_home, lost)
    landed = replace(state, landed=np.ones(len(state), bool))
    assert not safe.transition(landed, action, fading)[1].sent_home.any()
    assert all(np.array_equal(vars(found)[name], values) for name, values in vars(after).items())
    for name, values in vars(outcome).items():
        assert np.array_equal(getattr(safe_outcome, name), values)


def test_its_random_actions_are_allowed_ones_all_equally_likely():
    safe = SafeEnvironment(MANY)
    states, _ = everything(safe)
    refused = Environment.allowed_actions(safe, states) & ~safe.allowed_actions(states)
    state = states[np.full(6000, (refused.sum(axis=1) == 2).argmax())]
    allowed, action = safe.allowed_actions(state), safe.random_actions(state, stream(Use.TRAINING))
    share = np.bincount(action, minlength=6) / 6000
    assert share == pytest.approx(allowed[0] / allowed[0].sum(), abs=0.04)
    assert not share[~allowed[0]].any()
    with pytest.raises(InputError, match="6 of episode 5999"):
        safe.step(state, np.append(action[1:], LAND + 1), stream(Use.TEST))


def test_the_records_say_whether_there_was_a_failsafe():
    """Random flights land with it; the rule never needs it."""
    scenario, city = find_scenario("manhattan"), load_city("manhattan")
    plain, safe = Environment(city), SafeEnvironment(city)
    without = evaluate(plain, Random(0), scenario, 100, seed=0).records()
    assert "sent_home" not in without and without["landed"].mean() < 0.95
    records = evaluate(safe, Random(0), scenario, 100, seed=0).records()
    assert (records["landed"] == 1).all() and records["sent_home"].sum() > 20
    expected = evaluate(plain, Greedy(plain), scenario, 300, seed=0).records()
    records = evaluate(safe, Greedy(safe), scenario, 300, seed=0).records()
    assert not records.pop("sent_home").any()
    assert all(np.array_equal(records[metric], expected[metric]) for metric in expected)
