"""A figure that is drawn once and then only changed; a picture that takes clicks and keys."""

from collections.abc import Callable, Iterable
from pathlib import Path
from weakref import WeakSet

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import is_color_like, same_color
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.spines import Spine
from matplotlib.text import Text

from uavdh_lite.errors import extra
from uavdh_lite.plotting import png

with extra("notebooks"):
    import anywidget
    import traitlets

HERE = Path(__file__).parent
LIGHT = {"paper": "#ffffff", "ink": "#000000"}  # the colours of a page


class Picture(anywidget.AnyWidget):
    """A PNG on the page, with a sentence for those who do not see it.

    It tells what happens on it: `{"kind": "click"}`, `"down"`, `"move"` and `"up"` with `x` and
    `y` in pixels and `pressed`, whether the button is down; and `{"kind": "key", "key": …}` while
    the mouse is over it.

    | trait | meaning |
    | --- | --- |
    | `value` | the PNG, bytes |
    | `alt` | what it shows, as a sentence |
    | `listens` | what it tells: some of click, draw and key |
    | `size` | width and height on the page, pixels; on a large screen, it grows |
    | `page` | the colours of the page around it: `paper` and `ink` |
    """

    _esm = (HERE / "picture.js").read_text(encoding="utf-8")
    _css = (HERE / "picture.css").read_text(encoding="utf-8")
    value = traitlets.Bytes().tag(sync=True)
    alt = traitlets.Unicode().tag(sync=True)
    listens = traitlets.List().tag(sync=True)
    size = traitlets.List([100, 100]).tag(sync=True)
    page = traitlets.Dict(LIGHT).tag(sync=True)


class Canvas:
    """The picture of a figure: `draw_all` once, then `draw` the few artists that change.

    On the page, an inch of the figure is 100 pixels; with more dots per inch it stays sharp where
    it grows. What is drawn in black has the colour of the page's text, and the figure that of the
    page. Axes with a background of their own, such as maps, keep it, and the lines in them.

    Arguments:
        redraw: called when the page has got other colours, to draw the artists that change, too.

    | attribute | meaning |
    | --- | --- |
    | `figure` | the figure; `draw_all` draws what was added to it |
    | `picture` | the `Picture` to show |
    | `ink` | the colour of the page's text |
    """

    def __init__(self, figure: Figure, redraw: Callable[[], None] | None = None):
        self.figure, self.ink = figure, LIGHT["ink"]
        self._redraw = self.draw if redraw is None else redraw
        self._inked: WeakSet[Artist] = WeakSet()  # what was black
        self._canvas = FigureCanvasAgg(figure)
        self._background = None
        self.picture = Picture(size=[round(100 * inches) for inches in figure.get_size_inches()])
        self._hear: dict[str, Callable[[dict], None]] = {}
        self.picture.on_msg(lambda _, told, buffers: self._hear[told["kind"]](told))
        self.picture.observe(lambda change: self._wear(**change.new), "page")

    def draw_all(self) -> None:
        """Draw the figure without its animated artists, as the background of `draw`."""
        for ax in self.figure.axes:
            ax.tick_params(which="both", color=self.ink, labelcolor=self.ink)
        self._dress(self.figure)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def draw(self, changing: Iterable[tuple[Axes, Artist]] = (), alt: str | None = None) -> None:
        """Show the background with these artists on top of it.

        Arguments:
            alt: what the picture shows now, as a sentence; by default what it was.
        """
        if self._background is None:
            self.draw_all()
        self._canvas.restore_region(self._background)
        for ax, artist in changing:
            self._dress(artist)
            ax.draw_artist(artist)
        with self.picture.hold_sync():
            self.picture.value = png(np.asarray(self._canvas.buffer_rgba())[..., :3])
            if alt is not None:
                self.picture.alt = alt

    def on_click(self, handler: Callable[[Axes, float, float], None]) -> None:
        """Call `handler(ax, x, y)`, in data coordinates, for every click inside an Axes."""
        self._listen("click", {"click": lambda told: self._locate(told, handler)})

    def on_drag(
        self,
        handler: Callable[[Axes, list[tuple[float, float]], bool], None],
        hover: Callable[[Axes, float, float], None],
        ended: Callable[[], None],
    ) -> None:
        """Call `handler(ax, points, began)` while the mouse moves with its button down.

        The points, (x, y) in data coordinates, lead from the last event to this one and are at
        most half a unit apart: browsers report only some positions of a fast mouse. `began` is
        True when the button goes down; `ended()` is called when it comes up. Without a button,
        `hover(ax, x, y)` is called instead.
        """
        last = None

        def located(ax, x, y):
            nonlocal last
            start, began = ((x, y), True) if last is None else (last, False)
            steps = int(2 * max(abs(x - start[0]), abs(y - start[1]))) + 2
            last = x, y
            handler(ax, np.linspace(start, (x, y), steps).tolist(), began)

        def pressed(told):
            nonlocal last
            last = None
            self._locate(told, located)

        def moved(told):
            self._locate(told, located if told["pressed"] else hover)

        self._listen("draw", {"down": pressed, "move": moved, "up": lambda _: ended()})

    def on_key(self, handler: Callable[[str], None]) -> None:
        """Call `handler(key)` for every key that is pressed while the mouse is over the picture."""
        self._listen("key", {"key": lambda told: handler(told["key"])})

    def _wear(self, paper: str, ink: str) -> None:
        """Draw all again, in the colours of the page."""
        if not (is_color_like(paper) and is_color_like(ink)):
            return
        self.ink, self._background = ink, None
        self.figure.set_facecolor(paper)
        self._redraw()

    def _dress(self, artist: Artist) -> None:
        """Give the page's colour of text to what is black, in an artist and in what it holds."""
        for legend in artist.findobj(Legend):
            legend.get_frame().set_facecolor(self.figure.get_facecolor())
        for part in artist.findobj(lambda each: isinstance(each, Text | Line2D | Spine)):
            colour = part.get_edgecolor() if isinstance(part, Spine) else part.get_color()
            if part not in self._inked:
                if not same_color(colour, LIGHT["ink"]) or _is_on_a_map(part):
                    continue
                self._inked.add(part)
            if isinstance(part, Spine):
                part.set_edgecolor(self.ink)
            else:
                part.set_color(self.ink)

    def _locate(self, told: dict, handler: Callable[[Axes, float, float], None]) -> None:
        """Call the handler with the Axes under a place in the picture and the position in it."""
        height = self._canvas.get_width_height()[1]
        pixel = told["x"], height - told["y"]
        for ax in self.figure.axes:
            x, y = ax.transData.inverted().transform(pixel)
            if ax.get_aspect() == 1:  # a map: half a cell outside of it, the nearest cell is meant
                x, y = _nearest(x, ax.get_xlim()), _nearest(y, ax.get_ylim())
            elif not ax.bbox.contains(*pixel):
                continue
            if x is not None and y is not None:
                handler(ax, x, y)

    def _listen(self, kind: str, handlers: dict[str, Callable[[dict], None]]) -> None:
        self.picture.listens = [*self.picture.listens, kind]
        self._hear |= handlers


def _is_on_a_map(artist: Artist) -> bool:
    """Whether it is a line in Axes with a background of their own."""
    ax = artist.axes
    return isinstance(artist, Line2D) and ax is not None and ax.get_facecolor()[3] > 0


def _nearest(value: float, limits: tuple[float, float]) -> float | None:
    """The value, or the end of the limits that is at most half a unit away; None if neither."""
    low, high = sorted(limits)
    if not low - 0.5 <= value <= high + 0.5:
        return None
    return min(max(value, low + 1e-6), high - 1e-6)
