"""Updates a second of the training loop, as a ratio to a bare loop on random tensors.

    python benchmarks/training.py [--recipe lite] [--seconds 20]

The bare loop makes the same DDQN update (network, minibatch, optimiser) on tensors that are there
already, on one thread; the training loop also flies, explores, stores, samples and builds the maps,
on one thread or on two. They take turns, second by second, so that a noisy machine disturbs all
alike.
"""

import argparse
import time
from dataclasses import replace

import torch

from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.training import OverlappedTrainer, Trainer


def trainer(recipe, kind: type[Trainer] = Trainer) -> Trainer:
    run = kind(SCENARIOS["manhattan"], recipe, seed=0)
    while not run.updates:
        run.step()
    return run


def bare_update(run: Trainer):
    """A function that makes one update on random tensors."""
    recipe = run.recipe
    count = recipe.batch_size

    def observation():
        return [torch.rand(count, *shape) for shape in run.observation.map_shapes()], torch.rand(
            count, 1
        )

    seen, then = observation(), observation()
    action = torch.randint(0, 6, (count,))
    reward, discount = torch.randn(count), torch.full((count,), recipe.discount)
    return lambda: run.learner.update(seen, action, run.learner.targets(reward, discount, then))


def count(action, seconds: float) -> int:
    done, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        action()
        done += 1
    return done


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recipe", default="lite")
    parser.add_argument("--seconds", type=int, default=20, help="for each of the three")
    options = parser.parse_args()
    recipe = replace(find_recipe(options.recipe), replay_prefill=2_000)
    torch.set_num_threads(1)
    keep_freed_memory()  # as `train` does
    one, two = (trainer(recipe, kind) for kind in (Trainer, OverlappedTrainer))
    loops = {"one thread": one.step, "two threads": two.step, "bare": bare_update(trainer(recipe))}
    updates = dict.fromkeys(loops, 0)
    for _ in range(options.seconds):
        for name, step in loops.items():
            updates[name] += count(step, 1.0)
    for name, number in updates.items():
        speed, share = number / options.seconds, number / updates["bare"]
        print(f"{recipe.name}, {name:<12}{speed:6.1f} updates/s, {share:.2f} of the bare loop's")
    print(f"{one.replay.bytes_per_transition:.0f} bytes a transition")
