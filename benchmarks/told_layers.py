"""Which of the told layers pay: copying the genie with each of them, with all, and with others.

    python benchmarks/told_layers.py

A variant is the recipe `imitation` over `manhattan`, 80,000 labels with 16 kernels, that sees other
layers. The others that are tried:

- `spare_time`: what is left of the flying time after the way to the cell and from there home.
- `sum_of_data`: the expected data is summed over the devices, instead of the largest one.
- `shadows`: from how many of the devices with data left the cell is hidden.

Three seeds each. Writes `data/runs/told_layers-manhattan`; finished runs are kept in `build/`, so a
run that was stopped goes on.
"""

import json
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from uavdh_lite.beyond.recipes import IMITATION, ImitationRecipe, SafeToldObservation
from uavdh_lite.environment import Environment, State
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.observation import Observation
from uavdh_lite.provenance import provenance
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.training import trainer_of

OUT = Path("data/runs/told_layers-manhattan")
PARTS = Path("build/told_layers")
ALL = ("expected_data", "way_home", "way_there")
VARIANTS: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "expected_data": ("expected_data",),
    "way_home": ("way_home",),
    "way_there": ("way_there",),
    "all_three": ALL,
    "all_and_spare_time": (*ALL, "spare_time"),
    "all_and_shadows": (*ALL, "shadows"),
    "sum_of_data": ("sum_of_data", *ALL[1:]),
}
SEEDS = 3


class Seen(SafeToldObservation):
    """Tells the layers of one variant."""

    def told(self, state: State) -> Tensor:
        home, there = super().told(state)[:, 1:].unbind(1)
        values = {"way_home": home, "way_there": there}
        time_left = self._tensor(state.time_left).float()[:, None]
        moves = (2 - home - there) * self._farthest
        values["spare_time"] = ((time_left - moves - 1) / self.time_scale).clamp(-1, 3)
        values["expected_data"] = self.expected_data(state) / self.data_scale
        first = state.city.astype(int)[:, None] * self.environment.size**2
        rows, left = self._tensor(first + state.device_cells), self._tensor(state.data_left)
        offered = self._data[rows].minimum(left[..., None])  # (B, K, n)
        values["sum_of_data"] = offered.sum(1) / self.data_scale
        sight = self._tensor(self.environment.sight[state.city[:, None], state.device_cells])
        values["shadows"] = (~sight & (left > 0)[..., None]).float().mean(1)
        return torch.stack([values[name] for name in self.layers], dim=1)


@dataclass(frozen=True)
class Variant(ImitationRecipe):
    """The recipe `imitation` that sees a variant's layers."""

    variant: str = "all_three"

    def observation_for(self, environment: Environment, size: int = 0) -> Observation:
        if self.variant == "nothing":
            return super().observation_for(environment, size)
        seen = type("Seen", (Seen,), {"layers": VARIANTS[self.variant]})
        return seen(environment, self.observation, self.data_scale, self.time_scale, size)


def run(variant: str, seed: int) -> dict:
    """One training; its last validation."""
    part = PARTS / f"{variant}-{seed}.json"
    if part.exists():
        return json.loads(part.read_text())
    recipe = Variant(**asdict(IMITATION), variant=variant)
    recipe = replace(recipe, steps=80_000, kernels=16, told=variant != "nothing")
    started = time.perf_counter()
    trainer = trainer_of(IMITATION)(find_scenario("manhattan"), recipe, seed)
    while not trainer.finished:
        trainer.step()
    seconds = time.perf_counter() - started
    trainer.validate()
    last = trainer.validation_rows[-1]
    metrics = ("landed", "collected_and_landed", "return", "time_used")
    row = {"variant": variant, "seed": seed, "steps": trainer.steps, "seconds": round(seconds, 1)}
    row |= {name: last[name] for name in metrics}
    write_json(part, row)
    print(row, file=sys.stderr, flush=True)
    return row


if __name__ == "__main__":
    torch.set_num_threads(1)
    keep_freed_memory()
    rows = [run(variant, seed) for seed in range(SEEDS) for variant in VARIANTS]
    write_table(OUT.with_suffix(".csv.gz"), rows)
    about = {"command": "python benchmarks/told_layers.py", "layers": VARIANTS, **provenance()}
    write_json(OUT.with_suffix(".json"), about)
