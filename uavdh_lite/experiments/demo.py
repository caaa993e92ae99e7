"""The shipped agents on the paper's two maps: their flights, and a figure of some."""

from matplotlib.figure import Figure

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, evaluate
from uavdh_lite.paper import RESULTS
from uavdh_lite.plotting import add_legend, draw_trajectory


def paper_agents() -> list[str]:
    """The shipped agents of the paper's maps, by name."""
    return [name for name in RESULTS if name in shipped_agents()]


def fly_agent(name: str, episodes: int, seed: int, device: str) -> tuple[Environment, Flights]:
    """Fly a shipped agent on random missions of its own city, with every step kept."""
    agent = load_agent(name, device)
    environment = agent.environment
    return environment, evaluate(environment, agent, agent.scenario, episodes, seed, record=True)


def draw_flights(flown: list[tuple[Environment, Flights]]) -> tuple[Figure, int]:
    """A figure of four flights, the first ones of each city, and how many it shows.

    It shows fewer if there are fewer flights.
    """
    figure = Figure(figsize=(11, 13), layout="constrained")
    drawn = [
        (environment, flights, episode)
        for environment, flights in flown
        for episode in range(min(4 // len(flown), len(flights.start)))
    ]
    for number, (environment, flights, episode) in enumerate(drawn, start=1):
        ax = figure.add_subplot(2, 2, number)
        draw_trajectory(ax, environment, flights.trajectory(episode))
        ax.set_title(f"{environment.city.name}, scenario {episode}")
    add_legend(figure, max(flights.start.device_cells.shape[1] for _, flights in flown))
    return figure, len(drawn)
