import numpy as np
import pytest
import torch
from torch import nn

from uavdh_lite.beyond.recipes import AdvantageDDQN
from uavdh_lite.replay import Batch


@pytest.mark.parametrize("gap_share", [0.0, 0.5])
def test_targets_lose_a_share_of_the_gap_by_the_target_network_in_the_state_itself(gap_share):
    """In state 0 the target network has Q-values 3 and 7; state 1 is worth 2."""
    network, one_hot = nn.Linear(2, 2, bias=False), torch.eye(2)
    learner = AdvantageDDQN(
        lambda state: (one_hot[state],), network, None, 0.5, gap_share=gap_share
    )
    learner.online.weight.data = torch.tensor([[100.0, 1.0], [0.0, 0.0]])
    learner.target.weight.data = torch.tensor([[3.0, 2.0], [7.0, 9.0]])
    state, next_state = np.array([0, 0]), np.array([1, 1])
    y = learner.targets(Batch(state, np.array([0, 1]), *np.ones((2, 2), np.float32), next_state))
    assert y.tolist() == [1 + 2 - gap_share * (7 - 3), 1 + 2]
