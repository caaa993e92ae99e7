"""Double deep Q-learning: the paper's equations, and nothing else."""

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
    """y = r + γ · Q_target(s', argmax_a Q_online(s', a)), (B,) (eq. 10).

    Arguments:
        reward, discount: (B,), the discount 0 where the episode ended.
        online_next, target_next: (B, actions), Q-values of s' by the two networks.
    """
    best = online_next.argmax(dim=1, keepdim=True)
    return reward + discount * target_next.gather(1, best).squeeze(1)


def softmax_policy(q_values: Tensor, temperature: float) -> Tensor:
    """π(a|s) ∝ exp(Q(s, a) / β), (B, actions) (eq. 12)."""
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
        """`fit` a minibatch to its `targets`; returns the loss."""
        return self.fit(batch, self.targets(batch))

    def fit(self, batch: Batch, y: Tensor) -> Tensor:
        """One gradient step towards the targets y, and one soft update; returns the loss."""
        loss = self.loss(batch, y)
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
        """The squared error, or Huber's loss, of the Q-values of the actions taken."""
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
        """The weights of both networks and the optimiser's moments, by name."""
        tensors: dict[str, Tensor] = {}
        for part in ("online", "target"):
            weights = getattr(self, part).state_dict()
            tensors |= {f"{part}.{name}": value for name, value in weights.items()}
        for index, moments in self.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{name}": value for name, value in moments.items()}
        return tensors

    def load_state_dict(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `state_dict` gave, for networks of the same shape."""
        parts: dict[str, dict[str, Tensor]] = {"online": {}, "target": {}, "optimiser": {}}
        for key, value in tensors.items():
            part, name = key.split(".", 1)
            parts[part][name] = value
        self.online.load_state_dict(parts["online"])
        self.target.load_state_dict(parts["target"])
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in parts["optimiser"].items():
            index, name = key.split(".")
            moments.setdefault(int(index), {})[name] = value
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": moments, "param_groups": groups})
