"""What the sheets of exercises are given; their checks use it, too. It holds no solutions.

What asks an answer about networks or missions is here, too: it runs beside the answer, within the
walls, and gives arrays, which are judged outside.
"""

import functools
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import nn

from uavdh_lite.city import load_city
from uavdh_lite.environment import ACTIONS, HOVER, LAND, Environment
from uavdh_lite.evaluation import FunctionPolicy, Trajectory
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import draw_trajectory
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario
from uavdh_lite.shadowing import line_of_sight
from uavdh_lite.streams import Use, stream

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


# Of data/runs/pilots-manhattan, by variant, seed and thousand steps: landed, collected, time
RUNS = {
    "centred_as_it_is-0-300": (0.990, 0.931, 0.814),
    "centred_without_return_steps-0-300": (0.973, 0.718, 0.950),
    "centred_without_crash_reward-0-300": (1.000, 0.152, 0.347),
    "centred_without_falling_rate-0-300": (0.850, 0.918, 0.863),
    "centred_without_movement_reward-2-100": (0.814, 0.385, 0.646),
    "centred_with_amsgrad-0-300": (0.990, 0.913, 0.832),
    "centred_without_crash_reward-0-100": (1.000, 0.132, 0.245),
    "centred_without_layer_norm-0-100": (1.000, 0.204, 0.514),
    "centred_without_leaky_relus-0-200": (0.989, 0.780, 0.834),
}


class Unfit(Exception):
    """An answer that cannot be asked; the message says why."""


PROBE = torch.tensor([[0.0, 0.0], [1.0, 2.0]])  # cells about which both networks of 6.4 are asked


def after_updates(update, seed, gamma, tau, updates, ends):
    """Q-values of both networks for `PROBE` after so many updates: (online or target, cell, 4)."""
    generator = stream(Use.EXERCISE, seed)
    online, target = (nn.Sequential(nn.Linear(2, 8), nn.Tanh(), nn.Linear(8, 4)) for _ in range(2))
    with torch.no_grad():
        for weights in [*online.parameters(), *target.parameters()]:
            weights.copy_(torch.tensor(generator.normal(0, 0.5, weights.shape)))
    optimiser = torch.optim.SGD(online.parameters(), lr=0.05)
    for _ in range(updates):
        cell, after = (torch.tensor(generator.normal(0, 1, (16, 2))).float() for _ in range(2))
        action = torch.tensor(generator.integers(0, 4, (16, 1)))
        reward = torch.tensor(generator.normal(1, 1, (16, 1))).float()
        ended = torch.tensor(generator.random((16, 1)) < ends).float()
        update(online, target, optimiser, (cell, action, reward, after, ended), gamma, tau)
    with torch.no_grad():
        return torch.stack([online(PROBE), target(PROBE)]).numpy()


def dueling_values(head, inputs, count):
    """What a head with given weights says of so many rows of inputs, (count, 6)."""
    one, generator = head(inputs), stream(Use.EXERCISE, inputs)
    for name, outputs in (("value", 1), ("advantage", 6)):
        layer = getattr(one, name, None)
        if not isinstance(layer, torch.nn.Linear) or layer.weight.shape != (outputs, inputs):
            asked = f"nn.Linear({inputs}, {outputs})"
            raise Unfit(f"For {inputs} inputs self.{name} must be {asked}.")
        with torch.no_grad():
            for weights in layer.parameters():
                weights.copy_(torch.tensor(generator.normal(0, 1, weights.shape)))
    return one(torch.tensor(generator.normal(0, 1, (count, inputs))).float()).detach().numpy()


def round_of(one_round, kind, seed):
    """Of one round of four UAVs: what is stored, what goes on and what was begun.

    A row each: the time left in the stored next state and in the one that goes on, whether they
    ended, and the reward.
    """
    environment, scenario = Environment(load_city("village")), find_scenario("village")
    generator, memory = stream(Use.EXERCISE, seed), []
    state = scenario.sample(environment, 4, generator)
    action = np.full(4, LAND) if kind == "land" else np.array([1, 2, 1, 2])
    if kind == "mixed":
        action[0] = LAND
    times = {"land": [9, 9, 9, 9], "crash": [1, 1, 1, 1], "mixed": [9, 1, 9, 9]}
    state = replace(state, time_left=np.array(times.get(kind, [9, 8, 7, 6]), np.int16))
    begin = functools.partial(scenario.sample, environment, generator=generator)
    after = one_round(environment, state, action, memory, begin, generator)
    if not hasattr(after, "time_left"):
        raise Unfit("Return the state with which the next round begins.")
    if len(memory) != 1 or len(memory[0]) != 4:
        raise Unfit("One round appends one tuple (s, a, r, s') to the memory.")
    stored = memory[0][3]
    if not np.array_equal(memory[0][0].time_left, state.time_left):
        raise Unfit("The first state of the tuple must be that before the step.")
    rows = [stored.time_left, stored.ended, after.time_left, after.ended, memory[0][2]]
    return np.stack([np.asarray(row, float) for row in rows])
