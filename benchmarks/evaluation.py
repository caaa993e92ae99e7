"""Episodes flown a second by each policy on `manhattan`, and the time a genie's plan takes.

    python benchmarks/evaluation.py

All on the same scenarios, one thread; the genie on fewer of them.
"""

import time

import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import fly
from uavdh_lite.planners import Genie, Greedy, Random
from uavdh_lite.streams import Use, stream

if __name__ == "__main__":
    torch.set_num_threads(1)
    agent = load_agent("manhattan")
    environment = Environment(agent.city)
    policies = {
        "random": (Random(0), 1000),
        "greedy": (Greedy(environment), 1000),
        "agent": (agent, 1000),
        "genie, planning once": (Genie(environment, replan=1000), 20),
        "genie, planning every 5 steps": (Genie(environment), 10),
    }
    print(f"{'policy':<32}{'episodes':>9}{'seconds':>9}{'episodes/s':>12}")
    for name, (policy, episodes) in policies.items():
        generator = stream(Use.TEST, 0)
        start = agent.scenario.sample(environment.city, episodes, generator)
        fly(environment, policy, start[:1], stream(Use.TEST, 1))  # fill the caches
        started = time.perf_counter()
        fly(environment, policy, start, generator)
        seconds = time.perf_counter() - started
        print(f"{name:<32}{episodes:>9}{seconds:>9.1f}{episodes / seconds:>12,.1f}")
