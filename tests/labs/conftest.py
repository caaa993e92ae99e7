"""The modules of the labs in Node and in a real browser, without the page around them."""

import base64
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from uavdh_lite.city import load_city
from uavdh_lite.labs.page import bundle, data
from uavdh_lite.missions import Mission, as_json
from uavdh_lite.scenario import find_scenario

DDQN = {"manhattan_ddqn": "manhattan_ddqn"}
TELL = """async ({ base64, ...told }) => {
    const answers = [];
    if (base64 !== undefined) told.file = { name: told.name, bytes: pilots_js.bytesOf(base64) };
    lab.post = (answer) => answers.push(answer);
    await lab.hear(told);
    return answers.findLast(({ kind }) => kind === "scene").scene;
}"""


@pytest.fixture(scope="session")
def ask():
    """A function: what `answer` of a module beside this one answers in Node."""
    if shutil.which("node") is None:
        pytest.skip("needs node")

    def ask(name: str, question: dict) -> dict:
        module = json.dumps(Path(__file__).with_name(name).as_uri())
        program = f"""import {{ answer }} from {module};
            import {{ readFileSync }} from "node:fs";
            process.stdout.write(JSON.stringify(await answer(JSON.parse(readFileSync(0)))));"""
        command = ["node", "--no-warnings", "--input-type=module", "--eval", program]
        done = subprocess.run(command, input=json.dumps(question), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return ask


@pytest.fixture(scope="session")
def rows_of():
    """A function: each state of a batch as JSON values."""

    def rows_of(state) -> list[dict]:
        names = ("uav_cell", "time_left", "device_cells", "data_initial", "data_left")
        columns = [getattr(state, name).tolist() for name in names]
        return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]

    return rows_of


@pytest.fixture(scope="module")
def modules(browser):
    """A function that evaluates JavaScript in which `NAME_js` is what the module NAME exports."""
    page = browser.new_page()
    page.add_script_tag(content=bundle(Path(__file__).with_name("modules.js")))
    return page.evaluate


@pytest.fixture(scope="module")
def shared(modules):
    """A session with the DDQN agent of manhattan, as `lab` in the browser."""
    told = json.dumps({**data(DDQN), "tool": None, "mission": None})
    modules(f"() => {{ window.lab = new session_js.Session({told}, () => {{}}); lab.render(); }}")


@pytest.fixture
def tell(modules, shared):
    """A function that tells the session something and returns the next scene.

    It begins with the village, the tool Compare, random and greedy, and nothing was before.
    """

    def tell(kind, refused="", **values):
        scene = modules(TELL, {"kind": kind, **values})
        assert refused in scene["refused"] and bool(scene["refused"]) == bool(refused), scene
        return scene

    mission = Mission.draw(find_scenario("village"), load_city("village"), 0)
    content = base64.b64encode(json.dumps(as_json(mission)).encode()).decode()
    modules("() => Object.assign(lab, { history: [lab.stage], at: 0 })")
    learned = "Object.keys(lab.agents).filter((name) => name.startsWith('your'))"
    modules(f"() => {{ for (const name of {learned}) delete lab.agents[name]; }}")
    tell("open", name="mission.json", base64=content)
    modules("() => Object.assign(lab, { history: [lab.stage], at: 0 })")
    return tell
