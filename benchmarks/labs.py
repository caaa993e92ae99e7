"""How fast the labs are in a browser: the page of `python -m uavdh_lite app`, opened from a disk.

    python benchmarks/labs.py --minutes 1

Prints the size of the file, the time to the first picture, pictures a second, the time from a key
to the picture, pictures a second while a device is dragged, a city of 100×100 cells, how long an
agent takes to be read and for an action, and the memory of the page's drawing over some minutes of
flying. Needs Chromium, or its path in CHROMIUM.
"""

import argparse
import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, expect, sync_playwright

from uavdh_lite.city import City
from uavdh_lite.labs.page import PACKAGE, bundle, data, write_page

FRAMES = """async () => {
    document.querySelector(".play").click();
    let frames = 0;
    const began = performance.now();
    while (performance.now() - began < 3000) {
        await new Promise(requestAnimationFrame);
        frames += 1;
    }
    return frames / 3;
}"""
# Drags a device along the streets of rows 7 and 8 for three seconds and counts the pictures
DRAG = """async () => {
    const drawn = new Set();
    const stages = document.querySelector(".stages");
    const places = stages.querySelector("svg").getScreenCTM();
    const main = document.querySelector(".main");
    main.setPointerCapture = () => {};
    const send = (type, target, point) => {
        const { x: clientX, y: clientY } = point.matrixTransform(places);
        const where = { clientX, clientY, pointerId: 1, bubbles: true };
        target.dispatchEvent(new PointerEvent(type, where));
    };
    const watch = new MutationObserver(() => drawn.add(performance.now()));
    watch.observe(stages, { childList: true });
    const device = stages.querySelector("g[data-device='0']");
    const [x, y] = device.getAttribute("transform").match(/\\d+/g).map(Number);
    send("pointerdown", device.querySelector("path"), new DOMPoint(x, y));
    const began = performance.now();
    for (let k = 0; performance.now() - began < 3000; k += 1) {
        send("pointermove", main, new DOMPoint(Math.floor(k / 2) % 16, 7 + (k % 2)));
        await new Promise((resolve) => setTimeout(resolve, 8));
    }
    send("pointerup", main, new DOMPoint(8, 7));
    return drawn.size / 3;
}"""
KEY = """(key) => new Promise((resolve) => {
    const began = performance.now();
    const watch = new MutationObserver(() => {
        watch.disconnect();
        requestAnimationFrame(() => resolve(performance.now() - began));
    });
    watch.observe(document.querySelector(".stages"), { childList: true });
    const event = new KeyboardEvent("keydown", { key, bubbles: true });
    document.querySelector("#panel").dispatchEvent(event);
})"""

# Milliseconds to read an agent, and the median of its forward passes in the first city
PASSES = """([agent, { rows, scenario }]) => {
    const began = performance.now();
    const read = pilots_js.readAgent(pilots_js.bytesOf(agent.base64));
    const reading = performance.now() - began;
    const environment = new world_js.Environment(world_js.City.fromText("it", rows.join("\\n")));
    const { state } = world_js.Mission.draw(scenario, environment.city, 0);
    const flier = read.over(environment);
    const passes = Array.from({ length: 300 }, () => {
        const began = performance.now();
        flier.qValues(state);
        return performance.now() - began;
    });
    return [reading, passes.sort((one, other) => one - other)[150]];
}"""


def large_city(folder: Path) -> Path:
    """A city of 100×100 cells with a building in every ninth cell."""
    kinds = np.zeros((100, 100), np.uint8)
    kinds[3::3, 3::3] = 4
    kinds[:2, :2] = 3
    City.from_kinds("large", kinds).save(folder / "large.png")
    return folder / "large.png"


def opened(page: Page, file: Path) -> float:
    """Seconds until the first picture."""
    began = time.perf_counter()
    page.goto(file.as_uri())
    page.locator(".map svg").first.wait_for(timeout=600_000)
    return time.perf_counter() - began


def heap(page: Page) -> float:
    """MB that JavaScript holds on the page."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")["usedSize"] / 1e6


def time_agents(page: Page) -> None:
    page.add_script_tag(content=bundle(PACKAGE / "labs" / "pilots.js"))
    known = data(None, False)
    for agent in known["agents"]:
        reading, one = page.evaluate(PASSES, [agent, known["cities"][0]])
        print(f"{agent['name']:<20}read {reading:6.0f} ms, an action {one:.2f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=1, help="of flying, for the memory")
    minutes = parser.parse_args().minutes
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        file = folder / "labs.html"
        write_page(file)
        print(f"size of the file          {file.stat().st_size / 1e6:6.1f} MB")
        chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        seconds = [opened(page, file) for _ in range(5)]
        print(f"first picture             {statistics.median(seconds):6.2f} s")
        page.get_by_role("button", name="Skip the story").click()
        page.wait_for_timeout(1000)
        for agent in ("manhattan_ddqn", "any_city"):
            page.locator("[data-set='policy-0']").select_option(agent)
            page.wait_for_timeout(2000)
            print(f"drag, {agent:<20}{page.evaluate(DRAG):6.0f} pictures a second")
            page.wait_for_timeout(1000)
        page.locator("[data-set='policy-0']").select_option("manhattan_ddqn")
        print(f"pictures                  {page.evaluate(FRAMES):6.0f} a second")
        page.get_by_role("tab", name="Fly").click()
        page.wait_for_timeout(1000)
        keys = [page.evaluate(KEY, "ArrowUp") for _ in range(20)]
        print(f"from a key to the picture {statistics.median(keys):6.0f} ms")
        page.get_by_role("button", name="More").click()
        began = time.perf_counter()
        page.get_by_label("Open").set_input_files(large_city(folder))
        expect(page.locator("[data-set='city']")).to_have_value("my_city", timeout=600_000)
        print(f"100×100 cells             {time.perf_counter() - began:6.1f} s")
        page.locator("[data-set='city']").select_option("manhattan")
        page.get_by_role("tab", name="Compare").click()
        before, end = heap(page), time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            page.get_by_role("button", name="New").click()
            page.locator(".play").click()
            page.wait_for_timeout(1000)
        time_agents(browser.new_page())
        print(f"memory                    {before:6.1f} MB, then {heap(page):.1f} MB")


if __name__ == "__main__":
    main()
