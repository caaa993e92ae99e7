"""Advantage learning: widen the gap between the best action and the others (Bellemare et al. 2016).

Where the Q-values of all actions are nearly equal, errors of the network decide, and the UAV turns
back and forth. Taking α times the gap from the target, y − α (max_b Q(s, b) − Q(s, a)), leaves the
best action's value unchanged and makes the gaps 1/(1 − α) times as wide.
"""

from torch import Tensor

from uavdh_lite.ddqn import only_allowed


def action_gap(q_values: Tensor, action: Tensor, allowed: Tensor | None = None) -> Tensor:
    """max_b Q(s, b) − Q(s, a), 0 for the best action; (B,).

    Arguments:
        q_values: (B, actions), of the target network.
        action: (B,) int64.
        allowed: (B, actions) bool, the actions to take the maximum of; None for all.
    """
    best = only_allowed(q_values, allowed).amax(dim=1)
    return best - q_values.gather(1, action[:, None]).squeeze(1)


def widen_gap(y: Tensor, gap: Tensor, alpha: float) -> Tensor:
    """The targets y, (B,) or (B, N) for quantiles, minus α times the gap, (B,)."""
    return y - alpha * (gap if y.dim() == 1 else gap[:, None])
