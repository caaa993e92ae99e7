"""The ladder: every way to fly, over the paper's two maps, on the same missions, in one table.

    python benchmarks/ladder.py [--jobs 2]

All rows fly the same random missions of seed 50000, which nothing else uses, with the same fading.
Of what is learned, the agents of all seeds fly. A row has means over missions and seeds, and the
differences to the greedy rule, mission by mission. Its 95 % intervals are for other seeds and
other missions (`runs_interval`).

The genie takes longest, so it flies fewer missions of the seed, which greedy and the teacher fly,
too. They are drawn together, so they are not the first ones of the others.

Writes `data/runs/ladder.csv.gz`, a row for each map and way, `ladder.json`, and every mission of
every agent and rule, `ladder-missions.npz`: by `MAP|WAY`, (metrics, agents, missions) floats.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path

import joblib
import numpy as np
import torch
from scipy.special import stdtrit

from uavdh_lite.beyond.genie import Genie
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import described
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Interval, Policy, evaluate, in_flight, mean_interval
from uavdh_lite.missions import environment_of
from uavdh_lite.planners import Greedy, Random
from uavdh_lite.provenance import provenance
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_atomically, write_json, write_table

DATA = Path(__file__).parents[1] / "data"
AGENTS, OUT = DATA / "agents", DATA / "runs" / "ladder.csv.gz"
FLOWN = OUT.with_name("ladder-missions.npz")
MISSIONS, SEED = {False: 3000, True: 200}, 50_000  # fewer where the genie flies
MAPS = ("manhattan", "open_field")
METRICS = ("landed", "collected", "collected_and_landed", "return", "time_used")
COMPARED = ("collected_and_landed", "return")  # with greedy
KNOWS = ("map", "mean_rates", "failsafe", "moves", "reward")


@dataclass(frozen=True)
class Row:
    """A way to fly: what it knows, and a policy, or the file names of agents.

    `knows` are some of `KNOWS`: where buildings and zones are; every link's mean rate; the way
    home, flown by the environment when the time just suffices; a planner's moves to copy; a reward
    to learn from. `agents` is a pattern below `data/agents` with `{}` for the map, one of `maps`.
    """

    name: str
    knows: tuple[str, ...]
    policy: Callable[[Environment], Policy] | None = None
    agents: str = ""
    maps: tuple[str, ...] = MAPS
    slow: bool = False


class Orienteering(Greedy):
    """Fly towards the first device of the best order, which is sought again at every step.

    The orienteering problem: an order is a sequence of some of the devices. It takes the moves from
    one to the next, a unit of time over each, and the way home. The best one has the most data of
    those for which the time suffices, and the least time among equals.
    """

    def act(self, state: State) -> np.ndarray:
        return in_flight(state, self._act)

    def _act(self, state: State) -> np.ndarray:
        city, devices = state.city, state.device_cells.shape[1]
        # Stop 0 is where the UAV is, stop k the cell from which device k is served
        goals = self.approach[city[:, None], state.device_cells]
        stop = np.concatenate([state.uav_cell[:, None], goals], axis=1)
        moves = self.moves[city[:, None, None], stop[:, :, None], stop[:, None]].astype(int)
        home = self.environment.time_to_land[city[:, None], stop].astype(int)
        first, worth = [0], [-1e-4 * home[:, :1]]  # to no device at all
        for length in range(1, devices + 1):
            order = np.array(list(permutations(range(1, devices + 1), length)))
            there = moves[:, 0, order[:, 0]] + moves[:, order[:, :-1], order[:, 1:]].sum(axis=2)
            time = there + length + home[:, order[:, -1]]
            data = state.data_left[:, order - 1].sum(axis=2)
            worth.append(np.where(time <= state.time_left[:, None], data - 1e-4 * time, -np.inf))
            first += order[:, 0].tolist()
        chosen = np.array(first)[np.concatenate(worth, axis=1).argmax(axis=1)]
        action = self.towards(city, state.uav_cell, stop[np.arange(len(state)), chosen])
        return np.where(chosen == 0, super().act(state), action)


def teacher(environment: Environment) -> Genie:
    """The planner that the imitation agents copy: a genie with a narrow search."""
    return Genie(environment, beam=1, grow=False)


ROWS = (
    Row("random", (), lambda environment: Random()),
    Row("greedy", ("map",), Greedy),
    Row("orienteering", ("map",), Orienteering),
    Row("plain", ("map", "reward"), agents="*plain-{}-centred-*"),
    Row("ddqn", ("map", "reward"), agents="ddqn-{}-lite-*"),
    Row("ddqn_failsafe", ("map", "failsafe", "reward"), agents="failsafe-{}-safe-*", maps=MAPS[:1]),
    Row("ddqn_told", (*KNOWS[:3], "reward"), agents="failsafe-{}-told-*", maps=MAPS[:1]),
    Row("any_city", KNOWS, agents="any_city-imitation-*"),
    Row("copy", KNOWS[:-1], agents="copy-{}-copy-*"),
    Row("imitation", KNOWS, agents="imitation-{}-imitation-*"),
    Row("teacher", KNOWS[:2], teacher),
    Row("teacher_again", KNOWS[:2], teacher, slow=True),
    Row("genie_data", KNOWS[:2], lambda world: Genie(world, time_cost=0.01), slow=True),
    Row("genie", KNOWS[:2], Genie, slow=True),
)


def policies(row: Row, scenario: str) -> list[str]:
    """A name for each policy of a row: the files of the agents, or the row's own."""
    if row.policy:
        return [row.name]
    files = sorted(AGENTS.glob(f"{row.agents.format(scenario)}.safetensors"))
    return [str(path.relative_to(DATA.parent)) for path in files]


def fly(row: Row, name: str, scenario: str, missions: int) -> tuple[np.ndarray, int]:
    """The records of one policy over a map, (metrics, missions), and an agent's training steps."""
    torch.set_num_threads(1)
    environment, steps = environment_of(scenario), 0
    if row.policy:
        policy = row.policy(environment)
    else:
        agent = load_agent(DATA.parent / name)
        if not agent.knows(environment.cities):
            trained = described(agent.trained_in)
            raise InputError(f"{name}: was trained in {trained}, not in {scenario}")
        policy = agent.over(environment.cities)
        environment, steps = policy.environment, agent.training["steps"]
    records = evaluate(environment, policy, find_scenario(scenario), missions, SEED).records()
    return np.array([records[metric] for metric in METRICS], np.float32), steps


def runs_interval(values: np.ndarray) -> Interval:
    """The mean of S training runs on the same N missions, (S, N), with its 95 % interval.

    It is for other runs on other missions. How much the runs differ beyond what a mission and a run
    have by chance counts by Student's t with S − 1 degrees of freedom, how much the missions differ
    by the normal distribution; both halves add in square. Of one run it is `mean_interval`, which
    says nothing about others.
    """
    runs, missions = values.shape
    if runs == 1:
        return mean_interval(values[0])
    mean, of_run, of_mission = values.mean(), values.mean(axis=1), values.mean(axis=0)
    # Mean squares of an analysis of variance in two ways
    between_runs = missions * of_run.var(ddof=1)
    between_missions = runs * of_mission.var(ddof=1)
    rest = ((values - of_run[:, None] - of_mission + mean) ** 2).sum()
    rest /= (runs - 1) * (missions - 1)
    trained = stdtrit(runs - 1, 0.975) ** 2 * max(between_runs - rest, 0)
    flown = stdtrit(missions - 1, 0.975) ** 2 * max(between_missions, rest)
    half = np.sqrt((trained + flown) / values.size)
    return Interval(float(mean), float(mean - half), float(mean + half))


def summary(flown: np.ndarray, greedy: np.ndarray) -> dict[str, float]:
    """Means of a row, and what it is ahead of greedy on the same missions, with intervals.

    Both are (metrics, agents, missions); greedy has one agent.
    """
    values = dict(zip(METRICS, flown, strict=True))
    for metric in COMPARED:
        i = METRICS.index(metric)
        values[f"{metric}_ahead"] = flown[i] - greedy[i]
    return {
        name + end: number
        for name, value in values.items()
        for end, number in zip(("", "_low", "_high"), runs_interval(value), strict=True)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=1)
    jobs = parser.parse_args().jobs
    greedy_again = replace(ROWS[1], name="greedy_again", slow=True)
    grid = [
        (row, name, on)
        for row in sorted((*ROWS, greedy_again), key=lambda row: row.slow)
        for on in row.maps
        for name in policies(row, on)
    ]
    results = joblib.Parallel(n_jobs=jobs, verbose=10)(
        joblib.delayed(fly)(row, name, scenario, MISSIONS[row.slow]) for row, name, scenario in grid
    )
    flown, made = {}, {}
    for (row, _, scenario), (records, steps) in zip(grid, results, strict=True):
        flown.setdefault(f"{scenario}|{row.name}", []).append(records)
        made.setdefault(f"{scenario}|{row.name}", []).append(steps)
    missions = {way: np.stack(records, axis=1) for way, records in flown.items()}
    write_atomically(FLOWN, lambda path: np.savez_compressed(path, **missions))
    rows = []
    for scenario, row in product(MAPS, ROWS):
        if scenario in row.maps:
            way, greedy = f"{scenario}|{row.name}", f"{scenario}|greedy" + "_again" * row.slow
            _, seeds, number = missions[way].shape
            rows.append(
                {"scenario": scenario, "row": row.name, "seeds": seeds, "missions": number}
                | {"steps": int(np.mean(made[way]))}
                | {f"knows_{what}": int(what in row.knows) for what in KNOWS}
                | summary(missions[way], missions[greedy])
            )
    write_table(OUT, rows)
    agents = {on: [name for row, name, its in grid if its == on and row.agents] for on in MAPS}
    about = {"command": "python benchmarks/ladder.py", "seed": SEED, "agents": agents}
    about |= provenance()
    write_json(OUT.with_name("ladder.json"), about)


if __name__ == "__main__":
    main()
