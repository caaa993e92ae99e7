"""Maps built a second, by kind and batch, and as a ratio to a forward pass of `lite`'s
network over centred maps.

    python benchmarks/observation.py

States under way of `manhattan` with up to five devices.
"""

import time

import torch

from uavdh_lite.agent import build
from uavdh_lite.city import City
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.observation import KINDS, Observation
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream


def calls_per_second(action, seconds: float = 1.0) -> float:
    action()
    calls, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        action()
        calls += 1
    return calls / (time.perf_counter() - started)


if __name__ == "__main__":
    keep_freed_memory()  # as `train` does
    torch.set_num_threads(1)
    scenario = SCENARIOS["manhattan"]
    city = City.load(scenario.city)
    print(f"{'kind':<14}{'batch':>6}{'maps/s':>12}{'share of a forward pass':>26}")
    centred, network = build(LITE, city)
    for batch in (128, 1024):
        state = scenario.sample_anywhere(city, batch, stream(Use.BENCHMARK, 0), spare_time=0)
        seen = centred(state)
        with torch.no_grad():
            forward = calls_per_second(lambda: network(*seen))  # noqa: B023 (called at once)
        for kind in KINDS:
            observation = Observation(city, kind)
            maps = calls_per_second(lambda: observation(state))  # noqa: B023
            print(f"{kind:<14}{batch:>6}{maps * batch:>12,.0f}{forward / maps:>26.2f}")
