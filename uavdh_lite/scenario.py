"""Scenarios: what is drawn at random for each episode, and the named presets."""

from dataclasses import dataclass, replace

import numpy as np

from uavdh_lite.city import CellsByCity, Cities, City, as_cities
from uavdh_lite.config import option
from uavdh_lite.environment import State
from uavdh_lite.errors import InputError


@dataclass(frozen=True)
class Scenario:
    """The ranges from which an episode is drawn, both ends included."""

    name: str
    city: str = option("manhattan", "a shipped city, a PNG, a folder of PNGs, or random:COUNT:SEED")
    devices: tuple[int, int] = option((2, 5), "least and most number of devices")
    data: tuple[float, float] = option((5.0, 20.0), "least and most data of a device, data units")
    flying_time: tuple[int, int] = option((35, 70), "least and most flying time, units of time")

    def __post_init__(self):
        for name, least in (("devices", 1), ("data", 0), ("flying_time", 1)):
            low, high = getattr(self, name)
            if not least <= low <= high:
                raise InputError(
                    f"scenario {self.name}: {name} from {low} to {high}: "
                    f"the first must be at least {least} and not above the second"
                )
        if self.data[1] <= 0:
            raise InputError(f"scenario {self.name}: data up to {self.data[1]}: must be positive")
        if self.flying_time[1] >= 2**15:
            raise InputError(f"scenario {self.name}: flying_time must be below {2**15}")

    @property
    def max_devices(self) -> int:
        """K, the number of places for devices in a `State`."""
        return self.devices[1]

    def sample(self, city: City | Cities, count: int, generator: np.random.Generator) -> State:
        """Draw the starts of `count` episodes.

        The city of each is uniform over the cities, if there are several. The start is uniform over
        its landing cells. The devices are uniform over the cells where they may stand, never two
        in one. Their number, their data and the flying time are uniform over the ranges.
        """
        cities = as_cities(city)
        city_index = generator.integers(0, len(cities), count)  # draws nothing for a single one
        device_cells = self._device_cells(cities, city_index, generator)
        number = generator.integers(*self.devices, count, endpoint=True)
        data = generator.uniform(*self.data, (count, self.max_devices)).astype(np.float32)
        data *= np.arange(self.max_devices) < number[:, None]
        uav_cell = _choose(cities.landing_cells, city_index, generator)
        return State(
            uav_cell=uav_cell.astype(cities.cell_type),
            time_left=generator.integers(*self.flying_time, count, np.int16, endpoint=True),
            device_cells=device_cells.astype(cities.cell_type),
            data_initial=data,
            data_left=data.copy(),
            landed=np.zeros(count, bool),
        )

    def _device_cells(
        self, cities: Cities, city_index: np.ndarray, generator: np.random.Generator
    ) -> np.ndarray:
        """The first K of a random order of the cells for devices in each city; (B, K) ints."""
        cells, starts, counts = cities.device_cells
        least = int(counts.argmin())
        if self.max_devices > counts[least]:
            raise InputError(
                f"scenario {self.name}: up to {self.max_devices} devices, "
                f"but {cities[least].name} has {counts[least]} cells for them"
            )
        most = counts.max()
        rank = generator.random((len(city_index), most), np.float32)
        if most > counts[least]:  # the places beyond those of a smaller city come last
            rank[np.arange(most) >= counts[city_index][:, None]] = 1
        order = rank.argsort(axis=1)[:, : self.max_devices]
        return cells[starts[city_index][:, None] + order]

    def sample_anywhere(
        self,
        city: City | Cities,
        count: int,
        generator: np.random.Generator,
        spare_time: int,
    ) -> State:
        """Draw episodes that are already under way, for exploring starts in training.

        Three things differ from `sample`. The UAV may be over any cell from which it can land. Its
        flying time is uniform, from what the way home and the landing take plus `spare_time` to
        the scenario's longest. Each device is already empty with probability 1/2.
        """
        cities = as_cities(city)
        state = self.sample(cities, count, generator)
        uav_cell = _choose(cities.home_cells, cities.city[state.uav_cell], generator)
        home = cities.landing_distance[uav_cell] + 1
        most = np.maximum(self.flying_time[1], home)
        least = np.minimum(home + spare_time, most)
        time_left = generator.integers(least, most, count, np.int16, endpoint=True)
        emptied = generator.random(state.data_left.shape) < 0.5
        return replace(
            state,
            uav_cell=uav_cell.astype(cities.cell_type),
            time_left=time_left,
            data_left=np.where(emptied, np.float32(0), state.data_left),
        )


def _choose(
    among: CellsByCity, city_index: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    """For each city of `city_index`, one of its cells, all equally likely; (B,) ints."""
    return among.cells[among.starts[city_index] + generator.integers(0, among.counts[city_index])]


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("manhattan"),
        Scenario("open_field", "open_field", devices=(2, 2), data=(1.0, 25.0)),
        Scenario("village", "village", devices=(1, 2), data=(5.0, 15.0), flying_time=(20, 35)),
        Scenario("harbour", "harbour", devices=(3, 10), flying_time=(50, 150)),
        Scenario("metropolis", "metropolis", devices=(3, 10), flying_time=(100, 250)),
        Scenario(
            "any_city", "random:2000:0", devices=(1, 6), data=(1.0, 25.0), flying_time=(20, 70)
        ),
        Scenario(
            "any_size",
            "random:1000:0:8-50",
            devices=(1, 10),
            data=(1.0, 25.0),
            flying_time=(20, 250),
        ),
    )
}


def find_scenario(name: str) -> Scenario:
    """The preset of this name; raises `InputError` with the known names."""
    if name not in SCENARIOS:
        raise InputError(f"unknown scenario {name!r}: choose one of {', '.join(SCENARIOS)}")
    return SCENARIOS[name]


def scenario_for(city: str) -> Scenario:
    """The preset of a city's name, or else that for any city."""
    return SCENARIOS.get(city, SCENARIOS["any_city"])


def place(
    city: City,
    uav: tuple[int, int],
    devices: list[tuple[int, int]],
    data: list[float],
    flying_time: int,
    max_devices: int,
) -> State:
    """The start of an episode that you set yourself; a batch of one.

    Arguments:
        uav, devices: cells as (row, column).
        data: data units of each device.
        flying_time: units of time.
        max_devices: K, the number of places for devices.

    Raises `InputError`, naming the device or cell, for anything that cannot be flown.
    """
    if not 1 <= len(devices) <= max_devices:
        change = "take some away" if devices else "add one"
        raise InputError(
            f"{len(devices)} devices: this scenario takes 1 to {max_devices}; {change}"
        )
    if len(data) != len(devices):
        raise InputError(f"{len(devices)} devices but {len(data)} amounts of data: give one each")
    if not 1 <= flying_time < 2**15:
        raise InputError(f"flying time {flying_time}: must be at least 1 and below {2**15}")
    uav_cell = _cell(city, uav, "the UAV")
    if city.no_fly.ravel()[uav_cell]:
        raise InputError(f"the UAV cannot start at {tuple(uav)}, a no-fly cell: move it")
    device_cells = np.zeros((1, max_devices), np.int16)
    data_initial = np.zeros((1, max_devices), np.float32)
    for k, (device, amount) in enumerate(zip(devices, data, strict=True)):
        cell = _cell(city, device, f"device {k}")
        if city.buildings.ravel()[cell]:
            raise InputError(f"device {k} stands on a building at {tuple(device)}: move it")
        if city.landing.ravel()[cell]:
            raise InputError(f"device {k} stands in the landing zone at {tuple(device)}: move it")
        if cell in device_cells[0, :k]:
            raise InputError(
                f"device {k} is at {tuple(device)}, where another device stands: move one of them"
            )
        if not 0 <= amount < np.inf:
            raise InputError(f"device {k} has {amount} data units: must be 0 or more")
        device_cells[0, k], data_initial[0, k] = cell, amount
    if not data_initial.any():
        raise InputError("no device has data: give at least one a positive amount")
    return State(
        np.array([uav_cell], np.int16),
        np.array([flying_time], np.int16),
        device_cells,
        data_initial,
        data_initial.copy(),
        np.array([False]),
    )


def _cell(city: City, cell: tuple[int, int], what: str) -> int:
    row, col = cell
    if not (0 <= row < city.size and 0 <= col < city.size):
        size = f"{city.size} × {city.size} cells"
        raise InputError(
            f"{what} at {tuple(cell)} is outside the city of {size}: rows and columns go from 0 to "
            f"{city.size - 1}"
        )
    return int(row) * city.size + int(col)
