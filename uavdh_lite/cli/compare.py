"""`compare`: an agent and the planners on the same missions."""

import time
from pathlib import Path

from cyclopts.types import NonNegativeInt, PositiveInt

from uavdh_lite.cli.arguments import Device, open_agent
from uavdh_lite.cli.parsing import CommandLine


def compare(
    *,
    checkpoint: str | None = None,
    others: tuple[str, ...] = (),
    city: str | None = None,
    episodes: PositiveInt = 1000,
    seed: NonNegativeInt = 0,
    replan: PositiveInt = 5,
    jobs: PositiveInt = 1,
    device: Device = "cpu",
    out: Path | None = None,
    command_line: CommandLine,
) -> None:
    """Compare an agent with the planners on the same missions.

    The agent, the random planner, the greedy planner and two genies fly the same missions with
    the same fading. The metrics of every episode are written as a table.

    Arguments:
        checkpoint: a checkpoint file, or the name of a shipped agent; by default the one that knows
            the city best.
        others: names of shipped agents of the same city to compare with, too.
        city: another city, of the same size or smaller: a PNG, a folder of PNGs, the name of a
            shipped one, or random:COUNT:SEED.
        episodes: number of random missions.
        seed: seed of the missions, the fading and the random planner.
        replan: steps after which the genies plan again; fewer take longer.
        jobs: number of processes at a time.
        device: what the network runs on.
        out: the table, by default comparison-SCENARIO.csv.gz, with a JSON file next to it.
    """
    from uavdh_lite.environment import Environment
    from uavdh_lite.experiments import comparison
    from uavdh_lite.provenance import provenance

    agent = open_agent(checkpoint, city, device)
    environment = Environment(agent.city)
    started = time.perf_counter()
    policies = comparison.entrants(environment, agent, seed, replan, others)
    results = comparison.compare(environment, agent.scenario, policies, episodes, seed, jobs)
    out = out or Path(f"comparison-{agent.scenario.name}.csv.gz")
    about = {
        "command": command_line,
        "seed": seed,
        "seconds": round(time.perf_counter() - started, 1),
        "jobs": jobs,
        **provenance(),
        "agent": agent.training,
    }
    comparison.save_comparison(out, results, about)
    print(f"{agent.scenario.name}: {episodes} random missions, seed {seed}")
    print(comparison.summary(results))
    print(out)
