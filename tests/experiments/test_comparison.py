import json

import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.comparison import (
    breakdown,
    compare,
    entrants,
    save_comparison,
    share,
    summary,
)
from uavdh_lite.planners import Genie, Greedy
from uavdh_lite.scenario import SCENARIOS, Scenario
from uavdh_lite.storage import read_table


@pytest.fixture(scope="module")
def village():
    return Environment(City.load("village")), SCENARIOS["village"]


@pytest.mark.parametrize(("jobs", "chunk"), [(1, 40), (1, 7), (2, 13)])
def test_parts_and_processes_change_nothing(village, jobs, chunk):
    environment, scenario = village
    policies = {"greedy": lambda: Greedy(environment), "genie": lambda: Genie(environment)}
    results = compare(environment, scenario, policies, 20, seed=4, jobs=jobs, chunk=chunk)
    for name, policy in policies.items():
        flights = evaluate(environment, policy(), scenario, 20, seed=4)
        for metric, values in flights.records().items():
            np.testing.assert_array_equal(results[name][metric], values)
        data = flights.start.data_initial
        np.testing.assert_array_equal(results[name]["flying_time"], flights.start.time_left)
        np.testing.assert_allclose(results[name]["data"], data.sum(axis=1))
        np.testing.assert_array_equal(results[name]["devices"], (data > 0).sum(axis=1))


def test_over_several_cities_each_episode_names_its_city():
    cities = CityGenerator((8, 8)).draw(3, seed=5)
    environment, scenario = Environment(cities), Scenario("few", devices=(1, 2))
    policies = {"greedy": lambda: Greedy(environment)}
    results = compare(environment, scenario, policies, 20, seed=4, chunk=7)
    flights = evaluate(environment, Greedy(environment), scenario, 20, seed=4)
    expected = [cities[c].name for c in cities.city[flights.start.uav_cell]]
    assert results["greedy"]["city"].tolist() == expected and len(set(expected)) == 3


def test_the_genie_beats_greedy_at_what_it_is_asked_for():
    environment, scenario = Environment(City.load("open_field")), SCENARIOS["open_field"]
    policies = {
        "greedy": lambda: Greedy(environment),
        "return": lambda: Genie(environment),
        "data": lambda: Genie(environment, time_cost=0.01),
    }
    results = compare(environment, scenario, policies, 12, seed=0)
    reward = {name: each["cumulative_reward"].mean() for name, each in results.items()}
    data = {name: each["collection_ratio_and_landed"].mean() for name, each in results.items()}
    assert reward["return"] > max(reward["greedy"], reward["data"])
    assert data["data"] >= data["greedy"] - 1e-6 and data["data"] > data["return"]


def test_share_pairs_the_episodes(generator):
    reference = generator.uniform(1, 100, 200)
    exact = share(0.9 * reference, reference)
    assert exact == pytest.approx((0.9, 0.9, 0.9))  # unpaired, it would be some 0.9 ± 0.1
    assert share(0.9 * reference, reference, np.arange(200) // 9) == pytest.approx((0.9, 0.9, 0.9))
    noisy = share(0.9 * reference + generator.normal(0, 5, 200), reference)
    assert noisy.low < noisy.mean < noisy.high


def test_breakdown_by_few_values_and_by_ranges():
    by = np.repeat([2, 3, 5], [10, 20, 30])
    groups = breakdown(by * 0.1, by)
    assert [(label, count) for label, count, _ in groups] == [("2", 10), ("3", 20), ("5", 30)]
    assert [round(mean.mean, 6) for _, _, mean in groups] == [0.2, 0.3, 0.5]
    by = np.arange(100)
    groups = breakdown(by.astype(float), by)
    assert [label for label, _, _ in groups] == ["0 to 24", "25 to 49", "50 to 74", "75 to 99"]
    assert [mean.mean for _, _, mean in groups] == [12, 37, 62, 87]


@pytest.fixture(scope="module")
def results(village):
    environment, scenario = village
    policies = entrants(environment, Greedy(environment), seed=3, replan=50)
    return compare(environment, scenario, policies, 6, seed=0)


def test_entrants_are_the_agent_two_planners_and_two_genies(village, results):
    environment, _ = village
    made = {name: make() for name, make in entrants(environment, None, 3, 7).items()}
    assert list(made) == list(results) == ["agent", "random", "greedy", "genie", "genie_data"]
    assert made["genie"].replan == made["genie_data"].replan == 7
    assert made["genie_data"].time_cost == 0.01 < made["genie"].time_cost
    for metric, values in results["agent"].items():  # greedy in the agent's place
        np.testing.assert_array_equal(values, results["greedy"][metric])


def test_a_comparison_is_kept_as_a_table_and_how_it_was_made(results, tmp_path):
    save_comparison(tmp_path / "a.csv.gz", results, {"command": "a command"})
    table = read_table(tmp_path / "a.csv.gz")
    assert list(table)[:5] == ["policy", "episode", "devices", "flying_time", "data"]
    for policy, columns in results.items():
        of_policy = table["policy"] == policy
        assert table["episode"][of_policy].tolist() == list(range(6))
        for name, column in columns.items():
            np.testing.assert_allclose(table[name][of_policy], column, rtol=1e-5)
    assert json.loads((tmp_path / "a.json").read_text()) == {"command": "a command"}


def test_the_summary_has_all_policies_and_the_agents_share(results):
    lines = summary(results).splitlines()
    assert [line.split()[0] for line in lines[1:6]] == list(results)
    landed = results["genie"]["has_landed"].mean()
    assert lines[4].split()[1] == f"{landed:.4f}"
    assert lines[6].startswith(
        "agent's collection_ratio_and_landed as a share of the genie_data's:"
    )
    part = share(results["agent"]["cumulative_reward"], results["genie"]["cumulative_reward"])
    assert lines[7].endswith(f"{part.mean:.4f} ({part.low:.4f} to {part.high:.4f})")
    assert sum(line.startswith(("devices", "flying_time", "data")) for line in lines) >= 3


def test_groups_are_named_by_their_ends_or_their_words():
    by = np.repeat([1, 2, 3, 4, 5, 6], [6, 3, 3, 6, 3, 3])
    labels = [label for label, _, _ in breakdown(np.arange(24.0), by)]
    assert labels == ["1", "2 to 3", "4", "5 to 6"]
    kinds = np.array(["old_town", "blocks", "old_town"])
    words = breakdown(np.array([1.0, 5.0, 3.0]), kinds)
    assert [(label, count, mean.mean) for label, count, mean in words] == [
        ("blocks", 1, 5.0),
        ("old town", 2, 2.0),
    ]
