"""Environment steps a second by batch size, and as a ratio to stepping one episode at a time;
then over 1000 cities at once, their tables' time and memory.

    python benchmarks/environment.py

Random actions, new episodes in place of ended ones, up to five devices; `manhattan`, and random
cities of the same size.
"""

import time

import numpy as np

from uavdh_lite.city import Cities, City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream


def steps_per_second(
    batch: int, seconds: float = 2.0, city: City | Cities | None = None, failsafe: bool = False
) -> float:
    scenario = SCENARIOS["manhattan"]
    environment = Environment(City.load(scenario.city) if city is None else city, failsafe=failsafe)
    rewards = Rewards()
    generator = stream(Use.BENCHMARK, 0)
    state = scenario.sample(environment.city, batch, generator)
    environment.transition(state, np.zeros(batch, int), environment.draw_fading(state, generator))
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        action = generator.choice(6, batch, p=[0.22, 0.22, 0.22, 0.22, 0.1, 0.02])
        fading = environment.draw_fading(state, generator)
        state, outcome = environment.transition(state, action, fading)
        rewards(outcome)
        ended = np.flatnonzero(state.ended)
        if len(ended):
            fresh = scenario.sample(environment.city, len(ended), generator)
            state = state.with_rows(ended, fresh)
        steps += batch
    return steps / (time.perf_counter() - started)


if __name__ == "__main__":
    one = steps_per_second(1)
    print(f"{'batch':>6}{'steps/s':>12}{'ratio':>8}")
    for batch in (1, 16, 128, 1024, 4096):
        speed = one if batch == 1 else steps_per_second(batch)
        print(f"{batch:>6}{speed:>12,.0f}{speed / one:>8.0f}")
    started = time.perf_counter()
    cities = CityGenerator().draw(1000, seed=0)
    drawn = time.perf_counter()
    bits, *_ = Environment(cities)._sight_bits
    seconds = time.perf_counter() - drawn
    print(
        f"1000 cities: drawn in {drawn - started:.1f} s, line of sight in {seconds:.1f} s, ", end=""
    )
    print(f"{bits.nbytes / 1e6:.1f} MB")
    for failsafe in (False, True):
        pairs = [
            [steps_per_second(1024, 0.5, city, failsafe) for city in (None, cities)]
            for _ in range(5)
        ]
        shares = [several / single for single, several in pairs]
        label = "with the failsafe" if failsafe else "without"
        print(
            f"1024 episodes {label}: {np.median([p[1] for p in pairs]):,.0f} steps/s, "
            f"{np.median(shares):.2f} of the speed over one city"
        )
