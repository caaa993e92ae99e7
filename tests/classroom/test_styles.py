"""Right answers pass, however they are written."""

import bisect
import copy
import functools
import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from mutants import SCRIPTS, solutions

from uavdh_lite.course import checks
from uavdh_lite.evaluation import wilson_interval


class Callable:
    def __init__(self, function):
        self.function = function

    def __call__(self, *arguments):
        return self.function(*arguments)

    method = __call__


def star(function):
    def answer(*anything):
        return function(*anything)

    return answer


WRITTEN = {
    "as it is": lambda function: function,
    "lambda": lambda function: lambda *arguments: function(*arguments),
    "any arguments": star,
    "partial": functools.partial,
    "object": Callable,
    "method": lambda function: Callable(function).method,
    "wrapped": lambda function: functools.wraps(function)(star(function)),
}
ONE_NUMBER = {
    "float": float,
    "numpy": np.float64,
    "single element of an array": lambda x: np.array([x])[0],
    "array without axes": np.asarray,
    "tensor": lambda x: torch.tensor(float(x), dtype=torch.float64, requires_grad=True),
}
SEVERAL = {
    "list": list,
    "tuple": tuple,
    "array": np.array,
    "tensor": lambda x: torch.tensor(np.array(x, float)),
}
NUMBERS = ("flight_score", "same_path_loss", "n_step_return", "network_weights", "old_share")
NUMBERS += ("permutation_p", "clustered_half_width")
ROWS = ("tdma_slot", "lead")


@functools.cache
def solved(name):
    for script in sorted(SCRIPTS.glob("*.py")):
        around, functions, handed = solutions(script)
        if name in handed:
            space = {"__name__": "answers"}
            exec("\n".join([around, *functions.values()]), space)
            return eval(handed[name], space)
    raise KeyError(name)


@pytest.mark.parametrize("written", WRITTEN)
def test_a_function_of_any_kind_passes(written):
    for name in ("rate_from_snr", "tdma_slot"):
        assert not checks.EXERCISES[name].wrong_with(WRITTEN[written](solved(name)))


@pytest.mark.parametrize("name", [*NUMBERS, *ROWS])
def test_numbers_of_any_type_pass(name):
    for form in (ONE_NUMBER if name in NUMBERS else SEVERAL).values():
        checks.EXERCISES[name](lambda *arguments, form=form: form(solved(name)(*arguments)))


def by_sets(a, b):
    values = [Fraction(float(x)).limit_denominator(10**7) for x in (*a, *b)]
    total, places = sum(values), range(len(values))

    def difference(chosen):
        own = sum(values[k] for k in chosen)
        return abs(own / len(a) - (total - own) / len(b))

    seen = difference(range(len(a)))
    larger = [
        difference(c) >= seen - Fraction(1, 10**9) for c in itertools.combinations(places, len(a))
    ]
    return sum(larger) / len(larger)


def by_the_library(share, crashes):
    low = lambda n: wilson_interval(np.arange(n) >= crashes).low  # noqa: E731
    enough = next(2**k for k in itertools.count(6) if low(2**k) >= share)
    return bisect.bisect_left(range(crashes + 1, enough), share, key=low) + crashes + 1


def by_fractions(start, end, cell):
    """Cuts the segment at the four edges of the cell."""
    low, high = Fraction(0), Fraction(1)
    for a, b, c in zip(start, end, cell, strict=True):
        if a == b and a != c:
            return False
        if a != b:
            ends = sorted((Fraction(2 * (c - a) + s, 2 * (b - a))) for s in (-1, 1))
            low, high = max(low, ends[0]), min(high, ends[1])
    return low < high


def by_dictionary(step, start, flights, gamma, alpha, generator):
    q = {(row, col): [0.0] * 4 for row in range(4) for col in range(4)}
    for _ in range(flights):
        cell, ended = start, False
        while not ended:
            action = int(generator.random() * 4)
            after, reward, ended = step(cell, action)
            y = reward + gamma * max(q[after]) * (1 - ended)
            q[cell][action] = (1 - alpha) * q[cell][action] + alpha * y
            cell = after
    return np.array([[q[row, col] for col in range(4)] for row in range(4)])


class Cells(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.few, self.many = torch.nn.Linear(2, 4), torch.nn.Linear(2, 60)
        self.last = torch.nn.Linear(64, 4)

    def forward(self, cells):
        return self.last(torch.cat([self.few(cells), self.many(cells)], 1).relu())


def by_mask(memory, gamma, updates, tau=None):
    """All four differences, of which a mask keeps one; y is detached, the shapes are (B,)."""
    online, generator = Cells(), np.random.default_rng(0)
    target = copy.deepcopy(online) if tau is not None else online
    optimiser = torch.optim.Adam(online.parameters(), lr=0.01)
    for update in range(updates):
        rows = memory[generator.integers(len(memory), size=32)]
        mask = torch.nn.functional.one_hot(rows[:, 2].long(), 4)
        y = torch.where(
            rows[:, 6] == 1, rows[:, 3], rows[:, 3] + gamma * target(rows[:, 4:6]).amax(1)
        )
        if update < 50:
            with torch.no_grad():
                target(rows[:, 4:6]), online(rows[:, :2])  # looks at them
        error = mask * (online(rows[:, :2]) - y.detach()[:, None])
        (error**2).sum(1).mean().backward()
        optimiser.step()
        optimiser.zero_grad(set_to_none=False)
        if tau is not None:
            kept = target.state_dict()
            new = {
                name: (1 - tau) * kept[name] + tau * w for name, w in online.state_dict().items()
            }
            target.load_state_dict(new)
    return online.eval()


def by_mask_calmly(memory, gamma, tau, updates):
    return by_mask(memory, gamma, updates, tau)


def by_known_steps(memory, gamma, updates):
    """What the network should learn: a table of the steps, swept until nothing changes."""
    q = torch.zeros(4, 4, 4)
    for _ in range(60):
        for row, col, action, reward, *after, ended in {tuple(step) for step in memory.tolist()}:
            following = q[int(after[0]), int(after[1])].max()
            q[int(row), int(col), int(action)] = reward + gamma * (1 - ended) * following
    return lambda cells: q[cells[:, 0].long(), cells[:, 1].long()]


def by_whole_slots(rate, left):
    """Device by device, from the loudest on: each takes the slots that empty it."""
    layer = np.zeros(rate.shape[1:])
    for place in np.ndindex(layer.shape):
        slots = 4
        for own, data in sorted(zip(rate[(slice(None), *place)], left, strict=True), reverse=True):
            used = min(slots, math.ceil(data / own))
            layer[place] += min(used * own, data)
            slots -= used
    return layer


def by_logarithms(q_values, temperature):
    powers = q_values / temperature
    return (powers - powers.logsumexp(1, keepdim=True)).exp()


OUT, BACK = ["east"], ["north", "north", "west", "north", "land"]
HINTED = [  # by the second hint of 0.3
    [*OUT * out, *["hover"] * waits, *way, *["hover"] * (2 - waits) * (out < 7), *BACK]
    for out, several in ((6, (1, 2)), (7, (0,)))
    for waits in several
    for way in (
        ["west"] * (out - 2) + ["south"] * 4,
        ["west"] * (out - 3) + ["south"] * 4 + ["west"],
        ["south"] * 4 + ["west"] * (out - 2),
    )
]
OTHERS = [
    *(("flown_by_hand", flight) for flight in HINTED),
    ("learned_table", by_dictionary),
    ("learned_network", by_mask),
    ("learned_network", by_known_steps),
    ("learned_calmly", by_mask_calmly),
    ("permutation_p", by_sets),
    ("missions_needed", lambda *case: float(by_the_library(*case))),
    ("crosses", by_fractions),
    ("rate_from_snr", np.vectorize(lambda snr_db: math.log2(1 + 10 ** (snr_db / 10)))),
    ("data_of_a_step", by_whole_slots),
    ("stable_policy", by_logarithms),
]


@pytest.mark.parametrize("name, answer", OTHERS)
def test_another_way_to_solve_it_passes(name, answer):
    checks.EXERCISES[name](answer)
