"""Policies to compare an agent with: random, greedy-and-return, and a genie-aided search.

Each is a policy: actions for a batch of states. None of them learns.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uavdh_lite.city import read_only
from uavdh_lite.environment import ACTIONS, HOVER, LAND, Environment, State, schedule
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


@dataclass(frozen=True, eq=False)
class Genie:
    """A search over whole flights that knows where shadows lie and the channel's mean SNR.

    It simulates every move with the mean SNR (fading 0 dB). For each step, cell and set of emptied
    devices it keeps the `beam` candidates that have collected the most data, and drops those that
    cannot land in time.

    With `grow`, it searches again with four times the beam, as long as that finds a better flight
    and the beam does not exceed `widest`: memory and time grow with it. With `time_cost` 0.2, the
    paper's movement reward, it maximises the return; with a small one, the data collected.

    During a flight it plans again every `replan` steps, from the data that is really left, with the
    beam that the episode's first plan needed. Called with a state alone, it makes a plan and
    returns its first step.
    """

    environment: Environment
    beam: int = 2
    grow: bool = True
    widest: int = 128
    time_cost: float = 0.2
    replan: int = 5

    def plan(self, state: State, episode: int = 0) -> Plan:
        """The best flight found for one episode of the batch."""
        plan = self._search(state, episode, self.beam)
        while self.grow and plan.beam * 4 <= self.widest:
            wider = self._search(state, episode, plan.beam * 4)
            if wider.value <= plan.value + 1e-3:
                break
            plan = wider
        return plan

    def _search(self, state: State, episode: int, beam: int) -> Plan:
        """One search with a beam of this width."""
        city = self.environment.city
        home = city.landing_distance.ravel()
        next_cell, forbidden = self.environment.next_cell, self.environment.forbidden
        snr_db = self._mean_snr_db(state.device_cells[episode])
        total = state.data_left[episode].sum()
        time_left = int(state.time_left[episode])

        cell = state.uav_cell[[episode]].astype(int)
        left = state.data_left[[episode]]
        layers: list[tuple[np.ndarray, np.ndarray]] = []  # parent and action of each candidate
        best_value, best_end = -np.inf, None
        for step in range(time_left):
            collected = total - left.sum(axis=1)
            over_zone = np.flatnonzero(home[cell] == 0)
            if len(over_zone):  # land now
                end = over_zone[collected[over_zone].argmax()]
                value = collected[end] - self.time_cost * step
                if value > best_value:
                    best_value, best_end = value, (step, end)
            parent, action = np.divmod(np.arange(len(cell) * LAND), LAND)
            target = next_cell[cell[parent], action].astype(int)
            possible = ~forbidden[cell[parent], action]
            possible &= (home[target] >= 0) & (home[target] + 1 <= time_left - step - 1)
            # No flight can be better than to collect all by the time it is home.
            possible &= total - self.time_cost * (step + 1 + home[target]) > best_value
            parent, action, target = parent[possible], action[possible], target[possible]
            if not len(parent):
                break
            _, _, after = schedule(snr_db[cell[parent], action], left[parent])
            keep = _best(target, after, beam)
            layers.append((parent[keep], action[keep]))
            cell, left = target[keep], after[keep]
        if best_end is None:  # no landing is possible
            return Plan(np.full(time_left, HOVER), 0.0, -np.inf, beam)
        actions = self._trace(layers, best_end)
        collected = best_value + self.time_cost * best_end[0]
        return Plan(actions, float(collected), float(best_value), beam)

    def _trace(self, layers, end: tuple[int, int]) -> np.ndarray:
        """The actions that lead to a candidate, given as (step, index), and then `land`."""
        step, candidate = end
        actions = [LAND]
        for parent, action in reversed(layers[:step]):
            actions.append(action[candidate])
            candidate = parent[candidate]
        return np.array(actions[::-1])

    def _mean_snr_db(self, device_cells: np.ndarray) -> np.ndarray:
        """SNR without fading, dB, `[cell, action, slot, device]`, for all actions but landing."""
        environment = self.environment
        cells = np.repeat(np.arange(environment.city.size**2), LAND)
        target = environment.next_cell[:, :LAND].ravel()
        slots, devices = environment.channel.slots, len(device_cells)
        quiet = np.zeros((len(cells), slots, devices), np.float32)
        placed = np.broadcast_to(device_cells, (len(cells), devices))
        return environment.snr_db(placed, cells, target, quiet).reshape(-1, LAND, slots, devices)

    def __call__(self, state: State) -> np.ndarray:
        return np.array([self.plan(state, episode).actions[0] for episode in range(len(state))])

    def begin(self, start: State) -> Callable[[State, np.ndarray], np.ndarray]:
        """The function that flies the episodes of `start`; each has its own plan for the flight."""
        plans: list[Plan | None] = [None] * len(start)
        planned_at = np.zeros(len(start), int)  # the flying time left when the plan was made

        def act(state: State, episodes: np.ndarray) -> np.ndarray:
            actions = np.empty(len(state), int)
            for row, episode in enumerate(episodes):
                time_left = int(state.time_left[row])
                plan, age = plans[episode], planned_at[episode] - time_left
                if plan is None:
                    plan, age = self.plan(state, row), 0
                elif age >= min(self.replan, len(plan.actions)):
                    plan, age = self._search(state, row, plan.beam), 0
                plans[episode], planned_at[episode] = plan, time_left + age
                actions[row] = plan.actions[age]
            return actions

        return act


def _best(cell: np.ndarray, left: np.ndarray, beam: int) -> np.ndarray:
    """For each cell and set of emptied devices, the `beam` candidates with the least data left.

    Equal candidates count once. Returns their indices.
    """
    group = cell << left.shape[1] | (left == 0) @ (1 << np.arange(left.shape[1]))
    order = np.lexsort((*left.T, left.sum(axis=1), group))
    group, left = group[order], left[order]
    same = np.r_[False, group[1:] == group[:-1]]
    equal = same & np.r_[False, (left[1:] == left[:-1]).all(axis=1)]
    order, group = order[~equal], group[~equal]
    first = np.r_[True, group[1:] != group[:-1]]
    start = np.maximum.accumulate(np.where(first, np.arange(len(group)), 0))
    return order[np.arange(len(group)) - start < beam]
