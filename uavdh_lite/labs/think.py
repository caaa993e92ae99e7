"""Watch it think: the Q-values, the policy and what the network sees, at each step of a flight."""

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from torch import Tensor

from uavdh_lite.agent import Agent
from uavdh_lite.ddqn import softmax_policy
from uavdh_lite.environment import ACTIONS, State
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import Flights, Policy
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.insight import returns, saliency, value_map
from uavdh_lite.labs.mission import FADING, LABEL, POLICIES, SCORES, MissionLab
from uavdh_lite.labs.widgets import WRAP, quiet
from uavdh_lite.observation import LAYERS
from uavdh_lite.plotting import BLUE
from uavdh_lite.registry import names as known_names

with extra("notebooks"):
    import ipywidgets

CHOSEN, OTHER = BLUE, "#BBBBBB"
PLACE = 770, 476  # the width and height of all pictures, pixels
BELOW = 0.29  # the ranges lie so far below the middle of a row, in rows
UAV = {  # its mark: a ring around its cell that can be seen on any colour
    "clip_on": False,
    "mfc": "none",
    "mec": "black",
    "mew": 0.8,
    "path_effects": [withStroke(linewidth=2, foreground="white")],
}
RING = 0.75  # its radius in cells, and at least so many points:
SMALLEST_RING = 3.2
THICK, THIN = 6.5, 1.2  # the lines of the ranges
HALF, MOST = (0.25, 0.75), (0.1, 0.9)  # the parts of a distribution that are drawn as ranges
FORBIDDEN = "not allowed"
BROKEN = "does not begin at 0"  # the axis of the bars
TO_BEST = 1.52  # where the column of differences ends, in widths of the bars
BESIDE = {"ha": "right", "va": "center", "fontsize": "small", "animated": True}
WORDS = {
    "Q-value": "the return that the agent expects from here on if it takes this action now and "
    "flies on as it thinks best. It was learned with a discount: what comes later counts less. "
    "Of actions that it hardly ever takes it has learned little, so their values may be far off: "
    "that of landing before there is a need to, even in the landing zone",
    "action gap": "how much the best action's Q-value is above the next one's. A small gap is a "
    "close call: an error of the network could turn it round",
    "to best": "how much less than the best action's this Q-value is",
    FORBIDDEN: "an action that the agent cannot choose here: a move off the edge of the map, into "
    "a tall building or a no-fly zone, a landing outside of the landing zone, or one after which "
    "too little time might be left to fly home (the failsafe). Agents without a failsafe, such as "
    "<i>manhattan_ddqn</i>, may choose any; the safety controller then refuses it",
    "lines below the bars": "where the middle 50% (thick) and 80% (thin) of the returns lie that "
    "the agent expects, for agents that learned quantiles. ◂ at the left end: it goes on, beyond "
    "what is drawn",
    "softmax policy": "the chance of each action in training, exp(Q/temperature) in proportion. "
    "It shows how sure the agent is: when it flies for real, it takes the best action",
    "temperature": "low: the best action nearly always; high: all actions alike",
    "layers": "the maps that the network sees, shifted so that the UAV is in the middle: "
    "landing zone, no-fly zone (with tall buildings and all beyond the map), buildings, data left, "
    "data collected",
    "saliency": "which cells of these maps would change the chosen action's Q-value most, and by "
    "how much, roughly, if they were empty",
    "largest Q-value": "what the best action would be worth if the UAV were in that cell now",
}


class Thoughts:
    """What an agent computes at each step of one flight; a policy without Q-values has nothing.

    | attribute | meaning |
    | --- | --- |
    | `q` | the Q-values at each step, (T, 6); −∞ for actions that the failsafe forbids |
    | `returns` | quantiles of the return, (T, 6, N), where the agent has learned them |
    | `sizes` | for each step, how large the stage draws each action, 0 to 1; None: not allowed |
    """

    def __init__(self):
        figure = Figure(figsize=(PLACE[0] / 100, PLACE[1] / 100), dpi=130)
        self.bars = _axes(figure, 66, 26, 190, 200, facecolor="none")
        self.chances = _axes(figure, 366, 26, 62, 200, facecolor="none")
        self.key = _axes(figure, 508, 22, 262, 454, facecolor="none")
        seen = [(508 + 136 * (k % 2), 40 + 142 * (k // 2), 124) for k in range(len(LAYERS))]
        made = [(66 + 206 * k, 276, 150) for k in range(2)]
        self.pictures = [_axes(figure, x, y, side, side) for x, y, side in (*seen, *made)]
        self.scales = [_axes(figure, x + 36, y + 156, 78, 7) for x, y, _ in made]
        self.canvas = Canvas(figure, lambda: self.show(self._step))
        self.temperature = 0.1
        self.agent: Agent | None = None
        self.sizes: list[list[float | None]] = []
        self._step = 0

    def set_flight(self, name: str, flights: Flights, policy: Policy, last: int) -> None:
        """Compute the Q-values of the whole flight and draw what does not change."""
        self.agent, self.sizes = policy if isinstance(policy, Agent) else None, []
        for ax in self.canvas.figure.axes:
            ax.clear()
            ax.axis("on" if self.agent else "off")
        if self.agent is None:
            self.bars.text(0, 0.5, f"{name} has no Q-values. Choose an agent.")
            self.canvas.draw_all()
            return
        history = flights.history[: flights.steps[0]]
        self.states = [state for state, *_ in history]
        self.flown = [
            ACTIONS[int(action[0])] + ", refused" * bool(outcome.intervened[0])
            for _, action, outcome, *_ in history
        ]
        states = State.concatenate(self.states)
        self.q = self.agent.q_values(states)
        self.returns = returns(self.agent, states)
        self.sizes = [_sizes(values) for values in self.q]
        self._add_bars()
        self.images = self._add_images()
        self._add_key()
        self.canvas.draw_all()

    def _add_bars(self) -> None:
        """Bars without length, a number at the right of each, and below each bar its ranges."""
        aside, thick = (0.0, 0.6) if self.returns is None else (0.13, 0.46)
        self.bars.set_title("Q-values", fontsize="medium", loc="left")
        if self.returns is not None:
            self._add_range_key()
        self.bars.text(
            *(TO_BEST, 1.02), "to best", transform=self.bars.transAxes, ha="right", fontsize="small"
        )
        self.chances.set(xlim=(0, 1), xticks=())
        self.chances.set_title("softmax policy", fontsize="medium", loc="left")
        rows = np.arange(len(ACTIONS))
        for ax, names in ((self.bars, ACTIONS), (self.chances, ())):
            ax.set(ylim=(len(ACTIONS) - 0.4, -0.6), yticks=rows[: len(names)], yticklabels=names)
            ax.spines[["top", "right", "left"]].set_visible(False)
            ax.tick_params(left=False)
        self.chances.spines["bottom"].set_visible(False)
        self.base = self.bars.axvline(0, color="black", lw=0.8, animated=True)
        self.bars.xaxis.set_animated(True)  # the axis fits what is shown
        self.begins = self.bars.text(
            *(1.1, -0.08), "", transform=self.bars.transAxes, fontsize="small", animated=True
        )
        self.begins.set_va("center")
        self.chances.axvline(0, color="black", lw=0.8)
        self.changing = [
            (ax, bar)
            for ax, off, height in ((self.bars, aside, thick), (self.chances, 0, 0.6))
            for bar in ax.barh(
                rows - off, np.zeros(len(ACTIONS)), height, color=OTHER, animated=True
            )
        ]
        self.numbers = [
            ax.text(0, row, "", va="center", animated=True, transform=ax.get_yaxis_transform())
            for ax in (self.bars, self.chances)
            for row in rows
        ]
        self.less = [
            self.bars.text(TO_BEST, row, "", **BESIDE, transform=self.bars.get_yaxis_transform())
            for row in rows
        ]
        self.ranges = [
            self.bars.hlines(rows, 0, 0, lw=width, animated=True) for width in (THICK, THIN)
        ]
        self.aside = aside
        (self.cut,) = self.bars.plot([], [], "<", color="black", ms=7, animated=True)
        self.cut.set_clip_on(False)

    def _add_range_key(self) -> None:
        """What the lines below the bars are, next to the title."""
        for x, width, said in ((0.4, THICK, "50%"), (0.69, THIN, "80% of returns")):
            place = {"transform": self.bars.transAxes, "clip_on": False}
            butt = {"solid_capstyle": "butt"}
            self.bars.plot([x, x + 0.09], [1.055] * 2, color="black", lw=width, **butt, **place)
            self.bars.text(x + 0.11, 1.02, said, fontsize="small", **place)

    def _limits(self, step: int) -> tuple[float, float]:
        """The ends of the axis of the bars: they fit the best three actions and their ranges."""
        (allowed,) = self.q[step].isfinite().nonzero(as_tuple=True)
        known = self.q[step, allowed].sort(descending=True).values
        low, high = float(known[:3].min()), float(known.max())
        if self.returns is not None:
            best = self.q[step].topk(min(3, len(known))).indices
            ends = self.returns[step, best].quantile(torch.tensor(MOST), dim=1)
            low, high = min(low, float(ends.min())), max(high, float(ends.max()))
        if 0 < low < 0.4 * high:
            low = 0.0
        elif 0 > high > 0.4 * low:
            high = 0.0
        room = 0.06 * max(high - low, 0.5)
        return low - room, high + room

    def _add_images(self) -> list:
        """Seven empty pictures, each with its scale: five layers, saliency, largest Q-values."""
        width, size = self.agent.observation.width, self.agent.city.size
        most = max(float(self.states[0].data_initial.max()) / self.agent.recipe.data_scale, 1e-6)
        images, self.marks = [], []
        for k, ax in enumerate(self.pictures):
            name = (*LAYERS, "saliency", "largest Q-value")[k]
            side = size if k == 6 else width
            colours = "viridis" if k == 6 else "magma_r"
            image = ax.imshow(np.zeros((side, side)), cmap=colours, animated=True)
            image.set_clim(0, most if k in (3, 4) else 1)
            ax.set_title(name, fontsize="medium" if k > 4 else "small", pad=3)
            ax.set(xticks=[], yticks=[])
            images.append(image)
            cell = 72 * ax.get_position().width * PLACE[0] / 100 / side  # points
            ring = 2 * max(RING * cell, SMALLEST_RING)
            (mark,) = ax.plot([], [], "o", ms=ring, animated=True, **UAV)
            self.marks.append(mark)
        self.outline = LineCollection([], colors="#888888", linewidths=0.5, animated=True)
        self.pictures[len(LAYERS)].add_collection(self.outline, autolim=False)
        self._add_scales()
        return images

    def _add_scales(self) -> None:
        """The colours of saliency and of the largest Q-values, and which map they are on."""
        self.ends = []
        centred = "around the UAV" if self.agent.observation.kind != "non_centred" else "of the map"
        about = (f"{centred}; grey: buildings", "of the city; white: no flying")
        for ax, colours, said in zip(self.scales, ("magma_r", "viridis"), about, strict=True):
            ax.imshow(np.linspace(0, 1, 64)[None], cmap=colours, aspect="auto")
            ax.set(xticks=[], yticks=[])
            for x, side in ((-0.06, "right"), (1.06, "left")):
                number = ax.text(x, 0.4, "", ha=side, va="center", transform=ax.transAxes)
                number.set(fontsize="small", animated=True)
                self.ends.append(number)
            ax.text(0.5, -2.6, said, ha="center", transform=ax.transAxes, fontsize="small")

    def _add_key(self) -> None:
        """What the pictures have in common, where a sixth layer would be."""
        key = self.key
        key.set(xlim=(0, 262), ylim=(454, 0))
        key.axis("off")
        key.set_title("what the network sees", fontsize="medium", loc="left", pad=5)
        key.plot(148, 322, "o", ms=8, **UAV)
        said = (
            "the UAV",
            "light: no, none",
            "dark: yes, much",
            "no-fly: also tall",
            "buildings, off map",
        )
        for number, line in enumerate(said):
            y = 322 + 19 * number + 4 * (number > 0)
            key.text(142 if number else 162, y, line, va="center", fontsize="small")

    def show(self, step: int) -> None:
        """Show the numbers and pictures of a step."""
        self._step = step
        if self.agent is None:
            self.canvas.draw()
            return
        step = min(step, len(self.states) - 1)
        state, q = self.states[step], self.q[step]
        chances = softmax_policy(q[None], self.temperature)[0]
        values = [*q.tolist(), *chances.tolist()]
        limits = self._limits(step)
        base = min(max(0.0, limits[0]), limits[1])
        self.bars.set_xlim(limits)
        self.base.set_xdata([base, base])
        self.begins.set_text("" if base == 0 else BROKEN)
        for number, ((_, bar), value) in enumerate(zip(self.changing, values, strict=True)):
            start = base if number < len(ACTIONS) else 0
            bar.set_x(start)  # an action that is not allowed has no bar
            bar.set_width(value - start if np.isfinite(value) else 0)
            bar.set_color(CHOSEN if number % len(ACTIONS) == int(q.argmax()) else OTHER)
        full_map = self.agent.observation(state)[0][0]
        seen = saliency(self.agent, state)
        worth = value_map(self.agent, state)
        layers = [*full_map[: len(LAYERS)].numpy(), seen / max(seen.max(), 1e-9), worth]
        for image, layer in zip(self.images, layers, strict=True):
            image.set_data(layer)
        self.images[-1].set_clim(np.nanmin(worth), np.nanmax(worth))
        self.outline.set_segments(_outlines(layers[LAYERS.index("buildings")] > 0))
        for number, end in zip(
            self.ends, (0, seen.max(), np.nanmin(worth), np.nanmax(worth)), strict=True
        ):
            number.set_text(f"{end:z.1f}".replace("-", "−"))
        allowed, (best, second) = q.isfinite().tolist(), q.topk(2).values.tolist()
        digits = 1 if best - second > 0.1 else 2
        for number, (text, value) in enumerate(zip(self.numbers, values, strict=True)):
            of_q, action = number < len(ACTIONS), number % len(ACTIONS)
            said = f"{value:z.{digits}f}".replace("-", "−") if of_q else f"{value:.0%}"
            text.set_text(said if allowed[action] else FORBIDDEN if of_q else "")
            low, high = text.axes.get_xlim()
            inside = of_q and not allowed[action]  # there is no bar
            text.set(x=0.02 + (base - low) / (high - low) if inside else 1.05 + 0.2 * of_q)
            text.set(ha="left" if inside or not of_q else "right", fontsize="small")
        for action, text in enumerate(self.less):
            behind = float(q.max() - q[action])
            text.set_text(f"−{behind:.{digits}f}" if 0 < behind < np.inf else "")
        self._place_marks(full_map, state)
        pictures = list(zip(self.pictures, self.images, strict=True))
        pictures.append((self.pictures[len(LAYERS)], self.outline))
        pictures += zip(self.pictures, self.marks, strict=True)
        axis = (self.bars.xaxis, self.base)
        numbers = [
            (text.axes, text) for text in (*self.numbers, *self.less, self.begins, *self.ends)
        ]
        shown = "Q-values, softmax policy, layers of the map, saliency, largest Q-values"
        self.canvas.draw(
            pictures
            + self.changing
            + self._ranges(step)
            + [(self.bars, each) for each in axis]
            + numbers,
            f"{shown}. {self.told(step)}",
        )

    def _place_marks(self, full_map: Tensor, state: State) -> None:
        """Mark the UAV: in the layers and the saliency, and in the map of the city."""
        row, col = divmod(int(state.uav_cell[0]), self.agent.city.size)
        middle = self.agent.observation.width // 2
        there = middle, middle
        if self.agent.observation.kind == "non_centred":  # its last layer says where
            there = divmod(int(full_map[-1].argmax()), full_map.shape[-1])
        for number, mark in enumerate(self.marks):
            y, x = (row, col) if number == len(LAYERS) + 1 else there
            mark.set_data([x], [y])

    def _ranges(self, step: int) -> list:
        """Where half and most of the returns of the allowed actions lie, as lines below the bars.

        What is cut off at the left has a mark there.
        """
        (allowed,) = self.q[step].isfinite().nonzero(as_tuple=True)
        edge = self.bars.get_xlim()[0]
        cut = [int(row) - self.aside for row in allowed if self.q[step, row] < edge]
        lines = []
        if self.returns is not None:
            lines = self.ranges
            for line, levels in zip(lines, (HALF, MOST), strict=True):
                ends = self.returns[step, allowed].quantile(torch.tensor(levels), dim=1).T
                rows = allowed + BELOW
                line.set_segments(
                    [[(low, y), (high, y)] for y, (low, high) in zip(rows, ends, strict=True)]
                )
                line.set_color(self.canvas.ink)
            cut += [float(y) for y, (low, _) in zip(rows, ends, strict=True) if low < edge]
        self.cut.set_data([edge] * len(cut), cut)
        return [(self.bars, each) for each in (*lines, self.cut)]

    def closest_call(self) -> int:
        """The step with the smallest action gap while there is data to collect, if there is any.

        0 for policies without Q-values.
        """
        if self.agent is None:
            return 0
        best, second = self.q.topk(2, dim=1).values.T
        data = torch.tensor([float(state.data_left.sum()) for state in self.states])
        return int((best - second).where((data > 0) | (data.max() == 0), torch.inf).argmin())

    def told(self, step: int) -> str:
        """What it does at a step and how sure it is, in a sentence; "" for other policies."""
        if self.agent is None:
            return ""
        before = f"Last step: {self.flown[min(step, len(self.flown)) - 1]}. " if step > 0 else ""
        if step >= len(self.states):
            return f"{before}The flight is over; shown is what it thought before this step."
        order = self.q[step].argsort(descending=True).tolist()
        best, second = (ACTIONS[action] for action in order[:2])
        gap = float(self.q[step, order[0]] - self.q[step, order[1]])
        if not np.isfinite(gap):
            return f"{before}Next: {best}; nothing else is allowed."
        return f"{before}Next: {best}. The action gap, to {second} as the next best, is {gap:.2f}."


def _axes(figure: Figure, x: int, y: int, width: int, height: int, **options) -> Axes:
    """Axes whose north-west corner is so many pixels from that of the figure."""
    whole, high = PLACE
    return figure.add_axes(
        (x / whole, 1 - (y + height) / high, width / whole, height / high), **options
    )


def _outlines(cells: np.ndarray) -> list[list[tuple[float, float]]]:
    """The borders, as lines from (x, y) to (x, y), between these cells, (W, W) bool, and others."""
    lines = []
    for row, col in np.argwhere(cells[1:] != cells[:-1]).tolist():
        lines.append([(col - 0.5, row + 0.5), (col + 0.5, row + 0.5)])
    for row, col in np.argwhere(cells[:, 1:] != cells[:, :-1]).tolist():
        lines.append([(col + 0.5, row - 0.5), (col + 0.5, row + 0.5)])
    return lines


def _sizes(q: Tensor) -> list[float | None]:
    """Q-values, (6,), from 0 for the smallest to 1 for the largest; None for −∞."""
    known = q[q.isfinite()]
    low, span = known.min(), (known.max() - known.min()).clamp(min=1e-6)
    return [float((each - low) / span) if each.isfinite() else None for each in q]


class ThinkLab(MissionLab):
    """One flight, and next to it what the agent computes at each step.

    Arguments:
        city: the name of a shipped city with an agent.
        painted: returns the city to fly as *my city*; see `CityMenu`.
    """

    words = WORDS | POLICIES | SCORES | FADING

    def _side(self) -> Thoughts:
        return Thoughts()

    def _views(self) -> ipywidgets.Widget:
        self.stage.layout = {"flex": "1 1 400px", "min_width": "0"}
        views = ipywidgets.HBox([self.stage, self.charts.canvas.picture], layout=WRAP)
        views.add_class("uavdh-beside")
        return views

    def _controls(self) -> ipywidgets.Widget:
        self.temperature = ipywidgets.FloatLogSlider(
            value=0.1, base=10, min=-2, max=1, description="temperature", style=LABEL
        )
        self.temperature.observe(lambda change: self._set_temperature(change.new), "value")
        self.closest = ipywidgets.Button(
            description="closest call",
            icon="balance-scale",
            tooltip="go to the step with the smallest action gap, while there is data to collect",
        )
        self.closest.on_click(lambda _: self._go_to(self.charts.closest_call()))
        controls = super()._controls()
        unused = self.other, self.third, self.guess
        chosen = [each for each in controls.children[0].children if each not in unused]
        controls.children[0].children = [*chosen, self.temperature, self.closest]
        return controls

    def _set_city(self, again: bool = False) -> None:
        """Offer those policies that have Q-values, if the city has any."""
        super()._set_city(again)
        thinking = [each for each in self.policy.options if each[1] not in known_names("policy")]
        if thinking and len(thinking) < len(self.policy.options):
            with quiet(self):
                chosen = self.policy.value
                self.policy.options, self.policy.value = thinking, chosen

    def _go_to(self, step: int) -> None:
        self.stage.step = step

    def _show(self) -> None:
        super()._show()
        self.sentence.value = self.charts.told(self.stage.step)

    def _set_temperature(self, value: float) -> None:
        self.charts.temperature = value
        self._show()
