"""QR-DQN: learn quantiles of the return instead of its mean alone (Dabney et al., 2018).

Three things differ from `ddqn.py`: the network has N outputs for each action, the targets are N
samples of the return, and the loss is the quantile Huber loss. The policy acts on the mean.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import huber_loss

from uavdh_lite.ddqn import DDQN
from uavdh_lite.environment import ACTIONS
from uavdh_lite.replay import Batch


class QuantileNetwork(nn.Module):
    """N quantiles of each action's return; their mean is the Q-value: `network(map, time)`.

    Arguments:
        network: with 6·N outputs.
    """

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def quantiles(self, *observation: Tensor) -> Tensor:
        """The quantiles at the levels of `midpoints`, (B, 6, N)."""
        return self.network(*observation).unflatten(1, (len(ACTIONS), -1))

    def forward(self, *observation: Tensor) -> Tensor:
        return self.quantiles(*observation).mean(dim=2)


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
    """`DDQN` of a network with `quantiles`: `huber_delta` is κ, and the targets are (B, N)."""

    online: QuantileNetwork
    target: QuantileNetwork
    huber_delta: float

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """y_j = r + γ · θ_j(s', a*) of the target network, (B, N).

        As in `DDQN`, the online network chooses a*, the action with the largest mean.
        """
        observation = self.observation(batch.next_state)
        best = self.online(*observation).argmax(dim=1)
        chosen = self.target.quantiles(*observation)[torch.arange(len(best)), best]
        reward, discount = self.tensor(batch.reward), self.tensor(batch.discount)
        return reward[:, None] + discount[:, None] * chosen

    def loss(self, batch: Batch, y: Tensor) -> Tensor:
        """The quantile Huber loss of the actions taken."""
        quantiles = self.online.quantiles(*self.observation(batch.state))
        taken = quantiles[torch.arange(len(quantiles)), self.tensor(batch.action)]
        return quantile_huber_loss(taken, y, self.huber_delta)
