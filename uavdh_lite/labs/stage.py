"""The stage of the labs: flights that play in the browser, where missions are set by hand."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from uavdh_lite.environment import Environment
from uavdh_lite.errors import extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.labs.drawing import draw, script

with extra("notebooks"):
    import anywidget
    import ipywidgets
    import traitlets

Cell = tuple[int, int]
BESIDE = {"flex": "1 1 600px", "min_width": "0"}  # the layout of a stage beside something else


def _read(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


class FullScreen(anywidget.AnyWidget):
    """A button that lets the `together` around it fill the screen."""

    _esm = f"""{_read("fullscreen.js")}
    function render({{ el }}) {{
      el.classList.add("uavdh-full-screen");
      el.append(fullScreenButton(() => el.closest(".uavdh-together")));
    }}
    export default {{ render }};
    """
    _css = _read("fullscreen.css")


def together(children: Sequence[ipywidgets.Widget]) -> ipywidgets.VBox:
    """Widgets below each other that fill the screen together."""
    box = ipywidgets.VBox(children)
    box.add_class("uavdh-together")
    return box


class Stage(anywidget.AnyWidget):
    """Flights side by side, which play in the browser without asking Python.

    With `dropped`, the mission is edited on the stage: devices and the start are dragged, and the
    bars say how much data a device has at the start, and how much time there is.

    Arguments:
        dropped: called with the cell where the mouse went down and the cell where it was released,
            (row, column); the same cell twice is a click.
        filled: called with a device's number and its data at the start, data units.
        timed: called with the flying time, units of time.
        undone: called with -1 for the key z, and with 1 for y: undo a change, or redo it.
        keys: for each key that steers, called with its name as in JavaScript.
        pressed: what to call.

    | trait | meaning |
    | --- | --- |
    | `step` | the step that is shown, at most that of the longest flight; set it to show another |
    | `most` | the right end of the bars: `data` in data units, `time` in units of time |
    | `answered` | how many messages from the browser have been done or refused |
    """

    _esm = f"{script()}\n{_read('fullscreen.js')}\n{_read('stage.js')}"
    _css = f"{_read('stage.css')}\n{_read('fullscreen.css')}"
    drawing = traitlets.Unicode().tag(sync=True)
    begin = traitlets.Int(-1).tag(sync=True)
    step = traitlets.Int(0).tag(sync=True)
    q_values = traitlets.List().tag(sync=True)
    most = traitlets.Dict({"data": 20.0, "time": 70}).tag(sync=True)
    editable = traitlets.Bool(False).tag(sync=True)
    steering = traitlets.List().tag(sync=True)
    size = traitlets.Int(0).tag(sync=True)
    refused = traitlets.List().tag(sync=True)
    answered = traitlets.Int(0).tag(sync=True)

    def __init__(
        self,
        dropped: Callable[[Cell, Cell], None] | None = None,
        filled: Callable[[int, float], None] | None = None,
        timed: Callable[[int], None] | None = None,
        undone: Callable[[int], None] | None = None,
        keys: Sequence[str] = (),
        pressed: Callable[[str], None] | None = None,
    ):
        super().__init__(editable=dropped is not None, steering=list(keys))
        self._hear = {
            "drop": lambda told: dropped(tuple(told["from"]), tuple(told["to"])),
            "data": lambda told: filled(told["device"], float(told["value"])),
            "time": lambda told: timed(int(told["value"])),
            "undo": lambda told: undone and undone(int(told["by"])),
            "key": lambda told: pressed(told["key"]),
        }
        self.on_msg(lambda _, told, buffers: self._answer(told))

    def _answer(self, told: dict) -> None:
        try:
            self._hear[told["kind"]](told)
        finally:
            self.answered += 1  # after the drawing that it led to

    def put_back(self) -> None:
        """Draw the mission as it is: what was dragged or set on the stage was refused."""
        self.send({"kind": "draw"})

    def show(
        self,
        environment: Environment,
        flights: Mapping[str, Flights],
        begin: int | None = None,
        q_values: Sequence[Sequence[float | None]] = (),
        refused: Sequence[int] = (),
    ) -> None:
        """Show the flights of one mission, by their names.

        Arguments:
            begin: play from this step on; by default the whole flights are shown.
            q_values: for each step of the first flight, how large the sign of each action is, from
                0 to 1; None for none.
            refused: the rows and columns of the last step's move, if it was refused; zeros for a
                landing.
        """
        drawing = draw(environment, {name: each.trajectory(0) for name, each in flights.items()})
        last = max(int(each.steps[0]) for each in flights.values())
        with self.hold_sync():
            self.begin = -1 if begin is None else begin
            self.size, self.refused = environment.size, [int(each) for each in refused]
            self.q_values = [list(each) for each in q_values]
            self.step = last if begin is None else begin
            self.drawing = drawing
