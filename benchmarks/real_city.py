"""The agent of any city over four real places, in the paper's radio and in a ray-traced one.

    python benchmarks/real_city.py

Greedy, the DDQN agent of Manhattan and `any_city` fly the same missions, all with the failsafe.
What `any_city` is told varies:

- `model`: what the paper's model expects; `nothing`: no data anywhere; `truth`: the world's table.
- `line_N`: a line for links with and one for links without line of sight, fitted to what N earlier
  flights over the same place heard.
- `link_N`: these lines, corrected link by link.

The earlier flights are those of `any_city`, told the model; their missions have other devices. A
seed is one of these surveys and 300 missions. Writes `data/runs/real_city`, a row for each flight.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from uavdh_lite.beyond.measured import (
    MeasuredEnvironment,
    believing,
    expected,
    heard,
    load_place,
    shipped_places,
)
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate, fly
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use, stream

OUT = Path(__file__).parents[1] / "data" / "runs" / "real_city.csv.gz"
MISSIONS, SEEDS = 300, 3
SURVEYS = (1, 10, 100)  # earlier flights
NEARBY_CELLS = 1.0
METRICS = ("landed", "collected_and_landed", "return")


def policies(world: Environment, seed: int) -> Iterator[tuple[str, Policy]]:
    """Who flies, by name; what is told by measurement comes from a survey of this seed."""
    agent = load_agent("any_city").over(world.city)
    yield "greedy", Greedy(world)
    yield "ddqn", load_agent("manhattan_ddqn").over(world.city)
    yield "model", agent
    deaf = np.full((world.size**2,) * 2, -np.inf)
    yield "nothing", believing(agent, MeasuredEnvironment(world.city, mean_snr_db=deaf))
    yield "truth", believing(agent, world)
    generator = stream(Use.BENCHMARK, seed)
    missions = agent.scenario.sample(world, max(SURVEYS), generator)
    for count in SURVEYS:
        found = heard(world, fly(world, agent, missions[:count], generator), generator)
        for name, nearby in (("line", None), ("link", NEARBY_CELLS)):
            yield f"{name}_{count}", believing(agent, expected(agent.environment, found, nearby))


def rows(place: str) -> Iterator[dict]:
    """A row for each flight over a place."""
    traced = load_place(place)
    scenario = load_agent("any_city").scenario
    model = load_agent("any_city").over(traced.city).environment
    for radio, world in (("model", model), ("ray-traced", traced)):
        for seed in range(SEEDS):
            for policy, pilot in policies(world, seed):
                records = evaluate(world, pilot, scenario, MISSIONS, seed).records()
                print(place, radio, seed, policy, records["return"].mean(), file=sys.stderr)
                known = {"place": place, "radio": radio, "policy": policy, "seed": seed}
                for episode in range(MISSIONS):
                    metrics = {name: float(records[name][episode]) for name in METRICS}
                    yield {**known, "episode": episode, **metrics}


if __name__ == "__main__":
    torch.set_num_threads(1)
    write_table(OUT, [row for place in shipped_places() for row in rows(place)])
    about = {"missions": MISSIONS, "seeds": SEEDS, "surveys": SURVEYS, "nearby_cells": NEARBY_CELLS}
    about = {"command": "python benchmarks/real_city.py", **about, **provenance()}
    write_json(OUT.with_name("real_city.json"), about)
