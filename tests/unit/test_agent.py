"""What a decision hangs on: a linear network, for which it can be computed by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.agent import Agent, saliency, value_map
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import SCENARIOS, place
from uavdh_lite.streams import Use, stream


class Linear(nn.Module):
    """Six sums over the maps, each with weights of its own."""

    def __init__(self, generator):
        super().__init__()
        self.weight = nn.Parameter(torch.randn(6, 5, 31, 31, generator=generator))

    def forward(self, maps, time):
        return torch.einsum("bchw,achw->ba", maps[0], self.weight)


@pytest.fixture
def city():
    return City.load("manhattan")


@pytest.fixture
def state(city):
    return place(city, (8, 7), [(4, 4), (7, 9)], [10, 5], 40, 5)


def test_saliency_of_a_linear_network_is_weight_times_input(city, state):
    network = Linear(torch.Generator().manual_seed(0))
    agent = Agent(network, Observation(city), LITE, SCENARIOS["manhattan"], city)
    (maps,), _ = agent.observation(state)
    best = int(agent(state)[0])
    expected = (maps[0] * network.weight[best]).abs().sum(0).detach()
    np.testing.assert_allclose(saliency(agent, state), expected, rtol=1e-5)
    assert network.weight.grad is None  # nothing is left behind in the network


class LinearOverViews(nn.Module):
    """Q-values that are sums over all maps, each entry with its weight."""

    def __init__(self, shapes):
        super().__init__()
        generator = torch.Generator().manual_seed(0)
        self.weights = [torch.randn(6, *shape, generator=generator) for shape in shapes]

    def forward(self, maps, time):
        pairs = zip(self.weights, maps, strict=True)
        return sum(torch.einsum("alrc,blrc->ba", weight, layers) for weight, layers in pairs)


def test_saliency_with_two_views_is_the_change_when_a_cell_is_emptied(city, state):
    observation = Observation(city, "global_local", pooling=3, local_size=9)
    network = LinearOverViews(observation.map_shapes())
    agent = Agent(network, observation, LITE, SCENARIOS["manhattan"], city)
    full, best = observation.full_map(state), int(agent(state)[0])
    found = saliency(agent, state)
    assert found.shape == (31, 31)
    for row, col in [(15, 15), (12, 14), (0, 3), (30, 30), (18, 19)]:
        expected = 0.0
        for layer in range(5):
            emptied = full.clone()
            emptied[0, layer, row, col] = 0
            change = network(observation.views(full), None) - network(
                observation.views(emptied), None
            )
            expected += abs(float(change[0, best]))
        assert found[row, col] == pytest.approx(expected, abs=1e-4)


def test_value_map_moves_the_uav_and_nothing_else(city, state):
    agent = load_agent("manhattan")
    values = value_map(agent, state)
    assert (np.isnan(values) == city.no_fly).all()
    for cell in ((0, 0), (8, 7), (15, 15)):
        moved = place(city, cell, [(4, 4), (7, 9)], [10, 5], 40, 5)
        assert values[cell] == pytest.approx(float(agent.q_values(moved).max()), abs=1e-4)
    assert state.uav_cell[0] == 8 * 16 + 7


@pytest.fixture
def safe(city):
    """Untrained, with the failsafe: left to itself it would crash."""
    network = Linear(torch.Generator().manual_seed(0))
    recipe = replace(LITE, failsafe=True)
    return Agent(network, Observation(city), recipe, SCENARIOS["manhattan"], city)


def test_an_agent_with_the_failsafe_flies_alike_with_and_without_a_controller_that_has_it(safe):
    own = replace(safe, recipe=LITE)
    plain = Environment(safe.city)
    scenario = safe.scenario
    assert evaluate(plain, own, scenario, 60, seed=0).records()["has_landed"].mean() < 0.9
    assert safe.environment.failsafe and not own.environment.failsafe
    alone = evaluate(plain, safe, scenario, 60, seed=0).records()
    guarded = evaluate(safe.environment, safe, scenario, 60, seed=0).records()
    assert (alone["has_landed"] == 1).all() and not alone["safety_interventions"].any()
    assert not guarded.pop("sent_home").any()
    assert all(np.array_equal(guarded[metric], alone[metric]) for metric in alone)


def test_it_chooses_the_best_of_the_allowed_actions(safe, generator):
    state = safe.scenario.sample_anywhere(safe.city, 200, generator, spare_time=0)
    allowed = safe.environment.allowed_actions(state)
    q_values, action = safe.q_values(state).numpy(), safe(state)
    assert allowed[np.arange(200), action].all()
    assert (action == np.where(allowed, q_values, -np.inf).argmax(axis=1)).all()
    assert (action != q_values.argmax(axis=1)).sum() > 20


def test_explanations_leave_out_what_is_not_allowed(safe, city):
    """Twelve moves from home with thirteen units of time: one way remains."""
    far = np.unravel_index(city.landing_distance.argmax(), city.landing.shape)
    time = int(city.landing_distance.max()) + 1
    state = place(city, far, [(4, 4), (7, 9)], [10, 5], time, 5)
    (action,) = safe(state)
    assert action == safe.environment.way_home[state.uav_cell[0]]
    (maps,), _ = safe.observation(state)
    expected = (maps[0] * safe.network.weight[action]).abs().sum(0).detach()
    np.testing.assert_allclose(saliency(safe, state), expected, rtol=1e-5)
    assert value_map(safe, state)[far] == pytest.approx(float(safe.q_values(state)[0, action]))


@pytest.mark.parametrize("name", ["manhattan", "any_city"])
def test_returns_are_quantiles_around_the_q_values(name):
    """Also of the mean over eight views, in which every view's actions are turned back."""
    agent = load_agent(name).over(City.load("village"))
    states = SCENARIOS["village"].sample(agent.city, 3, stream(Use.TEST, 0))
    returns = agent.returns(states)
    assert returns.shape == (3, 6, agent.recipe.quantiles)
    assert torch.allclose(returns.mean(dim=2), agent.q_values(states), atol=1e-4)


def test_an_agent_that_learned_means_has_no_quantiles():
    agent = load_agent("manhattan_ddqn")
    states = SCENARIOS["manhattan"].sample(agent.city, 1, stream(Use.TEST, 0))
    assert agent.returns(states) is None
