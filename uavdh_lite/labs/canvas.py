"""A figure drawn once and then only changed, shown as a picture that hears clicks and keys."""

import io
from collections.abc import Callable, Iterable

import ipywidgets
import numpy as np
from ipyevents import Event
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image


class Canvas:
    """The picture of a figure: `draw_all` once, then `draw` the few artists that change.

    | attribute | what |
    | --- | --- |
    | `figure` | the figure; what is added to it is drawn by `draw_all` |
    | `picture` | the `ipywidgets.Image` to show |
    """

    def __init__(self, figure: Figure):
        self.figure = figure
        self._canvas = FigureCanvasAgg(figure)
        self._background = None
        # No tooltip: an Image with one cannot be shown, its view has no element to set it on
        self.picture = ipywidgets.Image(format="png", layout={"align_self": "flex-start"})

    def draw_all(self) -> None:
        """Draw the figure without changing artists and keep it as the background of `draw`."""
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def draw(self, changing: Iterable[tuple[Axes, Artist]] = ()) -> None:
        """Show the background with these artists on top of it."""
        if self._background is None:
            self.draw_all()
        self._canvas.restore_region(self._background)
        for ax, artist in changing:
            ax.draw_artist(artist)
        rgb = np.asarray(self._canvas.buffer_rgba())[..., :3]
        buffer = io.BytesIO()
        Image.fromarray(rgb).save(buffer, format="PNG", compress_level=1)
        self.picture.value = buffer.getvalue()

    def on_click(self, handler: Callable[[Axes, float, float], None]) -> Event:
        """Call `handler(ax, x, y)`, in data coordinates, for every click inside an Axes."""
        return self._watch(["click"], lambda event: self._locate(event, handler))

    def on_drag(self, handler: Callable[[Axes, list[tuple[float, float]]], None]) -> Event:
        """Call `handler(ax, points)` for what the mouse is drawn over, button down.

        Points are (x, y) in data coordinates, at most half a unit apart from the last event's on:
        browsers report a fast mouse only now and then.
        """
        last = None

        def located(ax, x, y):
            nonlocal last
            start = (x, y) if last is None else last
            steps = int(2 * max(abs(x - start[0]), abs(y - start[1]))) + 2
            last = x, y
            handler(ax, np.linspace(start, (x, y), steps).tolist())

        def drawn(event):
            nonlocal last
            if event.get("type") != "mousemove":
                last = None
            elif event.get("buttons") != 1:
                return
            self._locate(event, located)

        return self._watch(["mousedown", "mousemove"], drawn)

    def _locate(self, event: dict, handler: Callable[[Axes, float, float], None]) -> None:
        """Call the handler with the Axes and the place in it that a mouse event is at."""
        height = self._canvas.get_width_height()[1]
        pixel = event["dataX"], height - event["dataY"]
        for ax in self.figure.axes:
            if ax.bbox.contains(*pixel):
                handler(ax, *ax.transData.inverted().transform(pixel))

    def on_key(self, handler: Callable[[str], None]) -> Event:
        """Call `handler(key)` for every key pressed while the mouse is over the picture."""
        return self._watch(["keydown"], lambda event: handler(event["key"]))

    def _watch(self, names: list[str], handler) -> Event:
        event = Event(source=self.picture, watched_events=names, prevent_default_action=True)
        event.on_dom_event(handler)
        return event
