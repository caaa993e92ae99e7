"""The stage as a widget of a notebook."""

from typing import Any

from uavdh_lite.errors import extra
from uavdh_lite.labs.session import SCRIPT, STYLE, Session, read

with extra("notebooks"):
    import anywidget
    import traitlets


class Lab(anywidget.AnyWidget):
    """One city, one mission, and six tools to look at it.

    Arguments:
        tool: one of fly, compare, think, channel, paint and train, to have it alone; None: all.
        city: the name of a shipped city.

    | trait | meaning |
    | --- | --- |
    | `scene` | all that the browser draws, as JSON values |
    """

    _esm = read(*SCRIPT)
    _css = read(*STYLE)
    scene = traitlets.Dict().tag(sync=True)

    def __init__(self, tool: str | None = None, city: str = "manhattan"):
        super().__init__()
        self.session = Session(tool, city, self._show, self._give)
        self.on_msg(lambda _, told, buffers: self.session.hear(told))

    def close(self) -> None:
        """Pause a training for good and take the stage off the page."""
        self.session.close()
        super().close()

    def _show(self, scene: dict[str, Any]) -> None:
        self.scene = scene

    def _give(self, name: str, address: str) -> None:
        self.send({"kind": "file", "name": name, "address": address})
