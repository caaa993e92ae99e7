"""The decision process: a batch of UAVs, each in its own episode, stepped by pure functions.

Nothing here knows about learning, and nothing loops over the batch: every array has the batch as
its first axis. B is the batch size, K the number of places for devices, δ the number of
communication slots in a mission slot, M the number of cells on a side.
"""

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import City, read_only
from uavdh_lite.config import option
from uavdh_lite.shadowing import line_of_sight

ACTIONS = ("north", "east", "south", "west", "hover", "land")
NORTH, EAST, SOUTH, WEST, HOVER, LAND = range(6)
MOVES = read_only(np.array([(-1, 0), (0, 1), (1, 0), (0, -1), (0, 0), (0, 0)]))  # row, column


@dataclass(frozen=True)
class State:
    """The state of B episodes; its arrays are read-only. Cells are numbers `row * M + col`.

    An episode with fewer devices than K leaves the other places without data.

    | field | shape | meaning |
    | --- | --- | --- |
    | `uav_cell` | (B,) int16 | where the UAV is |
    | `time_left` | (B,) int16 | remaining flying time b, units of time |
    | `device_cells` | (B, K) int16 | where the devices are |
    | `data_initial` | (B, K) float32 | data of each device at the start, data units |
    | `data_left` | (B, K) float32 | data not yet collected, data units |
    | `landed` | (B,) bool | whether the UAV has landed |
    """

    uav_cell: np.ndarray
    time_left: np.ndarray
    device_cells: np.ndarray
    data_initial: np.ndarray
    data_left: np.ndarray
    landed: np.ndarray

    def __post_init__(self):
        for f in fields(self):
            object.__setattr__(self, f.name, read_only(getattr(self, f.name)))

    def __len__(self) -> int:
        return len(self.uav_cell)

    def __getitem__(self, index) -> "State":
        """The episodes that `index` (a slice, a mask, an array of indices) selects."""
        return State(*(getattr(self, f.name)[index] for f in fields(self)))

    def with_rows(self, index, rows: "State") -> "State":
        """A copy in which the episodes at `index` are replaced by `rows`."""
        copies = []
        for f in fields(self):
            copy = getattr(self, f.name).copy()
            copy[index] = getattr(rows, f.name)
            copies.append(copy)
        return State(*copies)

    @classmethod
    def concatenate(cls, states: list["State"]) -> "State":
        """The episodes of several batches as one batch."""
        return cls(*(np.concatenate([getattr(s, f.name) for s in states]) for f in fields(cls)))

    @property
    def ended(self) -> np.ndarray:
        """Whether the episode is over: landed, or no flying time left; (B,) bool."""
        return self.landed | (self.time_left <= 0)

    @property
    def data_collected(self) -> np.ndarray:
        """Data collected from each device so far, data units; (B, K)."""
        return self.data_initial - self.data_left

    @property
    def collection_ratio(self) -> np.ndarray:
        """Data collected over data at the start, summed over the devices of an episode; (B,)."""
        return self.data_collected.sum(1) / self.data_initial.sum(1)


@dataclass(frozen=True)
class Outcome:
    """What happened in one step of B episodes. In an episode that is over, nothing happens.

    | field | shape | meaning |
    | --- | --- | --- |
    | `served` | (B, δ) int8 | device that had the slot, −1 for none |
    | `uploaded` | (B, δ) float32 | data units uploaded in the slot |
    | `intervened` | (B,) bool | the safety controller replaced the action by hovering |
    | `landed` | (B,) bool | the UAV landed in this step |
    | `crashed` | (B,) bool | the flying time ran out in this step without a landing |
    | `flew` | (B,) bool | the step was flown: the episode was not over before it |
    | `sent_home` | (B,) bool | the failsafe replaced the action by the way home |
    """

    served: np.ndarray
    uploaded: np.ndarray
    intervened: np.ndarray
    landed: np.ndarray
    crashed: np.ndarray
    flew: np.ndarray
    sent_home: np.ndarray = field(default_factory=lambda: np.zeros((), bool))


@dataclass(frozen=True)
class Rewards:
    """The reward's constants. The defaults are the paper's; `crash` is from the authors' code."""

    data: float = option(1.0, "reward for a data unit uploaded")
    movement: float = option(-0.2, "reward for every step that does not land, r_mov")
    safety: float = option(-1.0, "reward for an intervention of the safety controller, r_sc")
    crash: float = option(-150.0, "reward for running out of flying time, r_crash")

    def terms(self, outcome: Outcome) -> dict[str, np.ndarray]:
        """The terms of the reward by name, (B,) float32 each; their sum is the reward (eq. 9)."""
        return {
            "data": np.float32(self.data) * outcome.uploaded.sum(1),
            "movement": np.where(
                outcome.flew & ~outcome.landed, np.float32(self.movement), np.float32(0)
            ),
            "safety": np.where(outcome.intervened, np.float32(self.safety), np.float32(0)),
            "crash": np.where(outcome.crashed, np.float32(self.crash), np.float32(0)),
        }

    def __call__(self, outcome: Outcome) -> np.ndarray:
        """The reward of each episode's step; (B,) float32."""
        first, *others = self.terms(outcome).values()
        return sum(others, start=first)


@dataclass(frozen=True, eq=False)
class Environment:
    """A UAV over a city collects data from devices on the ground and must land in time.

    ### Actions
    0 north, 1 east, 2 south, 3 west, 4 hover, 5 land. Each costs one unit of flying time. The
    safety controller replaces three actions by hovering: a move off the grid, a move into a no-fly
    cell, and a landing outside the landing zone.

    With `failsafe` it also brings the UAV home, like the return-to-home function of drones. If an
    action would make a landing impossible in the time left, the first move of a shortest path home
    replaces it. This costs no reward. So no policy crashes in an episode in which a landing is
    possible at all. The paper has no such guard: its agents learn to land.

    ### Channel
    While the UAV moves or hovers there are δ communication slots. In slot i it is at
    p(t) + (i/δ)(p(t+1) − p(t)). The shadow map is read at the nearest cell; half-way between two
    cells, at the one being entered. Of the devices with data left, the one with the highest SNR
    gets the slot and uploads min(rate, data left). Every device and slot has a new fading draw.
    Nothing is uploaded in the step that ends the episode.

    ### Episode end
    The UAV lands, or its flying time reaches 0 (a crash).

    ### Reward
    The environment returns an `Outcome`; `Rewards` computes the reward from it.

    Reference: Bayerlein et al., Globecom 2020, sections II and III.
    """

    city: City
    channel: Channel = Channel()  # noqa: RUF009 (frozen)
    shadow_method: str = "exact"
    failsafe: bool = False

    @cached_property
    def line_of_sight(self) -> np.ndarray:
        """Line of sight, `[device cell, uav cell]`; (M², M²) bool."""
        cells = self.city.size**2
        sight = line_of_sight(self.city.buildings, self.shadow_method)
        return read_only(sight.reshape(cells, cells))

    @cached_property
    def next_cell(self) -> np.ndarray:
        """The cell of the UAV after an action, `[cell, action]`; (M², 6) int16."""
        return self._moves[0]

    @cached_property
    def forbidden(self) -> np.ndarray:
        """The actions that the safety controller replaces, `[cell, action]`; (M², 6) bool."""
        return self._moves[1]

    @cached_property
    def _moves(self) -> tuple[np.ndarray, np.ndarray]:
        size = self.city.size
        cell = np.arange(size**2)[:, None]
        row, col = cell // size + MOVES[:, 0], cell % size + MOVES[:, 1]
        outside = (row < 0) | (row >= size) | (col < 0) | (col >= size)
        target = np.where(outside, cell, row * size + col)
        forbidden = outside | self.city.no_fly.ravel()[target]
        forbidden[:, HOVER] = False
        forbidden[:, LAND] = ~self.city.landing.ravel()
        next_cell = np.where(forbidden, cell, target).astype(np.int16)
        return read_only(next_cell), read_only(forbidden)

    @cached_property
    def way_home(self) -> np.ndarray:
        """First action of a shortest path to a landing cell; (M²,) ints.

        It is `land` in the landing zone, and `hover` where there is no path. If several landing
        cells are equally near, the path leads to the one with the lowest number.
        """
        distance = self.city.landing_distance.ravel()
        none = len(distance)
        action = np.where(distance == 0, LAND, HOVER)
        goal = np.where(distance == 0, np.arange(none), none)
        for moves in range(1, distance.max() + 1):
            cells = np.flatnonzero(distance == moves)
            ahead = self.next_cell[cells, :HOVER]
            goals = np.where(distance[ahead] == moves - 1, goal[ahead], none)
            action[cells], goal[cells] = goals.argmin(axis=1), goals.min(axis=1)
        return read_only(action)

    @cached_property
    def time_to_land(self) -> np.ndarray:
        """Units of time to fly home and land, a large number where there is no path; (M²,) ints."""
        distance = self.city.landing_distance.ravel()
        return read_only(np.where(distance < 0, np.iinfo(np.int16).max, distance + 1))

    def allowed_actions(self, state: State) -> np.ndarray:
        """The actions that the safety controller would not replace; (B, 6) bool, never none."""
        allowed = ~self.forbidden[state.uav_cell]
        return allowed & ~self._too_late(state) if self.failsafe else allowed

    def _too_late(self, state: State) -> np.ndarray:
        """The actions that miss the last chance to land; (B, 6) bool.

        A refused action counts as `hover`. If no landing is possible any more, there are none.
        """
        cell, time_left = state.uav_cell, state.time_left[:, None]
        possible = self.time_to_land[cell][:, None] <= time_left
        after = self.time_to_land[self.next_cell[cell]] <= time_left - 1
        after[:, LAND] |= ~self.forbidden[cell, LAND]
        return possible & ~after

    @cached_property
    def _centre_m(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column coordinates of the cell centres, m; two (M²,) float32."""
        rows, cols = np.indices((self.city.size,) * 2, np.float32).reshape(2, -1)
        side = np.float32(self.channel.cell_size_m)
        return read_only(rows * side), read_only(cols * side)

    def step(
        self, state: State, action: np.ndarray, generator: np.random.Generator
    ) -> tuple[State, Outcome]:
        """One step of all episodes with newly drawn fading: `draw_fading`, then `transition`.

        Arguments:
            state: B episodes.
            action: (B,) ints, indices into `ACTIONS`.
        """
        return self.transition(state, action, self.draw_fading(state, generator))

    def draw_fading(self, state: State, generator: np.random.Generator) -> np.ndarray:
        """Standard normal draws for one step, one for each slot and device; (B, δ, K) float32."""
        shape = (len(state), self.channel.slots, state.device_cells.shape[1])
        return generator.standard_normal(shape, np.float32)

    def transition(
        self, state: State, action: np.ndarray, fading: np.ndarray
    ) -> tuple[State, Outcome]:
        """One step of all episodes; those already over stay as they are.

        Arguments:
            state: B episodes.
            action: (B,) ints, indices into `ACTIONS`.
            fading: (B, δ, K), standard normal, from `draw_fading`.
        """
        flew = ~state.ended
        action = np.where(flew, action, HOVER)
        sent_home = np.zeros(len(state), bool)
        if self.failsafe:
            sent_home = flew & self._too_late(state)[np.arange(len(state)), action]
            action = np.where(sent_home, self.way_home[state.uav_cell], action)
        uav_cell = self.next_cell[state.uav_cell, action]
        intervened = self.forbidden[state.uav_cell, action]
        landed = (action == LAND) & ~intervened
        time_left = state.time_left - flew
        crashed = flew & ~landed & (time_left == 0)

        connected = flew & ~landed & ~crashed
        snr_db = self.snr_db(state.device_cells, state.uav_cell, uav_cell, fading)
        served, uploaded, left = schedule(snr_db, state.data_left * connected[:, None])
        data_left = np.where(connected[:, None], left, state.data_left)

        after = State(
            uav_cell,
            time_left,
            state.device_cells,
            state.data_initial,
            data_left,
            state.landed | landed,
        )
        return after, Outcome(served, uploaded, intervened, landed, crashed, flew, sent_home)

    def snr_db(self, device_cells, uav_cell, next_cell, fading) -> np.ndarray:
        """SNR of every device in every slot of a step, dB; (B, δ, K) float32 (eq. 2, 3).

        Arguments:
            device_cells: (B, K).
            uav_cell, next_cell: (B,), before and after the step.
            fading: (B, δ, K), standard normal; 0 gives the mean.
        """
        slots = self.channel.slots
        share = (np.arange(1, slots + 1, dtype=np.float32) / slots)[:, None]
        squared = np.float32(self.channel.altitude_m**2)
        for centre in self._centre_m:
            start = centre[uav_cell][:, None, None]
            uav = start + share * (centre[next_cell][:, None, None] - start)
            squared = squared + (uav - centre[device_cells][:, None, :]) ** 2
        los = np.empty(squared.shape, bool)
        entered = (slots + 1) // 2 - 1  # first slot with i/δ ≥ 1/2
        los[:, :entered] = self.line_of_sight[device_cells, uav_cell[:, None]][:, None]
        los[:, entered:] = self.line_of_sight[device_cells, next_cell[:, None]][:, None]
        mean = self.channel.mean_snr_db(squared, los, self.city.size)
        return mean + self.channel.fading_db(fading, los)


def schedule(
    snr_db: np.ndarray, data_left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """TDMA: each slot goes to the device with the highest SNR among those with data left.

    Arguments:
        snr_db: (B, δ, K).
        data_left: (B, K), at the start of the mission slot.

    Returns three arrays: the device of each slot, or −1, (B, δ) int8; the data units uploaded in
    it, min(rate, data left), (B, δ); and the data left after the mission slot, (B, K).
    """
    data_left = data_left.copy()
    episodes = np.arange(len(data_left))
    served = np.empty(snr_db.shape[:2], np.int8)
    uploaded = np.empty(snr_db.shape[:2], np.float32)
    for slot in range(snr_db.shape[1]):
        snr = np.where(data_left > 0, snr_db[:, slot], -np.inf)
        best = snr.argmax(1)
        best_snr = snr[episodes, best]
        amount = np.minimum(rate(best_snr), data_left[episodes, best])
        data_left[episodes, best] -= amount
        served[:, slot] = np.where(best_snr > -np.inf, best, -1)
        uploaded[:, slot] = amount
    return served, uploaded, data_left
