import copy
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import train
from uavdh_lite.recipe import LITE, PAPER, RECIPES, Recipe, find_recipe
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.storage import read_table
from uavdh_lite.training import BIN, OverlappedTrainer, Trainer


@pytest.fixture
def trainer(corridor, corridor_scenario, quick):
    return lambda seed=0, **changes: Trainer(
        corridor_scenario, replace(quick, **changes), seed, corridor
    )


def weights(trainer):
    return torch.cat([p.detach().flatten() for p in trainer.ddqn.online.parameters()])


def run(trainer):
    while not trainer.finished:
        trainer.step()
    return weights(trainer)


def test_same_seed_same_weights_other_seed_other_weights(trainer):
    first, again, other = (run(trainer(seed, steps=1500)) for seed in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_two_threads_train_the_same_weights(trainer, corridor, corridor_scenario, quick):
    two = OverlappedTrainer(corridor_scenario, quick, 0, corridor)
    assert torch.equal(run(two), run(trainer()))
    assert two.updates > 400


def test_an_error_in_the_second_thread_arrives(corridor, corridor_scenario, quick):
    with OverlappedTrainer(corridor_scenario, quick, 0, corridor) as broken:
        while not broken.updates:
            broken.step()
        broken.ddqn.optimiser = None
        with pytest.raises(AttributeError):
            broken.step()


def test_a_closed_trainer_leaves_no_thread(corridor, corridor_scenario, quick):
    before = threading.active_count()
    with OverlappedTrainer(corridor_scenario, quick, 0, corridor) as two:
        while two.updates < 3:
            two.step()
        assert threading.active_count() == before + 1
    assert threading.active_count() == before


def test_an_update_takes_the_minibatch_of_the_step_before(trainer):
    """Its targets come from the networks before the last update, by the equations."""
    own = trainer()
    while own.updates < 3:
        own.step()
    first, networks = own.minibatch, copy.deepcopy(own.ddqn)
    sampled = []
    sample = own.replay.sample
    own.replay.sample = lambda *arguments: sampled.append(sample(*arguments)) or sampled[-1]
    expected = copy.deepcopy(own.ddqn)
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
        ours, theirs = (getattr(one, part).parameters() for one in (own.ddqn, expected))
        assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


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


def test_a_restored_run_goes_on_to_the_same_weights(trainer, tmp_path):
    whole = trainer()
    expected = run(whole)
    half = trainer()
    while half.steps < 1800:
        half.step()
    half.save(tmp_path / "t.safetensors")
    again = trainer()
    again.restore(tmp_path / "t.safetensors")
    assert torch.equal(run(again), expected)
    without_time = [
        [{k: v for k, v in row.items() if k != "seconds"} for row in t.training_rows]
        for t in (whole, again)
    ]
    assert without_time[0] == without_time[1]


def test_another_run_is_not_restored(trainer, tmp_path):
    trainer().save(tmp_path / "t.safetensors")
    with pytest.raises(InputError, match="another seed than asked for: 0 there, 5 here"):
        trainer(seed=5).restore(tmp_path / "t.safetensors")
    with pytest.raises(InputError, match=r"another recipe.*discount: 0.95 there, 0.9 here"):
        trainer(discount=0.9).restore(tmp_path / "t.safetensors")


def test_files_of_a_run(trainer, tmp_path):
    done = trainer(steps=2 * BIN + 40)
    best = train(done, tmp_path / "run", command="python -m uavdh_lite train ...")
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "about.json",
        "best.safetensors",
        "lock",
        "training.csv",
        "training.safetensors",
        "validation.csv",
    ]
    curve = read_table(tmp_path / "run" / "training.csv")
    assert curve["steps"].tolist() == [BIN, 2 * BIN]
    assert (curve["episodes"] > 0).all()
    validation = read_table(tmp_path / "run" / "validation.csv")
    assert validation["steps"].tolist() == [*range(1000, 10_001, 1000), 10_040]
    agent = load_agent(best)
    about = agent.training
    kept = about["validation"]["collection_ratio_and_landed"]
    assert kept == pytest.approx(validation["collection_ratio_and_landed"].max(), abs=1e-6)
    assert about["command"].startswith("python -m uavdh_lite train")
    assert about["seed"] == 0 and about["steps"] == about["validation"]["steps"]


def test_a_folder_with_a_run_is_not_overwritten(trainer, tmp_path):
    train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="holds a run already; add --resume"):
        train(trainer(steps=400), tmp_path)
    with pytest.raises(InputError, match="no run to resume there"):
        train(trainer(steps=400), tmp_path / "empty", resume=True)
    train(trainer(steps=400), tmp_path, resume=True)  # a finished run stays finished


OPTIONS = {
    "scenario": "manhattan",
    "seed": 3,
    "steps": 9600,
    "validation-interval": 1600,
    "validation-episodes": 10,
    "kernels": 2,
    "hidden": 16,
    "batch-size": 32,
    "replay-capacity": 2000,
    "replay-prefill": 320,
}


def command(out, *more):
    options = [text for name, value in OPTIONS.items() for text in (f"--{name}", str(value))]
    return [sys.executable, "-m", "uavdh_lite", "train", *options, "--out", str(out), *more]


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    subprocess.run(command(out), check=True, capture_output=True)
    return out


def assert_same_result(out, uninterrupted):
    tensors, about = load(out / "training.safetensors", "training")
    expected, expected_about = load(uninterrupted / "training.safetensors", "training")
    assert about["steps"] == expected_about["steps"] == 9600
    assert tensors.keys() == expected.keys()
    for name, tensor in tensors.items():
        assert torch.equal(tensor, expected[name]), name
    for name in ("training.csv", "validation.csv"):
        ours, theirs = read_table(out / name), read_table(uninterrupted / name)
        for column in ours.keys() - {"seconds"}:
            assert np.array_equal(ours[column], theirs[column], equal_nan=True), column


def started(out, signal_number):
    """Start the run, wait for its first saved state, send the signal; the finished process."""
    process = subprocess.Popen(
        command(out), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    while not (out / "training.safetensors").exists():
        assert process.poll() is None, process.stdout.read()
        time.sleep(0.005)
    os.kill(process.pid, signal_number)
    output, _ = process.communicate(timeout=60)
    _, about = load(out / "training.safetensors", "training")
    assert 0 < about["steps"] < 9600
    return process.returncode, output


def test_a_killed_run_resumes_to_the_same_result(tmp_path, uninterrupted):
    code, _ = started(tmp_path, signal.SIGKILL)
    assert code == -signal.SIGKILL
    subprocess.run(command(tmp_path, "--resume"), check=True, capture_output=True)
    assert_same_result(tmp_path, uninterrupted)


def test_ctrl_c_saves_and_says_how_to_resume(tmp_path, uninterrupted):
    code, output = started(tmp_path, signal.SIGINT)
    assert code == 130
    assert "--resume" in output and "Traceback" not in output
    subprocess.run(command(tmp_path, "--resume"), check=True, capture_output=True)
    assert_same_result(tmp_path, uninterrupted)


@pytest.mark.parametrize("steps", [800, 1920])
def test_a_run_left_early_resumes_to_the_same_result(tmp_path, uninterrupted, steps):
    """Before and after the first validation, at 1600 steps; 32 environments."""
    left = subprocess.run(
        command(tmp_path, "--stop-after", str(steps)), check=True, capture_output=True, text=True
    )
    assert f"left after {steps} steps; to go on: add --resume" in left.stdout
    assert (
        ("best agent" in left.stdout) == (tmp_path / "best.safetensors").exists() == (steps > 1600)
    )
    subprocess.run(command(tmp_path, "--resume"), check=True, capture_output=True)
    assert_same_result(tmp_path, uninterrupted)


def test_schedules():
    recipe = replace(
        LITE,
        steps=1000,
        temperature_decay=0.5,
        crash_reward=-10,
        crash_reward_end=-60,
        crash_reward_growth=0.5,
    )
    assert [recipe.rewards_at(s).crash for s in (0, 250, 500, 900)] == [-10, -35, -60, -60]
    assert [recipe.temperature_at(s) for s in (0, 250, 500, 900)] == pytest.approx(
        [2.0, 1.05, 0.1, 0.1]
    )
    assert recipe.learning_rate_at(500) == pytest.approx(3e-4)
    assert recipe.learning_rate_at(1000) == 0
    assert PAPER.temperature_at(0) == PAPER.temperature_at(10**6) == 0.1


def test_the_paper_recipe_is_the_papers():
    assert (PAPER.discount, PAPER.target_update_rate, PAPER.learning_rate) == (0.95, 0.005, 3e-5)
    assert (PAPER.replay_capacity, PAPER.replay_prefill, PAPER.batch_size) == (50_000, 25_000, 128)
    assert (PAPER.environments, PAPER.return_steps, PAPER.huber_delta) == (1, 1, None)
    assert (PAPER.strides, PAPER.hidden, PAPER.layer_norm) == ((1, 1), (256, 256, 256), False)
    assert PAPER.rewards_at(0).crash == PAPER.rewards_at(PAPER.steps).crash == -150
    assert PAPER.amsgrad
    assert PAPER.learning_rate_at(10**6) == 3e-5 and PAPER.exploring_starts == 0


def test_the_paper_recipe_runs(corridor, corridor_scenario):
    recipe = replace(PAPER, kernel_size=3, replay_prefill=60, steps=80)
    trainer = Trainer(corridor_scenario, recipe, 0, corridor)
    before = weights(trainer)
    run(trainer)
    assert trainer.updates == 20  # one a step, from the one after the prefill on
    assert not torch.equal(weights(trainer), before)


def test_recipe_round_trip():
    for recipe in RECIPES.values():
        assert Recipe.from_json(recipe.as_json() | {"hidden": list(recipe.hidden)}) == recipe


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("steps", 0),
        ("discount", 1.5),
        ("temperature", 0.0),
        ("learning_rate_end", -1.0),
        ("huber_delta", 0.0),
        ("replay_prefill", 60_000),
        ("environments", 200),
        ("hidden", (256, 0)),
        ("data_scale", -1.0),
        ("exploring_starts", 2.0),
        ("leak", -0.1),
    ],
)
def test_impossible_recipes_name_the_field(field, value):
    with pytest.raises(InputError, match=f"recipe paper: {field} is .* must be"):
        replace(PAPER, **{field: value})


def test_unknown_recipe_lists_the_known_ones():
    with pytest.raises(InputError, match="unknown recipe 'secret': choose one of paper, lite"):
        find_recipe("secret")


@pytest.mark.parametrize("kind", ["centred", "non_centred", "global_local"])
def test_every_observation_trains(kind, trainer):
    own = trainer(observation=kind, local_size=5, pooling=1, strides=(1,), steps=400)
    before = weights(own)
    assert not torch.equal(run(own), before)


def test_a_larger_city_trains_with_global_and_local_maps():
    recipe = replace(
        LITE, observation="global_local", steps=320, replay_prefill=160, validation_episodes=4
    )
    trainer = Trainer(SCENARIOS["harbour"], recipe, seed=0)
    run(trainer)
    assert trainer.updates > 0
    trainer.validate()
    assert 0 <= trainer.validation_rows[-1]["collection_ratio"] <= 1
