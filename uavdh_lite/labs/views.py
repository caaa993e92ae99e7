"""What the labs draw next to the stage: charts of what happens during a flight."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from uavdh_lite.environment import Rewards
from uavdh_lite.evaluation import Flights, Policy
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.plotting import device_colour
from uavdh_lite.registry import names

# The terms of the reward, in colours that are not those of devices
# and can be seen on a light page and on a dark one
TERMS = {"data": "#7E6FD8", "movement": "#BBBBBB", "safety": "#DDCC77", "crash": "#C2477F"}


def policy_title(name: str) -> str:
    """A policy's name as the labs show it: agents are named after cities, so say what they are."""
    return name if name in names("policy") else f"{name} agent"


class Charts:
    """What happens during one flight: the data left, the device served in each slot, the reward.

    The axes are drawn again only if their limits change.
    """

    sizes: tuple = ()  # a chart has no Q-values for the stage

    def __init__(self):
        figure = Figure(figsize=(11.6, 2.6), dpi=100)
        self.axes = figure.subplots(1, 3, sharex=True, subplot_kw={"facecolor": "none"})
        figure.subplots_adjust(0.05, 0.17, 0.99, 0.88, wspace=0.22)
        self.title = figure.suptitle("", fontsize="medium")
        self.canvas = Canvas(figure, lambda: self.show(self._step))
        for ax, name in zip(self.axes, ("data left", "device served", "reward"), strict=True):
            ax.set_ylabel(name)
            ax.set_xlabel("step")
        reward = self.axes[-1]
        reward.xaxis.set_major_locator(MaxNLocator(integer=True))
        terms = [Patch(color=colour, label=name) for name, colour in TERMS.items()]
        above = {"loc": "lower right", "bbox_to_anchor": (1, 1), "borderaxespad": 0.2}
        reward.legend(handles=terms, fontsize="x-small", ncols=4, **above)
        self.cursors = [ax.axvline(0, color="black", lw=0.8, animated=True) for ax in self.axes]
        self._artists, self._limits, self._step = [], None, 0

    def set_flight(self, name: str, flights: Flights, policy: Policy, last: int) -> None:
        """Draw a policy's whole flight. `show` marks a step in it, at most `last`."""
        trajectory = flights.trajectory(0)
        self.devices = devices = np.flatnonzero(trajectory.start.data_initial[0] > 0)
        self.left = trajectory.data_left
        outcomes = [step.outcome for step in flights.history[: flights.steps[0]]]
        terms = [{k: v[0] for k, v in Rewards().terms(outcome).items()} for outcome in outcomes]
        for artist in self._artists:
            artist.remove()
        left, slots, reward = self.axes
        limits = (
            name,
            _ceil(last, 10),
            _ceil(trajectory.data_left[0].max(), 5),
            devices.max(),
            _ceil(max(term["data"] for term in terms) + 0.1, 3),
        )
        if limits != self._limits:
            self._limits = limits
            self.title.set_text(name)
            left.set(xlim=(0, limits[1]), ylim=(0, 1.05 * limits[2]))
            slots.set(yticks=range(limits[3] + 1), ylim=(limits[3] + 0.5, -0.5))
            reward.set(ylim=(-2, 1.05 * limits[4]))
            self.canvas.draw_all()
        self._artists = [
            *(
                left.plot(trajectory.data_left[:, k], color=device_colour(k), animated=True)[0]
                for k in devices
            ),
            self._draw_slots(slots, trajectory.served),
            *(
                reward.text(len(terms), -1.9, f"{term['crash']:g}", ha="right", animated=True)
                for term in terms
                if term["crash"]
            ),
            *(
                reward.stairs(values, fill=True, color=TERMS[name], animated=True)
                for name in TERMS
                if any(values := [term[name] for term in terms])
            ),
        ]

    def _draw_slots(self, ax, served: np.ndarray):
        step, slot = np.nonzero(served >= 0)
        device = served[step, slot]
        colours = [device_colour(each) for each in device]
        when = step + (slot + 0.5) / served.shape[1]
        return ax.scatter(when, device, c=colours, s=5, marker="s", animated=True)

    def show(self, step: int) -> None:
        """Mark a step."""
        self._step = step
        for cursor in self.cursors:
            cursor.set_xdata([step, step])
        artists = [(artist.axes, artist) for artist in (*self._artists, *self.cursors)]
        self.canvas.draw(artists, self._described(step))

    def _described(self, step: int) -> str:
        """The charts at a step as sentences."""
        left, total = self.left[min(step, len(self.left) - 1)], self.left[0]
        each = ", ".join(f"device {k} {left[k]:.1f} of {total[k]:.1f}" for k in self.devices)
        return (
            f"Charts of {self.title.get_text()}: data left, device served in each slot, terms of "
            f"the reward. After step {step} data is left: {each}."
        )


def _ceil(value: float, step: int) -> int:
    """The smallest multiple of `step` that is not below the value."""
    return int(np.ceil(value / step) * step)
