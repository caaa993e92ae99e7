"""How agents fly over cities that they learned in, and over cities that they never saw.

    python benchmarks/unseen_cities.py RUN... --out data/runs/unseen_cities

RUN is the folder of a training, with `best.safetensors`. Every agent flies the same missions: over
the cities of its own scenario, and over `random:300:9`; by one view of the map, and over the unseen
cities also by the mean of all eight. The greedy planner flies the missions over the unseen cities,
too. Writes a CSV table with a row for each, and JSON beside it.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city_generator import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.storage import write_json, write_table

UNSEEN = "random:300:9"
METRICS = ("has_landed", "collection_ratio_and_landed", "cumulative_reward", "time_used")

city_of = cache(load_city)


def row(about: dict, policy, cities: str, views: int, episodes: int, seed: int) -> dict:
    """A policy's means over the test missions of a seed, after what is known of the policy."""
    environment = Environment(city_of(cities))
    scenario = SCENARIOS["any_city"]
    records = evaluate(environment, policy(environment), scenario, episodes, seed).records()
    means = {name: float(records[name].mean()) for name in METRICS}
    return about | {"flown_over": cities, "views": views} | means


def rows(run: Path, episodes: int, seed: int) -> list[dict]:
    """All flights of a run's agent."""
    torch.set_num_threads(1)
    agent = load_agent(run / "best.safetensors")
    learned_in = agent.scenario.city
    about = {
        "run": run.name,
        "observation": agent.recipe.observation,
        "learned_in": learned_in,
        "seed": agent.training["seed"],
        "steps": agent.training["steps"],
    }

    def over(views):
        return lambda environment: replace(agent.over(environment.city), symmetric=views == 8)

    flights = [(learned_in, 1), (UNSEEN, 1), (UNSEEN, 8)]
    made = [row(about, over(v), cities, v, episodes, seed) for cities, v in flights]
    print(
        *(f"{m['flown_over']} {m['views']} {m[METRICS[1]]:.3f}" for m in made), run.name, flush=True
    )
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    fly = partial(rows, episodes=arguments.episodes, seed=arguments.seed)
    about = {"run": "greedy", "observation": "none", "learned_in": "none", "seed": 0, "steps": 0}
    table = [row(about, Greedy, UNSEEN, 1, arguments.episodes, arguments.seed)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for of_run in pool.map(fly, arguments.runs):
            table += of_run
    write_table(arguments.out.with_suffix(".csv.gz"), table)
    options = f"--episodes {arguments.episodes} --seed {arguments.seed}"
    command = f"python benchmarks/unseen_cities.py RUN... {options}"
    write_json(arguments.out.with_suffix(".json"), {"command": command, **provenance()})


if __name__ == "__main__":
    main()
