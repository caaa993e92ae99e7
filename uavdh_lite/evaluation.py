"""Monte Carlo evaluation: fly many random missions at once, and say how certain the means are."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.special import stdtrit

from uavdh_lite.city import described, fingerprint_of
from uavdh_lite.config import differences
from uavdh_lite.environment import HOVER, REPORTED, Environment, Outcome, State, checked_actions
from uavdh_lite.errors import InputError
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream


class Policy(Protocol):
    """Whatever flies a batch of episodes: an agent, a rule, a planner."""

    def begin(self, start: State) -> "Policy":
        """The policy for the flights from these states: itself, if it keeps nothing of them."""
        return self

    def act(self, state: State) -> np.ndarray:
        """An action for each episode, (B,) indices into `ACTIONS`; any one where it is over."""
        ...

    def made_for(self) -> Environment | None:
        """The environment over whose cities it flies: its own, if it has one; None for any."""
        return getattr(self, "environment", None)


def in_flight(state: State, act: Callable[[State], np.ndarray]) -> np.ndarray:
    """The actions that `act` gives for the episodes still in flight, `hover` for the others; (B,).

    Raises `InputError` if it gives anything that is not an action.
    """
    action, flying = np.full(len(state), HOVER), np.flatnonzero(~state.ended)
    if len(flying):
        action[flying] = checked_actions(act(state[flying]), len(flying))
    return action


class FunctionPolicy(Policy):
    """A policy from a function of the states in flight, (n,) states, that gives (n,) actions.

    Arguments:
        environment: the one that it is made for; None if it flies over any city.
    """

    def __init__(
        self, function: Callable[[State], np.ndarray], environment: Environment | None = None
    ):
        self.function, self.environment = function, environment

    def act(self, state: State) -> np.ndarray:
        return in_flight(state, self.function)


class Step(NamedTuple):
    """One step of B episodes: the state before it, the actions, what happened, the reward."""

    state: State
    action: np.ndarray
    outcome: Outcome
    reward: np.ndarray


class Interval(NamedTuple):
    """A mean and its 95 % confidence interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Trajectory:
    """One episode of T steps; see `State` and `Outcome` for the meaning of the fields.

    | field | shape |
    | --- | --- |
    | `start` | a batch of one |
    | `uav_cell`, `time_left` | (T + 1,) |
    | `data_left` | (T + 1, K) |
    | `action`, `intervened`, `reward` | (T,) |
    | `landed` | bool |
    """

    start: State
    uav_cell: np.ndarray
    time_left: np.ndarray
    data_left: np.ndarray
    action: np.ndarray
    intervened: np.ndarray
    reward: np.ndarray
    landed: bool


@dataclass(frozen=True, eq=False)
class Flights:
    """N episodes, from their first to their last state.

    | field | shape | meaning |
    | --- | --- | --- |
    | `start`, `end` | N states | first and last state |
    | `history` | T `Step`s | every step |
    """

    start: State
    end: State
    history: list[Step]

    @cached_property
    def returns(self) -> np.ndarray:
        """The sum of the rewards, undiscounted; (N,) float32."""
        return sum((step.reward for step in self.history), np.zeros(len(self.start), np.float32))

    @cached_property
    def steps(self) -> np.ndarray:
        """Steps flown; (N,) ints."""
        return sum((step.outcome.flew for step in self.history), np.zeros(len(self.start), int))

    @cached_property
    def counts(self) -> dict[str, np.ndarray]:
        """What `Outcome.counts` counts, summed over the steps, by name; (N,) ints each."""
        counts = {"safety_interventions": np.zeros(len(self.start), int)}
        for step in self.history:
            for name, happened in step.outcome.counts().items():
                counts[name] = counts.get(name, 0) + happened.astype(int)
        return counts

    def records(self) -> dict[str, np.ndarray]:
        """The metrics of each episode by name; (N,) float64 each.

        | metric | meaning |
        | --- | --- |
        | `landed` | 1 if the UAV landed in time, else 0 |
        | `collected` | data collected over data at the start |
        | `collected_and_landed` | the product of the two |
        | `return` | the sum of the rewards |
        | `time_used` | steps flown over flying time at the start |
        | `safety_interventions` | how often the safety controller replaced an action |
        """
        landed, collected = self.end.landed.astype(float), self.end.collected.astype(float)
        return {
            "landed": landed,
            "collected": collected,
            "collected_and_landed": collected * landed,
            "return": self.returns.astype(float),
            "time_used": self.steps / self.start.time_left,
            **{name: count.astype(float) for name, count in self.counts.items()},
        }

    def metrics(self) -> dict[str, Interval]:
        """The `mean_interval` of each metric over the episodes. Cities are drawn whole."""
        city = self.start.city
        return {name: mean_interval(values, city) for name, values in self.records().items()}

    def trajectory(self, episode: int) -> Trajectory:
        """One episode step by step."""
        steps = self.history[: self.steps[episode]]
        states = [step.state for step in steps] + [self.end]
        return Trajectory(
            start=self.start[[episode]],
            uav_cell=np.array([state.uav_cell[episode] for state in states]),
            time_left=np.array([state.time_left[episode] for state in states]),
            data_left=np.array([state.data_left[episode] for state in states]),
            action=np.array([step.action[episode] for step in steps]),
            intervened=np.array([step.outcome.intervened[episode] for step in steps]),
            reward=np.array([step.reward[episode] for step in steps]),
            landed=bool(self.end.landed[episode]),
        )


def fly(
    environment: Environment,
    policy: Policy,
    start: State,
    generator: np.random.Generator,
) -> Flights:
    """Fly all episodes of `start` to their end; rewards are `REPORTED`.

    Fading is drawn for all episodes in every step, so it does not depend on what the policy does:
    two policies with the same start and equal generators have the same fading.

    Raises `InputError` if the policy is made for other cities, or gives anything that is not an
    action.
    """
    _require_made_for(policy, environment)
    policy, state = policy.begin(start), start
    history: list[Step] = []
    while not state.ended.all():
        action = policy.act(state)
        after, outcome = environment.step(state, action, generator)
        history.append(Step(state, action, outcome, REPORTED(outcome)))
        state = after
    return Flights(start, state, history)


def _require_made_for(policy: Policy, environment: Environment) -> None:
    """Raise `InputError` if the policy is made for other cities, whose cells mean other places, or
    for another radio channel."""
    own = policy.made_for()
    if own is None or own is environment:
        return
    made_for = f"this {type(policy).__name__} is made for"
    other = "or make another policy with this environment"
    there, here = ((one.size, fingerprint_of(one.cities)) for one in (own, environment))
    if there != here:
        raise InputError(
            f"{made_for} {described(own.cities)}, not for {described(environment.cities)}: take "
            f"agent.over(city) of an agent (--city on the command line), {other}"
        )
    if found := differences(own.channel, environment.channel):
        raise InputError(
            f"{made_for} another channel, with {found}: take agent.over(city, channel) of an agent "
            f"(its options on the command line), {other}"
        )


def evaluate(
    environment: Environment,
    policy: Policy,
    scenario: Scenario,
    episodes: int,
    seed: int,
    use: Use = Use.TEST,
) -> Flights:
    """Fly `episodes` random missions; the same seed draws the same missions and fading.

    The return is of the rewards `REPORTED`, so agents trained with others compare.

    Raises `InputError` as `fly` does, and for a scenario with another channel than the environment,
    unless it is the policy's own: an agent may fly over another than it was trained with.
    """
    found = differences(scenario.channel, environment.channel)
    if found and scenario != getattr(policy, "scenario", None):
        raise InputError(
            f"scenario {scenario.name} has another channel than the environment, with {found}: "
            "take Environment(cities, channel=scenario.channel), or agent.over(city, channel)"
        )
    generator = stream(use, seed)
    start = scenario.sample(environment, episodes, generator)
    return fly(environment, policy, start, generator)


def mean_interval(values: np.ndarray, groups: np.ndarray | None = None) -> Interval:
    """The mean of values, (N,), with Wilson's interval if all are 0 or 1, else the bootstrap's.

    What is 0 or 1 says yes or no, such as `landed`. Of rare events the bootstrap would be too sure.
    Over several `groups`, such as cities, the interval is that of `groups_interval`, and does not
    leave 0 to 1 where all values are shares. A single value has none: it is a point.
    """
    several = groups is not None and len(np.unique(groups)) > 1
    if len(values) > 1 and not several and np.isin(values, (0, 1)).all():
        return wilson_interval(values)
    mean, low, high = paired_interval(values, groups)
    shares = (values >= 0).all() and (values <= 1).all()
    return Interval(mean, max(low, 0.0), min(high, 1.0)) if shares else Interval(mean, low, high)


def groups_interval(values: np.ndarray, groups: np.ndarray) -> Interval:
    """The mean of values, (N,), with a 95 % interval for other groups of the same kind.

    The values of a group, such as the missions of one city, have much in common, so that the groups
    are what was drawn. Their number decides how sure the mean is: by Student's t with one less.

    Arguments:
        groups: which values belong together, (N,); two groups at least.
    """
    mean, (_, member) = values.mean(), np.unique(groups, return_inverse=True)
    deviations = np.bincount(member, values - mean) / len(values)
    count = len(deviations)
    variance = count / (count - 1) * (deviations**2).sum()
    half = stdtrit(count - 1, 0.975) * np.sqrt(variance)
    return Interval(float(mean), float(mean - half), float(mean + half))


def wilson_interval(values: np.ndarray) -> Interval:
    """The share of ones among N zeros and ones with Wilson's 95 % score interval.

    It is not a point even if all values are equal: after 1000 landings in 1000 episodes, it says
    that at least 99.6 % of all episodes land.
    """
    count, share, z = len(values), float(values.mean()), 1.959964
    middle = share + z**2 / (2 * count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    low, high = (np.array([middle - half, middle + half]) / (1 + z**2 / count)).clip(0, 1)
    return Interval(share, float(low), float(high))


def bootstrap_interval(values: np.ndarray) -> Interval:
    """The mean of independent values, (N,), with its 95 % percentile bootstrap interval.

    If all values are equal, the interval is a point; that does not mean certainty. Raises
    `InputError` without any value.
    """
    generator, count = stream(Use.BOOTSTRAP), len(values)
    if not count:
        raise InputError("no values: there is no mean of nothing")
    means = [values[generator.integers(0, count, count)].mean() for _ in range(2000)]
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(float(values.mean()), float(low), float(high))


def paired_interval(values: np.ndarray, groups: np.ndarray | None = None) -> Interval:
    """The mean of differences, (N,), with the interval of whole groups if they are of several."""
    if groups is None or len(np.unique(groups)) < 2:
        return bootstrap_interval(values)
    return groups_interval(values, groups)
