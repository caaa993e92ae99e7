"""The labs as one file that any browser opens, from a disk or a link: code, cities and agents.

Nothing is compiled: the modules stand in the page as they are, each in an address of its own.
"""

import base64
import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors.torch import save as to_bytes

from uavdh_lite import __version__
from uavdh_lite.checkpoint import load
from uavdh_lite.city import load_city, shipped_cities
from uavdh_lite.missions import Mission, as_json
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder, write_atomically

AGENTS = {  # the agents that the page has, with their names for people
    "manhattan_ddqn": "DDQN agent",
    "open_field_ddqn": "DDQN agent",
    "manhattan": "imitation agent",
    "open_field": "imitation agent",
    "any_city": "any-city agent",
}
LARGEST = 16  # cells on a side of the cities that the page has
PACKAGE = Path(__file__).parents[1]
IMPORT = re.compile(r'(\bfrom |\bimport\(|\bresolve\()"(\.{1,2}/[\w./]+)"')
PAGE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data: blob:;
  style-src 'unsafe-inline'; script-src 'unsafe-inline' data:; worker-src data:">
<title>uavdh_lite labs</title>
<link rel="icon" href="data:,">
<style>body {{ margin: 0; }}
{style}</style>
<main id="stage"></main>
<script type="application/json" id="data">{data}</script>
<script type="importmap">{modules}</script>
<script type="module">
import {{ open }} from "stage.js";
open(document.getElementById("stage"), JSON.parse(document.getElementById("data").textContent));
</script>
</html>
"""


def page(tool: str | None = None, mission: Mission | None = None) -> str:
    """The page, as HTML.

    Arguments:
        tool: the tool to have alone; None: all.
        mission: what it begins with; None: the story.
    """
    style = "\n".join(
        (PACKAGE / name).read_text(encoding="utf-8") for name in ("player.css", "labs/stage.css")
    )
    about = {**data(), "tool": tool, "mission": mission and as_json(mission)}
    modules = {"imports": import_map(PACKAGE / "labs" / "stage.js")}
    return PAGE.format(style=style, data=_json(about), modules=_json(modules))


def write_page(path: str | Path) -> None:
    """Write the page, atomically."""
    write_atomically(path, lambda temporary: temporary.write_text(page(), encoding="utf-8"))


def data() -> dict[str, Any]:
    """What the page knows: the version, cities with their scenarios, agents, recorded races."""
    cities = [city for name in shipped_cities() if (city := load_city(name)).size <= LARGEST]
    return {
        "version": __version__,
        "cities": [
            {
                "name": city.name,
                "rows": city.text.split(),
                "scenario": asdict(find_scenario(city.name)),
            }
            for city in cities
        ],
        "agents": [
            {"name": name, "title": title, "base64": _base64(packed_agent(checkpoint(name)))}
            for name, title in AGENTS.items()
        ],
        "races": None,
    }


def checkpoint(name: str) -> Path:
    """The file of a shipped agent."""
    return data_folder() / "checkpoints" / f"{name}.safetensors"


def packed_agent(path: Path) -> bytes:
    """An agent's file with its weights in half precision, without its cities if there are many."""
    tensors, about = load(path, "agent")
    if len(about["cities"]) > 1:
        del tensors["cities"]
        about["cities"] = []
    weights = {k: v.half() if v.is_floating_point() else v for k, v in tensors.items()}
    return to_bytes(weights, {"uavdh_lite": json.dumps(about)})


def import_map(entry: Path) -> dict[str, str]:
    """The address of each module that one needs, and its own, by the name in its folder.

    A worker has no import map, so it brings its modules along.
    """
    found, todo = {}, [entry]
    while todo:
        path = todo.pop()
        if path.name in found:
            continue
        source = path.read_text(encoding="utf-8")
        workers = path.name == "worker.js"
        found[path.name] = address(_whole(path) if workers else IMPORT.sub(_bare, source))
        todo += [] if workers else [path.parent / name for _, name in IMPORT.findall(source)]
    return found


def _bare(found: re.Match) -> str:
    return f'{found[1]}"{Path(found[2]).name}"'


def _whole(path: Path) -> str:
    """A module in which the others stand as addresses."""
    source = path.read_text(encoding="utf-8")
    return IMPORT.sub(lambda it: f'{it[1]}"{address(_whole(path.parent / it[2]))}"', source)


def address(source: str) -> str:
    """A module as an address."""
    return f"data:text/javascript;base64,{_base64(source.encode())}"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _json(value: Any) -> str:
    """A value as JSON that may stand in a script of a page."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")
