"""City editor: paint a city, see at once what it lacks, fly planners in it, take it home."""

import base64
import html

import ipywidgets
import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.city import City, shipped_cities
from uavdh_lite.draft import BRUSHES, UPLOAD_BYTES, Draft
from uavdh_lite.environment import Environment
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.picker import CellPicker
from uavdh_lite.labs.views import Map
from uavdh_lite.mission import Mission, pilots
from uavdh_lite.plotting import draw_city
from uavdh_lite.scenario import Scenario

COMMAND = "python -m uavdh_lite train --city my_city.png --devices {devices} --out runs/my_city"


class CityLab(ipywidgets.VBox):
    """Paint buildings, no-fly zones and landing cells on a grid.

    The shipped agents know only their own cities; over a city of yours the planners fly, and the
    command that trains an agent for it is shown.

    Arguments:
        city: the name of a shipped city to start from.
    """

    def __init__(self, city: str = "village"):
        self.base = ipywidgets.Dropdown(options=shipped_cities(), value=city, description="from")
        self.size = ipywidgets.BoundedIntText(value=12, min=4, max=40, description="size")
        self.blank = ipywidgets.Button(description="blank city", icon="square-o")
        self.upload = ipywidgets.FileUpload(
            accept=".png",
            multiple=False,
            description="upload PNG",
            tooltip=f"one pixel a cell, at most {UPLOAD_BYTES // 1000} kB",
        )
        self.brush = ipywidgets.ToggleButtons(
            options=list(BRUSHES), value="tall building", description="paint"
        )
        self.pilot = ipywidgets.Dropdown(options=["greedy", "genie"], description="planner")
        self.fly = ipywidgets.Button(description="fly", icon="plane", tooltip="a random mission")
        self.picker = CellPicker(self.paint)
        self.message, self.take_home = ipywidgets.HTML(), ipywidgets.HTML()
        figure = Figure(figsize=(4.6, 4.6), dpi=100)
        self.ax = figure.add_axes((0.07, 0.05, 0.92, 0.93))
        self.canvas, self.map = Canvas(figure), Map()
        self.views = ipywidgets.HBox([self.canvas.picture])
        super().__init__(
            [
                ipywidgets.HBox([self.base, self.size, self.blank, self.upload]),
                self.brush,
                self.picker,
                self.message,
                self.views,
                ipywidgets.HBox([self.pilot, self.fly]),
                self.take_home,
            ]
        )
        self.base.observe(lambda change: self._take(City.load(change.new).kinds), "value")
        self.blank.on_click(lambda _: self._take(Draft.blank(self.size.value).kinds))
        self.upload.observe(lambda change: self._read(change.new), "value")
        self.fly.on_click(lambda _: self._fly())
        self.clicks = self.canvas.on_drag(lambda ax, x, y: self.paint((round(y), round(x))))
        self._missions = 0
        self._take(City.load(city).kinds)

    def paint(self, cell: tuple[int, int]) -> None:
        """One stroke of the brush on a cell."""
        if self.draft.paint(cell, self.brush.value):
            self._show()

    def _take(self, kinds: np.ndarray) -> None:
        self.draft = Draft(kinds)
        self._show()

    def _read(self, files) -> None:
        """An uploaded PNG; one that cannot be read leaves all as it was."""
        if not files:
            return
        try:
            self._take(Draft.from_png(bytes(files[0]["content"])).kinds)
        except CityError as error:
            self._say(str(error))

    def _show(self) -> None:
        self.ax.clear()
        draw_city(self.ax, self.draft).set(xlabel="", ylabel="")
        self.canvas.draw_all()
        self.canvas.draw()
        self.views.children = [self.canvas.picture]
        try:
            city = self.draft.city()
        except CityError as error:
            self._say(str(error))
            self.fly.disabled, self.take_home.value = True, ""
            return
        self._say("")
        self.fly.disabled = False
        link = base64.b64encode(self.draft.png()).decode()
        most = min(3, len(city.device_cells))
        self.take_home.value = (
            f'<a download="my_city.png" href="data:image/png;base64,{link}">save as PNG</a>; '
            "the shipped agents know only their own cities. To train one for this: "
            f"<code>{html.escape(COMMAND.format(devices=f'1 {most}'))}</code>"
        )

    def _fly(self) -> None:
        """A mission of up to three devices, with time for about two crossings of the city."""
        try:
            city = self.draft.city()
            most = min(3, len(city.device_cells))
            time = (2 * city.size, 4 * city.size)
            scenario = Scenario("my_city", devices=(1, most), flying_time=time)
            environment = Environment(city)
            mission = Mission.draw(scenario, city, self._missions)
            flights = mission.fly(environment, pilots(environment)[self.pilot.value](0))
        except InputError as error:
            self._say(str(error))
            return
        self._missions += 1
        self.map.set_city(environment, mission, self.pilot.value)
        self.map.show(flights)
        self.views.children = [self.canvas.picture, self.map.canvas.picture]

    def _say(self, text: str) -> None:
        self.message.value = f'<span role="status" style="color:#C1272D">{html.escape(text)}</span>'
