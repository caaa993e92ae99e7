"""City editor: paint a city, see at once what is missing, let planners fly in it, save it."""

import base64
import html
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.city import City, shipped_cities
from uavdh_lite.environment import Environment, State
from uavdh_lite.errors import CityError, InputError, extra
from uavdh_lite.evaluation import Flights, fly
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.draft import (
    BRUSHES,
    MIRRORS,
    UPLOAD_BYTES,
    Cell,
    Draft,
    History,
    is_changed,
    rectangle,
    scenario_of,
)
from uavdh_lite.labs.links import AGAIN, COPIED, HERE, decode, encode, mission_code, mission_in
from uavdh_lite.labs.menu import MINE
from uavdh_lite.labs.stage import BESIDE, FullScreen, Stage, together
from uavdh_lite.labs.views import policy_title
from uavdh_lite.labs.widgets import (
    ROW,
    TEXT,
    WRAP,
    CellPicker,
    cell_at,
    changed_note,
    link,
    say_changed,
    status,
    undo_and_redo,
    words,
)
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import RED, device_colour, draw_city, png, shadow_colours
from uavdh_lite.policies import find_policy, policies_for
from uavdh_lite.shadowing import line_of_sight
from uavdh_lite.streams import Use, stream

with extra("notebooks"):
    import ipywidgets
    import traitlets

LARGEST = 50  # cells on a side; in larger cities, planners take minutes
MANY = 100  # missions that say more than one
UPLOAD = "Your city is as it was: mend the file, and open it again"
FAILS = 0.5  # of the data: who brings home less fails
TRAIN = "python -m uavdh_lite train --city my_city.png --devices {devices} --out runs/my_city"
HINT = (
    "Drag devices, the start or the bars. A click on a flight's map adds a device, or takes it "
    "away."
)
SWATCH = """.uavdh-brush .widget-toggle-button::before {
    content: ""; display: inline-block; width: 14px; height: 14px; margin-right: 6px;
    vertical-align: -2px; border: 1px solid #999; background-size: cover}
.uavdh-open-png {font-size: 0} /* hides how many files were opened */
.uavdh-open-png i, .uavdh-open-png::after {font-size: var(--jp-widgets-font-size, 13px)}
.uavdh-open-png::after {content: "open PNG" / ""}
.uavdh-told {line-height: 1.25}
.uavdh-told .widget-html-content {line-height: 1.25}
"""
TIE = 0.01  # a difference in what is brought home that does not count
ADDRESS = "city="  # what stands behind the # of an address that opens a city
FLOWN = "&mission="  # and behind the city, before the mission that is flown in it
WORDS = {
    "landing zone": "where the UAV starts and must land; a city needs at least one such cell",
    "tall building": "the UAV cannot fly there, and it blocks the radio",
    "low building": "the UAV flies over it, but it blocks the radio all the same",
    "no-fly zone": "the UAV may not fly there; the radio passes",
    "shadow": "the cells that a device does not see because of buildings. From there, the UAV "
    "hears it far worse",
    "mirror": "what you paint is painted on the other side of the city, too",
    "mission": "the number of a random mission: devices, their data, start and flying time. The "
    "same number in the same city draws the same mission again",
    "fly at once": "after each stroke the same mission is flown again: watch what a wall does",
    "100 missions": "how policy and greedy do on average; then it shows the mission in which "
    "greedy is furthest behind",
    "fails": "brings home less than half of the data, or does not come home",
    "and with": "a third policy that flies the same mission",
    "any_city agent": "a trained network that learned in 2000 random cities, but not in yours",
    "greedy": "a simple rule: to the nearest device with data, and home in time",
    "genie": "a planner that knows the mean rate at every place, which no UAV does",
}
FINE_TUNE = "python -m uavdh_lite train --from any_city --city my_city.png --out runs/my_city"


class CityLab(ipywidgets.VBox):
    """Paint buildings, no-fly zones and landing cells on a grid.

    A brush, rectangles and fills, mirrored if you like; every step can be undone. While the mouse
    is over the map, it shows the shadow of a device there.

    The planners and the agent for any city fly over what you have painted, next to the greedy
    planner; the agent only if the city is not larger than those that it was trained in. Devices and
    the start are dragged on their maps. With *fly at once* they fly the same mission again after
    each stroke, and *and with* lets a third policy fly it, too. *100 missions* says how they do on
    average, and shows the mission in which greedy is furthest behind. The lab shows the command
    that trains an agent for your city alone.

    Arguments:
        city: the name of a shipped city to start from.
        linked: offer a link that opens the city on the labs' page, with the mission that is
            flown in it, if there is one; see `open_link`.

    | trait | meaning |
    | --- | --- |
    | `unsaved` | the PNG, in base64, of a city that was painted here; "" for any other city |
    """

    unsaved = traitlets.Unicode()

    def __init__(self, city: str = "village", linked: bool = False):
        self._linked = linked
        self._build()
        row = ipywidgets.HBox
        super().__init__(
            [
                row([self.base, self.size, self.blank, self.random, self.upload], layout=WRAP),
                together(
                    [
                        row([self.brush, self.swatches], layout=WRAP),
                        row(
                            [self.tool, self.mirror, self.undo, self.redo, FullScreen()],
                            layout=WRAP,
                        ),
                        row([self.picker, self.message], layout=WRAP),
                        row(
                            [
                                *(self.policy, self.third, self.number, self.changed, self.fly),
                                *(self.following, self.at_once, self.many),
                            ],
                            layout=WRAP,
                        ),
                        self.views,
                    ]
                ),
                self.take_home,
                words(WORDS),
            ]
        )
        self._listen()
        self._drawn, self._average = 0, ""
        self._renumbers = False  # the number is ours, not the user's
        self._numbered: Mission | None = None  # the random mission that was flown last
        self._mission: Mission | None = None  # that was flown last
        self._history, self._corner = History(), None
        self._mine: np.ndarray | None = None  # the city that is no shipped one
        self._offers = False  # the policies are ours to choose, for another city
        self.base.value = city

    def _build(self) -> None:
        self.base = ipywidgets.Dropdown(options=[MINE, *shipped_cities()], description="from")
        self.size = ipywidgets.BoundedIntText(value=12, min=4, max=LARGEST, description="new size")
        self.blank = ipywidgets.Button(description="blank city", icon="square-o")
        self.random = ipywidgets.Button(description="random city", icon="random")
        self.upload = ipywidgets.FileUpload(
            accept=".png",
            multiple=False,
            description="open PNG",
            tooltip=f"one pixel for each cell, at most {UPLOAD_BYTES // 1000} kB",
        )
        self.upload.add_class("uavdh-open-png")
        self.tool = ipywidgets.ToggleButtons(
            options=["brush", "rectangle", "fill"],
            description="tool",
            tooltips=[
                "paint cell by cell",
                "drag from corner to corner",
                "paint all that touches the cell and is of its kind",
            ],
            style={"button_width": "80px", "description_width": "80px"},
            layout=ROW,
        )
        self.mirror = ipywidgets.Dropdown(options=list(MIRRORS), description="mirror")
        self.undo, self.redo = undo_and_redo()
        self.brush = ipywidgets.ToggleButtons(
            options=list(BRUSHES),
            value="tall building",
            description="paint",
            style={"button_width": "125px", "description_width": "80px"},
            layout=ROW,
        )
        self.brush.add_class("uavdh-brush")
        self.swatches = ipywidgets.HTML(_swatches(), layout={"display": "none"})
        self.policy = ipywidgets.Dropdown(
            description="policy", layout={"width": "230px"}, style={"description_width": "50px"}
        )
        self.third = ipywidgets.Dropdown(
            options=[("none", "")],
            description="and with",
            tooltip="a third policy, next to greedy",
            layout={"width": "200px"},
            style={"description_width": "62px"},
        )
        self.number = ipywidgets.BoundedIntText(
            min=0, max=10**6, description="mission", tooltip="the number of the random mission"
        )
        self.number.layout.width = "160px"
        self.number.style.description_width = "58px"
        self.changed = changed_note()
        self.fly = ipywidgets.Button(
            description="fly", icon="plane", tooltip="the random mission of this number"
        )
        self.following = ipywidgets.Button(
            description="next mission", icon="step-forward", tooltip="the next random mission"
        )
        self.many = ipywidgets.Button(
            description=f"{MANY} missions",
            icon="bar-chart",
            tooltip="how they do on average, and the mission in which greedy is furthest behind",
        )
        self.at_once = ipywidgets.ToggleButton(
            description="fly at once", icon="bolt", tooltip="the mission again, after each stroke"
        )
        widths = {self.fly: 80, self.following: 130, self.at_once: 120, self.many: 130}
        for button, width in widths.items():
            button.layout.width = f"{width}px"
        self.picker = CellPicker(self.picked)
        # What is told stands beside the map, or in a row of its height: the map stays in its place
        self.message = ipywidgets.HTML(layout={"flex": "1 1 400px", "min_height": "28px"})
        self.result = ipywidgets.HTML()
        self.take_home = ipywidgets.HTML()
        self.seen = ipywidgets.HTML(layout={"min_height": "28px"})
        for told in (self.message, self.result, self.seen):
            told.add_class("uavdh-told")
        figure = Figure(figsize=(4.2, 4.25), dpi=150)
        self.ax = figure.add_axes((0.07, 0.05, 0.91, 0.9))
        self.canvas = Canvas(figure)
        self.stage = Stage(
            dropped=self.dropped,
            filled=lambda device, amount: self._fly(lambda: self._mission.fill(device, amount)),
            timed=lambda time: self._fly(lambda: replace(self._mission, flying_time=time)),
        )
        self.side = ipywidgets.VBox([self.seen, self.result], layout=BESIDE)
        self.views = ipywidgets.HBox([self.canvas.picture, self.side], layout=WRAP)

    def _listen(self) -> None:
        self.base.observe(lambda change: self._load(change.new), "value")
        self.blank.on_click(lambda _: self._take(Draft.blank(self.size.value).kinds))
        self.random.on_click(lambda _: self._draw_random())
        self.upload.observe(lambda change: self._read(change.new), "value")
        self.tool.observe(lambda _: self._forget_corner(), "value")
        self.undo.on_click(lambda _: self._go(-1))
        self.redo.on_click(lambda _: self._go(1))
        self.fly.on_click(lambda _: self._fly(self._drawn_mission))
        self.following.on_click(lambda _: self._fly_next())
        self.number.observe(lambda _: self._renumbers or self._fly(self._drawn_mission), "value")
        self.third.observe(lambda _: self._fly_with(), "value")
        self.many.on_click(lambda _: self._fly_many())
        self.at_once.observe(lambda _: self._fly_again(), "value")
        self.canvas.on_drag(
            lambda ax, points, began: self.stroke([cell_at(point) for point in points], began),
            lambda ax, x, y: self.look_from(cell_at((x, y))),
            self._fly_again,
        )
        self.canvas.on_key(lambda key: self._go({"z": -1, "y": 1}.get(key, 0)))

    def stroke(self, cells: list[Cell], began: bool = True) -> None:
        """Use the tool on these cells, one after the other.

        Arguments:
            began: whether the stroke begins with them; else they go on with the last one.
        """
        shown = self.draft.kinds.copy()
        if began:
            self._before, self._first, self._recorded = shown, cells[0], False
        if self.tool.value == "rectangle":
            self.draft = Draft(self._before)
            cells = rectangle(self._first, cells[-1])
        elif self.tool.value == "fill":
            cells = self.draft.region(cells[0]) if began else []
        for cell in self.draft.mirrored(cells, self.mirror.value):
            self.draft.paint(cell, self.brush.value)
        if (self.draft.kinds != shown).any():
            self._history.record(self.draft.kinds, new=not self._recorded)
            self._recorded, self._mine = True, self.draft.kinds.copy()
            self.base.value = MINE  # so that the city can be chosen again
            self._show()

    def picked(self, cell: Cell) -> None:
        """Use the tool on a cell that was picked by numbers; a rectangle takes two."""
        if self.tool.value != "rectangle":
            self.stroke([cell])
            self._fly_again()
        elif self._corner is None:
            self._corner = cell
            self._say("now pick the opposite corner")
        else:
            corner = self._corner
            self._show()
            self.stroke([corner, cell])
            self._fly_again()

    def _forget_corner(self) -> None:
        if self._corner is not None:
            self._show()

    def look_from(self, cell: Cell) -> None:
        """Show the shadow that a device in this cell would lie in, while the mouse is over it."""
        if cell == self._looked_from:
            return
        self._looked_from, size = cell, self.draft.size
        row, col = cell
        inside = 0 <= row < size and 0 <= col < size
        if not inside or self.draft.buildings[cell]:
            self.seen.value = ""
            self.canvas.draw()
            return
        if self._sight is None:
            self._sight = line_of_sight(self.draft.buildings)
        hidden = ~self._sight[cell] & ~self.draft.buildings
        open_cells = size**2 - self.draft.buildings.sum()
        self.seen.value = (
            f"A device in row {row}, column {col} sees {1 - hidden.sum() / open_cells:.0%} of the "
            "cells without a building; the violet ones lie in its shadow."
        )
        shadow = self.ax.imshow(shadow_colours(3.0 * hidden), zorder=0.2, animated=True)
        (device,) = self.ax.plot(col, row, "X", color=device_colour(0), ms=10, animated=True)
        self.canvas.draw([(self.ax, artist) for artist in (shadow, *self.ax.collections, device)])
        shadow.remove()
        device.remove()

    def _load(self, name: str) -> None:
        if name != MINE:
            self._take(City.load(name).kinds, name)
        elif self._mine is not None and not np.array_equal(self._mine, self.draft.kinds):
            self._history.record(self._mine)
            self._set(self._mine)

    def _draw_random(self) -> None:
        """A city of the size that the field says, another one each time."""
        try:
            (city,) = CityGenerator(self.size.value).draw(1, self._drawn)
        except InputError:
            self._say("a random city has at least 8 cells on a side: make the size larger")
            return
        self._drawn += 1
        self._take(city.kinds)

    def _take(self, kinds: np.ndarray, name: str = MINE) -> None:
        """Go on with another city."""
        self._history.record(kinds)
        self._taken = kinds
        self._set(kinds, name)

    def _go(self, by: int) -> None:
        """Undo a step (-1), or redo one (1)."""
        if by and (kinds := self._history.move(by)) is not None:
            self._set(kinds)
            mission = self._mission
            hidden = mission is not None and self.stage not in self.side.children
            if hidden and np.array_equal(mission.city.kinds, kinds):  # its flights come back, too
                self._fly(lambda: mission)

    def _set(self, kinds: np.ndarray, name: str = MINE) -> None:
        self.draft = Draft(kinds)
        if name == MINE:
            self._mine = self.draft.kinds.copy()
        self.base.value = name
        self.picker.row.max = self.picker.column.max = self.draft.size - 1
        self._show()
        self._fly_again()

    def _read(self, files) -> None:
        """Use an uploaded PNG; if it is not a city, say why and change nothing."""
        if files:
            self._read_png(bytes(files[0]["content"]), files[0]["name"], UPLOAD)
            self.upload.value = ()  # so that the same file can be uploaded again

    def open_link(self, code: str) -> None:
        """Use the city of a link, a PNG, and fly the mission behind it, if there is one.

        If it holds no city, say why and change nothing.
        """
        if code == self._address():
            if COPIED not in self.message.value:
                self._say(HERE, TEXT)
            return
        city, has_mission, mission = code.partition(FLOWN)
        try:
            data = decode(city)
        except ValueError:
            self._say(f"the link holds no city: part of it is missing. {AGAIN}")
            return
        if self._read_png(data, "the link", AGAIN) and has_mission:
            self._fly_linked(mission)

    def _fly_linked(self, code: str) -> None:
        """Fly the mission of a link, in the city of that link."""
        try:
            mission = mission_in(code, self.draft.city())
        except InputError as error:
            self._say(f"the city of the link is here, its mission is not: {error}. {AGAIN}")
            return
        self._renumbers = True
        self.number.value = mission.seed  # if it was a random one, this was its number
        self._renumbers = False
        self._numbered = self._drawn_mission()
        self._fly(lambda: mission)

    def tell_link(self, copied: bool) -> None:
        """Say where the link is that was clicked."""
        self._say(COPIED if copied else HERE, TEXT)

    def _read_png(self, data: bytes, source: str, remedy: str) -> bool:
        """Use the city of a PNG, or say why not; returns whether it is used."""
        try:
            kinds = Draft.from_png(data).kinds
            if len(kinds) > LARGEST:
                raise CityError(f"{len(kinds)} cells on a side: at most {LARGEST} fit this editor")
            self._take(kinds)
        except CityError as error:
            self._say(f"{source}: {str(error).removeprefix('city: ')}. {remedy}")
            return False
        return True

    def _address(self) -> str:
        """What stands in a link: the city, and the mission that is flown in it."""
        shown = self.stage in self.side.children
        return self._code + (FLOWN + mission_code(self._mission) if shown else "")

    def _show(self) -> None:
        self._corner = self._sight = self._looked_from = None
        self.undo.disabled, self.redo.disabled = (not self._history.can(by) for by in (-1, 1))
        self.seen.value = ""
        self.ax.clear()
        draw_city(self.ax, self.draft).set(xlabel="", ylabel="")
        self.ax.set_title("paint here", fontsize="medium")
        self.canvas.draw_all()
        self.canvas.draw(alt=self.draft.description())
        if not self.at_once.value:
            self._hide_flights()
        self._png = self.draft.png()
        self._code = encode(self._png)
        self.unsaved = "" if np.array_equal(self.draft.kinds, self._taken) else self._code
        try:
            city = self.draft.city()
        except CityError as error:
            self._hide_flights()
            self._allow_flights(False)
            self._offer_home(None)
            self._say(str(error).removeprefix("my_city: "))
            return
        self._allow_flights(True)
        self._offer_policies(city)
        self._offer_home(city)
        self._say("")  # last: who reads it finds the rest done

    def _offer_home(self, city: City | None) -> None:
        """Offer the city as a file and as a link; None for one that is not finished."""
        coded = base64.b64encode(self._png).decode()
        save = link("save as PNG", f"data:image/png;base64,{coded}", "my_city.png")
        if city is None:
            self.take_home.value = save
            return
        if self._linked:
            save += f" or as a {link('link', f'#{ADDRESS}{self._address()}')}"
        if "any_city" in [name for _, name in self.policy.options]:
            command = FINE_TUNE
        else:
            command = TRAIN.format(devices=f"1 {min(3, len(city.device_cells))}")
        self.take_home.value = (
            f"{save}: the page keeps nothing when you leave it. To train an agent for this city: "
            f"<code>{html.escape(command)}</code>"
        )

    def _offer_policies(self, city: City) -> None:
        """Let one choose from the policies for this city."""
        names = policies_for(Environment(city))
        options = [(policy_title(name), name) for name in names]
        if self.policy.options != tuple(options):
            chosen = self.policy.value
            self.policy.options = options
            self.policy.value = chosen if chosen in names else names[0]
            self._offers, third = True, self.third.value
            self.third.options = [("none", ""), *options]
            self.third.value = third if third in names else ""
            self._offers = False

    def _allow_flights(self, allowed: bool) -> None:
        for button in (self.fly, self.following, self.many, self.at_once):
            button.disabled = not allowed

    def _hide_flights(self) -> None:
        """They were in another city."""
        self.side.children, self.result.value = [self.seen, self.result], ""
        self.changed.value = ""
        self._average = ""

    def _fly_again(self) -> None:
        """If that is asked for, fly the last mission again, or another one if it is none here."""
        if not self.at_once.value or self.fly.disabled:
            return
        city, last = self.draft.city(), self._mission
        if last is not None and last.city.size == city.size:
            with suppress(InputError):  # a device, or the start, is where none can be any more
                mission = replace(last, city=city)
                self._fly(lambda: mission)
                return
        if last is None:
            self._fly(self._drawn_mission)
        else:
            self._fly_next()

    def dropped(self, start: Cell, end: Cell) -> None:
        """Drag a device or the start from one cell to another. The same cell twice is a click: it
        adds a device, or takes it away."""
        mission = self._mission
        if start != end:
            self._fly(lambda: mission.drag(start, end))
        elif (device := mission.device_at(end)) is None:
            self._fly(lambda: mission.add(end))
        else:
            self._fly(lambda: mission.remove(device))

    def _drawn_mission(self) -> Mission:
        """The random mission of the number that is shown."""
        city = self.draft.city()
        self._numbered = Mission.draw(scenario_of(city), city, self.number.value)
        return self._numbered

    def _fly_with(self) -> None:
        """Let another third policy fly the mission that is shown."""
        mission = self._mission
        if not self._offers and self.stage in self.side.children:
            self._fly(lambda: mission)

    def _policies(self) -> list[str]:
        """The policy, greedy for comparison, and a third one if there is one."""
        chosen = (self.policy.value, "greedy", self.third.value)
        return list(dict.fromkeys(name for name in chosen if name))

    def _fly_next(self) -> None:
        self.number.value += 1

    def _fly_many(self) -> None:
        """Fly many missions, say how it went, and show the one in which greedy is furthest behind.

        All missions fly at once, so their fading differs from that of a mission flown alone.
        """
        city = self.draft.city()
        scenario, environment = scenario_of(city), Environment(city)
        missions = [Mission.draw(scenario, city, number) for number in range(MANY)]
        states = State.concatenate([mission.state for mission in missions])
        chosen, title = self.policy.value, policy_title(self.policy.value)
        self.result.value = f"{title} is flying {MANY} missions …"
        scores = {}
        for name in self._policies():
            policy = find_policy(name, environment)
            flights = fly(environment, policy, states, stream(Use.LAB))
            scores[name] = flights.records()["collected_and_landed"]
        self._average = told_average(chosen, scores)
        ahead, number = scores[chosen] - scores["greedy"], self.number.value
        if ahead.max() > TIE:
            number = int(ahead.argmax())
        if number == self.number.value:
            self._fly(self._drawn_mission)
        self.number.value = number  # which flies it

    def _fly(self, choose: Callable[[], Mission]) -> None:
        """Fly a mission, and the greedy planner for comparison; or say why it cannot be."""
        self._say("")
        try:
            mission, city = choose(), self.draft.city()
            environment = Environment(city)
            self.result.value = f"{self.policy.value} is planning …"
            flown = {
                name: mission.fly(environment, find_policy(name, environment))
                for name in self._policies()
            }
        except InputError as error:
            self._say(str(error))
            self.stage.put_back()
            return
        self._mission = mission
        told = [*map(self._told, flown, flown.values()), HINT]
        self.result.value = "<br>".join([self._average] * bool(self._average) + told)
        self.stage.most = {"data": 20.0, "time": 4 * city.size}
        titled = {policy_title(name): flights for name, flights in flown.items()}
        self.stage.show(environment, titled, begin=0)
        self.side.children = [self.seen, self.result, self.stage]
        say_changed(self.changed, self.number.value, is_changed(mission, self._numbered))
        self._offer_home(city)

    @staticmethod
    def _told(name: str, flights: Flights) -> str:
        """A flight in a line."""
        end, start = flights.end, flights.start
        brought = f"{end.data_collected.sum():.1f} of {start.data_initial.sum():.1f}"
        return (
            f"{policy_title(name)}: {'landed' if end.landed[0] else 'crashed'} after "
            f"{flights.steps[0]} of {start.time_left[0]} units of time, "
            f"{brought} data units collected."
        )

    def _say(self, text: str, colour: str = RED) -> None:
        self.message.value = status(text, colour)


def told_average(chosen: str, scores: dict[str, np.ndarray]) -> str:
    """How many missions went, from the share that each policy brought home in each of them."""
    title, greedy = policy_title(chosen), scores["greedy"]
    shares = [f"{policy_title(name)} {score.mean():.0%}" for name, score in scores.items()]
    told = [f"Over {len(greedy)} missions, collected and landed: {', '.join(shares)}."]
    fails = (greedy < FAILS).sum()
    told.append(f"Greedy fails in {fails}: it brings home less than half." if fails else "")
    if chosen == "greedy":
        return " ".join(filter(None, told))
    difference = scores[chosen] - greedy
    wins, losses = (difference > TIE).sum(), (difference < -TIE).sum()
    told.append(f"The {title} is ahead of greedy in {wins}, behind in {losses}.")
    if difference.mean() * (wins - losses) < 0:
        less, more = ("behind", "ahead") if wins > losses else ("ahead", "behind")
        told.append(f"It is {less} on average, as it is {less} by more than it is {more}.")
    furthest = [f"greedy in mission {difference.argmax()}"] * bool(wins)
    furthest += [f"the {title} in mission {difference.argmin()}"] * bool(losses)
    told.append(f"Furthest behind: {', '.join(furthest)}." if furthest else "")
    return " ".join(filter(None, told))


def _swatches() -> str:
    """A style sheet that puts what a brush paints, as the map shows it, before its name."""
    rules = []
    for place, kind in enumerate(BRUSHES.values(), start=1):
        figure = Figure(figsize=(0.3, 0.3), dpi=100)
        draw_city(figure.add_axes((0, 0, 1, 1)), Draft(np.full((1, 1), kind)))
        picture = base64.b64encode(png(figure)).decode()
        rules.append(
            f".uavdh-brush .widget-toggle-button:nth-child({place})::before "
            f"{{background-image: url(data:image/png;base64,{picture})}}"
        )
    return f"<style>{SWATCH}{''.join(rules)}</style>"
