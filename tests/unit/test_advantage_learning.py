import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.advantage_learning import action_gap, widen_gap
from uavdh_lite.ddqn import DDQN

Q_VALUES = torch.tensor([[5.0, 3.0, 9.0], [1.0, 2.0, -4.0]])


def test_the_gap_by_hand():
    assert action_gap(Q_VALUES, torch.tensor([1, 1])).tolist() == [6.0, 0.0]


def test_actions_that_are_not_allowed_are_no_better_ones():
    allowed = torch.tensor([[True, True, False], [True, False, True]])
    assert action_gap(Q_VALUES, torch.tensor([1, 2]), allowed).tolist() == [2.0, 5.0]


def test_targets_lose_a_share_of_the_gap():
    gap = torch.tensor([6.0, 0.0])
    assert widen_gap(torch.tensor([10.0, 20.0]), gap, 0.5).tolist() == [7.0, 20.0]
    quantiles = torch.tensor([[10.0, 12.0, 14.0], [20.0, 21.0, 22.0]])
    widened = widen_gap(quantiles, gap, 0.5)
    assert widened.tolist() == [[7.0, 9.0, 11.0], [20.0, 21.0, 22.0]]


@pytest.mark.long
def test_the_best_values_stay_and_the_gaps_double(generator):
    """The chain of five cells of `test_ddqn`, with α = 1/2: Q = V − (V − Q) / (1 − α)."""
    discount = 0.9
    best = discount ** (3 - np.arange(4))
    left = discount * best[np.maximum(np.arange(4) - 1, 0)]
    network = nn.Linear(4, 2, bias=False)
    nn.init.zeros_(network.weight)
    ddqn = DDQN(network, torch.optim.Adam(network.parameters(), 0.02), 0.2)
    one_hot = torch.eye(4)
    for _ in range(1000):
        state, action = generator.integers(0, 4, 16), torch.tensor(generator.integers(0, 2, 16))
        after = np.maximum(state + 2 * action.numpy() - 1, 0)
        end = torch.tensor(after == 4)
        y = ddqn.targets(end.float(), (~end) * discount, (one_hot[np.minimum(after, 3)],))
        seen = one_hot[state]
        with torch.no_grad():
            gap = action_gap(ddqn.target(seen), action)
        ddqn.update((seen,), action, widen_gap(y, gap, 0.5))
    learned = network.weight.detach().T.numpy()
    assert learned[:, 1] == pytest.approx(best, abs=0.02)
    assert learned[:, 0] == pytest.approx(best - 2 * (best - left), abs=0.02)
