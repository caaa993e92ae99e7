"""The labs as one file that any browser opens, from a disk or a link: code, cities and agents.

Nothing is compiled: the modules stand in the page as they are, each in a function of its own.
"""

import base64
import hashlib
import json
import re
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save as to_bytes

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.recipes import BeyondRecipe, ImitationRecipe
from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load, load_agent, save_agent
from uavdh_lite.city import City, load_city, shipped_cities
from uavdh_lite.config import differences
from uavdh_lite.errors import InputError
from uavdh_lite.missions import Mission, as_json
from uavdh_lite.plotting import DEVICE_COLOURS
from uavdh_lite.recipe import Recipe, find_recipe
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.storage import data_folder, write_atomically

AGENTS = {  # the agents that the page has, with their names for people
    "manhattan_ddqn": "DDQN agent",
    "open_field_ddqn": "DDQN agent",
    "manhattan": "imitation agent",
    "open_field": "imitation agent",
    "any_city": "any-city agent",
}
TRAINED = data_folder() / "labs" / "village.safetensors"  # by the recipe of Train
PIECE = 65_536  # characters of a script: WebKit takes seconds for one that holds all
LARGEST = 16  # cells on a side of the cities that the page has
PACKAGE = Path(__file__).parents[1]
IMPORT = re.compile(r'^import (?:\{([^}]*)\}|\* as (\w+))\s+from "([^"]*)";$', re.MULTILINE)
EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+|\[[^]]*\])", re.MULTILINE)
PAGE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data: blob:;
  style-src 'unsafe-inline'; script-src 'unsafe-inline' data:; worker-src data:">
<title>uavdh_lite labs</title>
<link rel="icon" href="data:,">
<style>body {{ margin: 0; }}
{style}</style>
<main id="stage"><p>Beginning …</p></main>
{data}
<script type="module" id="code">{code}</script>
</html>
"""


def page(
    tool: str | None = None,
    mission: Mission | None = None,
    agents: Mapping[str, Agent | str | Path] | None = None,
) -> str:
    """The page, as HTML.

    Arguments:
        tool: the tool to have alone; None: all.
        mission: what it begins with; None: the story.
        agents: by the names that the page gives them, agents or their files; None: `AGENTS`.

    Raises `CheckpointError` for a file that holds no agent, and `InputError` for agents over
    several channels, or with parts that a page does not have.
    """
    names = ("player.css", "labs/stage.css")
    style = "\n".join((PACKAGE / name).read_text(encoding="utf-8") for name in names)
    about = {**data(agents), "tool": tool, "mission": mission and as_json(mission)}
    told = json.dumps(about, separators=(",", ":")).replace("<", "\\u003c")
    pieces = (told[begin : begin + PIECE] for begin in range(0, len(told), PIECE))
    held = "\n".join(f'<script type="application/json">{piece}</script>' for piece in pieces)
    return PAGE.format(style=style, data=held, code=bundle(PACKAGE / "labs" / "page.js"))


def write_page(path: str | Path) -> None:
    """Write the page, atomically."""
    write_atomically(path, lambda temporary: temporary.write_text(page(), encoding="utf-8"))


def data(agents: Mapping[str, Agent | str | Path] | None) -> dict[str, Any]:
    """What the page knows: cities with their scenarios, agents, colours, the recipe of Train."""
    shipped = (city for name in shipped_cities() if (city := load_city(name)).size <= LARGEST)
    cities = [_city(city, find_scenario(city.name)) for city in shipped]
    shelf, channel = [], None
    for name, source in ({each: each for each in AGENTS} if agents is None else agents).items():
        agent = source if isinstance(source, Agent) else load_agent(source)
        _require_flown(name, agent)
        channel = channel or agent.scenario.channel
        for own in (agent.scenario.channel, agent.environment.channel):
            if found := differences(channel, own):
                raise InputError(f"a page has one channel, but {name} has another, with {found}")
        content = packed(agent)
        about: dict[str, Any] = {"name": name, "title": name}
        if source == name and name in AGENTS:
            about["title"] = AGENTS[name]
        else:  # known by its content
            about["digest"] = hashlib.sha256(content).hexdigest()
        if len(agent.trained_in) == 1:
            own = _city(agent.trained_in[0], agent.scenario)
            known = next((each for each in cities if each["rows"] == own["rows"]), None)
            if known is None:
                taken = [each["name"] for each in cities]
                names = own["name"], *(f"{own['name']}_{k + 2}" for k in range(len(taken)))
                own["name"] = next(each for each in names if each not in taken)
                cities.append(own)
            about["city"] = (known or own)["name"]
        about["size"] = agent.observation.size
        about["scores"] = isinstance(agent.recipe, ImitationRecipe)
        shelf.append({**about, "base64": base64.b64encode(content).decode()})
    return {
        "cities": cities,
        "agents": shelf,
        "channel": asdict(channel or Channel()),
        "colours": DEVICE_COLOURS,
        "recipe": find_recipe("small").as_json(),
        "trained": base64.b64encode(packed(load_agent(TRAINED))).decode(),
    }


def _require_flown(name: str, agent: Agent) -> None:
    """Raise `InputError` for an agent that is more than its file says, which is all a page has."""
    recipe, own, usual = agent.recipe, [agent.recipe], [None]
    if type(recipe) in (Recipe, BeyondRecipe, ImitationRecipe):
        world = recipe.environment_for(agent.trained_in[0])
        sees = recipe.observation_for(world, agent.observation.size)
        with torch.device("meta"):  # without weights
            usual = [world, sees, recipe.network_for(sees)]
        own = [agent.environment, agent.observation, agent.network]
    for each, other in zip(own, usual, strict=True):
        if type(each) is not type(other):
            what = type(each).__name__
            raise InputError(f"{name}: a page has only what an agent's file says, and no {what}")


def _city(city: City, scenario: Scenario) -> dict[str, Any]:
    return {"name": city.name, "rows": city.text.split(), "scenario": asdict(scenario)}


def packed(agent: Agent) -> bytes:
    """An agent's file with its weights in half precision, without its cities if there are many."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "agent.safetensors"
        save_agent(file, agent)
        tensors, about = load(file, "agent")
    if len(about["cities"]) > 1:
        del tensors["cities"]
        about["cities"] = []
    weights = {k: v.half() if v.is_floating_point() else v for k, v in tensors.items()}
    return to_bytes(weights, {"uavdh_lite": json.dumps(about)})


def bundle(entry: Path) -> str:
    """A module and those that it imports, each a function that returns what it exports."""
    parts: dict[Path, str] = {}  # those that are imported come first

    def take(found: re.Match) -> str:
        names, whole, file = found.groups()
        return f"const {whole or '{' + names + '}'} = {Path(file).stem}_js;"

    def add(path: Path) -> None:
        source = path.read_text(encoding="utf-8")
        for *_, file in IMPORT.findall(source):
            if (other := (path.parent / file).resolve()) not in parts:
                add(other)
        exports = ", ".join(each.strip("[]") for each in EXPORT.findall(source))
        body = re.sub("^export ", "", IMPORT.sub(take, source), flags=re.MULTILINE)
        parts[path] = f"const {path.stem}_js = (() => {{\n{body}\nreturn {{ {exports} }};\n}})();\n"

    add(entry.resolve())
    return "\n".join(parts.values())
