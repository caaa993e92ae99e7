"""Widgets for notebooks: thin views over the library, with no logic of their own."""

import html
import io
from collections.abc import Callable

import ipywidgets
from matplotlib.figure import Figure


def explore(draw: Callable[..., Figure], **controls: ipywidgets.ValueWidget) -> ipywidgets.VBox:
    """Controls, and below them the figure that `draw` makes of their values.

    The figure is drawn anew whenever a control changes, and shown as a picture that is swapped in
    place. An error of `draw` is shown below the controls; the last picture stays.

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
            text = html.escape(f"{type(error).__name__}: {error}")
            message.value = f'<pre style="color:#C1272D">{text}</pre>'

    for control in controls.values():
        control.observe(update, "value")
    update()
    return ipywidgets.VBox([*controls.values(), message, picture])


def png(figure: Figure) -> bytes:
    """The figure as a PNG file's bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
