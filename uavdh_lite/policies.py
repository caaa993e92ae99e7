"""Every policy by its name: the planners of the registry, and the shipped agents."""

from functools import cache

import uavdh_lite.planners  # noqa: F401 (registers its policies)
from uavdh_lite import registry
from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Policy


def known_policies() -> list[str]:
    """The names that `find_policy` knows."""
    return [*_planners(), *shipped_agents()]


def agents_for(environment: Environment) -> list[str]:
    """The names of the shipped agents that know these cities: those of any city come last."""
    knowing = [name for name in shipped_agents() if _shipped(name).knows(environment.cities)]
    return sorted(knowing, key=lambda name: len(_shipped(name).trained_in))


def find_policy(name: str, environment: Environment, seed: int = 0) -> Policy:
    """The policy of this name over an environment's cities and channel.

    Arguments:
        seed: of the policy's own random numbers; only `random` has any.

    Raises `InputError` for an unknown name, and for an agent of other cities.
    """
    if name in _planners():
        return registry.find("policy", name)(environment, seed)
    if name not in shipped_agents():
        raise InputError(f"no policy named {name!r}: choose one of {', '.join(known_policies())}")
    agent = _shipped(name)
    if not agent.knows(environment.cities):
        trained, found = agent.trained_in[0].name, environment.cities[0].name
        choices = ", ".join([*agents_for(environment), *_planners()])
        raise InputError(f"agent {name} was trained in {trained}, not in {found}: take {choices}")
    return agent.over(environment.city, environment.channel)


def _planners() -> list[str]:
    """The planners by name, in an order that does not depend on what was imported first."""
    return sorted(registry.names("policy"), key=lambda name: (name != "greedy", name))


@cache
def _shipped(name: str) -> Agent:
    return load_agent(name)
