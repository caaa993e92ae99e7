"""QR-DQN: learn quantiles of the return instead of its mean alone (Dabney et al., 2018).

Three things differ from `ddqn.py`: the network's head has N values for each action, the targets are
N samples of the return, and the loss is the quantile Huber loss. The policy acts on the mean.
"""

import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from uavdh_lite.ddqn import DDQN, only_allowed
from uavdh_lite.environment import ACTIONS
from uavdh_lite.network import QNetwork


class QuantileNetwork(QNetwork):
    """N quantiles of each action's return; their mean is the Q-value: `network(maps, time)`.

    Arguments:
        quantiles: N. The other arguments are those of `QNetwork`.
    """

    def __init__(self, *arguments, quantiles: int, **options):
        super().__init__(*arguments, outputs=len(ACTIONS) * quantiles, **options)

    def quantiles(self, maps: list[Tensor], time: Tensor) -> Tensor:
        """The quantiles at the levels of `midpoints`, (B, 6, N)."""
        return super().forward(maps, time).unflatten(1, (len(ACTIONS), -1))

    def forward(self, maps: list[Tensor], time: Tensor) -> Tensor:
        return self.quantiles(maps, time).mean(dim=2)


def midpoints(count: int) -> Tensor:
    """The levels τ̂ of N quantiles, the middles of N equal parts of [0, 1]; (N,) (lemma 2)."""
    return (torch.arange(count) + 0.5) / count


def quantile_huber_loss(quantiles: Tensor, samples: Tensor, kappa: float) -> Tensor:
    """The mean over the batch of Σ_i mean_j |τ̂_i − 1{u < 0}| · L_κ(u), u = y_j − θ_i (eq. 10).

    Arguments:
        quantiles: (B, N), θ.
        samples: (B, any number), y, samples of the return.
        kappa: κ, the error above which Huber's L is linear.
    """
    error = samples[:, None, :] - quantiles[:, :, None]
    level = midpoints(quantiles.shape[1]).to(quantiles.device)[:, None]
    weight = (level - (error < 0).float()).abs()
    huber = huber_loss(error, torch.zeros_like(error), reduction="none", delta=kappa)
    return (weight * huber).mean(dim=2).sum(dim=1).mean()


class QRDQN(DDQN):
    """`DDQN` with a `QuantileNetwork`: `huber_delta` is κ, and the targets are (B, N)."""

    online: QuantileNetwork
    target: QuantileNetwork
    huber_delta: float

    @torch.no_grad()
    def targets(
        self, reward: Tensor, discount: Tensor, next_observation, allowed: Tensor | None = None
    ) -> Tensor:
        """y_j = r + γ · θ_j(s', a*) of the target network, (B, N).

        As in `DDQN`, the online network chooses a*, the action with the largest mean.
        """
        best = only_allowed(self.online(*next_observation), allowed).argmax(dim=1)
        quantiles = self.target.quantiles(*next_observation)
        chosen = quantiles[torch.arange(len(best)), best]
        return reward[:, None] + discount[:, None] * chosen

    def loss(self, observation, action: Tensor, y: Tensor) -> Tensor:
        """The quantile Huber loss of the actions taken."""
        quantiles = self.online.quantiles(*observation)
        taken = quantiles[torch.arange(len(action)), action]
        return quantile_huber_loss(taken, y, self.huber_delta)
