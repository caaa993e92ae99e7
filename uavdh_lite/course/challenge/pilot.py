"""The process of one submission: it loads the policy, and answers states with actions.

The referee starts it as `python -m uavdh_lite.course.challenge.pilot SUBMISSION CITY`. What the
policy prints goes to stderr, so that it cannot disturb the messages on stdout.
"""

import os
import runpy
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.course.challenge.wire import receive, send
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError


def load_policy(submission: Path, environment: Environment) -> Callable[[State], np.ndarray]:
    """The policy of a Python file with `policy(environment, state)`, or of a checkpoint."""
    if submission.suffix == ".py":
        names = runpy.run_path(str(submission))
        if not callable(names.get("policy")):
            raise InputError(f"{submission.name} has no function policy(environment, state)")
        return partial(names["policy"], environment)
    from uavdh_lite.checkpoint import load_agent  # a policy without a network needs no PyTorch

    agent = load_agent(submission)
    if not agent.knows(environment.city):
        raise InputError(
            f"{submission.name} was trained in another city than {environment.city.name}"
        )
    return agent


def main(submission: str, city: str) -> None:
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    environment = Environment(City.load(city))
    policy = load_policy(Path(submission), environment)
    send(answers)  # ready
    while True:
        try:
            state = State(**receive(sys.stdin.buffer))
        except EOFError:
            return
        action = policy(state)
        if np.asarray(action).dtype == object:
            sys.exit(f"policy gave back {type(action).__name__}, expected an array of actions")
        send(answers, action=np.asarray(action))


if __name__ == "__main__":
    main(*sys.argv[1:])
