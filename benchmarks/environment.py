"""Environment steps a second by batch size, and as a ratio to stepping one episode at a time.

    python benchmarks/environment.py

Random actions, new episodes in place of ended ones, `manhattan` with up to five devices.
"""

import time

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.scenario import SCENARIOS
from uavdh_lite.streams import Use, stream


def steps_per_second(batch: int, seconds: float = 2.0) -> float:
    scenario = SCENARIOS["manhattan"]
    environment = Environment(City.load(scenario.city))
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
