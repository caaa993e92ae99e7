"""No two uses share random numbers, whatever the seeds, and nobody makes generators elsewhere."""

import ast
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.missions import Mission
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream, torch_seed

ROOT = Path(__file__).parents[2]
SEEDS = [*range(64), 2**31, 2**32 - 1, 2**32, 2**32 + 1, 2**33, 2**62, 2**63 - 1]


def first(generator):
    return generator.integers(0, 2**63, 4).tobytes()


def test_no_two_uses_and_seeds_give_equal_numbers():
    drawn = [first(stream(use, seed)) for use, seed in product(Use, SEEDS)]
    assert len(set(drawn)) == len(Use) * len(SEEDS)
    seeds = [torch_seed(use, seed) for use, seed in product(Use, SEEDS)]
    assert len(set(seeds)) == len(seeds)


def test_none_is_what_a_caller_seeds_with_whole_numbers():
    """`default_rng([2, 0])` is `default_rng(2)`: a list of numbers keeps nobody out."""
    streams = {first(stream(use, seed)) for use, seed in product(Use, SEEDS)}
    plain = [first(np.random.default_rng(seed)) for seed in SEEDS]
    pairs = [first(np.random.default_rng(pair)) for pair in product(range(len(Use)), SEEDS)]
    assert streams.isdisjoint(plain + pairs)


@given(use=st.sampled_from(list(Use)), seed=st.integers(0, 2**63 - 1))
def test_a_use_and_seed_give_the_same_numbers_again(use, seed):
    assert first(stream(use, seed)) == first(stream(use, seed))


def test_the_streams_are_those_of_their_version():
    """Known numbers: if these change, so must `streams.VERSION`, and recorded results with it."""
    assert stream(Use.TEST, 0).integers(0, 1000, 4).tolist() == TEST_0
    assert torch_seed(Use.WEIGHTS, 3) == WEIGHTS_3


TEST_0 = [656, 838, 462, 83]
WEIGHTS_3 = 4300361653909824179


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_an_impossible_seed_is_refused(seed):
    with pytest.raises(InputError, match=f"seed {seed}: must be a whole number from 0"):
        stream(Use.TEST, seed)


def test_a_mission_is_none_of_the_other_uses():
    """Mission 2 once had the devices of test scenario 0, and mission 0 those of a training."""
    scenario, city = SCENARIOS["manhattan"], City.load("manhattan")
    others = {
        scenario.sample(city, 1, stream(use, seed)).device_cells.tobytes()
        for use in set(Use) - {Use.MISSION}
        for seed in range(20)
    }
    others |= {
        scenario.sample(city, 1, np.random.default_rng(seed)).device_cells.tobytes()
        for seed in range(20)
    }
    for seed in range(20):
        drawn = scenario.sample(city, 1, stream(Use.MISSION, seed))
        assert drawn.device_cells.tobytes() not in others
        mission = Mission.draw(scenario, city, seed)
        assert mission.flying_time == drawn.time_left[0]
        assert first(mission.fading) != first(stream(Use.MISSION, seed))


def calls(path):
    """The names of all functions that a file calls."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            function = node.func
            yield (
                function.attr
                if isinstance(function, ast.Attribute)
                else getattr(function, "id", "")
            )


MAKERS = {"default_rng", "SeedSequence", "RandomState", "PCG64", "Philox", "manual_seed", "Random"}


@pytest.mark.parametrize("folder", ["uavdh_lite", "benchmarks"])
def test_nobody_else_makes_a_generator(folder):
    for path in (ROOT / folder).rglob("*.py"):
        made = MAKERS & set(calls(path))
        text = path.read_text(encoding="utf-8")
        if path.name == "streams.py":
            made -= {"default_rng", "SeedSequence"}
        if path.name == "training.py":  # the weights, from `torch_seed`
            made -= {"manual_seed"}
        if "planners import" in text or path.name == "planners.py":
            made -= {"Random"}  # the policy
        assert not made, f"{path}: makes a random generator: use streams.stream"
        assert "import random" not in text.splitlines(), path
