"""Mission lab: set a mission with clicks and sliders, fly it with any policy, step through it."""

import html
from contextlib import contextmanager
from dataclasses import replace

from uavdh_lite.city import shipped_cities
from uavdh_lite.errors import InputError, extra
from uavdh_lite.labs.views import Charts, Map, legend, policy_title
from uavdh_lite.labs.widgets import CellPicker, cell_at, status, table
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import device_colour
from uavdh_lite.policies import find_policy, policies_for
from uavdh_lite.scenario import scenario_for

with extra("notebooks"):
    import ipywidgets

NONE = "none"
WRAP = {"flex_flow": "row wrap"}  # continue below on a narrow page
WIDE = {"description_width": "95px"}  # room for the labels of controls


class MissionLab(ipywidgets.VBox):
    """Set a mission, fly it, and compare two policies on it under the same fading.

    Arguments:
        city: the name of a shipped city to start with, or the path of a PNG with your own.
    """

    _silent = False
    _picked: int | None = None

    def __init__(self, city: str = "manhattan"):
        self._build()
        if city not in self.city.options:
            self.city.options = [*self.city.options, city]
        self.city.value = city
        self._set_city()
        super().__init__([self._controls(), self.message, self.views, self.numbers, legend()])
        self._listen()

    def _build(self) -> None:
        dropdown = ipywidgets.Dropdown
        self.city = dropdown(options=shipped_cities(), description="city", style=WIDE)
        self.policy = dropdown(description="policy", style=WIDE)
        self.other = dropdown(description="compare with", style=WIDE)
        self.click = ipywidgets.ToggleButtons(
            options=["add", "move", "remove", "start"],
            description="click to",
            tooltips=[
                "click a free cell to add a device",
                "click a device, then its new cell; or drag it, at any time",
                "click a device to remove it",
                "click the cell where the UAV starts; or drag it, at any time",
            ],
            style={"button_width": "70px", "description_width": "80px"},
        )
        self.picker = CellPicker(self.clicked)
        self.time = ipywidgets.IntSlider(
            description="flying time", min=1, max=70, style=WIDE, continuous_update=False
        )
        self.seed = ipywidgets.BoundedIntText(
            description="fading seed", min=0, max=10**6, style=WIDE
        )
        self.draw = ipywidgets.Button(description="random mission", icon="random")
        self.play = ipywidgets.Play(interval=150, description="fly")
        self.step = ipywidgets.IntSlider(description="step", style=WIDE)
        self.data: list[ipywidgets.FloatSlider] = []
        self.sliders = ipywidgets.VBox()
        self.message = ipywidgets.HTML(layout={"min_height": "28px"})
        self.numbers = ipywidgets.HTML()
        self.maps, self.charts = [Map(), Map()], self._side()
        self.views = ipywidgets.HBox(layout=WRAP)

    def _side(self):
        """The charts next to the maps: `set_flight` for a new flight, `show` for a step of it."""
        return Charts()

    def _controls(self) -> ipywidgets.Widget:
        flight = ipywidgets.HBox([self.play, self.step])
        box = ipywidgets.VBox
        return ipywidgets.HBox(
            [
                box([self.city, self.policy, self.other, self.draw]),
                box([self.click, self.picker, self.time, self.seed, flight]),
                self.sliders,
            ],
            layout=WRAP,
        )

    def _listen(self) -> None:
        ipywidgets.jslink((self.play, "value"), (self.step, "value"))
        self.city.observe(lambda _: self._set_city(), "value")
        self.click.observe(lambda _: self._pick(None), "value")
        self.draw.on_click(lambda _: self._random())
        for control in (self.policy, self.other):
            control.observe(lambda _: self._fly(), "value")
        self.time.observe(lambda change: self._change(flying_time=change.new), "value")
        self.seed.observe(lambda change: self._change(seed=change.new), "value")
        self.step.observe(lambda _: self._show(), "value")
        self.clicks = [
            each.canvas.on_drop(lambda ax, start, end: self.dropped(cell_at(start), cell_at(end)))
            for each in self.maps
        ]

    def _set_city(self) -> None:
        """Start again, in the chosen city."""
        self.environment = environment_of(self.city.value)
        self.scenario = scenario_for(self.city.value)
        with self._quiet():
            self.time.max = self.scenario.flying_time[1]
            names = policies_for(self.environment)
            options = [(policy_title(name), name) for name in names]
            self.policy.options, self.other.options = options, [(NONE, NONE), *options]
            self.policy.value, self.other.value = names[0], NONE
        self._drawn = 0
        self._set_mission(Mission.draw(self.scenario, self.environment.city, 0))

    def _random(self) -> None:
        self._drawn += 1
        city = self.environment.city
        mission = Mission.draw(self.scenario, city, self._drawn)
        self._set_mission(replace(mission, seed=self.seed.value))

    def _change(self, **changes) -> None:
        self._attempt(lambda: replace(self.mission, **changes))

    def dropped(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Drag a device or the start from one cell to another; the same cell twice is a click."""
        device = self.mission.device_at(start)
        if start == end:
            self.clicked(end)
        elif device is not None:
            self._attempt(lambda: self.mission.move(device, end))
        elif start == self.mission.start:
            self._change(start=end)

    def clicked(self, cell: tuple[int, int]) -> None:
        """Do what `click` says to this cell, (row, column)."""
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
            found = f"device {device}: now click its new cell"
            self._say("there is no device here" if device is None else found)
        else:
            picked, self._picked = self._picked, None
            self._attempt(lambda: self.mission.move(picked, cell))

    def _pick(self, device: int | None) -> None:
        """Remember the device that a second click will move."""
        self._picked = device

    def _attempt(self, change) -> None:
        """Make a change, or say why it is not possible."""
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
            square = f'<span style="color:{device_colour(number)}">■</span>'
            slider = ipywidgets.FloatSlider(
                min=0.5, step=0.5, description=f"{square} data of {number}", continuous_update=False
            )
            slider.description_allow_html = True
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
        """Fly the mission with the chosen policies and show the whole flights."""
        if self._silent:
            return
        self.play.playing = False
        names = [self.policy.value] + [self.other.value] * (self.other.value != NONE)
        self._say("the genie is planning …" if "genie" in names else "")
        self.flights = {}
        policies = {name: find_policy(name, self.environment, self.mission.seed) for name in names}
        for each, (name, policy) in zip(self.maps, policies.items(), strict=False):
            self.flights[name] = self.mission.fly(self.environment, policy)
            each.set_city(self.environment, self.mission, policy_title(name))
        last = max(int(flights.steps[0]) for flights in self.flights.values())
        first = names[0]
        self.charts.set_flight(policy_title(first), self.flights[first], policies[first], last)
        same = "both are the same policy, and fly the same way"
        self._say(same if len(names) > len(policies) else "")
        shown = [each.canvas.picture for each in self.maps[: len(self.flights)]]
        self.views.children = [*shown, self.charts.canvas.picture]
        with self._quiet():
            self.step.max = self.play.max = last
            self.step.value = self.play.value = last
        self._show()

    def _show(self) -> None:
        """Show the flights up to the step of the slider."""
        if self._silent:
            return
        for each, flights in zip(self.maps, self.flights.values(), strict=False):
            each.show(flights, self.step.value)
        self.charts.show(self.step.value)
        self.numbers.value = self._table() + f"<p>{html.escape(self._sentence())}</p>"

    def _table(self) -> str:
        """The numbers of the paper's captions, at this step and at the end."""
        head = ("policy", "time left", "data collected", "at the end", "time used", "return")
        rows = [head]
        for name, flights in self.flights.items():
            trajectory = flights.trajectory(0)
            step = min(self.step.value, len(trajectory.action))
            total = trajectory.start.data_initial.sum()
            collected = total - trajectory.data_left[step].sum()
            rows.append(
                (
                    policy_title(name),
                    f"{trajectory.time_left[step]} of {trajectory.time_left[0]}",
                    f"{collected:.1f} of {total:.1f}",
                    "landed" if trajectory.landed else "crashed",
                    f"{len(trajectory.action)} of {trajectory.time_left[0]}",
                    f"{flights.cumulative_reward[0]:.2f}",
                )
            )
        return table(rows)

    def _sentence(self) -> str:
        """How the first flight ends compared with the second; empty for one flight alone."""
        if len(self.flights) < 2:
            return ""
        (first, one), (second, other) = self.flights.items()
        ends = [
            ("landed" if each.end.landed[0] else "crashed", each.end.data_collected.sum())
            for each in (one, other)
        ]
        if ends[0][0] != ends[1][0]:
            told = [
                f"{policy_title(n)} {end}" for n, (end, _) in zip(self.flights, ends, strict=True)
            ]
            return f"{told[0]}, {told[1]}."
        more, sooner = ends[0][1] - ends[1][1], int(other.steps[0] - one.steps[0])
        data = f"{abs(more):.1f} data units {'more' if more > 0 else 'fewer'} than"
        data = "as much data as" if abs(more) < 0.05 else data
        units = "unit" if abs(sooner) == 1 else "units"
        time = f"{abs(sooner)} {units} of time {'sooner' if sooner > 0 else 'later'}"
        time = "after as many units of time" if sooner == 0 else time
        who, whom = policy_title(first), policy_title(second)
        return f"{who} collected {data} {whom}, and {ends[0][0]} {time}."

    def _say(self, text: str) -> None:
        self.message.value = status(text)

    @contextmanager
    def _quiet(self):
        """Inside, changes of the controls are ours, not the user's."""
        before, self._silent = self._silent, True
        try:
            yield
        finally:
            self._silent = before
