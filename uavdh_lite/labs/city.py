"""City editor: paint a city, see at once what is missing, let planners fly in it, save it."""

import base64
import html
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.city import COLOURS, LAYERS, City, shipped_cities
from uavdh_lite.environment import Environment
from uavdh_lite.errors import CityError, InputError, extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.views import Map, policy_title
from uavdh_lite.labs.widgets import CellPicker, status
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import draw_city, png
from uavdh_lite.policies import PLANNERS, agents_for, find_policy
from uavdh_lite.scenario import Scenario

with extra("notebooks"):
    import ipywidgets

LARGEST = 50  # cells on a side; in larger cities, planners take minutes
TRAIN = "python -m uavdh_lite train --city my_city.png --devices {devices} --out runs/my_city"
FINE_TUNE = "python -m uavdh_lite train --from any_city --city my_city.png --out runs/my_city"
BRUSHES = {
    "free": 0,
    "no-fly zone": 1,
    "low building": 2,
    "landing zone": 3,
    "tall building": 4,
}
UPLOAD_BYTES = 100_000


class Draft:
    """Kinds of cells on a square grid: a city that may still be incomplete.

    Arguments:
        kinds: (M, M) indices into `city.KINDS`.
    """

    def __init__(self, kinds: np.ndarray):
        self.kinds = np.array(kinds, np.uint8)

    @classmethod
    def blank(cls, size: int) -> "Draft":
        """Free cells only."""
        return cls(np.zeros((size, size), np.uint8))

    @classmethod
    def from_png(cls, data: bytes) -> "Draft":
        """The city of an uploaded PNG.

        Raises `CityError` if it has more than `UPLOAD_BYTES`, or if `City.load` refuses it.
        """
        if len(data) > UPLOAD_BYTES:
            raise CityError(f"the file has {len(data):,} bytes, at most {UPLOAD_BYTES:,} are read")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "upload.png")
            path.write_bytes(data)
            try:
                return cls(City.load(path).kinds)
            except CityError as error:
                raise CityError(str(error).replace(f"{folder}/", "")) from None

    @property
    def size(self) -> int:
        """M, the number of cells on a side."""
        return len(self.kinds)

    @property
    def landing(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 0]

    @property
    def no_fly(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 1]

    @property
    def buildings(self) -> np.ndarray:
        return LAYERS[self.kinds][..., 2]

    def paint(self, cell: tuple[int, int], brush: str) -> bool:
        """Paint a cell with one of `BRUSHES`; returns whether it changed. Ignores cells outside."""
        row, col = cell
        inside = 0 <= row < self.size and 0 <= col < self.size
        if not inside or self.kinds[row, col] == BRUSHES[brush]:
            return False
        self.kinds[row, col] = BRUSHES[brush]
        return True

    def city(self, name: str = "my_city") -> City:
        """The city; raises `CityError` if it is incomplete."""
        return City.from_kinds(name, self.kinds)

    def png(self) -> bytes:
        """The PNG file that `City.load` reads, with one pixel for each cell."""
        return png(COLOURS[self.kinds])


class CityLab(ipywidgets.VBox):
    """Paint buildings, no-fly zones and landing cells on a grid.

    The planners and the agent for any city fly over what you have painted, next to the greedy
    planner; the agent only if the city is not larger than those that it was trained in. The lab
    shows the command that trains an agent for your city alone.

    Arguments:
        city: the name of a shipped city to start from.
    """

    def __init__(self, city: str = "village"):
        self.base = ipywidgets.Dropdown(
            options=[("", None), *((name, name) for name in shipped_cities())], description="from"
        )
        self.size = ipywidgets.BoundedIntText(
            value=12, min=4, max=LARGEST, description="blank size"
        )
        self.blank = ipywidgets.Button(description="blank city", icon="square-o")
        self.upload = ipywidgets.FileUpload(
            accept=".png",
            multiple=False,
            description="upload PNG",
            tooltip=f"one pixel for each cell, at most {UPLOAD_BYTES // 1000} kB",
        )
        self.brush = ipywidgets.ToggleButtons(
            options=list(BRUSHES), value="tall building", description="paint"
        )
        self.policy = ipywidgets.Dropdown(description="policy")
        self.fly = ipywidgets.Button(description="fly", icon="plane", tooltip="a random mission")
        self.picker = CellPicker(self.paint)
        self.message = ipywidgets.HTML(layout={"min_height": "28px"})
        self.result, self.take_home = ipywidgets.HTML(), ipywidgets.HTML()
        figure = Figure(figsize=(4.6, 4.6), dpi=100)
        self.ax = figure.add_axes((0.07, 0.05, 0.92, 0.93))
        self.canvas, self.maps = Canvas(figure), [Map(), Map()]
        self.views = ipywidgets.HBox([self.canvas.picture], layout={"flex_flow": "row wrap"})
        super().__init__(
            [
                ipywidgets.HBox([self.base, self.size, self.blank, self.upload]),
                self.brush,
                self.picker,
                self.message,
                self.views,
                ipywidgets.HBox([self.policy, self.fly, self.result]),
                self.take_home,
            ]
        )
        self.base.observe(lambda change: self._load(change.new), "value")
        self.blank.on_click(lambda _: self._take(Draft.blank(self.size.value).kinds))
        self.upload.observe(lambda change: self._read(change.new), "value")
        self.fly.on_click(lambda _: self._fly())
        self.clicks = self.canvas.on_drag(
            lambda ax, points: self.paint(*((round(y), round(x)) for x, y in points))
        )
        self._missions = 0
        self.base.value = city

    def paint(self, *cells: tuple[int, int]) -> None:
        """One stroke of the brush on these cells."""
        if any([self.draft.paint(cell, self.brush.value) for cell in cells]):
            self.base.value = None  # so that the city can be chosen again
            self._show()

    def _load(self, name: str | None) -> None:
        if name is not None:
            self._take(City.load(name).kinds, name)

    def _take(self, kinds: np.ndarray, name: str | None = None) -> None:
        self.draft = Draft(kinds)
        self.base.value = name
        self.picker.row.max = self.picker.column.max = self.draft.size - 1
        self._show()

    def _read(self, files) -> None:
        """Use an uploaded PNG; if it is not a city, say why and change nothing."""
        if not files:
            return
        try:
            kinds = Draft.from_png(bytes(files[0]["content"])).kinds
            if len(kinds) > LARGEST:
                raise CityError(f"{len(kinds)} cells on a side: at most {LARGEST} fit this editor")
            self._take(kinds)
        except CityError as error:
            self._say(str(error).replace("upload.png", files[0]["name"]))
        self.upload.value = ()  # so that the same file can be uploaded again

    def _show(self) -> None:
        self.ax.clear()
        draw_city(self.ax, self.draft).set(xlabel="", ylabel="")
        self.canvas.draw_all()
        self.canvas.draw()
        self.views.children, self.result.value = [self.canvas.picture], ""
        link = base64.b64encode(self.draft.png()).decode()
        save = (
            '<a style="color:#0645AD;text-decoration:underline" download="my_city.png" '
            f'href="data:image/png;base64,{link}">save as PNG</a>'
        )
        try:
            city = self.draft.city()
        except CityError as error:
            self._say(str(error))
            self.fly.disabled, self.take_home.value = True, save
            return
        self._say("")
        self.fly.disabled = False
        if "any_city" in self._offer_policies(city):
            command = FINE_TUNE
        else:
            command = TRAIN.format(devices=f"1 {min(3, len(city.device_cells))}")
        self.take_home.value = (
            f"{save}; to train an agent for this city: <code>{html.escape(command)}</code>"
        )

    def _offer_policies(self, city: City) -> list[str]:
        """Let one choose from the policies for this city; returns their names."""
        names = [*agents_for(city), *PLANNERS]
        options = [(policy_title(name), name) for name in names]
        if self.policy.options != tuple(options):
            chosen = self.policy.value
            self.policy.options = options
            self.policy.value = chosen if chosen in names else names[0]
        return names

    def _fly(self) -> None:
        """Fly a mission of up to three devices, with time to cross the city about twice.

        The greedy planner flies it, too, for comparison.
        """
        try:
            city = self.draft.city()
            most = min(3, len(city.device_cells))
            time = (2 * city.size, 4 * city.size)
            scenario = Scenario("my_city", devices=(1, most), flying_time=time)
            environment = Environment(city)
            mission = Mission.draw(scenario, city, self._missions)
            self.result.value = f"{self.policy.value} is planning …"
            flown = {
                name: mission.fly(environment, find_policy(name, environment))
                for name in dict.fromkeys([self.policy.value, "greedy"])
            }
        except InputError as error:
            self._say(str(error))
            return
        self._missions += 1
        self.result.value = "<br>".join(map(self._told, flown, flown.values()))
        for each, (name, flights) in zip(self.maps, flown.items(), strict=False):
            each.set_city(environment, mission, policy_title(name))
            each.show(flights)
        shown = [each.canvas.picture for each in self.maps[: len(flown)]]
        self.views.children = [self.canvas.picture, *shown]

    @staticmethod
    def _told(name: str, flights: Flights) -> str:
        """A flight in a line."""
        end, start = flights.end, flights.start
        return (
            f"{policy_title(name)}: {'landed' if end.landed[0] else 'crashed'} after "
            f"{flights.steps[0]} of {start.time_left[0]} units of time, "
            f"{end.data_collected.sum():.1f} of {start.data_initial.sum():.1f} data units collected"
        )

    def _say(self, text: str) -> None:
        self.message.value = status(text)
