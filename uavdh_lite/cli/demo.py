"""`demo`: the shipped agents on the paper's maps."""

from pathlib import Path

from cyclopts.types import NonNegativeInt, PositiveInt

from uavdh_lite.cli.arguments import Device, require_device


def demo(
    *,
    episodes: PositiveInt = 1000,
    out: Path = Path("demo.png"),
    seed: NonNegativeInt = 0,
    device: Device = "cpu",
) -> None:
    """Fly the shipped agents next to a simple rule and the paper's results, and draw four flights.

    Arguments:
        episodes: number of random missions.
        out: the figure.
        seed: seed of the missions and the fading.
        device: what the network runs on.
    """
    from uavdh_lite.experiments.demo import draw_flights, fly_all, paper_agents
    from uavdh_lite.experiments.report import policies_table
    from uavdh_lite.paper import RESULTS
    from uavdh_lite.plotting import save_figure

    flown = []
    for name in paper_agents():
        environment, flights = fly_all(name, episodes, seed, require_device(device))
        flown.append((environment, next(iter(flights.values()))))
        metrics = {policy: of_policy.metrics() for policy, of_policy in flights.items()}
        print(f"{name}: {episodes} random missions, seed {seed}")
        print(f"{policies_table(metrics, RESULTS[name])}\n")
    figure, count = draw_flights(flown)
    save_figure(figure, out)
    print(f"The first {count} flights are drawn in {out}.")
    print("The paper's maps were never published. Ours are redrawn from its text, so the agents")
    print("solve the same task, but in other streets.")
