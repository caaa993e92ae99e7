"""A figure that is drawn once and then only changed; a picture that takes clicks and keys."""

from collections.abc import Callable, Iterable

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from uavdh_lite.errors import extra
from uavdh_lite.plotting import png

with extra("notebooks"):
    import ipywidgets
    from ipyevents import Event


class Canvas:
    """The picture of a figure: `draw_all` once, then `draw` the few artists that change.

    | attribute | meaning |
    | --- | --- |
    | `figure` | the figure; `draw_all` draws what was added to it |
    | `picture` | the `ipywidgets.Image` to show |
    """

    def __init__(self, figure: Figure):
        self.figure = figure
        self._canvas = FigureCanvasAgg(figure)
        self._background = None
        # No tooltip: the view of an Image has no element for it, and fails to show the picture
        self.picture = ipywidgets.Image(format="png", layout={"align_self": "flex-start"})

    def draw_all(self) -> None:
        """Draw the figure without its animated artists, as the background of `draw`."""
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def draw(self, changing: Iterable[tuple[Axes, Artist]] = ()) -> None:
        """Show the background with these artists on top of it."""
        if self._background is None:
            self.draw_all()
        self._canvas.restore_region(self._background)
        for ax, artist in changing:
            ax.draw_artist(artist)
        self.picture.value = png(np.asarray(self._canvas.buffer_rgba())[..., :3])

    def on_click(self, handler: Callable[[Axes, float, float], None]) -> Event:
        """Call `handler(ax, x, y)`, in data coordinates, for every click inside an Axes."""
        return self._watch(["click"], lambda event: self._locate(event, handler))

    def on_drop(
        self, handler: Callable[[Axes, tuple[float, float], tuple[float, float]], None]
    ) -> Event:
        """Call `handler(ax, start, end)` when the button is released in the Axes it was pressed in.

        `start` and `end` are (x, y) in data coordinates; for a click they are the same.
        """
        pressed = None

        def pressed_at(ax, x, y):
            nonlocal pressed
            pressed = ax, (x, y)

        def released_at(ax, x, y):
            if pressed is not None and pressed[0] is ax:
                handler(ax, pressed[1], (x, y))

        def moved(event):
            nonlocal pressed
            if event.get("type") == "mousedown":
                pressed = None  # unless it is inside an Axes
                self._locate(event, pressed_at)
            else:
                self._locate(event, released_at)
                pressed = None

        return self._watch(["mousedown", "mouseup"], moved)

    def on_drag(
        self,
        handler: Callable[[Axes, list[tuple[float, float]], bool], None],
        hover: Callable[[Axes, float, float], None],
    ) -> Event:
        """Call `handler(ax, points, began)` while the mouse moves with its button down.

        The points, (x, y) in data coordinates, lead from the last event to this one and are at
        most half a unit apart: browsers report only some positions of a fast mouse. `began` is
        True when the button goes down. Without a button, `hover(ax, x, y)` is called instead.
        """
        last = None

        def located(ax, x, y):
            nonlocal last
            start, began = ((x, y), True) if last is None else (last, False)
            steps = int(2 * max(abs(x - start[0]), abs(y - start[1]))) + 2
            last = x, y
            handler(ax, np.linspace(start, (x, y), steps).tolist(), began)

        def drawn(event):
            nonlocal last
            if event.get("type") != "mousemove":
                last = None
            elif event.get("buttons") != 1:
                self._locate(event, hover)
                return
            self._locate(event, located)

        return self._watch(["mousedown", "mousemove"], drawn)

    def _locate(self, event: dict, handler: Callable[[Axes, float, float], None]) -> None:
        """Call the handler with the Axes under a mouse event and the position in it."""
        height = self._canvas.get_width_height()[1]
        pixel = event["dataX"], height - event["dataY"]
        for ax in self.figure.axes:
            if ax.bbox.contains(*pixel):
                handler(ax, *ax.transData.inverted().transform(pixel))

    def on_key(self, handler: Callable[[str], None]) -> Event:
        """Call `handler(key)` for every key that is pressed while the mouse is over the picture."""
        return self._watch(["keydown"], lambda event: handler(event["key"]))

    def _watch(self, names: list[str], handler) -> Event:
        event = Event(source=self.picture, watched_events=names, prevent_default_action=True)
        event.on_dom_event(handler)
        return event
