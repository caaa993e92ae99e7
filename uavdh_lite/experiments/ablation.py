"""Ablations: the same training with one thing changed, over several seeds, side by side."""

import csv
import json
import sys
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import joblib
import torch
from tqdm.auto import tqdm

from uavdh_lite.errors import InputError, extra
from uavdh_lite.experiments.runs import SAVED, train
from uavdh_lite.recipe import LITE, PAPER, Recipe
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import read_table, write_json, write_table
from uavdh_lite.training import BIN, Trainer

# Where `lite` departs from `paper`, in groups that only make sense together. Strides and
# environments are not here: with the paper's, as many steps would take hours.
DEVIATIONS = {
    "input_scales": ("data_scale", "time_scale"),
    "layer_norm": ("layer_norm",),
    "leaky_relus": ("leak",),
    "return_steps": ("return_steps",),
    "learning_rate": ("learning_rate", "learning_rate_end"),
    "huber_loss": ("huber_delta",),
    "replay": ("replay_capacity", "replay_prefill"),
    "temperature": ("temperature",),
    "crash_reward": ("crash_reward", "crash_reward_end"),
    "movement_reward": ("movement_reward",),
    "exploring_starts": ("exploring_starts",),
}

# What `quantile` adds to `lite`. Without the failsafe, crashes must be learned from again.
PARTS = {
    "failsafe": ("failsafe", "crash_reward", "exploring_starts"),
    "quantiles": ("quantiles", "huber_delta"),
    "advantage_learning": ("advantage_learning",),
    "two_resolutions": (
        "observation",
        "pooling",
        "local_size",
        "data_scale",
        "kernel_size",
        "strides",
    ),
    "discount": ("discount",),
}

# Other values than those of `quantile`, one at a time.
VALUES: dict[str, dict[str, Any]] = {
    "8_quantiles": {"quantiles": 8},
    "32_quantiles": {"quantiles": 32},
    "kappa_10": {"huber_delta": 10.0},
    "5_step_return": {"return_steps": 5},
    "minibatch_64": {"batch_size": 64, "environments": 16},  # twice as many updates
    "32_kernels": {"kernels": 32},
    "steady_learning_rate": {"learning_rate": 3e-4, "learning_rate_end": 3e-4},
}


def centring(recipe: Recipe) -> dict[str, Recipe]:
    """The paper's ablation: the map centred on the UAV, and the city in place.

    A recipe with a map of another kind is the third variant. The first two then have `LITE`'s
    network, which is made for whole maps.
    """
    kinds, whole = ("centred", "non_centred"), recipe
    if recipe.observation not in kinds:
        whole = _with_fields_of(LITE, recipe, PARTS["two_resolutions"])
    variants = {kind: replace(whole, observation=kind) for kind in kinds}
    return variants | ({} if whole is recipe else {recipe.observation: recipe})


def deviations(recipe: Recipe) -> dict[str, Recipe]:
    """The recipe, and for each departure from `paper` the recipe with the paper's value instead."""
    return {"all": recipe} | _undone(recipe, DEVIATIONS, PAPER)


def parts(recipe: Recipe) -> dict[str, Recipe]:
    """The recipe, the recipe without each part of `PARTS`, and `lite`, which has none of them."""
    none = replace(
        LITE,
        steps=recipe.steps,
        validation_interval=recipe.validation_interval,
        validation_episodes=recipe.validation_episodes,
    )
    return {"all": recipe} | _undone(recipe, PARTS, LITE) | {"none": none}


def values(recipe: Recipe) -> dict[str, Recipe]:
    """The recipe, and for each row of `VALUES` that is not its own the recipe with these values."""
    others = {name: replace(recipe, **row) for name, row in VALUES.items()}
    return {"as_it_is": recipe} | {k: other for k, other in others.items() if other != recipe}


def _undone(
    recipe: Recipe, groups: dict[str, tuple[str, ...]], reference: Recipe
) -> dict[str, Recipe]:
    """For each group of fields in which the recipe departs from the reference: the recipe with the
    reference's values in them, by the name `without_GROUP`."""
    variants = {}
    for name, fields in groups.items():
        undone = _with_fields_of(reference, recipe, fields)
        if undone != recipe:
            variants[f"without_{name}"] = undone
    return variants


def _with_fields_of(reference: Recipe, recipe: Recipe, fields: tuple[str, ...]) -> Recipe:
    return replace(recipe, **{field: getattr(reference, field) for field in fields})


STUDIES = {"centring": centring, "deviations": deviations, "parts": parts, "values": values}


def find_study(name: str, recipe: Recipe, only: Collection[str] = ()) -> dict[str, Recipe]:
    """The variants of a study, or only those named; `InputError` names the known ones."""
    if name not in STUDIES:
        raise InputError(f"unknown study {name!r}: choose one of {', '.join(STUDIES)}")
    variants = STUDIES[name](recipe)
    for variant in only:
        if variant not in variants:
            raise InputError(f"unknown variant {variant!r}: choose from {', '.join(variants)}")
    return {variant: variants[variant] for variant in only or variants}


def run_study(
    scenario: Scenario,
    variants: dict[str, Recipe],
    seeds: int,
    out: str | Path,
    jobs: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
    command: str = "",
) -> dict[str, list[Path]]:
    """Train every variant with the seeds 0, 1, …; returns the folders of the runs by variant.

    Each run is one thread in a process of its own, in the folder `out/VARIANT-SEED`. If the call is
    killed, the same call continues: finished runs are kept, others resume where they were saved.

    Arguments:
        jobs: runs at a time on this machine.
        backend: `loky`, processes of this machine; or `dask`, the workers of a Dask cluster, which
            must see the folder `out` under the same path.
        scheduler: the address of the Dask cluster's scheduler, such as `tcp://node1:8786`; None
            starts a cluster of `jobs` workers on this machine.

    Raises `InputError` for an unknown backend, or one that is not installed, and for runs that are
    too short for a curve.
    """
    for recipe in variants.values():
        if recipe.steps < BIN:
            raise InputError(f"runs of {recipe.steps} steps: a study's curves need at least {BIN}")
    out = Path(out).absolute()
    grid = [(name, seed) for seed in range(seeds) for name in variants]
    folders = {(name, seed): out / f"{name}-{seed}" for name, seed in grid}
    total = sum(variants[name].steps for name, _ in grid)
    with (
        _cluster(backend, scheduler, jobs),
        joblib.parallel_config(backend=backend, n_jobs=jobs if scheduler is None else -1),
        tqdm(total=total, unit="step", unit_scale=True) as progress,
        _watching(progress, list(folders.values())),
    ):
        done = joblib.Parallel(return_as="generator_unordered")(
            joblib.delayed(_run)(scenario, variants[name], seed, folders[name, seed], command)
            for name, seed in grid
        )
        for folder in done:
            progress.write(f"finished: {folder}", file=sys.stderr)
    return {name: [folders[name, seed] for seed in range(seeds)] for name in variants}


def collect_curves(folders: dict[str, list[Path]], out: Path, command: str) -> tuple[Path, Path]:
    """Write the curves of a finished study as two tables; returns their paths.

    `training.csv.gz` and `validation.csv.gz` have the rows of the runs' own files, with the columns
    `variant` and `seed` in front. `about.json` has the command and each run's `about.json`.
    """
    runs = [(name, folder) for name, of_variant in folders.items() for folder in of_variant]
    about = {folder.name: json.loads((folder / "about.json").read_text()) for _, folder in runs}
    paths = []
    for kind in ("training", "validation"):
        rows = []
        for name, folder in runs:
            with open(folder / f"{kind}.csv", newline="") as file:
                first = {"variant": name, "seed": about[folder.name]["seed"]}
                rows += [first | row for row in csv.DictReader(file)]
        paths.append(out / f"{kind}.csv.gz")
        write_table(paths[-1], rows)
    write_json(out / "about.json", {"command": command, "runs": about})
    return paths[0], paths[1]


def final_scores(validation: str | Path) -> dict[str, list[float]]:
    """Collection ratio and landed at the end of each run, by variant, in the order of the seeds.

    Arguments:
        validation: the table `validation.csv.gz` of `collect_curves`.
    """
    table = read_table(validation)
    last = table["steps"] == table["steps"].max()
    return {
        variant: table["collection_ratio_and_landed"][last & (table["variant"] == variant)].tolist()
        for variant in dict.fromkeys(table["variant"].tolist())
    }


def _run(scenario: Scenario, recipe: Recipe, seed: int, folder: Path, command: str) -> Path:
    """One training run, from its start or from where it was saved."""
    torch.set_num_threads(1)
    resume = (folder / SAVED).exists()
    train(Trainer(scenario, recipe, seed), folder, resume, command, show_progress=False)
    return folder


def _cluster(backend: str, scheduler: str | None, jobs: int):
    """A context in which joblib's backend is ready."""
    if backend == "loky":
        return nullcontext()
    if backend != "dask":
        raise InputError(f"unknown backend {backend!r}: choose loky or dask")
    with extra("dask"):
        from distributed import Client
    if scheduler is None:
        return Client(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
    try:
        return Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from None


@contextmanager
def _watching(progress: tqdm, folders: list[Path]) -> Iterator[None]:
    """Keep the bar at the steps of all runs, as their validation files say."""
    stop = threading.Event()

    def watch():
        while not stop.wait(1.0):
            progress.n = sum(map(_steps_done, folders))
            progress.refresh()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        stop.set()
        watcher.join()
        progress.n = sum(map(_steps_done, folders))
        progress.refresh()


def _steps_done(folder: Path) -> int:
    try:
        return int((folder / "validation.csv").read_text().splitlines()[-1].split(",")[0])
    except FileNotFoundError:
        return 0
