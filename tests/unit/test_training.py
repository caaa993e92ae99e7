import copy
import threading
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.errors import InputError
from uavdh_lite.recipe import LITE, PAPER
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream
from uavdh_lite.symmetry import turned_cities
from uavdh_lite.training import BIN, OverlappedTrainer, Trainer

BEYOND = {
    "quantiles": 8,
    "huber_delta": 1.0,
    "failsafe": True,
    "advantage_learning": 0.5,
    "exploring_starts": 0.0,
}
either = pytest.mark.parametrize("changes", [{}, BEYOND], ids=["ddqn", "quantile"])


def weights(trainer):
    return torch.cat([p.detach().flatten() for p in trainer.learner.online.parameters()])


def run(trainer):
    while not trainer.finished:
        trainer.step()
    return weights(trainer)


def test_same_seed_same_weights_other_seed_other_weights(trainer):
    first, again, other = (run(trainer(seed, steps=1000)) for seed in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@either
def test_two_threads_train_the_same_weights(trainer, corridor, corridor_scenario, quick, changes):
    changes = {"steps": 1000, **changes}
    two = OverlappedTrainer(corridor_scenario, replace(quick, **changes), 0, corridor)
    assert torch.equal(run(two), run(trainer(**changes)))
    assert two.updates > 40


def test_an_error_in_the_second_thread_arrives(corridor, corridor_scenario, quick):
    with closing(OverlappedTrainer(corridor_scenario, quick, 0, corridor)) as broken:
        while not broken.updates:
            broken.step()
        broken.learner.optimiser = None
        with pytest.raises(AttributeError):
            broken.step()


def test_a_closed_trainer_leaves_no_thread(corridor, corridor_scenario, quick):
    before = threading.active_count()
    with closing(OverlappedTrainer(corridor_scenario, quick, 0, corridor)) as two:
        while two.updates < 3:
            two.step()
        assert threading.active_count() == before + 1
    assert threading.active_count() == before


def test_an_update_takes_the_minibatch_of_the_step_before(trainer):
    """Its targets come from the networks before the last update, by the equations."""
    own = trainer()
    while own.updates < 3:
        own.step()
    first, networks = own.minibatch, copy.deepcopy(own.learner)
    sampled = []
    sample = own.replay.sample
    own.replay.sample = lambda *arguments: sampled.append(sample(*arguments)) or sampled[-1]
    expected = copy.deepcopy(own.learner)
    expected.set_learning_rate(own.recipe.learning_rate_at(own.steps))
    own.step()
    (batch,) = sampled
    q_online = networks.online(*own.observation(batch.next_state))
    q_target = networks.target(*own.observation(batch.next_state))
    for row in range(0, len(batch.action), 5):
        best = int(q_online[row].argmax())
        y = float(batch.reward[row]) + float(batch.discount[row]) * float(q_target[row, best])
        assert float(own.minibatch.y[row]) == pytest.approx(y, rel=1e-5, abs=1e-5)
    expected.update(first.observation, first.action, first.y)
    for part in ("online", "target"):
        ours, theirs = (getattr(one, part).parameters() for one in (own.learner, expected))
        assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


def test_targets_beyond_the_paper(trainer):
    """Quantiles of what the online mean chooses of the allowed actions, less α of the gap."""
    own = trainer(**BEYOND)
    while own.steps < 1500:
        own.step()
    networks, sampled = copy.deepcopy(own.learner), []
    sample = own.replay.sample
    own.replay.sample = lambda *arguments: sampled.append(sample(*arguments)) or sampled[-1]
    own.step()
    (batch,) = sampled
    allowed, allowed_next = (
        own.environment.allowed_actions(state) for state in (batch.state, batch.next_state)
    )
    q_online = networks.online(*own.observation(batch.next_state))
    quantiles = networks.target.quantiles(*own.observation(batch.next_state))
    q_target = networks.target(*own.observation(batch.state))
    masked = others = 0
    for row, action in enumerate(batch.action):
        best = max(np.flatnonzero(allowed_next[row]), key=lambda a: q_online[row, a])
        masked += best != int(q_online[row].argmax())
        gap = q_target[row][torch.from_numpy(allowed[row])].max() - q_target[row, action]
        others += gap > 0
        y = batch.reward[row] + batch.discount[row] * quantiles[row, best] - 0.5 * gap
        assert torch.allclose(own.minibatch.y[row], y, atol=1e-4)
    assert masked and others, "the mask and the gap made no difference: nothing was tested"


def test_with_the_failsafe_a_learner_is_never_corrected(trainer):
    """It chooses among the allowed actions, from the first random ones on."""
    own = trainer(steps=2000, **BEYOND)
    outcomes, step = [], own.environment.step

    def recorded(*arguments):
        after, outcome = step(*arguments)
        outcomes.append(outcome)
        return after, outcome

    object.__setattr__(own.environment, "step", recorded)
    run(own)
    assert sum(outcome.landed.sum() for outcome in outcomes) > 20
    for kind in ("crashed", "intervened", "sent_home"):
        assert not any(getattr(outcome, kind).any() for outcome in outcomes), kind
    own.validate()
    row = own.validation_rows[-1]
    assert row["has_landed"] == 1 and row["sent_home"] == row["safety_interventions"] == 0


def test_the_agent_with_the_highest_return_is_the_best(trainer, monkeypatch):
    own = trainer()
    kept = []
    for collected, total in ((0.5, -3.0), (0.4, 2.0), (0.9, 1.0), (0.8, 2.5)):
        means = {"collection_ratio_and_landed": collected, "cumulative_reward": total}
        records = {name: np.full(2, value) for name, value in means.items()}
        flights = SimpleNamespace(records=lambda records=records: records)
        monkeypatch.setattr("uavdh_lite.training.evaluate", lambda *_, flights=flights: flights)
        kept.append(own.validate())
    assert kept == [True, True, False, True]


def test_a_training_from_before_the_failsafe_goes_on(trainer, tmp_path, monkeypatch):
    """Its recipe lacks the newer fields, which then had no effect."""
    half = trainer(steps=1000)
    while half.steps < 500:
        half.step()
    newer = {"failsafe", "quantiles", "advantage_learning"}
    identity = half.identity()
    identity["recipe"] = {k: v for k, v in identity["recipe"].items() if k not in newer}
    monkeypatch.setattr(half, "identity", lambda: identity)
    monkeypatch.setattr("uavdh_lite.checkpoint.FORMAT", 4)
    half.save(tmp_path / "t.safetensors")
    monkeypatch.undo()
    again = trainer(steps=1000)
    again.restore(tmp_path / "t.safetensors")
    assert torch.equal(run(again), run(trainer(steps=1000)))


def test_a_cold_policy_is_greedy(trainer):
    own = trainer(temperature=1e-6, temperature_end=1e-6)
    while own.updates < 3:
        own.step()
    assert (own._act(own.state) == own.agent(own.state)).all()


def test_a_share_of_the_episodes_starts_under_way(trainer):
    own = trainer(exploring_starts=0.5, environments=32)
    own._starts(np.arange(32))
    assert 4 < own.statistics.ordinary.sum() < 28


def test_global_generators_are_neither_used_nor_changed(trainer):
    torch.manual_seed(1)
    before = torch.get_rng_state()
    run(trainer(steps=600))
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.long
@either
def test_a_restored_run_goes_on_to_the_same_weights(trainer, tmp_path, changes):
    """With the statistics of the row that was begun before it was saved."""
    changes = {"steps": BIN + 400, "environments": 32, **changes}
    whole, half, again = (trainer(**changes) for _ in range(3))
    expected = run(whole)
    while half.steps < BIN - 800:
        half.step()
    half.save(tmp_path / "t.safetensors")
    again.restore(tmp_path / "t.safetensors")
    assert torch.equal(run(again), expected)
    (ours,), (theirs,) = whole.training_rows, again.training_rows
    assert ours | {"seconds": 0} == theirs | {"seconds": 0}


def test_another_run_is_not_restored(trainer, tmp_path):
    trainer().save(tmp_path / "t.safetensors")
    with pytest.raises(InputError, match="another seed than asked for: 0 there, 5 here"):
        trainer(seed=5).restore(tmp_path / "t.safetensors")
    with pytest.raises(InputError, match=r"another recipe.*discount: 0.95 there, 0.9 here"):
        trainer(discount=0.9).restore(tmp_path / "t.safetensors")


def test_the_paper_recipe_runs(corridor, corridor_scenario):
    recipe = replace(PAPER, kernel_size=3, replay_prefill=60, steps=80)
    trainer = Trainer(corridor_scenario, recipe, 0, corridor)
    before = weights(trainer)
    run(trainer)
    assert trainer.updates == 20  # one a step, from the one after the prefill on
    assert not torch.equal(weights(trainer), before)


@pytest.mark.parametrize("kind", ["centred", "non_centred", "global_local"])
def test_every_observation_trains(kind, trainer):
    own = trainer(observation=kind, local_size=5, pooling=1, strides=(1,), steps=400)
    before = weights(own)
    assert not torch.equal(run(own), before)


def test_a_turned_run_learns_in_all_eight_views_and_flies_the_city_by_all(
    tmp_path, corridor, corridor_scenario, quick
):
    trainer = Trainer(corridor_scenario, replace(quick, turned=True), seed=3, city=corridor)
    in_all = Trainer(corridor_scenario, quick, seed=3, city=turned_cities(corridor))
    assert torch.equal(run(trainer), run(in_all))
    trainer.validate()
    in_all.validate()
    assert trainer.validation_rows == in_all.validation_rows
    save_agent(tmp_path / "agent.safetensors", trainer.agent)
    agent = load_agent(tmp_path / "agent.safetensors")
    assert agent.city.fingerprint == corridor.fingerprint and agent.symmetric
    start = corridor_scenario.sample(corridor, 5, stream(Use.TEST))
    over = replace(in_all.agent.over(corridor), symmetric=True)
    assert torch.equal(agent.q_values(start), over.q_values(start))
    assert not agent.knows(turned_cities(corridor)[1])


def test_a_larger_city_trains_with_global_and_local_maps():
    recipe = replace(
        LITE, observation="global_local", steps=320, replay_prefill=160, validation_episodes=4
    )
    trainer = Trainer(SCENARIOS["harbour"], recipe, seed=0)
    run(trainer)
    assert trainer.updates > 0
    trainer.validate()
    assert 0 <= trainer.validation_rows[-1]["collection_ratio"] <= 1
