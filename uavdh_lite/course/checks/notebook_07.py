"""Exercises of notebook 7: another network, other targets, a diagnosis, bugs to find."""

import itertools

import numpy as np
import torch

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.course.given import RUNS, dueling_values, round_of
from uavdh_lite.environment import Rewards
from uavdh_lite.streams import Use, stream


def dueling(join):
    """A head whose Q-values are `join(value, advantage)`."""

    class Head(torch.nn.Module):
        def __init__(self, inputs):
            super().__init__()
            self.value = torch.nn.Linear(inputs, 1)
            self.advantage = torch.nn.Linear(inputs, 6)

        def forward(self, features):
            return join(self.value(features), self.advantage(features))

    return Head


Head = dueling(lambda v, a: v + a - a.mean(1, keepdim=True))


@exercise(
    "7.1 · A dueling head (3 points, 20 minutes)",
    rules={
        "For each row Q is the value plus the advantages, less their mean over the six actions.": [
            (3, 1),
            (8, 1),
        ],
        "Each row has its own value and its own mean: `mean(1, keepdim=True)`.": [(3, 2), (8, 5)],
    },
    mistakes={
        "The mean of the advantages is not taken away. Then value and advantage are not apart: "
        "what is added to one may be taken from the other.": dueling(lambda v, a: v + a),
        "That takes away the largest advantage; asked is the mean.": (
            dueling(lambda v, a: v + a - a.amax(1, keepdim=True))
        ),
        "The mean runs over the batch: it must run over the actions, dim=1.": (
            dueling(lambda v, a: v + a - a.mean(0, keepdim=True))
        ),
    },
    takes=type,
    ask=dueling_values,
    call=lambda inputs, count: f"Head({inputs}), asked about {count} rows,",
)
class dueling_head(Head):
    """The class `Head(inputs)`: Q-values, (B, 6), from features, (B, inputs)."""


# The recorded runs, and all that is at a limit, a little off it, or far from it
NEAR = [(0, 0.5, 0.89, limit - 1e-6, limit, limit + 1e-6, 1.0, 1) for limit in (0.9, 0.8, 0.25)]
AGENTS = [*RUNS.values(), *itertools.product(*NEAR)]
SENTENCES = {
    "wanders": "It uses at least 25 % of its time, and at least 90 % of its missions land, so it "
    "is neither lazy nor crashing: if it collects less than 80 %, 0.8, it wanders.",
    "good": "It uses at least 25 % of its time, and at least 90 % of its missions land: if it "
    "collects at least 80 %, it is good.",
    "crashes": "It uses at least 25 % of its time, so it is not lazy: if fewer than 90 % of its "
    "missions land, it crashes, whatever it collects.",
    "lazy": "If it uses less than 25 % of the flying time, it is lazy, whatever else it does.",
}


def judged(landed, collected, used):
    if used < 0.25:
        return "lazy"
    return "crashes" if landed < 0.9 else "good" if collected >= 0.8 else "wanders"


@exercise(
    "7.2 · What is wrong with this agent? (1 point, 5 minutes)",
    rules={
        sentence: [one for one in AGENTS if judged(*one) == name]
        for name, sentence in SENTENCES.items()
    },
)
def diagnosis(landed, collected, time_used):
    """`diagnose(landed, collected, time_used)`: one of `SENTENCES`."""
    return judged(landed, collected, time_used)


def stored(length, ends, n, discount):
    """Rewards, terminals and values of a stored sequence, and the other two arguments."""
    generator = stream(Use.EXERCISE, 10 * length + len(ends))
    rewards, values = generator.normal(1, 1, length), generator.normal(8, 3, length + 1)
    kind, digits = (int, 0) if length == 3 else (float, 2)
    rewards, values = (array.round(digits).astype(kind) for array in (rewards, values))
    return rewards, np.isin(np.arange(length), ends), values, n, discount


@exercise(
    "7.3 · The n-step return (2 points, 15 minutes)",
    rules={
        "With n = 1 the target is rewards[0] plus γ times values[1], the value of the next "
        "state.": [(3, (), 1, 0.5), (2, (), 1, 0.9), (2, (), 1, 1.0), (2, (), 1, 0.0)],
        "Reward k is multiplied by γ^k. After m rewards comes γ^m values[m], with the value of "
        "state m.": [(3, (), 2, 0.5), (6, (), 5, 0.3), (40, (), 30, 0.95)],
        "A terminal step among the first m ends the sum with its own reward, and no value is "
        "added.": [
            (6, (2, 4), 3, 0.8),
            (6, (2, 4), 4, 0.95),
            (5, (0,), 3, 0.95),
            (4, (0, 1, 2, 3), 2, 0.6),
        ],
        "A terminal step after the first m belongs to the future: the value of state m counts.": [
            (6, (2, 4), 1, 0.8),
            (6, (2, 4), 2, 0.8),
        ],
        "Where fewer than n steps are stored, m = T: sum their rewards, then add γ^T values[T].": [
            (6, (), 7, 0.9),
            (1, (), 3, 0.4),
            (3, (), 1000, 0.5),
        ],
        "Where fewer than n steps are stored, a terminal step still ends the sum.": [
            (6, (2, 4), 9, 0.8),
            (4, (3,), 5, 0.9),
            (1, (0,), 2, 0.9),
        ],
    },
    case=stored,
)
def n_step_return(rewards, terminals, values, n, discount):
    """`n_step(rewards, terminals, values, n, discount)`: the target of the first state."""
    m, total = min(n, len(rewards)), 0.0
    for k in range(m):
        total += float(discount**k * rewards[k])
        if terminals[k]:
            return total
    return total + float(discount**m * values[m])


def rounds(ended="both", early=False, stays=False):
    """A round of the loop, with a fault."""

    def one_round(environment, state, action, memory, begin, generator):
        after, outcome = environment.step(state, action, generator)
        over = {"both": after.ended, "landed": after.landed, "crashed": after.time_left <= 0}[ended]
        over = np.flatnonzero(over)
        following = after.with_rows(over, begin(len(over)))
        stored = following if early else after
        memory.append((state, action, Rewards(crash=-20.0)(outcome), stored))
        return state if stays else following

    return one_round


@exercise(
    "7.4 · The loop that never lands (3 points, 20 minutes)",
    rules={
        "The memory gets the state after the step, and the round returns the state from which the "
        "next one goes on: the same, if no flight has ended.": [("fly", 0), ("fly", 1)],
        "Where a flight has ended, the memory must hold the state as `step` gave it, and what is "
        "returned a new mission in its place.": [("land", 2)],
        "A flight ends by landing *or* when the time is up; `after.ended` says both. In either "
        "case a new mission begins.": [("crash", 3), ("mixed", 4), ("mixed", 5)],
    },
    mistakes={
        "The new missions are put in before the step is stored: then no stored step ever ends, and "
        "y is never the reward alone.": rounds(early=True),
        "Only UAVs that landed begin anew. A crashed one stays where it is for ever.": (
            rounds("landed")
        ),
        "The round returns the state before the step, so every round flies the same step.": (
            rounds(stays=True)
        ),
    },
    ask=round_of,
    call=lambda kind, seed: (
        f"Where the UAVs {kind if kind != 'mixed' else 'land, crash and fly on'}: time left and "
        "end in the stored s', the same in what goes on, and the reward [row, UAV]"
    ),
)
def mended_round(environment, state, action, memory, begin, generator):
    """`one_round(environment, state, action, memory, begin, generator)`: the next state."""
    return rounds()(environment, state, action, memory, begin, generator)
