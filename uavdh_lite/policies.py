"""Every policy by its name: the planners, and the shipped agents."""

from collections.abc import Callable
from functools import cache

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import Cities, City
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Policy
from uavdh_lite.planners import Genie, Greedy, Random

PLANNERS: dict[str, Callable[[Environment, int], Policy]] = {
    "greedy": lambda environment, seed: Greedy(environment),
    "genie": lambda environment, seed: Genie(environment),
    "random": lambda environment, seed: Random(seed),
}


def known_policies() -> list[str]:
    """The names that `find_policy` knows."""
    return [*PLANNERS, *shipped_agents()]


def policies_for(environment: Environment) -> list[str]:
    """The names of the policies that can fly over this city: its own agents first.

    A shipped agent knows the cities it was trained for, or all of its size; the planners fly over
    any.
    """
    return [*agents_for(environment.city), *PLANNERS]


def agents_for(city: City | Cities) -> list[str]:
    """The names of the shipped agents that know this city: its own first, then those of any."""
    knowing = [name for name in shipped_agents() if _shipped(name).knows(city)]
    return sorted(knowing, key=lambda name: isinstance(_shipped(name).city, Cities))


def find_policy(name: str, environment: Environment, seed: int = 0) -> Policy:
    """The policy of this name over a city.

    Arguments:
        seed: of the policy's own random numbers; only `random` has any.

    Raises `InputError` for an unknown name, and for an agent of another city.
    """
    if name in PLANNERS:
        return PLANNERS[name](environment, seed)
    if name not in shipped_agents():
        raise InputError(f"no policy named {name!r}: choose one of {', '.join(known_policies())}")
    agent = _shipped(name)
    if not agent.knows(environment.city):
        city = environment.city.name
        raise InputError(f"agent {name} was trained in {agent.city.name}, not in {city}")
    return agent.over(environment.city)


@cache
def _shipped(name: str) -> Agent:
    return load_agent(name)
