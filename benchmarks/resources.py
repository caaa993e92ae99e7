"""What a training takes: minutes, memory and size of the checkpoint, by city and recipe.

    python benchmarks/resources.py [--threads 2] [--seconds 20]

Each row is a process of its own that trains for some seconds after the prefill. Its minutes are
those of the whole recipe at that speed, validations included; its memory is the most that the
process held. Cities past 16×16 get global and local maps. Prints a Markdown table.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

ROWS = [("village", "small"), ("manhattan", "lite"), ("manhattan", "paper")]
ROWS += [("harbour", "lite"), ("metropolis", "lite")]


def measure(scenario_name: str, recipe_name: str, threads: int, seconds: float) -> dict:
    """Train in this process; returns the figures."""
    import torch

    from uavdh_lite.checkpoint import save_agent
    from uavdh_lite.city import City
    from uavdh_lite.experiments.runs import keep_freed_memory
    from uavdh_lite.recipe import find_recipe
    from uavdh_lite.scenario import find_scenario
    from uavdh_lite.training import OverlappedTrainer, Trainer

    torch.set_num_threads(1)
    keep_freed_memory()
    scenario, recipe = find_scenario(scenario_name), find_recipe(recipe_name)
    if City.load(scenario.city).size > 16:
        recipe = replace(recipe, observation="global_local")
    trainer = (OverlappedTrainer if threads == 2 else Trainer)(scenario, recipe, seed=0)
    while trainer.updates < 20:
        trainer.step()
    updates, started = trainer.updates, time.perf_counter()
    while time.perf_counter() - started < seconds:
        trainer.step()
    rate = (trainer.updates - updates) / (time.perf_counter() - started)
    started = time.perf_counter()
    trainer.validate()
    validation = time.perf_counter() - started
    whole = (recipe.steps - recipe.replay_prefill) / recipe.environments
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "agent.safetensors")
        save_agent(path, trainer.agent)
        size = path.stat().st_size
    return {
        "city": f"`{trainer.city.name}`, {trainer.city.size}×{trainer.city.size}",
        "recipe": f"`{recipe_name}`" + ("" if trainer.city.size <= 16 else ", global-local"),
        "updates_per_second": rate,
        "minutes": (whole / rate + validation * recipe.steps / recipe.validation_interval) / 60,
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "checkpoint_mb": size / 1e6,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, choices=(1, 2), default=2)
    parser.add_argument("--seconds", type=float, default=20, help="of training, a row")
    parser.add_argument("--row", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        print(json.dumps(measure(*options.row, options.threads, options.seconds)))
        return
    cores = f"{os.cpu_count()}-core {platform.machine()}, {platform.system()}"
    print(f"{cores}, {options.threads} thread(s)\n")
    print("| city | recipe | updates/s | whole training | memory | checkpoint |")
    print("| --- | --- | --- | --- | --- | --- |")
    for row in ROWS:
        command = [sys.executable, __file__, "--threads", str(options.threads)]
        command += ["--seconds", str(options.seconds), "--row", *row]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        one = json.loads(done.stdout)
        minutes = one["minutes"]
        whole = f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.0f} h"
        print(
            f"| {one['city']} | {one['recipe']} | {one['updates_per_second']:.1f} | {whole} | "
            f"{one['memory_mb']:.0f} MB | {one['checkpoint_mb']:.1f} MB |",
            flush=True,
        )


if __name__ == "__main__":
    main()
