"""Missions a minute that greedy and genie fly in the shipped cities, and how good a genie is.

    python benchmarks/planners.py [--missions 20]
    python benchmarks/planners.py --convergence harbour [--missions 20]

The first prints the processor time of one core, without that for the tables of the city, which are
made once. The second flies the same missions with genies of different beams and replanning
intervals. Missions and fading have seed 1000.
"""

import argparse
import time

from uavdh_lite.city_generator import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, Policy, evaluate
from uavdh_lite.planners import Genie, Greedy
from uavdh_lite.scenario import SCENARIOS, Scenario

SEED = 1000
GENIES = {
    "beam 1": {"beam": 1, "grow": False},
    "beam 2": {"beam": 2, "grow": False},
    "beam 8": {"beam": 8, "grow": False},
    "replan 1": {"replan": 1},
    "replan 5": {},
    "replan 20": {"replan": 20},
    "one plan": {"replan": 2**15},
}


def timed(
    environment: Environment, policy: Policy, scenario: Scenario, missions: int
) -> tuple[Flights, float]:
    """The flights, and the missions flown in a minute of processor time."""
    evaluate(environment, policy, scenario, 1, SEED)  # fill the caches
    started = time.process_time()
    flights = evaluate(environment, policy, scenario, missions, SEED)
    return flights, 60 * missions / (time.process_time() - started)


def speed(missions: int) -> None:
    print(f"{'city':<12}{'size':>5}{'devices':>9}{'greedy a minute':>17}{'genie a minute':>16}")
    for name, scenario in SCENARIOS.items():
        environment = Environment(load_city(scenario.city))
        _, greedy = timed(environment, Greedy(environment), scenario, 50 * missions)
        _, genie = timed(environment, Genie(environment), scenario, missions)
        devices = "{}-{}".format(*scenario.devices)
        size = environment.cities.size
        print(f"{name:<12}{size:>5}{devices:>9}{greedy:>17,.0f}{genie:>16,.0f}", flush=True)


def convergence(name: str, missions: int) -> None:
    scenario = SCENARIOS[name]
    environment = Environment(load_city(scenario.city))
    print(f"{name:<12}{'CRAL':>8}{'return':>9}{'missions a minute':>19}")
    for label, options in GENIES.items():
        flights, rate = timed(environment, Genie(environment, **options), scenario, missions)
        cral = flights.records()["collection_ratio_and_landed"].mean()
        returned = flights.cumulative_reward.mean()
        print(f"{label:<12}{cral:>8.4f}{returned:>9.3f}{rate:>19,.0f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--missions", type=int, default=20)
    parser.add_argument("--convergence", choices=SCENARIOS)
    arguments = parser.parse_args()
    if arguments.convergence:
        convergence(arguments.convergence, arguments.missions)
    else:
        speed(arguments.missions)
