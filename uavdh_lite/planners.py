"""Policies to compare an agent with: random actions, and a rule that goes for what is nearest.

Neither of them learns.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uavdh_lite import registry
from uavdh_lite.city import moves_from, read_only
from uavdh_lite.environment import ACTIONS, HOVER, Environment, State
from uavdh_lite.evaluation import Policy, in_flight
from uavdh_lite.streams import Portable, Use, stream

NO_PATH = np.iinfo(np.int16).max  # stands for the number of moves where no path leads
CACHED = 2**20  # bytes; a mask of cells and goals that is larger leaves the processor's cache


class Random(Policy):
    """Every action equally likely.

    Alone, an episode has the same actions in the labs, which take the seed of its mission.

    Arguments:
        seed: of the actions, in the stream for exploration.
    """

    def __init__(self, seed: int = 0):
        self.seed, self.generator = seed, stream(Use.EXPLORATION, seed)

    def begin(self, start: State) -> Policy:
        """A policy whose draws begin anew, so that equal flights have equal actions."""
        policy = Random(self.seed)
        if len(start) == 1:
            policy.generator = Portable(Use.EXPLORATION, self.seed)
        return policy

    def act(self, state: State) -> np.ndarray:
        """Draws for the episodes that still fly; `hover` in the others."""
        return in_flight(state, lambda s: self.generator.integers(0, len(ACTIONS), len(s)))


@dataclass(frozen=True, eq=False)
class Greedy(Policy):
    """Fly to the nearest device with data left; turn back when the time just suffices to land.

    The nearest device is the one that takes the fewest moves. If a device stands where the UAV may
    not fly, the UAV flies to the cell that is nearest to it in a straight line.
    """

    environment: Environment

    def act(self, state: State) -> np.ndarray:
        environment, city, uav_cell = self.environment, state.city, state.uav_cell
        goals = self.approach[city[:, None], state.device_cells]  # (B, K)
        moves = self.moves[city[:, None], uav_cell[:, None], goals].astype(float)
        moves[state.data_left <= 0] = np.inf
        episode, nearest = np.arange(len(state)), moves.argmin(axis=1)
        action = self.towards(city, uav_cell, goals[episode, nearest])
        # What the action leads to must leave time to fly home and land.
        after = environment.next_cell[city, uav_cell, action]
        late = environment.time_to_land[city, after] > state.time_left - 1
        done = np.isinf(moves[episode, nearest])
        return np.where(done | late, environment.way_home[city, uav_cell], action)

    def towards(self, city: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """First action of a shortest path, `hover` where there is none or none is needed; (B,)."""
        ahead = self.environment.next_cell[city, start, :HOVER]
        moves_ahead = self.moves[city[:, None], ahead, goal[:, None]]
        nearer = moves_ahead < self.moves[city, start, goal][:, None]
        return np.where(nearer.any(axis=1), nearer.argmax(axis=1), HOVER)

    @cached_property
    def moves(self) -> np.ndarray:
        """Moves between all pairs of cells, `[city, start, goal]`; see `shortest_paths`."""
        size = self.environment.size
        no_fly = self.environment.no_fly.reshape(-1, size, size)
        return read_only(np.stack([*map(shortest_paths, no_fly)]))

    @cached_property
    def approach(self) -> np.ndarray:
        """The nearest cell to each one that the UAV can reach from a landing zone; (C, n) ints."""
        size = self.environment.size
        row, col = np.divmod(np.arange(size**2, dtype=np.int16), size)
        nearest = np.tile(np.arange(len(row)), (len(self.environment.cities), 1))
        for cells, moves_home in zip(nearest, self.environment.landing_distance, strict=True):
            closed, open = np.flatnonzero(moves_home < 0)[:, None], np.flatnonzero(moves_home >= 0)
            squared_distance = (row[closed] - row[open]) ** 2 + (col[closed] - col[open]) ** 2
            cells[closed[:, 0]] = open[squared_distance.argmin(axis=1)]
        return read_only(nearest)


def shortest_paths(no_fly: np.ndarray) -> np.ndarray:
    """Moves between all pairs of cells of a city, `NO_PATH` where no path leads; (n, n) int16.

    They are found for many goals at once: for as many as the processor's cache holds.

    Arguments:
        no_fly: (M, M) bool.
    """
    size, cells = len(no_fly), no_fly.size
    goals = np.eye(cells, dtype=bool).reshape(size, size, cells)  # [row, col, goal]
    moves = np.empty(goals.shape, np.int16)
    count = CACHED // cells
    for some in (slice(first, first + count) for first in range(0, cells, count)):
        moves[:, :, some] = moves_from(goals[:, :, some], ~no_fly[:, :, None])
    moves[moves < 0] = NO_PATH
    return moves.reshape(cells, cells)


registry.register("policy", "greedy", lambda environment, seed: Greedy(environment))
registry.register("policy", "random", lambda environment, seed: Random(seed))
