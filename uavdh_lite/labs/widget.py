"""The labs in a notebook: the same page, in a frame."""

import html
from pathlib import Path

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.labs.page import page
from uavdh_lite.missions import Mission
from uavdh_lite.policies import agents_for
from uavdh_lite.scenario import find_scenario

TOOLS = ("fly", "compare", "think", "channel", "paint", "train")
LIGHT = ("manhattan_ddqn", "open_field_ddqn")  # agents that make a notebook hardly larger
FRAME = """<iframe srcdoc="{page}" title="uavdh_lite labs" allow="fullscreen; clipboard-write"
  style="width: 100%; height: {height}px; border: 0"></iframe>"""


class Lab:
    """One city, one mission, and six tools to look at it: the page of the labs in a cell's output.

    It lies in a frame of its own, so that no key reaches the notebook while it has the focus. It
    needs no kernel once it is shown, and stays in the notebook when that is saved.

    Arguments:
        tool: one of fly, compare, think, channel, paint and train, to have it alone; None: all.
        city: the name of a shipped city of at most 16×16 cells; None: the agent's, or manhattan.
        mission: what it begins with; None: a random one over the city.
        agent: an agent that flies, too, or its file. Without one, the page has the DDQN agent where
            there is one for the city; the others would make the notebook many megabytes larger.
        height: of the frame, pixels.

    Raises `InputError` for a tool that there is not and for an agent that cannot fly here, and
    `CheckpointError` for a file that holds no agent.
    """

    def __init__(
        self,
        tool: str | None = None,
        city: str | None = None,
        *,
        mission: Mission | None = None,
        agent: Agent | str | Path | None = None,
        height: int = 620,
    ):
        if tool is not None and tool not in TOOLS:
            raise InputError(f"tool {tool!r}: choose one of {', '.join(TOOLS)}")
        if agent is not None and not isinstance(agent, Agent):
            agent = load_agent(agent)
        mission = mission or _mission(agent, city)
        if agent and not agent.knows((mission.city,)):
            there = mission.city.name
            raise InputError(f"this agent was not trained for {there}: a page cannot fly it there")
        agents: dict[str, Agent | str | Path] = {"yours": agent} if agent else {}
        agents |= {name: name for name in agents_for(Environment(mission.city)) if name in LIGHT}
        self.page = page(tool, mission, agents)
        self.height = height

    def _repr_html_(self) -> str:
        return FRAME.format(page=html.escape(self.page), height=self.height)


def _mission(agent: Agent | None, city: str | None) -> Mission:
    """A mission over a shipped city, or over that of an agent, if it flies over only one."""
    if city is None and agent and len(agent.cities) == 1:
        return Mission.draw(agent.scenario, agent.city, 0)
    city = city or "manhattan"
    return Mission.draw(find_scenario(city), load_city(city), 0)
