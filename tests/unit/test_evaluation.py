from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.environment import EAST, HOVER, LAND, WEST, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import (
    FunctionPolicy,
    Policy,
    bootstrap_interval,
    evaluate,
    fly,
    groups_interval,
    mean_interval,
    wilson_interval,
)
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.streams import Use, stream


class Plan(Policy):
    """An action for each step, of all or of each; it remembers how far the flights begun are."""

    def __init__(self, actions):
        self.actions = actions

    def begin(self, start):
        plan = Plan(self.actions)
        plan.left = iter(self.actions)
        return plan

    def act(self, state):
        return np.broadcast_to(next(self.left), len(state))


@pytest.fixture
def environment(corridor):
    return Environment(corridor)


@pytest.fixture
def start(environment, corridor_scenario, generator):
    """At the west end of the street, 1.5 data units two cells to its east, 9 units of time."""
    data = np.array([[1.5]], np.float32)
    place = {"time_left": np.array([9], np.int16), "device_cells": np.array([[12]], np.int16)}
    sampled = corridor_scenario.sample(environment, 1, generator)
    return replace(sampled, **place, data_initial=data, data_left=data)


def test_metrics_of_landing_at_once_and_of_never_landing(environment, corridor_scenario):
    at_once = evaluate(environment, Plan([LAND]), corridor_scenario, 50, seed=1)
    records = at_once.records()
    assert (records["landed"] == 1).all() and not records["collected"].any()
    assert not records["return"].any() and not records["safety_interventions"].any()
    assert np.array_equal(records["time_used"], 1 / at_once.start.time_left)

    never = evaluate(environment, Plan([WEST] * 20), corridor_scenario, 50, seed=1)
    records, data = never.records(), never.end.data_collected.sum(1)
    assert not records["landed"].any() and not records["collected_and_landed"].any()
    assert (records["time_used"] == 1).all() and data.min() > 0
    assert np.array_equal(records["safety_interventions"], never.start.time_left)
    assert records["return"] == pytest.approx(data - 1.2 * never.steps - 150, rel=1e-4)
    assert records["collected"] == pytest.approx(data / never.start.data_initial.sum(1))


class AlwaysEast(Policy):
    """As a student writes it: with an environment, and nothing said of what it is made for."""

    def __init__(self, environment):
        self.environment = environment

    def act(self, state):
        return np.full(len(state), EAST)


@pytest.mark.parametrize("kind", ["agent", "greedy", "genie", "student"])
def test_a_policy_made_for_other_cities_is_refused(kind, corridor, corridor_scenario, trainer):
    """The cells decide, whatever the names are."""
    agent = trainer().agent
    over = {"greedy": Greedy, "genie": Genie, "student": AlwaysEast}
    make = over.get(kind, lambda environment: agent.over(environment.cities))
    turned = replace(corridor, landing=corridor.landing[:, ::-1])
    tiny, both = corridor.from_text("tiny", "L . \n . ."), (corridor, turned)
    for own, elsewhere in permutations((corridor, turned, both, both[::-1], tiny), 2):
        with pytest.raises(InputError, match=r"is made for .*agent\.over\(city\).*--city"):
            evaluate(Environment(elsewhere), make(Environment(own)), corridor_scenario, 3, seed=1)
    renamed = Environment(replace(corridor, name="other"))
    assert len(evaluate(renamed, make(Environment(corridor)), corridor_scenario, 3, 1).start) == 3


def test_a_policy_of_a_function_flies_anywhere(environment, corridor_scenario):
    policy = FunctionPolicy(lambda state: np.full(len(state), HOVER))
    assert policy.made_for() is None and Random(0).made_for() is None
    end = evaluate(environment, policy, corridor_scenario, 3, seed=1).end
    assert end.ended.all() and policy.act(end).tolist() == [HOVER] * 3  # nobody is asked any more


def test_a_flight_by_hand(environment, start):
    """Each flight begins the policy anew."""
    actions = [EAST, EAST, HOVER, WEST, WEST, LAND]
    plan = Plan(actions)
    for _ in range(2):
        flights = fly(environment, plan, start, stream(Use.TEST))
        assert flights.returns[0] == pytest.approx(1.5 - 5 * 0.2)
    flight = flights.trajectory(0)
    assert flight.uav_cell.tolist() == [10, 11, 12, 12, 11, 10, 10]
    assert flight.time_left.tolist() == [9, 8, 7, 6, 5, 4, 3]
    assert flight.action.tolist() == actions and flight.landed
    assert flight.data_left[[0, -1]].tolist() == [[1.5], [0]]
    assert flight.reward.sum() == pytest.approx(0.5)
    assert flights.records()["collected_and_landed"] == 1


def test_a_seed_fixes_missions_and_fading_whatever_the_policy_does(environment, corridor_scenario):
    """The first episode hovers and meets the same fading, however long the others last."""
    long, short, other = (
        evaluate(environment, Plan([[HOVER, *[action] * 19]] * 20), corridor_scenario, 20, seed)
        for action, seed in ((HOVER, 5), (LAND, 5), (HOVER, 6))
    )
    assert np.array_equal(long.start.device_cells, short.start.device_cells)
    assert long.returns[0] == short.returns[0] != other.returns[0]
    assert long.steps[0] == short.steps[0] > 1 and (short.steps[1:] == 1).all()
    assert short.trajectory(1).action.tolist() == [LAND]  # its own steps alone


def test_bootstrap_interval_is_that_of_the_normal_approximation(generator):
    values = generator.normal(10, 2, 1000)
    half = 1.96 * values.std() / np.sqrt(1000)
    mean, low, high = bootstrap_interval(values)
    assert mean == pytest.approx(values.mean())
    assert (low, high) == pytest.approx((mean - half, mean + half), abs=0.15 * half)


def test_the_interval_of_groups_is_students_over_their_means():
    """By hand for groups of one size: means 1, 2 and 6, s = √7, half = 4.3027 · √(7/3)."""
    values, groups = np.array([0.0, 2, 2, 2, 5, 7]), np.array([4, 4, -1, -1, 0, 0])
    assert groups_interval(values, groups) == pytest.approx((3, 3 - 6.5724, 3 + 6.5724), abs=1e-3)


def test_intervals_over_cities_contain_the_true_mean_in_19_of_20_studies():
    """240 missions over 12 cities, whose numbers of missions differ, too."""
    generator, found = np.random.default_rng(1), 0
    for _ in range(1000):
        city = generator.integers(0, 12, 240)
        values = generator.normal(0, 1, 12)[city] + generator.normal(0, 2, 240)
        interval = mean_interval(values, city)
        found += interval.low <= 0 <= interval.high
    assert 0.93 <= found / 1000 <= 0.98


def test_over_several_cities_whole_cities_count(corridor, corridor_scenario):
    """In the twin no device can be reached in time: all episodes of a city are alike."""
    far = corridor.from_text("far", "B B B B B\nL B B B B\n" + 3 * ". . . . .\n")
    both = Environment((corridor, far))
    flights = evaluate(both, Greedy(both), corridor_scenario, 300, seed=2)
    found, records, cities = flights.metrics(), flights.records(), flights.start.city
    assert set(cities) == {0, 1}
    for name, values in records.items():
        assert found[name] == mean_interval(values, cities)
    means = [records["return"][cities == city].mean() for city in (0, 1)]
    assert found["return"].high - found["return"].low > 10 * abs(np.diff(means))[0]  # t = 12.7
    alone = Environment(corridor)
    one = evaluate(alone, Greedy(alone), corridor_scenario, 300, seed=2)
    assert one.metrics()["landed"] == wilson_interval(one.records()["landed"])


def test_values_of_one_group_are_independent(generator):
    values, landed = generator.random(50), np.r_[np.zeros(3), np.ones(47)]
    assert mean_interval(values, np.zeros(50, int)) == bootstrap_interval(values)
    assert mean_interval(landed, np.zeros(50, int)) == wilson_interval(landed)
    groups = np.arange(50) // 9
    mean, low, high = groups_interval(landed, groups)
    assert high > 1 and mean_interval(landed, groups) == (mean, low, 1)


def test_shares_get_wilsons_interval_as_in_the_tables(generator):
    landed = np.r_[np.zeros(3), np.ones(997)]
    assert mean_interval(landed) == pytest.approx((0.997, 0.99122, 0.99898), abs=1e-5)
    assert wilson_interval(np.ones(1000)) == pytest.approx((1, 0.99617, 1), abs=1e-5)
    others = generator.random(50)
    assert mean_interval(others) == bootstrap_interval(others)
    assert mean_interval(np.ones(1)) == (1, 1, 1)
