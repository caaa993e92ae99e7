from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.agent import CHUNK
from uavdh_lite.city import City
from uavdh_lite.environment import HOVER
from uavdh_lite.errors import InputError

TINY = City.from_text("tiny", "L . b \n . . . \n . B .")


@pytest.fixture
def agent(trainer):
    return trainer().agent


@pytest.fixture
def states(agent, generator):
    return agent.scenario.sample_anywhere(agent.environment, CHUNK + 10, generator, spare_time=0)


def test_it_takes_the_action_with_the_largest_q_value_and_hovers_after_the_end(agent, states):
    q_values = agent.q_values(states)
    expected = agent.network(*agent.observation(states)).detach()
    assert torch.allclose(q_values, expected, atol=1e-5) and q_values.shape == (CHUNK + 10, 6)
    states = replace(states, landed=np.arange(CHUNK + 10) % 3 == 0)
    action = agent.act(states)
    assert (action[states.landed] == HOVER).all()
    assert np.array_equal(action[~states.landed], q_values.argmax(1)[~states.landed])


def test_which_cities_it_knows_and_that_a_larger_one_is_refused(agent, corridor):
    assert agent.knows((corridor,)) and not agent.knows((TINY,))
    both, manhattan = agent.over((corridor, TINY)), City.load("manhattan")
    several = replace(both, trained_in=both.cities)
    assert several.knows((TINY,)) and several.knows((corridor,))
    assert not several.knows((manhattan,))
    # Where it flies changes nothing of what it was trained for.
    for elsewhere in (both, agent.over(TINY)):
        assert elsewhere.knows((corridor,)) and not elsewhere.knows((TINY,))
        assert not elsewhere.knows(elsewhere.cities)
    assert several.over(corridor).knows((TINY,)) and several.over(TINY).knows((corridor,))
    # Nor does what the network could see: the largest of them all must be as large as its own.
    wide = agent.recipe.observation_for(both.environment, 16)
    assert not replace(several, observation=wide).knows((manhattan,))
    assert not several.knows((TINY, manhattan))
    with pytest.raises(InputError, match="2 cities"):
        _ = several.city
    with pytest.raises(InputError, match=r"up to 5 cells .* 16 .*manhattan"):
        agent.over(manhattan)
