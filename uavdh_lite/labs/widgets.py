"""Small widgets for notebooks and quizzes; they need only ipywidgets."""

import html
from collections.abc import Callable

from matplotlib.figure import Figure

from uavdh_lite.errors import extra
from uavdh_lite.plotting import RED, png

with extra("notebooks"):
    import ipywidgets

TEXT = "inherit"  # the colour of a `status` that reports no error

__all__ = ["explore", "png", "status"]


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


def status(text: str, colour: str = RED) -> str:
    """A line of text that screen readers read out when it changes.

    A colour is mixed with that of the page's text, to be read on a dark page, too.
    """
    if colour != TEXT:
        colour = f"color-mix(in srgb, {colour} 65%, currentColor)"
    return f'<span role="status" style="color:{colour}">{html.escape(text)}</span>'
