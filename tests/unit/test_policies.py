import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.planners import Genie, Greedy
from uavdh_lite.policies import agents_for, find_policy, known_policies, policies_for
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream


@pytest.fixture(scope="module")
def environment():
    return Environment(City.load("manhattan"))


@pytest.fixture(scope="module")
def village():
    return Environment(City.load("village"))


def test_a_citys_own_agents_come_first_and_planners_fly_over_any(environment, village):
    planners = ["greedy", "genie", "random"]
    assert policies_for(environment) == [
        "manhattan",
        "manhattan_ddqn",
        "manhattan_ddqn_early",
        "manhattan_turned",
        "any_city",
        *planners,
    ]
    assert policies_for(village) == ["any_city", *planners]
    assert policies_for(Environment(CityGenerator((20, 20)).draw(1, seed=5)[0])) == planners
    assert agents_for(CityGenerator().draw(2, seed=5)) == ["any_city"]
    assert set(policies_for(environment)) < set(known_policies())


def test_a_policy_by_its_name(environment):
    assert find_policy("manhattan", environment).knows(environment.city)
    assert isinstance(find_policy("greedy", environment), Greedy)
    assert isinstance(find_policy("genie", environment), Genie)


def test_the_seed_is_that_of_random_flights(village):
    state = SCENARIOS["village"].sample(village.city, 500, stream(Use.TEST))
    first, again, other = (find_policy("random", village, seed)(state) for seed in (7, 7, 8))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_an_unknown_name_and_an_agent_of_another_city(village):
    with pytest.raises(InputError, match="no policy named 'magic': choose one of greedy, genie"):
        find_policy("magic", village)
    with pytest.raises(InputError, match="manhattan was trained in manhattan, not in village"):
        find_policy("manhattan", village)
