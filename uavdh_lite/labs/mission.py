"""Mission lab: set a mission on the map, and watch up to three policies fly it side by side."""

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from uavdh_lite.city import City
from uavdh_lite.environment import Rewards
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.draft import History, is_changed
from uavdh_lite.labs.links import (
    COPIED,
    HERE,
    encoded_mission,
    mission_file,
    mission_of_file,
    mission_of_link,
)
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.stage import Stage, together
from uavdh_lite.labs.views import Charts, policy_title
from uavdh_lite.labs.widgets import (
    ROW,
    TEXT,
    WRAP,
    CellPicker,
    changed_note,
    link,
    quiet,
    say_changed,
    status,
    table,
    undo_and_redo,
    words,
)
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import RED
from uavdh_lite.policies import find_policy, policies_for

with extra("notebooks"):
    import ipywidgets

NONE = "none"
OPEN = "Your mission is as it was: mend the file, and open it again"
ADDRESS = "mission="  # what stands behind the # of an address that opens a mission
LABEL = {"description_width": "95px"}  # room for the labels of controls
MOST_NUMBER = 10**6
GUESS = "Guess first: who does best? Then play the flights."
POLICIES = {
    "policy": "who flies: it chooses an action in each unit of time",
    "agent": "a trained network, named after the city that it learned; <i>any_city</i> learned in "
    "2000 random cities. <i>ddqn</i>: by the paper's method alone; <i>early</i>: its training was "
    "stopped early",
    "greedy": "a simple rule: to the nearest device with data, and home in time",
    "genie": "a planner that knows the mean rate at every place, which no UAV does",
    "random": "each action that is allowed, with the same chance",
}
PRICES = {name: -value for name, value in vars(Rewards()).items()}
SCORES = {
    "UAV": "an unmanned aerial vehicle: a drone",
    "device": "a radio on the ground that has data to send; in each slot the UAV serves, or hears, "
    "one of them",
    "step, unit of time": "one action takes one unit of flying time; in it the radio has four "
    "slots, each for one device",
    "crash": "the flying time is over, and the UAV has not landed",
    "return": "what an agent learns to make large: the sum of all rewards, which are the data "
    f"collected, less {PRICES['movement']:g} for each step before the landing and "
    f"{PRICES['safety']:g} for each move that was refused; a crash costs {PRICES['crash']:g}. The "
    "charts call these parts <i>data</i>, <i>movement</i>, <i>safety</i> and <i>crash</i>",
    "refused": "the safety controller lets the UAV hover instead of a move into a tall building, "
    "a no-fly zone or off the map, or a landing outside of the zone",
}
FADING = {
    "mission no.": "the number of a random mission, which says where devices stand, how much data "
    "they have, and how long the UAV can fly: the same number draws the same one again",
    "fading no.": "fading is the random ups and downs of the radio links; the same number draws "
    "the same ones, for every policy",
    "charts": "<i>device served</i>: whom the UAV hears in each of a step's four slots; "
    "<i>reward</i>: its parts in each step",
}


class MissionLab(ipywidgets.VBox):
    """Set a mission, fly it, and compare up to three policies on it under the same fading.

    Devices and the start are dragged on the map, amounts of data and the flying time on the bars.
    Every change can be undone. A mission is saved as a file, and opened from one.

    Arguments:
        city: the name of a shipped city to start with, or the path of a PNG with your own.
        painted: returns the city to fly as *my city*; see `CityMenu`.
        linked: offer a link that opens the mission on the labs' page; see `open_link`.
    """

    _silent = _hidden = False
    _picked: int | None = None
    words = SCORES | POLICIES | FADING

    def __init__(
        self,
        city: str = "manhattan",
        painted: Callable[[], City] | None = None,
        linked: bool = False,
    ):
        self._linked = linked
        self.city = CityMenu(
            city, painted, style={"description_width": "30px"}, layout={"width": "185px"}
        )
        self._build()
        self._set_city()
        super().__init__(
            [
                self._controls(),
                self.message,
                together([self.sentence, self._views()]),
                self.numbers,
                ipywidgets.HBox([self.upload, self.take_home], layout=WRAP),
                words(self.words),
            ]
        )
        self._listen()

    def _build(self) -> None:
        self.policy, self.other, self.third = (
            ipywidgets.Dropdown(
                description=about,
                style={"description_width": f"{width}px"},
                layout={"width": f"{width + 165}px"},
            )
            for about, width in (("policy", 45), ("compare with", 90), ("and with", 60))
        )
        self.guess = ipywidgets.ToggleButton(
            description="guess first",
            icon="eye-slash",
            tooltip="flights start at their first step; how they end is said once they have been "
            "played",
            layout={"width": "125px"},
        )
        self.click = ipywidgets.ToggleButtons(
            options=["add", "move", "remove", "start"],
            description="click to",
            tooltips=[
                "click a free cell to add a device",
                "click a device, then its new cell; or drag it, at any time",
                "click a device to remove it",
                "click the cell where the UAV starts; or drag it, at any time",
            ],
            style={"button_width": "62px", "description_width": "50px"},
            layout=ROW,
        )
        self.picker = CellPicker(self.clicked)
        self.number, self.seed = (
            ipywidgets.IntText(
                description=f"{name} no.",
                tooltip=tooltip,
                style={"description_width": f"{width}px"},
                layout={"width": f"{width + 62}px"},
            )
            for name, tooltip, width in (
                ("mission", "the number of the random mission", 80),
                ("fading", "the number of the random fading", 72),
            )
        )
        self.changed = changed_note()
        self.upload = ipywidgets.FileUpload(
            accept=".json",
            multiple=False,
            description="open mission",
            tooltip="a file that was saved here, or by the command fly",
        )
        self.draw = ipywidgets.Button(
            description="random mission", icon="random", tooltip="the next random mission"
        )
        self.undo, self.redo = undo_and_redo()
        self.undo.layout.width = self.redo.layout.width = "76px"
        self.message = ipywidgets.HTML(layout={"min_height": "24px", "margin": "0 2px"})
        self.message.add_class("uavdh-message")
        self.sentence, self.numbers, self.take_home = (ipywidgets.HTML() for _ in range(3))
        self.charted = ipywidgets.ToggleButtons(description="charts of", style=LABEL, layout=ROW)
        self.sentence.add_class("uavdh-sentence")
        self.stage = Stage(
            dropped=self.dropped,
            filled=lambda device, amount: self._attempt(lambda: self.mission.fill(device, amount)),
            timed=lambda time: self._change(flying_time=time),
            undone=self._go,
        )
        self.charts = self._side()
        self.charting = ipywidgets.VBox([self.charted, self.charts.canvas.picture])

    def _side(self):
        """What is next to the maps: `set_flight` for a new flight, `show` for a step of it."""
        return Charts()

    def _views(self) -> ipywidgets.Widget:
        """The maps, and what is next to them."""
        return ipywidgets.VBox([self.stage, self.charting])

    def _controls(self) -> ipywidgets.Widget:
        row = ipywidgets.HBox
        return ipywidgets.VBox(
            [
                row(
                    [self.city, self.policy, self.other, self.third, self.draw, self.guess],
                    layout=WRAP,
                ),
                row(
                    [
                        *(self.click, self.picker, self.number, self.changed, self.seed),
                        *(self.undo, self.redo),
                    ],
                    layout=WRAP,
                ),
            ]
        )

    def _listen(self) -> None:
        self.city.on_choice(self._set_city, self._say)
        self.click.observe(lambda _: self._choose_click(), "value")
        self.draw.on_click(lambda _: self._random())
        self.number.observe(lambda change: self._renumber("mission", change), "value")
        self.undo.on_click(lambda _: self._go(-1))
        self.redo.on_click(lambda _: self._go(1))
        self.charted.observe(lambda _: self._chart(), "value")
        for control in (self.policy, self.other, self.third):
            control.observe(lambda _: self._fly(), "value")
        self.seed.observe(lambda change: self._renumber("fading", change), "value")
        self.guess.observe(lambda _: self._fly(), "value")
        self.upload.observe(lambda change: self._read(change.new), "value")
        self.stage.observe(lambda _: self._show(), "step")

    def _set_city(self, again: bool = False) -> None:
        """Start again, in the chosen city.

        Arguments:
            again: it is the city of before, painted further; then the mission stays if it can, and
                so do the policies.
        """
        self.environment, self.scenario = self.city.environment, self.city.scenario
        chosen = self.policy, self.other, self.third
        before = [control.value for control in chosen]
        with quiet(self):
            self.stage.most = {
                "data": self.scenario.data[1],
                "time": self.scenario.flying_time[1],
            }
            names = policies_for(self.environment)
            self.policy.options = options = [(policy_title(name), name) for name in names]
            self.other.options = self.third.options = [(NONE, NONE), *options]
            for control, first, name in zip(chosen, (names[0], NONE, NONE), before, strict=True):
                stays = name in (*names, NONE) and (again or control is not self.policy)
                control.value = name if stays else first
            if not again:  # the city's own agent flies; who is compared with it is another one
                for control in chosen[1:]:
                    if control.value == self.policy.value:
                        control.value = NONE
            if not again:
                self.number.value = self.seed.value = 0
        mission = None
        if again:
            with suppress(InputError):  # a device, or the start, is where none can be any more
                mission = replace(self.mission, city=self.environment.city)
        self._begin(self._numbered() if mission is None else mission)

    def _begin(self, mission: Mission) -> None:
        """Show a mission; what was before it cannot be brought back."""
        self._history = History()
        self._set_mission(mission)

    def _numbered(self) -> Mission:
        """The random mission of the number that is shown."""
        mission = Mission.draw(self.scenario, self.environment.city, self.number.value)
        with quiet(self):
            self.seed.value = mission.seed
        return mission

    def _renumber(self, what: str, change) -> None:
        """Take another number of the mission or of its fading, or say which there are."""
        if self._silent:
            return
        number = change.new
        if not 0 <= number <= MOST_NUMBER:
            with quiet(self):
                change.owner.value = change.old
            self._say(
                f"there is no {what} no. {number}: the numbers go from 0 to {MOST_NUMBER:,}. It is "
                f"still no. {change.old}"
            )
        elif what == "mission":
            self._attempt(self._numbered)
        else:
            self._change(seed=number)

    def _random(self) -> None:
        self.number.value = (self.number.value + 1) % (MOST_NUMBER + 1)

    def open_link(self, code: str) -> None:
        """Fly the mission of a link, its file in base64; if it is none, say why."""
        if code == self._code():
            if COPIED not in self.message.value:
                self._say(HERE, TEXT)
            return
        try:
            mission = mission_of_link(code)
        except InputError as error:
            self._say(str(error))
        else:
            self._open(mission)

    def tell_link(self, copied: bool) -> None:
        """Say where the link is that was clicked."""
        self._say(COPIED if copied else HERE, TEXT)

    def _open(self, mission: Mission) -> None:
        """Go on with a mission that comes from elsewhere."""
        with quiet(self):
            self.city.take(mission.city)
            self.number.value = mission.seed  # if it was a random one, this was its number
        self._begin(mission)

    def _read(self, files) -> None:
        """Fly the mission of an uploaded file; if it is none, say why and change nothing."""
        if not files:
            return
        name, data = files[0]["name"], bytes(files[0]["content"])
        self.upload.value = ()  # so that the same file can be opened again
        try:
            mission = mission_of_file(data)
        except InputError as error:
            self._say(f"{name}: {error}. {OPEN}")
        else:
            self._open(mission)

    def _code(self) -> str:
        """The mission's file as it stands in a link."""
        return encoded_mission(self.mission)

    def _go(self, by: int) -> None:
        """Undo a change (-1), or redo one (1)."""
        if by and (before := self._history.move(by)) is not None:
            mission, number = before
            with quiet(self):
                self.number.value = number
            self._show_mission(mission)

    def _change(self, **changes) -> None:
        self._attempt(lambda: replace(self.mission, **changes))

    def dropped(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Drag a device or the start from one cell to another; the same cell twice is a click."""
        if start == end:
            self.clicked(end)
        else:
            device = self.mission.device_at(start)
            if device is not None:
                self._attempt(lambda: self._moved(device, end))
            elif start == self.mission.start:
                self._attempt(lambda: self._started(end))

    def clicked(self, cell: tuple[int, int]) -> None:
        """Do what `click` says to this cell, (row, column)."""
        device, mode = self.mission.device_at(cell), self.click.value
        if mode == "add":
            self._attempt(lambda: self._added(cell))
        elif mode == "start":
            self._attempt(lambda: self._started(cell))
        elif mode == "remove":
            if device is None:
                self._say("there is no device here to remove: click on one")
            else:
                self._attempt(lambda: self._removed(device))
        elif self._picked is None:
            self._picked = device
            found = f"device {device}: now click its new cell"
            self._say("there is no device here: click on one" if device is None else found)
        else:
            picked, self._picked = self._picked, None
            self._attempt(lambda: self._moved(picked, cell))

    def _choose_click(self) -> None:
        """Forget the device that a second click would have moved, and what was said of it."""
        self._picked = None
        self._say("")

    def _added(self, cell: tuple[int, int]) -> Mission:
        there = len(self.mission.devices)
        if there == self.mission.max_devices:
            raise InputError(f"not added: {self._numbers()}, and {there} are on the map")
        if reason := obstacle(self.mission, cell):
            raise InputError(f"not added: {reason}")
        return self.mission.add(cell)

    def _removed(self, device: int) -> Mission:
        if len(self.mission.devices) == 1:
            raise InputError(f"not removed: {self._numbers()}, and only one is on the map")
        return self.mission.remove(device)

    def _moved(self, device: int, cell: tuple[int, int]) -> Mission:
        others = self.mission.devices[:device] + self.mission.devices[device + 1 :]
        if reason := obstacle(self.mission, cell, others):
            raise InputError(f"device {device} was not moved: {reason}")
        return self.mission.move(device, cell)

    def _started(self, cell: tuple[int, int]) -> Mission:
        if reason := blocked(self.mission, cell):
            raise InputError(f"the start was not moved: {reason}")
        return replace(self.mission, start=cell)

    def _numbers(self) -> str:
        return f"this scenario has 1 to {self.mission.max_devices} devices"

    def _attempt(self, change) -> None:
        """Make a change, or say why it is not possible."""
        if self._silent:
            return
        try:
            mission = change()
        except InputError as error:
            self._say(str(error))
            self.stage.put_back()
        else:
            self._set_mission(mission)

    def _set_mission(self, mission: Mission) -> None:
        self._history.record((mission, self.number.value))
        self._show_mission(mission)

    def _show_mission(self, mission: Mission) -> None:
        self.mission, self._picked = mission, None
        self.undo.disabled, self.redo.disabled = (not self._history.can(by) for by in (-1, 1))
        data = base64.b64encode(mission_file(mission)).decode()
        save = link("save as JSON", f"data:application/json;base64,{data}", "my_mission.json")
        if self._linked:
            save += f" or as a {link('link', f'#{ADDRESS}{self._code()}')}"
        self.take_home.value = (
            f"{save}: the page keeps nothing when you leave it. The file is for this button, and "
            "for <code>python -m uavdh_lite fly --mission</code>."
        )
        drawn = Mission.draw(self.scenario, mission.city, self.number.value)
        say_changed(self.changed, self.number.value, is_changed(mission, drawn))
        with quiet(self):
            self.seed.value = mission.seed
        self._fly()

    def _fly(self) -> None:
        """Fly the mission with the chosen policies and show the whole flights."""
        if self._silent:
            return
        chosen = [self.policy.value, self.other.value, self.third.value]
        names = [name for name in dict.fromkeys(chosen) if name != NONE]
        self._say("the genie is planning …" if "genie" in names else "")
        self._policies = {
            name: find_policy(name, self.environment, self.mission.seed) for name in names
        }
        self.flights = {
            name: self.mission.fly(self.environment, policy)
            for name, policy in self._policies.items()
        }
        twice = len(names) < len(chosen) - chosen.count(NONE)
        self._say("each policy is shown once: twice, it would fly the same way" if twice else "")
        with quiet(self):
            charted = self.charted.value
            self.charted.options = [(policy_title(name), name) for name in names]
            self.charted.value = charted if charted in names else names[0]
        self.charted.layout.display = None if len(names) > 1 else "none"
        self._draw_charts()
        self._hidden = self.guess.value
        with quiet(self):
            self.stage.show(
                self.environment,
                {policy_title(name): flights for name, flights in self.flights.items()},
                q_values=self.charts.sizes,
            )
            if self.charts.sizes or self._hidden:
                self.stage.step = 0  # its thoughts are seen on the way, not at the end
        self._tell()
        self._show()

    def _tell(self) -> None:
        """Say how the flights end, and show the charts, unless one guesses first."""
        self.charting.layout.display = "none" if self._hidden else None
        self.sentence.value = html.escape(GUESS) if self._hidden else self._sentences()

    @property
    def _last(self) -> int:
        """The last step of the longest flight."""
        return max(int(flights.steps[0]) for flights in self.flights.values())

    def _draw_charts(self) -> None:
        """Draw the flight of the policy that `charted` says."""
        name = self.charted.value
        flights, policy = self.flights[name], self._policies[name]
        self.charts.set_flight(policy_title(name), flights, policy, self._last)

    def _chart(self) -> None:
        if not self._silent:
            self._draw_charts()
            self.charts.show(self.stage.step)

    def _show(self) -> None:
        """Show the numbers of the step that the stage shows."""
        if self._silent:
            return
        if self._hidden and self.stage.step == self._last:
            self._hidden = False  # until the next flights
            self._tell()
        self.charts.show(self.stage.step)
        self.numbers.value = self._table()

    def _table(self) -> str:
        """The numbers of the paper's captions, at this step and at the end."""
        head = ("policy", "time left", "data collected", "landed", "time used", "return")
        rows, best = [head], _best(self.flights)
        for name, flights in self.flights.items():
            trajectory = flights.trajectory(0)
            step = min(self.stage.step, len(trajectory.action))
            total = trajectory.start.data_initial.sum()
            collected = total - trajectory.data_left[step].sum()
            ends = (
                "yes" if trajectory.landed else "crashed",
                f"{len(trajectory.action)} of {trajectory.time_left[0]}",
                f"{flights.returns[0]:z.2f}",
            )
            if name in best and len(self.flights) > 1:
                ends = *ends[:2], f"{ends[2]} (best)"
            rows.append(
                (
                    policy_title(name),
                    f"{trajectory.time_left[step]} of {trajectory.time_left[0]}",
                    f"{collected:.1f} of {total:.1f}",
                    *(("?",) * 3 if self._hidden else ends),
                )
            )
        return table(rows, {"": 1, f"now, after step {self.stage.step}": 2, "at the end": 3})

    def _sentences(self) -> str:
        """Who has the largest return, and how the flights end compared with each other; HTML."""
        if len(self.flights) == 1:
            return ""
        (first, flights), *others = self.flights.items()
        winner = f"<b>{html.escape(_ranked(self.flights))}</b>"
        lines = [_compared(first, flights, *other) for other in others]
        if len(others) == 2:
            (second, one), (third, other) = others
            winner += f" {html.escape(_compared(second, one, third, other, short=True))}"
        return "<br>".join([winner, *map(html.escape, lines)])

    def _say(self, text: str, colour: str = RED) -> None:
        self.message.value = status(text, colour)


def blocked(mission: Mission, cell: tuple[int, int]) -> str | None:
    """Why the UAV cannot be in this cell, or None."""
    row, col = cell
    size = mission.city.size
    if not (0 <= row < size and 0 <= col < size):
        return (
            f"row {row}, column {col} is outside of the map, where rows and columns go from 0 to "
            f"{size - 1}"
        )
    if not mission.city.no_fly[cell]:
        return None
    what = "tall building" if mission.city.buildings[cell] else "no-fly zone"
    return f"there is a {what} at row {row}, column {col}"


def obstacle(
    mission: Mission, cell: tuple[int, int], others: Sequence[tuple[int, int]] | None = None
) -> str | None:
    """Why a device cannot stand in this cell, or None.

    Arguments:
        others: the cells of the devices that stay where they are; by default of all.
    """
    row, col = cell
    here, city = f"at row {row}, column {col}", mission.city
    if not (0 <= row < city.size and 0 <= col < city.size):
        return blocked(mission, cell)
    if city.buildings[cell]:
        return f"there is a building {here}"
    if city.landing[cell]:
        return f"there is a landing zone {here}"
    if cell in (mission.devices if others is None else others):
        return f"there is device {mission.device_at(cell)} {here}"
    return None


def _best(flights: Mapping[str, Flights]) -> list[str]:
    """The policies with the largest return, to two digits."""
    returns = {name: round(float(each.returns[0]), 2) for name, each in flights.items()}
    return [name for name, value in returns.items() if value == max(returns.values())]


def _ranked(flights: Mapping[str, Flights]) -> str:
    """Who has the largest return, and what the others have, as a sentence."""
    returns = {name: float(each.returns[0]) for name, each in flights.items()}
    best = _best(flights)
    if len(best) == len(flights):
        who = "Both" if len(best) == 2 else "All"
        return f"{who} have the same return: {returns[best[0]]:z.2f}."
    others = sorted((name for name in returns if name not in best), key=lambda name: -returns[name])
    rest = ", ".join(f"{policy_title(name)} {returns[name]:z.2f}" for name in others)
    winners = " and ".join(map(policy_title, best))
    return f"Best return: {winners} {returns[best[0]]:z.2f}; {rest}."


def _compared(first: str, one: Flights, second: str, other: Flights, short: bool = False) -> str:
    """How a flight ends compared with another one, as a sentence, or as a short one."""
    who, whom = policy_title(first), policy_title(second)
    ends = ["landed" if each.end.landed[0] else "crashed" for each in (one, other)]
    if ends[0] != ends[1]:
        return f"{who} {ends[0]}, {whom} {ends[1]}."
    more = one.end.data_collected.sum() - other.end.data_collected.sum()
    sooner = int(other.steps[0] - one.steps[0])
    data = f"{abs(more):.1f} data units {'more' if more > 0 else 'fewer'} than"
    data = "as much data as" if abs(more) < 0.05 else data
    if short:
        steps = "step" if abs(sooner) == 1 else "steps"
        time = f"{abs(sooner)} {steps} {'sooner' if sooner > 0 else 'later'}"
        return f"{who}: {data} {whom}, {'as many steps' if sooner == 0 else time}."
    units = "unit" if abs(sooner) == 1 else "units"
    time = f"{abs(sooner)} {units} of time {'sooner' if sooner > 0 else 'later'}"
    time = "after as many units of time" if sooner == 0 else time
    return f"{who} collected {data} {whom}, and {ends[0]} {time}."
