"""Policies to compare an agent with: random, greedy-and-return, and a genie-aided search.

Each is a policy: actions for a batch of states. None of them learns.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from uavdh_lite.channel import rate
from uavdh_lite.city import read_only
from uavdh_lite.environment import ACTIONS, HOVER, LAND, Environment, State
from uavdh_lite.streams import Use, stream

PAIRS = 2**22  # pairs of cells whose paths are searched at a time


class Random:
    """Every action equally likely.

    Arguments:
        seed: of the actions, in the stream for exploration.
    """

    def __init__(self, seed: int = 0):
        self.generator = stream(Use.EXPLORATION, seed)

    def __call__(self, state: State) -> np.ndarray:
        return self.generator.integers(0, len(ACTIONS), len(state))


@dataclass(frozen=True, eq=False)
class Greedy:
    """Fly to the nearest device with data left; turn back when the time just suffices to land.

    The nearest device is the one that takes the fewest moves. If a device stands where the UAV may
    not fly, the UAV flies to the cell that is nearest to it in a straight line.
    """

    environment: Environment

    def __call__(self, state: State) -> np.ndarray:
        environment = self.environment
        episodes, uav_cell = np.arange(len(state)), state.uav_cell
        goals = self._approach[state.device_cells]
        moves = self._moves(uav_cell[:, None], goals).astype(float)
        moves[state.data_left <= 0] = np.inf
        nearest = moves.argmin(axis=1)
        done = np.isinf(moves[episodes, nearest])
        action = self._towards(uav_cell, goals[episodes, nearest])
        # What the action leads to must leave time to fly home and land.
        after = environment.next_cell[uav_cell, action]
        late = environment.cities.landing_distance[after] + 1 > state.time_left - 1
        return np.where(done | late, environment.way_home[uav_cell], action)

    def _moves(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Moves from cells to others of the same city; a large number where there is no path."""
        distance, start_of_row = self._distance
        return distance[start_of_row[start] + self.environment.cities.within[goal]]

    def _towards(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """First action of a shortest path, (B,); hover where there is no path."""
        ahead = self._moves(self.environment.next_cell[start, :HOVER], goal[:, None])
        nearer = ahead < self._moves(start, goal)[:, None]
        return np.where(nearer.any(axis=1), nearer.argmax(axis=1), HOVER)

    @cached_property
    def _distance(self) -> tuple[np.ndarray, np.ndarray]:
        """Moves between all pairs of cells of a city, one city's pairs after the other's, int16;
        and where the row of each cell starts in it.

        All shortest paths together. Each round finds those that are one move longer, for the goals
        as bits of a byte; a pair's distance is the number of rounds that have not reached it.
        """
        cities = self.environment.cities
        width = (cities.sizes**2)[cities.city]
        start = np.cumsum(width) - width
        distance = np.empty(width.sum(), np.int16)
        for part in cities.alike(PAIRS):
            count = int(cities.sizes[part[0]]) ** 2
            cells = (cities.first_cell[part][:, None] + np.arange(count)).ravel()
            row = np.zeros(len(cities.city), int)
            row[cells] = np.arange(len(cells))
            ahead = row[self.environment.next_cell[cells, :HOVER]]
            goals = np.eye(count, dtype=bool)[cities.within[cells]] & ~cities.no_fly[cells, None]
            reached = np.packbits(goals, axis=1)
            moves = np.zeros((len(cells), count), np.int16)
            while True:
                missing = np.unpackbits(~reached, axis=1, count=count)
                grown = reached | np.bitwise_or.reduce([reached[to] for to in ahead.T])
                if np.array_equal(grown, reached):
                    break
                moves += missing
                reached = grown
            moves[missing.astype(bool)] = np.iinfo(np.int16).max
            distance[start[cells][:, None] + np.arange(count)] = moves
        return read_only(distance), read_only(start)

    @cached_property
    def _approach(self) -> np.ndarray:
        """For each cell, the nearest one of its city that the UAV can reach from the landing zone;
        (n,)."""
        cities = self.environment.cities
        approach = np.empty(len(cities.city), int)
        for part in cities.alike(PAIRS):
            size = int(cities.sizes[part[0]])
            cells = cities.first_cell[part][:, None] + np.arange(size**2)
            row, col = np.divmod(np.arange(size**2), size)
            squared = (row[:, None] - row) ** 2 + (col[:, None] - col) ** 2
            reachable = cities.landing_distance[cells] >= 0
            squared = np.where(reachable[:, None], squared, np.iinfo(squared.dtype).max)
            approach[cells] = cities.first_cell[part][:, None] + squared.argmin(axis=2)
        return read_only(approach)


@dataclass(frozen=True)
class Plan:
    """A planned flight: its actions, and the data it collects at the channel's mean rates.

    `value` is what the planner maximises; `beam` the width of the search that found the flight.
    """

    actions: np.ndarray
    collected: float
    value: float
    beam: int


SETS = 32  # for each cell, a search keeps this many times its beam: all sets of 5 devices
NARROW = (1, 4, 16)  # what the first searches keep for each cell
BETTER = 1e-3  # a flight must be worth that much more than the best one known
LEVELS = 8  # parts of a device's data in the tables of the bound
TOGETHER = 2**17  # cells times sets of emptied devices that are searched together


@dataclass(frozen=True, eq=False)
class Genie:
    """A search over whole flights that knows where shadows lie and the channel's mean SNR.

    It simulates every move with the mean SNR (fading 0 dB). For each step, cell and set of emptied
    devices it keeps the `beam` candidates that have collected the most data, but no more than 32
    times as many for each cell. It drops those that cannot land in time, and those that cannot beat
    the best flight known (branch and bound): each device with data left costs some time, or the
    data. Narrow searches come first, to know a good flight early.

    With `grow`, it searches again with four times the beam, as long as that finds a better flight
    and the beam does not exceed `widest`: memory and time grow with it. With `time_cost` 0.2, the
    paper's movement reward, it maximises the return; with a small one, the data collected.

    During a flight it searches again every `replan` steps, from the data that is really left, with
    the beam that the episode's first plan needed, and changes its plan only for a better one.
    Called with a state alone, it makes a plan and returns its first step.
    """

    environment: Environment
    beam: int = 2
    grow: bool = True
    widest: int = 8
    time_cost: float = 0.2
    replan: int = 5

    def plan(self, state: State, episode: int = 0) -> Plan:
        """The best flight found for one episode of the batch."""
        return self.plans(state[[episode]])[0]

    def plans(self, state: State) -> list[Plan]:
        """The best flight found for each episode of the batch."""
        return self._in_parts(state, lambda part: self._first_plans(state[part]))

    def _in_parts(self, state: State, plan: Callable[[np.ndarray], list[Plan]]) -> list[Plan]:
        """The plans that `plan` makes for the episodes of each part, in the order of `state`."""
        plans: dict[int, Plan] = {}
        for part in self._parts(state):
            plans |= zip(part.tolist(), plan(part), strict=True)
        return [plans[episode] for episode in range(len(state))]

    def _first_plans(self, state: State) -> list[Plan]:
        problem = _Problem(*self.environment.alone(state), self.time_cost)
        plans = [Plan(np.full(time, HOVER), 0.0, -np.inf, self.beam) for time in state.time_left]
        beams = np.full(len(state), self.beam)
        for per_cell in (*NARROW, None):
            plans = self._search(problem, plans, beams, per_cell)
        while self.grow and 0 < beams.max() * 4 <= self.widest:
            beams = beams * 4
            wider = self._search(problem, plans, beams)
            better = np.array([new is not old for new, old in zip(wider, plans, strict=True)])
            plans, beams = wider, np.where(better, beams, 0)  # no beam: not searched again
        return plans

    def _search(
        self, problem: "_Problem", plans: list[Plan], beams: np.ndarray, per_cell: int | None = None
    ) -> list[Plan]:
        """For each episode a better plan, found with a beam of its width, or else the old plan."""
        value = np.array([plan.value for plan in plans]) + BETTER
        episode = np.flatnonzero((beams > 0) & (problem.start_cell >= 0))
        cell, left = problem.start_cell[episode], problem.data[:, episode]
        layers: list[tuple[np.ndarray, np.ndarray]] = []  # parent and action of each candidate
        ends: dict[int, tuple[int, int]] = {}
        for step in range(problem.time.max()):
            # Land now.
            over = np.flatnonzero(problem.home[cell] == 0)
            landed = problem.value(episode[over], left[:, over], step)
            for i in np.unique(episode[over[landed > value[episode[over]]]]):
                row = np.where(episode[over] == i, landed, -np.inf).argmax()
                value[i], ends[i] = landed[row], (step, int(over[row]))
            # Move on.
            possible = problem.can_be_better(episode, cell, step, value)
            parent, action = possible.nonzero()
            if not len(parent):
                break
            episode, cell = episode[parent], cell[parent]
            left = problem.collect(episode, cell, action, left.take(parent, axis=1))
            cell = problem.target[cell, action]
            hope = problem.bound(episode, cell, left, step + 1) > value[episode]
            kept = np.flatnonzero(hope)
            episode, cell, left = episode[kept], cell[kept], left.take(kept, axis=1)
            place, beam = episode * len(problem.home) + cell, beams[episode]
            most = beam * SETS if per_cell is None else np.full(len(beam), per_cell)
            best = _best(place, left, beam, most)
            episode, cell, left = episode[best], cell[best], left.take(best, axis=1)
            layers.append((parent[kept[best]], action[kept[best]]))
        plans = list(plans)
        for i, end in ends.items():
            actions = _trace(layers, end)
            collected = value[i] + self.time_cost * end[0]
            plans[i] = Plan(actions, float(collected), float(value[i]), int(beams[i]))
        return plans

    def __call__(self, state: State) -> np.ndarray:
        return np.array([plan.actions[0] for plan in self.plans(state)])

    def begin(self, start: State) -> Callable[[State, np.ndarray], np.ndarray]:
        """The function that flies the episodes of `start`; each has its own plan for the flight."""
        plans: dict[int, Plan] = {}
        planned_at = np.zeros(len(start), int)  # the flying time left when the plan was made

        def act(state: State, episodes: np.ndarray) -> np.ndarray:
            new = np.array([episode not in plans for episode in episodes])
            age = np.where(new, 0, planned_at[episodes] - state.time_left)
            due = age >= self.replan
            rest = []
            for episode, steps in zip(episodes[due], age[due], strict=True):
                plan = plans[episode]
                rest.append(replace(plan, actions=plan.actions[steps:]))
            age[due] = 0
            planned_at[episodes] = state.time_left + age
            plans.update(zip(episodes[new], self.plans(state[new]), strict=True))
            plans.update(zip(episodes[due], self._better_plans(state[due], rest), strict=True))
            return np.array([plans[e].actions[a] for e, a in zip(episodes, age, strict=True)])

        return act

    def _parts(self, state: State) -> Iterator[np.ndarray]:
        """The episodes that are searched together, as indices: over one city, and no more than fit
        into memory."""
        cities = self.environment.cities
        sets = min(2 ** state.data_left.shape[1], SETS)
        city = cities.city[state.uav_cell]
        for one in np.unique(city):
            episodes = np.flatnonzero(city == one)
            count = max(1, TOGETHER // (int(cities.sizes[one]) ** 2 * sets))
            yield from (episodes[i : i + count] for i in range(0, len(episodes), count))

    def _better_plans(self, state: State, plans: list[Plan]) -> list[Plan]:
        """The plans for the flight from here, or better ones."""

        def better(part: np.ndarray) -> list[Plan]:
            problem = _Problem(*self.environment.alone(state[part]), self.time_cost)
            known = problem.expect([plans[episode] for episode in part])
            return self._search(problem, known, np.array([plan.beam for plan in known]))

        return self._in_parts(state, better)


class _Problem:
    """The flights from E states, with mean rates: what a move collects, and what is still possible.

    The C cells from which a landing cell can be reached have numbers of their own. In each episode
    the devices with data come first; K is the largest number of them. A candidate of a search is an
    episode, a cell and the data left, (K, n) for n candidates.
    """

    def __init__(self, environment: Environment, state: State, time_cost: float):
        home = environment.city.landing_distance.ravel()
        cells = np.flatnonzero(home >= 0)
        index = np.full(len(home), -1)
        index[cells] = np.arange(len(cells))
        self.time_cost = time_cost
        self.time = state.time_left.astype(int)
        self.start_cell = index[state.uav_cell]
        self.home = home[cells]
        self.target = index[environment.next_cell[cells, :LAND]]
        after = np.where(environment.forbidden[cells, :LAND], np.iinfo(np.int16).max, 0)
        self.home_after = after + self.home[self.target]

        order = (state.data_left <= 0).argsort(axis=1, kind="stable")
        order = order[:, : max(1, (state.data_left > 0).sum(axis=1).max())]
        self.data = np.take_along_axis(state.data_left, order, axis=1).T.copy()  # (K, E)
        self.total = self.data.sum(axis=0).astype(float)
        devices = np.take_along_axis(state.device_cells, order, axis=1)
        self.rates = self._mean_rates(environment, cells, devices)
        self._set_bounds()

    def _mean_rates(self, environment, cells, devices) -> np.ndarray:
        """Data units in a slot without fading; (δ, K, E·C·actions)."""
        episodes, K = devices.shape
        moves = len(cells) * LAND
        placed = np.repeat(devices, moves, axis=0)
        cell = np.tile(np.repeat(cells, LAND), episodes)
        target = np.tile(environment.next_cell[cells, :LAND].ravel(), episodes)
        quiet = np.zeros((len(cell), environment.channel.slots, K), np.float32)
        snr_db = environment.snr_db(placed, cell, target, quiet)
        return rate(np.ascontiguousarray(snr_db.transpose(1, 2, 0)))

    def _set_bounds(self) -> None:
        """Tables of what each device costs at least, whatever happens to the others."""
        cells, (K, episodes) = len(self.home), self.data.shape
        part = self.data[:, :, None] / LEVELS
        # The most data from one device in a flight that lands in t units of time; (K, E, C).
        rates = self.rates.sum(axis=0).reshape(K, episodes, cells, LAND)
        rates = np.ascontiguousarray(np.moveaxis(rates, 3, 0))
        most = np.full((K, episodes, cells), -np.inf, np.float32)
        most[..., self.home == 0] = 0
        # The time to collect so many parts and land.
        needed = part * np.arange(1, LEVELS)[:, None, None, None] - 1e-4
        self.needed_time = np.ones((LEVELS, K, episodes, cells), np.int16)
        self.needed_time[0] += self.home.astype(np.int16)
        for _ in range(self.time.max()):
            missing = most < needed
            if not missing.any():
                break
            self.needed_time[1:] += missing
            ahead = (most.take(self.target[:, a], axis=2) + rates[a] for a in range(LAND))
            most = np.maximum.reduce(list(ahead))
        # With so many parts left: lose one more than with one part less, or take the time for it.
        cost = self.time_cost * (self.needed_time - 1.0)
        loss = [cost[0], cost[0]]
        for more in cost[1:]:
            loss.append(np.minimum(loss[-1] + part, more))
        self.loss = np.array(loss, np.float32)
        self.part = part
        scale = np.where(self.data > 0, LEVELS / np.maximum(self.data, 1e-9), 0)
        self.scale = scale.astype(np.float32)

    def can_be_better(self, episode, cell, step: int, value) -> np.ndarray:
        """The moves after which a landing in time is possible, and worth it; (n, actions) bool."""
        landing = step + 1 + self.home_after[cell]  # steps before the landing
        in_time = landing < self.time[episode, None]
        # No flight can be better than to collect all by the time it is home.
        most = self.total[episode, None] - self.time_cost * landing
        return in_time & (most > value[episode, None])

    def collect(self, episode, cell, action, left) -> np.ndarray:
        """The data left after a move; (K, n). As `environment.schedule`, with mean rates."""
        left = left.copy()
        move = (episode * len(self.home) + cell) * LAND + action
        for rates in self.rates:
            offered = rates.take(move, axis=1) * (left > 0)
            served = offered == offered.max(axis=0)
            free = ~served[0]
            for device in served[1:]:  # one device a slot: the first of those with equal rates
                device &= free
                free &= ~device
            left -= np.minimum(offered, left) * served
        return left

    def value(self, episode, left, step: int) -> np.ndarray:
        """What flights are worth that land after so many steps; (n,)."""
        return self.total[episode] - left.sum(axis=0) - self.time_cost * step

    def bound(self, episode, cell, left, step: int) -> np.ndarray:
        """No flight that goes on from here is worth more; (n,).

        Of all devices, one costs the most. In the time left, no device gives more than if it were
        alone.
        """
        column = episode * len(self.home) + cell
        level = (left * self.scale.take(episode, axis=1)).astype(int)
        device = np.arange(len(left))[:, None]
        loss = self.loss[level, device, episode, cell].max(axis=0)
        parts = (self.needed_time <= (self.time - step)[:, None]).sum(axis=0)
        reach = (parts * self.part).astype(np.float32).reshape(len(left), -1)
        short = np.maximum(left - reach.take(column, axis=1), 0).sum(axis=0)
        loss = np.maximum(loss, short + self.time_cost * self.home[cell])
        return self.total[episode] - self.time_cost * step - loss

    def expect(self, plans: list[Plan]) -> list[Plan]:
        """The plans with what they are worth from here on."""
        length = max(len(plan.actions) for plan in plans)
        actions = np.array([np.resize(plan.actions, length) for plan in plans])
        episode, cell, left = np.arange(len(plans)), self.start_cell, self.data
        known = [replace(plan, value=-np.inf, collected=0.0) for plan in plans]
        for step, action in enumerate(actions.T):
            lands = action[episode] == LAND
            values = self.value(episode, left, step)
            for i, value in zip(episode[lands], values[lands], strict=True):
                collected = float(value + self.time_cost * step)
                known[i] = replace(plans[i], value=float(value), collected=collected)
            episode, cell, left = episode[~lands], cell[~lands], left[:, ~lands]
            if not len(episode):
                break
            left = self.collect(episode, cell, action[episode], left)
            cell = self.target[cell, action[episode]]
        return known


def _trace(layers: list[tuple[np.ndarray, np.ndarray]], end: tuple[int, int]) -> np.ndarray:
    """The actions that lead to a candidate, given as (step, index), and then `land`."""
    step, candidate = end
    actions = [LAND]
    for parent, action in reversed(layers[:step]):
        actions.append(action[candidate])
        candidate = parent[candidate]
    return np.array(actions[::-1])


def _best(
    place: np.ndarray, left: np.ndarray, beam: np.ndarray, per_cell: np.ndarray
) -> np.ndarray:
    """Indices of the candidates with the least data left.

    There are at most `beam` for each place and set of emptied devices, and at most `per_cell` for
    each place. Equal candidates count once.

    Arguments:
        place: (n,) ints, of episode and cell.
        left: (K, n).
        beam, per_cell: (n,) ints, the same for all candidates of a place.
    """
    K = len(left)
    total = left.sum(axis=0)
    group = place << K | (1 << np.arange(K)) @ (left == 0)
    order = _ranked(group, total)
    group, ranked = group[order], total[order]
    alike = (group[1:] == group[:-1]) & (ranked[1:] == ranked[:-1])
    if alike.any():  # only now compare device by device
        tied = np.flatnonzero(np.r_[alike, False] | np.r_[False, alike])
        rows = order[tied]
        order[tied] = rows[np.lexsort((*left.take(rows, axis=1), ranked[tied], group[tied]))]
        pairs = np.flatnonzero(alike)
        pair = left.take(order[pairs], axis=1) == left.take(order[pairs + 1], axis=1)
        alike[pairs] = pair.all(axis=0)
        different = np.r_[True, ~alike]
        order, group = order[different], group[different]
    order = order[_rank(group) < beam[order]]
    if (per_cell < beam << K).any():
        order = order[_ranked(place[order], total[order])]
        order = order[_rank(place[order]) < per_cell[order]]
    return order


def _ranked(group: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """Indices that sort by group, then by amount."""
    if group.max(initial=0) < 2**31:  # both in one number: floats from 0 on sort like their bits
        return (group << 32 | amount.view(np.int32)).argsort(kind="stable")
    return np.lexsort((amount, group))


def _rank(group: np.ndarray) -> np.ndarray:
    """The position of each entry in its group; equal groups stand together."""
    first = np.r_[True, group[1:] != group[:-1]][: len(group)]
    index = np.arange(len(group))
    return index - np.maximum.accumulate(np.where(first, index, 0))
