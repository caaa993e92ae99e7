"""The genie finds the best flights there are, and what it expects is what the environment does."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from uavdh_lite.beyond import genie as search
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import HOVER, LAND, Environment, State
from uavdh_lite.evaluation import Policy, evaluate, fly
from uavdh_lite.missions import Mission
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream

CITY = City.from_text("small", "L.b. \n .N.. \n ..B. \n ....")
DEVICES = ("device_cells", "data_initial", "data_left")
OTHER = City.from_text("other", "..b \n .L. \n b..")


class Quiet(np.random.Generator):
    """Draws no fading: the channel's mean."""

    def __init__(self):
        super().__init__(np.random.PCG64(0))

    def standard_normal(self, size=None, dtype=np.float64, out=None):
        return np.zeros(size, dtype)


@pytest.fixture
def small():
    return Environment(CITY)


@pytest.fixture
def starts(small):
    """Two missions that differ in what they start from alone: opposite corners."""
    there = [(2, 3)], [20.0], 14
    return State.concatenate([Mission(CITY, at, *there).state for at in ((0, 0), (3, 0))])


def test_a_last_search_four_times_as_wide_finds_what_the_others_miss():
    environment = Environment(load_city("village"))
    start = find_scenario("village").sample(environment, 30, stream(Use.TEST))[[0]]
    narrow, wide = (Genie(environment, 1, grow).plans(start)[0] for grow in (False, True))
    assert (narrow.beam, wide.beam) == (1, 4) and wide.value > narrow.value + 0.1


def test_it_flies_and_lands_with_fading_in_several_cities():
    environment = Environment((CITY, OTHER))
    scenario = Scenario("s", "s", (1, 2), (3.0, 8.0), (8, 14))
    flights = evaluate(environment, Genie(environment), scenario, 40, seed=0)
    greedy = evaluate(environment, Greedy(environment), scenario, 40, seed=0)
    assert flights.end.landed.all() and not flights.counts["safety_interventions"].any()
    assert flights.returns.mean() > greedy.returns.mean()


def test_empty_places_of_a_state_do_not_count(small):
    """Sixty of them; the three devices with data are what is planned for."""
    few = Scenario("few", "small", (3, 3), (3.0, 8.0), (8, 14)).sample(small, 2, stream(Use.TEST))
    parts = {name: np.pad(getattr(few, name), ((0, 0), (0, 57))) for name in DEVICES}
    expected = [plan.actions.tolist() for plan in Genie(small).plans(few)]
    many = Genie(small).plans(replace(few, **parts))
    assert [plan.actions.tolist() for plan in many] == expected


@pytest.mark.parametrize("together", [2**17, 1])
def test_a_plan_does_not_depend_on_the_others_of_the_batch(together, monkeypatch):
    """Other cities, numbers of devices and flying times, all in one search or each in its own."""
    environment = Environment((CITY, OTHER))
    start = Scenario("s", "s", (1, 3), (3, 9), (6, 14)).sample(environment, 20, stream(Use.TEST))
    monkeypatch.setattr(search, "MOST_CANDIDATES", together)
    plans = Genie(environment).plans(start)
    for row in range(20):
        city = int(start.city[row])
        alone = replace(start[[row]], city=np.zeros(1, np.int16))
        (plan,) = Genie(Environment((environment.cities[city], CITY))).plans(alone)
        assert plan.value == plans[row].value
        assert plan.actions.tolist() == plans[row].actions.tolist()


def test_without_a_way_home_in_time_it_hovers(small, monkeypatch):
    monkeypatch.setattr(search, "REPLAN", 1)
    start = Mission(CITY, (3, 3), [(2, 0)], [5.0], 3, max_devices=2).state
    (plan,) = Genie(small).plans(start)
    assert plan.actions.tolist() == [HOVER] * 3 and plan.value == -np.inf
    assert fly(small, Genie(small), start, Quiet()).steps == 3


def test_without_fading_it_keeps_to_its_plan_and_gets_what_it_expects(small, starts, monkeypatch):
    plans = Genie(small).plans(starts)
    for replan in (1, 1000):
        monkeypatch.setattr(search, "REPLAN", replan)
        flown = fly(small, Genie(small), starts, Quiet())
        assert flown.returns.tolist() == pytest.approx([p.value for p in plans], abs=1e-3)
        for row, plan in enumerate(plans):
            steps = flown.steps[row]
            assert flown.trajectory(row).action.tolist() == plan.actions[:steps].tolist()
            assert (plan.actions[steps - 1 :] == LAND).all()
    assert np.array_equal(Genie(small).act(starts), [plan.actions[0] for plan in plans])


def test_it_plans_again_and_again_for_what_is_left(small, monkeypatch):
    """A device is empty sooner than planned: only who plans again comes home sooner."""
    start = Mission(CITY, (0, 0), [(3, 3)], [60.0], 14, max_devices=2).state
    later = replace(start, time_left=start.time_left - 2)
    lucky = replace(start, data_left=np.zeros_like(start.data_left), time_left=start.time_left - 4)
    for replan in (2, 4, 100):
        monkeypatch.setattr(search, "REPLAN", replan)
        policy = Genie(small).begin(start)
        assert policy.act(start) != LAND and policy.act(later) != LAND
        assert (policy.act(lucky) == LAND) == (replan < 100)


def test_flights_that_are_over_are_ignored_and_two_flights_do_not_mix(small, starts):
    genie = Genie(small)
    one, other = genie.begin(starts), genie.begin(starts[[1]])
    over = replace(starts, landed=np.array([True, False]), time_left=starts.time_left - [9, 0])
    assert one.act(over).tolist() == [HOVER, *other.act(starts[[1]])]
    assert genie.act(replace(starts, landed=np.ones(2, bool))).tolist() == [HOVER] * 2


class Sequences(Policy):
    def __init__(self, actions):
        self.left = iter(actions.T)

    def act(self, state):
        return next(self.left)


def test_it_finds_the_best_of_all_flights(small, generator):
    """Against every sequence of actions, flown without fading; some devices are already empty."""
    scenario = Scenario("s", "s", (1, 3), (3.0, 12.0), (4, 5))
    states = scenario.sample_anywhere(small, 40, generator, 1)
    states = states[states.time_left <= 5]
    assert len(states) > 20
    for row, plan in enumerate(Genie(small, beam=10_000).plans(states)):
        actions = np.array(list(product(range(6), repeat=int(states.time_left[row]))))
        start = states[np.full(len(actions), row)]
        flights = fly(small, Sequences(actions), start, Quiet())
        assert plan.value == pytest.approx(flights.returns.max(), abs=2e-3)
