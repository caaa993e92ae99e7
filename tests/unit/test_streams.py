"""No two uses share random numbers, whatever the seeds."""

from copy import deepcopy
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


def test_the_streams_stay_what_they_are():
    """Known numbers: if these change, so do all recorded results."""
    assert stream(Use.TEST, 0).integers(0, 1000, 4).tolist() == [656, 838, 462, 83]
    assert torch_seed(Use.WEIGHTS, 3) == 4300361653909824179


def test_portable_numbers_stay_what_they_are():
    """Known numbers: if these change, so do all missions that people have shared."""
    generator = Portable(Use.FADING, np.int64(3))
    assert generator.random(2).tolist() == [1431989686 / 2**32, 2601602745 / 2**32]
    generator = deepcopy(generator)
    assert generator.integers([0, 5], [10, 6]).tolist() == [4, 5]
    assert generator.uniform(2, 4) == 2 + 2 * 249554668 / 2**32
    drawn = Portable(Use.FADING, 3).standard_normal((1, 2), np.float32)
    assert drawn.dtype == np.float32
    np.testing.assert_allclose(drawn, [[-0.7091007, -0.0089062]], rtol=1e-4)


def test_portable_normal_numbers_are_normal_and_independent():
    """Slots and devices, next to each other or seeds apart; each bound is five standard errors."""
    seeds, count = (0, 1, 2, 2**32, 2**53 - 1), 10_000
    drawn = np.stack([Portable(Use.FADING, seed).standard_normal((count, 4, 5)) for seed in seeds])
    for level, quantile in ((0.001, -3.090232), (0.1, -1.281552), (0.5, 0.0), (0.975, 1.959964)):
        spread = np.sqrt(level * (1 - level) / drawn.size)
        assert abs((drawn < quantile).mean() - level) < 5 * spread
    rows = np.concatenate([each.reshape(count, 20).T for each in drawn])  # seed, slot and device
    correlation = np.corrcoef(rows) - np.eye(len(rows))
    assert abs(correlation).max() < 5.5 / np.sqrt(count)  # of 4950 pairs


@pytest.mark.parametrize("make", [stream, Portable, torch_seed])
@pytest.mark.parametrize("seed", [-1, 2**63, 0.0, "1"])
def test_an_impossible_seed_is_refused(make, seed):
    with pytest.raises(InputError, match="seed "):
        make(Use.FADING, seed)
    with pytest.raises(InputError, match=f"seed {2**53}"):
        Portable(Use.FADING, 2**53)
