import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.environment import EAST, HOVER, LAND, WEST, Environment, Rewards
from uavdh_lite.evaluation import (
    bootstrap_interval,
    evaluate,
    fly,
    mean_interval,
    wilson_interval,
)
from uavdh_lite.scenario import SCENARIOS, place
from uavdh_lite.streams import Use, stream


@pytest.fixture(scope="module")
def manhattan():
    return Environment(City.load("manhattan"))


def random_policy(seed):
    generator = np.random.default_rng(seed)
    return lambda state: generator.integers(0, 6, len(state))


def hover(state):
    return np.full(len(state), HOVER)


def land(state):
    return np.full(len(state), LAND)


def test_metrics_of_landing_at_once_and_of_never_landing(manhattan):
    scenario = SCENARIOS["manhattan"]
    at_once = evaluate(manhattan, land, scenario, 50, seed=1).records()
    assert (at_once["has_landed"] == 1).all()
    assert not at_once["collection_ratio"].any() and not at_once["cumulative_reward"].any()
    assert (
        at_once["time_used"] == 1 / evaluate(manhattan, land, scenario, 50, 1).start.time_left
    ).all()

    never = evaluate(manhattan, hover, scenario, 50, seed=1)
    records = never.records()
    assert not records["has_landed"].any() and not records["collection_ratio_and_landed"].any()
    assert (records["time_used"] == 1).all()
    data = never.end.data_collected.sum(1)
    expected = data - 0.2 * never.steps - 150
    assert records["cumulative_reward"] == pytest.approx(expected, rel=1e-4)
    assert records["collection_ratio"] == pytest.approx(data / never.start.data_initial.sum(1))


def test_trajectory_of_a_hand_flown_episode(corridor):
    environment = Environment(corridor)
    start = place(corridor, (2, 0), [(2, 2)], [1.5], 9, max_devices=2)
    actions = iter([EAST, EAST, HOVER, WEST, WEST, LAND])
    flights = fly(
        environment,
        lambda state: np.array([next(actions)]),
        start,
        stream(Use.TEST, 0),
        record=True,
    )
    flight = flights.trajectory(0)
    assert flight.uav_cell.tolist() == [10, 11, 12, 12, 11, 10, 10]
    assert flight.time_left.tolist() == [9, 8, 7, 6, 5, 4, 3]
    assert flight.action.tolist() == [EAST, EAST, HOVER, WEST, WEST, LAND]
    assert flight.landed
    assert flight.data_left[0].tolist() == [1.5, 0] and flight.data_left[-1].tolist() == [0, 0]
    assert flight.uploaded.sum() == pytest.approx(1.5)
    assert flight.reward.sum() == pytest.approx(1.5 - 5 * 0.2)
    assert flight.reward.sum() == pytest.approx(flights.cumulative_reward[0])


def test_trajectories_without_recording_say_what_to_do(manhattan):
    flights = evaluate(manhattan, land, SCENARIOS["manhattan"], 2, seed=1)
    with pytest.raises(ValueError, match="record=True"):
        flights.trajectory(0)


def test_same_seed_same_scenarios_and_fading_whatever_the_policy(manhattan):
    """The first hovering step meets the same fading, however long the other episodes last."""
    scenario = SCENARIOS["manhattan"]

    def hover_then(action):
        return lambda state: np.where(np.arange(len(state)) == 0, HOVER, action)

    long = evaluate(manhattan, hover_then(HOVER), scenario, 20, seed=5)
    short = evaluate(manhattan, hover_then(LAND), scenario, 20, seed=5)
    assert (long.start.device_cells == short.start.device_cells).all()
    assert long.cumulative_reward[0] == short.cumulative_reward[0]
    assert long.steps[0] == short.steps[0] > 1 and (short.steps[1:] == 1).all()


def test_results_repeat_with_the_seed_and_change_with_it(manhattan):
    def rewards(seed):
        flights = evaluate(manhattan, random_policy(0), SCENARIOS["manhattan"], 100, seed)
        return flights.cumulative_reward.tolist()

    assert rewards(3) == rewards(3) != rewards(4)


def test_training_validation_and_test_never_share_draws():
    draws = {stream(use, 0).random() for use in (Use.TRAINING, Use.VALIDATION, Use.TEST)}
    assert len(draws) == 3


def test_cumulative_reward_takes_the_rewards_given(manhattan):
    start = SCENARIOS["manhattan"].sample(manhattan.city, 10, stream(Use.TEST, 0))
    gentle = fly(manhattan, hover, start, stream(Use.TEST, 1), Rewards(crash=-10))
    paper = fly(manhattan, hover, start, stream(Use.TEST, 1))
    assert gentle.cumulative_reward - paper.cumulative_reward == pytest.approx(140, rel=1e-4)


def test_bootstrap_interval_is_that_of_the_normal_approximation(generator):
    values = generator.normal(10, 2, 1000)
    mean, low, high = bootstrap_interval(values)
    half = 1.96 * values.std() / np.sqrt(1000)
    assert mean == pytest.approx(values.mean())
    assert (low, high) == pytest.approx((mean - half, mean + half), abs=0.15 * half)


def test_bootstrap_interval_covers_the_truth_about_95_times_in_100(generator):
    covered = 0
    for _ in range(200):
        _, low, high = bootstrap_interval(generator.random(100), resamples=400)
        covered += low <= 0.5 <= high
    assert 178 <= covered <= 199


def test_bootstrap_interval_of_groups_draws_whole_groups_again(generator):
    """Fifty values, each of them ten times, are no more than fifty values."""
    once = generator.normal(10, 2, 50)
    values, groups = np.repeat(once, 10), np.repeat(generator.permutation(50), 10)
    mean, low, high = bootstrap_interval(values, groups=groups)
    half = 1.96 * once.std() / np.sqrt(50)
    assert (mean, low, high) == pytest.approx((once.mean(), mean - half, mean + half), abs=0.07)
    each = bootstrap_interval(values, groups=np.arange(500))
    assert each.high - each.low == pytest.approx(2 * half / np.sqrt(10), rel=0.1)
    uneven = bootstrap_interval(np.array([0.0, 3.0, 3.0]), groups=np.array([7, -1, -1]))
    assert uneven == (2, 0, 3)  # each draw of two groups: 0, 2 or 3


def test_bootstrap_interval_of_equal_values_is_a_point():
    assert bootstrap_interval(np.ones(20)) == (1, 1, 1)


def test_wilson_interval_of_three_crashes_in_a_thousand():
    """The values that tables and other programs give."""
    landed = np.r_[np.zeros(3), np.ones(997)]
    assert wilson_interval(landed) == pytest.approx((0.997, 0.99122, 0.99898), abs=1e-5)
    assert wilson_interval(np.ones(1000)) == pytest.approx((1, 0.99617, 1), abs=1e-5)
    assert wilson_interval(np.zeros(10)) == pytest.approx((0, 0, 0.27753), abs=1e-5)


def test_shares_get_wilsons_interval_and_other_means_the_bootstraps(generator):
    ones, others = np.ones(50), generator.random(50)
    assert mean_interval(ones) == wilson_interval(ones)
    assert mean_interval(others) == bootstrap_interval(others)
