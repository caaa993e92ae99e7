"""Fly it yourself with buttons or arrow keys, and compare your score with the policies'."""

import html

from uavdh_lite.city import shipped_cities
from uavdh_lite.environment import ACTIONS
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.views import Map, legend, policy_title
from uavdh_lite.labs.widgets import table
from uavdh_lite.missions import HandFlight, Mission, environment_of
from uavdh_lite.policies import find_policy, policies_for
from uavdh_lite.scenario import scenario_for

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
ICONS = ("arrow-up", "arrow-right", "arrow-down", "arrow-left", "pause", "download")


class FlyLab(ipywidgets.VBox):
    """Fly a random mission by hand; then every policy flies it, with the same fading.

    Arguments:
        city: the name of a shipped city to start with.
        seed: of the first mission.
    """

    def __init__(self, city: str = "manhattan", seed: int = 0):
        self.city = ipywidgets.Dropdown(options=shipped_cities(), value=city, description="city")
        self.seed = ipywidgets.BoundedIntText(
            value=seed, min=0, max=10**6, description="mission", tooltip="the mission's number"
        )
        self.again = ipywidgets.Button(description="start again", icon="undo")
        self.buttons = [
            ipywidgets.Button(description=action, icon=icon, layout={"width": "100px"})
            for action, icon in zip(ACTIONS, ICONS, strict=True)
        ]
        self.message, self.score = ipywidgets.HTML(), ipywidgets.HTML()
        self.map = Map()
        hint = (
            "With the mouse over the map: arrow keys to move, space to hover, Enter to land. The "
            "map takes all keys then."
        )
        super().__init__(
            [
                ipywidgets.HBox([self.city, self.seed, self.again]),
                ipywidgets.HBox(self.buttons),
                ipywidgets.HTML(hint),
                self.message,
                self.map.canvas.picture,
                self.score,
                legend(),
            ]
        )
        for number, button in enumerate(self.buttons):
            button.on_click(lambda _, number=number: self.act(number))
        self.key_events = self.map.canvas.on_key(self._pressed)
        self.again.on_click(lambda _: self._start())
        for control in (self.city, self.seed):
            control.observe(lambda _: self._start(), "value")
        self._start()

    def _start(self) -> None:
        """Start the chosen mission from its beginning."""
        self.environment = environment_of(self.city.value)
        scenario, city = scenario_for(self.city.value), self.environment.city
        self.flight = HandFlight(self.environment, Mission.draw(scenario, city, self.seed.value))
        self.map.set_city(self.environment, self.flight.mission, "your flight")
        self.score.value = ""
        self._show("")

    def _pressed(self, key: str) -> None:
        if key in KEYS:
            self.act(ACTIONS.index(KEYS[key]))

    def act(self, action: int) -> None:
        """Take one step, unless the flight is over."""
        if self.flight.ended:
            return
        outcome = self.flight.step(action)
        refused = f"{ACTIONS[action]} was refused: the UAV hovered instead, which costs 1"
        self._show(refused if outcome.intervened[0] else "")
        if self.flight.ended:
            self._fly_others()

    def _show(self, message: str) -> None:
        state = self.flight.state
        self.map.show(self.flight.flights())
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
            self.score.value = self._table(results) + f"<p>{html.escape(title)} is flying …</p>"
            policy = find_policy(name, self.environment, mission.seed)
            results[title] = mission.fly(self.environment, policy)
        self.score.value = self._table(results)

    def _table(self, results: dict[str, Flights]) -> str:
        rows = [("", "landed", "collected", "steps", "return")]
        rows += [
            (
                name,
                "yes" if flights.end.landed[0] else "crashed",
                f"{flights.end.collection_ratio[0]:.0%}",
                str(flights.steps[0]),
                f"{flights.cumulative_reward[0]:.2f}",
            )
            for name, flights in results.items()
        ]
        return table(rows)
