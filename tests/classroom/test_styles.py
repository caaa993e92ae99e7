"""Right answers pass, however they are written."""

import functools
import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from mutants import SCRIPTS, solutions

from uavdh_lite.course import checks


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


def by_hand(online, target, optimiser, batch, gamma, tau):
    """A mask, a detached target, weights from a dictionary, slopes cleared at the end."""
    cell, action, reward, after, ended = batch
    y = torch.where(ended == 1, reward, reward + gamma * target(after).max(1, True).values)
    mask = torch.nn.functional.one_hot(action[:, 0], 4)
    optimiser.zero_grad(set_to_none=False)
    ((mask * (online(cell) - y.detach())) ** 2).sum(1).mean().backward()
    optimiser.step()
    kept, new = target.state_dict(), online.state_dict()
    target.load_state_dict({name: (1 - tau) * kept[name] + tau * new[name] for name in kept})


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
    ("crosses", by_fractions),
    ("rate_from_snr", np.vectorize(lambda snr_db: math.log2(1 + 10 ** (snr_db / 10)))),
    ("mended_update", by_hand),
    (
        "expected_target",
        lambda r, ended, g, q, beta: torch.where(
            ended, r, r + g * torch.einsum("ba,ba->b", (q / beta).log_softmax(1).exp(), q)
        ),
    ),
]


@pytest.mark.parametrize("name, answer", OTHERS)
def test_another_way_to_solve_it_passes(name, answer):
    checks.EXERCISES[name](answer)
