"""Advantage learning: widen the gap between the best action and the others (Bellemare et al. 2016).

Where the Q-values of all actions are nearly equal, errors of the network decide, and the UAV turns
back and forth. Taking α times the gap from the target, y − α (max_b Q(s, b) − Q(s, a)), leaves the
best action's value unchanged and makes the gaps 1/(1 − α) times as wide.
"""

import torch
from torch import Tensor

from uavdh_lite.ddqn import DDQN
from uavdh_lite.replay import Batch


class AdvantageLearning(DDQN):
    """Put before a learner, as in `class Both(AdvantageLearning, QRDQN)`, it widens its gaps.

    Arguments:
        gap_share: α, the share of the gap that is taken from the targets; from 0 to below 1.
        The others are those of the learner.
    """

    def __init__(self, *arguments, gap_share: float, **options):
        super().__init__(*arguments, **options)
        self.gap_share = gap_share

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """The learner's targets, (B,) or (B, N), minus α times the gap of the action taken."""
        y = super().targets(batch)
        q_values = self.target(*self.observation(batch.state))
        gap = self.gap_share * action_gap(q_values, self.tensor(batch.action))
        return y - gap.view(-1, *(1,) * (y.dim() - 1))


def action_gap(q_values: Tensor, action: Tensor) -> Tensor:
    """max_b Q(s, b) − Q(s, a), 0 for the best action; (B,).

    Arguments:
        q_values: (B, actions), of the target network.
        action: (B,) int64.
    """
    return q_values.amax(dim=1) - q_values.gather(1, action[:, None]).squeeze(1)
