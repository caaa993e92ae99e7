import copy

import numpy as np
import pytest
import torch
from torch.nn.utils import parameters_to_vector

from uavdh_lite import training
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.environment import Rewards
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.experiments.runs import restore_run, save_run
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import CURVES


def run(trainer, steps=100_000):
    """The weights after these steps, or at the end."""
    while not trainer.finished and trainer.steps < steps:
        trainer.step()
    return parameters_to_vector(trainer.learner.online.parameters()).tolist()


def test_a_seed_fixes_the_weights_and_torchs_global_generator_is_left_alone(trainer, tmp_path):
    before, own = torch.get_rng_state(), trainer(0)
    weights = run(own, 400)
    save_agent(tmp_path / "a.safetensors", own.agent)
    load_agent(tmp_path / "a.safetensors").over(own.agent.city)
    assert torch.equal(torch.get_rng_state(), before)
    torch.rand(1)
    assert run(trainer(0), 400) == weights != run(trainer(1), 400)


def given_by(thing, method, call):
    """What a method of a thing gives during a call."""
    given, original = [], getattr(thing, method)

    def recorded(*arguments):
        given.append(original(*arguments))
        return given[-1]

    object.__setattr__(thing, method, recorded)  # also of a frozen dataclass
    call()
    object.__delattr__(thing, method)
    return given


def test_a_step_acts_remembers_and_learns_from_what_was_just_drawn(trainer):
    """Nothing is learned before the prefill. A cold policy is greedy."""
    cold = {"temperature": 1e-6, "temperature_end": 1e-6}
    own = trainer(return_steps=1, learning_rate_end=0.0, replay_prefill=48, **cold)
    run(own, 32)
    assert own.updates == 0 and len(own.replay) == 32
    for updates in (1, 2):
        state, greedy, expected = own.state, own.agent.act(own.state), copy.deepcopy(own.learner)
        rate = own.recipe.learning_rate_at(own.steps)
        (batch,) = given_by(own.replay, "sample", own.step)
        assert own.updates == updates and len(batch.action) == own.recipe.batch_size
        assert np.array_equal(batch.state[:16].uav_cell, state.uav_cell)  # the newest come first
        assert np.array_equal(batch.state[:16].time_left, state.time_left)
        assert np.array_equal(batch.action[:16], greedy) == (updates > 1)
        assert own.learner.optimiser.param_groups[0]["lr"] == rate
        expected.set_learning_rate(rate)
        expected.update(batch)
        ours, theirs = own.learner.state_dict(), expected.state_dict()
        assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_a_share_of_the_episodes_starts_under_way(trainer):
    for share, least, most in ((0.5, 4, 28), (0.0, 0, 0)):
        own = trainer(exploring_starts=share, environments=32)
        under_way = ~own.environment.landing[0][own.state.uav_cell]
        assert least <= under_way.sum() <= most
        assert not own.from_start[under_way].any() and own.from_start.all() == (share == 0)
        state = own.state[under_way]
        home = own.environment.time_to_land[state.city, state.uav_cell]
        assert (state.time_left >= home + own.recipe.exploring_spare_time).all()


@pytest.mark.parametrize("stop", [16, 208, 400])
def test_a_restored_run_goes_on_to_the_same_weights(trainer, tmp_path, monkeypatch, stop):
    """Before the prefill, right after it, and when the ring is full; in the middle of a row."""
    monkeypatch.setattr(training, "BIN", 512)
    options = {"steps": 560, "replay_prefill": 200, "replay_capacity": 300, "return_steps": 3}
    options["amsgrad"] = True  # Adam has a third moment then
    whole, half, again = (trainer(**options) for _ in range(3))
    run(half, stop)
    save_run(tmp_path / "t.safetensors", half)
    restore_run(tmp_path / "t.safetensors", again)
    assert again.steps == half.steps
    assert run(again) == run(whole)
    (ours,), (theirs,) = whole.training_rows, again.training_rows
    assert ours | {"seconds": 0} == theirs | {"seconds": 0} and ours["episodes"] > 9


def test_a_row_of_the_learning_curve_has_the_means_of_the_counted_episodes(trainer, monkeypatch):
    monkeypatch.setattr(training, "BIN", 640)
    own = trainer(exploring_starts=0.5, replay_prefill=2000)
    returns, ended, all_ended = np.zeros(16), [], 0
    while not own.training_rows:
        counted = own.from_start.copy()
        (after, outcome), *_ = given_by(own.environment, "step", own.step)
        all_ended += after.ended.sum()
        returns += Rewards()(outcome)
        for e in np.flatnonzero(after.ended & counted):
            landed, collected = after.landed[e], after.collected[e]
            ended.append((returns[e], landed, collected, collected * landed))
        returns[after.ended] = 0
    (row,) = own.training_rows
    assert row["steps"] == 640 and row["episodes"] == len(ended) > 5
    assert [row[name] for name in CURVES] == pytest.approx(np.mean(ended, axis=0))
    # and, as in the paper, greedy flights of new missions, one for ten episodes
    flights, generator = row["greedy_flights"], stream(Use.GREEDY_FLIGHTS, 0)
    assert flights == all_ended // 10 > 2
    start = own.scenario.sample(own.environment, flights, generator)
    means = fly(own.environment, own.agent, start, generator).records()
    assert [row[f"greedy_{name}"] for name in CURVES] == [means[name].mean() for name in CURVES]


def test_validations_come_when_they_are_due_and_tell_which_agent_is_best(trainer):
    """Always the same missions; of equal scores the first one counts."""
    own = trainer(validation_interval=48, validation_episodes=20, steps=128, replay_prefill=64)
    due = []
    while not own.finished:
        if own.advance():
            due.append(own.steps)
    assert due == [48, 96, 128] == [row["steps"] for row in own.validation_rows]
    flights = evaluate(own.environment, own.agent, own.scenario, 20, 0, Use.VALIDATION)
    means = {name: values.mean() for name, values in flights.records().items()}
    assert means.items() <= own.validation_rows[-1].items()
    for returns, best in (([1], True), ([1, 2], True), ([1, 2, 2], False), ([2, 1], False)):
        rows = enumerate(returns, own.steps + 1 - len(returns))
        own.validation_rows = [{"return": each, "steps": steps} for steps, each in rows]
        assert own.is_best == best
    own.steps += 1
    own.validation_rows.append({"return": 3, "steps": own.steps - 1})
    assert not own.is_best  # that was the agent of a step earlier


def test_the_authors_rule_keeps_the_best_mean_of_fifty_test_flights(trainer, monkeypatch):
    """Over whole rows of the learning curve, as few as have 50 flights; before, none is judged."""
    own = trainer(kept_by="test_flights")
    flights, collected = [30, 20, 0, 10, 60, 20], [1.0, 0.5, None, 1.0, 0.9, 0.0]
    best = []
    for row, of_row in enumerate(zip(flights, collected, strict=True), 1):
        own.steps = row
        count, mean = of_row
        own.training_rows.append(
            {"steps": row, "greedy_flights": count, "greedy_collected_and_landed": mean}
        )
        best.append(own.is_best)
    assert best == [False, True, False, True, True, False]
    short = trainer(kept_by="test_flights", steps=100, replay_prefill=64, validation_interval=64)
    while not short.finished:
        assert short.advance() == (short.steps == 64 or short.finished)
    assert short.is_best  # too short for the rule: the last one is kept
    for name, value in (("BIN", 320), ("TEST_FLIGHTS", 1)):
        monkeypatch.setattr(training, name, value)
    own = trainer(kept_by="test_flights", steps=1600, validation_interval=1600)
    kept = [own.steps for _ in range(100) if own.advance()]
    assert own.finished and kept[0] == 320 and kept[-1] == 1600  # between validations, too


def test_a_row_has_the_losses_since_the_row_before_and_actions_the_temperature_of_their_step(
    trainer, monkeypatch
):
    monkeypatch.setattr(training, "BIN", 160)
    drawn, policy = [], training.softmax_policy

    def softmax_policy(q_values, temperature):
        drawn.append(temperature)
        return policy(q_values, temperature)

    monkeypatch.setattr(training, "softmax_policy", softmax_policy)
    own = trainer(replay_prefill=160, steps=640)
    losses = []
    for row in range(4):
        given = [given_by(own.learner, "update", own.step) for _ in range(10)]
        losses = [float(loss) for of_step in given for loss in of_step]
        assert own.training_rows[row]["loss"] == (np.mean(losses) if losses else None)
    assert len(own.training_rows) == 4 and losses
    assert drawn == [own.recipe.temperature_at(step) for step in range(192, 640, 16)]


def test_what_is_learned_from_follows_the_schedule_and_what_is_reported_does_not(trainer):
    own = trainer(
        return_steps=1,
        crash_reward=-5.0,
        crash_reward_end=-20.0,
        movement_reward=-0.3,
        crash_reward_growth=0.5,
    )
    crashes = 0
    for _ in range(200):
        steps, returns = own.steps, own.returns.copy()
        (after, outcome), *_ = given_by(own.environment, "step", own.step)
        newest = own.replay.reward[own.replay.head - 1]
        crash = -5.0 - 15.0 * min(steps / 2000, 1)
        assert newest == pytest.approx(Rewards(crash=crash, movement=-0.3)(outcome))
        ended = after.ended
        assert own.returns[~ended] == pytest.approx(
            (returns + Rewards()(outcome))[~ended], abs=1e-4
        )
        crashes += outcome.crashed.sum()
    assert crashes > 5


def test_a_small_world_is_solved_in_seconds(trainer, corridor_scenario):
    """From reward alone: fly to the device, collect, fly back, land."""
    network = {"kernels": 8, "hidden": (64,), "batch_size": 64, "learning_rate": 3e-3}
    crash = {"crash_reward": -5.0, "crash_reward_end": -20.0, "crash_reward_growth": 0.75}
    pace = {"environments": 24, "discount": 0.9, "target_update_rate": 0.05, "temperature": 1.0}
    own = trainer(seed=1, steps=9_600, **network, **crash, **pace)

    def score():
        flights = evaluate(own.environment, own.agent, corridor_scenario, 300, seed=1)
        return flights.records()["collected_and_landed"].mean()

    assert score() < 0.3
    run(own)
    assert score() > 0.8
