"""A tour of the labs in three engines: `python -m pytest -m long tests/browser/test_engines.py`.

Needs a browser with its driver: chromedriver, geckodriver, or WebKitGTK's WebKitWebDriver, which
also needs a display (`xvfb-run` gives one). An engine that is not there is skipped.
"""

import os
import shutil
import time
from pathlib import Path

import pytest

from uavdh_lite.labs.page import write_page

DRIVERS = {"chromium": "chromedriver", "firefox": "geckodriver", "webkit": "WebKitWebDriver"}
SLOW = 2  # seconds to the first picture at most, in the quickest of three tries
TROUBLE = """
window.trouble = [];
window.addEventListener("error", ({ message }) => window.trouble.push(message));
window.addEventListener("unhandledrejection", ({ reason }) => window.trouble.push(`${reason}`));
"""
SETTLED = """return Boolean(document.querySelector(".map svg")) &&
    document.querySelector(".main").ariaBusy !== "true";"""
# What is drawn at a place where another engine draws it elsewhere: strokes without a length, texts
ODD = """const all = (name) => [...document.querySelectorAll(`.map ${name}`)];
    return all("path").filter((each) => /[hv]0(?![.\\d])/.test(each.getAttribute("d"))).length +
        all("text").filter((each) => !each.getAttribute("dy")).length;"""
# Presses what is there, at random, and keys over the panel; each act has its answer before the next
MONKEY = """
const [count, done] = arguments;
let seed = 7;
const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
const pick = (list) => list[Math.floor(random() * list.length)];
const busy = () => document.querySelector(".main").ariaBusy === "true";
const rest = () => new Promise((resolve) => setTimeout(resolve, 10));
const keys = ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", " ", "l", "Enter", "Escape"];
(async () => {
    for (let k = 0; k < count; k += 1) {
        const all = document.querySelectorAll(".main :is(button:not(.full), select, summary)");
        const target = pick([...all].filter((each) => each.checkVisibility() && !each.disabled &&
            !/save|many|duel/.test(each.dataset.ask ?? "")));
        if (target.matches("select")) {
            target.value = pick([...target.options]).value;
            target.dispatchEvent(new Event("change", { bubbles: true }));
        } else if (random() < 0.7) target.click();
        else document.querySelector("#panel").dispatchEvent(
            new KeyboardEvent("keydown", { key: pick(keys), bubbles: true }));
        for (let n = 0; n < 500 && (n === 0 || busy()); n += 1) await rest();
        const said = document.querySelector(".refusal").textContent;
        if (said.includes("did not work")) window.trouble.push(said);
    }
    done(window.trouble);
})();
"""


def begin(engine: str):
    """A browser without a window, or a skip."""
    webdriver = pytest.importorskip("selenium.webdriver")
    driver = shutil.which(DRIVERS[engine])
    if driver is None or (engine == "webkit" and not os.environ.get("DISPLAY")):
        pytest.skip(f"no {DRIVERS[engine]}, or no display for it")
    if engine == "chromium":
        options = webdriver.ChromeOptions()
        for argument in ("--headless=new", "--no-sandbox"):
            options.add_argument(argument)
        return webdriver.Chrome(options, webdriver.ChromeService(driver))
    if engine == "firefox":
        options = webdriver.FirefoxOptions()
        options.add_argument("-headless")
        return webdriver.Firefox(options, webdriver.FirefoxService(driver))
    return webdriver.WebKitGTK(
        webdriver.WebKitGTKOptions(), service=webdriver.WebKitGTKService(driver)
    )


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Selenium's own, for WebKitGTK
@pytest.mark.parametrize("engine", DRIVERS)
def test_every_tool_works_in_every_engine(engine, tmp_path):
    browser = begin(engine)
    try:
        browser.set_window_size(1280, 800)
        browser.set_script_timeout(300)
        file = tmp_path / "labs.html"
        write_page(file)

        def wait(condition=SETTLED, seconds=60):
            end = time.monotonic() + seconds
            while not browser.execute_script(condition):
                assert time.monotonic() < end, condition
                time.sleep(0.02)

        times = []
        for _ in range(3):  # a machine that does other things, too, is slow now and then
            began = time.monotonic()
            browser.get(file.as_uri())
            wait()
            times.append(time.monotonic() - began)
        print(f"{engine}: first picture after {min(times):.2f} s")
        assert min(times) < SLOW
        browser.execute_script(TROUBLE)
        for tab in browser.find_elements("css selector", "[role=tab]"):
            name = tab.get_attribute("data-tool")
            tab.click()
            wait(f"return document.querySelector('.main').dataset.shows === '{name}';")
            wait()
            assert browser.execute_script(ODD) == 0, name
            if folder := os.environ.get("PICTURES"):
                time.sleep(1)
                browser.save_screenshot(str(Path(folder) / f"{engine}_{name}.png"))
        browser.execute_script("location.hash = '#stage=abcd';")
        wait("return document.querySelector('.refusal').textContent.includes('damaged');")
        assert browser.execute_async_script(MONKEY, 300) == []
    finally:
        browser.quit()
