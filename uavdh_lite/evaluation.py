"""Monte Carlo evaluation: fly many random missions at once, and say how certain the means are."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import Environment, Outcome, Rewards, State
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream

Policy = Callable[[State], np.ndarray]
"""Actions for a batch of states: (B,) indices into `ACTIONS`.

A policy that keeps something for each episode, such as a plan, also has a method `begin(start)`. It
returns a function of (state, episodes) for the flights from `start`; `episodes` says which of them
are in the rows of `state`. `fly` calls it if it is there.
"""


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
    | `served`, `uploaded` | (T, δ) |
    | `landed` | bool |
    """

    start: State
    uav_cell: np.ndarray
    time_left: np.ndarray
    data_left: np.ndarray
    action: np.ndarray
    intervened: np.ndarray
    reward: np.ndarray
    served: np.ndarray
    uploaded: np.ndarray
    landed: bool


def alone(environment: Environment, trajectory: Trajectory) -> tuple[Environment, Trajectory]:
    """A flight over one of several cities, in the environment of that city alone."""
    if isinstance(environment.city, City):
        return environment, trajectory
    uav_cell = environment.cities.within[trajectory.uav_cell]
    environment, start = environment.alone(trajectory.start)
    return environment, replace(trajectory, start=start, uav_cell=uav_cell)


@dataclass(frozen=True)
class Flights:
    """The records of N episodes.

    | field | shape | meaning |
    | --- | --- | --- |
    | `start`, `end` | N states | first and last state |
    | `cumulative_reward` | (N,) | sum of the rewards, undiscounted |
    | `steps` | (N,) | steps flown |
    | `safety_interventions` | (N,) | how often the safety controller intervened |
    | `history` | T `Step`s | every step, if recorded |
    | `sent_home` | (N,) | how often the failsafe replaced the action; None without a failsafe |
    """

    start: State
    end: State
    cumulative_reward: np.ndarray
    steps: np.ndarray
    safety_interventions: np.ndarray
    history: list[Step]
    sent_home: np.ndarray | None = None

    @classmethod
    def of_steps(cls, start: State, end: State, history: list[Step]) -> "Flights":
        """One episode that was flown step by step, perhaps not to its end, from its `history`."""
        return cls(
            start,
            end,
            np.array([sum(float(step.reward[0]) for step in history)], np.float32),
            np.array([len(history)]),
            np.array([sum(int(step.outcome.intervened[0]) for step in history)]),
            list(history),
        )

    def records(self) -> dict[str, np.ndarray]:
        """The metrics of each episode by name; (N,) float64 each.

        `has_landed`: 1 or 0. `collection_ratio`: collected over initial data.
        `collection_ratio_and_landed`: their product (CRAL). `cumulative_reward`.
        `time_used`: steps over initial flying time. `safety_interventions`: a count. `sent_home`:
        a count, there only for flights with the failsafe.
        """
        ratio = self.end.collection_ratio.astype(float)
        records = {
            "has_landed": self.end.landed.astype(float),
            "collection_ratio": ratio,
            "collection_ratio_and_landed": ratio * self.end.landed,
            "cumulative_reward": self.cumulative_reward.astype(float),
            "time_used": self.steps / self.start.time_left,
            "safety_interventions": self.safety_interventions.astype(float),
        }
        if self.sent_home is not None:
            records["sent_home"] = self.sent_home.astype(float)
        return records

    def metrics(self) -> dict[str, Interval]:
        """The mean of each record with its 95 % interval; see `mean_interval`."""
        return {name: mean_interval(values) for name, values in self.records().items()}

    def trajectory(self, episode: int) -> Trajectory:
        """One episode step by step; needs `record=True` in `fly`."""
        if len(self.history) < self.steps[episode]:
            raise ValueError("the steps were not kept: call fly(..., record=True)")
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
            served=np.array([step.outcome.served[episode] for step in steps]),
            uploaded=np.array([step.outcome.uploaded[episode] for step in steps]),
            landed=bool(self.end.landed[episode]),
        )


def fly(
    environment: Environment,
    policy: Policy,
    start: State,
    generator: np.random.Generator,
    rewards: Rewards = Rewards(),  # noqa: B008 (frozen)
    record: bool = False,
) -> Flights:
    """Fly all episodes of `start` to their end.

    The policy is asked only about the episodes still in the air. Fading is drawn for all episodes
    in every step, so it does not depend on what the policy does: two policies with the same start
    and equal generators have the same fading.

    Arguments:
        record: keep every step, for `Flights.trajectory`.
    """
    act = policy.begin(start) if hasattr(policy, "begin") else _by_state_alone(policy)
    state = start
    total = np.zeros(len(start), np.float32)
    steps = np.zeros(len(start), int)
    interventions = np.zeros(len(start), int)
    sent_home = np.zeros(len(start), int)
    history: list[Step] = []
    while True:
        flying = np.flatnonzero(~state.ended)
        if not len(flying):
            break
        action = np.zeros(len(start), int)
        action[flying] = act(state[flying], flying)
        after, outcome = environment.step(state, action, generator)
        reward = rewards(outcome)
        if record:
            history.append(Step(state, action, outcome, reward))
        total += reward
        steps += outcome.flew
        interventions += outcome.intervened
        sent_home += outcome.sent_home
        state = after
    counted = sent_home if environment.failsafe else None
    return Flights(start, state, total, steps, interventions, history, counted)


def _by_state_alone(policy: Policy) -> Callable[[State, np.ndarray], np.ndarray]:
    return lambda state, episodes: policy(state)


def evaluate(
    environment: Environment,
    policy: Policy,
    scenario: Scenario,
    episodes: int,
    seed: int,
    use: Use = Use.TEST,
    record: bool = False,
) -> Flights:
    """Fly `episodes` random missions; the same seed draws the same missions and fading.

    The cumulative reward always has the paper's constants, so agents trained with other constants
    can be compared.
    """
    generator = stream(use, seed)
    start = scenario.sample(environment.city, episodes, generator)
    return fly(environment, policy, start, generator, record=record)


def mean_interval(values: np.ndarray) -> Interval:
    """The mean of independent values, (N,), with a 95 % interval.

    Wilson's interval if all of them are 0 or 1, the bootstrap's otherwise: the bootstrap is too
    narrow for rare events.
    """
    return wilson_interval(values) if np.isin(values, (0, 1)).all() else bootstrap_interval(values)


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


def bootstrap_interval(
    values: np.ndarray, resamples: int = 2000, groups: np.ndarray | None = None
) -> Interval:
    """The mean of independent values, (N,), with its 95 % percentile bootstrap interval.

    If all values are equal, the interval is a point; that does not mean certainty.

    Arguments:
        groups: which values belong together, (N,), such as the missions of one city. Then whole
            groups are drawn again: the interval is for missions in other cities of the same kind.
    """
    if groups is None:
        generator = stream(Use.BOOTSTRAP)
        means = [
            values[generator.integers(0, len(values), len(values))].mean() for _ in range(resamples)
        ]
    else:
        counts, sums = drawn_again(groups, resamples, np.ones(len(values)), values)
        means = sums / counts
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(float(values.mean()), float(low), float(high))


def drawn_again(groups: np.ndarray, resamples: int, *columns: np.ndarray) -> list[np.ndarray]:
    """The sum of each column, (N,), over groups that are drawn again; (resamples,) each.

    All columns get the same draws.
    """
    _, member = np.unique(groups, return_inverse=True)
    by_group = [np.bincount(member, column) for column in columns]
    count = len(by_group[0])
    drawn = stream(Use.BOOTSTRAP).integers(0, count, (resamples, count))
    return [sums[drawn].sum(axis=1) for sums in by_group]
