"""How long visitors of the labs' page wait when several come at once, each in a browser's tab.

    python benchmarks/visitors.py --visitors 10

Prints the time to the first picture, to the map after a key that steers, and how smoothly flights
play while all of them do; medians and the longest. Needs Chromium, or its path in CHROMIUM.
"""

import argparse
import asyncio
import os
import re
import shutil
import statistics
import subprocess
import sys
import time

import psutil
from playwright.async_api import async_playwright

FRAMES = """async () => {
    document.querySelector(".uavdh-stage .play").click();
    let frames = 0;
    const began = performance.now();
    while (performance.now() - began < 3000) {
        await new Promise(requestAnimationFrame);
        frames += 1;
    }
    return frames / 3;
}"""


async def visit(browser, address: str) -> tuple:
    """Open the page; returns it and the seconds until its first picture."""
    page = await (await browser.new_context()).new_page()
    page.set_default_timeout(600_000)
    began = time.perf_counter()
    await page.goto(address)
    await page.locator(".uavdh-stage .map svg").first.wait_for()
    return page, time.perf_counter() - began


async def change(page) -> float:
    """One step by hand, with a key; returns the seconds until the map shows it."""
    await page.get_by_role("tab", name="Fly").click()
    await page.locator(".main[data-shows='fly']").wait_for()
    await page.wait_for_timeout(500)  # the key alone is measured
    flown = int((await page.locator(".controls output").inner_text()).split()[-1]) + 1
    began = time.perf_counter()
    await page.keyboard.press(" ")
    await page.locator(".controls output", has_text=f"of {flown}").wait_for()
    return time.perf_counter() - began


async def measure(address: str, visitors: int, server: psutil.Process) -> None:
    async with async_playwright() as playwright:
        chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
        browser = await playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        visits = await asyncio.gather(*(visit(browser, address) for _ in range(visitors)))
        pages = [page for page, _ in visits]
        report("first picture, s", [seconds for _, seconds in visits])
        frames = await asyncio.gather(*(page.evaluate(FRAMES) for page in pages))
        report("frames a second, all playing", frames)
        report("a key that steers, s", await asyncio.gather(*map(change, pages)))
        report("one after the other, s", [await change(page) for page in pages])
        print(f"memory: {server.memory_full_info().uss / 1e6:,.0f} MB")
        await browser.close()


def report(about: str, values: list[float]) -> None:
    print(f"{about}: median {statistics.median(values):.2f}, longest {max(values):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--visitors", type=int, default=10)
    visitors = parser.parse_args().visitors
    command = [sys.executable, "-m", "uavdh_lite", "app", "--no-browser", "--port", "8950"]
    server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        lines = (re.match(r"labs: (\S+)", line) for line in server.stderr)
        address = next(found[1] for found in lines if found)
        asyncio.run(measure(address, visitors, psutil.Process(server.pid)))
    finally:
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
