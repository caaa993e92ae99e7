import numpy as np
import pytest

from uavdh_lite.city import City, load_city
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.planners import Greedy
from uavdh_lite.policies import agents_for, find_policy, known_policies
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream

PLANNERS = ["greedy", "genie", "random"]


@pytest.fixture(scope="module")
def manhattan():
    return Environment(load_city("manhattan"))


@pytest.fixture(scope="module")
def village():
    return Environment(load_city("village"))


def test_a_citys_own_agents_come_first_and_planners_fly_over_any(manhattan, village):
    *own, last = agents_for(manhattan)
    assert own and all(name.startswith("manhattan") for name in own) and last == "any_city"
    both = Environment((manhattan.city, village.city))
    for environment in (village, both):
        assert agents_for(environment) == ["any_city"]
    large = City.from_kinds("large", np.pad(village.city.kinds, (0, 30)))
    assert agents_for(Environment(large)) == []
    with pytest.raises(InputError, match=rf"take {', '.join(PLANNERS)}$"):
        find_policy("manhattan", Environment(large))
    assert {*PLANNERS, *own, last} < set(known_policies())


def test_a_policy_by_its_name_and_the_seed_is_that_of_random_flights(village):
    state = find_scenario("village").sample(village, 500, stream(Use.TEST))
    first, again, other = (find_policy("random", village, seed).act(state) for seed in (7, 7, 8))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert isinstance(find_policy("greedy", village), Greedy)
    assert find_policy("any_city", village).cities[0].name == "village"
