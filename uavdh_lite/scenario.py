"""Scenarios: what is drawn at random for each episode, and the named presets."""

from dataclasses import dataclass, replace

import numpy as np

from uavdh_lite import registry
from uavdh_lite.channel import Channel
from uavdh_lite.config import option, require, require_name
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError

LIMIT = 2**15  # of every number of a scenario: flying times are int16
MAX_DEVICES = 100  # places for devices in a state; a step takes time and memory for each
LEAST_DATA = 0.1  # data units; a saved mission keeps tenths


@dataclass(frozen=True)
class Scenario:
    """The ranges from which an episode is drawn, both ends included, and the radio channel."""

    name: str
    city: str = option("manhattan", "a shipped city, a PNG, or a folder of PNGs")
    devices: tuple[int, int] = option(
        (2, 5), "least and most number of devices", ge=1, le=MAX_DEVICES
    )
    data: tuple[float, float] = option(
        (5.0, 20.0), "least and most data of a device, data units", ge=0, le=LIMIT - 1
    )
    flying_time: tuple[int, int] = option(
        (35, 70), "least and most flying time, units of time", ge=1, le=LIMIT - 1
    )
    channel: Channel = Channel()  # noqa: RUF009 (frozen)

    def __post_init__(self):
        require(self, f"scenario {self.name}")
        require_name(self.name, "scenario")
        for name in ("devices", "data", "flying_time"):
            least, most = getattr(self, name)
            if least > most or most < LEAST_DATA:
                raise InputError(
                    f"scenario {self.name}: {name} from {least} to {most}: the first must not be "
                    f"above the second, which must be at least {LEAST_DATA}"
                )

    @property
    def max_devices(self) -> int:
        """K, the number of places for devices in a `State`."""
        return self.devices[1]

    def sample(self, environment: Environment, count: int, generator: np.random.Generator) -> State:
        """Draw the starts of `count` episodes.

        The city of each is uniform over the environment's, the start over its landing cells. The
        devices are uniform over the cells where they may stand, never two in one. Their number,
        their data and the flying time are uniform over the ranges.
        """
        city = generator.integers(0, len(environment.cities), count)  # of one: draws nothing
        device_cells = self._device_cells(environment, city, generator)
        number = generator.integers(*self.devices, count, endpoint=True)
        data = generator.uniform(*self.data, (count, self.max_devices)).astype(np.float32)
        data *= np.arange(self.max_devices) < number[:, None]
        uav_cell = one_of(environment.landing[city], generator)
        return State(
            uav_cell=uav_cell.astype(np.int16),
            time_left=generator.integers(*self.flying_time, count, np.int16, endpoint=True),
            device_cells=device_cells.astype(np.int16),
            data_initial=data,
            data_left=data.copy(),
            landed=np.zeros(count, bool),
            city=city.astype(np.int16),
        )

    def _device_cells(
        self, environment: Environment, city: np.ndarray, generator: np.random.Generator
    ) -> np.ndarray:
        """The first K of a random order of the cells for devices in each city; (B, K) ints."""
        counts = environment.open_to_devices.sum(axis=1)
        least, most = int(counts.argmin()), counts.max()
        if self.max_devices > counts[least]:
            raise InputError(
                f"scenario {self.name}: up to {self.max_devices} devices, "
                f"but {environment.cities[least].name} has {counts[least]} cells for them"
            )
        rank = generator.random((len(city), most), np.float32)
        rank[np.arange(most) >= counts[city][:, None]] = 1  # a city with fewer cells: come last
        order = rank.argsort(axis=1)[:, : self.max_devices]
        return nth_cell(environment.open_to_devices[city], order)

    def sample_anywhere(
        self,
        environment: Environment,
        count: int,
        generator: np.random.Generator,
        spare_time: int,
    ) -> State:
        """Draw episodes that are already under way, for exploring starts in training.

        The UAV is over any cell from which it can land, all equally likely. It has at least the
        time to fly home and land, and `spare_time` more; at most the scenario's longest flying
        time. Each device is already empty with probability 1/2. The rest is as in `sample`.
        """
        state = self.sample(environment, count, generator)
        uav_cell = one_of(environment.landing_distance[state.city] >= 0, generator)
        home = environment.time_to_land[state.city, uav_cell]
        most = np.maximum(self.flying_time[1], home)
        least = np.minimum(home + spare_time, most)
        time_left = generator.integers(least, most, count, np.int16, endpoint=True)
        emptied = generator.random(state.data_left.shape) < 0.5
        return replace(
            state,
            uav_cell=uav_cell.astype(np.int16),
            time_left=time_left,
            data_left=np.where(emptied, np.float32(0), state.data_left),
        )


def one_of(mask: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """For each row of a mask, (B, n), one of its cells, all equally likely; (B,) ints."""
    return nth_cell(mask, generator.integers(0, mask.sum(axis=1))[:, None])[:, 0]


def nth_cell(mask: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The cells of each row of a mask, (B, n), that have these places among them; (B, k) ints."""
    cells = np.argsort(~mask, axis=1, kind="stable")  # those in the mask come first, in order
    return np.take_along_axis(cells, index, axis=1)


for scenario in (
    Scenario("manhattan"),
    Scenario("open_field", "open_field", devices=(2, 2), data=(1.0, 25.0)),
    Scenario("village", "village", devices=(1, 2), data=(5.0, 15.0), flying_time=(20, 35)),
    Scenario("harbour", "harbour", devices=(3, 10), flying_time=(50, 150)),
    Scenario("metropolis", "metropolis", devices=(3, 10), flying_time=(100, 250)),
):
    registry.register("scenario", scenario.name, scenario)


def find_scenario(name: str) -> Scenario:
    """The preset of this name; raises `InputError` with the known names."""
    return registry.find("scenario", name)
