from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavdh_lite.environment import State
from uavdh_lite.errors import InputError
from uavdh_lite.replay import Replay

DISCOUNT = 0.5


def states(values):
    """States told apart by their flying time."""
    values = np.array(values, np.int16)
    cells, data = np.zeros((len(values), 2), np.int16), np.ones((len(values), 2), np.float32)
    return State(np.zeros_like(values), values, cells, data, data, np.zeros(len(values), bool))


def filled(steps, environments=2, capacity=20, ends=()):
    """Step t of environment e: state 100 e + t, reward t + 1; `ends` lists terminal (t, e)."""
    replay = Replay(capacity, environments, 2)
    for t in range(steps):
        now, after = ([100 * e + t + k for e in range(environments)] for k in (0, 1))
        terminal = [(t, e) in ends for e in range(environments)]
        action = np.full(environments, t % 6)
        replay.add(states(now), action, np.full(environments, t + 1.0), terminal, states(after))
    return replay


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(1, 40), st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**31))
def test_every_batch_holds_the_newest_transition_of_each_environment(steps, n, back, seed):
    replay = filled(steps, n)
    batch = replay.sample(n + 3, np.random.default_rng(seed), DISCOUNT, back)
    newest = [100 * e + steps - 1 for e in range(n)]
    assert batch.state.time_left[:n].tolist() == newest
    assert batch.reward[:n].tolist() == [steps] * n
    assert batch.next_state.time_left[:n].tolist() == [value + 1 for value in newest]


def test_rewards_of_three_steps_are_summed_with_their_discounts(generator):
    replay = filled(10)
    batch = replay.sample(500, generator, DISCOUNT, 3)
    t = batch.state.time_left % 100
    for m in (1, 2, 3):
        own = (10 - t == m) if m < 3 else (10 - t >= 3)  # fewer near the newest state
        assert own.any()
        expected = sum((t[own] + 1 + k) * DISCOUNT**k for k in range(m))
        assert batch.reward[own] == pytest.approx(expected)
        assert (batch.discount[own] == DISCOUNT**m).all()
        assert (batch.next_state.time_left[own] == batch.state.time_left[own] + m).all()
    assert (batch.action == t % 6).all()


def test_sums_stop_at_the_end_of_an_episode(generator):
    replay = filled(10, ends={(4, 0)})
    batch = replay.sample(500, generator, DISCOUNT, 3)
    at = {t: batch.state.time_left == t for t in (2, 3, 4, 5)}
    assert (batch.discount[at[2] | at[3] | at[4]] == 0).all()
    assert batch.reward[at[4]] == pytest.approx(5)
    assert batch.reward[at[3]] == pytest.approx(4 + 5 / 2)
    assert batch.reward[at[2]] == pytest.approx(3 + 4 / 2 + 5 / 4)
    assert (batch.discount[at[5]] == DISCOUNT**3).all()
    other = batch.state.time_left == 104  # the other environment's episode goes on
    assert (batch.discount[other] == DISCOUNT**3).all()


def test_the_oldest_make_room_and_all_that_is_left_is_drawn(generator):
    replay = filled(1000, environments=2, capacity=20)
    assert len(replay) == 20
    batch = replay.sample(2000, generator, DISCOUNT)
    assert set(batch.state.time_left % 100) == set(range(990 % 100, 1000 % 100 + 100)) - {0}


def test_a_capacity_that_the_environments_do_not_divide_is_rounded_up():
    assert len(filled(1000, environments=3, capacity=20)) == 21


def test_the_state_after_an_end_belongs_to_the_new_episode(generator):
    replay = Replay(10, 1, 2)
    replay.add(states([1]), [5], [7.0], [True], states([0]))
    replay.add(states([50]), [4], [1.0], [False], states([49]))
    batch = replay.sample(50, generator, DISCOUNT, 3)
    ended = batch.state.time_left == 1
    assert (batch.discount[ended] == 0).all() and (batch.reward[ended] == 7).all()
    assert (batch.next_state.time_left[~ended] == 49).all()


def test_a_transition_takes_under_200_bytes():
    assert Replay(100_000, 16, 5).bytes_per_transition < 65
    assert Replay(50_000, 1, 10).bytes_per_transition < 200


def test_compact_states_come_back_whole(generator):
    replay = Replay(4, 1, 2)
    given = State(
        np.array([255], np.int16),
        np.array([70], np.int16),
        np.array([[3, 200]], np.int16),
        np.array([[20, 5]], np.float32),
        np.array([[1.25, 0]], np.float32),
        np.array([False]),
    )
    replay.add(given, [0], [0.0], [False], given)
    batch = replay.sample(1, generator, DISCOUNT)
    for f in fields(State):
        assert np.array_equal(getattr(batch.state, f.name), getattr(given, f.name))


def test_misuse_is_explained(generator):
    with pytest.raises(InputError, match="empty"):
        Replay(10, 2, 2).sample(4, generator, DISCOUNT)
    with pytest.raises(InputError, match="a minibatch of 1 cannot hold the newest 2"):
        filled(3).sample(1, generator, DISCOUNT)
    with pytest.raises(InputError, match="replay of 3 transitions for 4 environments"):
        Replay(3, 4, 2)
