"""A radio that was measured or ray-traced: the SNR between two cells comes from a table.

**World and belief are two things.** The world is the environment in which a policy flies. What an
agent is told comes from an environment, too: that is its belief. They may differ. An agent flies in
a `MeasuredEnvironment` and is told what the paper's model expects, since it cannot know the table.
It may measure, though: `heard` collects what earlier flights heard, `expected` makes a belief of
it, and `believing` tells it.
"""

import hashlib
import io
import json
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.channel import Channel, rate
from uavdh_lite.city import City
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights
from uavdh_lite.storage import data_folder, write_atomically

LEAST = 20  # SNRs that are enough to fit a line to
FLOOR_DB = -30.0  # SNR below which a receiver hears nothing: a slot brings 0.0014 data units there


@dataclass(frozen=True, eq=False)
class MeasuredEnvironment(SafeEnvironment):
    """One city in which a table takes the place of path loss and shadow map; with the failsafe.

    In each slot the table is read at the cell nearest to the UAV, as the shadow map is.

    `mean_snr_db` is the table, (n, n), `[device cell, UAV cell]`, dB; −∞ where nothing is heard.
    There is no fading.

    Raises `InputError` for several cities, and for a table of another shape or with NaN.
    """

    mean_snr_db: np.ndarray = field(kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        found, cells = np.shape(self.mean_snr_db), self.size**2
        if len(self.cities) > 1 or found != (cells, cells) or np.isnan(self.mean_snr_db).any():
            raise InputError(
                f"a table of {' × '.join(map(str, found))} for {len(self.cities)} cities: must be "
                f"{cells} × {cells} for one city, without NaN; −∞ is for what nobody hears"
            )

    def snr_db(self, state: State, next_cell: np.ndarray, fading: np.ndarray) -> np.ndarray:
        first_half = 2 * np.arange(1, self.channel.slots + 1) < self.channel.slots
        nearest = np.where(first_half, state.uav_cell[:, None], next_cell[:, None])  # (B, δ)
        return self.mean_snr_db[state.device_cells[:, None], nearest[:, :, None]].astype(np.float32)

    def rate_map(self, device_cell: int, city: int = 0) -> np.ndarray:
        return rate(self.mean_snr_db[device_cell]).reshape(self.size, -1)


def distances_m(environment: Environment) -> np.ndarray:
    """From each device's cell to the UAV over each cell, m; (n, n)."""
    cells = np.indices((environment.size,) * 2).reshape(2, -1) * environment.channel.cell_size_m
    squared_m2 = ((cells[:, :, None] - cells[:, None]) ** 2).sum(axis=0)
    return np.sqrt(squared_m2 + environment.channel.altitude_m**2)


def modelled_snr_db(environment: Environment) -> np.ndarray:
    """The SNR without fading that eq. 2 has for the first city, dB; (n, n)."""
    loss_db = environment.channel.path_loss_db(distances_m(environment) ** 2, environment.sight[0])
    return environment.transmit_snr_db[0] - loss_db


def links(environment: Environment) -> np.ndarray:
    """The pairs of cells between which there may be a link in the first city; (n, n) bool."""
    return environment.open_to_devices[0][:, None] & ~environment.no_fly[0]


def levelled(environment: Environment, gain_db: np.ndarray) -> np.ndarray:
    """SNRs from gains, dB; (n, n). One offset for all gives the links in sight the model's mean.

    Raises `InputError` if no link in sight has a finite gain.
    """
    known = links(environment) & environment.sight[0] & np.isfinite(gain_db)
    if not known.any():
        raise InputError("no finite gain between two cells in sight: nothing to level it by")
    return gain_db + (modelled_snr_db(environment) - gain_db)[known].mean()


def shipped_places() -> list[str]:
    """The names of the real places that come with the package, with ray-traced gains."""
    return sorted(path.stem for path in (data_folder() / "places").glob("*.npz"))


def load_place(name: str | Path, channel: Channel | None = None) -> MeasuredEnvironment:
    """A shipped place by its name, or a city's PNG with its table of gains beside it, `.npz`.

    Of the channel, by default the paper's, the transmit power and the slots count; there is no
    fading. Raises `CityError` or `InputError` that names the file if one of the two cannot be used,
    or if the table says that it was made for other buildings, or another cell size or altitude.
    """
    path = data_folder() / "places" / f"{name}.png" if name in shipped_places() else Path(name)
    table, channel = path.with_suffix(".npz"), channel or Channel()
    if not (path.suffix or table.exists()):
        known = ", ".join(shipped_places())
        raise InputError(f"no place named {path.name!r}: give the path of a PNG, or one of {known}")
    city, (gain_db, about) = City.load(path), load_gains(table)
    right = {key: getattr(channel, key) for key in ("cell_size_m", "altitude_m")}
    right["buildings"] = buildings_fingerprint(city)
    for key, value in right.items():
        if about.get(key, value) != value:
            raise InputError(
                f"{table}: its {key} are {about[key]}, but {value} for {path.name}: take the "
                "table that belongs to it"
            )
    try:
        snr_db = levelled(SafeEnvironment(city, channel), gain_db)
        deaf = city.open_to_devices & np.isinf(gain_db).all(axis=1).reshape(city.landing.shape)
        if deaf.any():  # as where its landing zone was
            (row, col), *_ = np.argwhere(deaf)
            raise InputError(f"no gain of a device at row {row}, column {col}, where one may stand")
        return MeasuredEnvironment(city, channel, mean_snr_db=snr_db)
    except ValueError as error:
        raise InputError(f"{table}: not the gains of {path.name} ({error})") from None


def buildings_fingerprint(city: City) -> str:
    """SHA-256 of where buildings stand, by which a table of gains knows the city it is of."""
    return hashlib.sha256(bytes([city.size]) + city.buildings.tobytes()).hexdigest()


class Heard(NamedTuple):
    """What UAVs heard: N times a device's cell, the UAV's cell, and an SNR, dB; (N,) each."""

    device: np.ndarray
    uav: np.ndarray
    snr_db: np.ndarray


def heard(world: Environment, flights: Flights, generator: np.random.Generator) -> Heard:
    """What was heard of each device that had data left, once a step, at the step's end.

    A device sends a pilot, whose fading is drawn from `generator`. What is below `FLOOR_DB` counts
    as that.
    """
    found = []
    states = [step.state for step in flights.history] + [flights.end]
    for before, after in pairwise(states):
        fading = world.draw_fading(before, generator)
        snr_db = world.snr_db(before, after.uav_cell, fading)[:, -1]
        episode, device = np.nonzero((before.data_left > 0) & ~before.ended[:, None])
        cells = before.device_cells[episode, device], after.uav_cell[episode]
        found.append((*cells, np.maximum(snr_db[episode, device], FLOOR_DB)))
    return Heard(*map(np.concatenate, zip(*found, strict=True)))


def expected(
    environment: Environment, heard: Heard, nearby_cells: float | None = None
) -> MeasuredEnvironment:
    """A belief made of what was heard over the first city, instead of the channel's constants.

    To the SNRs with line of sight, and to those without, a line over log10 d is fitted: level,
    exponent α, spread σ. The SNR of the belief has the mean rate of such a link, over the spread.

    Arguments:
        environment: the city, and the channel whose lines stand in where too little was heard.
        nearby_cells: also correct the line link by link with what was heard nearby; how many cells
            away one link still tells something of another.
    """
    log_m, sight = 10 * np.log10(distances_m(environment)), environment.sight[0]
    mean_db, spread_db = modelled_snr_db(environment), environment.channel.fading_db(1, sight)
    pairs = heard.device, heard.uav
    for state in (sight, ~sight):
        of_state = state[pairs]
        if of_state.sum() >= LEAST:
            x, y = log_m[pairs][of_state], heard.snr_db[of_state]
            slope, level = np.polyfit(x, y, 1)
            mean_db = np.where(state, slope * log_m + level, mean_db)
            spread_db = np.where(state, (y - slope * x - level).std(), spread_db)
    if nearby_cells:
        error_db, count = np.zeros((2, *mean_db.shape))
        np.add.at(error_db, pairs, heard.snr_db - mean_db[pairs])
        np.add.at(count, pairs, 1)
        ground_m2 = distances_m(environment) ** 2 - environment.channel.altitude_m**2
        reach_m = nearby_cells * environment.channel.cell_size_m
        near = np.exp(-ground_m2 / (2 * reach_m**2))
        count, error_db = near @ count @ near, near @ error_db @ near
        mean_db = mean_db + error_db / (count + 1)
        spread_db = spread_db / np.sqrt(count + 1)
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    rates = rate(mean_db[..., None] + spread_db[..., None] * nodes) @ weights / weights.sum()
    with np.errstate(divide="ignore"):
        return MeasuredEnvironment(
            environment.city, environment.channel, mean_snr_db=10 * np.log10(np.exp2(rates) - 1)
        )


def believing(agent: Agent, belief: Environment) -> Agent:
    """The same network, which is told what this belief expects; it may fly in another world."""
    observation = agent.recipe.observation_for(belief, agent.observation.size)
    device = next(agent.network.parameters()).device
    return replace(agent, observation=observation.to(device))


def save_gains(path: str | Path, gain_db: np.ndarray, about: dict) -> None:
    """Write a table of gains, (n, n), `[device cell, UAV cell]`, dB, in half precision, and JSON
    values about it, atomically."""
    content, text = io.BytesIO(), np.array(json.dumps(about))
    np.savez_compressed(content, gain_db=gain_db.astype(np.float16), about=text)
    write_atomically(path, lambda file: file.write_bytes(content.getvalue()))


def load_gains(path: str | Path) -> tuple[np.ndarray, dict]:
    """Read what `save_gains` wrote; `InputError` names the file if it is none."""
    try:
        with Path(path).open("rb") as content, np.load(content, allow_pickle=False) as file:
            gain_db, about = file["gain_db"].astype(np.float32), json.loads(str(file["about"]))
        if (gain_db > 0).any():
            raise InputError("a gain above 0 dB: a path loss is a negative gain")
        return gain_db, dict(about)
    except Exception as error:  # numpy raises many types for damaged files
        raise InputError(f"{path}: not a table of gains ({error})") from None
