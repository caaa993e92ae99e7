"""The Gymnasium environments: the checkers pass, and both are the library's simulator."""

from contextlib import closing

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import uavdh_lite.gym
from uavdh_lite.city import City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import HOVER, LAND, NORTH, SOUTH, Environment, Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.scenario import SCENARIOS, place

ID = "uavdh_lite/DataHarvesting-v0"


@pytest.mark.parametrize("observation", ["centred", "non_centred", "global_local"])
def test_checker(observation):
    options = {"observation": observation, "scenario": "manhattan"}
    check_env(gymnasium.make(ID, **options).unwrapped, skip_render_check=True)
    check_env(gymnasium.make(ID, scenario="village", render_mode="rgb_array").unwrapped)


def test_same_seed_same_episode():
    runs = []
    for _ in range(2):
        env = gymnasium.make(ID, scenario="village")
        steps = [env.reset(seed=3)]
        generator = np.random.default_rng(0)
        for _ in range(12):
            steps.append(env.step(int(generator.integers(0, 5))))
        runs.append(steps)
    assert data_equivalence(runs[0], runs[1], exact=True)
    assert not data_equivalence(runs[0][0], env.reset(seed=4), exact=True)


def start(time_left=10, uav=(0, 0)):
    return place(City.load("village"), uav, [(4, 1)], [5.0], time_left, 2)


def test_a_landing_ends_the_episode_without_a_crash():
    env = gymnasium.make(ID, scenario="village")
    env.reset(options={"start": start()})
    observation, reward, terminated, truncated, info = env.step(LAND)
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert info["has_landed"] and info["collection_ratio_and_landed"] == 0
    assert observation["time"][0] == pytest.approx(9 / 35)
    with pytest.raises(gymnasium.error.ResetNeeded, match="over"):
        env.unwrapped.step(LAND)


def test_running_out_of_time_is_a_termination_and_costs():
    env = gymnasium.make(ID, scenario="village", rewards=Rewards(crash=-7.0))
    env.reset(options={"start": start(time_left=1)})
    _, reward, terminated, truncated, info = env.step(NORTH)  # off the grid
    assert reward == pytest.approx(-0.2 - 1 - 7)
    assert terminated and not truncated and info["safety_intervention"]


def test_bad_input_is_named():
    env = gymnasium.make(ID, scenario="village").unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(0)
    env.reset(seed=0)
    for action in (6, -1, 1.5, "north"):
        with pytest.raises(InputError, match="whole number from 0 to 5"):
            env.step(action)
    with pytest.raises(InputError, match="choose one of human, rgb_array"):
        uavdh_lite.gym.DataHarvesting(render_mode="ansi")
    two = SCENARIOS["village"].sample(City.load("village"), 2, np.random.default_rng(0))
    with pytest.raises(InputError, match="expected a State of 1"):
        env.reset(options={"start": two})
    with pytest.raises(InputError, match="unknown scenario"):
        uavdh_lite.gym.DataHarvesting("nowhere")


def test_picture_shows_the_flight():
    env = gymnasium.make(ID, scenario="village", render_mode="rgb_array")
    env.reset(seed=0, options={"start": start()})
    before = env.render()
    env.step(1)
    after = env.render()
    assert before.shape == after.shape == (640, 600, 3) and before.dtype == np.uint8
    assert (before != after).any()


def test_window(monkeypatch):
    import matplotlib.pyplot as plt

    plt.close("all")  # of other tests
    paused = []
    monkeypatch.setattr(plt, "pause", paused.append)
    env = gymnasium.make(ID, scenario="village", render_mode="human")
    env.reset(seed=0)
    env.step(1)
    assert len(paused) == 2 and len(plt.get_fignums()) == 1 and env.render() is None
    env.close()
    assert not plt.get_fignums()


def vector(num_envs=8, **options):
    return gymnasium.make_vec(
        ID, num_envs, vectorization_mode="vector_entry_point", scenario="village", **options
    )


def test_vector_spaces_and_shapes():
    envs = vector()
    observation, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observation)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    sync = gymnasium.make_vec(ID, 8, vectorization_mode="sync", scenario="village")
    assert sync.single_observation_space == envs.single_observation_space
    assert sync.observation_space == envs.observation_space
    assert sync.action_space == envs.action_space
    with pytest.raises(InputError, match="must be 8 whole numbers"):
        envs.step(np.full(8, 6))
    with pytest.raises(InputError, match="expected a State of 8"):
        envs.reset(options={"start": start()})
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector().unwrapped.step(np.zeros(8, int))


def test_vector_steps_are_those_of_the_single_environment_without_fading(monkeypatch):
    """The same starts and no fading: equal transitions, ended episodes included."""
    from uavdh_lite.environment import Environment

    def quiet(self, state, generator):
        return np.zeros((len(state), 4, state.device_cells.shape[1]), np.float32)

    monkeypatch.setattr(Environment, "draw_fading", quiet)
    city, scenario = City.load("village"), SCENARIOS["village"]
    starts = scenario.sample(city, 16, np.random.default_rng(1))
    envs = vector(16)
    envs.reset(seed=0, options={"start": starts})
    singles = [gymnasium.make(ID, scenario="village").unwrapped for _ in range(16)]
    for k, env in enumerate(singles):
        env.reset(options={"start": starts[[k]]})
    generator = np.random.default_rng(2)
    over = np.zeros(16, bool)
    for _ in range(36):
        actions = generator.integers(0, 6, 16)
        observation, reward, terminated, truncated, infos = envs.step(actions)
        assert not truncated.any() and envs.observation_space.contains(observation)
        for k in np.flatnonzero(~over):
            own = singles[k].step(int(actions[k]))
            assert own[1] == pytest.approx(reward[k]) and own[2] == terminated[k]
            if terminated[k]:
                assert infos["_final_obs"][k] and infos["_final_info"][k]
                assert data_equivalence(infos["final_obs"][k], own[0])
                told = {name: infos["final_info"][name][k] for name in own[4]}
                assert told == own[4]
                assert infos["time_left"][k] > 0 and not infos["has_landed"][k]
            else:
                assert data_equivalence({n: a[k] for n, a in observation.items()}, own[0])
                assert {name: infos[name][k] for name in own[4]} == own[4]
        over |= terminated
    assert over.all()


def test_no_step_of_the_vector_environment_is_a_dummy():
    """After an end, the next step takes its action: the new episode's time goes down."""
    envs = vector(4)
    envs.reset(seed=0)
    _, _, terminated, _, infos = envs.step(np.full(4, LAND))
    assert terminated.all()
    before = infos["time_left"]
    _, reward, _, _, infos = envs.step(np.full(4, 4))
    assert (infos["time_left"] == before - 1).all() and (reward != 0).all()


def test_vector_keys_are_those_of_gymnasium_s_own():
    sync = SyncVectorEnv(
        [lambda: gymnasium.make(ID, scenario="village")] * 4,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    envs = vector(4)
    infos = []
    for one in (sync, envs):
        one.reset(seed=0)
        infos.append(one.step(np.full(4, LAND))[4])
    assert set(infos[0]) == set(infos[1])
    assert set(infos[0]["final_info"]) == set(infos[1]["final_info"])
    for mine, theirs in ((infos[1], infos[0]),):
        assert all(
            data_equivalence(m, t)
            for m, t in zip(mine["_final_obs"], theirs["_final_obs"], strict=True)
        )


def test_vector_seeds_and_pictures():
    runs = []
    for _ in range(2):
        envs = vector(3, render_mode="rgb_array")
        envs.reset(seed=5)
        runs.append([envs.step(np.array([1, 2, 4])) for _ in range(5)])
    assert data_equivalence(runs[0], runs[1], exact=True)
    pictures = envs.render()
    assert len(pictures) == 3 and pictures[0].shape == (640, 600, 3)


def test_a_policy_of_observations_is_evaluated_as_ours_are():
    from uavdh_lite.environment import Environment
    from uavdh_lite.evaluation import evaluate

    env = gymnasium.make(ID, scenario="village")
    environment, scenario = Environment(City.load("village")), SCENARIOS["village"]
    seen = []

    def land(batch):
        seen.append({name: array.shape for name, array in batch.items()})
        return np.full(len(batch["time"]), LAND)

    flights = evaluate(environment, uavdh_lite.gym.as_policy(env, land), scenario, 20, seed=0)
    assert flights.end.landed.all() and (flights.steps == 1).all()
    assert seen == [{"map": (20, 5, 15, 15), "time": (20, 1)}]


def test_the_failsafe_brings_it_home_and_the_mask_says_so_before():
    env = gymnasium.make(ID, scenario="village", failsafe=True)
    env.reset(options={"start": start(time_left=2)})
    mask = env.get_wrapper_attr("action_masks")
    # In the corner: off the map, or one move away with one unit of time to land elsewhere.
    assert mask()[[HOVER, LAND]].all() and not mask()[NORTH]
    env.step(HOVER)
    assert mask().tolist() == [False] * 5 + [True]
    _, reward, terminated, _, info = env.step(SOUTH)
    assert (reward, terminated) == (0.0, True)
    assert info["has_landed"] and info["sent_home"] and not info["safety_intervention"]


def test_without_the_failsafe_the_mask_leaves_out_what_is_refused():
    env = gymnasium.make(ID, scenario="village")
    env.reset(options={"start": start(time_left=1)})
    mask = env.get_wrapper_attr("action_masks")()
    assert mask[HOVER] and mask[LAND] and not mask[NORTH]


def test_nobody_crashes_in_the_vector_environment_with_the_failsafe():
    envs = vector(16, failsafe=True)
    envs.reset(seed=0)
    generator, ends, corrected = np.random.default_rng(0), 0, 0
    for _ in range(150):
        masks = envs.unwrapped.action_masks()
        assert masks.shape == (16, 6) and masks.any(axis=1).all()
        actions = generator.integers(0, 5, 16)
        _, _, terminated, _, infos = envs.step(actions)
        if terminated.any():
            assert infos["final_info"]["has_landed"][terminated].all()
        ends += terminated.sum()
        told = np.where(terminated, infos.get("final_info", infos)["sent_home"], infos["sent_home"])
        corrected += told.sum()
        assert not (told & masks[np.arange(16), actions]).any()
    assert ends > 40 and corrected >= ends


@pytest.mark.parametrize("observation", ["centred", "non_centred"])
def test_every_episode_has_a_city_of_its_own(observation):
    cities = CityGenerator((8, 8)).draw(5, 0)
    options = {"scenario": "village", "city": cities, "observation": observation}
    check_env(gymnasium.make(ID, **options, render_mode="rgb_array").unwrapped)
    envs = gymnasium.make_vec(
        ID, num_envs=12, vectorization_mode="vector_entry_point", failsafe=True, **options
    )
    seen, _ = envs.reset(seed=1)
    simulator = Environment(cities, failsafe=True)
    where = cities.city[envs.unwrapped.state.uav_cell]
    assert len(set(where)) > 2
    generator = np.random.default_rng(0)
    for _ in range(45):
        state = envs.unwrapped.state
        assert np.array_equal(envs.unwrapped.action_masks(), simulator.allowed_actions(state))
        layer = seen["map"][:, 2].sum(axis=(1, 2))
        where = cities.city[state.uav_cell]
        assert np.array_equal(layer, [cities[city].buildings.sum() for city in where])
        seen, _, terminated, _, infos = envs.step(generator.integers(0, 6, 12))
        assert terminated.any() == ("final_info" in infos)
        if terminated.any():
            assert infos["final_info"]["has_landed"][terminated].all()
    assert (cities.city[envs.unwrapped.state.uav_cell] != where[0]).any()


def test_without_a_render_mode_nothing_is_drawn():
    with closing(vector(2)) as envs:
        envs.reset(seed=0)
        assert envs.render() is None
