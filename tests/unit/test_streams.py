"""No two uses share random numbers, whatever the seeds."""

from itertools import product

import numpy as np
import pytest

from uavdh_lite.errors import InputError
from uavdh_lite.streams import Portable, Use, stream, torch_seed

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


def test_portable_numbers_stay_what_they_are():
    """Known numbers: if these change, so do all missions that people have shared."""
    generator = Portable(Use.FADING, np.int64(3))
    assert generator.random(2).tolist() == [1431989686 / 2**32, 2601602745 / 2**32]
    assert generator.integers([0, 5], [10, 6]).tolist() == [4, 5]
    assert generator.uniform(2, 4) == 2 + 2 * 249554668 / 2**32
    drawn = generator.standard_normal((1, 2), np.float32)
    assert drawn.dtype == np.float32 and drawn.shape == (1, 2)


def test_portable_normal_numbers_are_normal_and_independent():
    """Slots and devices, next to each other or seeds apart; each bound is five standard errors."""
    seeds, count = (0, 1, 2, 2**32, 2**53 - 1), 10_000
    drawn = np.stack([Portable(Use.FADING, seed).standard_normal((count, 4, 5)) for seed in seeds])
    total, bound = drawn.size, 5 / np.sqrt(drawn.size)
    assert abs(drawn.mean()) < bound and abs(drawn.var() - 1) < np.sqrt(2) * bound
    for level, quantile in ((0.001, -3.090232), (0.1, -1.281552), (0.5, 0.0), (0.975, 1.959964)):
        spread = np.sqrt(level * (1 - level) / total)
        assert abs((drawn < quantile).mean() - level) < 5 * spread
    rows = np.concatenate([each.reshape(count, 20).T for each in drawn])  # seed, slot and device
    correlation = np.corrcoef(rows) - np.eye(len(rows))
    assert abs(correlation).max() < 5.5 / np.sqrt(count)  # of 4950 pairs
    for lag in (1, 5, 20):
        both = drawn.reshape(len(seeds), -1)[:, :-lag], drawn.reshape(len(seeds), -1)[:, lag:]
        for values in (both, [each**2 for each in both]):
            assert abs(np.corrcoef(values[0].ravel(), values[1].ravel())[0, 1]) < bound


@pytest.mark.parametrize("make", [stream, Portable, torch_seed])
@pytest.mark.parametrize("seed", [-1, 2**63, 0.0, "1"])
def test_an_impossible_seed_is_refused(make, seed):
    with pytest.raises(InputError, match="seed "):
        make(Use.FADING, seed)
    with pytest.raises(InputError, match=f"seed {2**53}"):
        Portable(Use.FADING, 2**53)
