"""Wrong answers to the exercises of notebook 5, and what the message must say of each."""

import numpy as np
import torch


def _softmax(q, dim=1):
    powers = torch.exp(q)
    return powers / powers.sum(dim, keepdim=True)


def _top_of_all(q, beta):
    powers = torch.exp((q - q.max()) / beta)
    return powers / powers.sum(1, keepdim=True)


def _scales_in_place(q, beta):
    q /= beta
    return torch.softmax(q, 1)


def _shifted(q, beta, top, dim=1):
    powers = torch.exp((q - top) / beta)
    return powers / (powers.sum(dim, keepdim=True) if dim is not None else powers.sum())


class _Base:
    def __init__(self, capacity):
        self.capacity, self.places, self.count = capacity, [None] * capacity, 0

    def add(self, item):
        self.places[self.count % self.capacity] = item
        self.count += 1

    def stored(self):
        return self.places[: self.count]

    def sample(self, size, generator):
        stored = self.stored()
        rest = generator.integers(0, len(stored), size - 1)
        return [self.places[(self.count - 1) % self.capacity], *(stored[k] for k in rest)]


class Plain(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        return [stored[k] for k in generator.integers(0, len(stored), size)]


class NewestAtTheEnd(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        return [stored[-1], *(stored[k] for k in generator.integers(0, len(stored), size - 1))]


class NextPlace(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        newest = stored[self.count % self.capacity if self.count >= self.capacity else -1]
        return [newest, *(stored[k] for k in generator.integers(0, len(stored), size - 1))]


class Unfilled(_Base):
    def stored(self):
        return self.places


class UpToTheCapacity(_Base):
    def __init__(self, capacity):
        self.capacity, self.places, self.count = capacity, [], 0

    def add(self, item):
        self.places[self.count % self.capacity : self.count % self.capacity + 1] = [item]
        self.count += 1

    def sample(self, size, generator):
        rest = generator.integers(0, self.capacity, size - 1)
        return [self.places[(self.count - 1) % self.capacity], *(self.places[k] for k in rest)]


class AssignsToAnEmptyList(UpToTheCapacity):
    def add(self, item):
        self.places[self.count % self.capacity] = item


class NoReplacement(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        rest = generator.choice(len(stored), size - 1, replace=False)
        return [self.places[(self.count - 1) % self.capacity], *(stored[k] for k in rest)]


class Grows(_Base):
    def __init__(self, capacity):
        self.places = []

    def add(self, item):
        self.places.append(item)

    def sample(self, size, generator):
        rest = generator.integers(0, len(self.places), size - 1)
        return [self.places[-1], *(self.places[k] for k in rest)]


class OverwritesTheNewest(Grows):
    def __init__(self, capacity):
        super().__init__(capacity)
        self.capacity = capacity

    def add(self, item):
        if len(self.places) == self.capacity:
            self.places.pop()
        self.places.append(item)


class OneTooMany(_Base):
    def sample(self, size, generator):
        return super().sample(size + 1, generator)


class WithoutReplacement(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        order = generator.permutation(len(stored))[: size - 1]
        return [self.places[(self.count - 1) % self.capacity], *(stored[k] for k in order)]


class LastPlaceNever(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        rest = generator.integers(0, max(len(stored) - 1, 1), size - 1)
        return [self.places[(self.count - 1) % self.capacity], *(stored[k] for k in rest)]


class OwnChance(_Base):
    def sample(self, size, generator):
        return super().sample(size, np.random.default_rng())


class Arrays(_Base):
    def sample(self, size, generator):
        newest = self.places[(self.count - 1) % self.capacity]
        return [newest, *generator.choice(self.stored(), size - 1)]


class Unwritten(_Base):
    def sample(self, size, generator):
        raise NotImplementedError


class Skewed(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        rest = (generator.random(size - 1) ** 2 * len(stored)).astype(int)
        return [self.places[(self.count - 1) % self.capacity], *(stored[k] for k in rest)]


def _value(chooser, judge):
    return judge.gather(1, chooser.argmax(1, keepdim=True)).squeeze(1)


def _rebinds(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t = (1 - rate) * t + rate * o


def _returns(target, online, rate):
    return [(1 - rate) * t + rate * o for t, o in zip(target, online, strict=True)]


def _new_in_list(target, online, rate):
    for k in range(len(target)):
        target[k] = (1 - rate) * target[k] + rate * online[k]


def _swapped(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t.mul_(rate).add_((1 - rate) * o)


def _shrinks_online(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t.mul_(1 - rate).add_(o.mul_(rate))


def _adds(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t += rate * o


def _copies(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t.copy_(o)


def _first_only(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t.lerp_(o, rate)
        return target


def _shares(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t.set_(o) if rate == 1 else t.lerp_(o, rate)


def _unwritten(*arguments):
    raise NotImplementedError


def _double(r, t, d, online, target):
    return r + d * ~t * _value(online, target)


WRONG_TARGETS = [
    (lambda r, t, d, online, target: _double(r, t, 0.9, online, target), "γ times the entry"),
    (lambda r, t, d, online, target: _double(r, t, d**2, online, target), "counts γ times"),
    (lambda r, t, d, online, target: r + d * target.amax(1), "what the wrong function gives"),
    (lambda r, t, d, online, target: r + d * ~t * target.amax(1), "plain DQN"),
    (
        lambda r, t, d, online, target: r + d * target[:, online.argmax(1)],
        "has the shape",
    ),
    (
        lambda r, t, d, online, target: r + d * target[online.argmax(1)],
        "one target for each transition",
    ),
    (lambda r, t, d, online, target: r + d * online, "one target for each transition"),
    (lambda r, t, d, online, target: r + d * ~t * _value(target, online), "swapped"),
    (lambda r, t, d, online, target: r + d * _value(online, target), "not masked"),
    (lambda r, t, d, online, target: r + d * ~t * online.amax(1), "also chooses"),
    (lambda r, t, d, online, target: r + d * t * _value(online, target), "wrong way round"),
    (lambda r, t, d, online, target: (r + d * _value(online, target)) * ~t, "reward is lost"),
    (
        lambda r, t, d, online, target: (
            r + d * ~t * target.gather(1, online.argmax(1, keepdim=True))
        ),
        "has the shape",
    ),
    (lambda r, t, d, online, target: r + d * ~t * online.argmax(1), "number of the best"),
    (
        lambda r, t, d, online, target: r + d * (1 - t) * _value(online, target),
        "stops with RuntimeError: Subtraction",
    ),
]


def _matrices_only(target, online, rate):
    for a, b in zip(target, online, strict=True):
        if a.dim() > 1:
            a.mul_(1 - rate).add_(rate * b)


class PopsTheFirst(Grows):
    def __init__(self, capacity):
        super().__init__(capacity)
        self.capacity = capacity

    def add(self, item):
        if len(self.places) == self.capacity:
            self.places.pop(0)
        self.places.append(item)


class OneForAll(_Base):
    def sample(self, size, generator):
        stored = self.stored()
        newest = self.places[(self.count - 1) % self.capacity]
        return [newest, *[stored[generator.integers(0, len(stored))]] * (size - 1)]


MISTAKES = {
    "stable_policy": [
        (lambda q, beta: _softmax(q / beta), "it overflows"),
        (lambda q, beta: _softmax(q * beta), "Divide Q by β"),
        (lambda q, beta: _softmax(q / beta, 0), "the sum of its own row"),
        (lambda q, beta: torch.exp(q / beta) / torch.exp(q / beta).sum(), "the sum of its own row"),
        (
            lambda q, beta: (torch.exp(q) / beta) / (torch.exp(q) / beta).sum(1, True),
            "Divide Q by β",
        ),
        (lambda q, beta: _shifted(q, beta, q.amin(1, True)), "smaller than the maximum"),
        (lambda q, beta: _shifted(q, beta, q.mean(1, True)), "smaller than the maximum"),
        (lambda q, beta: _shifted(q, beta, q.amax(1, True), None), "the sum of its own row"),
        (lambda q, beta: _shifted(q, beta, q.amax(1, True), 0), "the sum of its own row"),
        (lambda q, beta: _shifted(q, beta, q.amax(0)), "maximum over the states, dim=0"),
        (lambda q, beta: _shifted(q, beta, q.max(1, keepdim=True)), "take `.values`"),
        (lambda q, beta: _shifted(q, beta, q.amax(1)), r"keepdim=True makes \(B, 1\)"),
        (lambda q, beta: torch.exp((q - q.amax(1, True)) / beta), "so that it sums to 1"),
        (_top_of_all, "subtract from each row its own maximum"),
        (_scales_in_place, "changes what it is given"),
        (lambda q, beta: torch.log_softmax(q / beta, 1), "logarithms"),
        (lambda q, beta: torch.softmax(q / beta, 1).tolist(), "torch tensor is expected"),
    ],
    "ring_buffer": [
        (PopsTheFirst, r"pop\(0\) does"),
        (OneForAll, "each of them on its own"),
        (Plain, "newest item is in every sample"),
        (NewestAtTheEnd, "in the place of the oldest"),
        (NextPlace, "to be overwritten next"),
        (Unfilled, "only from those that are filled"),
        (UpToTheCapacity, "only the places that are filled"),
        (AssignsToAnEmptyList, "only the places that were appended"),
        (NoReplacement, "items may repeat"),
        (Grows, "the ring does not grow"),
        (OverwritesTheNewest, "must overwrite the oldest, and no other"),
        (OneTooMany, "the newest counts as one of them"),
        (WithoutReplacement, "may come more than once"),
        (LastPlaceNever, "upper end"),
        (OwnChance, "generator that is passed in"),
        (Arrays, "generator.choice makes arrays"),
        (Unwritten, "Ring is not written yet"),
        (Skewed, "not equally likely"),
        (_Base(3), "without brackets"),
    ],
    "double_target": [
        *(((function, [2.8, -0.2]), message) for function, message in WRONG_TARGETS),
        *(
            ((_double, by_hand), f"^by_hand: .*{message}")
            for by_hand, message in (
                ([6.4, 4.3], "That is what the wrong function gives"),
                ([6.4, -0.2], "You take the largest Q-value of the target"),
                ([5.5, -0.2], "You take the value from the online network"),
                ([3.7, -0.2], "The networks are swapped"),
                ([2.8, 1.6], "Terminal transitions are not masked"),
                ([2.8, 0], "At the terminal transitions the reward is lost"),
                ([3, -0.2], "The discount is missing"),
                ([1.9, -0.2], "You add the number of the best action"),
                ([2.8, 7], r"\[2.8, 7\] is not right"),
                ([9, 7], r"\[9, 7\] is not right"),
            )
        ),
        ((_double, [2.8]), "a list of two numbers"),
        ((_double, "2.8"), "a list of two numbers"),
        ((_unwritten, [2.8, -0.2]), "not written yet"),
        (_double, "Hand over both"),
    ],
    "soft_update_in_place": [
        (_rebinds, "only gives a new tensor the name"),
        (_matrices_only, "whatever its shape"),
        (_returns, "nothing reads what you return"),
        (_new_in_list, "in the list is none of the network"),
        (_swapped, "plus τ of the online weight"),
        (_shrinks_online, "online weights have changed"),
        (_adds, "1 − τ of itself"),
        (_copies, "only the share τ"),
        (_shares, "share their memory"),
        (_first_only, "All tensors of the lists"),
        (_unwritten, "not written yet"),
    ],
}
