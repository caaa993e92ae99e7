"""Shipped agents against greedy and genie on missions that were used nowhere else.

    python benchmarks/fresh_missions.py manhattan open_field harbour any_city any_city:village

An argument is an agent, or an agent and a city with a colon between.

Each agent flies 3000 missions of a seed of its own in pairs with greedy, and fewer, which are drawn
separately, in pairs with the genie, which takes seconds for a mission over a large city. One row an
agent goes to data/runs/fresh_missions.csv.gz: means, and differences and shares with their 95 %
intervals. Over many cities the intervals draw whole cities again.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, evaluate, paired_interval
from uavdh_lite.experiments.comparison import share
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.storage import write_json, write_table

OUT = Path(__file__).parents[1] / "data" / "runs" / "fresh_missions.csv.gz"
EPISODES, SEED = 3000, 41_000
WITH_GENIE = {16: 1000, 32: 300, 50: 60}  # missions, by the city's size
METRICS = {"collected_and_landed": 100, "return": 1}  # and the factor of a difference
UNSEEN = "random:300:41"  # for the agent of many cities


def straight_home(flights: Flights, environment: Environment) -> float:
    """The share of landed flights with at most two steps more than the way home after the last
    upload takes."""
    uploads = np.array([step.outcome.uploaded.any(axis=1) for step in flights.history])
    number = np.arange(1, len(uploads) + 1)[:, None]
    last = (number * uploads).max(axis=0)
    cells = np.array([*(step.state.uav_cell for step in flights.history), flights.end.uav_cell])
    here = cells[last, np.arange(len(last))]
    extra = flights.steps - last - environment.time_to_land[flights.start.city, here]
    return float((extra[flights.end.landed] <= 2).mean())


def row(name: str) -> dict:
    """What an agent does over a city, next to greedy and genie."""
    agent, _, city = name.partition(":")
    agent = load_agent(agent)
    usual = UNSEEN if len(agent.cities) > 1 else agent.scenario.city
    agent = agent.over(load_cities(city or usual))
    environment, scenario = agent.environment, agent.scenario
    fly = lambda policy, count: evaluate(environment, policy, scenario, count, SEED)  # noqa: E731
    mine, greedy = fly(agent, EPISODES), fly(Greedy(environment), EPISODES)
    ours, theirs = mine.records(), greedy.records()
    found = {"agent": name, "missions": EPISODES, "landed": ours["landed"].mean()}
    found["straight_home"] = straight_home(mine, environment)
    found["time_used"] = ours["time_used"].mean()
    count = WITH_GENIE[max(16, environment.size)]
    genie, again = (fly(policy, count) for policy in (Genie(environment), agent))
    for metric, factor in METRICS.items():
        found[metric], found[f"{metric}_of_greedy"] = ours[metric].mean(), theirs[metric].mean()
        lead = factor * (ours[metric] - theirs[metric])
        ahead = paired_interval(lead, mine.start.city)
        part = share(again.records()[metric], genie.records()[metric], again.start.city)
        for what, interval in (("ahead", ahead), ("share", part)):
            names = (f"{metric}_{what}{end}" for end in ("", "_low", "_high"))
            found |= dict(zip(names, interval, strict=True))
    return {**found, "missions_with_genie": count}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("agents", nargs="+")
    torch.set_num_threads(1)
    names = parser.parse_args().agents
    write_table(OUT, [row(name) for name in names])
    command = f"python benchmarks/fresh_missions.py {' '.join(names)}"
    about = {"command": command, "seed": SEED, **provenance()}
    write_json(OUT.with_name("fresh_missions.json"), about)
