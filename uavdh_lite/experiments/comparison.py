"""Policies side by side: the same missions with the same fading."""

from pathlib import Path

import joblib
import numpy as np
from tqdm.auto import tqdm

from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Interval, Policy, evaluate, mean_interval
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import read_json, write_json, write_table

Columns = dict[str, np.ndarray]


def compare(
    environment: Environment,
    scenario: Scenario,
    policies: dict[str, Policy],
    episodes: int,
    seed: int,
    jobs: int = 1,
) -> dict[str, Columns]:
    """Fly every policy on the same random missions with the same fading, those of `evaluate`.

    Returns the `columns` of each policy by its name.

    Arguments:
        jobs: processes at a time, each with one policy.
    """
    flown = joblib.Parallel(n_jobs=jobs, return_as="generator")(
        joblib.delayed(_fly)(environment, policy, scenario, episodes, seed)
        for policy in policies.values()
    )
    progress = tqdm(flown, total=len(policies), unit="policy")
    return dict(zip(policies, progress, strict=True))


def _fly(
    environment: Environment, policy: Policy, scenario: Scenario, episodes: int, seed: int
) -> Columns:
    return columns(environment, evaluate(environment, policy, scenario, episodes, seed))


def columns(environment: Environment, flights: Flights) -> Columns:
    """What was drawn for each episode, then its metrics from `Flights.records`; (N,) each.

    `devices`, `flying_time` and `data`, the sum over the devices in data units, were drawn; over
    several cities also `city`, its name, with its number where two have the same.
    """
    start, names = flights.start, [city.name for city in environment.cities]
    if len({*names}) < len(names):
        names = [f"{name} {number}" for number, name in enumerate(names)]
    return {
        **({"city": np.array(names)[start.city]} if len(names) > 1 else {}),
        "devices": (start.data_initial > 0).sum(axis=1),
        "flying_time": start.time_left.astype(int),
        "data": start.data_initial.sum(axis=1).astype(float),
        **flights.records(),
    }


def breakdown(
    values: np.ndarray, by: np.ndarray, groups: np.ndarray | None = None
) -> list[tuple[str, int, Interval]]:
    """The mean of `values` in parts of the episodes: (label, number of episodes, mean).

    Parts are the different values of `by` if there are at most five or they are words, otherwise
    four ranges with about equally many episodes. `groups` are those of `mean_interval`.
    """
    different = np.unique(by)
    if by.dtype.kind == "U":
        parts = {value: by == value for value in different.tolist()}
    elif len(different) <= 5:
        parts = {f"{value:g}": by == value for value in different}
    else:
        part_of = np.searchsorted(np.quantile(by, [0.25, 0.5, 0.75]), by, side="right")
        ranges = [part_of == part for part in np.unique(part_of)]
        parts = {f"{by[inside].min():.4g} to {by[inside].max():.4g}": inside for inside in ranges}
    rows = []
    for label, inside in parts.items():
        mean = mean_interval(values[inside], None if groups is None else groups[inside])
        rows.append((label, int(inside.sum()), mean))
    return rows


def save_comparison(path: Path, results: dict[str, Columns], about: dict) -> None:
    """Write a row for each policy and episode as a table, and `about` at its `about_path`.

    Arguments:
        path: of the table, `NAME.csv` or `NAME.csv.gz`.
    """
    rows, beside = [], about_path(path)
    for policy, of_policy in results.items():
        values = (column.tolist() for column in of_policy.values())
        for episode, row in enumerate(zip(*values, strict=True)):
            metrics = dict(zip(of_policy, row, strict=True))
            rows.append({"policy": policy, "episode": episode, **metrics})
    write_table(path, rows)
    write_json(beside, about)


def about_path(path: Path) -> Path:
    """The file `NAME.json` next to a table; `InputError` if there is one with other things."""
    unpacked = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    beside = unpacked.with_suffix(".json")
    if beside.exists() and "command" not in read_json(beside):
        raise InputError(f"{beside}: is not a comparison's, and would be replaced: rename it")
    return beside
