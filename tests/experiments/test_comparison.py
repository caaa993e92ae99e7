import json
from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.city import City, load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate, mean_interval
from uavdh_lite.experiments.comparison import breakdown, compare, save_comparison
from uavdh_lite.planners import Greedy
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.storage import read_table

VILLAGE, SCENARIO = Environment(City.load("village")), find_scenario("village")


def entrants():
    return {name: find_policy(name, VILLAGE, 3) for name in ("random", "greedy", "genie")}


@pytest.fixture(scope="module")
def results():
    return compare(VILLAGE, SCENARIO, entrants(), 12, seed=4)


def test_every_policy_flies_the_missions_of_evaluate(results):
    """In this process or in others; a random policy too has the same draws."""
    again = compare(VILLAGE, SCENARIO, entrants(), 12, seed=4, jobs=2)
    assert list(again) == list(results) == ["random", "greedy", "genie"]
    for name, policy in entrants().items():
        flights = evaluate(VILLAGE, policy, SCENARIO, 12, seed=4)
        for metric, values in flights.records().items():
            np.testing.assert_array_equal(results[name][metric], values)
            np.testing.assert_array_equal(again[name][metric], values)
        data = flights.start.data_initial
        np.testing.assert_array_equal(again[name]["flying_time"], flights.start.time_left)
        np.testing.assert_allclose(again[name]["data"], data.sum(axis=1))
        np.testing.assert_array_equal(again[name]["devices"], (data > 0).sum(axis=1))


def test_over_several_cities_each_episode_names_its_city_and_of_equal_names_the_number():
    cities = load_cities("random:3:5:8")
    environment, scenario = Environment(cities), Scenario("few", devices=(1, 2))
    found = compare(environment, scenario, {"greedy": Greedy(environment)}, 20, seed=4)
    flights = evaluate(environment, Greedy(environment), scenario, 20, seed=4)
    expected = [cities[c].name for c in flights.start.city]
    assert found["greedy"]["city"].tolist() == expected and len(set(expected)) == 3
    alike = Environment(tuple(replace(city, name="x") for city in cities))
    found = compare(alike, scenario, {"greedy": Greedy(alike)}, 20, seed=4)
    assert found["greedy"]["city"].tolist() == [f"x {c}" for c in flights.start.city]


@pytest.mark.parametrize(
    ("by", "labels", "counts"),
    [
        (np.repeat(range(5), [9, 20, 30, 1, 1]), [*"01234"], [9, 20, 30, 1, 1]),
        # An edge, such as 10, begins a range
        (np.arange(41), ["0 to 9", "10 to 19", "20 to 29", "30 to 40"], [10, 10, 10, 11]),
        (np.array(["old_town", "blocks", "old_town"]), ["blocks", "old_town"], [1, 2]),
    ],
)
def test_breakdown_by_values_words_and_ranges(by, labels, counts):
    values = np.arange(float(len(by)))
    groups = breakdown(values, by)
    assert [(label, count) for label, count, _ in groups] == list(zip(labels, counts, strict=True))
    assert sum(count * mean.mean for _, count, mean in groups) == pytest.approx(values.sum())


def test_in_each_part_of_a_breakdown_whole_cities_count(generator):
    by, city = np.repeat([2, 3], 50), np.tile(np.repeat(["a", "b"], 25), 2)
    values = 10.0 * (city == "b") + generator.random(100)
    for (_, _, apart), (_, _, together), part in zip(
        breakdown(values, by), breakdown(values, by, city), (by == 2, by == 3), strict=True
    ):
        assert together == mean_interval(values[part], city[part])
        assert together.high - together.low > 9 > 4 > apart.high - apart.low


def test_a_comparison_is_kept_as_a_table_and_how_it_was_made(results, tmp_path):
    save_comparison(tmp_path / "a.b.csv", results, {"command": "another"})
    save_comparison(tmp_path / "a.CSV.gz", results, {"command": "a command"})
    table = read_table(tmp_path / "a.CSV.gz")
    assert list(table)[:5] == ["policy", "episode", "devices", "flying_time", "data"]
    for policy, flown in results.items():
        of_policy = table["policy"] == policy
        assert table["episode"][of_policy].tolist() == list(range(12))
        for name, column in flown.items():
            np.testing.assert_allclose(table[name][of_policy], column, rtol=1e-5)
    assert json.loads((tmp_path / "a.json").read_text()) == {"command": "a command"}
    assert json.loads((tmp_path / "a.b.json").read_text()) == {"command": "another"}
