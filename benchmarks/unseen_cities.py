"""How agents fly over cities that they learned in, and over cities that they never saw.

    python benchmarks/unseen_cities.py RUN... --out data/runs/unseen_cities

RUN is the folder of a training, with `best.safetensors`. Every agent flies the same 500 missions:
over the cities of its own scenario, and over `random:300:9`; by one view of the map, and over the
unseen cities also by the mean of all eight. The greedy planner flies the latter, too.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table

UNSEEN = "random:300:9"
METRICS = ("landed", "collected_and_landed", "return", "time_used")


def row(about: dict, environment: Environment, policy: Policy, cities: str, views: int) -> dict:
    """A policy's means over the missions, after what is known of the policy."""
    scenario = find_scenario("any_city")
    records = evaluate(environment, policy, scenario, episodes=500, seed=9).records()
    means = {name: float(records[name].mean()) for name in METRICS}
    return about | {"flown_over": cities, "views": views} | means


def by_views(agent: Agent, views: int) -> Agent:
    """An agent of one view that flies by this many."""
    recipe = replace(agent.recipe, views=views == 8)
    return replace(agent, network=recipe.flown(agent.network))


def rows(run: Path) -> list[dict]:
    """All flights of a run's agent."""
    agent = load_agent(run / "best.safetensors")
    recipe, learned_in = agent.recipe, agent.scenario.city
    about = {
        "variant": "global_local" if recipe.pooling else recipe.observation,
        "learned_in": learned_in,
        **{name: agent.training[name] for name in ("seed", "steps")},
    }
    made = []
    for cities, views in ((learned_in, 1), (UNSEEN, 1), (UNSEEN, 8)):
        pilot = by_views(agent.over(load_cities(cities)), views)
        made.append(row(about, pilot.environment, pilot, cities, views))
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    unseen = Environment(load_cities(UNSEEN))
    about = {"variant": "greedy", "learned_in": "none", "seed": 0, "steps": 0}
    table = [row(about, unseen, Greedy(unseen), UNSEEN, 1)]
    for run in options.runs:
        table += rows(run)
    write_table(options.out.with_suffix(".csv.gz"), table)
    command = "python benchmarks/unseen_cities.py RUN..."
    write_json(options.out.with_suffix(".json"), {"command": command, **provenance()})
