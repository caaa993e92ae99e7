"""The pieces of HTML that several labs show; whatever they say is escaped."""

import html
from collections.abc import Sequence

ERROR = "#C1272D"


def status(text: str, colour: str = ERROR) -> str:
    """A line that screen readers announce when it changes."""
    return f'<span role="status" style="color:{colour}">{html.escape(text)}</span>'


def table(rows: Sequence[Sequence[str]]) -> str:
    """A table of numbers, its head in the first row."""
    cells = "</td></tr><tr><td>".join("</td><td>".join(map(html.escape, row)) for row in rows)
    return f'<table class="uavdh-numbers"><tr><td>{cells}</td></tr></table>'
