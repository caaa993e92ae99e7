"""Double deep Q-learning: the paper's equations, and nothing else."""

import copy

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import huber_loss, mse_loss


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


def only_allowed(q_values: Tensor, allowed: Tensor | None) -> Tensor:
    """The Q-values, (B, actions), but −∞ for actions that are not allowed; None allows all."""
    return q_values if allowed is None else q_values.masked_fill(~allowed, -torch.inf)


def softmax_policy(q_values: Tensor, temperature: float) -> Tensor:
    """π(a|s) ∝ exp(Q(s, a) / β), (B, actions) (eq. 12)."""
    return torch.softmax(q_values / temperature, dim=1)


def draw_actions(probabilities: Tensor, generator: np.random.Generator) -> np.ndarray:
    """One action for each row of probabilities; (B,) ints."""
    cumulative = probabilities.cpu().double().cumsum(dim=1).numpy()
    # Rounded, the last sum may be less than 1: no draw is to lie above it.
    draws = generator.random(len(cumulative))[:, None] * cumulative[:, -1:]
    return (cumulative[:, :-1] < draws).sum(axis=1)


@torch.no_grad()
def soft_update(target: nn.Module, online: nn.Module, rate: float) -> None:
    """θ̄ ← (1 − τ) θ̄ + τ θ, in place."""
    torch._foreach_lerp_(list(target.parameters()), list(online.parameters()), rate)


class Networks:
    """The online network and the target network; the latter starts as a copy of the former."""

    def __init__(self, online: nn.Module):
        self.online = online
        self.target = copy.deepcopy(online).requires_grad_(False)

    @torch.no_grad()
    def targets(
        self, reward: Tensor, discount: Tensor, next_observation, allowed: Tensor | None = None
    ) -> Tensor:
        """The targets y of a minibatch, (B,): `ddqn_target` with the Q-values of both networks.

        Arguments:
            reward, discount: (B,), the discount 0 where the episode ended.
            next_observation: what the networks take, as a tuple of arguments.
            allowed: (B, actions) bool, the actions to choose from in s'; None for all.
        """
        online_next, target_next = self.online(*next_observation), self.target(*next_observation)
        return ddqn_target(reward, discount, only_allowed(online_next, allowed), target_next)

    @torch.no_grad()
    def copy_from(self, other: "Networks") -> None:
        """Copy the weights of `other`, in place."""
        for mine, theirs in ((self.online, other.online), (self.target, other.target)):
            torch._foreach_copy_(list(mine.parameters()), list(theirs.parameters()))


class DDQN(Networks):
    """Both networks and the optimiser of the online one.

    Arguments:
        online: the network to train.
        optimiser: over the parameters of `online`.
        target_update_rate: τ.
        huber_delta: the error above which the loss is linear; None for the squared error.
    """

    def __init__(
        self,
        online: nn.Module,
        optimiser: torch.optim.Optimizer,
        target_update_rate: float,
        huber_delta: float | None = None,
    ):
        super().__init__(online)
        self.optimiser = optimiser
        self.target_update_rate = target_update_rate
        self.huber_delta = huber_delta

    def update(self, observation, action: Tensor, y: Tensor) -> Tensor:
        """One gradient step towards the targets and one soft update; returns the loss.

        Arguments:
            observation: what the networks take, as a tuple of arguments.
            action: (B,) int64.
            y: (B,), from `targets`.
        """
        loss = self.loss(observation, action, y)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        soft_update(self.target, self.online, self.target_update_rate)
        return loss.detach()

    def loss(self, observation, action: Tensor, y: Tensor) -> Tensor:
        """The squared error, or Huber's loss, of the Q-values of the actions taken."""
        q = self.online(*observation).gather(1, action[:, None]).squeeze(1)
        if self.huber_delta is None:
            return mse_loss(q, y)
        return huber_loss(q, y, delta=self.huber_delta)

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
