"""The world in JavaScript is that in Python: both answer alike. Python's answers are made here.

If one of these fails after a change in Python, make the same change in `labs/world.js` or
`labs/pilots.js`: their functions have the names and the order of those in Python.
"""

import base64
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.cities import random_cities
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.beyond.recipes import TOLD, BeyondRecipe
from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import load_city, shipped_cities
from uavdh_lite.environment import ACTIONS, Environment, Rewards, State
from uavdh_lite.labs.page import AGENTS
from uavdh_lite.missions import Mission, as_json
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.recipe import PAPER
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream, torch_seed

CITIES = (
    *map(load_city, shipped_cities()),
    *random_cities("10:5:8-16"),
)
SCENARIO = Scenario("twin", devices=(1, 4), data=(0.0, 20.0), flying_time=(1, 60))
TRANSITIONS = 3_000
STATES = 100  # of each agent over its city, or 20 over each of several
SAME = "labs/world.js or labs/pilots.js do not do what Python does: make the same change there"


def draw_states(environment: Environment, scenario: Scenario, count: int, seed: int) -> State:
    """States anywhere, with any time left, and devices that have a part of their data left."""
    generator = stream(Use.EXERCISE, seed)
    state = scenario.sample_anywhere(environment, count, generator, 3)
    data_left = state.data_left * generator.choice([1, 0.02, 0.6], state.data_left.shape)
    short = generator.random(count) < 0.3
    time_left = np.where(short, generator.integers(1, 9, count), state.time_left)
    return replace(
        state, time_left=time_left.astype(np.int16), data_left=data_left.astype(np.float32)
    )


@pytest.fixture(scope="module")
def flown():
    """For each city its environment, states, actions and fading."""
    each, cases = TRANSITIONS // len(CITIES) + 1, []
    for number, city in enumerate(CITIES):
        environment, generator = SafeEnvironment(city), stream(Use.EXERCISE, 1000 + number)
        state = draw_states(environment, SCENARIO, each, number)
        action = generator.integers(0, len(ACTIONS), each)
        cases.append((environment, state, action, environment.draw_fading(state, generator)))
    return cases


# Untrained agents with the parts that those of the page do not have: map in place, no LayerNorm,
# what is told without the failsafe
SMALL = {"kernels": 5, "hidden": (9, 8)}
MADE = (
    replace(PAPER, **SMALL),
    replace(PAPER, observation="non_centred", kernel_size=4, strides=(3, 2), **SMALL),
    replace(BeyondRecipe(**asdict(PAPER)), told=True, observation="non_centred", **SMALL),
    replace(TOLD, pooling=4, local_size=21, **SMALL),
)


@pytest.fixture(scope="module")
def agents(tmp_path_factory):
    """For each agent its file, a city, states, Q-values."""
    made, file = [], tmp_path_factory.mktemp("agents") / "agent.safetensors"
    for name in AGENTS:
        agent = load_agent(name)
        agent.network.half().float()  # the weights that the page has
        save_agent(file, agent)
        made.append((agent, file.read_bytes()))
    for number, recipe in enumerate(MADE):
        cities = load_city("village"), load_city("manhattan")
        observation = recipe.observation_for(recipe.environment_for(cities))
        torch.manual_seed(torch_seed(Use.EXERCISE, number))
        network = recipe.network_for(observation)
        agent = Agent(network, observation, recipe, find_scenario("village"))
        save_agent(file, agent)
        made.append((agent, file.read_bytes()))
    cases = []
    for agent, content in made:
        several = len(agent.cities) > 1  # then a smaller city, too
        known = ("manhattan", "village") if several else (agent.city.name,)
        for city in (city for city in CITIES if city.name in known):
            count = STATES // 5 if several else STATES
            state = draw_states(agent.over(city).environment, agent.scenario, count, 7)
            values = agent.over(city).q_values(state).numpy()
            cases.append((content, city, state, values))
    return cases


@pytest.fixture(scope="module")
def asked(flown, agents, rows_of):
    """The questions, as JSON values."""
    states = []
    for number, (_, state, action, fading) in enumerate(flown):
        for row, act, draws in zip(rows_of(state), action, fading, strict=True):
            states.append(
                {**row, "city": number, "action": int(act), "fading": draws.ravel().tolist()}
            )
    return {
        "channel": asdict(Channel()),
        "cities": [{"name": city.name, "rows": city.text.split()} for city in CITIES],
        "states": states,
        "sight": [number for number, city in enumerate(CITIES) if city.size <= 32],
        "agents": [
            {
                "base64": base64.b64encode(content).decode(),
                "city": CITIES.index(city),
                "asked": rows_of(state),
            }
            for content, city, state, _ in agents
        ],
        "missions": [
            {
                "scenario": asdict(find_scenario(city.name)),
                "city": CITIES.index(city),
                "seed": seed,
            }
            for city in CITIES[: len(shipped_cities())]
            for seed in (*range(3), 2**40 + 1)
        ],
    }


@pytest.fixture(scope="module")
def answered(asked, ask):
    return ask("twin.js", asked)


def test_transitions_are_the_same(flown, answered):
    begin, ties = 0, 0
    for environment, state, action, fading in flown:
        rows = answered["stepped"][begin : begin + len(state)]
        begin += len(state)
        plain = Environment(environment.city)
        after, outcome = plain.transition(state, action, fading)
        snr_db = plain.snr_db(state, after.uav_cell, fading)
        snr_db[np.isinf(snr_db)] = np.nan  # in JSON −∞ is null, which becomes NaN
        # Devices that are heard alike to the last digit: either may be served
        tied = (np.diff(np.sort(snr_db), axis=-1) < 1e-5).any(axis=(1, 2))
        ties += tied.sum()
        exact = {
            "uav_cell": after.uav_cell,
            "time_left": after.time_left,
            "landed": after.landed,
            "intervened": outcome.intervened,
            "crashed": outcome.crashed,
            "served": outcome.served,
            "allowed": plain.allowed_actions(state),
            "safe": environment.allowed_actions(state),
            "way_home": environment.way_home[0, state.uav_cell],
            "greedy": Greedy(plain).act(state),
        }
        near = {
            "data_left": after.data_left,
            "uploaded": outcome.uploaded,
            "reward": Rewards()(outcome),
            "snr_db": snr_db.reshape(len(state), -1),
        }
        for name, expected in (exact | near).items():
            found = np.array([row[name] for row in rows], float)[~tied]
            tolerance = 1e-4 if name in near else 0
            message = f"{name} over {plain.city.name}: {SAME}"
            np.testing.assert_allclose(found, expected[~tied], atol=tolerance, err_msg=message)
    assert ties <= 0.001 * TRANSITIONS


def test_another_channel_is_the_same_too(asked, ask, rows_of):
    channel = Channel(12.0, 25.0, -25.0, 2.0, 3.0, 1.0, 4.0, slots=3)
    city = load_city("village")
    environment, generator = Environment(city, channel), stream(Use.EXERCISE, 5)
    state = draw_states(environment, SCENARIO, 50, 5)
    fading = environment.draw_fading(state, generator)
    nothing: dict[str, list] = {key: [] for key in ("sight", "agents", "missions")}
    rows = rows_of(state)
    for row, draws in zip(rows, fading, strict=True):
        row |= {"city": 0, "action": 4, "fading": draws.ravel().tolist()}
    cities = [{"name": city.name, "rows": city.text.split()}]
    told = {"channel": asdict(channel), "cities": cities, "states": rows}
    stepped = ask("twin.js", asked | nothing | told)["stepped"]
    snr_db = environment.snr_db(state, state.uav_cell, fading).reshape(50, -1)
    np.testing.assert_allclose([row["snr_db"] for row in stepped], snr_db, atol=1e-4)


def test_line_of_sight_is_the_same_for_all_pairs(flown, asked, answered):
    for number, seen in zip(asked["sight"], answered["seen"], strict=True):
        expected = "".join(map(str, flown[number][0].sight.astype(int).ravel()))
        assert seen == expected, f"line of sight over {CITIES[number].name}: {SAME}"


def test_agents_value_states_alike(agents, answered):
    for (_, city, _, expected), found in zip(agents, answered["valued"], strict=True):
        values = np.array(found, float)  # null, an action that is not allowed, becomes NaN
        assert np.array_equal(np.isnan(values), np.isinf(expected)), SAME
        finite = np.isfinite(expected)
        tolerance = 1e-3 * (expected[finite].max() - expected[finite].min())
        np.testing.assert_allclose(
            values[finite], expected[finite], atol=tolerance, err_msg=f"{city.name}: {SAME}"
        )
        first, second = np.sort(expected, axis=1)[:, :-3:-1].T
        clear = first - second > tolerance
        best = np.nan_to_num(values, nan=-np.inf).argmax(axis=1)
        assert np.array_equal(best[clear], expected.argmax(axis=1)[clear]), SAME


def test_missions_and_flights_are_the_same(asked, answered):
    environments = [Environment(city) for city in CITIES[: len(shipped_cities())]]
    planners = [Greedy(environment) for environment in environments]
    for question, found in zip(asked["missions"], answered["flown"], strict=True):
        city, environment, greedy = (
            each[question["city"]] for each in (CITIES, environments, planners)
        )
        mission = Mission.draw(find_scenario(city.name), city, question["seed"])
        assert found["mission"] == as_json(mission), SAME
        flight = mission.fly(environment, greedy).trajectory(0)
        assert found["action"] == flight.action.tolist(), SAME
        np.testing.assert_allclose(found["reward"], flight.reward, atol=1e-4)
        np.testing.assert_allclose(found["left"], flight.data_left[-1], atol=1e-4)
        random = mission.fly(environment, Random(question["seed"])).trajectory(0)
        assert found["random"] == random.action.tolist(), SAME
