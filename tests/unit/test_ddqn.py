import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.ddqn import DDQN, ddqn_target, draw_actions, soft_update, softmax_policy


def test_target_of_a_three_state_problem_by_hand():
    """From s0 to s1, s1 to s2, s2 to the end. The online network chooses, the target rates.

    s0: online prefers action 1 in s1, which the target rates 4: 1 + 0.9 · 4 = 4.6.
    s1: online prefers action 0 in s2, which the target rates −2: 2 + 0.9 · −2 = 0.2.
    s2: the episode ends: 3.
    """
    reward = torch.tensor([1.0, 2.0, 3.0])
    discount = torch.tensor([0.9, 0.9, 0.0])
    online_next = torch.tensor([[0.0, 1.0], [5.0, 1.0], [9.0, 9.0]])
    target_next = torch.tensor([[7.0, 4.0], [-2.0, 8.0], [9.0, 9.0]])
    target = ddqn_target(reward, discount, online_next, target_next)
    assert target.tolist() == pytest.approx([4.6, 0.2, 3.0])


def test_softmax_policy_by_hand_and_at_its_limits():
    q = torch.tensor([[0.0, np.log(3.0), 0.0]], dtype=torch.float64)
    assert softmax_policy(q, 1.0).tolist()[0] == pytest.approx([0.2, 0.6, 0.2])
    assert softmax_policy(q, 1e-3).tolist()[0] == pytest.approx([0, 1, 0])
    assert softmax_policy(q, 1e6).tolist()[0] == pytest.approx([1 / 3] * 3, abs=1e-5)
    huge = torch.tensor([[1e4, 0.0]])
    assert softmax_policy(huge, 0.1).tolist()[0] == [1, 0]  # no overflow


def test_drawn_actions_follow_the_probabilities(generator):
    probabilities = torch.tensor([0.1, 0.0, 0.6, 0.0, 0.3, 0.0]).expand(50_000, -1)
    share = np.bincount(draw_actions(probabilities, generator), minlength=6) / 50_000
    assert share == pytest.approx([0.1, 0, 0.6, 0, 0.3, 0], abs=0.01)
    assert share[[1, 3, 5]].max() == 0


def test_soft_update_moves_by_its_rate():
    online, target = nn.Linear(2, 2), nn.Linear(2, 2)
    before = [parameter.clone() for parameter in target.parameters()]
    soft_update(target, online, 0.25)
    for old, new, goal in zip(before, target.parameters(), online.parameters(), strict=True):
        assert torch.allclose(new, 0.75 * old + 0.25 * goal)


@pytest.mark.parametrize(("delta", "slope"), [(None, 2 * 3.0), (1.0, 1.0)])
def test_update_descends_the_loss_of_the_action_taken(delta, slope):
    """One weight an action, Q = w. Target 3 above: the gradient is −2·3, or −δ for Huber."""
    network = nn.Linear(1, 2, bias=False)
    nn.init.zeros_(network.weight)
    ddqn = DDQN(network, torch.optim.SGD(network.parameters(), 0.1), 0.5, delta)
    one = (torch.ones(1, 1),)
    ddqn.update(one, torch.tensor([1]), ddqn.targets(torch.tensor([3.0]), torch.zeros(1), one))
    assert network.weight.flatten().tolist() == pytest.approx([0, 0.1 * slope])
    assert ddqn.target.weight.flatten().tolist() == pytest.approx([0, 0.05 * slope])


def test_learns_the_exact_values_of_a_chain(generator):
    """Five cells in a row, actions left and right; reaching the right end pays 1 and ends.

    Exact: Q(s, right) = γ^(3 − s); Q(s, left) = γ · max Q of the cell on the left.
    """
    discount = 0.9
    best = discount ** (3 - np.arange(4))
    exact = np.stack([discount * best[np.maximum(np.arange(4) - 1, 0)], best], axis=1)
    network = nn.Linear(4, 2, bias=False)
    ddqn = DDQN(network, torch.optim.Adam(network.parameters(), 0.02), 0.05)
    one_hot = torch.eye(4)
    for _ in range(1500):
        state, action = generator.integers(0, 4, 16), generator.integers(0, 2, 16)
        after = np.maximum(state + 2 * action - 1, 0)
        end = after == 4
        y = ddqn.targets(
            torch.from_numpy(end.astype(np.float32)),
            torch.from_numpy(np.where(end, 0, discount).astype(np.float32)),
            (one_hot[np.minimum(after, 3)],),
        )
        ddqn.update((one_hot[state],), torch.from_numpy(action), y)
    assert network.weight.detach().T.numpy() == pytest.approx(exact, abs=0.02)
