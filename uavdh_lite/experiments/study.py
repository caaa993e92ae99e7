"""Studies: the same training with one thing changed, over several seeds, side by side."""

import csv
import json
import os
import re
import secrets
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import torch
from tqdm.auto import tqdm

from uavdh_lite.city import load_cities
from uavdh_lite.config import shown
from uavdh_lite.errors import InputError, extra
from uavdh_lite.experiments.runs import SAVE_SECONDS, SAVED, STUDY, locked, train
from uavdh_lite.experiments.stopping import deferred_stop
from uavdh_lite.recipe import Recipe
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import read_json, read_table, write_json, write_table
from uavdh_lite.training import BIN, trainer_of

# Holds the number of the call whose runs may go on in a study's folder; others save and end
GOING = "going"


def centring(recipe: Recipe) -> dict[str, Recipe]:
    """The paper's ablation: the map centred on the UAV, and the city in place."""
    return {kind: replace(recipe, observation=kind) for kind in ("centred", "non_centred")}


def variants_of(recipe: Recipe, changes: Iterable[str]) -> dict[str, Recipe]:
    """The recipe with each of some changes, by their text.

    A change is `FIELD=VALUE`, or several of these with commas between them. A value is written as
    in JSON, a word without quotes: `observation=non_centred`, or `kernels=8,strides=[3,1]`. The
    text `as_it_is` changes nothing.

    Raises `InputError` for anything else, and for values that the recipe cannot have.
    """
    return {text: _changed(recipe, text) for text in changes}


def changes_of(text: str) -> dict[str, Any]:
    """The fields and values that a variant's text names; a part without `=` is of no field."""
    values: dict[str, Any] = {}
    for part in re.split(r",(?=\w+=)", text) if text != "as_it_is" else ():
        name, equals, written = part.partition("=")
        try:
            values[name if equals else ""] = json.loads(written)
        except (ValueError, RecursionError):
            values[name if equals else ""] = written
    return values


def _changed(recipe: Recipe, text: str) -> Recipe:
    known = {field.name for field in fields(recipe) if "help" in field.metadata}
    values = changes_of(text)
    if not values.keys() <= known:
        raise InputError(
            f"variant {shown(text)}: write FIELD=VALUE, such as leak=0 or layer_norm=false"
        )
    try:
        return replace(recipe, **values)
    except InputError as error:
        raise InputError(f"variant {shown(text)}: {error}") from None


def require_fit(scenario: Scenario, variants: dict[str, Recipe]) -> None:
    """Raise `InputError` that names a variant whose network the scenario's cities do not fit."""
    cities = load_cities(scenario.city)
    for text, recipe in variants.items():
        observation = recipe.observation_for(recipe.environment_for(cities, scenario.channel))
        try:
            with torch.device("meta"):
                recipe.network_for(observation)
        except InputError as error:
            raise InputError(f"variant {shown(text)}: {error}") from None


def run_study(
    scenario: Scenario,
    variants: dict[str, Recipe],
    seeds: int,
    out: str | Path,
    jobs: int = 1,
    command: str = "",
    cluster: str = "",
) -> dict[str, list[Path]]:
    """Train every variant with the seeds 0, 1, …; returns the folders of the runs by variant.

    Each run is one thread in a process of its own, in the folder `out/VARIANT-SEED`. If the call is
    killed, its processes save their runs and end, and the same call continues: finished runs are
    kept, others resume where they were saved. Ctrl-C and SIGTERM do so, too, and then raise
    `KeyboardInterrupt`. On a cluster, the runs of a call that was killed end when the same call
    continues.

    Arguments:
        jobs: runs at a time, on this machine.
        cluster: the address of a Dask cluster's scheduler; then its workers make the runs. They see
            `out` under the same path. If one is lost, another goes on with its run.

    Raises `InputError` for runs that are too short for a curve, for a folder that holds a single
    run or the tables of other runs, or in which another study runs, and for a cluster that cannot
    be reached or whose workers have several threads; `MissingExtra` if Dask is not installed.
    """
    for recipe in variants.values():
        if recipe.steps < BIN:
            raise InputError(f"runs of {recipe.steps} steps: a study's curves need at least {BIN}")
    out = Path(out).absolute()
    if (out / SAVED).exists():
        raise InputError(f"{out}: holds a single run; choose another folder")
    call, grid = _Call(out / GOING), [(name, seed) for seed in range(seeds) for name in variants]
    told = read_json(out / "about.json").get("runs", {}) if (out / "about.json").exists() else {}
    if others := told.keys() - {f"{name}-{seed}" for name, seed in grid}:
        raise InputError(f"{out}: holds a study with {min(others)}, too; choose another folder")
    with locked(out), call.begun(), _workers(cluster, jobs) as parallel, deferred_stop(call.end):
        runs = ((variants[name], seed, out / f"{name}-{seed}") for name, seed in grid)
        done = parallel(joblib.delayed(_run)(scenario, *run, command, call) for run in runs)
        for folder in tqdm(done, total=len(grid), unit="run"):
            if folder is not None:
                tqdm.write(f"finished: {folder}", file=sys.stderr)
        stopped = not call.goes_on()
    if stopped:
        print("stopped; the same command continues", file=sys.stderr)
        raise KeyboardInterrupt
    return {name: [out / f"{name}-{seed}" for seed in range(seeds)] for name in variants}


@contextmanager
def _workers(cluster: str, jobs: int) -> Iterator[joblib.Parallel]:
    """What makes the runs: processes of this machine, or the workers of a cluster."""
    if not cluster:
        yield joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        return
    with extra("cluster"):
        from dask.distributed import Client
    try:
        client = Client(cluster)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler at {cluster} ({error})") from None
    with client, joblib.parallel_config(backend="dask"):
        if any(threads != 1 for threads in client.nthreads().values()):
            raise InputError(f"{cluster}: start its workers with --nthreads 1: a run is a process")
        yield joblib.Parallel(n_jobs=-1)


@dataclass(frozen=True)
class _Call:
    """A call of `run_study`, which its runs ask in their processes whether they may go on."""

    file: Path
    number: str = field(default_factory=lambda: secrets.token_hex(8))
    process: int = field(default_factory=os.getpid)

    @contextmanager
    def begun(self) -> Iterator[None]:
        self.file.write_text(self.number)
        try:
            yield
        finally:
            self.end()

    def end(self) -> None:
        if self.goes_on():
            self.file.unlink(missing_ok=True)

    def goes_on(self) -> bool:
        try:
            return self.file.read_text() == self.number
        except FileNotFoundError:
            return False


def _run(
    scenario: Scenario, recipe: Recipe, seed: int, folder: Path, command: str, call: _Call
) -> Path | None:
    """One training run, from its start or from where it was saved; None if it was stopped.

    It stops when its call does not go on, or when it is in a worker process of the call's own and
    that process is gone, however it ended.
    """
    is_worker = os.getppid() == call.process

    def orphaned() -> bool:
        return is_worker and os.getppid() != call.process

    if not call.goes_on():
        return None
    torch.set_num_threads(1)
    try:
        with locked(folder, SAVE_SECONDS):
            pass  # a run of a call that was killed saves itself and ends
        train(
            trainer_of(recipe)(scenario, recipe, seed),
            folder,
            resume=True,
            command=command,
            show_progress=False,
            stop=lambda: orphaned() or not call.goes_on(),
        )
    except KeyboardInterrupt:
        if orphaned():
            os._exit(130)  # nobody is left to tell, and an idle worker would wait for minutes
        call.end()  # it may have been a Ctrl-C that only this process got
        return None
    return folder


def collect_curves(folders: dict[str, list[Path]], out: Path, command: str) -> tuple[Path, Path]:
    """Write the curves of a finished study as two tables; returns their paths.

    `training.csv.gz` and `validation.csv.gz` have the rows of the runs' own files, with the columns
    `variant` and `seed` in front. `about.json` has the command and each run's `about.json`.
    """
    runs = {folder: name for name, of_variant in folders.items() for folder in of_variant}
    about = {folder: read_json(folder / "about.json") for folder in runs}
    paths = out / STUDY[0], out / STUDY[1]
    for path in paths:
        rows = []
        for folder, name in runs.items():
            with open(folder / path.stem, newline="") as file:
                first = {"variant": name, "seed": about[folder]["seed"]}
                rows += [first | row for row in csv.DictReader(file)]
        write_table(path, rows)
    write_json(
        out / "about.json",
        {"command": command, "runs": {folder.name: how for folder, how in about.items()}},
    )
    return paths


def final_scores(validation: str | Path) -> dict[str, list[float]]:
    """Collected and landed at the end of each run, by variant, in the order of the seeds.

    Arguments:
        validation: the table `validation.csv.gz` of `collect_curves`.
    """
    table, scores = read_table(validation), {}
    for variant in dict.fromkeys(table["variant"].tolist()):
        own = table["variant"] == variant
        seeds = np.unique(table["seed"][own])
        runs = [np.flatnonzero(own & (table["seed"] == seed)) for seed in seeds]
        scores[variant] = [float(table["collected_and_landed"][run[-1]]) for run in runs]
    return scores
