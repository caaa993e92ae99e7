"""The training that one watches: what is drawn, and knobs that act while a cell runs."""

import asyncio

import numpy as np
import pytest
from jupyter_client.manager import start_new_kernel

from uavdh_lite.city import load_city
from uavdh_lite.course import live as module
from uavdh_lite.course.live import KNOBS, Live
from uavdh_lite.environment import NORTH, Environment
from uavdh_lite.one_file import VILLAGE, Settings

CELL = """
import asyncio, numpy as np
from uavdh_lite.city import load_city
from uavdh_lite.course.live import Live
from uavdh_lite.environment import Environment
from uavdh_lite.one_file import VILLAGE, Settings
environment, settings = Environment(load_city("village")), Settings()
missions = VILLAGE.sample(environment, 2, np.random.default_rng(0))
live = Live(settings, environment, missions)
async def training():
    while settings.temperature != 1000.0:
        await live.show(16, lambda state: np.zeros((len(state), 6)))
    return "turned"
print(await asyncio.wait_for(training(), 60))
"""


@pytest.fixture
def live():
    environment = Environment(load_city("village"))
    missions = VILLAGE.sample(environment, 2, np.random.default_rng(0))
    return Live(Settings(steps=160), environment, missions)


def to_the_north(state):
    return np.eye(6)[np.full(len(state), NORTH)]


def test_the_curve_grows_and_the_agent_of_now_flies_the_chosen_mission(live, monkeypatch):
    shown = []
    monkeypatch.setattr(module, "display", lambda what, **_: shown.append(what) or Shown(shown))
    monkeypatch.setattr(module, "SECONDS", 0.0)

    async def training():
        for step in range(16, 161, 16):
            await live.show(step, to_the_north, *((0.5, step / 160) if step % 80 == 0 else ()))

    asyncio.run(training())
    knobs, _, *pictures = shown
    assert len(knobs.children[0].children) + len(knobs.children[1].children) == len(KNOBS) + 1
    assert "knobs" in knobs._repr_mimebundle_()["text/html"]
    curve, flight = pictures[-1].axes
    assert len(pictures) == 2 and curve.lines[1].get_ydata() == pytest.approx([0.5, 1.0])
    assert "100%" in curve.get_title() and flight.get_xlabel().startswith("column")


class Shown:
    def __init__(self, shown):
        self.update = shown.append


def test_each_knob_sets_what_it_says_and_back(live):
    usual = vars(Settings(steps=160))
    for choices, at_first, act in KNOBS.values():
        assert at_first in choices
        for value in choices:
            act(live.settings, value)
            assert (vars(live.settings) == usual) == (value == at_first)
        act(live.settings, at_first)


def test_a_knob_turned_while_the_cell_runs_acts_at_once():
    manager, client = start_new_kernel()
    try:
        asked, turned, said = client.execute(CELL), False, ""
        while True:
            message = client.get_iopub_msg(timeout=120)
            content = message["content"]
            state = content.get("data", {}).get("state", {}) if "data" in content else {}
            if isinstance(state, dict) and state.get("description") == "temperature":
                update = {"method": "update", "state": {"index": 4}, "buffer_paths": []}
                turn = {"comm_id": content["comm_id"], "data": update}
                client.shell_channel.send(client.session.msg("comm_msg", turn))
                turned = True
            said += content.get("text", "") + "\n".join(content.get("traceback", ()))
            of_cell = message["parent_header"].get("msg_id") == asked
            if of_cell and content.get("execution_state") == "idle":
                break
        assert turned and "turned" in said, said
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
