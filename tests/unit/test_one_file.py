"""The small file computes what the library does, from the same state and random numbers."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite import one_file
from uavdh_lite.ddqn import draw_actions, softmax_policy
from uavdh_lite.environment import Rewards
from uavdh_lite.evaluation import evaluate
from uavdh_lite.recipe import SMALL
from uavdh_lite.streams import Use
from uavdh_lite.training import VALIDATION_SEED, Trainer

UPDATES = 5


@pytest.fixture
def twins(environment_of_village, settings):
    """A trainer whose memory has gone round, and the small file's parts in the same state."""
    recipe = replace(SMALL, steps=6000, replay_capacity=1008, replay_prefill=992, batch_size=64)
    trainer = Trainer(one_file.VILLAGE, recipe, 0, environment_of_village.city)
    see, memory = one_file.CentredMap(trainer.environment), one_file.Memory(1008, 16)
    add = trainer.replay.add

    def both(*step):
        add(*step)
        memory.add(*step)

    trainer.replay.add = both
    for _ in range(80):  # of 16 steps
        trainer.step()
    online = one_file.QNetwork(see.side)
    target = copy.deepcopy(online)
    for own, other in ((online, trainer.learner.online), (target, trainer.learner.target)):
        own.load_state_dict(other.state_dict())
    optimiser = torch.optim.Adam(online.parameters(), 0.0, eps=1e-7, amsgrad=True, fused=True)
    optimiser.load_state_dict(copy.deepcopy(trainer.learner.optimiser.state_dict()))
    return trainer, see, memory, online, target, optimiser


@pytest.fixture
def environment_of_village():
    return one_file.Environment(one_file.load_city("village"))


@pytest.fixture
def settings():
    return one_file.Settings(6000)


def test_what_it_sees_draws_and_learns_is_the_library_s(twins, settings):
    trainer, see, memory, online, target, optimiser = twins
    learner, generator = trainer.learner, trainer.generator
    for ours, theirs in zip(see(trainer.state), learner.observation(trainer.state), strict=True):
        assert torch.equal(ours, theirs)
    with torch.no_grad():
        q = online(*see(trainer.state))
    assert torch.equal(q, learner.q_values(trainer.state))
    theirs = draw_actions(softmax_policy(q, 0.1), copy.deepcopy(generator))
    assert (one_file.softmax_policy(q, 0.1, copy.deepcopy(generator)) == theirs).all()

    for _ in range(UPDATES):
        batch = memory.sample(64, copy.deepcopy(generator))
        theirs = trainer.replay.sample(64, generator)
        goes_on = theirs.discount > 0  # elsewhere the library keeps no next state
        for ours, other in (
            (batch[0], theirs.state),
            (batch[3][goes_on], theirs.next_state[goes_on]),
        ):
            assert all((vars(ours)[name] == values).all() for name, values in vars(other).items())
        assert (batch[1].numpy() == theirs.action).all()
        assert (batch[2].numpy() == theirs.reward).all()
        ended = torch.tensor(batch[3].ended)
        assert ended.any()
        with torch.no_grad():
            seen = see(batch[3])
            y = one_file.double_target(batch[2], ended, 0.95, online(*seen), target(*seen))
        assert torch.equal(y, learner.targets(theirs))
        loss = one_file.update(online, target, optimiser, see, batch, settings)
        assert torch.equal(loss, learner.update(theirs))
        for ours, other in ((online, learner.online), (target, learner.target)):
            for name, weights in other.state_dict().items():
                assert torch.equal(ours.state_dict()[name], weights), name


def test_its_constants_and_its_evaluation_are_those_of_small(environment_of_village):
    own = one_file.Settings()
    pairs = {
        "steps": "steps", "uavs": "environments", "discount": "discount", "batch": "batch_size",
        "target_rate": "target_update_rate", "learning_rate": "learning_rate",
        "memory": "replay_capacity", "prefill": "replay_prefill", "temperature": "temperature",
    }  # fmt: skip
    assert {a: getattr(own, a) for a in pairs} == {a: getattr(SMALL, b) for a, b in pairs.items()}
    for step in (0, 30_000, 108_000, 144_000):
        assert Rewards(crash=-own.crash(step)) == SMALL.training_rewards_at(step)
    trainer = Trainer(one_file.VILLAGE, SMALL, 0, environment_of_village.city)
    network = trainer.learner.online
    flights = evaluate(
        trainer.environment, trainer.agent, one_file.VILLAGE, 100, VALIDATION_SEED, Use.VALIDATION
    )
    means = flights.metrics()
    found = one_file.evaluate(network, one_file.CentredMap(trainer.environment), 100)
    assert np.allclose(found, [means[k].mean for k in ("landed", "collected_and_landed")])


def test_it_trains_draws_its_curve_and_a_flight(monkeypatch, capsys, tmp_path):
    picture = tmp_path / "village.png"
    monkeypatch.setattr("sys.argv", ["one_file", "--steps", "2400", "--png", str(picture)])
    monkeypatch.setattr(one_file.evaluate, "__defaults__", (20,))
    one_file.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 19 and lines[-1].startswith("      2,400")
    assert picture.stat().st_size > 10_000
