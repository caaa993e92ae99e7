"""Policies side by side: the same scenarios, the same fading, and who is left behind."""

from collections.abc import Callable
from dataclasses import replace

import joblib
import numpy as np
from tqdm.auto import tqdm

from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, Interval, Policy, fly, mean_interval
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream

Columns = dict[str, np.ndarray]


def compare(
    environment: Environment,
    scenario: Scenario,
    policies: dict[str, Callable[[], Policy]],
    episodes: int,
    seed: int,
    jobs: int = 1,
    chunk: int = 50,
) -> dict[str, Columns]:
    """Fly every policy over the same random scenarios and fading.

    Returns for each policy the metrics of `Flights.records` and what was drawn for the episodes:
    `devices`, `flying_time`, `data` (the sum over devices, data units); (N,) each.

    Arguments:
        policies: functions that make a policy, by name; each is called in its own process.
        jobs: processes at a time. Each flies `chunk` episodes; neither changes the results of a
            policy that treats episodes apart.
    """
    tasks = [
        (name, slice(first, min(first + chunk, episodes)))
        for name in policies
        for first in range(0, episodes, chunk)
    ]
    parts = joblib.Parallel(n_jobs=jobs, return_as="generator")(
        joblib.delayed(_fly_part)(environment, scenario, policies[name], episodes, seed, part)
        for name, part in tasks
    )
    results: dict[str, list[Columns]] = {name: [] for name in policies}
    with tqdm(total=episodes * len(policies), unit="episode") as progress:
        for (name, part), columns in zip(tasks, parts, strict=True):
            results[name].append(columns)
            progress.set_description(name, refresh=False)
            progress.update(part.stop - part.start)
    return {
        name: {key: np.concatenate([one[key] for one in several]) for key in several[0]}
        for name, several in results.items()
    }


def _fly_part(environment, scenario, policy, episodes: int, seed: int, part: slice) -> Columns:
    """The columns of some of the episodes.

    Scenarios and fading are drawn for all, so that they are those of `evaluate` with this seed;
    the other episodes count as landed and are not flown.
    """
    generator = stream(Use.TEST, seed)
    start = scenario.sample(environment.city, episodes, generator)
    others = np.ones(episodes, bool)
    others[part] = False
    flights = fly(environment, policy(), replace(start, landed=others), generator)
    return {name: values[part] for name, values in columns(flights).items()}


def columns(flights: Flights) -> Columns:
    """What was drawn for each episode, then its metrics; (N,) each."""
    data = flights.start.data_initial
    return {
        "devices": (data > 0).sum(axis=1),
        "flying_time": flights.start.time_left.astype(int),
        "data": data.sum(axis=1).astype(float),
        **flights.records(),
    }


def share(values: np.ndarray, reference: np.ndarray) -> Interval:
    """The mean of `values` as a share of that of `reference`, over the same N episodes.

    The 95 % interval resamples episodes, keeping the two values of each together.
    """
    generator = stream(Use.BOOTSTRAP)
    rows = generator.integers(0, len(values), (2000, len(values)))
    low, high = np.quantile(
        values[rows].mean(axis=1) / reference[rows].mean(axis=1), [0.025, 0.975]
    )
    return Interval(float(values.mean() / reference.mean()), float(low), float(high))


def breakdown(
    values: np.ndarray, by: np.ndarray, groups: int = 4
) -> list[tuple[str, int, Interval]]:
    """The mean of `values` within groups of episodes: (label, number of episodes, mean).

    Groups are the different values of `by` if there are few, else ranges that hold about equally
    many episodes.
    """
    different = np.unique(by)
    if len(different) <= groups + 1:
        members = [(f"{value:g}", by == value) for value in different]
    else:
        edges = np.quantile(by, np.linspace(0, 1, groups + 1))
        place = np.searchsorted(edges[1:-1], by, side="right")
        members = [
            (f"{by[place == group].min():.4g} to {by[place == group].max():.4g}", place == group)
            for group in np.unique(place)
        ]
    return [(label, int(own.sum()), mean_interval(values[own])) for label, own in members]
