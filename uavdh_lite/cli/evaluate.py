"""`evaluate`: fly an agent on many random missions."""

from pathlib import Path

from cyclopts.types import NonNegativeInt, PositiveInt

from uavdh_lite.cli.arguments import Device, open_agent


def evaluate(
    *,
    checkpoint: str,
    city: str | None = None,
    episodes: PositiveInt = 1000,
    seed: NonNegativeInt = 0,
    device: Device = "cpu",
    json: Path | None = None,
) -> None:
    """Fly an agent on many random missions.

    Arguments:
        checkpoint: a checkpoint file, or the name of a shipped agent.
        city: another city, of the same size or smaller: a PNG, a folder of PNGs, the name of a
            shipped one, or random:COUNT:SEED.
        episodes: number of random missions.
        seed: seed of the missions and the fading.
        device: what the network runs on.
        json: file to write the mean, low and high of each metric to.
    """
    from uavdh_lite import evaluation
    from uavdh_lite.experiments.report import metrics_table
    from uavdh_lite.storage import write_json

    agent = open_agent(checkpoint, city, device)
    flights = evaluation.evaluate(agent.environment, agent, agent.scenario, episodes, seed)
    metrics = flights.metrics()
    print(f"{agent.scenario.name}: {episodes} random missions, seed {seed}")
    print(metrics_table(metrics))
    if json is not None:
        write_json(json, {name: interval._asdict() for name, interval in metrics.items()})
