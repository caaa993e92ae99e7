"""The Gymnasium environments: the checkers pass, and both are the library's simulator."""

import subprocess
import sys
from dataclasses import replace
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv
from numpy.testing import assert_equal

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.bridges.gymnasium import ID, as_policy
from uavdh_lite.channel import Channel
from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, LAND, NORTH, Environment, Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.scenario import Scenario, find_scenario

VILLAGE, SCENARIO = City.load("village"), find_scenario("village")


def single(**options):
    return gymnasium.make(ID, **{"scenario": "village", **options})


def in_the_corner(time_left):
    """Over the landing cell at the north-west corner, as the options of a reset."""
    start = SCENARIO.sample(Environment(VILLAGE), 1, np.random.default_rng(0))
    start = replace(start, uav_cell=np.array([0]), time_left=np.array([time_left]))
    return {"start": start}


@pytest.mark.parametrize("observation", ["centred", "non_centred"])
@pytest.mark.parametrize("cities", [None, CityGenerator(8).draw(3, 0)])
def test_checker(observation, cities):
    environment = cities and SafeEnvironment(cities)
    env = single(observation=observation, environment=environment, render_mode="rgb_array")
    check_env(env.unwrapped)


def test_an_episode_ends_with_a_landing_or_without_time():
    env = single(rewards=Rewards(crash=-7.0), render_mode="rgb_array")
    env.reset(options=in_the_corner(10))
    seen, *end, info = env.step(LAND)
    assert end == [0.0, True, False] and seen["time"][0] == pytest.approx(9 / 35)
    assert info["landed"] and info["collected_and_landed"] == 0 and info["time_left"] == 9
    kinds = [bool, float, float, int, bool]  # of Python: batches stack these alone
    assert [type(value) for value in info.values()] == kinds
    env.reset(options=in_the_corner(1))
    assert env.get_wrapper_attr("action_masks")()[[NORTH, HOVER, LAND]].tolist() == [0, 1, 1]
    before = env.render()
    _, reward, *end, info = env.step(NORTH)  # off the grid
    assert reward == pytest.approx(-0.2 - 1 - 7) and end == [True, False]
    assert info["safety_interventions"] and not info["landed"]
    assert before.shape == (640, 600, 3) and (env.render() != before).any()


def test_before_the_first_reset_there_is_no_episode():
    one, two = single(render_mode="rgb_array").unwrapped, batch(2).unwrapped
    for call in (
        *(one.action_masks, lambda: one.step(HOVER), one.render),
        *(two.action_masks, lambda: two.step(np.array([HOVER, HOVER]))),
    ):
        with pytest.raises(ResetNeeded, match=r"call reset\(\) first"):
            call()


START = in_the_corner(10)["start"]


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"uav_cell": 0}, "start is .*: expected a State of 1 ep"),
        (START[[0, 0]], "start is .*: expected a State of 1 ep"),
        (replace(START, data_initial=0 * START.data_initial + 15.1), "more time or data"),
        (replace(START, data_initial=START.data_initial * np.nan), "data that is no number"),
        (replace(START, data_left=START.data_initial + 1), "outside the observation space"),
        (replace(START, uav_cell=np.flatnonzero(VILLAGE.no_fly)[:1]), "over a no-fly cell"),
        (replace(START, uav_cell=np.array([64])), "in no cell"),
        (replace(START, device_cells=0 * START.device_cells), "on a building or in the landing"),
        (replace(START, time_left=np.array([36])), "more time or data"),
        (replace(START, time_left=np.array([-1])), "is over"),
    ],
)
def test_a_start_that_cannot_be_flown_or_seen_is_refused(wrong, named):
    most = replace(START, time_left=np.array([35]), data_initial=0 * START.data_initial + 15)
    assert single().observation_space.contains(single().reset(options={"start": most})[0])
    with pytest.raises(InputError, match=named):
        single().reset(options={"start": wrong})


def test_an_option_that_a_batch_does_not_have_is_refused():
    with pytest.raises(InputError, match="options reset_mask: a reset has start alone"):
        batch(2).reset(options={"reset_mask": np.array([True, False])})


SCRIPT = """
import multiprocessing

if __name__ == "__main__":
    multiprocessing.set_start_method("spawn")
    import gymnasium
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    ID = "uavdh_lite.bridges.gymnasium:uavdh_lite/DataHarvesting-v0"
    start = {"start_method": "spawn"}
    options = {"env_kwargs": {"scenario": "village"}, "vec_env_kwargs": start}
    envs = make_vec_env(ID, 2, vec_env_cls=SubprocVecEnv, **options)
    print(envs.reset()["map"].shape)
    envs.close()
    envs = gymnasium.make_vec(ID, 2, vectorization_mode="async", scenario="village")
    print(envs.reset(seed=0)[0]["map"].shape)
    envs.close()
"""


@pytest.mark.long
@pytest.mark.longest
def test_processes_that_inherit_nothing_find_the_environment_by_its_module(tmp_path):
    """As in a Jupyter kernel: what the parent imported has registered nothing in them."""
    pytest.importorskip("stable_baselines3")
    (tmp_path / "script.py").write_text(SCRIPT)
    ran = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert ran.stdout.split("\n")[:2] == ["(2, 5, 15, 15)"] * 2, ran.stderr


def batch(count, **options):
    options = {"scenario": "village", **options}
    mode = "vector_entry_point"
    return gymnasium.make_vec(ID, num_envs=count, vectorization_mode=mode, **options)


@pytest.mark.parametrize("count", [None, 4])
def test_a_seed_says_what_is_drawn_and_each_environment_knows_its_own(count):
    def flown(seed):
        env = batch(count) if count else single()
        first = env.reset(seed=seed)
        assert seed is None or env.unwrapped.np_random_seed == seed
        action = np.full(count, HOVER) if count else HOVER
        return env.unwrapped.np_random_seed, [first, *(env.step(action) for _ in range(19))]

    (_, first), (_, again), (_, other), (own, unseeded) = map(flown, (7, 7, 8, None))
    assert data_equivalence(first, again, exact=True)
    assert data_equivalence(flown(own)[1], unseeded, exact=True)
    assert not any(data_equivalence(first, each, exact=True) for each in (other, unseeded))
    maps = first[0][0]["map"]
    assert count is None or not any(np.array_equal(maps[0], each) for each in maps[1:])


# A landing cell and a cell for the device; nothing else can be drawn.
ONLY = Environment(
    City.from_text("only", "L . B \n B B B \n B B B"),
    Channel(fading_variance_los_db2=0.0, fading_variance_nlos_db2=0.0),
)
ONE_MISSION = Scenario("one mission", "", (1, 1), (60.0, 60.0), (5, 5))


@pytest.mark.parametrize("kind", [Environment, SafeEnvironment])
def test_a_batch_is_eight_single_environments(kind):
    """Every array and every mask, through many ends."""
    options = {"scenario": ONE_MISSION, "environment": kind(ONLY.city, ONLY.channel)}
    ours = batch(8, **options)
    theirs = SyncVectorEnv([partial(single, **options)] * 8)
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    generator, ends = np.random.default_rng(0), 0
    ours_seen, theirs_seen = ours.reset(seed=1), theirs.reset(seed=2)
    for _ in range(60):
        assert data_equivalence(ours_seen[0], theirs_seen[0])
        assert_equal(ours_seen[1:], theirs_seen[1:])
        assert ours.observation_space.contains(ours_seen[0])
        masks = theirs.call("action_masks")
        assert np.array_equal(ours.unwrapped.action_masks(), masks)
        action = generator.integers(0, 6, 8)
        ours_seen, theirs_seen = ours.step(action), theirs.step(action)
        ends += ours_seen[2].sum()
    assert ends > 50


@pytest.mark.parametrize("masked", [False, True])
def test_a_policy_of_observations_is_evaluated_as_ours_are(masked):
    environment, shapes = SafeEnvironment(VILLAGE), []

    def last_allowed(seen, masks=None):
        shapes.append({name: array.shape[1:] for name, array in seen.items()})
        assert (masks is not None) == masked
        return 5 - masks[:, ::-1].argmax(axis=1) if masked else np.full(len(seen["time"]), LAND)

    policy = as_policy(single(environment=environment), last_allowed, masked)
    flights = evaluate(environment, policy, SCENARIO, 20, seed=0)
    assert flights.end.landed.all() and (flights.steps == 1).all()
    assert shapes == [{"map": (5, 15, 15), "time": (1,)}]
    halved = gymnasium.wrappers.TransformObservation(single(), dict, None)
    many = gymnasium.wrappers.vector.TransformAction(batch(2), abs)
    for env in (gymnasium.wrappers.TimeLimit(halved, 9), many):
        with pytest.raises(InputError, match=r"^Transform(Observation|Action) would be left out"):
            as_policy(env, last_allowed)
    policy = as_policy(single(), lambda seen: (np.full(len(seen["time"]), LAND), None))
    with pytest.raises(InputError, match=r"predict gave a tuple.*model\.predict\(\.\.\.\)\[0\]"):
        evaluate(environment, policy, SCENARIO, 2, seed=0)
