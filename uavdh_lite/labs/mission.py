"""Mission lab: set a mission by clicks and sliders, fly it with any policy, scrub along time."""

import html
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import ipywidgets
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from uavdh_lite.city import City, shipped_cities
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Flights, Policy
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.picker import CellPicker
from uavdh_lite.mission import Mission, pilots
from uavdh_lite.plotting import device_colour, draw_city, draw_flight, shadow_sum
from uavdh_lite.scenario import SCENARIOS

NONE = "none"
WIDE = {"description_width": "85px"}  # room for the labels of controls
TERMS = {"data": "#0072B2", "movement": "#999999", "safety": "#E69F00", "crash": "#D55E00"}


@cache
def environment_of(city: str) -> Environment:
    """The environment of a shipped city, made once."""
    return Environment(City.load(city))


class Map:
    """The map of one policy's flight; the city is drawn once, the flight at every step."""

    def __init__(self):
        figure = Figure(figsize=(4.0, 4.2), dpi=100)
        self.ax = figure.add_axes((0.06, 0.06, 0.93, 0.88))
        self.canvas = Canvas(figure)
        self._drawn = None

    def set_city(self, environment: Environment, mission: Mission, title: str) -> None:
        """Draw the city with the shadows of the mission's devices, unless it is drawn already."""
        drawn = environment.city.fingerprint, mission.devices, title
        if drawn == self._drawn:
            return
        self._drawn = drawn
        self.ax.clear()
        self.city = environment.city
        cells = np.array([row * self.city.size + col for row, col in mission.devices])
        draw_city(self.ax, self.city, shadow_sum(environment, cells))
        self.ax.set(xlabel="", ylabel="", title=title)
        self.canvas.draw_all()

    def show(self, flights: Flights, step: int | None = None) -> None:
        """Draw the flight, or so many steps of it."""
        artists = draw_flight(self.ax, self.city, flights.trajectory(0), step)
        self.canvas.draw([(self.ax, artist) for artist in artists])
        for artist in artists:
            artist.remove()


class Charts:
    """What happens along one flight: data left, who is served in each slot, the reward's terms.

    The axes are drawn anew only when a flight does not fit them.
    """

    def __init__(self):
        figure = Figure(figsize=(4.0, 4.2), dpi=100)
        self.axes = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 3))
        figure.subplots_adjust(0.14, 0.1, 0.98, 0.98, hspace=0.1)
        figure.align_ylabels()
        self.canvas = Canvas(figure)
        for ax, name in zip(self.axes, ("data left", "served", "reward"), strict=True):
            ax.set_ylabel(name)
        reward = self.axes[-1]
        reward.set_xlabel("step")
        terms = [Patch(color=colour, label=name) for name, colour in TERMS.items()]
        reward.legend(handles=terms, fontsize="x-small", ncols=4, loc="upper right")
        self.cursors = [ax.axvline(0, color="black", lw=0.8, animated=True) for ax in self.axes]
        self._artists, self._limits = [], None

    def set_flight(self, flights: Flights, policy: Policy) -> None:
        """Draw the whole flight; `show` marks a step in it."""
        trajectory = flights.trajectory(0)
        devices = np.flatnonzero(trajectory.start.data_initial[0] > 0)
        outcomes = [outcome for _, _, outcome, _ in flights.history[: flights.steps[0]]]
        terms = [{k: v[0] for k, v in Rewards().terms(outcome).items()} for outcome in outcomes]
        for artist in self._artists:
            artist.remove()
        left, slots, reward = self.axes
        limits = (
            _ceil(len(terms), 10),
            _ceil(trajectory.data_left[0].max(), 5),
            devices.max(),
            _ceil(max(term["data"] for term in terms) + 0.1, 3),
        )
        if limits != self._limits:
            self._limits = limits
            left.set(xlim=(0, limits[0]), ylim=(0, 1.05 * limits[1]))
            slots.set(yticks=range(limits[2] + 1), ylim=(limits[2] + 0.5, -0.5))
            reward.set(ylim=(-2, 1.3 * limits[3]))
            self.canvas.draw_all()
        self._artists = [
            *(
                left.plot(trajectory.data_left[:, k], color=device_colour(k), animated=True)[0]
                for k in devices
            ),
            self._draw_slots(slots, trajectory.served),
            *(
                reward.stairs(values, fill=True, color=TERMS[name], animated=True)
                for name in TERMS
                if any(values := [term[name] for term in terms])
            ),
        ]

    def _draw_slots(self, ax, served: np.ndarray):
        step, slot = np.nonzero(served >= 0)
        device = served[step, slot]
        colours = [device_colour(each) for each in device]
        when = step + (slot + 0.5) / served.shape[1]
        return ax.scatter(when, device, c=colours, s=5, marker="s", animated=True)

    def show(self, step: int) -> None:
        """Mark a step."""
        for cursor in self.cursors:
            cursor.set_xdata([step, step])
        self.canvas.draw([(artist.axes, artist) for artist in (*self._artists, *self.cursors)])


def _ceil(value: float, step: int) -> int:
    """The least multiple of `step` that is not below the value."""
    return int(np.ceil(value / step) * step)


class MissionLab(ipywidgets.VBox):
    """Set a mission, fly it, and compare two policies with the same luck.

    Arguments:
        city: the name of a shipped city to start with.
    """

    _silent = False
    _picked: int | None = None

    def __init__(self, city: str = "manhattan"):
        self._build()
        self.city.value = city
        self._set_city()
        super().__init__([self._controls(), self.message, self.views, self.numbers])
        self._listen()

    def _build(self) -> None:
        dropdown = ipywidgets.Dropdown
        self.city = dropdown(options=shipped_cities(), description="city", style=WIDE)
        self.pilot = dropdown(description="policy", style=WIDE)
        self.other = dropdown(description="beside it", style=WIDE)
        self.click = ipywidgets.ToggleButtons(
            options=["add", "move", "remove", "start"],
            description="click to",
            tooltips=[
                "a click places a device",
                "a click on a device, then one on its new place",
                "a click on a device removes it",
                "a click sets where the UAV starts",
            ],
            style={"button_width": "70px", "description_width": "80px"},
        )
        self.picker = CellPicker(self.clicked)
        self.time = ipywidgets.IntSlider(description="flying time", min=1, max=70, style=WIDE)
        self.seed = ipywidgets.BoundedIntText(
            description="fading seed", min=0, max=10**6, style=WIDE
        )
        self.draw = ipywidgets.Button(description="random mission", icon="random")
        self.play = ipywidgets.Play(interval=150, description="fly")
        self.step = ipywidgets.IntSlider(description="step", style=WIDE)
        self.data: list[ipywidgets.FloatSlider] = []
        self.sliders = ipywidgets.VBox()
        self.message, self.numbers = ipywidgets.HTML(), ipywidgets.HTML()
        self.maps, self.charts, self.views = [Map(), Map()], self._side(), ipywidgets.HBox()

    def _side(self):
        """What stands beside the maps: `set_flight` for a new flight, `show` for a step of it."""
        return Charts()

    def _controls(self) -> ipywidgets.Widget:
        flight = ipywidgets.HBox([self.play, self.step])
        box = ipywidgets.VBox
        return ipywidgets.HBox(
            [
                box([self.city, self.pilot, self.other, self.draw]),
                box([self.click, self.picker, self.time, self.seed, flight]),
                self.sliders,
            ]
        )

    def _listen(self) -> None:
        ipywidgets.jslink((self.play, "value"), (self.step, "value"))
        self.city.observe(lambda _: self._set_city(), "value")
        self.draw.on_click(lambda _: self._random())
        for control in (self.pilot, self.other):
            control.observe(lambda _: self._fly(), "value")
        self.time.observe(lambda change: self._change(flying_time=change.new), "value")
        self.seed.observe(lambda change: self._change(seed=change.new), "value")
        self.step.observe(lambda _: self._show(), "value")
        self.clicks = [
            each.canvas.on_click(lambda ax, x, y: self.clicked((round(y), round(x))))
            for each in self.maps
        ]

    def _set_city(self) -> None:
        """Start anew in the chosen city."""
        self.environment = environment_of(self.city.value)
        self.makers = pilots(self.environment)
        self.scenario = SCENARIOS[self.city.value]
        with self._quiet():
            self.time.max = self.scenario.flying_time[1]
            self.pilot.options = list(self.makers)
            self.other.options = [NONE, *self.makers]
            self.pilot.value, self.other.value = self.pilot.options[0], NONE
        self._drawn = 0
        self._set_mission(Mission.draw(self.scenario, self.environment.city, 0))

    def _random(self) -> None:
        self._drawn += 1
        city = self.environment.city
        mission = Mission.draw(self.scenario, city, self._drawn)
        self._set_mission(replace(mission, seed=self.seed.value))

    def _change(self, **changes) -> None:
        self._attempt(lambda: replace(self.mission, **changes))

    def clicked(self, cell: tuple[int, int]) -> None:
        """A click on a cell of a map, (row, column): does what `click` says."""
        device, mode = self.mission.device_at(cell), self.click.value
        if mode == "add":
            self._attempt(lambda: self.mission.add(cell))
        elif mode == "start":
            self._change(start=cell)
        elif mode == "remove":
            if device is None:
                self._say("there is no device here to remove")
            else:
                self._attempt(lambda: self.mission.remove(device))
        elif self._picked is None:
            self._picked = device
            found = f"device {device}: now click on its new place"
            self._say("there is no device here" if device is None else found)
        else:
            picked, self._picked = self._picked, None
            self._attempt(lambda: self.mission.move(picked, cell))

    def _attempt(self, change) -> None:
        """Make a change, or say why it cannot be."""
        if self._silent:
            return
        try:
            mission = change()
        except InputError as error:
            self._say(str(error))
        else:
            self._set_mission(mission)

    def _set_mission(self, mission: Mission) -> None:
        self.mission, self._picked = mission, None
        with self._quiet():
            self.time.value, self.seed.value = mission.flying_time, mission.seed
            self._set_sliders()
        self._fly()

    def _set_sliders(self) -> None:
        """One slider for the data of each device."""
        most = self.scenario.data[1]
        while len(self.data) < len(self.mission.devices):
            number = len(self.data)
            slider = ipywidgets.FloatSlider(
                min=0.5, step=0.5, description=f"data of {number}", continuous_update=False
            )
            slider.observe(lambda change, k=number: self._change_data(k, change.new), "value")
            self.data.append(slider)
        shown = self.data[: len(self.mission.devices)]
        for slider, amount in zip(shown, self.mission.data, strict=True):
            slider.max, slider.value = max(most, amount), amount
        self.sliders.children = shown

    def _change_data(self, device: int, amount: float) -> None:
        data = list(self.mission.data)
        data[device] = amount
        self._change(data=tuple(data))

    def _fly(self) -> None:
        """Fly the mission with the chosen policies and show it from its end."""
        if self._silent:
            return
        self._say("")
        names = [self.pilot.value] + [self.other.value] * (self.other.value != NONE)
        self.flights = {}
        policies = {name: self.makers[name](self.mission.seed) for name in names}
        for place, (name, policy) in zip(self.maps, policies.items(), strict=False):
            self.flights[name] = self.mission.fly(self.environment, policy)
            place.set_city(self.environment, self.mission, name)
        self.charts.set_flight(self.flights[names[0]], policies[names[0]])
        shown = [place.canvas.picture for place in self.maps[: len(self.flights)]]
        self.views.children = [*shown, self.charts.canvas.picture]
        last = max(int(flights.steps[0]) for flights in self.flights.values())
        with self._quiet():
            self.step.max = self.play.max = last
            self.step.value = self.play.value = last
        self._show()

    def _show(self) -> None:
        """Show the flights up to the step of the slider."""
        if self._silent:
            return
        for place, flights in zip(self.maps, self.flights.values(), strict=False):
            place.show(flights, self.step.value)
        self.charts.show(self.step.value)
        self.numbers.value = self._table()

    def _table(self) -> str:
        """The numbers of the paper's caption, at the step and at the end."""
        head = ("policy", "time left", "data collected", "landed", "flying time used", "return")
        rows = [head]
        for name, flights in self.flights.items():
            trajectory = flights.trajectory(0)
            step = min(self.step.value, len(trajectory.action))
            total = trajectory.start.data_initial.sum()
            collected = total - trajectory.data_left[step].sum()
            rows.append(
                (
                    name,
                    f"{trajectory.time_left[step]} of {trajectory.time_left[0]}",
                    f"{collected:.1f} of {total:.1f}",
                    "yes" if trajectory.landed else "no",
                    f"{len(trajectory.action)} of {trajectory.time_left[0]}",
                    f"{flights.cumulative_reward[0]:.2f}",
                )
            )
        cells = "</td></tr><tr><td>".join("</td><td>".join(map(html.escape, r)) for r in rows)
        return f'<table class="uavdh-numbers"><tr><td>{cells}</td></tr></table>'

    def _say(self, text: str) -> None:
        self.message.value = f'<span role="status" style="color:#C1272D">{html.escape(text)}</span>'

    @contextmanager
    def _quiet(self):
        """Controls that are set in here are not the user's."""
        before, self._silent = self._silent, True
        try:
            yield
        finally:
            self._silent = before
