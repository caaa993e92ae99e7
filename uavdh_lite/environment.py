"""The decision process: a batch of UAVs, each in its own episode, stepped by pure functions.

Nothing here knows about learning, and nothing loops over the batch: every array has the batch as
its first axis. B is the batch size, K the number of places for devices, δ the number of
communication slots in a mission slot, M the number of cells on a side, n the number of cells, M²,
and C the number of cities: 1, unless an agent is to learn for many.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import City, read_only
from uavdh_lite.config import option, shown
from uavdh_lite.errors import InputError
from uavdh_lite.shadowing import line_of_sight

ACTIONS = ("north", "east", "south", "west", "hover", "land")
NORTH, EAST, SOUTH, WEST, HOVER, LAND = range(6)
MOVES = read_only(np.array([(-1, 0), (0, 1), (1, 0), (0, -1), (0, 0), (0, 0)]))  # row, column

MAX_CITIES = 2**15  # of an environment: a state has int16 for the city


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
    | `city` | (B,) int16 | which of the environment's cities it is in; 0 where there is one |
    """

    uav_cell: np.ndarray
    time_left: np.ndarray
    device_cells: np.ndarray
    data_initial: np.ndarray
    data_left: np.ndarray
    landed: np.ndarray
    city: np.ndarray

    def __post_init__(self):
        for name, array in vars(self).items():
            object.__setattr__(self, name, read_only(array))

    def __len__(self) -> int:
        return len(self.uav_cell)

    def __getitem__(self, index) -> "State":
        """The episodes that `index` (a slice, a mask, an array of indices) selects."""
        return State(**{name: array[index] for name, array in vars(self).items()})

    def with_rows(self, index, rows: "State") -> "State":
        """A copy in which the episodes at `index` are replaced by `rows`."""
        copies = {name: array.copy() for name, array in vars(self).items()}
        for name, copy in copies.items():
            copy[index] = getattr(rows, name)
        return State(**copies)

    @classmethod
    def concatenate(cls, states: list["State"]) -> "State":
        """The episodes of several batches as one batch."""
        names = vars(states[0])
        return cls(**{name: np.concatenate([getattr(s, name) for s in states]) for name in names})

    @property
    def ended(self) -> np.ndarray:
        """Whether the episode is over: landed, or no flying time left; (B,) bool."""
        return self.landed | (self.time_left <= 0)

    @property
    def data_collected(self) -> np.ndarray:
        """Data collected from each device so far, data units; (B, K)."""
        return self.data_initial - self.data_left

    @property
    def collected(self) -> np.ndarray:
        """Data collected over data at the start, summed over the devices of an episode; (B,)."""
        return self.data_collected.sum(1) / self.data_initial.sum(1)


@dataclass(frozen=True)
class Outcome:
    """What happened in one step of B episodes. In an episode that is over, nothing happens.

    | field | shape | meaning |
    | --- | --- | --- |
    | `served` | (B, δ) int16 | device that had the slot, −1 for none |
    | `uploaded` | (B, δ) float32 | data units uploaded in the slot |
    | `intervened` | (B,) bool | the safety controller replaced the action by hovering |
    | `landed` | (B,) bool | the UAV landed in this step |
    | `crashed` | (B,) bool | the flying time ran out in this step without a landing |
    | `flew` | (B,) bool | the step was flown: the episode was not over before it |
    """

    served: np.ndarray
    uploaded: np.ndarray
    intervened: np.ndarray
    landed: np.ndarray
    crashed: np.ndarray
    flew: np.ndarray

    def counts(self) -> dict[str, np.ndarray]:
        """What is counted over a flight, by the name of its metric; (B,) bool each."""
        return {"safety_interventions": self.intervened}


@dataclass(frozen=True)
class Rewards:
    """The reward's constants (section II-B).

    The paper gives none of them. These are the defaults of the classes in the authors' code.
    """

    data: float = option(1.0, "reward for a data unit uploaded")
    movement: float = option(-0.2, "reward for each step without a landing, r_mov")
    safety: float = option(-1.0, "reward for an intervention of the safety controller, r_sc")
    crash: float = option(-150.0, "reward for running out of flying time, r_crash")

    def terms(self, outcome: Outcome) -> dict[str, np.ndarray]:
        """The terms of the reward by name, (B,) float32 each; their sum is the reward."""
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


REPORTED = Rewards()  # of every return that is reported, whatever an agent learns from


@dataclass(frozen=True, eq=False)
class Environment:
    """A UAV over a city collects data from devices on the ground and must land in time.

    ### Actions
    0 north, 1 east, 2 south, 3 west, 4 hover, 5 land. Each costs one unit of flying time. The
    safety controller replaces three actions by hovering: a move off the grid, a move into a no-fly
    cell, and a landing outside the landing zone.

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
    Over one city, C is 1 and an index of 0 in front of a table is all there is to know. With a
    tuple of cities, each episode of a batch is in one of them, and goes on as it would over that
    city alone: tables have the cities as their first axis. In them a smaller city lies in the
    north-west corner, with no-fly cells around it, so that all have one shape.

    Raises `InputError` for anything but cities.

    Reference: Bayerlein et al., Globecom 2020, sections II and III.
    """

    city: City | tuple[City, ...]
    channel: Channel = Channel()  # noqa: RUF009 (frozen)

    def __post_init__(self):
        self.cities  # noqa: B018 (it raises what is wrong)

    @cached_property
    def cities(self) -> tuple[City, ...]:
        """The cities, each of its own size."""
        cities = self.city if isinstance(self.city, tuple | list) else (self.city,)
        if not 1 <= len(cities) <= MAX_CITIES:
            raise InputError(f"{len(cities)} cities: an environment takes 1 to {MAX_CITIES}")
        for city in cities:
            if not isinstance(city, City):
                raise InputError(
                    f"an environment takes a City or a tuple of them, here is {shown(city)}: "
                    "City.load reads one by its name or from a PNG"
                )
        return tuple(cities)

    @cached_property
    def size(self) -> int:
        """M, the number of cells on a side of the largest city."""
        return max(city.size for city in self.cities)

    @cached_property
    def landing(self) -> np.ndarray:
        """The start and landing zones; (C, n) bool."""
        return self._layer("landing")

    @cached_property
    def no_fly(self) -> np.ndarray:
        """The cells that the UAV may not enter; (C, n) bool."""
        return self._layer("no_fly", outside=True)

    @cached_property
    def buildings(self) -> np.ndarray:
        """The cells that block radio links; (C, n) bool."""
        return self._layer("buildings")

    @cached_property
    def open_to_devices(self) -> np.ndarray:
        """Where a device may stand; (C, n) bool."""
        return self._layer("open_to_devices")

    @cached_property
    def landing_distance(self) -> np.ndarray:
        """Moves to the nearest landing cell, −1 if there is no path; (C, n) ints."""
        return self._layer("landing_distance", outside=-1)

    def _layer(self, name: str, outside: int = False) -> np.ndarray:
        """A layer of all cities, with this value around the smaller ones; (C, n)."""
        layers = [getattr(city, name) for city in self.cities]
        padded = [np.pad(a, (0, self.size - len(a)), constant_values=outside) for a in layers]
        return read_only(np.stack(padded).reshape(len(layers), -1))

    @cached_property
    def sight(self) -> np.ndarray:
        """Line of sight, `[city, device cell, UAV cell]`; (C, n, n) bool."""
        cells = self.size**2
        sight = line_of_sight(self.buildings.reshape(-1, self.size, self.size))
        return read_only(sight.reshape(-1, cells, cells))

    @cached_property
    def transmit_snr_db(self) -> np.ndarray:
        """P/σ² in each city, dB; (C,) float32."""
        snr_db = [self.channel.transmit_snr_db(city.size) for city in self.cities]
        return read_only(np.array(snr_db, np.float32))

    @cached_property
    def next_cell(self) -> np.ndarray:
        """The cell of the UAV after an action, `[city, cell, action]`; (C, n, 6) int16."""
        row, col = self._targets
        here, target = np.arange(self.size**2)[:, None], row * self.size + col
        return read_only(np.where(self.forbidden, here, target).astype(np.int16))

    @cached_property
    def forbidden(self) -> np.ndarray:
        """The actions that the safety controller replaces, `[city, cell, action]`; (C, n, 6)."""
        (row, col), layers = self._targets, self.no_fly.reshape(-1, self.size, self.size)
        closed = np.pad(layers, ((0, 0), (1, 1), (1, 1)), constant_values=True)
        forbidden = closed[:, row + 1, col + 1]
        forbidden[..., HOVER] = False
        forbidden[..., LAND] = ~self.landing
        return read_only(forbidden)

    @property
    def _targets(self) -> np.ndarray:
        """Row and column to which each action leads from each cell, off the grid too; (2, n, 6)."""
        cells = np.indices((self.size, self.size)).reshape(2, -1, 1)
        return cells + MOVES.T[:, None]

    @cached_property
    def time_to_land(self) -> np.ndarray:
        """Units of time to fly home and land, very many where there is no path; (C, n) ints."""
        distance = self.landing_distance
        return read_only(np.where(distance < 0, np.iinfo(np.int16).max, distance + 1))

    @cached_property
    def way_home(self) -> np.ndarray:
        """First action of a shortest path to a landing cell; (C, n) ints.

        It is `land` in the landing zone, and `hover` where there is no path. If several landing
        cells are equally near, the path leads to the one with the lowest number.
        """
        distance, cells = self.landing_distance, self.size**2
        action = np.where(distance == 0, LAND, HOVER)
        goal = np.where(distance == 0, np.arange(cells), cells)
        for moves in range(1, distance.max() + 1):
            city, cell = np.nonzero(distance == moves)
            ahead = self.next_cell[city, cell, :HOVER]
            nearer = distance[city[:, None], ahead] == moves - 1
            goals = np.where(nearer, goal[city[:, None], ahead], cells)
            action[city, cell], goal[city, cell] = goals.argmin(axis=1), goals.min(axis=1)
        return read_only(action)

    def allowed_actions(self, state: State) -> np.ndarray:
        """The actions that the safety controller would not replace; (B, 6) bool, never none."""
        return ~self.forbidden[state.city, state.uav_cell]

    def random_actions(self, state: State, generator: np.random.Generator) -> np.ndarray:
        """Actions of the random policy, all equally likely; (B,) ints."""
        return generator.integers(0, len(ACTIONS), len(state))

    def step(
        self, state: State, action: np.ndarray, generator: np.random.Generator
    ) -> tuple[State, Outcome]:
        """One step of all episodes with newly drawn fading: `draw_fading`, then `transition`."""
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

        Raises `InputError` for anything that is not an action.
        """
        flew = ~state.ended
        action = np.where(flew, checked_actions(action, len(state)), HOVER)
        taken = state.city, state.uav_cell, action
        next_cell, intervened = self.next_cell[taken], self.forbidden[taken]
        landed = (action == LAND) & ~intervened
        time_left = state.time_left - flew
        crashed = flew & ~landed & (time_left == 0)

        snr_db = self.snr_db(state, next_cell, fading)
        snr_db[~flew | landed | crashed] = -np.inf  # nothing is heard
        served, uploaded, data_left = schedule(snr_db, state.data_left)

        after = replace(
            state,
            uav_cell=next_cell,
            time_left=time_left,
            data_left=data_left,
            landed=state.landed | landed,
        )
        return after, Outcome(served, uploaded, intervened, landed, crashed, flew)

    def snr_db(self, state: State, next_cell: np.ndarray, fading: np.ndarray) -> np.ndarray:
        """SNR of every device in every slot of a step, dB; (B, δ, K) float32 (eq. 2).

        Arguments:
            next_cell: (B,), the UAV's cell after the step: the same, or a neighbour.
            fading: (B, δ, K), standard normal; 0 gives the mean.
        """
        channel, slots = self.channel, self.channel.slots
        share = np.arange(1, slots + 1, dtype=np.float32) / np.float32(slots)
        start, end = self._centres_m[:, state.uav_cell], self._centres_m[:, next_cell]  # (2, B)
        uav_m = start[..., None] + share * (end - start)[..., None]  # (2, B, δ)
        device_m = self._centres_m[:, state.device_cells]  # (2, B, K)
        down, right = device_m[:, :, None, :] - uav_m[..., None]
        squared_distance_m2 = np.float32(channel.altitude_m**2) + down**2 + right**2  # (B, δ, K)
        nearest = np.where(share < 0.5, state.uav_cell[:, None], next_cell[:, None])  # (B, δ)
        city = state.city[:, None, None]
        sight = self.sight[city, state.device_cells[:, None, :], nearest[:, :, None]]
        return (
            self.transmit_snr_db[city]
            - channel.path_loss_db(squared_distance_m2, sight)
            + channel.fading_db(fading, sight)
        )

    def rate_map(self, device_cell: int, city: int = 0) -> np.ndarray:
        """Data units per slot, without fading, from a device to a UAV hovering over a cell; (M, M).

        Arguments:
            city: the index of the city in which the device stands.
        """
        down, right = self._centres_m - self._centres_m[:, [device_cell]]
        squared_distance_m2 = np.float32(self.channel.altitude_m**2) + down**2 + right**2
        loss_db = self.channel.path_loss_db(squared_distance_m2, self.sight[city, device_cell])
        return rate(self.transmit_snr_db[city] - loss_db).reshape(self.size, -1)

    @cached_property
    def _centres_m(self) -> np.ndarray:
        """How far each cell's centre is to the south and to the east, m; (2, n) float32."""
        cells = np.indices((self.size, self.size), np.float32).reshape(2, -1)
        return read_only(cells * np.float32(self.channel.cell_size_m))


def schedule(
    snr_db: np.ndarray, data_left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """TDMA: each slot goes to the device with data left that has the highest SNR (eq. 3, 4).

    Arguments:
        snr_db: (B, δ, K); −∞ for a device that is not heard.
        data_left: (B, K), at the start of the mission slot.

    Returns three arrays: the device of each slot, or −1, (B, δ) int16; the data units uploaded in
    it, min(rate, data left), (B, δ); and the data left after the mission slot, (B, K).
    """
    left = data_left.copy()
    episode = np.arange(len(left))
    served = np.empty(snr_db.shape[:2], np.int16)
    uploaded = np.empty(snr_db.shape[:2], np.float32)
    for slot in range(snr_db.shape[1]):
        heard_db = np.where(left > 0, snr_db[:, slot], -np.inf)
        best = heard_db.argmax(-1)
        best_db = heard_db[episode, best]
        served[:, slot] = np.where(best_db > -np.inf, best, -1)
        uploaded[:, slot] = np.minimum(rate(best_db), left[episode, best])
        left[episode, best] -= uploaded[:, slot]
    return served, uploaded, left


def checked_actions(action: np.ndarray, count: int) -> np.ndarray:
    """The actions of `count` episodes, (B,) ints; raises `InputError` that names the episode."""
    action = np.asarray(action)
    if action.shape != (count,):
        raise InputError(f"actions of shape {action.shape}: must be ({count},), one an episode")
    whole = action.dtype.kind in "iu"  # else, such as text, it may not be comparable
    right = (action >= 0) & (action < len(ACTIONS)) if whole else np.zeros(count, bool)
    if not right.all():
        first = right.argmin()
        raise InputError(
            f"action {action[first]} of episode {first}: must be a whole number, 0 to 5"
        )
    return action
