"""Double deep Q-learning: the target, the loss, and one update of the networks (section III-B)."""

import copy

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import huber_loss, mse_loss

from uavdh_lite.environment import State
from uavdh_lite.observation import Observation
from uavdh_lite.replay import Batch


def ddqn_target(
    reward: Tensor, discount: Tensor, online_next: Tensor, target_next: Tensor
) -> Tensor:
    """y = r + γ · Q_target(s', argmax_a Q_online(s', a)), (B,) (eq. 8).

    Arguments:
        reward, discount: (B,), the discount 0 where the episode ended.
        online_next, target_next: (B, actions), Q-values of s' by the two networks.
    """
    best = online_next.argmax(dim=1, keepdim=True)
    return reward + discount * target_next.gather(1, best).squeeze(1)


def softmax_policy(q_values: Tensor, temperature: float) -> Tensor:
    """π(a|s) ∝ exp(Q(s, a) / β), (B, actions) (eq. 10)."""
    return torch.softmax(q_values / temperature, dim=1)


def draw_actions(probabilities: Tensor, generator: np.random.Generator) -> np.ndarray:
    """One action for each row of probabilities; (B,) ints."""
    cumulative = probabilities.cpu().double().cumsum(dim=1).numpy()
    # Rounded, the last sum may be less than 1: no draw is to lie above it. A draw may be exactly 0,
    # and an action of probability 0 is not to be drawn: hence ≤.
    draws = generator.random(len(cumulative))[:, None] * cumulative[:, -1:]
    return (cumulative[:, :-1] <= draws).sum(axis=1)


@torch.no_grad()
def soft_update(target: nn.Module, online: nn.Module, tau: float) -> None:
    """θ̄ ← (1 − τ) θ̄ + τ θ, in place."""
    torch._foreach_lerp_(list(target.parameters()), list(online.parameters()), tau)


class DDQN:
    """The online network, the target network, and the optimiser of the former (section III-B).

    The target network starts as a copy of the online one.

    Arguments:
        observation: makes what the networks take from states.
        network: the online network, to be trained: `network(*observation(state)) -> (B, 6)`.
        optimiser: over its parameters.
        target_update_rate: τ.
        huber_delta: the error above which the loss is linear; None for the squared error.
    """

    def __init__(
        self,
        observation: Observation,
        network: nn.Module,
        optimiser: torch.optim.Optimizer,
        target_update_rate: float,
        huber_delta: float | None = None,
    ):
        self.observation = observation
        self.online = network
        self.target = copy.deepcopy(network).requires_grad_(False)
        self.optimiser = optimiser
        self.target_update_rate = target_update_rate
        self.huber_delta = huber_delta

    @torch.no_grad()
    def q_values(self, state: State) -> Tensor:
        """Q-values by the online network, (B, 6)."""
        return self.online(*self.observation(state))

    def update(self, batch: Batch) -> Tensor:
        """One gradient step towards the targets, and one soft update; returns the loss."""
        loss = self.loss(batch, self.targets(batch))
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        soft_update(self.target, self.online, self.target_update_rate)
        return loss.detach()

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """The targets y, (B,): `ddqn_target` with the Q-values of both networks."""
        observation = self.observation(batch.next_state)
        return ddqn_target(
            self.tensor(batch.reward),
            self.tensor(batch.discount),
            self.online(*observation),
            self.target(*observation),
        )

    def loss(self, batch: Batch, y: Tensor) -> Tensor:
        """The squared error (eq. 7), or Huber's loss, of the Q-values of the actions taken."""
        q_values = self.online(*self.observation(batch.state))
        q = q_values.gather(1, self.tensor(batch.action)[:, None]).squeeze(1)
        if self.huber_delta is None:
            return mse_loss(q, y)
        return huber_loss(q, y, delta=self.huber_delta)

    def tensor(self, array: np.ndarray) -> Tensor:
        """An array on the networks' device."""
        return torch.from_numpy(array).to(next(self.online.parameters()).device)

    def set_learning_rate(self, rate: float) -> None:
        """Set the optimiser's learning rate from now on."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate

    def state_dict(self) -> dict[str, Tensor]:
        """The weights of both networks and Adam's moments of each weight, by name."""
        tensors = self._networks.state_dict()
        for name, weight in self.online.named_parameters():
            moments = self.optimiser.state.get(weight, {})  # none before the first update
            tensors |= {f"{moment}.{name}": value for moment, value in moments.items()}
        return tensors

    def load_state_dict(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `state_dict` gave, for networks of the same shape."""
        self._networks.load_state_dict(
            {name: tensors[name] for name in self._networks.state_dict()}
        )
        for name, weight in self.online.named_parameters():
            self.optimiser.state[weight] = {
                moment: tensors[f"{moment}.{name}"].to(weight.device)
                for moment in ("step", "exp_avg", "exp_avg_sq", "max_exp_avg_sq")
                if f"{moment}.{name}" in tensors
            }

    @property
    def _networks(self) -> nn.Module:
        return nn.ModuleDict({"online": self.online, "target": self.target})
