"""A line of text for notebooks and quizzes."""

import html

from uavdh_lite.plotting import RED

TEXT = "inherit"  # the colour of a `status` that reports no error


def status(text: str, colour: str = RED) -> str:
    """A line of text that screen readers read out when it changes.

    A colour is mixed with that of the page's text, to be read on a dark page, too.
    """
    if colour != TEXT:
        colour = f"color-mix(in srgb, {colour} 65%, currentColor)"
    return f'<span role="status" style="color:{colour}">{html.escape(text)}</span>'
