"""The agent of any city over four real places, in the paper's radio and in a ray-traced one.

    python benchmarks/real_city.py

Greedy, the DDQN agent of Manhattan and `any_city` fly the same missions, all with the failsafe.
What `any_city` is told varies:

- `model`: what the paper's model expects; `nothing`: no data anywhere; `truth`: the world's table.
- `line_N`: a line for links with and one for links without line of sight, fitted to what N earlier
  flights over the same place heard.
- `link_N`: these lines, corrected link by link.

The earlier flights are those of `any_city`, told the model; their missions have other devices. A
seed is one of these surveys and 300 missions. Writes `data/runs/real_city`, a row for each flight,
and `data/places/NAME.json`, the places for the labs.
"""

import base64
import json
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
    load_gains,
    load_place,
    shipped_places,
)
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Policy, evaluate, fly
from uavdh_lite.planners import Greedy
from uavdh_lite.provenance import provenance
from uavdh_lite.storage import data_folder, write_json, write_table
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
                for episode in range(MISSIONS):
                    metrics = {name: float(records[name][episode]) for name in METRICS}
                    known = {"place": place, "radio": radio, "policy": policy, "seed": seed}
                    yield {**known, "episode": episode, **metrics}


def write_for_labs(place: str) -> None:
    """The city, its gains in half decibels below 0 dB, and what makes SNRs of them."""
    world = load_place(place)
    path = data_folder() / "places" / f"{place}.npz"
    gain_db, about = load_gains(path)
    heard_at = np.isfinite(gain_db)
    level_db = float((world.mean_snr_db - np.where(heard_at, gain_db, 0))[heard_at].mean())
    halves = np.where(heard_at, -2 * np.where(heard_at, gain_db, 0), 255)
    values = {
        "format": "uavdh_lite place",
        "version": 1,
        "name": place,
        "source": "Sionna RT's scenes, made with data of OpenStreetMap",
        "licence": "© OpenStreetMap contributors, ODbL, https://www.openstreetmap.org/copyright",
        "about": about,
        "rows": world.cities[0].text.split(),
        "level_db": round(level_db, 4),
        "gain": base64.b64encode(halves.clip(0, 255).astype(np.uint8).tobytes()).decode(),
    }
    write_json(path.with_suffix(".json"), values)


if __name__ == "__main__":
    torch.set_num_threads(1)
    for place in shipped_places():
        write_for_labs(place)
    write_table(OUT, [row for place in shipped_places() for row in rows(place)])
    about = {
        "command": "python benchmarks/real_city.py",
        "missions": MISSIONS,
        "seeds": SEEDS,
        "surveys": SURVEYS,
        "nearby_cells": NEARBY_CELLS,
        "rays": {
            place: load_gains(data_folder() / "places" / f"{place}.npz")[1]["rays"]
            for place in shipped_places()
        },
        **provenance(),
    }
    write_json(OUT.with_name("real_city.json"), json.loads(json.dumps(about)))
