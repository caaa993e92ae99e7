"""What `benchmarks/fleet.py` computes on the device is what the library computes."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks import fleet as program
from benchmarks.fleet import Fleet, Run, packed
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import ACTIONS, Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import restore_run
from uavdh_lite.recipe import LITE, PLAIN
from uavdh_lite.replay import Batch
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import Trainer

pytestmark = pytest.mark.long  # it trains
VILLAGE = find_scenario("village")
TINY = replace(
    PLAIN, kernels=4, kernel_size=3, strides=(2, 2), hidden=(32,), environments=4, batch_size=16,
    replay_capacity=200, replay_prefill=80, steps=2_000, validation_interval=1_000,
    validation_episodes=20,
)  # fmt: skip


@pytest.fixture
def build(tmp_path):
    """A function that makes the fleet of some trainings; it takes recipes, one or more seeds."""

    def build(*recipes, seeds=1, scenario=VILLAGE, folder=tmp_path, **options):
        trainers = [Trainer(scenario, recipe, seed) for recipe in recipes for seed in range(seeds)]
        runs = [Run(folder / str(i), trainer, {}) for i, trainer in enumerate(trainers)]
        return Fleet(runs, "cpu", **options)

    return build


def under_way(environment: Environment, scenario, count: int) -> State:
    """States anywhere, a tenth of them with a single unit of time left."""
    generator = stream(Use.BENCHMARK)
    state = scenario.sample_anywhere(environment, count, generator, 0)
    last = generator.random(count) < 0.1
    return replace(state, time_left=np.where(last, np.int16(1), state.time_left))


def maps_and_times(observation, state):
    map, time = observation(state)
    return map.numpy(), time.numpy()


@pytest.mark.parametrize("kind", ["centred", "non_centred"])
@pytest.mark.parametrize("scenario", ["village", "manhattan"])
def test_transitions_and_maps_are_those_of_the_library(kind, scenario):
    scenario = find_scenario(scenario)
    trainer = Trainer(scenario, replace(PLAIN, kernel_size=3, observation=kind), 0)
    environment, observation = trainer.environment, trainer.learner.observation
    world = program.World(observation, scenario.max_devices, "cpu")
    state, generator = under_way(environment, scenario, 4_000), stream(Use.BENCHMARK, 1)
    action = generator.integers(0, len(ACTIONS), len(state))
    fading = environment.draw_fading(state, generator)
    expected, outcome = environment.transition(state, action, fading)
    given = torch.from_numpy(packed(state))
    after, what, over = world.transition(given, torch.from_numpy(action), torch.from_numpy(fading))
    np.testing.assert_allclose(after.numpy(), packed(expected), atol=1e-4)
    assert np.array_equal(over.numpy(), expected.ended)
    assert outcome.landed.any() and outcome.crashed.any() and outcome.intervened.any()
    own = (outcome.uploaded.sum(1), ~outcome.landed, outcome.intervened, outcome.crashed)
    np.testing.assert_allclose(what.numpy(), np.stack(own, axis=1), atol=1e-4)
    for found, right in zip(world.observe(after), observation(expected), strict=True):
        torch.testing.assert_close(found, right, rtol=0, atol=1e-4)


@pytest.mark.parametrize("kind", ["centred", "non_centred"])
def test_updates_give_the_weights_of_the_library(kind, build):
    """Three updates in turn: Adam's moments and the target network matter, too."""
    memory = {"batch_size": 8, "replay_capacity": 100, "replay_prefill": 100}
    recipe = replace(PLAIN, observation=kind, validation_episodes=1, **memory)
    scenario = find_scenario("manhattan")
    fleet = build(recipe, seeds=2, scenario=scenario)
    learners = [Trainer(scenario, recipe, seed).learner for seed in range(2)]
    before = fleet.vectors.clone()
    for update in range(3):
        parts, batches = [], []
        for run, learner in enumerate(learners):
            state = under_way(fleet.trainers[0].environment, scenario, 2 * recipe.batch_size)
            mixed = stream(Use.BENCHMARK, 10 * update + run)
            state = state[mixed.permutation(len(state))]
            first, after = state[: recipe.batch_size], state[recipe.batch_size :]
            action = mixed.integers(0, 6, recipe.batch_size)
            reward = mixed.normal(size=recipe.batch_size).astype(np.float32) * 10
            discount = mixed.choice(np.float32([0, 0.95]), recipe.batch_size)
            loss = learner.update(Batch(first, action, reward, discount, after))
            states = np.stack([packed(part) for part in (first, after)])
            batches.append((states, action, reward, discount, loss))
        states, action, reward, discount, losses = zip(*batches, strict=True)
        given = [np.stack(states, axis=1), np.stack(action), np.stack(reward), np.stack(discount)]
        loss = fleet.loss_of(fleet.leaves, *map(torch.from_numpy, given))
        torch.testing.assert_close(loss.detach(), torch.stack(losses), rtol=1e-4, atol=1e-5)
        parts = torch.autograd.grad(loss.sum(), fleet.leaves)
        count = update + 1
        plan = torch.zeros(2, 5)
        plan[:, program.RATE] = recipe.learning_rate / (1 - 0.9**count)
        plan[:, program.ROOT] = (1 - 0.999**count) ** -0.5
        with torch.no_grad():
            fleet._adam(parts, plan)
    fleet.fetch(weights_alone=True)
    for trainer, learner in zip(fleet.trainers, learners, strict=True):
        found, right = trainer.learner.state_dict(), learner.state_dict()
        for name, weight in right.items():
            if not name.startswith("step"):
                torch.testing.assert_close(found[name], weight, rtol=1e-4, atol=5e-5)
    assert (fleet.vectors[0] - before[0]).abs().max() > 1e-5


def test_minibatches_are_those_of_the_librarys_memory(build):
    """The device's memory, given to the library's, holds the same transitions."""
    fleet = build(replace(TINY, batch_size=80), seeds=2)
    plan = fleet.next_plan(0, 0, 0, 0)
    fleet.plan[: len(plan)] = torch.from_numpy(plan)
    for _step in range(70):  # more than the memory has room for
        fleet.fill()
    for trainer in fleet.trainers:
        trainer.replay.head, trainer.replay.filled = 70 % fleet.L, fleet.L - 1
    fleet.fetch()
    draws = stream(Use.BENCHMARK).random(fleet.uniform.shape, np.float32)
    fleet.uniform.copy_(torch.from_numpy(draws))
    states, action, reward, discount = fleet.sample(fleet.plan[69])
    for run, trainer in enumerate(fleet.trainers):
        batch = trainer.replay.sample(80, Draws(fleet.uniform[run].numpy()))
        alive = batch.discount > 0
        np.testing.assert_array_equal(states[0, run], packed(batch.state))
        np.testing.assert_array_equal(action[run], batch.action)
        np.testing.assert_allclose(reward[run], batch.reward, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(discount[run], batch.discount, rtol=1e-6)
        for part in states[1:, run]:
            np.testing.assert_array_equal(part[alive], packed(batch.next_state)[alive])
        assert alive.any() and not alive.all()


class Draws:
    """A generator that gives the library's memory the draws of the device."""

    def __init__(self, uniform: np.ndarray):
        self.uniform = uniform

    def choice(self, among: int, size: int, replace: bool) -> np.ndarray:
        return np.floor(self.uniform[-size:] * np.float32(among)).astype(int)


def test_a_run_that_was_stopped_goes_on_here_and_with_the_library(tmp_path, monkeypatch, capsys):
    """The first call ends by a clock that ticks a minute a look; after two chunks of steps."""
    monkeypatch.setattr(program, "PLAIN", TINY)
    monkeypatch.setattr(program, "CHUNK", 50)
    arguments = ["learning_rate=0.001", "--scenario", "village"]
    arguments += ["--device", "cpu", "--seeds", "2", "--out", str(tmp_path), "--minutes", "6.5"]

    def call() -> list[str]:
        with pytest.raises(SystemExit) as end:
            program.main(arguments)
        assert end.value.code == 0
        return capsys.readouterr().out.splitlines()

    def trained(seed: int) -> Trainer:
        trainer = Trainer(VILLAGE, replace(TINY, learning_rate=0.001), seed)
        folder = tmp_path / f"learning_rate=0.001-{seed}"
        restore_run(folder / "training.safetensors", trainer)
        return trainer

    ticks = itertools.count(0, 60)
    with monkeypatch.context() as patched:
        patched.setattr(program, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
        call()
    stopped = trained(1)
    assert (stopped.steps, stopped.updates, stopped.replay.filled) == (400, 81, 50)
    assert stopped.training_rows == [] and stopped.validation_rows == []
    stopped.step()
    assert stopped.updates == 82 and stopped.is_finite()
    said = call()
    assert sum(": 2000 steps" in line for line in said) == 2 + 1  # of each run, and of the fleet
    ended = trained(1)
    assert ended.finished and ended.updates == 481 and len(ended.validation_rows) == 2
    assert all(0 < row["greedy_flights"] <= 64 for row in ended.training_rows)
    assert load_agent(tmp_path / "learning_rate=0.001-0" / "last.safetensors")


def test_what_a_fleet_does_not_compute_or_cannot_continue_is_named(build, tmp_path):
    with pytest.raises(InputError, match=r"with another .*leak"):
        build(LITE)
    with pytest.raises(InputError, match="over a single city, not over 2"):
        build(TINY, scenario=replace(VILLAGE, city="random:2:0:8"))
    (tmp_path / "0").mkdir()
    (tmp_path / "0" / "validation.csv").touch()
    with pytest.raises(InputError, match="holds a run without its training"):
        build(TINY)
