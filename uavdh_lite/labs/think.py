"""What an agent expects at each step of its flight, and what it looks at."""

from dataclasses import replace
from typing import Any

import numpy as np

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.recipes import ImitationRecipe
from uavdh_lite.checkpoint import shipped_agents
from uavdh_lite.environment import ACTIONS, HOVER, LAND, State
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.labs.flights import Hangar, grid, says, title
from uavdh_lite.labs.state import Stage

CLOSE = 0.5  # a gap between Q-values below which a decision is called close
ENOUGH, SOON = 0.5, 3  # data units of a device that are worth a reason, and the steps until then
SPARE = 1  # units of time more than the way home takes, with which it has to fly home


def agent_of(stage: Stage, hangar: Hangar) -> str | None:
    """The agent that thinks: the first that flies, or one that knows the city, or None."""
    known = shipped_agents()
    return next((name for name in (*stage.policies, *hangar.known) if name in known), None)


def states_of(flight: Trajectory) -> State:
    """The states before each step, as one batch."""
    steps = np.zeros(len(flight.action), int)
    start = flight.start[steps]
    return State(
        flight.uav_cell[:-1],
        flight.time_left[:-1],
        start.device_cells,
        start.data_initial,
        flight.data_left[:-1],
        start.landed,
        start.city,
    )


def scene(stage: Stage, hangar: Hangar) -> dict[str, Any]:
    """The values of each step, None where an action is not allowed, and sentences.

    They are Q-values, or the scores of an agent that copies a planner.
    """
    name = agent_of(stage, hangar)
    if name is None:
        return {"agent": None}
    flight, agent, left = hangar.flight(stage, name), hangar.policy(name), stage.policies[0]
    agents = [[each, title(each)] for each in hangar.known if each in shipped_agents()]
    number = "score" if isinstance(agent.recipe, ImitationRecipe) else "Q-value"
    note = f"{says(title(left), f'has no {number}s')}: here thinks and flies the {title(name)}"
    values = agent.q_values(states_of(flight)).numpy().astype(float)
    ordered = np.sort(values, axis=1)  # what is not allowed is -inf
    gaps = ordered[:, -1] - ordered[:, -2]
    return {
        "agent": title(name),
        "note": "" if left == name else note,
        "agents": agents if left == name else [["", "choose an agent"], *agents],
        "chosen": name if left == name else "",
        "number": number,
        "actions": list(ACTIONS),
        "q": grid(values, 3),
        "gaps": np.round(np.where(np.isfinite(gaps), gaps, 999), 3).tolist(),
        "closest": int(np.where(np.isfinite(gaps), gaps, np.inf).argmin()),
        "says": [_because(hangar, flight, values, step) for step in range(len(values))],
    }


def _because(hangar: Hangar, flight: Trajectory, values: np.ndarray, step: int) -> str:
    """One sentence: what it does, what for where its flight shows it, and how sure it is."""
    action, left = int(flight.action[step]), int(flight.time_left[step])
    home, after = hangar.environment.time_to_land[0, flight.uav_cell[step : step + 2]]
    given = flight.data_left[step] - flight.data_left[step + 1 :]  # by each device, from here on
    enough = np.flatnonzero((given >= ENOUGH).any(axis=1)) + 1
    reason = ""
    if flight.intervened[step]:
        reason = ", which is refused: it stays where it is"
    elif action == LAND:
        reason = ", because all data is collected" if flight.data_left[step].sum() < 0.05 else ""
    elif flight.landed and after < home and left <= home + SPARE:
        reason = f", because home is {home} units of time away and {left} are left"
    elif step and flight.uav_cell[step + 1] == flight.uav_cell[step - 1] != flight.uav_cell[step]:
        reason = ", back to where it just was"
    elif len(enough):
        steps, device = int(enough[0]), int(given[enough[0] - 1].argmax())
        when = "in this step" if steps == 1 else f"within {steps} steps"
        gives = f"gives {given[steps - 1][device]:.1f} units {when}"
        if steps <= SOON:
            reason = f", because device {device} {gives}"
        elif action != HOVER:
            reason = f", on the way to device {device}, which {gives}"
    elif flight.landed and after < home:
        reason = f", on the way home, which is {home} units of time away; {left} are left"
    order = np.argsort(-values[step])
    best, second = values[step][order[:2]]
    name = ACTIONS[action]
    if np.isinf(second):
        return f"{name}, because nothing else is allowed in time."
    gap = best - second
    call = "a close call: " if gap < CLOSE else ""
    more = f"{gap:.1f}" if gap >= 1 else f"{gap:.2f}" if gap >= 0.005 else "less than 0.01"
    return f"{name}{reason}; {call}{more} ahead of {ACTIONS[order[1]]}."


def values(stage: Stage, hangar: Hangar, step: int) -> dict[str, Any] | None:
    """The largest Q-value if the UAV were over each cell at a step; None without an agent."""
    policy = agent_of(stage, hangar)
    if policy is None:
        return None
    flight = hangar.flight(stage, policy)
    step = min(step, len(flight.action) - 1)
    found = value_map(hangar.policy(policy), states_of(flight)[[step]])
    return {"step": step, "values": grid(found, 3)}


def value_map(agent: Agent, state: State) -> np.ndarray:
    """The largest Q-value if the UAV were over each cell, all else equal; (M, M).

    It is NaN in cells over which the UAV may not fly.

    Arguments:
        state: a batch of one.
    """
    environment = agent.environment
    cells = np.flatnonzero(~environment.no_fly[state.city[0]])
    elsewhere = replace(state[np.zeros(len(cells), int)], uav_cell=cells.astype(np.int16))
    values = np.full(environment.size**2, np.nan)
    values[cells] = agent.q_values(elsewhere).max(dim=1).values
    return values.reshape(environment.size, environment.size)
