"""Every random generator of the package comes from here, made from a use and a seed.

The use is a spawn key of numpy's `SeedSequence`, so two uses never share a stream, whatever their
seeds. A generator made elsewhere, such as `numpy.random.default_rng(2)`, has no spawn key, so it
shares none of these streams, either.
"""

import math
from enum import IntEnum
from typing import Any

import numpy as np

from uavdh_lite.config import shown
from uavdh_lite.errors import InputError


class Use(IntEnum):
    """What random numbers are for. The numbers are part of the streams: never change one."""

    TRAINING = 0  # episodes, fading, exploration and minibatches of a training run
    VALIDATION = 1  # the missions that choose the best agent of a run
    TEST = 2  # the missions of an evaluation
    CHALLENGE = 3  # the missions of a challenge
    MISSION = 4  # a mission drawn at random
    FADING = 5  # the fading of a mission
    EXPLORATION = 6  # the actions of the random policy
    LAB = 7
    BOOTSTRAP = 8  # resampling for confidence intervals
    EXERCISE = 9  # the cases that check an answer
    GYMNASIUM = 10  # an environment's `reset(seed=...)`
    WEIGHTS = 11  # a network before training
    EXPORT = 12  # the states that compare an exported network with its agent
    BENCHMARK = 13
    CITY = 14  # cities drawn at random
    GREEDY_FLIGHTS = 15  # new missions that a run flies greedily as it learns


def stream(use: Use, seed: int = 0) -> np.random.Generator:
    """The generator for one use and seed.

    Raises `InputError` unless the seed is a whole number from 0 to 2**63 − 1.
    """
    return np.random.default_rng(_sequence(use, seed))


class Portable(np.random.Generator):
    """A generator of few methods whose numbers are the same in every language: for what people
    share, a mission and its fading.

    Its k-th number, from `drawn` on, is a hash of k, so it needs only arithmetic with whole numbers
    of 32 bits. `labs/world.js` has the same class. Other methods than those here are numpy's own.

    Raises `InputError` unless the seed is a whole number from 0 to 2**53 − 1, the largest that
    JavaScript counts exactly.
    """

    def __init__(self, use: Use, seed: int, drawn: int = 0):
        super().__init__(stream(use, seed).bit_generator)
        if seed >= 2**53:
            raise InputError(f"seed {seed!r}: must be a whole number from 0 to 2**53 - 1")
        seed = int(seed)  # one of numpy would overflow
        self._key = _hash(seed % 2**32 + _hash(seed // 2**32 + _hash(use)))
        self._made_of, self._drawn = (use, seed), drawn

    def __reduce__(self):  # numpy's makes a copy one of its own generators
        return Portable, (*self._made_of, self._drawn)

    def random(self, size: Any = None, dtype: Any = float, out: Any = None) -> Any:
        """Uniform over [0, 1), multiples of 2**−32; float64 whatever the `dtype`."""
        shape = () if size is None else size
        count = math.prod(np.atleast_1d(shape).tolist())
        numbers = np.arange(self._drawn, self._drawn + count, dtype=np.uint64)
        self._drawn += count
        return (_hash(numbers + self._key) / 2**32).reshape(shape)[()]

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        return low + (high - low) * self.random(size)

    def integers(
        self, low: Any, high: Any = None, size: Any = None, dtype: Any = int, endpoint: bool = False
    ) -> Any:
        low, high = np.broadcast_arrays(*((0, low) if high is None else (low, high)))
        share = self.random(low.shape if size is None else size)
        return (low + np.floor(share * (high - low + endpoint))).astype(dtype)

    def standard_normal(self, size: Any = None, dtype: Any = float, out: Any = None) -> Any:
        """By Box and Muller, two numbers for each."""
        shape = () if size is None else np.atleast_1d(size)
        first, second = np.moveaxis(self.random((*shape, 2)), -1, 0)
        radius = np.sqrt(-2 * np.log(1 - first))  # 1 − first is above 0
        return (radius * np.cos(2 * np.pi * second)).astype(dtype)


def _hash(number: Any) -> Any:
    """A hash of 32 bits, of a number or an array of uint64: Wellons' triple32."""
    for shift, factor in ((17, 0xED5AD4BB), (11, 0xAC4C1B51), (15, 0x31848BAB)):
        number = number & 0xFFFFFFFF
        number = (number ^ number >> shift) * factor
    number = number & 0xFFFFFFFF
    return number ^ number >> 14


def torch_seed(use: Use, seed: int) -> int:
    """A seed for `torch.manual_seed`, for one use and seed; raises as `stream` does."""
    return int(_sequence(use, seed).generate_state(1, np.uint64)[0])


def _sequence(use: Use, seed: int) -> np.random.SeedSequence:
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed {shown(seed)}: must be a whole number from 0 to 2**63 - 1")
    return np.random.SeedSequence(int(seed), spawn_key=(Use(use),))
