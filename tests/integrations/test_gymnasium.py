"""The Gymnasium environments: the checkers pass, and both are the library's simulator."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

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


def test_the_seed_says_what_is_drawn():
    def episode(seed):
        env = single()
        first = env.reset(seed=seed)
        assert env.np_random_seed == seed
        return first, env.step(HOVER)

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


def test_a_start_of_several_episodes_is_refused():
    start = SCENARIO.sample(Environment(VILLAGE), 9, np.random.default_rng(0))
    with pytest.raises(InputError, match="start of 9 episodes"):
        single().reset(options={"start": start})


@pytest.mark.parametrize("kind", [Environment, SafeEnvironment])
def test_its_steps_are_those_of_the_library(kind):
    """The same starts in several cities, no fading: equal transitions."""
    calm = Channel(fading_variance_los_db2=0.0, fading_variance_nlos_db2=0.0)
    environment, generator = kind(CityGenerator(8).draw(5, 0), calm), np.random.default_rng(2)
    starts = SCENARIO.sample(environment, 16, generator)
    ends = set()
    for k in range(16):
        env, state = single(environment=environment).unwrapped, starts[[k]]
        env.reset(options={"start": state})
        ended = False
        while not ended:
            action = int(generator.integers(0, 6))
            assert (env.action_masks() == environment.allowed_actions(state)[0]).all()
            state, outcome = environment.step(state, np.array([action]), generator)
            seen, reward, ended, truncated, info = env.step(action)
            assert reward == pytest.approx(Rewards()(outcome)[0]) and not truncated
            assert ended == state.ended[0] and env.observation_space.contains(seen)
            assert info["landed"] == state.landed[0] and info["time_left"] == state.time_left[0]
            assert info["collected"] == pytest.approx(state.collected[0])
        ends.add(int(state.city[0]))
    assert len(ends) == 5


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
