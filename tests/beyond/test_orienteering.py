from itertools import permutations

import pytest

from uavdh_lite import registry
from uavdh_lite.beyond.orienteering import Orienteering
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import Scenario, find_scenario

ENVIRONMENT = Environment(load_cities("manhattan"))


def slow_first(rule, state, row):
    """The place that the rule should make for, by trying every order; None if there is none."""
    cell, left = int(state.uav_cell[row]), state.data_left[row]
    goals = rule.approach[0, state.device_cells[row]]
    best, first = (0.0, 0.0), None
    for length in range(1, len(goals) + 1):
        for order in permutations(range(len(goals)), length):
            time, here = 0, cell
            for device in order:
                time += int(rule.moves[0, here, goals[device]]) + 1
                here = goals[device]
            time += int(ENVIRONMENT.time_to_land[0, here])
            score = (float(left[list(order)].sum()), -time)
            if time <= state.time_left[row] and score > best:
                best, first = score, goals[order[0]]
    return first


def test_it_makes_for_the_first_device_of_the_best_order(generator):
    scenario = Scenario("few", "manhattan", (1, 4), (1.0, 20.0), (8, 40))
    start = scenario.sample_anywhere(ENVIRONMENT, 300, generator, 0)
    rule = registry.find("policy", "orienteering")(ENVIRONMENT, 0)
    action, greedy = rule.act(start), Greedy(ENVIRONMENT).act(start)
    kinds = set()
    for row in range(300):
        first, one = slow_first(rule, start, row), start[[row]]
        goal = None if first is None else first.reshape(1)
        kinds.add(first is None)
        expected = greedy[row] if first is None else rule.towards(one.city, one.uav_cell, goal)
        assert action[row] == expected
    assert kinds == {True, False}


def test_it_lands_always_and_brings_about_what_greedy_brings():
    scenario = find_scenario("manhattan")
    flights = [
        evaluate(ENVIRONMENT, rule(ENVIRONMENT), scenario, 300, 3)
        for rule in (Orienteering, Greedy)
    ]
    assert flights[0].end.landed.all()
    ours, theirs = (f.returns.mean() for f in flights)
    assert abs(ours - theirs) < 1


def test_more_devices_than_it_can_order_are_refused(generator):
    many = Scenario("many", "manhattan", (7, 7), (1.0, 20.0), (35, 40))
    with pytest.raises(InputError, match="7 devices: at most 6"):
        fly(
            ENVIRONMENT,
            Orienteering(ENVIRONMENT),
            many.sample(ENVIRONMENT, 2, generator),
            generator,
        )
