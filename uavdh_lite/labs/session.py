"""A session: it hears what is done in the browser, and says what is to be drawn."""

import base64
import io
import json
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

from uavdh_lite.city import COLOURS, load_city, shipped_cities
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.labs import channel, compare, think, train
from uavdh_lite.labs.flights import Hangar, numbers, title
from uavdh_lite.labs.state import EMPTY, STORY, TOOLS, YOU, Stage, changed, random_mission
from uavdh_lite.missions import as_json
from uavdh_lite.player import film

TOGETHER = 0.7  # seconds between changes of one kind that are undone as one
KEPT = 100  # changes that can be undone
RANKED = 6  # flights of a session's ranking


SCRIPT = ("player.js", "labs/tools.js", "labs/stage.js")
STYLE = ("player.css", "labs/stage.css")


def read(*names: str) -> str:
    """Files of the package, one after the other."""
    package = Path(__file__).parents[1]
    return "\n".join((package / name).read_text(encoding="utf-8") for name in names)


class Session:
    """One city, one mission, and six tools to look at it.

    The state is a `Stage` that never changes: a message from the browser makes the next one, and
    `render` shows what it looks like. The browser draws it.

    Arguments:
        tool: one of `TOOLS`, to have it alone; all of them if None.
        city: the name of a shipped city.
        show: called with each scene: all that the browser draws, as JSON values.
        give: called with the name of a file and its content, as an address that a browser opens.
    """

    def __init__(
        self,
        tool: str | None = None,
        city: str = "manhattan",
        show: Callable[[dict[str, Any]], None] = lambda scene: None,
        give: Callable[[str, str], None] = lambda name, address: None,
    ):
        self._show, self._give = show, give
        self.stage = Stage.of(random_mission(load_city(city), STORY), tool or "compare")
        self._alone = tool is not None
        self._hangar = Hangar.of(self.stage.mission)
        self._history, self._at = [self.stage], 0
        self._last = ("", 0.0)  # the kind of the last change, and when it was
        self._race: train.Race | None = None
        self._seed = 0  # of the next race
        self._point: tuple[int, int] | None = None
        self._extra: dict[str, Any] = {}  # what was asked for, until the mission changes
        self._ranking: list[dict] = []
        self._refused, self._answered, self._version, self._film = "", 0, 0, ""
        self._fresh = True
        self._lock = threading.Lock()
        self._asked = {
            "undo": self._undo,
            "fly": self._fly,
            "duel": self._duel,
            "many": lambda: self._add("many", compare.many(self.stage, self._hangar)),
            "values": lambda step: self._add(
                "values", think.values(self.stage, self._hangar, step)
            ),
            "shadow": self._shadow,
            "train": self._train,
            "pause": lambda: self._race and self._race.pause(),
            "point": self._see,
            "save": self._save,
        }
        self.render()

    def hear(self, told: dict[str, Any]) -> None:
        """Do what a message says, or say why it was not done."""
        values = dict(told)
        kind = values.pop("kind", "")
        self._refused = ""
        try:
            if kind in self._asked:
                self._asked[kind](**values)
            else:
                self._take(changed(self.stage, kind, values), kind)
        except InputError as error:
            self._refused = str(error)
        except Exception as error:  # whatever it is, the reader must see it
            self._refused = f"this did not work: {type(error).__name__}: {error}"
        self._answered += 1
        self._fresh = False
        self.render()

    def render(self) -> None:
        """Show what the stage looks like now."""
        with self._lock:
            flights = self._flights()
            drawn = film(self._hangar.environment, flights)
            if (text := json.dumps(drawn)) != self._film:
                self._film, self._version = text, self._version + 1
            self.scene = {
                "tools": [self.stage.tool] if self._alone else list(TOOLS),
                "state": self._summary(),
                "film": drawn,
                "version": self._version,
                "panel": self._panel(flights),
                "refused": self._refused,
                "answered": self._answered,
                "fresh": self._fresh,
            }
            self._show(self.scene)

    def close(self) -> None:
        """Pause a training for good."""
        if self._race is not None:
            self._race.pause()

    def _summary(self) -> dict[str, Any]:
        stage, mission = self.stage, self.stage.mission
        policies = [*self._hangar.known, *[YOU] * bool(stage.flown)]
        cities = [*shipped_cities(), *EMPTY]
        pairs = zip(mission.devices, mission.data, strict=True)
        return {
            "tool": stage.tool,
            "city": mission.city.name,
            "cities": cities if mission.city.name in cities else [mission.city.name, *cities],
            "start": list(mission.start),
            "devices": [{"cell": list(cell), "data": data} for cell, data in pairs],
            "most": mission.max_devices,
            "flying_time": mission.flying_time,
            "policies": list(stage.policies),
            "known": [[name, title(name)] for name in policies],
            "step": stage.step,
            "device": stage.device,
            "link": stage.link,
            "undo": self._at > 0,
            "redo": self._at < len(self._history) - 1,
        }

    def _flights(self) -> dict[str, Trajectory]:
        """The flights that are drawn, by their names; the ghost is the second one."""
        stage, hangar = self.stage, self._hangar
        if stage.tool == "train" and self._race and self._point:
            run, point = self._point
            steps = self._race.runs[run].points[point]["steps"]
            flight = self._race.flight(run, point, stage.mission)
            return {f"{train.COLOURS[run]}'s agent after {steps:,} steps": flight}
        if stage.tool == "fly":
            names = [YOU, self._ghost]
        elif stage.tool == "compare":
            names = list(stage.policies)
        elif stage.tool == "think":
            names = [think.agent_of(stage, hangar) or stage.policies[0]]
        else:
            names = [stage.policies[0]]
        flights = [(title(name), hangar.flight(stage, name)) for name in names]
        again = len(flights) == 2 and flights[0][0] == flights[1][0]
        return dict([flights[0], (f"{flights[1][0]} again", flights[1][1])] if again else flights)

    @property
    def _ghost(self) -> str:
        return "greedy" if self.stage.policies[1] == YOU else self.stage.policies[1]

    def _panel(self, flights: dict[str, Trajectory]) -> dict[str, Any]:
        """What the tool shows next to the map."""
        stage, hangar = self.stage, self._hangar
        panel = dict(self._extra)
        if stage.tool == "compare":
            panel |= compare.scene(stage, hangar)
        elif stage.tool == "think":
            panel |= think.scene(stage, hangar)
        elif stage.tool == "channel":
            panel |= channel.scene(stage, hangar)
        elif stage.tool == "train":
            panel |= train.scene(self._race, self._point)
        elif stage.tool == "fly":
            you, ghost = flights.values()
            panel |= {"you": numbers(you), "ghost": numbers(ghost), "rival": self._ghost}
            panel |= {"ranking": self._ranking[:RANKED], "rival_name": title(self._ghost)}
        return panel

    def _take(self, stage: Stage, kind: str) -> None:
        """Go on with another stage; a change of its mission can be undone."""
        if stage.mission is not self.stage.mission:
            soon = self._last[0] == kind and time.monotonic() - self._last[1] < TOGETHER
            if soon and kind in ("move", "data", "time"):
                self._history[self._at] = stage
            else:
                self._history = [*self._history[: self._at + 1], stage][-KEPT:]
                self._at = len(self._history) - 1
            self._last = kind, time.monotonic()
            self._extra, self._point = {}, None
        self.stage = stage
        self._hangar = Hangar.of(stage.mission, self._hangar)

    def _fly(self, action: str) -> None:
        """Fly one action by hand."""
        if numbers(self._hangar.flight(self.stage, YOU))["ended"]:
            raise InputError("this flight is over: press Again")
        self._take(changed(self.stage, "fly", {"action": action}), "fly")
        you = numbers(self._hangar.flight(self.stage, YOU))
        if you["ended"]:  # it is kept, the best first
            ghost = numbers(self._hangar.flight(self.stage, self._ghost))
            mission = self.stage.mission
            told = {"city": mission.city.name, "time": mission.flying_time, **you}
            told["ahead"] = you["return"] - ghost["return"]
            self._ranking = sorted([*self._ranking, told], key=lambda each: -each["ahead"])

    def _undo(self, by: int) -> None:
        at = self._at + (1 if by > 0 else -1)
        if not 0 <= at < len(self._history):
            raise InputError("there is nothing more to undo")
        tool, self._at = self.stage.tool, at
        self._extra, self._point = {}, None
        self.stage = changed(self._history[at], "tool", {"tool": tool})
        self._hangar = Hangar.of(self.stage.mission, self._hangar)

    def _duel(self, wanted: int) -> None:
        self._take(compare.find_duel(self.stage, self._hangar, wanted), "duel")

    def _add(self, name: str, value: Any) -> None:
        self._extra = {**self._extra, name: value}

    def _shadow(self, cell: list) -> None:
        self._add("shadow", {"cell": cell, "rows": channel.shadow(self._hangar, tuple(cell))})

    def _train(self, settings: list[str]) -> None:
        """Begin a race, or go on with it if the settings are those of the one there is."""
        if self._race is None or settings:
            if self._race is not None:
                self._race.pause()
            if self.stage.mission.city.size > train.LARGEST:
                village = changed(self.stage, "city", {"name": "village"})
                self._take(village, "city")
            self._point = None
            me = weakref.WeakMethod(self.render)
            told = lambda: (render := me()) and render()  # noqa: E731
            self._race = train.Race(self.stage.mission.city, settings, self._seed, told)
            self._seed += 2  # a new race is another one
        self._race.go_on()

    def _see(self, run: int, point: int) -> None:
        """Show the flight of the agent that got a point of the curves."""
        if self._race is None:
            raise InputError("nothing was trained yet: press start")
        if self.stage.mission.city.size > self._race.city.size:
            there = random_mission(self._race.city, self.stage.mission.seed)
            self._take(self.stage.with_mission(there), "city")
        self._race.flight(run, point, self.stage.mission)  # or say that there is none
        self._point = (run, point)

    def _save(self, what: str) -> None:
        """Give a file: the stage or its mission as JSON, or the city as a PNG."""
        mission = self.stage.mission
        if what == "png":
            picture = io.BytesIO()
            Image.fromarray(COLOURS[mission.city.kinds]).save(picture, "PNG")
            name, kind, content = f"{mission.city.name}.png", "image/png", picture.getvalue()
        else:
            values = as_json(mission) if what == "mission" else self.stage.as_json()
            name, kind = f"{mission.city.name}_{what}.json", "application/json"
            content = json.dumps(values, indent=1).encode()
        self._give(name, f"data:{kind};base64,{base64.b64encode(content).decode()}")
