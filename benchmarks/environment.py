"""Steps of the simulator a second, and the seconds that the tables of a city take.

    python benchmarks/environment.py

Random actions over `manhattan`, new missions in place of ended ones; then the same over 1000 random
cities of that size.
"""

import time

import numpy as np

from uavdh_lite.city import City, load_cities, load_city
from uavdh_lite.environment import Environment
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream

SCENARIO = find_scenario("manhattan")


def steps_per_second(environment: Environment, batch: int, seconds: float = 2.0) -> float:
    """Steps of all episodes together."""
    generator = stream(Use.BENCHMARK)
    state = SCENARIO.sample(environment, batch, generator)
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        action = generator.choice(6, batch, p=[0.22, 0.22, 0.22, 0.22, 0.1, 0.02])
        state, _ = environment.step(state, action, generator)
        ended = np.flatnonzero(state.ended)
        if len(ended):
            state = state.with_rows(ended, SCENARIO.sample(environment, len(ended), generator))
        steps += batch
    return steps / (time.perf_counter() - started)


def made(cities: City | tuple[City, ...], name: str) -> Environment:
    """The environment; prints the seconds until its first step is done."""
    started = time.perf_counter()
    environment = Environment(cities)
    steps_per_second(environment, 1, seconds=0.001)
    print(f"{name}: made in {time.perf_counter() - started:.2f} s", flush=True)
    return environment


if __name__ == "__main__":
    one_city = made(load_city("manhattan"), "manhattan, 16 cells on a side")
    made(load_city("metropolis"), "metropolis, 50")
    many = made(load_cities("random:1000:0"), "1000 random cities, 16")
    for batch in (1, 32, 1024):
        print(f"{batch} episodes at a time: {steps_per_second(one_city, batch):,.0f} steps/s")
    print(f"1024 over 1000 cities: {steps_per_second(many, 1024):,.0f} steps/s")
