"""Exercises of notebook 5, from Q-learning to DDQN."""

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


def experience(states, actions, terminal, rate, discount):
    """A table, one step in it, and the constants."""
    generator = stream(Use.EXERCISE, 10 * states + actions)
    state, action, following = (int(generator.integers(n)) for n in (states, actions, states))
    q = generator.normal(0, 3, (states, actions)).round(1)
    return q, state, action, round(q[0, 0] - 0.5, 1), following, terminal, rate, discount


@exercise(
    "5.1 · One step of Q-learning (2 points, 10 minutes)",
    rules={
        "In a copy of the table, only q[state, action] changes. With alpha = 1 it becomes y, which "
        "after the end of an episode is the reward alone: nothing follows.": [
            (2, 2, True, 1.0, 0.9), (3, 2, True, 1.0, 0.5),
        ],
        "Otherwise y is the reward plus discount times the largest Q-value of the next state.": [
            (2, 3, False, 1.0, 0.5), (4, 2, False, 1.0, 0.9), (5, 4, False, 1.0, 1.0),
            (3, 3, False, 1.0, 0.0), (6, 4, False, 1.0, 0.95),
        ],
        "The entry goes the share alpha of the way from its old value to y; all others stay.": [
            (4, 2, False, 0.1, 0.9), (5, 4, False, 0.5, 0.9), (6, 6, False, 0.25, 0.99),
            (3, 2, False, 0.0, 0.9), (7, 3, True, 0.3, 0.8), (4, 3, True, 0.5, 0.9),
        ],
    },
    mistakes={
        "y holds the value of the next state only where the step is not terminal.": (
            lambda q, s, a, r, after, terminal, *rates: q_update.solution(
                q, s, a, r, after, 0, *rates
            )
        ),
        "The table is as it was: change q[state, action] in the copy, and return the copy.": (
            lambda q, *rest: q
        ),
    },
    case=experience,
)
def q_update(q, state, action, reward, next_state, terminal, alpha, discount):
    """`update(q, state, action, reward, next_state, terminal, alpha, discount)`: a new table."""
    target, new = reward if terminal else reward + discount * q[next_state].max(), q.copy()
    new[state, action] += alpha * (target - q[state, action])
    return new


def draw_policy(ax, policy):
    q_values = torch.tensor([[1000, 999.75, 999.5, 999, 998, 997]])
    for k, temperature in enumerate((0.1, 0.5, 2.0)):
        shares = policy(q_values, temperature)[0].numpy()
        ax.bar(np.arange(6) + 0.27 * (k - 1), shares, 0.27, label=f"β = {temperature}")
    ax.set_xticks(range(6), q_values[0].tolist())
    ax.set(xlabel="Q-value of an action", ylabel="probability")


def few(count, temperature, kind=torch.float32):
    """Q-values of so many states, and a temperature."""
    rows = stream(Use.EXERCISE, count).integers(-8, 9, (count, 6)) / 4
    return torch.tensor(rows, dtype=kind), temperature


def rows(temperature, *several):
    return torch.tensor(np.array(several, np.float32)), temperature


NEAR = np.array([1000, 999.875, 999.75, 999.5, 999, 998], np.float32)


@exercise(
    "5.2 · A softmax that does not overflow (2 points, 10 minutes)",
    figure=draw_policy,
    rules={
        "Each row is exp(Q/β), divided by the sum of its own row (dim=1), so that it sums to 1; "
        "keepdim=True makes a column of the sums.": [
            few(1, 1.0), few(2, 1.0), few(5, 1, torch.float64), few(6, 1),
        ],
        "Divide Q by β inside of exp: a small β makes the best action likelier, a large one all "
        "alike.": [few(1, 0.25), few(2, 2.0), few(6, 0.7), few(3, 40.0)],
        "No exponent may be above 0, since exp(1000 / 0.1) is infinite: it overflows, and infinity "
        "over infinity is nan. Subtract the state's largest Q-value first; that changes no "
        "probability.": [rows(0.125, NEAR), rows(0.125, NEAR[::-1])],
        "All Q-values of a state may be far below 0. Then every exp(Q/β) is 0, and 0/0 is nan. "
        "Subtract the maximum first.": [rows(0.125, -NEAR), rows(0.1, [-1000.0] * 6)],
        "Within a row the best action may be far above the others, whichever it is: subtract the "
        "maximum of the row, nothing smaller than the maximum.": [
            rows(0.1, [0.0, 0, 0, 1000, 0, 0]), rows(0.1, [1000.0, 0, 0, 0, 0, 0]),
            rows(0.5, [0.0, -1000, 1000, 0, 1000, 0]),
        ],
        "Rows of a batch may be far apart: subtract from each row its own maximum.": [
            rows(0.125, NEAR, NEAR - 1000), rows(0.125, NEAR - 1500, NEAR, 0 * NEAR),
        ],
    },
    mistakes={
        "These are the probabilities' logarithms.": lambda q, beta: torch.log_softmax(q / beta, 1),
    },
    tolerance=1e-4,
    smallest=1e-7,
)
def stable_policy(q_values, temperature):
    """`policy(q_values, temperature)`: the softmax policy (eq. 12), (B, 6), for any Q-values."""
    return torch.softmax(q_values / temperature, 1)


def value(chooser, judge):
    return judge.gather(1, chooser.argmax(1, True)).squeeze(1)


def transitions(size, discount, ends=0.4, at=5.0, kind=np.float32, apart=2.0):
    """Arguments of `target` for so many transitions, with Q-values near `at`."""
    generator = stream(Use.EXERCISE, 10 * size + int(10 * discount))
    online = generator.normal(at, apart, (size, 6)).round(2 if apart > 1 else 6)
    target = generator.normal(at, 3, (size, 6)).round(2)
    reward, terminal = generator.normal(1, 2, size).round(2), generator.random(size) < ends
    reward, online, target = (torch.tensor(a.astype(kind)) for a in (reward, online, target))
    return reward, torch.tensor(terminal), discount, online, target


@exercise(
    "5.3 · The double-DQN target (2 points, 10 minutes)",
    rules={
        "There is one target for each transition, (B,): the reward, plus γ times the entry of "
        "target_next, in the same row, for the action that online_next rates highest.": [
            (1, 1.0, 0), (2, 1.0, 0), (8, 1.0, 0), (3, 1, 0, 5.0, np.float64),
            (4, 1.0, 0, -50.0), (2, 1.0, 0, 1.0, np.float32, 1e-4),
        ],
        "The value of the next state is multiplied by γ, the one that is handed in; the reward "
        "counts in full.": [(2, 0.5, 0), (2, 0.99, 0), (2, 0.0, 0), (2, 1, 0)],
        "At a terminal transition the target is the reward alone. Elsewhere the next state "
        "counts.": [
            (1, 0.9, 2), (1, 1.0, 2), (2, 0.8), (6, 0.8), (32, 0.8), (7, 0.8),
        ],
    },
    mistakes={
        "That is the wrong function: one network both chooses and judges, and a value is added "
        "after the end of an episode.": lambda r, t, d, online, target: r + d * target.amax(1),
        "You take the largest Q-value of the target network: that is the target of plain DQN, "
        "with its bias. The online network must choose the action.": (
            lambda r, t, d, online, target: r + d * target.amax(1) * ~t
        ),
        "The networks are swapped: the online network chooses the action (argmax), the target "
        "network says what it is worth.": (
            lambda r, t, d, online, target: r + d * value(target, online) * ~t
        ),
    },
    tolerance=1e-5,
    smallest=1e-5,
    case=transitions,
)
def double_target(reward, terminal, discount, online_next, target_next):
    """`target(reward, terminal, discount, online_next, target_next)`: y, (B,) (eq. 10)."""
    return reward + discount * value(online_next, target_next) * ~terminal
