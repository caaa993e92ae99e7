"""Flights that play in any web page: in a notebook without a kernel, on the site, in a file.

Python writes what happened as JSON; `player.js` draws and plays it, in the style of `player.css`.
Where no script runs, the page says how each flight ended.
"""

import html
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory
from uavdh_lite.plotting import device_colour
from uavdh_lite.storage import write_atomically

PLAYER = """\
<style>{style}</style>
<div class="uavdh-player"><p>{text}</p><script type="application/json">{data}</script></div>
<script>(() => {{
"use strict";
{script}
drawAll();
}})();</script>"""
PAGE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="
  default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>{title}</title>
<body style="max-width: 1160px; margin: 16px auto; padding: 0 16px">
{player}
</body>
</html>
"""


@dataclass(frozen=True, repr=False)
class Player:
    """Flights to play in a browser. A notebook shows them where a cell ends with the player."""

    film: dict[str, Any]

    def __repr__(self) -> str:
        endings = (f"{each['name']}: {each['ending']}" for each in self.film["flights"])
        return " ".join((f"{self.film['title']}.", *(each.removeprefix(": ") for each in endings)))

    def _repr_html_(self) -> str:
        """A part of a page; it loads nothing, and a page may have several."""
        data = json.dumps(self.film, separators=(",", ":")).replace("<", "\\u003c")
        style, script = (
            Path(__file__).with_suffix(suffix).read_text(encoding="utf-8").strip()
            for suffix in (".css", ".js")
        )
        script = re.sub("^export ", "", script, flags=re.MULTILINE)  # no module here: all is inside
        return PLAYER.format(style=style, text=html.escape(repr(self)), data=data, script=script)

    def save(self, path: str | Path) -> None:
        """Write a page that any browser plays without a network, atomically."""
        page = PAGE.format(title=html.escape(self.film["title"]), player=self._repr_html_())
        write_atomically(path, lambda temporary: temporary.write_text(page, encoding="utf-8"))


def play(environment: Environment, trajectories: Trajectory | Mapping[str, Trajectory]) -> Player:
    """A player of one flight, or of a few side by side, each with its name.

    An arrow is a move, a ring is hovering, with the number of steps so far. Their colour says which
    device uploaded most, and their width how much. Cells are violet while the device that uploads
    most, or that is pointed at, has no line of sight to them.

    Arguments:
        trajectories: flights of one mission.

    Raises `InputError` if their missions differ.
    """
    named = trajectories if isinstance(trajectories, Mapping) else {"": trajectories}
    return Player(film(environment, named))


def film(environment: Environment, flights: Mapping[str, Trajectory]) -> dict[str, Any]:
    """What `player.js` draws, as plain values for JSON. Cells are (row, column).

    | entry | meaning |
    | --- | --- |
    | `title` | what is flown, and where |
    | `city` | a text for each row, in the signs of `City.text` |
    | `devices` | for each its `number`, `cell`, `colour`, and the `hidden` cells, with `#` |
    | `flights` | for each its `name`, how it ended in `end` and `ending`; |
    | | for each state the UAV's cell in `path`, and what is `left` of the data and of the time; |
    | | for each step the action that was `refused`, if any |

    Raises `InputError` as `play` does.
    """
    start, *others = (flight.start for flight in flights.values())
    for field, first in vars(start).items():
        if not all(np.array_equal(first, getattr(other, field)) for other in others):
            raise InputError(f"flights side by side are of one mission, but their `{field}` differ")
    city, size = environment.cities[start.city[0]], environment.size
    used = np.flatnonzero(start.data_initial[0] > 0)
    cells = start.device_cells[0, used]
    hidden = np.where(environment.sight[start.city, cells], ".", "#")
    hidden = hidden.reshape(-1, size, size)[:, : city.size, : city.size]
    return {
        "title": f"Flight{'s' * (len(flights) > 1)} over {city.name}",
        "city": city.text.split("\n"),
        "devices": [
            {
                "number": int(number),
                "cell": divmod(int(cell), size),
                "colour": device_colour(number),
                "hidden": ["".join(row) for row in rows],
            }
            for number, cell, rows in zip(used, cells, hidden, strict=True)
        ],
        "flights": [
            {"name": name, **_flight(flight, used, size)} for name, flight in flights.items()
        ],
    }


def _flight(flight: Trajectory, devices: np.ndarray, size: int) -> dict[str, Any]:
    """What a film holds of one flight."""
    used, available = len(flight.action), flight.time_left[0]
    data, left = flight.data_left[0].sum(), flight.data_left[-1].sum()
    out_of_time = flight.time_left[-1] <= 0
    end = "landed" if flight.landed else "crashed" if out_of_time else "in the air"
    how = ", because the time ran out," if end == "crashed" else ""
    amounts = np.column_stack([flight.data_left[:, devices], flight.time_left]).astype(float)
    actions = zip(flight.action, flight.intervened, strict=True)
    return {
        "end": end,
        "ending": f"{end.capitalize()}{how} after {used} of {available} units of time, "
        f"with {data - left:.1f} of {data:.1f} units of data.",
        "path": [divmod(int(cell), size) for cell in flight.uav_cell],
        "left": amounts.round(5).tolist(),
        "refused": [ACTIONS[action] if intervened else "" for action, intervened in actions],
    }
