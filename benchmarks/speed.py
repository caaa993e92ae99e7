"""How fast simulator, training loop and planners are on one core of this machine.

python benchmarks/speed.py [--scenario manhattan] [--recipe lite] [--seconds 10] [--missions 20]
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import torch

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import Trainer


def rate(call: Callable[[], object], seconds: float) -> float:
    """Calls a second."""
    calls, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        call()
        calls += 1
    return calls / (time.perf_counter() - started)


def steps(environment: Environment, scenario: Scenario, batch: int, seconds: float) -> float:
    """Steps a second of all episodes together, with new missions in place of ended ones."""
    generator = stream(Use.BENCHMARK)
    state = scenario.sample(environment, batch, generator)

    def step() -> None:
        nonlocal state
        action = generator.choice(6, batch, p=[0.22, 0.22, 0.22, 0.22, 0.1, 0.02])
        state, _ = environment.step(state, action, generator)
        if ended := state.ended.sum():
            state = state.with_rows(state.ended, scenario.sample(environment, ended, generator))

    return batch * rate(step, seconds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="manhattan")
    parser.add_argument("--recipe", default="lite")
    parser.add_argument("--seconds", type=float, default=10, help="of each measurement")
    parser.add_argument("--missions", type=int, default=20, help="that each policy flies")
    options = parser.parse_args()
    torch.set_num_threads(1)
    keep_freed_memory()  # as `train` does
    scenario, environment = find_scenario(options.scenario), environment_of(options.scenario)
    for batch in (1, 32, 1024):
        found = steps(environment, scenario, batch, options.seconds)
        print(f"{batch} episodes at a time: {found:,.0f} steps/s", flush=True)

    recipe = find_recipe(options.recipe)
    trainer = Trainer(scenario, replace(recipe, replay_prefill=2_000), seed=0)
    while not trainer.updates:
        trainer.step()
    found, each = rate(trainer.step, options.seconds), recipe.environments
    hours = (recipe.steps - recipe.replay_prefill) / each / found / 3600
    print(f"{recipe.name}: {found:.1f} updates/s, {recipe.steps:,} steps take {hours:.2f} hours")

    policies: dict[str, Policy] = {"random": Random(), "greedy": Greedy(environment)}
    if options.scenario in shipped_agents():
        policies["agent"] = load_agent(options.scenario)
    policies["genie"] = Genie(environment)
    for name, policy in policies.items():
        evaluate(environment, policy, scenario, 1, seed=1000)  # what is made once
        started = time.perf_counter()
        evaluate(environment, policy, scenario, options.missions, seed=1000)
        found = 60 * options.missions / (time.perf_counter() - started)
        print(f"{name}: {found:,.0f} missions a minute", flush=True)
