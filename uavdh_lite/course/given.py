"""What the sheets of exercises are given; their checks use it, too. It holds no solutions."""

import functools

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.city import load_city
from uavdh_lite.environment import ACTIONS, HOVER
from uavdh_lite.evaluation import FunctionPolicy, Trajectory
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import draw_trajectory
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.shadowing import line_of_sight

PILOTS = {"A": "manhattan_ddqn", "B": "random", "C": "greedy"}
SEED = 462  # of a mission in which the agent does not begin with the nearest device


def flights_to_tell_apart() -> Figure:
    """Three flights of one mission, A, B and C."""
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.cities[0], SEED)
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    for ax, (letter, name) in zip(figure.subplots(1, 3), PILOTS.items(), strict=True):
        flights = mission.fly(environment, find_policy(name, environment))
        draw_trajectory(ax, environment, flights.trajectory(0)).set_title(f"flight {letter}")
    return figure


DATA, FLYING_TIME = (15.0, 15.0), 21


def mission() -> Mission:
    """The mission of exercise 0.3."""
    return Mission(load_city("village"), (0, 0), ((4, 1), (0, 7)), DATA, FLYING_TIME)


def flown(actions: list[str]) -> Trajectory:
    """The flight of these actions; once they are used up, the UAV hovers."""
    left = iter([ACTIONS.index(name) for name in actions])
    policy = FunctionPolicy(lambda state: np.array([next(left, HOVER)]))
    return mission().fly(environment_of("village"), policy).trajectory(0)


def picture(actions: list[str]) -> Figure:
    """The map after these actions."""
    figure = Figure(figsize=(5, 5.6), layout="constrained")
    draw_trajectory(figure.subplots(), environment_of("village"), flown(actions))
    return figure


@functools.cache
def sight_of(size, cells):
    return line_of_sight(np.frombuffer(cells, bool).reshape(size, size))


def shadow(buildings, device):
    return ~sight_of(len(buildings), buildings.tobytes())[device]


def blocked(buildings, device, cell):
    """Whether the link between a device and a UAV over a cell is blocked."""
    return bool(shadow(buildings, device)[cell])


# Of data/runs/deviations-manhattan, by variant, seed and thousand steps: landed, collected, time
RUNS = {
    "all-0-300": (0.991, 0.916, 0.804),
    "without_return_steps-0-300": (0.958, 0.715, 0.948),
    "without_crash_reward-0-300": (0.995, 0.186, 0.410),
    "without_learning_rate-0-100": (0.516, 0.334, 0.706),
    "without_input_scales-1-100": (0.834, 0.552, 0.502),
    "without_temperature-0-300": (0.982, 0.943, 0.844),
    "without_crash_reward-0-100": (1.000, 0.125, 0.231),
    "without_layer_norm-0-100": (0.980, 0.255, 0.442),
    "without_learning_rate-0-300": (0.989, 0.596, 0.866),
}
