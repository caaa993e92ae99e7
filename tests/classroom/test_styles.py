"""Right answers pass, however they are written."""

import functools
import itertools
import math
from decimal import Decimal
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
    "fraction": lambda x: Fraction(float(x)),
    "decimal": lambda x: Decimal(float(x)),
    "tensor": lambda x: torch.tensor(float(x), dtype=torch.float64, requires_grad=True),
    "long double": np.longdouble,
}
SEVERAL = {
    "list": list,
    "tuple": tuple,
    "array": np.array,
    "tensor": lambda x: torch.tensor(np.array(x, float)),
}
NUMBERS = ("flight_score", "n_step_return", "network_weights", "clustered_half_width")
ROWS = ("tdma_slot", "wilson", "lead")


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
        checks.EXERCISES[name](WRITTEN[written](solved(name)))


@pytest.mark.parametrize("name", [*NUMBERS, *ROWS])
def test_numbers_of_any_type_pass(name):
    for form in (ONE_NUMBER if name in NUMBERS else SEVERAL).values():
        checks.EXERCISES[name](lambda *arguments, form=form: form(solved(name)(*arguments)))


def by_logarithms(q_values, temperature):
    return torch.exp(q_values / temperature - torch.logsumexp(q_values / temperature, 1, True))


def by_one_hot(reward, terminal, discount, online_next, target_next):
    chosen = torch.nn.functional.one_hot(online_next.argmax(1), 6).to(target_next)
    return torch.where(terminal, reward, reward + discount * (chosen * target_next).sum(1))


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
    return Fraction(sum(larger), len(larger))


def by_search(successes, trials):
    share, ends = successes / trials, []
    for far in (0.0, 1.0):
        near, away = share, far
        for _ in range(200):
            q = (near + away) / 2
            inside = abs(share - q) <= 1.96 * math.sqrt(q * (1 - q) / trials)
            near, away = (q, away) if inside else (near, q)
        ends.append(near)
    return ends


def blended(target, online, rate):
    for t, o in zip(target, online, strict=True):
        t[...] = torch.lerp(t, o, float(rate))


def by_padding_layers(layers, uav, size):
    around = size - 1
    wide = [np.pad(layer, around, constant_values=k == 1) for k, layer in enumerate(layers)]
    (r, c), side = uav, 2 * size - 1
    return np.stack(wide)[:, r : r + side, c : c + side].copy()


def by_transposing(q_of, layers):
    """All eight maps in one stack; the cells next to the middle say which move is which."""
    w = layers.shape[1]
    names, middle = np.arange(w * w).reshape(1, w, w), w // 2

    def eight(one):
        four = [one, one[:, ::-1], one[:, :, ::-1], one[:, ::-1, ::-1]]
        return np.stack([*four, *(np.swapaxes(x, 1, 2) for x in four)])

    def moves(one):
        return [one[0, middle + r, middle + c] for r, c in ((-1, 0), (0, 1), (1, 0), (0, -1))]

    wanted, rows = moves(names), []
    for named, q in zip(eight(names), q_of(eight(layers)), strict=True):
        found = moves(named)
        rows.append([*(q[found.index(name)] for name in wanted), *q[4:]])
    return np.mean(rows, axis=0)


def by_matrix(values, city):
    off = values - np.mean(values)
    count = len(set(city.tolist()))
    together = off @ (city[:, None] == city) @ off
    return 1.96 * math.sqrt(count / (count - 1) * max(together, 0)) / len(city)


OTHERS = {
    "small_city_map": by_padding_layers,
    "symmetric_q": by_transposing,
    "clustered_half_width": by_matrix,
    "stable_policy": lambda q, beta: by_logarithms(q.double(), beta).float(),
    "permutation_p": by_sets,
    "wilson": by_search,
    "soft_update_in_place": blended,
    "double_target": (by_one_hot, (2.8, Fraction(-1, 5))),
    "rate_from_snr": lambda snr_db: np.logaddexp2(0, np.asarray(snr_db) / 10 * np.log2(10)),
    "episodes_needed": lambda s, h: -int(-((1.96 * s / h) ** 2) // 1),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_way_to_solve_it_passes(name):
    checks.EXERCISES[name](OTHERS[name])
