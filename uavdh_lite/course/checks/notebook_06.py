"""Exercises of notebook 6: another target, another exploration, another memory, bugs to find."""

import numpy as np
import torch
from torch import nn

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.given import after_updates
from uavdh_lite.streams import Use, stream


def transitions(size, gamma, beta, ends=0.4, at=5.0):
    """Arguments of `expected_target` for so many transitions, with Q-values near `at`."""
    generator = stream(Use.EXERCISE, 10 * size + int(10 * gamma))
    reward, q = generator.normal(1, 2, size).round(2), generator.normal(at, 2, (size, 6)).round(2)
    reward, q = (torch.tensor(array.astype(np.float32)) for array in (reward, q))
    return reward, torch.tensor(generator.random(size) < ends), gamma, q, beta


def expected(q, beta):
    return (torch.softmax(q / beta, 1) * q).sum(1)


@exercise(
    "6.1 · A target that explores, too (2 points, 10 minutes)",
    rules={
        "There is one target for each transition, (B,): the reward plus γ times the mean of the "
        "next Q-values, each weighted by the probability with which the softmax policy draws its "
        "action.": [(1, 1.0, 1.0, 0), (2, 1.0, 1.0, 0), (8, 1.0, 1.0, 0)],
        "The value of the next state is multiplied by γ; the reward counts in full.": [
            (2, 0.5, 1.0, 0),
            (3, 0.0, 1.0, 0),
        ],
        "The policy has the temperature that is handed in: the lower it is, the more the best "
        "action counts.": [(2, 0.9, 0.1, 0), (4, 0.9, 10.0, 0)],
        "At the end of an episode the target is the reward alone.": [
            (1, 0.9, 1.0, 2),
            (6, 0.8, 1.0),
            (32, 0.8, 0.5),
        ],
        "Q-values may be near 1000: `torch.softmax` does not overflow.": [(3, 0.9, 0.1, 0, 1000.0)],
    },
    mistakes={
        "That is the largest Q-value, the target of Q-learning. Here the mean counts, weighted by "
        "the policy.": lambda r, ended, gamma, q, beta: r + gamma * ~ended * q.amax(1),
        "That is the plain mean of all actions, as if all were drawn equally often.": (
            lambda r, ended, gamma, q, beta: r + gamma * ~ended * q.mean(1)
        ),
        "Something is added after the end of an episode.": (
            lambda r, ended, gamma, q, beta: r + gamma * expected(q, beta)
        ),
    },
    case=transitions,
)
def expected_target(reward, ended, gamma, q_next, beta):
    """`expected_target(reward, ended, gamma, q_next, beta)`: y of expected SARSA, (B,)."""
    return reward + gamma * ~ended * expected(q_next, beta)


def estimates(size, actions, epsilon):
    rows = stream(Use.EXERCISE, size + actions).permuted(
        np.tile(np.arange(actions) - 2.5, (size, 1)), axis=1
    )
    return torch.tensor(rows, dtype=torch.float32), epsilon


@exercise(
    "6.2 · ε-greedy (2 points, 10 minutes)",
    rules={
        "Without exploration, ε = 0, the best action of each row has probability 1.": [
            (1, 6, 0.0),
            (3, 6, 0.0),
        ],
        "With ε = 1 all actions are equally likely.": [(1, 6, 1.0), (2, 4, 1.0)],
        "With probability ε the action is drawn from *all* actions, the best one included. So each "
        "has ε divided by their number, and the best has 1 − ε more.": [
            (5, 6, 0.1),
            (2, 4, 0.5),
            (2, 3, 0.25),
        ],
    },
    mistakes={
        "The random action may also be the best one: it has more than 1 − ε.": (
            lambda q, epsilon: torch.where(
                q == q.amax(1, True), 1 - epsilon, epsilon / (q.shape[1] - 1)
            )
        ),
        "ε and 1 − ε are swapped.": lambda q, epsilon: epsilon_greedy.solution(q, 1 - epsilon),
    },
    case=estimates,
)
def epsilon_greedy(q, epsilon):
    """`epsilon_greedy(q, epsilon)`: the probabilities of all actions, (B, A)."""
    best = nn.functional.one_hot(q.argmax(1), q.shape[1])
    return epsilon / q.shape[1] + (1 - epsilon) * best


def errors(count, spread=1.0):
    generator = stream(Use.EXERCISE, count)
    signs = generator.choice([-1.0, 1.0], count)
    return (spread * signs * generator.permutation(np.arange(1, count + 1) ** 2)).round(3)


@exercise(
    "6.3 · A memory that prefers surprises (2 points, 15 minutes)",
    rules={
        "The step with the largest error has rank 1 and the weight 1; the next has rank 2 and the "
        "weight 1/2, and so on. Divide by the sum, so that the probabilities add up to 1.": [
            (1,),
            (3,),
            (5,),
            (40,),
        ],
        "Only the order counts: how large the errors are makes no difference.": [
            (4, 0.01),
            (4, 100.0),
        ],
    },
    mistakes={
        "An error below 0 is as much of a surprise as one above: rank by the absolute value.": (
            lambda errors: ranked(-errors)
        ),
        "The smallest error has rank 1: it must be the largest.": (
            lambda errors: ranked(np.abs(errors))
        ),
        "`argsort` says which step comes k-th. Needed is the place of each step in that order: "
        "write the weights to those places.": (
            lambda errors: _share(1 / (1 + np.argsort(-np.abs(errors))))
        ),
    },
    case=lambda *row: (errors(*row),),
)
def by_surprise(errors):
    """`by_surprise(errors)`: the probability of each step, (N,), by the rank of its TD error."""
    return ranked(-np.abs(errors))


def ranked(key):
    weights = np.empty(len(key))
    weights[np.argsort(key)] = 1 / np.arange(1, len(key) + 1)
    return _share(weights)


def _share(weights):
    return weights / weights.sum()


def made(fault=""):
    """An update of notebook 6, with a fault."""

    def update(online, target, optimiser, batch, gamma, tau):
        cell, action, reward, after, ended = batch
        with torch.no_grad():
            judge = online if fault == "own judge" else target
            goes_on = 1 if fault == "end" else ended if fault == "inverted" else 1 - ended
            y = reward + gamma * goes_on * judge(after).amax(1, keepdim=True)
        q = online(cell)
        q = q.amax(1, keepdim=True) if fault == "largest" else q.gather(1, action)
        loss = ((y - q) ** 2).mean()
        if fault != "slopes":
            optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        with torch.no_grad():
            for old, new in zip(target.parameters(), online.parameters(), strict=True):
                if fault != "never":
                    old.lerp_(new, 1 - tau if fault == "swapped" else tau)

    return update


@exercise(
    "6.4 · Four bugs in an update (3 points, 25 minutes)",
    rules={
        "With γ = 0 the target y is the reward alone, and only the Q-value of the action that was "
        "taken moves towards it: `gather` picks it, and the loss is the mean of (y − q)². With "
        "τ = 0 the target network stays as it is.": [(0, 0.0, 0.0, 1, 0.0)],
        "y is the reward plus γ times the target network's largest Q-value of the next cell, and a "
        "number: computed inside `torch.no_grad()`.": [(1, 0.9, 0.0, 1, 0.0)],
        "Where the episode ended, y is the reward alone: the second part times (1 − ended).": [
            (2, 0.9, 0.0, 1, 1.0),
            (3, 0.9, 0.0, 1, 0.5),
        ],
        "After every update each weight of the target network moves the share τ of the way to the "
        "online one, in place, as `old.lerp_(new, tau)` does. `old = …` only gives the name to "
        "another tensor.": [(4, 0.9, 0.25, 1, 0.2)],
        "The slopes of an update must be forgotten before the next: `optimiser.zero_grad()` before "
        "`loss.backward()`.": [(5, 0.9, 0.25, 3, 0.2)],
    },
    mistakes={
        "The online network makes its own targets; the target network must judge.": (
            made("own judge")
        ),
        "The mask is the wrong way round: `ended` is 1 where nothing follows.": made("inverted"),
        "τ and 1 − τ are swapped: the target network keeps the share 1 − τ of its weights.": (
            made("swapped")
        ),
    },
    ask=after_updates,
    call=lambda seed, gamma, tau, updates, ends: (
        f"With γ = {gamma}, τ = {tau}, {updates} update{'s' * (updates > 1)} and {ends:.0%} of the "
        "steps at an end, Q-values [online or target, cell, action]"
    ),
)
def mended_update(online, target, optimiser, batch, gamma, tau):
    """`update(online, target, optimiser, batch, gamma, tau)` of notebook 6, without the bugs."""
    made()(online, target, optimiser, batch, gamma, tau)
