"""Fly it yourself with buttons or keys, and see how the policies do on the same mission."""

import html
from collections.abc import Callable, Sequence

import numpy as np

from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, LAND, MOVES, State
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.mission import POLICIES, PRICES, SCORES
from uavdh_lite.labs.stage import Stage
from uavdh_lite.labs.views import policy_title
from uavdh_lite.labs.widgets import WRAP, table, words
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
HARD = (140, 92, 112, 249, 10)  # missions of manhattan: greedy leaves 30% or so, the genie nothing
METRICS = "collection_ratio_and_landed", "cumulative_reward"  # of the session's scores
ICONS = ("arrow-up", "arrow-right", "arrow-down", "arrow-left", "pause", "download")


class FlyLab(ipywidgets.VBox):
    """Fly a random mission by hand; then every policy flies it, with the same fading.

    Arguments:
        city: the name of a shipped city to start with.
        seed: of the first mission.
        painted: returns the city to fly as *my city*; see `CityMenu`.
    """

    def __init__(
        self,
        city: str = "manhattan",
        seed: int = 0,
        painted: Callable[[], City] | None = None,
    ):
        self.city = CityMenu(city, painted)
        self.seed = ipywidgets.BoundedIntText(
            value=seed, min=0, max=10**6, description="mission", tooltip="the mission's number"
        )
        self.again = ipywidgets.Button(description="start again", icon="undo")
        self.hard = ipywidgets.Button(
            description="a hard one",
            icon="puzzle-piece",
            tooltip="one of five in which greedy leaves nearly a third of the data, the genie none",
        )
        self.buttons = [
            ipywidgets.Button(description=action, icon=icon, layout={"width": "100px"})
            for action, icon in zip(ACTIONS, ICONS, strict=True)
        ]
        self.message, self.verdict, self.score, self.session = (ipywidgets.HTML() for _ in range(4))
        self.message.add_class("uavdh-sentence")
        self.stage = Stage(keys=list(KEYS), pressed=self._pressed)
        self.scores: dict[str, list[list[float]]] = {}
        self._scored: set[tuple[str, int]] = set()
        hint = (
            "Click the map, or reach it with Tab: then the arrow keys move, space hovers, and "
            "Enter lands."
        )
        super().__init__(
            [
                ipywidgets.HBox([self.city, self.seed, self.again, self.hard], layout=WRAP),
                ipywidgets.HBox(self.buttons, layout=WRAP),
                ipywidgets.HTML(hint),
                self.message,
                self.verdict,
                self.stage,
                ipywidgets.HBox([self.score, self.session], layout=WRAP),
                words(SCORES | POLICIES),
            ]
        )
        for number, button in enumerate(self.buttons):
            button.on_click(lambda _, number=number: self.act(number))
        self.again.on_click(lambda _: self._start())
        self.hard.on_click(lambda _: self._choose_hard())
        self.city.on_choice(lambda _: self._start(), self._show)
        self.seed.observe(lambda _: self._start(), "value")
        self._start()

    def _start(self) -> None:
        """Start the chosen mission from its beginning."""
        self.environment = self.city.environment
        mission = Mission.draw(self.city.scenario, self.environment.city, self.seed.value)
        self.flight = HandFlight(self.environment, mission)
        self.score.value = self.verdict.value = ""
        self._show("")

    def _choose_hard(self) -> None:
        """The next of the hard missions."""
        following = HARD.index(self.seed.value) + 1 if self.seed.value in HARD else 0
        self.city.value, self.seed.value = "manhattan", HARD[following % len(HARD)]

    def _pressed(self, key: str) -> None:
        if key in KEYS:
            self.act(ACTIONS.index(KEYS[key]))

    def act(self, action: int) -> None:
        """Take one step, unless the flight is over."""
        if self.flight.ended:
            return
        before = self.flight.state
        outcome = self.flight.step(action)
        refused = (
            f"{ACTIONS[action]} was refused, for {self._obstacle(before, action)}. The UAV hovered "
            f"instead, which takes {PRICES['safety']:g} from the return"
        )
        if outcome.intervened[0]:
            self._show(refused, MOVES[action])
        else:
            self._show("")
        if self.flight.ended:
            self._fly_others()

    def _obstacle(self, state: State, action: int) -> str:
        """Why an action was refused."""
        if action == LAND:
            return "this is no landing zone"
        city = self.environment.city
        row, col = np.array(divmod(int(state.uav_cell[0]), city.size)) + MOVES[action]
        if not (0 <= row < city.size and 0 <= col < city.size):
            return "the map ends there"
        return "a tall building is there" if city.buildings[row, col] else "a no-fly zone is there"

    def _show(self, message: str, refused: Sequence[int] = ()) -> None:
        state, flights = self.flight.state, self.flight.flights()
        begin = max(int(flights.steps[0]) - 1, 0)  # the last step plays, the others have been seen
        self.stage.show(self.environment, {"your flight": flights}, begin, refused=refused)
        landed = "landed" if state.landed[0] else "out of time: crashed"
        now = landed if self.flight.ended else f"{state.time_left[0]} units of time left"
        left = ", ".join(
            f"device {k}: {amount:.1f}"
            for k, amount in enumerate(state.data_left[0])
            if state.data_initial[0, k] > 0
        )
        text = html.escape(f"{now}; data left: {left}")
        self.message.value = f'<span role="status">{text}<br><b>{html.escape(message)}</b></span>'

    def _fly_others(self) -> None:
        """Show your result and, as they come, the policies' on the same mission and fading."""
        mission, results = self.flight.mission, {"you": self.flight.flights()}
        for name in policies_for(self.environment):
            title = policy_title(name)
            self.verdict.value = f"<p>{html.escape(title)} is flying …</p>"
            self.score.value = self._table(results)
            policy = find_policy(name, self.environment, mission.seed)
            results[title] = mission.fly(self.environment, policy)
        self.verdict.value, self.score.value = self._verdict(results), self._table(results)
        self._score(results)

    def _verdict(self, results: dict[str, Flights]) -> str:
        """Your place among all, as a sentence, and where to see the best of the others."""
        returns = {name: float(each.cumulative_reward[0]) for name, each in results.items()}
        others = {name: value for name, value in returns.items() if name != "you"}
        ahead = [name for name, value in others.items() if returns["you"] > value + 0.005]
        best = max(others, key=lambda name: others[name])
        behind = ", ".join(ahead) if ahead else "nobody"
        text = (
            f"Your return is {returns['you']:.2f}. You are ahead of {behind}. "
            f"The best of the others is {best}, with {others[best]:.2f}: the mission lab shows its "
            f"flight, with the same city and the mission number {self.seed.value}."
        )
        return f'<p role="status">{html.escape(text)}</p>'

    def _score(self, results: dict[str, Flights]) -> None:
        """Count a mission's results, if it is flown for the first time in this session."""
        mission = self.environment.city.fingerprint, self.seed.value
        if mission in self._scored:
            return
        self._scored.add(mission)
        for name, flights in results.items():
            records = flights.records()
            result = [records[metric][0] for metric in METRICS]
            self.scores.setdefault(name, []).append(result)
        means = {name: np.mean(scores, axis=0) for name, scores in self.scores.items()}
        rows = [("this session", "missions", "collected and landed", "return")]
        for name in sorted(means, key=lambda name: (*np.round(-means[name], 3), name)):
            collected, reward = means[name]
            rows.append((name, str(len(self.scores[name])), f"{collected:.0%}", f"{reward:z.2f}"))
        self.session.value = table(rows)

    def _table(self, results: dict[str, Flights]) -> str:
        rows = [("", "landed", "collected", "steps", "return")]
        rows += [
            (
                name,
                "yes" if flights.end.landed[0] else "crashed",
                f"{flights.end.collection_ratio[0]:.0%}",
                str(flights.steps[0]),
                f"{flights.cumulative_reward[0]:z.2f}",
            )
            for name, flights in results.items()
        ]
        return table(rows)
