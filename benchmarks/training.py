"""Updates a second of the training loop, and what the whole training takes.

    python benchmarks/training.py [--scenario manhattan] [--recipe lite] [--seconds 20]

The loop flies, explores, stores, samples and learns, on one thread. Next to it, second by second,
runs a bare loop that learns from one minibatch again and again: so a noisy machine disturbs both
alike. The hours are those of the whole recipe at that speed, without its validations.
"""

import argparse
import resource
import time
from collections.abc import Callable
from dataclasses import replace

import torch

from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer


def ready(scenario: str, recipe: str) -> Trainer:
    """A training that has made its first update, after a short prefill."""
    short = replace(find_recipe(recipe), replay_prefill=2_000)
    trainer = Trainer(find_scenario(scenario), short, seed=0)
    while not trainer.updates:
        trainer.step()
    return trainer


def in_turns(loops: dict[str, Callable[[], object]], seconds: int) -> dict[str, float]:
    """Calls a second of each loop; each runs for a second at a time."""
    calls, spent = dict.fromkeys(loops, 0), dict.fromkeys(loops, 0.0)
    for _ in range(seconds):
        for name, call in loops.items():
            started = time.perf_counter()
            while time.perf_counter() - started < 1:
                call()
                calls[name] += 1
            spent[name] += time.perf_counter() - started
    return {name: calls[name] / spent[name] for name in loops}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="manhattan")
    parser.add_argument("--recipe", default="lite")
    parser.add_argument("--seconds", type=int, default=20, help="for each of the two loops")
    options = parser.parse_args()
    torch.set_num_threads(1)
    keep_freed_memory()  # as `train` does
    loop, bare = (ready(options.scenario, options.recipe) for _ in range(2))
    batch = bare.replay.sample(bare.recipe.batch_size, bare.generator)
    loops = {"loop": loop.step, "bare": lambda: bare.learner.update(batch)}
    rates = in_turns(loops, options.seconds)
    recipe = find_recipe(options.recipe)
    updates = (recipe.steps - recipe.replay_prefill) / recipe.environments
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{rates['loop']:.1f} updates/s, {rates['loop'] / rates['bare']:.2f} of the bare loop's")
    print(f"{recipe.steps:,} steps take {updates / rates['loop'] / 3600:.2f} hours")
    print(f"at most {memory:.0f} MB, with both loops")
