"""No two uses share random numbers, whatever the seeds, and nobody makes generators elsewhere."""

import ast
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.errors import InputError
from uavdh_lite.streams import Use, stream, torch_seed

ROOT = Path(__file__).parents[2]
SEEDS = [*range(64), 2**31, 2**32 - 1, 2**32, 2**32 + 1, 2**33, 2**62, 2**63 - 1]


def first(generator):
    return generator.integers(0, 2**63, 4).tobytes()


def test_no_two_uses_and_seeds_give_equal_numbers():
    drawn = [first(stream(use, seed)) for use, seed in product(Use, SEEDS)]
    assert len(set(drawn)) == len(Use) * len(SEEDS)
    assert drawn == [first(stream(use, np.int64(seed))) for use, seed in product(Use, SEEDS)]
    seeds = [torch_seed(use, seed) for use, seed in product(Use, SEEDS)]
    assert len(set(seeds)) == len(seeds)


def test_no_stream_is_that_of_a_plain_generator():
    """`default_rng([2, 0])` is `default_rng(2)`: a list of numbers keeps nobody out."""
    streams = {first(stream(use, seed)) for use, seed in product(Use, SEEDS)}
    plain = [first(np.random.default_rng(seed)) for seed in SEEDS]
    pairs = [first(np.random.default_rng(pair)) for pair in product(range(len(Use)), SEEDS)]
    assert streams.isdisjoint(plain + pairs)


def test_the_streams_stay_what_they_are():
    """Known numbers: if these change, so do all recorded results."""
    assert stream(Use.TEST, 0).integers(0, 1000, 4).tolist() == [656, 838, 462, 83]
    assert torch_seed(Use.WEIGHTS, 3) == 4300361653909824179


@pytest.mark.parametrize("seed", [-1, 2**63, 0.0, 0.5, "1"])
def test_an_impossible_seed_is_refused(seed):
    with pytest.raises(InputError, match=f"seed {seed}"):
        stream(Use.TEST, seed)


MAKERS = {"default_rng", "SeedSequence", "RandomState", "PCG64", "Philox", "manual_seed"}
ALLOWED = {"streams.py": {"default_rng", "SeedSequence"}, "training.py": {"manual_seed"}}


@pytest.mark.parametrize("folder", ["uavdh_lite", "benchmarks"])
def test_nobody_else_makes_a_generator(folder):
    for path in (ROOT / folder).rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        called = {node.func for node in nodes if isinstance(node, ast.Call)}
        names = {getattr(one, "attr", getattr(one, "id", "")) for one in called}
        assert names & MAKERS <= ALLOWED.get(path.name, set()), f"{path}: use streams.stream"
        imported = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
        assert "random" not in imported, path
