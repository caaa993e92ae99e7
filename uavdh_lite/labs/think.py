"""Watch it think: the Q-values, the policy and what the network sees, at each step of a flight."""

import numpy as np
from matplotlib.figure import Figure

from uavdh_lite.agent import Agent, saliency, value_map
from uavdh_lite.ddqn import only_allowed, softmax_policy
from uavdh_lite.environment import ACTIONS, State
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import Flights, Policy
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.mission import WIDE, MissionLab
from uavdh_lite.observation import LAYERS
from uavdh_lite.plotting import BLUE

with extra("notebooks"):
    import ipywidgets

NO_AGENT = "Choose an agent: all cities but metropolis have one."
CHOSEN, OTHER = BLUE, "#BBBBBB"


class Thoughts:
    """What an agent computes at each step of one flight; a policy without Q-values has nothing."""

    def __init__(self):
        figure = Figure(figsize=(7.9, 4.2), dpi=100)
        grid = figure.add_gridspec(
            2, 6, left=0.08, right=0.99, top=0.92, bottom=0.08, wspace=0.1, hspace=0.3
        )
        self.bars, self.chances = (figure.add_subplot(grid[row, :2]) for row in (0, 1))
        self.pictures = [figure.add_subplot(grid[k // 4, 2 + k % 4]) for k in range(7)]
        self.canvas = Canvas(figure)
        self.temperature = 0.1
        self.agent: Agent | None = None

    def set_flight(self, name: str, flights: Flights, policy: Policy, last: int) -> None:
        """Compute the Q-values of the whole flight and draw what does not change."""
        self.agent = policy if isinstance(policy, Agent) else None
        for ax in self.canvas.figure.axes:
            ax.clear()
            ax.axis("on" if self.agent else "off")
        if self.agent is None:
            self.bars.text(0, 0.5, f"{name} has no Q-values. {NO_AGENT}")
            self.canvas.draw_all()
            return
        self.states = [state for state, *_ in flights.history[: flights.steps[0]]]
        states = State.concatenate(self.states)
        self.q = only_allowed(self.agent.q_values(states), self.agent.allowed(states))
        known = self.q[self.q.isfinite()]
        low, high = float(known.min()), float(known.max())
        self.bars.set(title="Q-values", xlim=(min(low, 0) - 1, max(high, 0) + 1))
        self.chances.set(title="softmax policy", xlim=(0, 1))
        self.changing = [
            (ax, bar)
            for ax in (self.bars, self.chances)
            for bar in ax.barh(ACTIONS, np.zeros(len(ACTIONS)), color=OTHER)
        ]
        for ax in (self.bars, self.chances):
            ax.invert_yaxis()
        self.images = self._add_images()
        self.canvas.draw_all()

    def _add_images(self) -> list:
        """Seven empty pictures, each with its scale: five layers, saliency, largest Q-values."""
        width, size = self.agent.observation.width, self.agent.city.size
        most = max(float(self.states[0].data_initial.max()) / self.agent.recipe.data_scale, 1e-6)
        images = []
        for k, ax in enumerate(self.pictures):
            name = (*LAYERS, "saliency", "largest Q-value")[k]
            side = size if k == 6 else width
            colours = "viridis" if k == 6 else "magma_r"
            image = ax.imshow(np.zeros((side, side)), cmap=colours, animated=True)
            image.set_clim(0, most if k in (3, 4) else 1)
            ax.set_title(name, fontsize="small")
            ax.set(xticks=[], yticks=[])
            images.append(image)
        return images

    def show(self, step: int) -> None:
        """Show the numbers and pictures of a step."""
        if self.agent is None:
            self.canvas.draw()
            return
        step = min(step, len(self.states) - 1)
        state, q = self.states[step], self.q[step]
        chances = softmax_policy(q[None], self.temperature)[0]
        bars = q.nan_to_num(neginf=0)  # an action that is not allowed has no bar
        values = [*bars.tolist(), *chances.tolist()]
        for number, ((_, bar), value) in enumerate(zip(self.changing, values, strict=True)):
            bar.set_width(value)
            bar.set_color(CHOSEN if number % len(ACTIONS) == int(q.argmax()) else OTHER)
        full_map = self.agent.observation.full_map(state)[0]
        seen = saliency(self.agent, state)
        worth = value_map(self.agent, state)
        layers = [*full_map[: len(LAYERS)].numpy(), seen / max(seen.max(), 1e-9), worth]
        for image, layer in zip(self.images, layers, strict=True):
            image.set_data(layer)
        self.images[-1].set_clim(np.nanmin(worth), np.nanmax(worth))
        pictures = list(zip(self.pictures, self.images, strict=True))
        self.canvas.draw(pictures + self.changing)


class ThinkLab(MissionLab):
    """One flight, and next to it what the agent computes at each step.

    Arguments:
        city: the name of a shipped city with an agent.
    """

    def _side(self) -> Thoughts:
        return Thoughts()

    def _controls(self) -> ipywidgets.Widget:
        self.temperature = ipywidgets.FloatLogSlider(
            value=0.1, base=10, min=-2, max=1, description="temperature", style=WIDE
        )
        self.temperature.observe(lambda change: self._set_temperature(change.new), "value")
        controls = super()._controls()
        chosen = [widget for widget in controls.children[0].children if widget is not self.other]
        controls.children[0].children = [*chosen, self.temperature]
        return controls

    def _set_temperature(self, value: float) -> None:
        self.charts.temperature = value
        self._show()
