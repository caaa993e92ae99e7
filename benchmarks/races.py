"""Record the trainings that the labs' *Watch it learn* shows: four settings of one recipe.

    python benchmarks/races.py

Writes `data/races/races.json` and, for each point of each run, its agent in half precision. At a
point the agent flies 100 missions that it does not learn from.
"""

import argparse
import copy
import time
from dataclasses import asdict, replace
from pathlib import Path

import torch

from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.checkpoint import save_agent
from uavdh_lite.evaluation import evaluate
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json
from uavdh_lite.streams import Use
from uavdh_lite.training import Trainer

# `lite` for a village and half a minute
QUICK = replace(
    LITE,
    name="quick",
    steps=48_000,
    kernels=8,
    kernel_size=3,
    strides=(2, 2),
    hidden=(128, 128),
    learning_rate=2e-3,
    batch_size=64,
    environments=16,
    replay_capacity=40_000,
    replay_prefill=2_000,
    temperature=1.0,
    crash_reward=-5.0,
    crash_reward_end=-20.0,
    crash_reward_growth=0.75,
    validation_interval=8_000,
    validation_episodes=200,
)
CITY = "village"
EPISODES = 100  # missions of a point
POINTS = (0, 3_000, 6_000, 9_000, 12_000, 18_000, 24_000, 32_000, 40_000, 48_000)
METRICS = ("landed", "collected", "collected_and_landed", "return", "time_used")
SETTINGS = {  # title, what it is, changes of the recipe
    "small": (
        "the usual recipe",
        "Crashing costs 5 at first and 20 at the end, so that it dares to explore.",
        {},
    ),
    "no_fear": (
        "no fear of crashing",
        "A crash costs nothing. Will it come home?",
        {"crash_reward": 0.0, "crash_reward_end": None},
    ),
    "fear": (
        "−150 from the start",
        "A crash costs 150 from the first step on. Will it dare to leave?",
        {"crash_reward": -150.0, "crash_reward_end": None},
    ),
    "failsafe": (
        "failsafe",
        "Actions after which the way home is too long are not allowed: it need not learn to land.",
        {"failsafe": True, "exploring_starts": 0.0},
    ),
}


def record(name: str, seed: int, folder: Path) -> dict:
    """Train with one setting; returns what `races.json` holds of it."""
    title, text, changes = SETTINGS[name]
    recipe = replace(BeyondRecipe(**asdict(QUICK)), **changes)
    trainer = Trainer(find_scenario(CITY), recipe, seed)
    points, begin = [], time.perf_counter()
    for steps in POINTS:
        while trainer.steps < steps:
            trainer.step()
        file = f"{name}-{steps}.safetensors"
        network = copy.deepcopy(trainer.agent.network).half().float()  # as it is saved and shown
        agent = replace(trainer.agent, network=network)
        flights = evaluate(agent.environment, agent, agent.scenario, EPISODES, 0, Use.VALIDATION)
        records = flights.records()
        point = {metric: round(float(records[metric].mean()), 4) for metric in METRICS}
        points.append({"steps": trainer.steps, **point, "agent": file})
        save_agent(folder / file, replace(agent, network=copy.deepcopy(network).half()))
        print(f"{name:<10}{trainer.steps:>8,} steps", *(f"{m} {v:.2f}" for m, v in point.items()))
    seconds = round(time.perf_counter() - begin)
    told = {"name": name, "title": title, "text": text, "seed": seed, "seconds": seconds}
    return {**told, "changes": changes, "steps": trainer.steps, "points": points}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1)  # untrained, that of 0 hovers, then lands
    parser.add_argument("--out", type=Path, default=Path("data/races"))
    given = parser.parse_args()
    torch.set_num_threads(1)
    settings = [record(name, given.seed, given.out) for name in SETTINGS]
    about = {"city": CITY, "episodes": EPISODES, **provenance(), "settings": settings}
    write_json(given.out / "races.json", about)


if __name__ == "__main__":
    main()
