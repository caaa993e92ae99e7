"""Every random generator of the package comes from here, made from a use and a seed.

The use is a spawn key of numpy's `SeedSequence`, so two uses never share a stream, whatever their
seeds. A generator made elsewhere, such as `numpy.random.default_rng(2)`, has no spawn key, so it
shares none of these streams, either.
"""

from enum import IntEnum

import numpy as np

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


def torch_seed(use: Use, seed: int) -> int:
    """A seed for `torch.manual_seed`, for one use and seed; raises as `stream` does."""
    return int(_sequence(use, seed).generate_state(1, np.uint64)[0])


def _sequence(use: Use, seed: int) -> np.random.SeedSequence:
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed {seed}: must be a whole number from 0 to 2**63 - 1")
    return np.random.SeedSequence(int(seed), spawn_key=(Use(use),))
