import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.ddqn import DDQN, draw_actions, softmax_policy
from uavdh_lite.replay import Batch


def test_softmax_policy_by_hand_and_at_its_limits():
    q = torch.tensor([[0.0, np.log(3.0), 0.0, -torch.inf]])
    assert softmax_policy(q, 1.0).tolist()[0] == pytest.approx([0.2, 0.6, 0.2, 0])
    assert softmax_policy(q, 1e-3).tolist()[0] == pytest.approx([0, 1, 0, 0])
    assert softmax_policy(torch.tensor([[1e4, 0.0]]), 0.1).tolist()[0] == [1, 0]  # no overflow


PROBABILITIES = torch.tensor([0.0, 0.1, 0.0, 0.6, 0.3, 0.0])


def test_drawn_actions_follow_the_probabilities(generator):
    share = np.bincount(draw_actions(PROBABILITIES.expand(50_000, -1), generator), minlength=6)
    assert share / 50_000 == pytest.approx(PROBABILITIES.tolist(), abs=0.01)


@pytest.mark.parametrize(("draw", "action"), [(0.0, 1), (1 - 2**-53, 4)])
def test_the_extreme_draws_give_no_impossible_action(draw, action):
    class Generator:
        def random(self, count):
            return np.full(count, draw)

    assert draw_actions(PROBABILITIES[None], Generator()).tolist() == [action]


def learner(optimiser, rate, **options):
    """Of a table: states are the numbers 0 to 3, actions 0 and 1; all Q-values begin at 0."""
    network = nn.Linear(4, 2, bias=False)
    nn.init.zeros_(network.weight)
    one_hot, optimiser = torch.eye(4), optimiser(network.parameters(), rate)
    return DDQN(lambda state: (one_hot[state],), network, optimiser, **options)


def batch(state, action, reward, discount, next_state):
    reward, discount = np.array(reward, np.float32), np.array(discount, np.float32)
    return Batch(np.array(state), np.array(action), reward, discount, np.array(next_state))


def test_targets_by_hand():
    """In the next state the online network chooses, the target network rates; 0 after an end."""
    own = learner(torch.optim.SGD, 0.1, target_update_rate=0.5)
    own.online.weight.data = torch.tensor([[0.0, 5.0, 9.0, 0.0], [1.0, 1.0, 9.0, 0.0]])
    own.target.weight.data = torch.tensor([[7.0, -2.0, 9.0, 0.0], [4.0, 8.0, 9.0, 0.0]])
    y = own.targets(batch([3, 3, 3], [0, 0, 0], [1, 2, 3], [0.5, 0.5, 0], [0, 1, 2]))
    assert y.tolist() == [1 + 0.5 * 4, 2 - 0.5 * 2, 3]


@pytest.mark.parametrize(
    ("huber_delta", "loss", "slope", "next_slope"),
    [(None, 9.0, 6.0, 4.8), (1.0, 2.5, 1.0, 1.0), (4.0, 4.5, 3.0, 2.7)],
)
def test_an_update_descends_the_loss_of_the_action_taken(huber_delta, loss, slope, next_slope):
    """Q is 0, its target 3: the loss is 3², or 1 · (3 − 1/2), or 3²/2; τ is 1/4.

    The next slope is that of the error that is left, and of nothing before.
    """
    own = learner(torch.optim.SGD, 1.0, target_update_rate=0.25, huber_delta=huber_delta)
    own.set_learning_rate(0.1)
    assert own.update(batch([2], [1], [3], [0], [0])) == loss
    moved = torch.zeros(2, 4)
    moved[1, 2] = 0.1 * slope
    assert torch.allclose(own.online.weight, moved)
    assert torch.allclose(own.target.weight, moved / 4)
    own.update(batch([2], [1], [3], [0], [0]))
    assert own.online.weight[1, 2].item() == pytest.approx(0.1 * (slope + next_slope))


def test_it_learns_the_exact_values_of_a_chain(generator):
    """Five cells in a row, actions left and right; reaching the right end pays 1 and ends."""
    best = 0.9 ** (3 - np.arange(4))
    exact = np.stack([0.9 * best[np.maximum(np.arange(4) - 1, 0)], best])
    own = learner(torch.optim.Adam, 0.02, target_update_rate=0.1)
    for _ in range(800):
        state, action = generator.integers(0, 4, 16), generator.integers(0, 2, 16)
        after = np.maximum(state + 2 * action - 1, 0)
        end = after == 4
        own.update(batch(state, action, end, np.where(end, 0, 0.9), np.minimum(after, 3)))
    assert own.online.weight.detach().numpy() == pytest.approx(exact, abs=0.03)
