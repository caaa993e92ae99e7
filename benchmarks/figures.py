"""The charts of the results, in `data/figures/results`, and the paper's figures, made again.

    python benchmarks/figures.py [NAME ...]

All figures are drawn unless some are named, such as `ladder`. The charts are those of
`docs/_extensions/charts.py`. In `data/figures/paper` the curves are those of the recorded studies;
the flights are flown by the strengthened DDQN agents of seed 0.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "_extensions"))
from charts import CHARTS, save_chart

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.missions import Mission
from uavdh_lite.observation import LAYERS, Observation
from uavdh_lite.plotting import add_legend, draw_maps, draw_study, draw_trajectory, save_figure
from uavdh_lite.storage import read_table

DATA = Path(__file__).parents[1] / "data"
OUT = DATA / "figures" / "paper"
MOST_SEEDS = 2000  # missions that are looked through for a behaviour


def agent_of(scenario: str) -> Agent:
    return load_agent(f"{scenario}_ddqn")


def centring() -> Figure:
    """What the network sees of one state: in place above, centred on the UAV below."""
    agent = agent_of("manhattan")
    environment = Environment(agent.cities)
    mission = Mission.draw(agent.scenario, agent.city, 0)
    shown = {}
    for kind in ("non_centred", "centred"):
        map, _ = Observation(environment, kind, 20.0, 10.0)(mission.state)
        name = {"non_centred": "in place"}.get(kind, kind)
        shown |= {f"{name}: {layer}": map[0, i].numpy() for i, layer in enumerate(LAYERS[:3])}
    return draw_maps(shown)


def curves(study: str) -> Figure:
    """Greedy flights of new random missions during the training, as the paper evaluates."""
    table = read_table(DATA / "runs" / f"{study}-training.csv.gz")
    greedy = table | {k: table[f"greedy_{k}"] for k in ("return", "collected_and_landed")}
    figure = Figure(figsize=(9, 4), layout="constrained")
    draw_study(figure, greedy)
    return figure


def manhattan() -> dict[str, Mission]:
    """Missions with 2 to 5 devices: the first drawn ones whose flights show these behaviours."""
    agent = agent_of("manhattan")
    city = agent.city

    def straight_home(flight: Trajectory) -> bool:
        last = np.flatnonzero(np.diff(flight.data_left.sum(axis=1)))[-1] + 1  # the last upload
        home = agent.environment.time_to_land[0, flight.uav_cell[last]]
        return len(flight.action) - last <= home + 2

    def shows(devices: int, flight: Trajectory) -> bool:
        left, time = flight.data_left[-1][:devices], flight.time_left
        cells = flight.start.device_cells[0, :devices]
        inside = (city.no_fly & ~city.buildings).ravel()[cells].any()
        early, emptied = time[-1] >= 6, (left < 0.05).sum()
        return (
            flight.landed
            and {
                2: bool(inside and emptied == 2),
                3: bool(time[-1] == 0 and emptied == 3 and straight_home(flight)),
                4: bool(early and emptied == 3 and left.max() > 3),
                5: bool(early and emptied == 5),
            }[devices]
        )

    titles = ("one in the no-fly zone", "all time is used", "one is left", "with time to spare")
    missions = {}
    for devices, title in zip((2, 3, 4, 5), titles, strict=True):
        scenario = replace(agent.scenario, devices=(devices, devices))
        drawn = (Mission.draw(scenario, city, seed) for seed in range(MOST_SEEDS))
        found = (m for m in drawn if shows(devices, m.fly(agent.environment, agent).trajectory(0)))
        missions[f"{devices} devices: {title}"] = next(found)
    return missions


def flights(scenario: str, missions: dict[str, Mission]) -> Figure:
    """The agent's flights of some missions, two in a row, with the legend."""
    agent = agent_of(scenario)
    rows = len(missions) // 2
    figure = Figure(figsize=(10, 5.4 * rows + 1.2), layout="constrained")
    for ax, (title, mission) in zip(
        figure.subplots(rows, 2).ravel(), missions.items(), strict=True
    ):
        draw_trajectory(ax, agent.environment, mission.fly(agent.environment, agent).trajectory(0))
        ax.set_title(title)
    add_legend(figure, max(len(mission.devices) for mission in missions.values()))
    return figure


def main() -> None:
    torch.set_num_threads(1)
    city = agent_of("open_field").city
    equal = Mission(city, (14, 1), ((6, 3), (10, 12)), (20, 20), 45, max_devices=2)
    court = Mission(city, (14, 1), ((6, 3), (7, 12)), (20, 20), 60, max_devices=2)
    quarter = {"equal data": equal, "a quarter at the far device": equal.fill(1, 5)}
    courtyard = {"20 units in the courtyard": court, "5 units in the courtyard": court.fill(1, 5)}
    figures = {
        "centring": centring,
        "curves_plain": lambda: curves("centring_plain-manhattan"),
        "curves_lite": lambda: curves("centring_lite-manhattan"),
        "open_field": lambda: flights("open_field", quarter),
        "courtyard": lambda: flights("open_field", courtyard),
        "manhattan": lambda: flights("manhattan", manhattan()),
    }
    OUT.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[1:] or (*CHARTS, *figures):
        if name in CHARTS:
            print(save_chart(name), flush=True)
        elif name in figures:
            save_figure(figures[name](), OUT / f"{name}.png")
            print(OUT / f"{name}.png", flush=True)
        else:
            sys.exit(f"no figure {name!r}: choose of {', '.join((*CHARTS, *figures))}")


if __name__ == "__main__":
    main()
