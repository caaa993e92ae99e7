"""Watches an answer that trains a network, and stops it at what its first updates do wrong."""

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from uavdh_lite.course.checks.exercise import CheckFailed

LOSSES = ("sub", "__rsub__", "mse_loss", "huber_loss", "smooth_l1_loss", "l1_loss")
IN_PLACE = ("lerp_", "copy_", "mul_", "add_")  # as the target network may follow
UPDATES = 3  # that are looked at


class Watched(TorchFunctionMode):
    """While an answer trains: raises `CheckFailed` where the first updates go wrong.

    Arguments:
        tau: the share of the way that a target network moves in each update, if it is known.

    `losses` counts the calls of `backward`.
    `ends` says whether a minibatch had a terminal transition; None if none was seen as Booleans.
    `lags` says whether layers ever had weights other than the trained ones; None if none were seen.
    """

    def __init__(self, tau: float | None = None):
        super().__init__()
        self.tau, self.ends, self.lags = tau, None, None
        self.updates, self.idle, self.largest, self.losses = 0, 0, True, 0
        self.before: dict[Tensor, Tensor] = {}  # the trained weights at the last `backward`
        self.used: dict[Tensor, None] = {}  # the weights of all layers before the first update
        self.asked: list[Tensor] = []  # copies of those since the last `backward`
        self.targets: list[tuple[Tensor, Tensor, Tensor]] = []  # target, online, target before
        self.cells: dict[bool, list[Tensor]] = {}  # since the last update, by whether it learns
        self.moved: list[tuple[Tensor, Tensor]] = []  # Q-values and the loss's slopes in them

    def __torch_function__(self, func, types, args=(), kwargs=None):
        given = [*args, *(kwargs or {}).values()]
        if func is torch.tensor and str(getattr(given[0], "dtype", "")) == "bool":
            self.ends = bool(self.ends or given[0].any())
        self.losses += func is Tensor.backward
        tensors = [one for one in given[:2] if isinstance(one, Tensor)]
        if tensors and not self.lags:  # a target network may be made late
            self._lagging(func, tensors[-1])
        if self.updates >= UPDATES or not tensors:
            return func(*args, **(kwargs or {}))
        if len(tensors) == 2 and func.__name__ in (*LOSSES, "add", "mul"):
            _compared(*tensors, func.__name__ in LOSSES)
        weight = tensors[0].is_leaf and tensors[0].requires_grad and torch.is_grad_enabled()
        if weight and func.__name__ in IN_PLACE:
            raise CheckFailed(
                "Weights are changed outside of `torch.no_grad()`: put the lines in which the "
                "target network follows under `with torch.no_grad():`."
            )
        if not self.before and func.__name__ in ("linear", "conv2d"):
            self.used[tensors[-1]] = None
        if func is Tensor.backward:
            self._update(tensors[0])
        result = func(*args, **(kwargs or {}))
        if func.__name__ == "linear" and tensors[0].shape[1:] == (2,):
            self.cells.setdefault(torch.is_grad_enabled(), []).append(tensors[0])
        if func.__name__ == "linear" and result.requires_grad and result.shape[1:] == (4,):
            q = result.detach()
            result.register_hook(lambda slope: self.moved.append((q, slope)))
        if func is Tensor.backward:
            self._moved()
        return result

    def _lagging(self, func, tensor: Tensor) -> None:
        """Whether layers had other weights than those of which the loss is made."""
        if func.__name__ in ("linear", "conv2d") and self.before:
            self.asked.append(tensor.detach().clone())  # one network may hold two sets in turn
        elif func is Tensor.backward:
            own = _weights(tensor)
            other = [all(not torch.equal(one, w) for w in own) for one in self.asked]
            self.lags = any(other) if not all(other) else self.lags
            self.asked.clear()

    def trained(self, network: torch.nn.Module) -> bool:
        """Whether weights of a network are those that were trained; True if none were seen."""
        own = [(p, w) for p in network.parameters() for w in self.before]
        return not own or any(torch.equal(p, w) for p, w in own)

    def _moved(self) -> None:
        """Which Q-values of a row the last loss moves, and whose value y was made of."""
        learned, judged = self.cells.pop(True, [None])[-1], self.cells.pop(False, [])
        if learned is not None and judged and all(torch.equal(learned, cells) for cells in judged):
            raise CheckFailed(
                "y is computed from the Q-values of the cell itself. It needs those of the next "
                "cell."
            )
        for q, slope in self.moved[:1]:  # of the last layer, whose slopes come first
            if (slope != 0).sum(1).max() > 1:
                raise CheckFailed(
                    "All four Q-values of a cell move towards y. Only that of the action that was "
                    "taken may: `gather` picks it."
                )
            sizes, spread = slope[slope != 0].abs(), q[slope != 0]
            equal = len(sizes) > 2 and torch.allclose(sizes, sizes[:1])
            if equal and spread.max() - spread.min() > 0.01:  # so the errors are not
                raise CheckFailed(
                    "All errors, small or large, move their Q-values equally. The loss must be the "
                    "mean of the squared errors, not of their sizes."
                )
            learns = (slope != 0).any(1)
            self.largest &= torch.equal(slope.abs().argmax(1)[learns], q.argmax(1)[learns])
        if self.moved and self.largest and self.updates == UPDATES:
            raise CheckFailed(
                "The largest Q-value of each cell moves towards y. It must be that of the action "
                "that was taken: `gather` picks it."
            )
        self.moved.clear()

    def _update(self, loss: Tensor) -> None:
        """Look at the weights as `backward` is called."""
        weights = _weights(loss)
        for other in self.used if not self.before else ():
            same = [own for own in weights if own.shape == other.shape]
            copied = [own for own in same if torch.equal(own, other)]
            if same and not copied:
                raise CheckFailed(
                    "The target network does not begin as a copy of the online one: "
                    "`copy.deepcopy(online)` is one.",
                    seen=False,
                )
            if all(own is not other for own in weights) and copied:
                self.targets.append((other, copied[0], other.detach().clone()))
        stale = {w for w in weights if w.grad is not None and w.grad.any()}
        still = {w for w in weights if w in self.before and torch.equal(w, self.before[w])}
        moved = len(still) < len(weights)
        if self.before and moved and stale:
            raise CheckFailed(
                "Some weights never change: the optimiser must have all of the online network's, "
                "`online.parameters()`."
                if stale <= still
                else "The slopes of earlier updates are still there, and new ones are added to "
                "them: `optimiser.zero_grad()` is missing before `loss.backward()`."
            )
        if self.before and moved and self.tau:
            self._followed()
        self.updates += moved
        self.idle = 0 if moved else self.idle + 1
        if self.idle > (64 if stale else 1):  # a loss may be made of many parts
            raise CheckFailed(
                "The weights do not change from update to update. `optimiser.step()` must follow "
                "`loss.backward()`, without `zero_grad()` between them, and with an optimiser of "
                "the online network's parameters."
            )
        self.before = {w: w.detach().clone() for w in weights}

    def _followed(self) -> None:
        """How the target network has followed the online one in the last update."""
        if self.targets and all(torch.equal(now, old) for now, _, old in self.targets):
            raise CheckFailed(
                "After an update your target network was the same as before. After every single "
                "update it must move the share τ of the way to the online one.",
                seen=False,
            )
        right, swapped = (
            all(torch.allclose(now, old.lerp(own, share)) for now, own, old in self.targets)
            for share in (self.tau, 1 - self.tau)
        )
        if self.targets and swapped and not right:
            raise CheckFailed(
                "τ and 1 − τ are swapped: the target network keeps the share 1 − τ of its weights.",
                seen=False,
            )
        self.targets = [(now, own, now.detach().clone()) for now, own, _ in self.targets]


def _compared(one: Tensor, other: Tensor, as_loss: bool) -> None:
    """Two tensors that are added, multiplied or subtracted, or whose loss is computed."""
    n = max(one.numel(), other.numel())
    if n > 1 and {tuple(one.shape), tuple(other.shape)} == {(n,), (n, 1)}:
        raise CheckFailed(
            f"A tensor of shape {tuple(one.shape)} meets one of shape "
            f"{tuple(other.shape)}: that makes {n} × {n} numbers. Give both the same shape."
        )
    flows = one.grad_fn is not None and other.grad_fn is not None and torch.is_grad_enabled()
    if as_loss and flows and one.shape == other.shape and one.shape[1:] in ((), (1,)):
        raise CheckFailed("A gradient runs through y: compute it inside `torch.no_grad()`.")


def _weights(loss: Tensor) -> list[Tensor]:
    """The weights that a loss depends on, by its graph."""
    weights, seen, left = [], set(), [loss.grad_fn]
    while left:
        node = left.pop()
        if node is not None and node not in seen:
            seen.add(node)
            left += [before for before, _ in node.next_functions]
            if hasattr(node, "variable"):
                weights.append(node.variable)
    return weights
