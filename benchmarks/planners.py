"""Missions a minute of each policy over a city, and what they collect.

    python benchmarks/planners.py [--city manhattan] [--missions 20] [--beam 8]

The minutes are processor time of one core. With `--beam` the genie searches with this beam alone;
by default it begins with 2 and widens it where that finds a better flight. Missions and fading have
seed 1000.
"""

import argparse
import time

import torch

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import load_city, shipped_cities
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.scenario import find_scenario

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--city", choices=shipped_cities(), default="manhattan")
    parser.add_argument("--missions", type=int, default=20)
    parser.add_argument("--beam", type=int, help="of the genie")
    options = parser.parse_args()
    torch.set_num_threads(1)
    scenario, environment = find_scenario(options.city), Environment(load_city(options.city))
    beam = {"beam": options.beam, "grow": False} if options.beam else {}
    policies: dict[str, Policy] = {"random": Random(), "greedy": Greedy(environment)}
    if options.city in shipped_agents():
        policies["agent"] = load_agent(options.city)
    policies["genie"] = Genie(environment, **beam)
    print(f"{'':<8}{'collected and landed':>22}{'return':>9}{'missions a minute':>19}")
    for name, policy in policies.items():
        evaluate(environment, policy, scenario, 1, seed=1000)  # what is made once
        started = time.process_time()
        flights = evaluate(environment, policy, scenario, options.missions, seed=1000)
        rate = 60 * options.missions / (time.process_time() - started)
        score = flights.records()["collected_and_landed"].mean()
        print(f"{name:<8}{score:>22.4f}{flights.returns.mean():>9.3f}{rate:>19,.0f}", flush=True)
