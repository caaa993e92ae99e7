"""Fly it yourself with buttons or keys, and see how the policies do on the same mission."""

import html
from collections.abc import Callable, Sequence

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, LAND, MOVES, Outcome, State
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.draft import is_changed
from uavdh_lite.labs.links import (
    COPIED,
    HERE,
    encoded_mission,
    mission_of_file,
    mission_of_link,
)
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.mission import NONE, POLICIES, PRICES, SCORES
from uavdh_lite.labs.stage import BESIDE, Stage, together
from uavdh_lite.labs.views import policy_title
from uavdh_lite.labs.widgets import (
    TEXT,
    WRAP,
    changed_note,
    link,
    quiet,
    say_changed,
    status,
    table,
    undo_and_redo,
    words,
)
from uavdh_lite.missions import HandFlight, Mission
from uavdh_lite.policies import find_policy, policies_for

with extra("notebooks"):
    import ipywidgets

KEYS = {
    "ArrowUp": "north",
    "ArrowRight": "east",
    "ArrowDown": "south",
    "ArrowLeft": "west",
    " ": "hover",
    "Enter": "land",
}
UNDO = "z"
YOU = "you"
ADDRESS = "fly="  # what stands behind the # of an address that opens a mission to fly
HARD = (140, 92, 112, 249, 10)  # missions of manhattan: greedy leaves 30% or so, the genie nothing
WHY_HARD = (
    "A hard one: greedy, to the nearest device first, leaves nearly a third of the data, the "
    "genie none."
)
METRICS = "collected_and_landed", "return"  # of the session's scores
ICONS = ("arrow-up", "arrow-right", "arrow-down", "arrow-left", "pause", "download")
NARROW = {"width": "210px"}


class FlyLab(ipywidgets.VBox):
    """Fly a mission by hand; then every policy flies it, with the same fading.

    Arguments:
        city: the name of a shipped city to start with.
        seed: of the first mission.
        painted: returns the city to fly as *my city*; see `CityMenu`.
        linked: offer a link that opens the mission on the labs' page; see `open_link`.
    """

    _silent = False

    def __init__(
        self,
        city: str = "manhattan",
        seed: int = 0,
        painted: Callable[[], City] | None = None,
        linked: bool = False,
    ):
        self._linked = linked
        self._build(city, seed, painted)
        self.scores: dict[str, list[list[float]]] = {}
        self._scored: set[tuple[str, str]] = set()
        hint = "Arrow keys fly, space hovers, Enter lands, and z takes the last key back."
        chosen = [self.city, self.seed, self.changed, self.again, self.hard, self.upload]
        result = ipywidgets.VBox([self.verdict, self.beside, self.score, self.session])
        result.add_class("uavdh-result")
        super().__init__(
            [
                ipywidgets.HBox([*chosen, self.take_home], layout=WRAP),
                together(
                    [
                        ipywidgets.HBox(
                            [*self.buttons, self.undo, ipywidgets.HTML(hint)], layout=WRAP
                        ),
                        self.message,
                        ipywidgets.HBox([self.stage, result], layout=WRAP),
                    ]
                ),
                words(SCORES | POLICIES),
            ]
        )
        self.add_class("uavdh-fly")
        self._listen()
        self._begin(self._drawn())

    def _build(self, city: str, seed: int, painted: Callable[[], City] | None) -> None:
        self.city = CityMenu(city, painted, layout=NARROW, style={"description_width": "40px"})
        self.seed = ipywidgets.BoundedIntText(
            value=seed,
            min=0,
            max=10**6,
            description="mission",
            tooltip="the number of the random mission",
            style={"description_width": "55px"},
            layout={"width": "135px"},
        )
        self.changed = changed_note()
        self.again = ipywidgets.Button(description="start again", icon="undo")
        self.hard = ipywidgets.Button(
            description="a hard one",
            icon="puzzle-piece",
            tooltip="one of five of manhattan in which greedy leaves nearly a third of the data, "
            "the genie none",
        )
        self.upload = ipywidgets.FileUpload(
            accept=".json",
            multiple=False,
            description="open mission",
            tooltip="a file that the tab Mission has saved, or the command fly",
        )
        self.buttons = [
            ipywidgets.Button(description=action, icon=icon, layout={"width": "90px"})
            for action, icon in zip(ACTIONS, ICONS, strict=True)
        ]
        self.undo, _ = undo_and_redo()
        self.beside = ipywidgets.Dropdown(
            description="next to mine",
            options=[NONE],
            style={"description_width": "90px"},
            layout={"width": "280px"},
        )
        self.message = ipywidgets.HTML()
        self.verdict, self.score, self.session, self.take_home = (
            ipywidgets.HTML() for _ in range(4)
        )
        self.message.add_class("uavdh-sentence")
        self.stage = Stage(keys=[*KEYS, UNDO], pressed=self._pressed)
        self.stage.layout = BESIDE

    def _listen(self) -> None:
        for number, button in enumerate(self.buttons):
            button.on_click(lambda _, number=number: self.act(number))
        self.undo.on_click(lambda _: self.take_back())
        self.again.on_click(lambda _: self._begin(self.flight.mission))
        self.hard.on_click(lambda _: self._choose_hard())
        self.city.on_choice(lambda _: self._draw(), self._refuse)
        self.seed.observe(lambda _: self._draw(), "value")
        self.upload.observe(lambda change: self._read(change.new), "value")
        self.beside.observe(lambda _: self._show_beside(), "value")

    # Which mission is flown

    def _drawn(self) -> Mission:
        """The random mission of the number that is shown."""
        return Mission.draw(self.city.scenario, self.city.environment.city, self.seed.value)

    def _draw(self) -> None:
        if not self._silent:
            self._begin(self._drawn())

    def _begin(self, mission: Mission, message: str = "") -> None:
        """Start a mission over the chosen city from its beginning."""
        self.environment = self.city.environment
        self.flight = HandFlight(self.environment, mission)
        self._took_back = False
        say_changed(self.changed, self.seed.value, is_changed(mission, self._drawn()))
        if self._linked:
            address = f"#{ADDRESS}{encoded_mission(mission)}"
            self.take_home.value = f"or from a {link('link to this mission', address)}"
        self._forget()
        self._show(message)

    def _forget(self) -> None:
        """Nobody else has flown this mission yet."""
        self._results: dict[str, Flights] = {}
        self.score.value = self.verdict.value = ""
        with quiet(self):
            self.beside.options = [NONE]
        self.beside.layout.display = "none"

    def show(self, mission: Mission) -> None:
        """Start this mission, wherever it comes from and whatever its city."""
        with quiet(self):
            self.city.take(mission.city)
            self.seed.value = mission.seed  # if it was a random one, this was its number
        self._begin(mission)

    def open_link(self, code: str) -> None:
        """Start the mission of a link, its file in base64; if it is none, say why."""
        if code == encoded_mission(self.flight.mission):
            return
        try:
            mission = mission_of_link(code)
        except InputError as error:
            self._refuse(str(error))
        else:
            self.show(mission)

    def tell_link(self, copied: bool) -> None:
        """Say where the link is that was clicked."""
        self.message.value = status(COPIED if copied else HERE, TEXT)

    def _read(self, files) -> None:
        """Start the mission of an uploaded file; if it is none, say why and change nothing."""
        if not files:
            return
        name, data = files[0]["name"], bytes(files[0]["content"])
        self.upload.value = ()  # so that the same file can be opened again
        try:
            mission = mission_of_file(data)
        except InputError as error:
            self._refuse(f"{name}: {error}. Your flight is as it was")
        else:
            self.show(mission)

    def _choose_hard(self) -> None:
        """The next of the hard missions."""
        following = HARD.index(self.seed.value) + 1 if self.seed.value in HARD else 0
        moved = "The city is now manhattan. " if self.city.value != "manhattan" else ""
        with quiet(self):
            self.city.value, self.seed.value = "manhattan", HARD[following % len(HARD)]
        self._begin(self._drawn(), moved + WHY_HARD)

    # The flight

    def _pressed(self, key: str) -> None:
        if key in KEYS:
            self.act(ACTIONS.index(KEYS[key]))
        elif key == UNDO:
            self.take_back()

    def act(self, action: int) -> None:
        """Take one step, unless the flight is over."""
        if self.flight.ended:
            return
        before = self.flight.state
        outcome = self.flight.step(action)
        refused = MOVES[action] if outcome.intervened[0] else ()
        self._show(self._told(before, action, outcome), refused)
        if self.flight.ended:
            self._fly_others()

    def take_back(self) -> None:
        """Undo the last step: the mission's fading comes again as it was."""
        steps = self.flight.flights().history
        if not steps:
            self._show("There is no step to take back.")
            return
        flight = HandFlight(self.environment, self.flight.mission)
        for _, action, *_ in steps[:-1]:
            flight.step(int(action[0]))
        self.flight, self._took_back = flight, True
        self._forget()
        self._show(f"Step {len(steps)} is taken back: this session's table does not count it.")

    def _told(self, before: State, action: int, outcome: Outcome) -> str:
        """What a step brought, as a sentence."""
        does = "hovers" if ACTIONS[action] == "hover" else f"flies {ACTIONS[action]}"
        does = "lands" if action == LAND else does
        if outcome.intervened[0]:
            does = (
                f"{ACTIONS[action]} is refused, for {self._obstacle(before, action)}: it costs a "
                f"unit of time and {PRICES['safety']:g} of the return"
            )
        uploads = (before.data_left - self.flight.state.data_left)[0]
        brought = [
            f"device {k} uploads {_amount(units)} units"
            for k, units in enumerate(uploads.tolist())
            if units > 0
        ]
        step = before.time_left[0] - self.flight.mission.flying_time
        return f"Step {1 - step}: {does}; {', '.join(brought) or 'no upload'}."

    def _obstacle(self, state: State, action: int) -> str:
        """Why an action was refused."""
        if action == LAND:
            return "this is no landing zone"
        city = self.environment.city
        row, col = np.array(divmod(int(state.uav_cell[0]), city.size)) + MOVES[action]
        if not (0 <= row < city.size and 0 <= col < city.size):
            return "the map ends there"
        return "a tall building is there" if city.buildings[row, col] else "a no-fly zone is there"

    def _refuse(self, reason: str) -> None:
        """Say why something else than a step is not done."""
        self.message.value = status(reason)

    def _show(self, message: str, refused: Sequence[int] = ()) -> None:
        state, flights = self.flight.state, self.flight.flights()
        begin = max(int(flights.steps[0]) - 1, 0)  # the last step plays, the others have been seen
        self.stage.show(self.environment, {"your flight": flights}, begin, refused=refused)
        self.undo.disabled = not flights.history
        landed = "The UAV has landed." if state.landed[0] else "Out of time: crashed."
        now = landed if self.flight.ended else f"{state.time_left[0]} units of time left."
        said = html.escape(message)
        said = f"<b>{said}</b>" if len(refused) else said
        self.message.value = f'<span role="status">{html.escape(now)} {said}</span>'

    # The others

    def _fly_others(self) -> None:
        """Show your result and, as they come, the policies' on the same mission and fading."""
        mission, results = self.flight.mission, {YOU: self.flight.flights()}
        for name in policies_for(self.environment):
            title = policy_title(name)
            self.verdict.value = f"<p>{html.escape(title)} is flying …</p>"
            self.score.value = self._table(results)
            policy = find_policy(name, self.environment, mission.seed)
            results[title] = mission.fly(self.environment, policy)
        self._results = results
        self._score(results)
        self.verdict.value, self.score.value = self._verdict(results), self._table(results)
        with quiet(self):
            self.beside.options = [NONE, *(name for name in results if name != YOU)]
        self.beside.layout.display = None

    def _show_beside(self) -> None:
        """Play the chosen policy's flight next to yours."""
        if self._silent or not self._results:
            return
        flights = {"your flight": self._results[YOU]}
        if self.beside.value != NONE:
            flights[self.beside.value] = self._results[self.beside.value]
        self.stage.show(self.environment, flights, 0)

    def _verdict(self, results: dict[str, Flights]) -> str:
        """Your place among all, as sentences."""
        returns = {name: round(float(each.returns[0]), 2) for name, each in results.items()}
        yours, best = returns[YOU], max(returns.values())
        first = [name for name, value in returns.items() if value == best]
        above = [value for value in returns.values() if value > yours]
        said = [f"Your return is {yours:z.2f}"]
        if above:
            following = [name for name, value in returns.items() if value == min(above)]
            said[0] += f", {_difference(min(above) - yours)} behind {_listed(following)}."
        elif len(first) > 1:
            said[0] += f": nobody has more; {_listed(first[1:])} as much."
        else:
            said[0] += ": nobody has as much."
        if above and min(above) < best:
            said.append(f"The best has {best:z.2f}: {_listed(first)}.")
        if self._took_back:
            said.append("You took a key back, so this session's table does not count it.")
        said.append(f"The tab Mission shows more of each flight: there it is {self._number()}.")
        return f'<p role="status">{html.escape(" ".join(said))}</p>'

    def _number(self) -> str:
        """What the flown mission is called in the other labs."""
        if self.changed.value:
            return "the mission of the same file"
        return f"mission {self.seed.value} of {self.city.value}"

    def _score(self, results: dict[str, Flights]) -> None:
        """Count a mission's results, if it is flown for the first time in this session."""
        mission = self.environment.city.fingerprint, encoded_mission(self.flight.mission)
        if mission in self._scored:
            return
        self._scored.add(mission)
        if self._took_back:
            return
        for name, flights in results.items():
            records = flights.records()
            result = [records[metric][0] for metric in METRICS]
            self.scores.setdefault(name, []).append(result)
        means = {name: np.mean(scores, axis=0) for name, scores in self.scores.items()}
        rows = [("", "missions", "collected and landed", "return")]
        for name in sorted(means, key=lambda name: (*np.round(-means[name], 3), name)):
            collected, reward = means[name]
            rows.append((name, str(len(self.scores[name])), f"{collected:.0%}", f"{reward:z.2f}"))
        self.session.value = _ranking("this session, mean of all missions flown", rows)

    def _table(self, results: dict[str, Flights]) -> str:
        """All flights of this mission, the largest return first."""
        rows = [("", "landed", "collected", "steps", "return")]
        ranked = sorted(results.items(), key=lambda each: (-each[1].returns[0].round(2), each[0]))
        rows += [
            (
                name,
                "yes" if flights.end.landed[0] else "crashed",
                f"{flights.end.collected[0]:.0%}",
                str(flights.steps[0]),
                f"{flights.returns[0]:z.2f}",
            )
            for name, flights in ranked
        ]
        return _ranking("this mission", rows)


def _amount(units: float) -> str:
    return f"{units:.1f}" if units >= 0.1 else f"{units:.1g}"


def _difference(amount: float) -> str:
    """A difference of returns without needless digits."""
    return f"{amount:.1f}" if round(amount, 1) == round(amount, 2) else f"{amount:.2f}"


def _listed(names: Sequence[str]) -> str:
    """A, B and C."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _ranking(caption: str, rows: Sequence[Sequence[str]]) -> str:
    """A table with its heading, in which your row stands out."""
    said = table(rows).replace(">", f"><caption>{html.escape(caption)}</caption>", 1)
    return said.replace(f"<tr><td>{YOU}</td>", f'<tr class="uavdh-you"><td>{YOU}</td>')
