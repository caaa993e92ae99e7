"""The ladder's intervals, and its rows on the same missions."""

from itertools import permutations

import numpy as np
import pytest

from benchmarks import ladder
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate, mean_interval
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.storage import read_table


def test_the_recorded_rows_say_what_they_know_and_are_ahead_of_greedy_in_pairs():
    table = read_table(ladder.OUT)
    rows = {(s, r): i for i, (s, r) in enumerate(zip(table["scenario"], table["row"], strict=True))}
    for row in ladder.ROWS:
        for scenario in row.maps:
            at = rows[scenario, row.name]
            knows = {what for what in ladder.KNOWS if table[f"knows_{what}"][at]}
            assert knows == set(row.knows)
            if not row.slow:
                greedy = table["return"][rows[scenario, "greedy"]]
                ahead = table["return"][at] - greedy
                assert table["return_ahead"][at] == pytest.approx(ahead, abs=2e-4)


def test_agents_and_rules_fly_as_many_missions_as_are_asked_for():
    rows = {row.name: row for row in ladder.ROWS}
    (name, *_) = ladder.policies(rows["ddqn"], "manhattan")
    for row, policy in (("greedy", "greedy"), ("ddqn", name)):
        records, steps = ladder.fly(rows[row], policy, "manhattan", 20)
        assert (steps > 0) == (row == "ddqn") and records.shape == (len(ladder.METRICS), 20)


def test_an_agent_of_another_city_is_refused_whatever_its_file_is_called():
    row = ladder.Row("copied", (), agents="ddqn-{}-lite-*")
    with pytest.raises(InputError, match=r"was trained in manhattan .*, not in open_field"):
        ladder.fly(row, "data/checkpoints/manhattan.safetensors", "open_field", 2)


def test_the_interval_of_runs_is_students_where_runs_alone_differ():
    """The same three runs on each of two missions: the half is that of their means."""
    values = np.array([[1.0, 1.0], [2.0, 2.0], [6.0, 6.0]])
    assert ladder.runs_interval(values) == pytest.approx((3, 3 - 6.5724, 3 + 6.5724), abs=1e-3)
    alike = np.random.default_rng(0).normal(size=400) * np.ones((3, 1))
    half = ladder.runs_interval(alike).high - alike.mean()
    assert half == pytest.approx(1.966 * alike[0].std(ddof=1) / 20, rel=1e-3)
    assert ladder.runs_interval(alike[:1]) == mean_interval(alike[0])


@pytest.mark.parametrize(("of_runs", "of_missions"), [(1.0, 1.0), (0.3, 10.0), (0.0, 3.0)])
def test_intervals_contain_the_true_mean_in_19_of_20_studies(of_runs, of_missions):
    generator, found = np.random.default_rng(1), 0
    for _ in range(1000):
        values = generator.normal(0, of_runs, (3, 1)) + generator.normal(0, of_missions, 100)
        interval = ladder.runs_interval(values + generator.normal(0, 1, values.shape))
        found += interval.low <= 0 <= interval.high
    assert 0.93 <= found / 1000 <= 0.98


MANHATTAN = environment_of("manhattan")


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
            time += int(MANHATTAN.time_to_land[0, here])
            score = (float(left[list(order)].sum()), -time)
            if time <= state.time_left[row] and score > best:
                best, first = score, goals[order[0]]
    return first


def test_orienteering_makes_for_the_first_device_of_the_best_order(generator):
    """Time decides among equals alone: here a long way brings a tenth of a unit more."""
    scenario = Scenario("few", "manhattan", (1, 4), (0.1, 0.4), (8, 40))
    start = scenario.sample_anywhere(MANHATTAN, 300, generator, 0)
    rule = ladder.Orienteering(MANHATTAN)
    action, greedy = rule.act(start), Greedy(MANHATTAN).act(start)
    kinds = set()
    for row in range(300):
        first, one = slow_first(rule, start, row), start[[row]]
        goal = None if first is None else first.reshape(1)
        kinds.add(first is None)
        expected = greedy[row] if first is None else rule.towards(one.city, one.uav_cell, goal)
        assert action[row] == expected
    assert kinds == {True, False}
    flights = evaluate(MANHATTAN, rule, find_scenario("manhattan"), 100, 3)
    assert flights.end.landed.all()
