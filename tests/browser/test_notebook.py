"""Notebooks, the labs and the player in JupyterLab and Notebook 7, as a reader uses them."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from urllib.request import Request, urlopen

import execute
import nbformat
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.long
DEADLINE = 180  # seconds
LAB = "from uavdh_lite.labs import Lab\nLab(tool='fly', city='village')"
PLAY = """from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.missions import Mission
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.scenario import find_scenario
city = load_city("village")
environment = Environment(city)
mission = Mission.draw(find_scenario("village"), city, 0)
play(environment, mission.fly(environment, Greedy(environment)).trajectory(0))"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a notebook whose cells have run, saved and trusted."""
    folder = tmp_path_factory.mktemp("notebooks")
    file = folder / "labs.ipynb"
    cells = [nbformat.v4.new_code_cell(source) for source in (LAB, PLAY, "keep = 1")]
    book = nbformat.v4.new_notebook(cells=cells)
    nbformat.write(book, file)
    run = [sys.executable, "-m", "jupyter", "execute", "--inplace", str(file)]
    subprocess.run(run, check=True, timeout=DEADLINE, capture_output=True)
    trust = [sys.executable, "-m", "jupyter", "trust", str(file)]
    subprocess.run(trust, check=True, timeout=DEADLINE, capture_output=True)
    assert len(json.dumps(json.loads(file.read_text())["cells"][0])) < 3_000_000
    return folder


@pytest.fixture(scope="module")
def server(folder):
    """The address of a Jupyter server over the folder, and the token."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ["--no-browser", "--allow-root", f"--port={port}", "--IdentityProvider.token=t"]
    command = [sys.executable, "-m", "jupyter", "lab", *options]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL) as process:
        address, end = f"http://127.0.0.1:{port}", time.monotonic() + DEADLINE
        while time.monotonic() < end:
            try:
                urlopen(f"{address}/api?token=t").close()
                break
            except OSError:
                time.sleep(0.3)
        yield address
        process.terminate()


def cells(page):
    """What stands in the notebook's cells now."""
    return page.locator(".jp-Cell .cm-content").all_inner_texts()


def step(root):
    return int(root.get_by_role("slider", name="step").input_value())


@pytest.mark.parametrize("application", ["lab/tree", "notebooks"])
def test_keys_fly_and_play_and_none_of_them_edits_the_notebook(server, browser, application):
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    page.goto(f"{server}/{application}/labs.ipynb?token=t")
    page.locator(".jp-Cell").nth(2).wait_for(timeout=DEADLINE * 1000)
    before = cells(page)
    assert len(before) == 3
    frame = page.frame_locator("iframe[title='uavdh_lite labs']")
    frame.locator(".map svg").first.click()  # no kernel has begun: the saved page works
    output = frame.locator(".controls output")
    for key, count in (("ArrowDown", 1), ("ArrowRight", 2), (" ", 3)):
        page.keyboard.press(key)
        expect(output).to_have_text(f"{count} of {count}")
    player = page.locator(".uavdh-player").first
    player.locator(".map").click()
    for key, expected in (("Home", 0), ("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1)):
        page.keyboard.press(key)
        assert step(player) == expected, key
    for place in (frame.locator(".map svg").first, player.locator(".map")):
        place.click()
        for key in (*"xabddymzcv", "Enter", "Shift+Enter", "Delete"):  # of a notebook
            page.keyboard.press(key)
    page.wait_for_timeout(500)
    assert cells(page) == before
    page.close()


def test_a_notebook_that_is_newer_than_its_script_is_opened_and_saved(server, folder):
    """Finding: paired by jupytext, it was refused with 400, and a save wrote into the script."""
    script, now = execute.scripts()[0], time.time()
    (folder / "scripts").mkdir()
    copy = shutil.copy(script, folder / "scripts")
    os.utime(copy, (now - 60, now - 60))  # as after a pull, or a save in another editor
    os.utime(shutil.copy(execute.notebook_of(script), folder), (now, now))
    address = f"{server}/api/contents/{script.stem}.ipynb?token=t"
    content = json.load(urlopen(address))["content"]
    assert content["cells"][0]["source"].startswith("# 0")
    saved = json.dumps({"type": "notebook", "content": content}).encode()
    urlopen(Request(address, saved, method="PUT")).close()
    assert (folder / "scripts" / script.name).read_text() == script.read_text()
