"""The flights of one mission, each flown once, and words for them."""

import numpy as np

from uavdh_lite.environment import ACTIONS, LAND, Environment
from uavdh_lite.evaluation import Flights, Policy, Trajectory
from uavdh_lite.labs.state import LETTERS, YOU, Stage
from uavdh_lite.missions import HandFlight, Mission
from uavdh_lite.policies import find_policy, policies_for

PLANNERS = ("greedy", "random", "genie")
YOURS = {
    "flies": "fly",
    "gets": "get",
    "hovers": "hover",
    "lands": "land",
    "wants": "want",
    "spends": "spend",
    "goes": "go",
    "has no": "have no",
    "leaves": "leave",
    "wins": "win",
    "crashes": "crash",
}


def title(policy: str) -> str:
    """The name of a policy for people."""
    if policy in (YOU, *PLANNERS):
        return policy
    if policy == "any_city":
        return "any-city agent"
    if policy.endswith("_ddqn_early"):
        return "half-trained agent"
    if policy.endswith("_paper"):
        return "paper's own agent"
    return "DDQN agent" if policy.endswith("_ddqn") else "imitation agent"


def says(name: str, text: str) -> str:
    """A sentence's part about a policy, by its title: `greedy flies`, `you fly`."""
    if name == YOU:
        for theirs, yours in YOURS.items():
            text = text.replace(theirs, yours)
    return f"{'the ' if 'agent' in name else ''}{name} {text}"


class Hangar:
    """The flights of one mission, each flown when it is first asked for."""

    def __init__(self, environment: Environment, mission: Mission):
        self.environment, self.mission = environment, mission
        self.policies: dict[str, Policy] = {}
        self.known: list[str] = []  # who can fly over the city
        self._flown: dict[tuple[str, str], Trajectory] = {}  # by policy and actions

    @classmethod
    def of(cls, mission: Mission, before: "Hangar | None" = None) -> "Hangar":
        """The flights of this mission; the shadows of a city are computed once."""
        if before is None or before.mission.city is not mission.city:
            hangar = cls(Environment(mission.city), mission)
            hangar.known = policies_for(hangar.environment)
            return hangar
        if before.mission is mission:
            return before
        hangar = cls(before.environment, mission)
        hangar.policies, hangar.known = before.policies, before.known
        return hangar

    def flight(self, stage: Stage, policy: str) -> Trajectory:
        """The flight of a policy, or that by hand."""
        flown = stage.flown if policy == YOU else ""
        if (policy, flown) not in self._flown:
            if policy == YOU:
                flights = self._by_hand(flown)
            else:
                flights = self.mission.fly(self.environment, self.policy(policy))
            self._flown[policy, flown] = flights.trajectory(0)
        return self._flown[policy, flown]

    def policy(self, name: str) -> Policy:
        """The policy of this name over the city; an agent sees a city only once."""
        if name == "random":
            return find_policy(name, self.environment, self.mission.seed)
        if name not in self.policies:
            self.policies[name] = find_policy(name, self.environment)
        return self.policies[name]

    def _by_hand(self, flown: str) -> Flights:
        flight = HandFlight(self.environment, self.mission)
        for letter in flown:
            if not flight.ended:
                flight.step(LETTERS.index(letter))
        return flight.flights()


def numbers(flight: Trajectory) -> dict:
    """How a flight went: landed, collected, data, the time used and the return."""
    data, left = flight.data_left[0].sum(), flight.data_left[-1].sum()
    return {
        "landed": bool(flight.landed),
        "ended": bool(flight.landed or flight.time_left[-1] <= 0),
        "collected": float(data - left),
        "steps": len(flight.action),
        "time_left": int(flight.time_left[-1]),
        "return": float(flight.reward.sum()),
    }


def does(flight: Trajectory, step: int) -> str:
    """What a flight does in a step, in words."""
    action = int(flight.action[step])
    if flight.intervened[step]:
        return f"wants to {'land' if action == LAND else 'go ' + ACTIONS[action]} and may not"
    return ("flies north", "flies east", "flies south", "flies west", "hovers", "lands")[action]


def grid(values: np.ndarray, digits: int = 2) -> list:
    """A map as JSON values; None where it is no finite number."""
    rounded = np.round(values.astype(float), digits)
    return [[each if np.isfinite(each) else None for each in row] for row in rounded.tolist()]
