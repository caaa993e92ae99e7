"""Small widgets and pieces of HTML for notebooks, quizzes and labs; they need only ipywidgets."""

import html
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager

from matplotlib.figure import Figure

from uavdh_lite.errors import extra
from uavdh_lite.plotting import RED, png

with extra("notebooks"):
    import ipywidgets

ROW = {"display": "flex", "flex_flow": "row", "width": "max-content"}  # label and buttons
LINK = "color:var(--jp-content-link-color, #0645AD);text-decoration:underline"
TEXT = "inherit"  # the colour of a `status` that reports no error
GLOSSARY = "uavdh-words"  # the class of a page's `words`
WRAP = {"flex_flow": "row wrap"}  # the layout of a row that continues below on a narrow page

__all__ = ["CellPicker", "cell_at", "explore", "png", "status", "table", "words"]


@contextmanager
def quiet(lab):
    """Inside, changes of a lab's controls are its own, not the user's: its `_silent` is true."""
    before, lab._silent = lab._silent, True
    try:
        yield
    finally:
        lab._silent = before


def explore(draw: Callable[..., Figure], **controls: ipywidgets.ValueWidget) -> ipywidgets.VBox:
    """Controls, and below them the figure that `draw` makes of their values.

    The figure is drawn again whenever a control changes. An error in `draw` is shown below the
    controls; the last picture stays.

    Arguments:
        draw: called with the value of each control by its name; returns a figure.
    """
    picture = ipywidgets.Image(format="png", layout={"align_self": "flex-start"})
    message = ipywidgets.HTML()

    def update(change=None):
        try:
            picture.value = png(draw(**{name: each.value for name, each in controls.items()}))
            message.value = ""
        except Exception as error:  # whatever it is, the reader must see it
            message.value = status(f"{type(error).__name__}: {error}")

    for control in controls.values():
        control.observe(update, "value")
    update()
    return ipywidgets.VBox([*controls.values(), message, picture])


def cell_at(point: tuple[float, float]) -> tuple[int, int]:
    """The cell, (row, column), at a point (x, y) of a city's map."""
    return round(point[1]), round(point[0])


class CellPicker(ipywidgets.HBox):
    """Row, column and a button that does what a click on that cell does, without a mouse.

    Arguments:
        handler: called with (row, column).
    """

    def __init__(self, handler: Callable[[tuple[int, int]], None]):
        self.row, self.column = (
            ipywidgets.BoundedIntText(
                description=name,
                min=0,
                max=99,
                layout={"width": f"{width + 46}px"},
                style={"description_width": f"{width}px"},
            )
            for name, width in (("or a cell: row", 87), ("column", 50))
        )
        self.button = ipywidgets.Button(
            description="click there",
            tooltip="does what a click on this cell of the map does",
            layout={"width": "80px"},
        )
        self.button.on_click(lambda _: handler((self.row.value, self.column.value)))
        super().__init__([self.row, self.column, self.button])


def undo_and_redo() -> tuple[ipywidgets.Button, ipywidgets.Button]:
    """The buttons of an editor."""
    undo = ipywidgets.Button(description="undo", icon="undo", tooltip="key z")
    redo = ipywidgets.Button(description="redo", icon="repeat", tooltip="key y")
    for button in (undo, redo):
        button.layout.width = "90px"
    return undo, redo


def changed_note() -> ipywidgets.HTML:
    """Room for a word next to a mission's number: whether it has been changed since."""
    return ipywidgets.HTML(layout={"width": "62px"})


def say_changed(note: ipywidgets.HTML, number: int, changed: bool) -> None:
    """Say next to its number whether a mission has been changed."""
    title = f"no longer the random mission of the number {number}; undo brings it back"
    note.value = f'<i title="{title}" aria-live="polite">changed</i>' if changed else ""


def link(text: str, address: str, download: str = "") -> str:
    """A link in the page's colours, or with the name of a file, one that saves it."""
    saved = f'download="{download}" ' if download else ""
    return f'<a style="{LINK}" {saved}href="{html.escape(address)}">{text}</a>'


def status(text: str, colour: str = RED) -> str:
    """A line of text that screen readers read out when it changes.

    A colour is mixed with that of the page's text, to be read on a dark page, too.
    """
    if colour != TEXT:
        colour = f"color-mix(in srgb, {colour} 65%, currentColor)"
    return f'<span role="status" style="color:{colour}">{html.escape(text)}</span>'


def table(rows: Sequence[Sequence[str]], groups: Mapping[str, int] | None = None) -> str:
    """A table of numbers; the first row is its head.

    Arguments:
        groups: what stands above columns, from the left, and above how many of them.
    """
    cells = "</td></tr><tr><td>".join("</td><td>".join(map(html.escape, row)) for row in rows)
    heads = (
        f'<th colspan="{columns}" scope="colgroup">{html.escape(name)}</th>'
        if name
        else f'<td colspan="{columns}"></td>'
        for name, columns in (groups or {}).items()
    )
    above = f"<tr>{''.join(heads)}</tr>" if groups else ""
    return f'<table class="uavdh-numbers">{above}<tr><td>{cells}</td></tr></table>'


def words(meanings: Mapping[str, str]) -> ipywidgets.HTML:
    """What the words on a page mean, by word, as HTML that is unfolded with a click."""
    lines = (f"<dt>{word}</dt><dd>{meaning}</dd>" for word, meaning in meanings.items())
    meant = ipywidgets.HTML(
        f"<details><summary>What do these words mean?</summary><dl>{''.join(lines)}</dl></details>"
    )
    meant.add_class(GLOSSARY)
    return meant


def introduced(text: str, lab: ipywidgets.Box) -> ipywidgets.HBox:
    """What a lab is about, with what its words mean on the same line instead of below the lab."""
    meant = [each for each in lab.children if GLOSSARY in each._dom_classes]
    lab.children = [each for each in lab.children if each not in meant]
    line = ipywidgets.HBox([ipywidgets.HTML(f"<p>{text}</p>"), *meant], layout=WRAP)
    line.add_class("uavdh-introduction")
    return line
