"""The labs' web page, used in a real browser as a person would; pictures in build/screenshots."""

import base64
import json
import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect, sync_playwright
from serving import IMPATIENT, serving

from uavdh_lite.city import City
from uavdh_lite.labs.draft import Draft
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.scenario import find_scenario

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SCREENSHOTS = Path(__file__).parents[2] / "build" / "screenshots"
WAIT = 180_000  # milliseconds; only a page that never answers takes so long

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium: install it, or name one in CHROMIUM"
)


@pytest.fixture(scope="module")
def server():
    with serving() as (address, _):
        yield address


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def visiting(browser, server):
    """The page with its first lab; all that it loads comes from the server."""
    page = browser.new_page(viewport=SCREEN)
    page.set_default_timeout(WAIT)
    expect.set_options(timeout=WAIT)
    outside, errors = [], []
    page.on("request", lambda r: outside.append(r.url) if not r.url.startswith(OWN) else None)
    page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(server)
    page.locator(SHOWN).first.wait_for()
    yield page
    page.on("dialog", lambda dialog: dialog.accept())  # yes, leave what was painted
    page.goto("about:blank")  # ends the session; closing the page alone would not, here
    page.close()
    assert outside == [] and errors == []


@pytest.fixture
def page(browser, server):
    """A page of one's own."""
    with visiting(browser, server) as page:
        yield page


@pytest.fixture(scope="module")
def shared_page(browser, server):
    """One page for several tests, each of which opens another lab: a page takes seconds to come."""
    with visiting(browser, server) as page:
        yield page


@pytest.fixture
def on_screen(shared_page):
    """Give the shared page another size, for one test only."""
    yield lambda width, height: shared_page.set_viewport_size({"width": width, "height": height})
    shared_page.evaluate("document.fullscreenElement && document.exitFullscreen()")
    shared_page.set_viewport_size(SCREEN)


SCREEN = {"width": 1280, "height": 1000}
SHOWN = ".uavdh-picture img[src]:visible, .uavdh-stage .map svg:visible"
OWN = ("http://127.0.0.1", "ws://127.0.0.1", "data:", "blob:")


def open_lab(page, title):
    page.get_by_role("tab", name=title, exact=True).click()
    lab = page.locator(".jp-OutputArea-output .widget-tab-contents > :not(.lm-mod-hidden)")
    lab.locator(SHOWN).first.wait_for()
    return lab


def shoot(page, name):
    """Keep a picture of the page."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENSHOTS / f"{name}.png")


def place_of_cell(lab, row, col, flight=0):
    """Where the middle of a cell is on the page, on the map of a flight."""
    svg = lab.locator(".uavdh-stage .map svg").nth(flight)
    place = """(svg, [x, y]) => {
        const { x: left, y: top } = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
        return [left, top];
    }"""
    return svg.evaluate(place, [col, row])


def click_cell(page, lab, row, col, flight=0):
    page.mouse.click(*place_of_cell(lab, row, col, flight))


def drag_cell(page, lab, start, end):
    """Drag what is in a cell to another one."""
    page.mouse.move(*place_of_cell(lab, *start))
    page.mouse.down()
    page.mouse.move(*place_of_cell(lab, *end), steps=8)
    page.mouse.up()


def first_mission(city):
    """The mission that the labs start with in a city."""
    return Mission.draw(find_scenario(city), environment_of(city).city, 0)


def table(lab):
    """The numbers below the maps of the mission lab: a dict for each policy."""
    rows = lab.locator(".uavdh-numbers tr:not(:has(th))").all()
    head, *others = ([cell.inner_text() for cell in row.locator("td").all()] for row in rows)
    return [dict(zip(head, values, strict=True)) for values in others]


def collected(lab, row=0):
    """Collected and total data of a policy in that table."""
    return [float(value) for value in table(lab)[row]["data collected"].split(" of ")]


def until(page, condition):
    """Wait for a condition for which there is no locator."""
    for _ in range(WAIT // 100):
        if condition():
            return
        page.wait_for_timeout(100)
    raise AssertionError("waited in vain")


def settled_width(page, picture):
    """The width of a picture, once it no longer follows a screen that has changed."""
    widths = []

    def still():
        widths.append(picture.bounding_box()["width"])
        return len(widths) >= 5 and len(set(widths[-5:])) == 1

    until(page, still)
    return widths[-1]


def bottom(part):
    box = part.bounding_box()
    return box["y"] + box["height"]


def fill_the_screen(page, lab, filled=True):
    lab.get_by_role("button", name="Full screen").click()
    until(page, lambda: page.evaluate("document.fullscreenElement !== null") == filled)


def painted(link):
    """The city of the link that saves it."""
    return Draft.from_png(base64.b64decode(link.get_attribute("href").split("base64,")[1]))


def fits(page):
    """Whether nothing on the page reaches beyond its width."""
    right = """Math.max(...[...document.querySelectorAll("img, svg, .jupyter-widgets")].map(
        (each) => each.getBoundingClientRect().right))"""
    return page.evaluate(right) <= page.evaluate("innerWidth")


def kernel(page):
    config = page.locator("#jupyter-config-data").text_content()
    return json.loads(config)["kernelId"]


def test_a_mission_is_set_on_the_map_and_flown(page):
    lab = open_lab(page, "Mission")
    status = lab.locator("span[role=status]")
    devices = len(first_mission("manhattan").devices)
    amounts = lab.get_by_role("slider", name="data of device")
    expect(amounts).to_have_count(devices)
    before = collected(lab)[1]
    click_cell(page, lab, 8, 8)
    expect(amounts).to_have_count(devices + 1)
    until(page, lambda: collected(lab)[1] > before)
    lab.get_by_role("button", name="remove").click()
    click_cell(page, lab, 8, 8)
    expect(amounts).to_have_count(devices)
    lab.get_by_role("button", name="add", exact=True).click()

    flown = table(lab)[0]
    here, there = first_mission("manhattan").devices[0], (0, 6)  # far away
    drag_cell(page, lab, here, there)
    until(page, lambda: table(lab)[0] != flown)  # the device stands elsewhere
    drag_cell(page, lab, there, here)
    until(page, lambda: table(lab)[0] == flown)
    drag_cell(page, lab, here, (2, 2))  # onto a building: it goes back
    expect(status).to_contain_text("device 0 was not moved")
    device = lab.locator("svg [data-device='0']").first
    expect(device).to_have_attribute("transform", f"translate({here[1]} {here[0]})")

    click_cell(page, lab, 15.9, 8)  # the map ends at 15.5: it counts for the nearest cell
    expect(lab.get_by_role("button", name="at (15, 8)").first).to_be_visible()
    click_cell(page, lab, 16.6, 8)  # and this for none
    expect(amounts).to_have_count(devices + 1)
    page.keyboard.press("z")
    expect(amounts).to_have_count(devices)

    lab.get_by_label("compare with").select_option("greedy")
    until(page, lambda: len(table(lab)) == 2)
    assert [row["policy"] for row in table(lab)] == ["manhattan agent", "greedy"]
    lab.get_by_label("and with").select_option("random")
    expect(lab.locator(".uavdh-stage .flight")).to_have_count(3)
    expect(lab.get_by_text("more than random")).to_be_visible()
    assert fits(page)
    shoot(page, "mission")

    box = lab.get_by_role("slider", name="data of device 0").first.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.9 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.25 * box["width"], y, steps=5)
    expect(lab.get_by_text("start: 5.0")).to_be_visible()  # at once, before Python knows
    page.mouse.up()
    expect(lab.locator(".bar .number").first).to_contain_text("of 5.0")


def test_changes_are_undone_by_key_and_a_link_opens_the_mission(page):
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    lab = open_lab(page, "Mission")
    amounts, status = lab.get_by_role("slider", name="data of device"), "span[role=status]"
    devices = amounts.count()
    click_cell(page, lab, 8, 8)
    expect(amounts).to_have_count(devices + 1)
    page.keyboard.press("z")  # the mouse is over the map
    expect(amounts).to_have_count(devices)
    page.keyboard.press("y")
    expect(amounts).to_have_count(devices + 1)
    until(page, lambda: len(table(lab)) == 1)
    flown = table(lab)

    link = lab.get_by_role("link", name="link", exact=True)
    link.click()
    expect(lab.locator(status)).to_contain_text("Link copied")
    address = page.evaluate("navigator.clipboard.readText()")
    assert address == page.url and re.search(r"#mission=[A-Za-z0-9_-]+$", address)
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error()) }")
    link.click()
    expect(lab.locator(status)).to_contain_text("address bar")
    page.reload()  # somebody opens the address
    page.locator(SHOWN).first.wait_for()
    until(page, lambda: table(lab) == flown)


def test_the_browser_asks_before_work_is_lost_and_only_then(page, server):
    asked = []

    def leave(accept, until_then):
        def answer(dialog):
            asked.append(dialog.type)
            dialog.accept() if accept else dialog.dismiss()

        page.on("dialog", answer)
        page.evaluate("() => { setTimeout(() => location.reload()) }")
        until(page, until_then)
        page.remove_listener("dialog", answer)

    def paint():
        before = painted(save).kinds
        page.locator(SHOWN).first.wait_for()
        open_lab(page, "City").locator(".uavdh-picture img").click(position={"x": 230, "y": 200})
        until(page, lambda: (painted(save).kinds != before).any())

    save = open_lab(page, "City").get_by_role("link", name="save as PNG")
    paint()
    first = kernel(page)
    leave(False, lambda: asked == ["beforeunload"])
    edited = painted(save).kinds
    page.keyboard.press("z")  # one stays, and the session is alive
    until(page, lambda: (painted(save).kinds != edited).any())
    page.keyboard.press("y")
    until(page, lambda: (painted(save).kinds == edited).all())
    leave(True, lambda: len(asked) == 2 and kernel(page) != first)
    session = f"{server}api/kernels/{first}"
    until(page, lambda: page.request.get(session).status == 404)  # and who leaves gives it back
    page.locator(SHOWN).first.wait_for()
    open_lab(page, "City")
    paint()
    with page.expect_download():
        save.click()
    second = kernel(page)
    leave(False, lambda: kernel(page) != second)  # it was saved: nobody is asked
    assert len(asked) == 2


@pytest.mark.parametrize(
    "title, shown", [("Mission", ".uavdh-stage .map"), ("Channel", ".uavdh-picture img")]
)
def test_a_large_screen_is_used_and_pictures_fill_it(shared_page, on_screen, title, shown):
    page = shared_page
    lab = open_lab(page, title)
    picture = lab.locator(shown).first
    on_screen(1280, 720)
    small = settled_width(page, picture)
    on_screen(1920, 1080)
    until(page, lambda: picture.bounding_box()["width"] > 1.3 * small and fits(page))
    large = settled_width(page, picture)
    fill_the_screen(page, lab)
    until(page, lambda: picture.bounding_box()["width"] > large)
    if title == "Channel":  # clicks count where they are
        at, alt = picture.bounding_box(), picture.get_attribute("alt")
        picture.click(position={"x": 0.3 * at["width"], "y": 0.4 * at["height"]})
        expect(picture).not_to_have_attribute("alt", alt)
    fill_the_screen(page, lab, filled=False)


def test_a_click_on_a_row_keeps_the_shadow_of_its_device(shared_page):
    lab = open_lab(shared_page, "Mission")
    shadow = lab.locator("[data-shadow='1']")
    row = lab.locator(".bar[data-device='1'] .what")
    row.click()
    lab.locator(".legend").hover()
    expect(shadow).to_have_attribute("visibility", "visible")
    row.click()
    lab.locator(".legend").hover()
    expect(shadow).to_have_attribute("visibility", "hidden")


def test_keys_set_bars_move_devices_and_scrub(page):
    lab = open_lab(page, "Mission")
    time = lab.get_by_role("slider", name="flying time")
    given = int(time.get_attribute("aria-valuenow"))
    time.focus()
    for less in (1, 2):
        page.keyboard.press("ArrowLeft")
        until(page, lambda: table(lab)[0]["time left"].endswith(f"of {given - less}"))  # noqa: B023
        expect(time).to_be_focused()  # although the maps were drawn again

    before = collected(lab)[1]
    amount = lab.get_by_role("slider", name="data of device 1")
    amount.focus()
    page.keyboard.press("End")
    until(page, lambda: collected(lab)[1] > before)
    expect(amount).to_have_attribute("aria-valuenow", "20")

    row, col = first_mission("manhattan").devices[0]
    lab.get_by_role("button", name="device 0 at").first.focus()
    page.keyboard.press("ArrowDown")
    moved = lab.get_by_role("button", name=f"device 0 at ({row + 1}, {col})").first
    expect(moved).to_be_focused()

    end = table(lab)[0]["time left"]
    lab.get_by_role("slider", name="step").focus()
    page.keyboard.press("Home")
    until(page, lambda: table(lab)[0]["time left"] == f"{given - 2} of {given - 2}")
    assert collected(lab)[0] == 0
    lab.get_by_label("speed").select_option("4")
    lab.get_by_role("button", name="Play").click()  # and the flight runs to its end
    until(page, lambda: table(lab)[0]["time left"] == end)


def test_quick_keys_on_bars_all_count(shared_page):
    lab = open_lab(shared_page, "Mission")
    time = lab.get_by_role("slider", name="flying time")
    given = int(time.get_attribute("aria-valuenow"))
    press = """(element) => { for (let k = 0; k < 5; k += 1) element.dispatchEvent(
        new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true })); }"""
    time.evaluate(press)  # none waits for Python
    expect(time).to_have_attribute("aria-valuenow", str(given + 5))
    until(shared_page, lambda: table(lab)[0]["time left"].endswith(f"of {given + 5}"))
    time.focus()
    for _ in range(5):
        shared_page.keyboard.press("ArrowLeft")  # while answers come
    expect(time).to_have_attribute("aria-valuenow", str(given))
    until(shared_page, lambda: table(lab)[0]["time left"].endswith(f"of {given}"))
    expect(lab.get_by_text("changed", exact=True)).to_have_count(0)  # all is as it was


def test_a_refused_move_is_red_at_the_uav(shared_page):
    lab = open_lab(shared_page, "Fly it yourself")
    lab.get_by_label("city").select_option("manhattan")
    lab.get_by_role("button", name="start again").click()
    red = lab.locator(".uavdh-stage .refused")
    expect(red).to_have_count(0)
    row, col = first_mission("manhattan").start
    assert row in (0, 15)  # at the map's edge
    lab.locator(".uavdh-stage .map svg").click()
    shared_page.keyboard.press("ArrowDown" if row == 15 else "ArrowUp")
    expect(lab).to_contain_text("the map ends there")
    expect(red).to_have_attribute("transform", f"translate({col} {row})")
    shared_page.keyboard.press(" ")
    expect(red).to_have_count(0)


CORNER = """async (image) => {
    await image.decode();
    const paper = document.createElement("canvas").getContext("2d");
    paper.drawImage(image, 0, 0);
    return [...paper.getImageData(0, 0, 1, 1).data];
}"""


@pytest.mark.parametrize("title", ["Mission", "City"])
def test_figures_are_dark_on_a_dark_page(shared_page, title):
    lab = open_lab(shared_page, title)
    picture = lab.locator(".uavdh-picture img").first
    corner = lambda: picture.evaluate(CORNER)[0]  # noqa: E731
    until(shared_page, lambda: corner() == 255)
    shared_page.emulate_media(color_scheme="dark")
    until(shared_page, lambda: corner() < 50)
    shared_page.emulate_media(color_scheme="light")
    until(shared_page, lambda: corner() == 255)


def test_a_finger_drags_a_device(browser, server):
    page = browser.new_page(viewport={"width": 820, "height": 1180}, has_touch=True)
    page.set_default_timeout(WAIT)
    page.goto(server)
    page.locator(SHOWN).first.wait_for()
    lab = open_lab(page, "Mission")
    settled_width(page, lab.locator(".uavdh-stage .map"))
    row, col = first_mission("manhattan").devices[0]
    session = page.context.new_cdp_session(page)
    for kind, cell in (("touchStart", (row, col)), ("touchMove", (8, 7)), ("touchMove", (8, 8))):
        x, y = place_of_cell(lab, *cell)
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    expect(lab.get_by_role("button", name="device 0 at (8, 8)").first).to_be_visible()
    page.goto("about:blank")
    page.close()


def test_quick_keys_leave_the_map_at_the_last_step(shared_page):
    lab = open_lab(shared_page, "Fly it yourself")
    lab.get_by_role("button", name="start again").click()
    expect(lab.locator(".uavdh-stage output")).to_have_text("0 of 0")
    for _ in range(8):
        shared_page.keyboard.press(" ")
    counter = lab.locator(".uavdh-stage output")
    expect(counter).to_have_text("8 of 8")
    shared_page.wait_for_timeout(1000)
    expect(counter).to_have_text("8 of 8")


SMOOTH = """async (lab) => {
    const uav = lab.querySelector("[data-uav]");
    const places = new Set();
    let frames = 0;
    const began = performance.now();
    lab.querySelector(".play").click();
    while (performance.now() - began < 2000) {
        await new Promise(requestAnimationFrame);
        frames += 1;
        places.add(uav.getAttribute("transform"));
    }
    return [frames, places.size];
}"""


def test_flights_play_smoothly_and_scrubbing_asks_nobody(shared_page):
    """The UAV has a new place in nearly every frame; a step is drawn in the event that asks."""
    lab = open_lab(shared_page, "Mission")
    stage = lab.locator(".uavdh-stage")
    frames, places = stage.evaluate(SMOOTH)
    assert places > 0.8 * frames > 8  # 8 steps of flight: Python's pictures would be 8 places
    at_once = """(stage) => {
        const [slider, uav] = [stage.querySelector("input"), stage.querySelector("[data-uav]")];
        const places = [0, 5, 11].map((step) => {
            slider.value = step;
            slider.dispatchEvent(new Event("input"));
            return uav.getAttribute("transform");
        });
        return new Set(places).size;
    }"""
    assert stage.evaluate(at_once) == 3


def test_what_the_agent_thinks_changes_from_step_to_step(shared_page, on_screen):
    lab = open_lab(shared_page, "Watch it think")
    thoughts, arrows = lab.locator(".uavdh-picture img"), lab.locator(".thoughts > *")
    signs = "signs => signs.map((sign) => sign.outerHTML)"
    first, drawn = thoughts.get_attribute("src"), arrows.evaluate_all(signs)
    expect(lab.locator(".thoughts > .best")).to_have_count(1)
    lab.get_by_role("slider", name="step").focus()
    for _ in range(7):
        shared_page.keyboard.press("ArrowRight")
    time = first_mission("manhattan").flying_time
    until(shared_page, lambda: table(lab)[0]["time left"] == f"{time - 7} of {time}")
    expect(lab.get_by_text("Last step: ")).to_be_visible()
    assert thoughts.get_attribute("src") != first
    assert arrows.evaluate_all(signs) != drawn
    shoot(shared_page, "think")
    now = thoughts.get_attribute("src")
    lab.get_by_role("slider", name="temperature").focus()
    shared_page.keyboard.press("End")
    until(shared_page, lambda: thoughts.get_attribute("src") != now)
    map_ = lab.locator(".map svg")
    for height in (1000, 720):  # the map beside the thoughts, and all of it in sight
        on_screen(1280, height)
        until(shared_page, lambda: bottom(map_) <= height)  # noqa: B023
        left, right = map_.bounding_box(), thoughts.bounding_box()
        assert left["x"] + left["width"] <= right["x"] and fits(shared_page)


def test_keys_fly_wherever_the_focus_is_and_in_full_screen(shared_page, on_screen):
    page = shared_page
    lab = open_lab(page, "Fly it yourself")
    lab.get_by_label("city").select_option("village")
    left = first_mission("village").flying_time
    button = lambda name: lab.get_by_role("button", name=re.compile(f"{name}$"))  # noqa: E731

    def after(used, say):
        expect(lab.locator(".uavdh-sentence")).to_contain_text(f"{left - used} units of time left")
        expect(lab.locator(".uavdh-sentence")).to_contain_text(say)

    button("start again").click()
    after(0, "")
    assert "uavdh-stage" in page.evaluate("document.activeElement.className")
    for used, refused in ((1, False), (2, True)):
        page.keyboard.press("ArrowUp")
        after(used, "north is refused" if refused else "flies north")
    page.keyboard.press("z")
    after(1, "Step 2 is taken back")
    button("hover").click()
    after(2, "hovers")
    page.keyboard.press(" ")
    after(3, "hovers")
    page.get_by_role("tab", name="Fly it yourself", exact=True).click()
    page.keyboard.press(" ")
    after(4, "hovers")
    button("south").focus()  # reached by Tab: space and Enter are the button's
    page.keyboard.press("Enter")
    after(5, "flies south")
    number = lab.get_by_label("mission", exact=True)
    number.focus()
    page.keyboard.press("ArrowUp")  # the field's
    expect(number).to_have_value("1")
    page.keyboard.press("ArrowDown")
    after(0, "")

    on_screen(1280, 720)
    fill_the_screen(page, lab)
    page.keyboard.press(" ")
    after(1, "hovers")
    page.keyboard.press("Enter")
    for each in (lab.get_by_text("Arrow keys fly"), lab.locator(".uavdh-you td").last):
        expect(each).to_be_in_viewport(ratio=0.99)
    fill_the_screen(page, lab, filled=False)
    shoot(page, "fly")


def test_the_channel_follows_device_and_sliders(shared_page):
    page = shared_page
    lab = open_lab(page, "Channel")
    picture = lab.locator(".uavdh-picture img")
    box = picture.bounding_box()

    def place(row, column):
        """Where a cell of the map is: the axes are at these shares of the picture."""
        x, y = 0.03 + 0.45 * (column + 0.5) / 16, 0.06 + 0.82 * (row + 0.5) / 16
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def shown(device, uav):
        alt = re.compile(re.escape(f"device in cell {device}, UAV over {uav}"))
        expect(picture).to_have_attribute("alt", alt)

    page.mouse.click(*place(8, 4))
    shown((8, 4), (0, 0))
    page.mouse.move(*place(0, 0))  # the UAV, although a click moves the device
    page.mouse.down()
    page.mouse.move(*place(4, 0), steps=6)
    page.mouse.up()
    shown((8, 4), (4, 0))
    page.mouse.move(*place(8, 8), steps=3)
    expect(lab.get_by_text("Under the mouse, row 8, column 8")).to_be_visible()
    alt = picture.get_attribute("alt")
    lab.get_by_role("slider", name="edge SNR, dB").focus()
    page.keyboard.press("End")
    expect(picture).not_to_have_attribute("alt", alt)
    assert fits(page)
    shoot(page, "channel")


def test_a_click_while_the_next_picture_loads_counts_where_it_is(shared_page):
    lab = open_lab(shared_page, "Channel")
    picture = lab.locator(".uavdh-picture img")
    click = """async (image) => {
        const { left, top, width, height } = image.getBoundingClientRect();
        const [clientX, clientY] = [left + 0.25 * width, top + 0.45 * height];
        const next = await (await fetch(image.src)).blob();
        image.src = URL.createObjectURL(next);
        await null;
        image.setPointerCapture = () => {}; // there is no such pointer
        const pressed = { clientX, clientY, button: 0, buttons: 1, bubbles: true };
        image.dispatchEvent(new PointerEvent("pointerdown", pressed));
        image.dispatchEvent(new PointerEvent("pointerup", pressed));
    }"""
    picture.evaluate(click)
    expect(picture).to_have_attribute("alt", re.compile(r"device in cell \(7, 7\)"))


@pytest.mark.long
def test_two_trainings_race_pause_and_go_on(shared_page):
    lab = open_lab(shared_page, "Training")
    status, unsaved = lab.locator("span[role=status]"), shared_page.locator("body[data-unsaved]")
    rival = lab.get_by_label("rival: return steps")
    button = lambda name: lab.get_by_role("button", name=re.compile(f"{name}$"))  # noqa: E731
    lab.get_by_label("failsafe").first.check()
    lab.get_by_label("race a second agent").check()
    expect(rival).to_be_enabled()
    button("start").click()
    expect(rival).to_be_disabled()
    expect(unsaved).to_have_count(1)  # who leaves now is asked
    expect(status).to_contain_text(re.compile(r"after \d+,000 steps: .*; the rival landed"))
    button("pause training").click()
    expect(status).to_contain_text("paused")
    expect(unsaved).to_have_count(0)
    button("go on").click()
    expect(status).to_contain_text(re.compile(r"after (32|40|48),"))  # however fast it is
    for run in ("your run", "the rival"):
        expect(lab.get_by_text(re.compile(f"{run} after .* steps"))).to_be_visible()
    assert fits(shared_page)
    shoot(shared_page, "training")
    curves = lab.locator(".uavdh-picture img")
    start = 0.12 * curves.bounding_box()["width"] + 3  # the left end of the axes
    curves.click(position={"x": start, "y": 100})
    expect(lab.get_by_text("your run after 0 steps")).to_be_visible()
    button("pause training").click()
    button("new run").click()
    expect(rival).to_be_enabled()


def test_a_city_is_painted_uploaded_and_flown(shared_page):
    page = shared_page
    lab = open_lab(page, "City")
    status, picture = lab.locator("span[role=status]"), lab.locator(".uavdh-picture img")
    lab.get_by_label("size").fill("6")
    lab.get_by_label("size").press("Tab")
    lab.get_by_role("button", name="blank city").click()
    expect(status).to_contain_text("no start and landing zone")
    lab.get_by_role("button", name="landing zone").click()
    lab.get_by_role("button", name="click there").click()
    expect(status).not_to_contain_text("landing")
    lab.get_by_role("button", name="tall building").click()
    link = lab.get_by_role("link", name="save as PNG")

    def drag(down=0.5):
        box = picture.bounding_box()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + down * box["height"], steps=12)
        page.mouse.up()

    def buildings(count):
        until(page, lambda: painted(link).buildings.sum() == count)

    drag()
    buildings(3)
    lab.get_by_role("button", name="rectangle").click()
    drag(down=0.8)
    buildings(9)
    page.keyboard.press("z")
    buildings(3)
    lab.get_by_role("button", name="redo").click()
    buildings(9)
    picture.hover(position={"x": 60, "y": 60})
    expect(lab.get_by_text("of the cells without a building")).to_be_visible()

    with page.expect_file_chooser() as chooser:
        lab.get_by_role("button", name="open PNG").click()
    village = Draft(City.load("village").kinds).png()
    chooser.value.set_files([{"name": "x.png", "mimeType": "image/png", "buffer": village}])
    until(page, lambda: painted(link).size == 8)
    maps = lab.locator(".uavdh-stage .map svg")
    lab.get_by_role("button", name=re.compile(r"fly at once$")).click()
    expect(maps).to_have_count(2)
    before = painted(link).kinds
    drag(down=0.8)
    until(page, lambda: (painted(link).kinds != before).any())
    expect(lab.get_by_role("button", name="Play")).to_be_visible()  # they flew again, and landed
    assert fits(page)
    shoot(page, "city")
    kinds = painted(link).kinds
    lab.get_by_role("link", name="link", exact=True).click()
    expect(status).to_contain_text("address bar")
    page.reload()  # somebody opens the address
    link.wait_for()
    until(page, lambda: (painted(link).kinds == kinds).all())
    page.evaluate("location.hash = ''")


def test_every_lab_is_for_everybody(page):
    """No finding of axe-core, which checks contrast, names, roles and more, on a dark page and on a
    light one; a tablet is wide enough; and each tab and its words are explained."""
    for tab in page.get_by_role("tab").all():
        title = tab.inner_text()
        lab = open_lab(page, title)
        tab.hover()
        expect(tab).to_have_attribute("title", re.compile(r"\w+ .*\w"))
        lab.locator("summary").click()
        expect(lab.locator("dt").first).to_be_visible()
        if title == "Mission":
            lab.get_by_label("compare with").select_option("greedy")
            expect(lab.get_by_text("charts of")).to_be_visible()
        if title == "Training":
            lab.get_by_label("race a second agent").check()
            expect(lab.get_by_label("rival: temperature")).to_be_visible()
        for scheme, behind in (("dark", "rgb(17, 17, 17)"), ("light", "rgb(255, 255, 255)")):
            page.emulate_media(color_scheme=scheme)
            background = "getComputedStyle(document.body).backgroundColor"
            assert page.evaluate(background) == behind
            found = Axe().run(page).response["violations"]
            assert [(each["impact"], each["id"], each["nodes"][0]["html"]) for each in found] == []
        page.set_viewport_size({"width": 800, "height": 1100})
        until(page, lambda: fits(page))
        page.set_viewport_size(SCREEN)


@pytest.mark.long
def test_an_idle_session_ends_and_the_page_says_so(browser):
    with serving("-c", IMPATIENT) as (address, _):
        page = browser.new_page()
        page.goto(address)
        page.locator(SHOWN).first.wait_for(timeout=WAIT)
        expect(page.get_by_role("alert")).to_contain_text("has ended", timeout=WAIT)
        page.close()
