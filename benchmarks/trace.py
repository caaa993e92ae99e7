"""Ray tracing by Sionna RT: a place in a scene becomes a city, and a table of gains beside it.

    python benchmarks/trace.py munich --centre=20,40 --out data/places/munich.png

Needs the extra `sionna`; on a CPU also LLVM 17 or later, whose library `DRJIT_LIBLLVM_PATH` names.
"""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

from uavdh_lite.beyond.measured import buildings_fingerprint, save_gains
from uavdh_lite.bridges.footprints import city_of_shares
from uavdh_lite.city import City
from uavdh_lite.errors import InputError, extra

with extra("sionna"):
    import mitsuba as mi
    from sionna import rt

POINTS = 5  # on a side of a cell at which its height is taken
LEVEL_M = 0.5  # what rises less above the ground is none of the buildings
MOST_RELIEF_M = 5.0  # between the lowest and the highest ground, since the UAV's plane is level


@dataclass(frozen=True)
class Place:
    """A square in a scene, and how its radio is traced; x is east, y is north."""

    scene: str  # that Sionna ships, or the path of an XML file
    centre: tuple[float, float] = (0.0, 0.0)  # x and y, m
    size: int = 16  # cells on a side
    cell_size_m: float = 10.0
    altitude_m: float = 10.0  # of the UAV above the ground
    device_height_m: float = 1.5
    frequency_hz: float = 3.5e9
    rays: int = 1_000_000  # from each device
    depth: int = 5  # most reflections of a ray


class Tracer:
    """A place whose scene is loaded.

    | attribute | shape | meaning |
    | --- | --- | --- |
    | `height_m` | (M, M, 5, 5) | how high something stands at points of each cell, m; 0: nothing |

    Raises `InputError` for a scene that cannot be loaded, for a place that is not on its ground,
    and for one whose ground is not nearly level.
    """

    def __init__(self, place: Place):
        self.place, path = place, getattr(rt.scene, place.scene, place.scene)
        try:
            self._scene = scene = rt.load_scene(path)
        except Exception as error:  # of the XML's parser, or Mitsuba's for a mesh that is not there
            raise InputError(f"{path}: no scene that can be traced ({error})") from None
        scene.frequency = place.frequency_hz
        scene.tx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
        scene.add(rt.Transmitter("device", position=[0, 0, 0]))
        along = (np.arange(place.size * POINTS) + 0.5) * place.cell_size_m / POINTS
        along -= place.size * place.cell_size_m / 2
        x, y = np.meshgrid(place.centre[0] + along, place.centre[1] - along)
        shape = (place.size, POINTS, place.size, POINTS)  # rows and columns of cells and of points
        self._x, self._y = (points.reshape(shape).swapaxes(1, 2) for points in (x, y))
        self._ground_m = self._first_hit(down=False)
        self.height_m = self._first_hit(down=True) - self._ground_m
        where = f"place around {place.centre} in {place.scene}"
        if np.isnan(self._ground_m).any():
            raise InputError(f"{where}: reaches beyond the scene's ground")
        if np.ptp(self._ground_m) > MOST_RELIEF_M:
            raise InputError(
                f"{where}: its ground rises by {np.ptp(self._ground_m):.1f} m, at most "
                f"{MOST_RELIEF_M:g} m can be traced, because the UAV flies level"
            )

    def city(self, name: str, landing: int) -> City:
        """The place as a city; its landing zone are the free cells nearest to the middle."""
        tall, built = (
            (self.height_m > limit).mean(axis=(2, 3)) for limit in (self.place.altitude_m, LEVEL_M)
        )
        return city_of_shares(name, tall, built, landing)

    def gains(self, city: City) -> np.ndarray:
        """The gains between all cells, `[device cell, UAV cell]`, dB; (n, n), −∞ without any ray.

        Rows of cells where no device may stand are −∞. Steps are half a decibel.
        """
        gain_db = np.full((city.size**2,) * 2, -np.inf, np.float32)
        for cell in tqdm(np.flatnonzero(city.open_to_devices), unit="device"):
            gain_db[cell] = np.round(2 * self._gains_from(int(cell))) / 2
        return gain_db

    def _gains_from(self, cell: int) -> np.ndarray:
        """The gain from a device in a cell to a UAV in each, the mean over what is open of it, dB.

        The device stands on the ground as near to the cell's middle as it can.
        """
        place = self.place
        row, col = divmod(cell, place.size)
        ground = self.height_m[row, col] <= LEVEL_M
        off_centre = np.abs(np.arange(POINTS) - POINTS // 2)
        where = np.where(ground, np.hypot(off_centre[:, None], off_centre), np.inf).argmin()
        point = (row, col, *divmod(int(where), POINTS))
        height_m = self._ground_m[point] + place.device_height_m
        device = self._scene.transmitters["device"]
        device.position = mi.Point3f(*map(float, (self._x[point], self._y[point], height_m)))
        side, step = place.size * place.cell_size_m, place.cell_size_m
        traced = rt.RadioMapSolver()(
            self._scene,
            center=mi.Point3f(*place.centre, float(self._ground_m.mean()) + place.altitude_m),
            orientation=mi.Point3f(0, 0, 0),
            size=mi.Point2f(side, side),
            cell_size=mi.Point2f(step, step),
            samples_per_tx=place.rays,
            max_depth=place.depth,
            refraction=False,
            diffraction=True,
        )
        gain = np.array(traced.path_gain)[0, ::-1]  # the first row is now that of the north
        open_share = (self.height_m < place.altitude_m).mean(axis=(2, 3))
        gain = np.divide(gain, open_share, out=np.zeros_like(gain), where=open_share > 0)
        with np.errstate(divide="ignore"):
            return 10 * np.log10(gain.ravel())

    def _first_hit(self, down: bool) -> np.ndarray:
        """The height of what a ray from above, or from below, meets first, m; NaN for nothing."""
        scene, count = self._scene.mi_scene, self._x.size
        start = scene.bbox().max.z + 1 if down else scene.bbox().min.z - 1
        origin = mi.Point3f(self._x.ravel(), self._y.ravel(), np.full(count, start))
        hit = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(0, 0, -1 if down else 1)))
        height_m = np.where(np.array(hit.is_valid()), np.array(hit.p.z), np.nan)
        return height_m.reshape(self._x.shape)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", help="one that Sionna ships, or the path of an XML file")
    parser.add_argument("--centre", default="0,0", help="X,Y of the place's middle, m")
    parser.add_argument("--cells", type=int, default=16, help="on a side, of 10 m each")
    parser.add_argument("--rays", type=int, default=Place.rays, help="from each device")
    parser.add_argument("--landing-cells", type=int, default=6)
    parser.add_argument("--out", type=Path, default=Path("place.png"), help="the city's PNG")
    options = parser.parse_args(arguments)
    x, y = map(float, options.centre.split(","))
    table = options.out.with_suffix(".npz")
    if table.exists():
        parser.error(f"{table} exists, and took long: name another file with --out")
    try:
        tracer = Tracer(Place(options.scene, (x, y), options.cells, rays=options.rays))
    except InputError as error:
        parser.error(str(error))
    city, place = tracer.city(options.out.stem, options.landing_cells), asdict(tracer.place)
    about = {**place, "buildings": buildings_fingerprint(city)}
    city.save(options.out)
    save_gains(table, tracer.gains(city), about)
    print(city.text, f"{options.out}, {table}", sep="\n")


if __name__ == "__main__":
    main()
