"""How much each recipe collects after how many minutes on one core: data/figures/minutes.png.

    python benchmarks/minutes.py [--seconds 60] [--out data/figures/minutes.png]

Each point is the end of a recorded run over `manhattan` that was made for this length. The steps a
second of both recipes are measured here, in turns, so that a noisy machine disturbs both alike;
the minutes are the steps by that speed, without validations.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import torch
from matplotlib.figure import Figure

from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.storage import read_table, write_atomically
from uavdh_lite.streams import Use
from uavdh_lite.training import VALIDATION_SEED, Trainer

RUNS = Path(__file__).parents[1] / "data" / "runs"
CRAL = "collection_ratio_and_landed"
STUDIED = {  # by recipe: studies, and the variant that is the recipe as it is
    "lite": [
        ("parts-manhattan", "none"),
        ("deviations-manhattan", "all"),
        ("in_20_minutes", "manhattan-2500000"),
    ],
    "quantile": [
        ("values-manhattan-30000", "8_quantiles"),
        ("values-manhattan-100000", "8_quantiles"),
        ("in_minutes-manhattan", "210000_steps"),
        ("in_minutes-manhattan", "850000_steps"),
    ],
}


def ends(recipe: str) -> np.ndarray:
    """Steps and CRAL in the last validation of each run, (runs, 2)."""
    points = []
    for folder, variant in STUDIED[recipe]:
        table = read_table(RUNS / folder / "validation.csv.gz")
        for seed in np.unique(table["seed"][table["variant"] == variant]):
            run = (table["variant"] == variant) & (table["seed"] == seed)
            points.append([table["steps"][run][-1], table[CRAL][run][-1]])
    return np.array(points)


def speeds(recipes: list[str], seconds: int) -> dict[str, float]:
    """Environment steps a second of each recipe, on one thread."""
    runs, steps = {}, dict.fromkeys(recipes, 0)
    for name in recipes:
        recipe = replace(find_recipe(name), replay_prefill=2_000)
        runs[name] = Trainer(SCENARIOS["manhattan"], recipe, seed=0)
        while not runs[name].updates:
            runs[name].step()
    for _ in range(seconds):
        for name, run in runs.items():
            before, started = run.steps, time.perf_counter()
            while time.perf_counter() - started < 1:
                run.step()
            steps[name] += run.steps - before
    return {name: count / seconds for name, count in steps.items()}


def greedy_cral() -> float:
    """Greedy in the missions of the validations."""
    environment = environment_of("manhattan")
    flown = evaluate(
        environment,
        Greedy(environment),
        SCENARIOS["manhattan"],
        find_recipe("lite").validation_episodes,
        VALIDATION_SEED,
        Use.VALIDATION,
    )
    return float(flown.records()[CRAL].mean())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="to measure each recipe's speed")
    parser.add_argument("--out", type=Path, default=RUNS.parent / "figures" / "minutes.png")
    options = parser.parse_args()
    matplotlib.use("Agg")
    torch.set_num_threads(1)
    keep_freed_memory()  # as `train` does
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    ax = figure.subplots()
    named = {"quantile": ("recipe quantile", BLUE, "o"), "lite": ("recipe lite", VERMILION, "s")}
    for name, speed in speeds(list(STUDIED), options.seconds).items():
        points = ends(name)
        label, colour, marker = named[name]
        minutes = points[:, 0] / speed / 60
        lengths = np.unique(minutes)
        means = [points[minutes == length, 1].mean() for length in lengths]
        ax.plot(lengths, means, color=colour, lw=1, label=label)
        ax.plot(minutes, points[:, 1], marker, color=colour, markersize=5, alpha=0.7)
        print(f"{name}: {speed:.0f} steps/s")
        for length in lengths:
            scores = np.sort(points[minutes == length, 1])
            print(f"  {length:5.1f} minutes  CRAL", *(f"{score:.3f}" for score in scores))
    greedy = greedy_cral()
    print(f"greedy: CRAL {greedy:.3f}")
    ax.axhline(greedy, color="grey", ls="--", lw=1, label="greedy rule")
    ax.set(xscale="log", xlabel="minutes on one core", ylabel="collected and landed")
    ticks = [1, 2, 5, 10, 20, 50]
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_ylim(0.15, 1)
    ax.legend(loc="lower right")
    write_atomically(options.out, lambda path: figure.savefig(path, format="png", dpi=150))
