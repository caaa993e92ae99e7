from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uavdh_lite.environment import State
from uavdh_lite.replay import Replay


def states(labels, landed=False):
    """States told apart in every field by a number below 400."""
    labels = np.array(labels, np.int16)
    data = np.stack([labels + 1, labels + 2], axis=1).astype(np.float32)
    cells = np.stack([399 - labels, labels], axis=1)
    landed = np.broadcast_to(landed, labels.shape)
    return State(labels, labels + 1, cells, data, data / 2, landed, labels % 7)


def filled(rewards, ended, capacity=100, return_steps=1):
    """A memory of these rewards and ends, (T, N); step t of environment e has label 100 e + t."""
    replay = Replay(capacity, rewards.shape[1], 2, 0.5, return_steps)
    for t in range(len(rewards)):
        labels = 100 * np.arange(rewards.shape[1]) + t
        after = states(labels + 1, ended[t])
        replay.add(states(labels), labels % 6, rewards[t].astype(np.float32), after)
    return replay


@settings(derandomize=True, deadline=None, max_examples=50)
@given(*(st.integers(1, most) for most in (40, 4, 60, 4, 2**32)))
def test_samples_are_those_of_a_slow_memory(steps, environments, capacity, n, seed):
    """The ring keeps the newest steps; sums go on over n steps or to the end of the episode.

    What is saved comes back.
    """
    generator = np.random.default_rng(seed)
    rewards = generator.integers(0, 9, (steps, environments))
    ended = generator.random((steps, environments)) < 0.2
    capacity = max(capacity, environments)
    replay = filled(rewards, ended, capacity, return_steps=n)
    newest = steps - n  # the last whose n steps are complete
    oldest = max(0, newest + 1 - -(-capacity // environments))
    assert len(replay) == max(newest + 1 - oldest, 0) * environments
    if not len(replay):
        return

    saved = {name: array.copy() for name, array in replay.state_dict().items()}
    replay = Replay(capacity, environments, 2, 0.5, return_steps=n)
    replay.load_state_dict(saved)
    size = int(generator.integers(environments, len(replay) + 1))
    batch = replay.sample(size, generator)
    found = batch.state.uav_cell.tolist()
    assert found[:environments] == [100 * e + newest for e in range(environments)]
    assert len(set(found)) == size  # no transition twice
    for row in range(size):
        e, t = divmod(found[row], 100)
        reward, discount, k = 0.0, 1.0, t
        assert oldest <= t <= newest
        while k < t + n and discount:
            reward += discount * rewards[k, e]
            discount *= 0 if ended[k, e] else 0.5
            k += 1
        assert (batch.reward[row], batch.discount[row]) == (reward, discount)
        assert batch.next_state.uav_cell[row] == 100 * e + k
    assert np.array_equal(batch.action, batch.state.uav_cell % 6)
    expected = states(batch.state.uav_cell)  # each field; and a new episode's first has not landed
    for field in fields(State):
        assert np.array_equal(getattr(batch.state, field.name), getattr(expected, field.name))


def test_a_transition_takes_little_memory():
    assert sum(a.nbytes for a in Replay(100_000, 16, 5, 0.95).state_dict().values()) / 100_000 < 65
