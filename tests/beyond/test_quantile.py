import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.beyond.quantile import QRDQN, QuantileNetwork, quantile_huber_loss
from uavdh_lite.replay import Batch


@pytest.mark.parametrize(
    ("samples", "kappa", "loss"),
    [
        ([3.0], 1.0, 1.75),  # u = 3, 2: L = 2.5, 1.5; weights 0.25, 0.75
        ([3.0, -1.0], 1.0, 1.25),  # the mean with u = −1, −2: L = 0.5, 1.5; weights 0.75, 0.25
        ([3.0], 2.0, 2.5),  # L = 2 (3 − 1) = 4, and 2² / 2 = 2
    ],
)
def test_loss_by_hand(samples, kappa, loss):
    """Two quantiles, at 0 and 1, of levels 1/4 and 3/4."""
    quantiles = torch.tensor([[0.0, 1.0]])
    assert float(quantile_huber_loss(quantiles, torch.tensor([samples]), kappa)) == loss


def learner(values):
    """Of one state with these quantiles, [action, quantile]; its rate is 0.4, its τ 1/2."""
    table = nn.Linear(1, 12, bias=False)
    table.weight.data = torch.tensor(values + [[0.0, 0.0]] * (6 - len(values))).view(12, 1)
    network = QuantileNetwork(table)
    optimiser = torch.optim.SGD(network.parameters(), 0.4)
    return QRDQN(lambda state: (torch.ones(len(state), 1),), network, optimiser, 0.5, 1.0)


def batch(actions, rewards, discounts):
    state, numbers = np.zeros(len(actions)), np.array([rewards, discounts], np.float32)
    return Batch(state, np.array(actions), *numbers, state)


def test_the_online_mean_chooses_and_the_target_network_gives_the_quantiles():
    """By its mean the online network likes action 0 best, by one quantile action 1; the target
    network likes action 2."""
    own = learner([[3.0, 4.0], [0.0, 6.0], [1.0, 1.0]])
    own.target = learner([[5.0, 7.0], [-1.0, 2.0], [90.0, 95.0]]).online
    assert own.q_values([0]).tolist() == [[3.5, 3, 1, 0, 0, 0]]
    y = own.targets(batch([0, 0], [1, 2], [0.5, 0]))
    assert y.tolist() == [[3.5, 4.5], [2.0, 2.0]]  # 1 + 5/2, 1 + 7/2; and the end


def test_an_update_moves_only_the_action_taken():
    """θ = (0, 1), the sample is 3: the slopes are 1/4 · 1 and 3/4 · 1."""
    own = learner([[0.0, 1.0]] * 3)
    assert own.update(batch([1], [3], [0])) == 1.75
    after = own.online.quantiles(torch.ones(1, 1))[0, :3]
    assert torch.allclose(after, torch.tensor([[0.0, 1.0], [0.1, 1.3], [0.0, 1.0]]))
