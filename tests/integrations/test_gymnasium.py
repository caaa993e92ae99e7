"""The Gymnasium environments: the checkers pass, and both are the library's simulator."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.bridges.gymnasium import ID, as_policy
from uavdh_lite.channel import Channel
from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, LAND, NORTH, Environment, Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.scenario import find_scenario

VILLAGE, SCENARIO = City.load("village"), find_scenario("village")


def single(**options):
    return gymnasium.make(ID, scenario="village", **options)


def vector(count, **options):
    mode = "vector_entry_point"
    return gymnasium.make_vec(ID, count, vectorization_mode=mode, scenario="village", **options)


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


@pytest.mark.parametrize("make", [single, lambda: vector(3)])
def test_the_seed_says_what_is_drawn(make):
    def episode(seed):
        env = make()
        first = env.reset(seed=seed)
        assert env.np_random_seed == seed
        return first, env.step(np.full(env.action_space.shape, HOVER)[()])

    assert data_equivalence(episode(7), episode(7), exact=True)
    assert not data_equivalence(episode(7), episode(8), exact=True)


def test_an_episode_ends_with_a_landing_or_without_time():
    env = single(rewards=Rewards(crash=-7.0), render_mode="rgb_array")
    env.reset(options=in_the_corner(10))
    seen, *end, info = env.step(LAND)
    assert end == [0.0, True, False] and seen["time"][0] == pytest.approx(9 / 35)
    assert info["landed"] and info["collected_and_landed"] == 0 and info["time_left"] == 9
    env.reset(options=in_the_corner(1))
    assert env.get_wrapper_attr("action_masks")()[[NORTH, HOVER, LAND]].tolist() == [0, 1, 1]
    before = env.render()
    _, reward, *end, info = env.step(NORTH)  # off the grid
    assert reward == pytest.approx(-0.2 - 1 - 7) and end == [True, False]
    assert info["safety_interventions"] and not info["landed"]
    assert before.shape == (640, 600, 3) and (env.render() != before).any()


def test_a_start_of_another_number_of_episodes_is_refused():
    with pytest.raises(InputError, match="start of 1 episodes"):
        vector(8).reset(options=in_the_corner(9))


@pytest.mark.parametrize("kind", [Environment, SafeEnvironment])
def test_vector_steps_are_those_of_the_single_environment(kind):
    """The same starts in several cities, no fading: equal transitions, also where one ends."""
    calm = Channel(fading_variance_los_db2=0.0, fading_variance_nlos_db2=0.0)
    environment, generator = kind(CityGenerator(8).draw(5, 0), calm), np.random.default_rng(2)
    starts = SCENARIO.sample(environment, 16, generator)
    envs = vector(16, environment=environment)
    envs.reset(seed=0, options={"start": starts})
    singles = [single(environment=environment).unwrapped for _ in range(16)]
    for k, env in enumerate(singles):
        env.reset(options={"start": starts[[k]]})
    over = np.zeros(16, bool)
    for _ in range(36):
        masks, actions = envs.action_masks(), generator.integers(0, 6, 16)
        observation, reward, terminated, truncated, infos = envs.step(actions)
        assert not truncated.any() and envs.observation_space.contains(observation)
        for k in np.flatnonzero(~over):
            assert (masks[k] == singles[k].action_masks()).all()
            seen, own_reward, ended, _, info = singles[k].step(actions[k])
            assert own_reward == pytest.approx(reward[k]) and ended == terminated[k]
            told = infos["final_info"] if ended else infos
            assert all(told[f"_{name}"][k] and told[name][k] == info[name] for name in info)
            now = {name: array[k] for name, array in observation.items()}
            assert data_equivalence(infos["final_obs"][k] if ended else now, seen)
            assert not ended or (infos["time_left"][k] > 0 and not infos["landed"][k])
        over |= terminated
    assert over.all() and len({*starts.city}) == 5


def test_the_vector_environment_promises_what_gymnasium_s_own_does():
    theirs = SyncVectorEnv([single] * 4, autoreset_mode=AutoresetMode.SAME_STEP)
    ours, infos = vector(4), []
    for space in ("observation_space", "action_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    for envs in (theirs, ours):
        envs.reset(seed=0)
        infos.append(envs.step(np.array([LAND, HOVER, LAND, HOVER]))[4])
    assert infos[0].keys() == infos[1].keys()
    assert infos[0]["final_info"].keys() == infos[1]["final_info"].keys()
    for name in ("_final_obs", "_landed", "_safety_interventions"):
        assert (infos[0][name] == infos[1][name]).all()
    after = ours.step(np.full(4, HOVER))[4]  # no dummy: it takes time in the new episodes, too
    assert (after["time_left"] == infos[1]["time_left"] - 1).all()


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
