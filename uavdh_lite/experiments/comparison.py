"""Policies side by side: the same missions with the same fading."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import joblib
import numpy as np
from tqdm.auto import tqdm

from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, Interval, Policy, drawn_again, fly, mean_interval
from uavdh_lite.experiments.report import interval_text
from uavdh_lite.planners import Genie
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use, stream

Columns = dict[str, np.ndarray]


def entrants(
    environment: Environment,
    agent: Policy,
    seed: int = 0,
    replan: int = 5,
    others: Iterable[str] = (),
) -> dict[str, Callable[[], Policy]]:
    """The agent and what it is compared with, for `compare`.

    These are `random`, `greedy`, `genie` (which plans for the return) and `genie_data` (which plans
    for the data). Agents trained with the failsafe use it in any environment; the others fly
    without it if the environment has none.

    Arguments:
        seed: of the random policy.
        replan: steps after which the genies plan again.
        others: names of shipped agents to compare with, too.
    """
    return {
        "agent": lambda: agent,
        **{name: partial(find_policy, name, environment) for name in others},
        "random": partial(find_policy, "random", environment, seed),
        "greedy": partial(find_policy, "greedy", environment),
        "genie": partial(Genie, environment, replan=replan),
        "genie_data": partial(Genie, environment, replan=replan, time_cost=0.01),
    }


def compare(
    environment: Environment,
    scenario: Scenario,
    policies: dict[str, Callable[[], Policy]],
    episodes: int,
    seed: int,
    jobs: int = 1,
    chunk: int = 50,
) -> dict[str, Columns]:
    """Fly every policy on the same random missions with the same fading.

    Returns for each policy the metrics of `Flights.records` and what was drawn for the episodes:
    `devices`, `flying_time`, `data` (the sum over devices, data units), and over several cities
    `city`, a name; (N,) each.

    Arguments:
        policies: functions that make a policy, by name; each is called in its own process.
        jobs: processes at a time. Each flies `chunk` episodes. Neither number changes the results
            of a policy that treats each episode on its own.
    """
    tasks = [
        (name, slice(first, min(first + chunk, episodes)))
        for name in policies
        for first in range(0, episodes, chunk)
    ]
    flown = joblib.Parallel(n_jobs=jobs, return_as="generator")(
        joblib.delayed(_fly_part)(environment, scenario, policies[name], episodes, seed, part)
        for name, part in tasks
    )
    parts: dict[str, list[Columns]] = {name: [] for name in policies}
    with tqdm(total=episodes * len(policies), unit="episode") as progress:
        for (name, part), columns in zip(tasks, flown, strict=True):
            parts[name].append(columns)
            progress.set_description(name, refresh=False)
            progress.update(part.stop - part.start)
    return {
        policy: {name: np.concatenate([part[name] for part in each]) for name in each[0]}
        for policy, each in parts.items()
    }


def _fly_part(environment, scenario, policy, episodes: int, seed: int, part: slice) -> Columns:
    """The columns of some of the episodes.

    Missions and fading are drawn for all, so that they are those of `evaluate` with this seed. The
    other episodes count as landed and are not flown.
    """
    generator = stream(Use.TEST, seed)
    start = scenario.sample(environment.city, episodes, generator)
    others = np.ones(episodes, bool)
    others[part] = False
    flights = fly(environment, policy(), replace(start, landed=others), generator)
    return {name: values[part] for name, values in columns(environment, flights).items()}


def columns(environment: Environment, flights: Flights) -> Columns:
    """What was drawn for each episode, then its metrics; (N,) each.

    Over several cities, `city` is the name of the episode's.
    """
    data, cities = flights.start.data_initial, environment.cities
    names = np.array([city.name for city in cities.cities])
    return {
        **({"city": names[cities.city[flights.start.uav_cell]]} if len(cities) > 1 else {}),
        "devices": (data > 0).sum(axis=1),
        "flying_time": flights.start.time_left.astype(int),
        "data": data.sum(axis=1).astype(float),
        **flights.records(),
    }


def share(values: np.ndarray, reference: np.ndarray, groups: np.ndarray | None = None) -> Interval:
    """The mean of `values` as a share of that of `reference`, over the same N episodes.

    The 95 % interval resamples episodes, keeping the two values of each together, or `groups` of
    them as `bootstrap_interval` does.
    """
    if groups is None:
        rows = stream(Use.BOOTSTRAP).integers(0, len(values), (2000, len(values)))
        shares = values[rows].mean(axis=1) / reference[rows].mean(axis=1)
    else:
        sums, of_reference = drawn_again(groups, 2000, values, reference)
        shares = sums / of_reference
    low, high = np.quantile(shares, [0.025, 0.975])
    return Interval(float(values.mean() / reference.mean()), float(low), float(high))


def breakdown(
    values: np.ndarray, by: np.ndarray, groups: int = 4
) -> list[tuple[str, int, Interval]]:
    """The mean of `values` within groups of episodes: (label, number of episodes, mean).

    Groups are the different values of `by` if there are few or they are words, otherwise ranges
    with about equally many episodes.
    """
    different = np.unique(by)
    if by.dtype.kind == "U":
        members = [(value.replace("_", " "), by == value) for value in different.tolist()]
    elif len(different) <= groups + 1:
        members = [(f"{value:g}", by == value) for value in different]
    else:
        edges = np.quantile(by, np.linspace(0, 1, groups + 1))
        group_of = np.searchsorted(edges[1:-1], by, side="right")
        members = [(_range(by[group_of == g]), group_of == g) for g in np.unique(group_of)]
    return [(label, int(inside.sum()), mean_interval(values[inside])) for label, inside in members]


def _range(values: np.ndarray) -> str:
    """As in `2 to 3`, or `4`."""
    return " to ".join(dict.fromkeys(f"{end:.4g}" for end in (values.min(), values.max())))


def save_comparison(path: Path, results: dict[str, Columns], about: dict) -> None:
    """Write a row for each policy and episode as a table, and `about` as JSON next to it."""
    rows = [
        {"policy": policy, "episode": episode}
        | {name: column[episode].item() for name, column in columns.items()}
        for policy, columns in results.items()
        for episode in range(len(columns["devices"]))
    ]
    write_table(path, rows)
    write_json(path.with_name(path.name.split(".")[0] + ".json"), about)


def summary(results: dict[str, Columns]) -> str:
    """The metrics of all policies, and where the agent of `entrants` stands, as text."""
    shown = ("has_landed", "collection_ratio", "collection_ratio_and_landed", "cumulative_reward")
    wide = max(12, *(len(policy) + 2 for policy in results))
    lines = [f"{'':<{wide}}" + "".join(f"{metric:>30}" for metric in shown)]
    for policy, columns in results.items():
        means = (interval_text(mean_interval(columns[metric])) for metric in shown)
        lines.append(f"{policy:<{wide}}" + "".join(f"{mean:>30}" for mean in means))
    for metric, genie in (
        ("collection_ratio_and_landed", "genie_data"),
        ("cumulative_reward", "genie"),
    ):
        part = share(results["agent"][metric], results[genie][metric])
        lines.append(f"agent's {metric} as a share of the {genie}'s: {interval_text(part)}")
    metric = "collection_ratio_and_landed"
    lines.append(f"{metric} of the agent and of genie_data, by what was drawn:")
    for drawn in ("devices", "flying_time", "data"):
        ours, theirs = (
            breakdown(results[policy][metric], results[policy][drawn])
            for policy in ("agent", "genie_data")
        )
        for (label, count, agent), (_, _, genie_data) in zip(ours, theirs, strict=True):
            both = f"{interval_text(agent):>30}{interval_text(genie_data):>30}"
            lines.append(f"{drawn:<12}{label:>18}{count:>6}{both}")
    return "\n".join(lines)
