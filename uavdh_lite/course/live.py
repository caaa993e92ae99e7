"""A training that one watches: its curve, a flight, the best actions on the map, and knobs."""

import asyncio
import html
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, LAND, MOVES, Environment, State
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.one_file import Settings
from uavdh_lite.plotting import BLUE, ORANGE, draw_trajectory
from uavdh_lite.streams import Use, stream

with extra("notebooks"):
    import ipywidgets
    from IPython.display import display

SECONDS = 1.0  # between two pictures


def _price(settings: Settings, value) -> None:
    usual = Settings()
    grows = usual.crash_at_first, usual.crash_at_last
    settings.crash_at_first, settings.crash_at_last = grows if value == "grows" else (value, value)


def _follows(settings: Settings, value: str) -> None:
    settings.target_rate = Settings().target_rate if value == "follows" else 0.0


def _sets(name: str) -> Callable:
    return lambda settings, value: setattr(settings, name, value)


KNOBS: dict[str, tuple[tuple, object, Callable]] = {  # choices, the usual one, what it sets
    "price of a crash": ((0.0, 5.0, "grows", 20.0, 150.0), "grows", _price),
    "learning rate": ((0.0, 2e-4, 2e-3, 2e-2, 0.2), 2e-3, _sets("learning_rate")),
    "temperature": ((0.001, 0.1, 1.0, 10.0, 1000.0), 0.1, _sets("temperature")),
    "target network": (("follows", "frozen"), "follows", _follows),
    "memory": ((320, 40_000), 40_000, _sets("memory")),
}


class Live:
    """What is seen of a training while it runs; a cell shows it once, and each `show` draws anew.

    The knobs set the fields of `settings`, which the training's loop reads in every round. They act
    at once where the kernel passes their messages on while a cell runs, as ipykernel 7.4 does.

    Arguments:
        missions: a state with some missions, from which one is chosen to be watched.
    """

    def __init__(self, settings: Settings, environment: Environment, missions: State):
        self.settings, self.environment, self.missions = settings, environment, missions
        self.mission, self.drawn = 0, -np.inf
        self.points: list[tuple[float, ...]] = []
        self.handle: Any = None  # of the figure

    def _begin(self) -> None:
        knobs = []
        for name, (choices, usual, act) in KNOBS.items():
            knob = ipywidgets.SelectionSlider(options=choices, value=usual, description=name)
            knob.style.description_width = "8em"
            knob.observe(lambda change, act=act: act(self.settings, change["new"]), "value")
            knobs.append(knob)
        chosen = ipywidgets.Dropdown(
            options=range(len(self.missions)), value=self.mission, description="mission"
        )
        chosen.observe(lambda change: setattr(self, "mission", change["new"]), "value")
        rows = [ipywidgets.HBox(knobs[:3]), ipywidgets.HBox([*knobs[3:], chosen])]
        display(Knobs(rows))
        self.handle = display(Figure(figsize=(9, 3.9)), display_id=True)

    async def show(self, step: int, q_values: Callable[[State], np.ndarray], *shares) -> None:
        """Add a point to the curve, if there are shares, and draw when it is time.

        Arguments:
            q_values: (B, 6) of states, by the agent as it is now.
            shares: landed, and collected and landed.
        """
        if not self.handle:
            self._begin()
        if shares:
            self.points.append((step, *shares))
            if time.monotonic() - self.drawn > SECONDS or step >= self.settings.steps:
                self.handle.update(self.picture(q_values))
                self.drawn = time.monotonic()
        await asyncio.sleep(0)  # the kernel reads its messages now: a knob may have been turned

    def picture(self, q_values: Callable[[State], np.ndarray]) -> Figure:
        """The curve so far, and the chosen mission as the agent flies it now."""
        figure = Figure(figsize=(9, 3.9), layout="constrained")
        curve, flight = figure.subplots(1, 2, width_ratios=(1.3, 1))
        steps, landed, both = zip(*self.points, strict=True)
        curve.plot(steps, landed, "^:", color=ORANGE, ms=3, label="landed")
        curve.plot(steps, both, "o-", color=BLUE, ms=3, label="collected and landed")
        curve.set(xlim=(0, self.settings.steps), ylim=(-0.03, 1.03), xlabel="environment steps")
        curve.set(ylabel="share", title=f"after {steps[-1]:,} steps: {both[-1]:.0%}")
        curve.legend(loc="lower right")
        self.draw_mission(flight, q_values)
        return figure

    def draw_mission(self, ax: Axes, q_values: Callable[[State], np.ndarray]) -> Axes:
        """The chosen mission, flown by the best actions, and these in each cell at its start."""
        start, generator = self.missions[[self.mission]], stream(Use.LAB)
        act = FunctionPolicy(lambda state: np.asarray(q_values(state)).argmax(axis=1))
        flown = fly(self.environment, act, start, generator)
        draw_trajectory(ax, self.environment, flown.trajectory(0))
        cells = np.arange(self.environment.size**2, dtype=np.int16)
        everywhere = replace(start[np.zeros(len(cells), int)], uav_cell=cells)
        return draw_actions(ax, self.environment.cities[0], act.act(everywhere))


class Knobs(ipywidgets.VBox):
    """The knobs; a page without a kernel says which there are."""

    def _repr_mimebundle_(self, **options) -> dict:
        names = html.escape(", ".join(KNOBS))
        text = f"<p>In a running notebook there are knobs here: {names}, mission.</p>"
        return {**super()._repr_mimebundle_(**options), "text/html": text}


def draw_actions(ax: Axes, city: City, actions: np.ndarray) -> Axes:
    """An action for each free cell, (n,): arrows are moves, rings hover, diamonds land."""
    row, col = np.divmod(np.arange(city.size**2), city.size)
    free = ~city.no_fly.ravel()
    for kind in np.unique(actions[free]):
        at = free & (actions == kind)
        if kind < HOVER:
            south, east = MOVES[kind]
            there = np.full(at.sum(), 0.55 * east), np.full(at.sum(), 0.55 * south)
            ax.quiver(
                col[at], row[at], *there, angles="xy", scale_units="xy", scale=1, pivot="mid",
                color="0.35", width=0.007, zorder=3,
            )  # fmt: skip
        else:
            marker = "D" if kind == LAND else "o"
            ax.plot(col[at], row[at], marker, mfc="none", mec="0.35", ms=6, zorder=3)
    return ax
