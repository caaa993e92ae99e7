"""Agents that learned in 1 to 2000 random cities, flown over those and over others.

    python benchmarks/unseen_cities.py [--jobs 2]

Each learns from reward, with the failsafe and told layers, by the recipe `told` with the one map of
`lite`, since the map in place has no second resolution. There are three seeds for each number of
cities; those for 2000 cities learn with the map in place, too. Writes `data/runs/unseen_cities`;
the runs are kept in `build/`, so one that was stopped goes on.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import joblib
import torch

from uavdh_lite.beyond.recipes import TOLD
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.experiments.runs import train
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.training import trainer_of

OUT = Path("data/runs/unseen_cities")
PARTS = Path("build/unseen_cities")
SEEDS, MANY = (0, 1, 2), "random:2000:0"
ARMS = [("centred", f"random:{count}:0") for count in (1, 10, 100)]
ARMS += [("centred", MANY), ("non_centred", MANY)]
ONE_MAP = {name: getattr(LITE, name) for name in ("kernel_size", "strides", "data_scale")}
RECIPE = replace(TOLD, pooling=0, **ONE_MAP, steps=200_000, validation_interval=50_000)
UNSEEN, MISSIONS, SEED = "random:300:9", 500, 9
METRICS = ("landed", "collected_and_landed", "return", "time_used")


def of_greedy(cities: str) -> dict:
    about = {"policy": "greedy", "learned_in": "", "seed": 0, "steps": 0, "flown_over": cities}
    return flown(Greedy(Environment(load_cities(cities))), about)


def flown(policy: Policy, about: dict) -> dict:
    """A row of the table: what it is about, and the means over the missions."""
    scenario = find_scenario("any_city")
    records = evaluate(policy.made_for(), policy, scenario, MISSIONS, SEED).records()
    return about | {name: records[name].mean() for name in METRICS}


def of_agent(observation: str, learned_in: str, seed: int) -> list[dict]:
    """Two rows of an agent: over the cities in which it learned, and over unseen ones."""
    torch.set_num_threads(1)
    scenario = replace(find_scenario("any_city"), city=learned_in)
    recipe = replace(RECIPE, observation=observation)
    folder = PARTS / f"{observation}-{learned_in.replace(':', '_')}-{seed}"
    agent = load_agent(train(trainer_of(recipe)(scenario, recipe, seed), folder, resume=True))
    about = {"policy": observation, "learned_in": learned_in, "seed": seed}
    about |= {"steps": agent.training["steps"]}
    over = {cities: agent.over(load_cities(cities)) for cities in (learned_in, UNSEEN)}
    return [flown(pilot, about | {"flown_over": cities}) for cities, pilot in over.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=1)
    jobs = parser.parse_args().jobs
    runs = [(*arm, seed) for arm in ARMS for seed in SEEDS]
    parts = joblib.Parallel(jobs, verbose=10)(joblib.delayed(of_agent)(*run) for run in runs)
    rows = [of_greedy(cities) for cities in dict.fromkeys((*(c for _, c in ARMS), UNSEEN))]
    rows += [row for part in parts for row in part]
    write_table(OUT.with_suffix(".csv.gz"), rows)
    about = {"command": "python benchmarks/unseen_cities.py", "recipe": RECIPE.as_json()}
    write_json(OUT.with_suffix(".json"), about | provenance())


if __name__ == "__main__":
    main()
