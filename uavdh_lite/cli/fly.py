"""`fly`: one mission of your own."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import NonNegativeInt

from uavdh_lite.cli.arguments import Device, open_agent
from uavdh_lite.errors import InputError

Cell = Annotated[str, Parameter(metavar="ROW,COL")]
Cells = Annotated[tuple[str, ...] | None, Parameter(metavar="ROW,COL...")]


def fly(
    *,
    checkpoint: str | None = None,
    city: str | None = None,
    devices: Cells = None,
    data: Annotated[tuple[float, ...] | None, Parameter(metavar="UNITS...")] = None,
    flying_time: int | None = None,
    start: Cell | None = None,
    mission: Path | None = None,
    save_mission: Path | None = None,
    seed: NonNegativeInt = 0,
    device: Device = "cpu",
    out: Path = Path("flight.png"),
) -> None:
    """Fly one mission of your own and draw it.

    Whatever you leave out is drawn at random.

    Arguments:
        checkpoint: a checkpoint file, or the name of a shipped agent; by default the one that knows
            the city best.
        city: another city, of the same size or smaller: a PNG, or the name of a shipped one.
        devices: cells of the devices, such as 4,4 8,11.
        data: data units of each device.
        flying_time: units of time.
        start: the UAV's first cell, in the landing zone or anywhere it may fly.
        mission: fly the mission in this file instead.
        save_mission: write the mission to this file, to share it.
        seed: seed of the fading, and of whatever you leave out.
        device: what the network runs on.
        out: the figure; a name that ends in .gif makes an animation, in .html a page that plays it.
    """
    from matplotlib.figure import Figure

    from uavdh_lite.city import one_city
    from uavdh_lite.environment import Environment
    from uavdh_lite.missions import Mission, load_mission
    from uavdh_lite.missions import save_mission as save
    from uavdh_lite.player import play
    from uavdh_lite.plotting import (
        add_legend,
        caption,
        draw_trajectory,
        save_animation,
        save_figure,
    )

    if mission is not None:
        flown = load_mission(mission)
        agent = open_agent(checkpoint, flown.city, device)
    else:
        agent = open_agent(checkpoint, city, device)
        flown = Mission.draw(
            agent.scenario,
            one_city(agent.city),
            seed,
            start=None if start is None else cell(start),
            devices=None if devices is None else tuple(map(cell, devices)),
            data=data,
            flying_time=flying_time,
        )
    if save_mission is not None:
        save(save_mission, flown)
    environment = Environment(flown.city)
    trajectory = flown.fly(environment, agent).trajectory(0)

    if out.suffix == ".gif":
        save_animation(flown.city, trajectory, out)
    elif out.suffix == ".html":
        play(environment, trajectory).save(out)
    else:
        figure = Figure(figsize=(7, 9), layout="constrained")
        draw_trajectory(figure.subplots(), environment, trajectory)
        add_legend(figure, len(flown.devices))
        save_figure(figure, out)
    print(f"{'landed' if trajectory.landed else 'crashed'}. {caption(trajectory)}. {out}")


def cell(text: str) -> tuple[int, int]:
    """The cell that is written as ROW,COL."""
    try:
        row, col = text.split(",")
        return int(row), int(col)
    except ValueError:
        raise InputError(f"{text!r} is not a cell: write ROW,COL as in 3,12") from None
