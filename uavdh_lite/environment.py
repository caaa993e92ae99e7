"""The decision process: a batch of UAVs, each in its own episode, stepped by pure functions.

Nothing here knows about learning, and nothing loops over the batch: every array has the batch as
its first axis. B is the batch size, K the number of places for devices, δ the number of
communication slots in a mission slot, M the number of cells on a side, n the number of cells: M²,
or that of all cities together.
"""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import Cities, City, as_cities, read_only
from uavdh_lite.config import option
from uavdh_lite.errors import InputError
from uavdh_lite.shadowing import line_of_sight

ACTIONS = ("north", "east", "south", "west", "hover", "land")
NORTH, EAST, SOUTH, WEST, HOVER, LAND = range(6)
MOVES = read_only(np.array([(-1, 0), (0, 1), (1, 0), (0, -1), (0, 0), (0, 0)]))  # row, column

PAIRS = 2**25  # pairs of cells whose line of sight is computed at a time


@dataclass(frozen=True)
class State:
    """The state of B episodes; its arrays are read-only. Cells are numbers `row * M + col`.

    An episode with fewer devices than K leaves the other places without data. Over several cities,
    the cells have the numbers of `Cities`, so they say in which city an episode is; they are int32
    if int16 is too small.

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
        for name, array in vars(self).items():
            object.__setattr__(self, name, read_only(array))

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

    ### Several cities
    With `Cities` for the `city`, every episode of a batch is in a city of its own, the one in
    which its cells are. It goes on as it would over that city alone. Line of sight takes a bit for
    each pair of cells of a city, 8 kB for 16 × 16 cells, and all else about 120 bytes a cell.

    Reference: Bayerlein et al., Globecom 2020, sections II and III.
    """

    city: City | Cities
    channel: Channel = Channel()  # noqa: RUF009 (frozen)
    shadow_method: str = "exact"
    failsafe: bool = False

    @cached_property
    def cities(self) -> Cities:
        """The cities: a set of one unless `city` is one."""
        return as_cities(self.city)

    def over(self, index: int) -> "Environment":
        """The environment of one of the cities alone."""
        return replace(self, city=self.cities[index])

    def alone(self, state: State) -> tuple["Environment", State]:
        """The environment of the only city in which these episodes are, and their states in it.

        Raises `InputError` if they are in several cities.
        """
        if isinstance(self.city, City):
            return self, state
        found = np.unique(self.cities.city[state.uav_cell])
        if len(found) != 1:
            raise InputError(f"episodes in {len(found)} cities: take those of one")
        uav_cell, device_cells = (
            self.cities.within[cells].astype(np.int16)
            for cells in (state.uav_cell, state.device_cells)
        )
        return self.over(found[0]), replace(state, uav_cell=uav_cell, device_cells=device_cells)

    @cached_property
    def line_of_sight(self) -> np.ndarray:
        """Line of sight over a single city, `[device cell, uav cell]`; (M², M²) bool.

        Raises `InputError` over several cities: `over(index)` has the table of one.
        """
        if not isinstance(self.city, City):
            raise InputError("line_of_sight is of a single city: take environment.over(index)")
        cells = self.city.size**2
        sight = line_of_sight(self.city.buildings, self.shadow_method)
        return read_only(sight.reshape(cells, cells))

    @cached_property
    def _sight_bits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Line of sight as bits: a row of bytes for each device cell, with a bit for each UAV cell.

        Returns the bytes of all rows, and for each cell (n,): where its row begins as a device
        cell; and as a UAV cell, which byte of a row has its bit, and the bit alone.
        """
        cities = self.cities
        bytes_of_row = -(-(cities.sizes**2) // 8)[cities.city]
        row_of = np.cumsum(bytes_of_row) - bytes_of_row
        bits = np.empty(bytes_of_row.sum(), np.uint8)
        for part in cities.alike(PAIRS):
            packed = np.packbits(self._sight(part), axis=-1, bitorder="little")
            packed = packed.reshape(len(part), -1)
            first = row_of[cities.first_cell[part]][:, None]
            bits[first + np.arange(packed.shape[1])] = packed
        byte_of, place = np.divmod(cities.within, 8)
        bit_of = np.left_shift(1, place).astype(np.uint8)
        return read_only(bits), read_only(row_of), read_only(byte_of), read_only(bit_of)

    def _sight(self, part: np.ndarray) -> np.ndarray:
        """Line of sight in some cities of one size; (C, M², M²) bool."""
        if isinstance(self.city, City):
            return self.line_of_sight[None]
        buildings = np.stack([self.cities[index].buildings for index in part])
        sight = line_of_sight(buildings, self.shadow_method)
        cells = buildings[0].size
        return sight.reshape(len(part), cells, cells)

    @cached_property
    def next_cell(self) -> np.ndarray:
        """The cell of the UAV after an action, `[cell, action]`; (n, 6) int16 or int32."""
        return self._moves[0]

    @cached_property
    def forbidden(self) -> np.ndarray:
        """The actions that the safety controller replaces, `[cell, action]`; (n, 6) bool."""
        return self._moves[1]

    @cached_property
    def _moves(self) -> tuple[np.ndarray, np.ndarray]:
        cities = self.cities
        size = cities.sizes[cities.city][:, None]
        cell = np.arange(len(cities.city))[:, None]
        row, col = cities.row[:, None] + MOVES[:, 0], cities.col[:, None] + MOVES[:, 1]
        outside = (row < 0) | (row >= size) | (col < 0) | (col >= size)
        target = np.where(outside, cell, cell + MOVES[:, 0] * size + MOVES[:, 1])
        forbidden = outside | cities.no_fly[target]
        forbidden[:, HOVER] = False
        forbidden[:, LAND] = ~cities.landing
        next_cell = np.where(forbidden, cell, target).astype(cities.cell_type)
        return read_only(next_cell), read_only(forbidden)

    @cached_property
    def way_home(self) -> np.ndarray:
        """First action of a shortest path to a landing cell; (n,) ints.

        It is `land` in the landing zone, and `hover` where there is no path. If several landing
        cells are equally near, the path leads to the one with the lowest number.
        """
        distance = self.cities.landing_distance
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
        """Units of time to fly home and land, a large number where there is no path; (n,) ints."""
        distance = self.cities.landing_distance
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
        before = state.uav_cell.astype(int)
        sent_home = np.zeros(len(state), bool)
        if self.failsafe:
            sent_home = flew & self._too_late(state)[np.arange(len(state)), action]
            action = np.where(sent_home, self.way_home[before], action)
        taken = before * len(ACTIONS) + action
        uav_cell, intervened = self.next_cell.take(taken), self.forbidden.take(taken)
        landed = (action == LAND) & ~intervened
        time_left = state.time_left - flew
        crashed = flew & ~landed & (time_left == 0)

        snr_db = self.snr_db(state.device_cells, before, uav_cell, fading)
        served, uploaded, data_left = schedule(snr_db, state.data_left)
        silent = np.flatnonzero(~flew | landed | crashed)
        served[silent], uploaded[silent] = -1, 0
        data_left[silent] = state.data_left[silent]

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

        Inside, the batch is the last axis of all arrays: rows of five numbers would be slow.

        Arguments:
            device_cells: (B, K).
            uav_cell, next_cell: (B,), before and after the step: the same cell or neighbours.
            fading: (B, δ, K), standard normal; 0 gives the mean.
        """
        slots, width = self.channel.slots, 2 * self.cities.size - 1
        place, moves, gain_db = self._path_gain_db
        bits, row_of, byte_of, bit_of = self._sight_bits
        devices = np.array(device_cells.T, int, order="C")
        row, start = row_of.take(devices), place.take(uav_cell)
        without_sight = moves.take(place.take(next_cell) - start + width) - start
        without_sight = place.take(devices) + without_sight
        transmit = self._transmit_snr_db.take(self.cities.city.take(uav_cell))
        snr_db = np.empty((slots, *devices.shape), np.float32)
        entered = (slots + 1) // 2 - 1  # first slot with i/δ ≥ 1/2
        for cell, part in ((uav_cell, slice(entered)), (next_cell, slice(entered, slots))):
            sight = (bits.take(row + byte_of.take(cell)) & bit_of.take(cell)).astype(bool)
            entry = without_sight + sight * (gain_db.shape[1] // 2)
            deviation = self.channel.fading_db(np.float32(1), sight)
            gain_db[part].take(entry, axis=1, out=snr_db[part], mode="clip")
            snr_db[part] += transmit
            snr_db[part] += fading[:, part].transpose(1, 2, 0) * deviation
        return snr_db.transpose(2, 0, 1)

    @cached_property
    def _transmit_snr_db(self) -> np.ndarray:
        """P/σ² of each city, dB; (C,) float32."""
        sizes, city = np.unique(self.cities.sizes, return_inverse=True)
        each = [self.channel.transmit_snr_db(int(size)) for size in sizes]
        return read_only(np.array(each, np.float32)[city])

    @cached_property
    def _path_gain_db(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The path gain in dB by slot, LoS or NLoS, move and place of the device, as a table.

        Returns three arrays: the place of each cell on a map W = 2M − 1 cells wide, (n,); the entry
        of each move, by the difference of the two places + W, (2W + 1,); and the table, (δ, 2·5·W²)
        float32. A device's entry is that of the move, and its place minus that of the UAV; with
        line of sight, in the second half of the table.
        """
        slots, side = self.channel.slots, np.float32(self.channel.cell_size_m)
        size, width = self.cities.size, 2 * self.cities.size - 1
        place = self.cities.row * width + self.cities.col
        middle = (size - 1) * (width + 1)
        share = np.arange(1, slots + 1, dtype=np.float32)[:, None, None, None] / np.float32(slots)
        squared = np.full((1, 1, 1, 1), self.channel.altitude_m**2, np.float32)
        cells = np.arange(1 - size, size, dtype=np.float32) * side
        for axis, cell in enumerate((cells[:, None], cells[None, :])):
            moved = share * (MOVES[:LAND, axis, None, None].astype(np.float32) * side)
            squared = squared + (cell - moved) ** 2
        sight = np.array([False, True])[None, :, None, None, None]
        table = self.channel.path_gain_db(squared[:, None], sight).reshape(slots, -1)
        entries = np.zeros(2 * width + 1, int)
        entries[MOVES[:LAND] @ (width, 1) + width] = np.arange(LAND) * width**2 + middle
        return read_only(place), read_only(entries), read_only(table)


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
    slots, (count, devices) = snr_db.shape[1], data_left.shape
    left = np.array(data_left.T, order="C")  # the batch is last, as inside `snr_db`
    flat, episodes = left.reshape(-1), np.arange(count)
    empty_db = np.where(left > 0, np.float32(0), np.float32(-np.inf))
    countdown = np.arange(devices, 0, -1, dtype=np.int8)[:, None]
    best = np.empty((slots, count), np.int8)
    best_snr = np.empty((slots, count), snr_db.dtype)
    uploaded = np.empty((slots, count), np.float32)
    for slot in range(slots):
        snr = snr_db[:, slot].T + empty_db
        np.maximum.reduce(snr, out=best_snr[slot])
        first = (snr == best_snr[slot]) * countdown
        best[slot] = devices - np.maximum.reduce(first)  # argmax, but faster
        place = best[slot].astype(int) * count + episodes
        had = flat.take(place)
        amount = uploaded[slot] = np.minimum(rate(best_snr[slot]), had)
        remaining = had - amount
        flat[place] = remaining
        empty_db.reshape(-1)[place[remaining <= 0]] = -np.inf
    served = np.where(best_snr > -np.inf, best, np.int8(-1))
    return served.T, uploaded.T, np.ascontiguousarray(left.T)
