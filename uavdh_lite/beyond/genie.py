"""The genie: a search over whole flights that knows the channel's mean rate at every place.

No UAV knows that much. The genie's flights show what is possible, and an agent may imitate them.

It is a **beam search** with **branch and bound**. A *candidate* is the beginning of a flight: the
cell that it has led to, and the data that it has left in each device. All candidates are equally
long. In each step, every one of them tries the five moves, and most of what comes out is dropped:

```text
after 3 steps                    after 4 steps
                         ┌ north  cell  1           ✗ too far: it could not land in time
                         ├ west   cell 16           ✗ bound: whatever comes, it cannot be worth more
cell 17, left 8 0 5  ────┼ hover  cell 17, 7 0 5        than the best flight known
                         ├ east   cell 18, 8 0 3
                         └ south  cell 33, 6 0 5
cell 34, left 9 0 2  ───── west   cell 33, 9 0 1    in one cell, with the same device emptied:
cell 49, left 8 0 6  ───── north  cell 33, 8 0 5    ✗ a beam of 2: 13 left, the others 11 and 10
cell 32, left 2 7 0  ───── east   cell 33, 1 7 0    kept: another device is empty
```

So candidates compete only in one cell, and only with the same devices emptied: who has emptied the
far device has collected less by then than who served the near ones, and yet has the shorter way to
go. A candidate over a landing zone may land, and if that flight is worth more, it is the best one
known. The better this one is, the more the bound drops. So a narrow search comes first, which finds
a good flight quickly, and each later one is wider.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from uavdh_lite import registry
from uavdh_lite.channel import rate
from uavdh_lite.environment import HOVER, LAND, Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Policy

# In the widest search a cell has so many times the beam: the 2^5 sets of emptied devices that there
# are in `manhattan`. With more devices, the sets with the least data left share these.
SETS = 32
# What the first searches keep for each cell. Each is four times as wide as the one before, so that
# all of them together cost a third of the next.
NARROW = (1, 4, 16)
WIDER = 4  # the same factor for the last search's beam
BETTER = 1e-3  # data units that a better flight is worth more; what float32 rounds off is less
REPLAN = 5  # steps of a flight after which it plans again
MOST_DEVICES = 16  # with data in an episode: beyond them the bound drops too little
LEVELS = 8  # parts of a device's data in the bound's tables: more are tighter and take more memory
# Cells times sets of emptied devices that are searched together, over all episodes. After five
# moves with 10 devices an array of the data left takes 26 MB for a beam of 1.
MOST_CANDIDATES = 2**17


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned flight: an action for each unit of flying time that was left.

    From the landing on it is `land`; if no flight is known, it is always `hover`. `value` is what
    the planner maximises, −∞ if no flight is known; `beam` the width of the search that found it.
    """

    actions: np.ndarray
    value: float
    beam: int


@dataclass(frozen=True, eq=False)
class Genie(Policy):
    """A search over whole flights that knows where shadows lie and the channel's mean SNR.

    It simulates every move with the mean SNR (fading 0 dB), as the drawing at the top of this
    module shows. For each step, cell and set of emptied devices it keeps the `beam` candidates with
    the least data left, but no more than 32 times as many for each cell. The bound says what is
    lost at least from a candidate on: each device with data left costs some time, or the data. With
    `grow`, a search with four times the beam comes last.

    With `time_cost` 0.2, as in `Rewards`, it maximises the return; with a small one, the data.

    During a flight it searches again every `REPLAN` steps, from the data that is really left, with
    the beam that the episode's first plan needed, and changes its plan only for a better one.
    Asked to act without `begin`, it makes a plan and returns the first action.

    Raises `InputError` for more than 16 devices with data in an episode: there are 2^K sets of
    emptied devices, and with more of them the search takes many minutes or does not end.
    """

    environment: Environment
    beam: int = 2
    grow: bool = True
    time_cost: float = 0.2

    def begin(self, start: State) -> Policy:
        """The policy that flies the episodes of `start`; each has its own plan for the flight."""
        return _Flights(self, start)

    def act(self, state: State) -> np.ndarray:
        return self.begin(state).act(state)

    def plans(self, state: State) -> list[Plan]:
        """The best flight found for each episode; none is searched for one that is over."""
        plans = []
        for rows, problem in self._problems(state):
            times = state.time_left[rows]
            found = [Plan(np.full(time, HOVER), -np.inf, self.beam) for time in times]
            beam = np.full(len(times), self.beam)
            for per_cell in (*NARROW, None):
                found = _search(problem, found, beam, per_cell)
            plans += _search(problem, found, beam * WIDER) if self.grow else found
        return plans

    def better_plans(self, state: State, plans: list[Plan]) -> list[Plan]:
        """The rest of plans that were made earlier in these flights, or better ones."""
        better = []
        for rows, problem in self._problems(state):
            known = problem.worth(plans[rows])
            better += _search(problem, known, np.array([plan.beam for plan in known]))
        return better

    def _problems(self, state: State) -> Iterator[tuple[slice, "_Problem"]]:
        """The episodes in order, no more at a time than fit into memory."""
        devices = int((state.data_left > 0).sum(axis=1).max(initial=0))
        if devices > MOST_DEVICES:
            raise InputError(
                f"{devices} devices with data in an episode: the genie plans for at most "
                f"{MOST_DEVICES}; take fewer, or the greedy planner"
            )
        sets = min(2 ** state.data_left.shape[1], SETS)
        count = max(1, MOST_CANDIDATES // (self.environment.size**2 * sets))
        for first in range(0, len(state), count):
            rows = slice(first, first + count)
            yield rows, _Problem(self.environment, state[rows], self.time_cost)


class _Flights(Policy):
    """A genie during the flights that it began."""

    def __init__(self, genie: Genie, start: State):
        self.genie, self.start, self.plans = genie, start, genie.plans(start)

    def act(self, state: State) -> np.ndarray:
        action, flown = np.full(len(state), HOVER), self.start.time_left - state.time_left
        due = np.flatnonzero(~state.ended & (flown > 0) & (flown % REPLAN == 0))
        better = self.genie.better_plans(state[due], [self.plans[i] for i in due])
        for i, plan in zip(due, better, strict=True):
            self.plans[i] = plan
        for i in np.flatnonzero(~state.ended):
            action[i] = self.plans[i].actions[-state.time_left[i]]
        return action


class _Problem:
    """The flights from E states, with mean rates: what a move collects, and what is still possible.

    A *node* is an episode and a cell from which its UAV can fly home; there are P of them. In each
    episode the devices with data come first; K is the largest number of them. A *candidate* of a
    search is a node and the data left there, (K, n) for n candidates.
    """

    def __init__(self, environment: Environment, state: State, time_cost: float):
        self.time_cost = time_cost
        distance = environment.landing_distance[state.city]
        self.episode, cell = np.nonzero(distance >= 0)  # of each node
        node = np.full(distance.shape, -1)
        node[self.episode, cell] = np.arange(len(cell))
        self.start = node[np.arange(len(state)), state.uav_cell]
        self.start[state.ended] = -1  # as if it could not fly home
        self.home = distance[self.episode, cell]
        self.time = state.time_left[self.episode].astype(int)

        here = state.city[self.episode], cell
        next_cell = environment.next_cell[here].T[:LAND]
        self.target = node[self.episode, next_cell]  # (5, P)
        refused = environment.forbidden[here].T[:LAND]
        self.home_after = np.where(refused, np.inf, self.home[self.target])

        order = (state.data_left <= 0).argsort(axis=1, kind="stable")
        order = order[:, : max(1, (state.data_left > 0).sum(axis=1).max())]
        devices = np.take_along_axis(state.device_cells, order, axis=1)
        data = np.take_along_axis(state.data_left, order, axis=1)
        self.data = data[self.episode].T.copy()  # at the start, (K, P)
        self.total = self.data.sum(axis=0).astype(float)
        moves = replace(state, device_cells=devices)[np.tile(self.episode, LAND)]
        moves = replace(moves, uav_cell=np.tile(cell, LAND))
        quiet = np.zeros((1, environment.channel.slots, 1), np.float32)
        rates = rate(environment.snr_db(moves, next_cell.ravel(), quiet))
        # Of devices with equal rates the first has the slot. So that no two are equal:
        rates *= 1 - 1e-6 * np.arange(order.shape[1])
        self.rates = rates.transpose(1, 2, 0).copy()  # data units in a slot, (δ, K, 5P)
        self._set_bounds()

    def _set_bounds(self) -> None:
        """Tables of what each device costs at least, whatever happens to the others."""
        shape = self.data.shape
        self.part = np.maximum(self.data, np.float32(1e-9)) / LEVELS
        # The most data from one device in a flight that lands in t units of time; (K, P).
        gain = self.rates.sum(axis=0).reshape(len(self.data), LAND, -1)
        most = np.where(self.home == 0, 0, np.full(shape, -np.inf, np.float32))
        # The time to collect so many parts and land; (LEVELS, K, P).
        needed = self.part * np.arange(1, LEVELS)[:, None, None] - 1e-4
        self.needed_time = np.ones((LEVELS, *shape), np.int16)
        self.needed_time[0] += self.home.astype(np.int16)
        for _ in range(self.time.max()):
            missing = most < needed
            if not missing.any():
                break
            self.needed_time[1:] += missing
            most = (most[:, self.target] + gain).max(axis=1)
        # With so many parts left: lose one more than with one part less, or take the time for it.
        cost = self.time_cost * (self.needed_time - 1.0)
        loss = [cost[0], cost[0]]
        for more in cost[1:]:
            loss.append(np.minimum(loss[-1] + self.part, more))
        self.loss = np.array(loss, np.float32)

    def collect(self, node: np.ndarray, action: np.ndarray, left: np.ndarray) -> np.ndarray:
        """The data left after a move; (K, n). As `environment.schedule`, with mean rates."""
        left, move = left.copy(), action * len(self.home) + node
        for rates in self.rates:
            offered = rates.take(move, axis=1) * (left > 0)
            left -= np.minimum(offered, left) * (offered == offered.max(axis=0))
        return left

    def value(self, node: np.ndarray, left: np.ndarray, step: int) -> np.ndarray:
        """What flights are worth that land after so many steps; (n,)."""
        return self.total[node] - left.sum(axis=0) - self.time_cost * step

    def bound(self, node: np.ndarray, left: np.ndarray, step: int) -> np.ndarray:
        """No flight that goes on from here is worth more; (n,).

        Of all devices, one costs the most. In the time left, no device gives more than if it were
        alone.
        """
        device = np.arange(len(left))[:, None]
        level = (left / self.part.take(node, axis=1)).astype(int)
        loss = self.loss[level, device, node].max(axis=0)
        parts = (self.needed_time <= self.time - step).sum(axis=0, dtype=np.float32)
        reach = (parts * self.part).take(node, axis=1)
        short = np.maximum(left - reach, 0).sum(axis=0)
        loss = np.maximum(loss, short + self.time_cost * self.home[node])
        return self.total[node] - self.time_cost * step - loss

    def worth(self, plans: list[Plan]) -> list[Plan]:
        """The plans with their value from here on."""
        node, left = self.start, self.data[:, self.start]
        value = np.full(len(plans), -np.inf)
        times = self.time[node]
        rest = [plan.actions[-time:] for plan, time in zip(plans, times, strict=True)]
        for step, actions in enumerate(zip_longest(*rest, fillvalue=LAND)):
            action = np.array(actions)
            lands = (action == LAND) & np.isinf(value)
            value = np.where(lands, self.value(node, left, step), value)
            moved = np.where(action == LAND, HOVER, action)
            node, left = self.target[moved, node], self.collect(node, moved, left)
        return [replace(plan, value=worth) for plan, worth in zip(plans, value, strict=True)]


def _search(
    problem: _Problem, known: list[Plan], beam: np.ndarray, per_cell: int | None = None
) -> list[Plan]:
    """For each episode a better plan than the known one, or else that.

    Arguments:
        beam: (E,), candidates to keep for each node and set of emptied devices.
        per_cell: candidates to keep for each node; None for `SETS` times the beam.
    """
    value = np.array([plan.value for plan in known]) + BETTER
    most = beam * SETS if per_cell is None else np.full(len(beam), per_cell)
    node = problem.start[problem.start >= 0]
    left = problem.data[:, node]
    layers: list[tuple[np.ndarray, np.ndarray]] = []  # parent and action of each candidate
    ends: dict[int, tuple[int, int]] = {}  # step and candidate that lands, for each episode
    for step in range(problem.time.max()):
        # Land now.
        home = np.flatnonzero(problem.home[node] == 0)
        episode = problem.episode[node[home]]
        landed = problem.value(node[home], left[:, home], step)
        for i in np.unique(episode[landed > value[episode]]):
            best = np.where(episode == i, landed, -np.inf).argmax()
            value[i], ends[i] = landed[best], (step, home[best])
        # Move on.
        in_time = step + 1 + problem.home_after[:, node] < problem.time[node]
        parent, action = in_time.T.nonzero()
        left = problem.collect(node[parent], action, left.take(parent, axis=1))
        node = problem.target[action, node[parent]]
        bound = problem.bound(node, left, step + 1)
        kept = np.flatnonzero(bound > value[problem.episode[node]])
        if not len(kept):
            break
        episode = problem.episode[node[kept]]
        kept = kept[_best(node[kept], left.take(kept, axis=1), beam[episode], most[episode])]
        node, left = node[kept], left.take(kept, axis=1)
        layers.append((parent[kept], action[kept]))
    plans = list(known)
    for i, (steps, candidate) in ends.items():
        actions = np.full(problem.time[problem.start[i]], LAND)
        for step in range(steps - 1, -1, -1):
            parent, action = layers[step]
            actions[step], candidate = action[candidate], parent[candidate]
        plans[i] = Plan(actions, float(value[i]), int(beam[i]))
    return plans


def _best(node: np.ndarray, left: np.ndarray, beam: np.ndarray, per_cell: np.ndarray) -> np.ndarray:
    """Indices of the candidates with the least data left.

    There are at most `beam` for each node and set of emptied devices, and at most `per_cell` for
    each node. Equal candidates count once.
    All arrays have one entry for each candidate; `left` is (K, n).
    """
    total, sets = left.sum(axis=0), 2 ** len(left)
    group = node * sets + 2 ** np.arange(len(left)) @ (left == 0)
    order = _ranked(group, total)
    # Equal candidates become neighbours.
    alike = (np.diff(group[order]) == 0) & (np.diff(total[order]) == 0)
    tied = np.flatnonzero(np.append(False, alike) | np.append(alike, False))
    rows = order[tied]
    order[tied] = rows[np.lexsort((*left.take(rows, axis=1), total[rows], group[rows]))]
    pairs = np.flatnonzero(alike)
    again = left.take(order[pairs], axis=1) == left.take(order[pairs + 1], axis=1)
    order = np.delete(order, pairs[again.all(axis=0)] + 1)
    order = order[_rank(group[order]) < beam[order]]
    if (per_cell < beam * sets).any():
        order = order[_ranked(node[order], total[order])]
        order = order[_rank(node[order]) < per_cell[order]]
    return order


def _ranked(group: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """Indices that sort by group, then by amount; faster than to sort twice."""
    return (group + amount / (amount.max() + 1)).argsort(kind="stable")


def _rank(group: np.ndarray) -> np.ndarray:
    """The position of each entry among those of its group; `group` is sorted."""
    return np.arange(len(group)) - np.searchsorted(group, group)


registry.register("policy", "genie", lambda environment, seed: Genie(environment))
