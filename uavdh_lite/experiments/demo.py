"""The shipped agents on the paper's two maps, next to the planners: their flights, and a figure."""

from matplotlib.figure import Figure

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import City
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import Flights, evaluate
from uavdh_lite.paper import RESULTS
from uavdh_lite.planners import Greedy
from uavdh_lite.plotting import add_legend, draw_trajectory

# The shipped agents of a city, the best first: label, and what follows the city in their names.
AGENTS = {"beyond it: quantile agent": "", "the paper's method: DDQN": "_ddqn"}
GREEDY = "greedy rule"


def paper_agents() -> list[str]:
    """The shipped agents of the paper's maps, by name."""
    return [name for name in RESULTS if name in shipped_agents()]


def fly_all(
    name: str, episodes: int, seed: int, device: str
) -> tuple[Environment, dict[str, Flights]]:
    """A city's shipped agents, the best first, and greedy over the same random missions.

    Every step of the agents' flights is kept.
    """
    agents = {
        label: load_agent(name + suffix, device)
        for label, suffix in AGENTS.items()
        if name + suffix in shipped_agents()
    }
    scenario = next(iter(agents.values())).scenario
    environment = Environment(City.load(scenario.city))
    policies = agents | {GREEDY: Greedy(environment)}
    return environment, {
        label: evaluate(environment, policy, scenario, episodes, seed, record=label in agents)
        for label, policy in policies.items()
    }


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
