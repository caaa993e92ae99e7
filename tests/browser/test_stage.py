"""The stage in a real browser, used as a person would; pictures in build/screenshots."""

import json
import os
import re
import shutil
import time
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect, sync_playwright
from serving import serving

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SCREENSHOTS = Path(__file__).parents[2] / "build" / "screenshots"
WAIT = int(os.environ.get("WAIT", 180_000))  # ms; only a page that never answers takes so long
OWN = ("http://127.0.0.1", "ws://127.0.0.1", "data:", "blob:")
TOOLS = ["Fly", "Compare", "Think", "Channel", "Paint", "Train"]
FIRST = """new MutationObserver(() => {
    window.first ??= document.querySelector(".stages")?.textContent || null;
}).observe(document, { childList: true, subtree: true })"""  # what the stage shows first
PLACE = """(svg, [row, col]) => {
    const { x, y } = new DOMPoint(col, row).matrixTransform(svg.getScreenCTM());
    return [x, y];
}"""

NONE = "no Chromium: install it, or name one in CHROMIUM"
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=NONE)


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
def visiting(browser, address, **options):
    """A page with the stage; all that it loads comes from the server, and it has no errors."""
    options = {"viewport": {"width": 1280, "height": 720}, **options}
    page = browser.new_page(**options)
    page.set_default_timeout(WAIT)
    expect.set_options(timeout=WAIT)
    outside, errors = [], []
    page.on("request", lambda r: r.url.startswith(OWN) or outside.append(r.url))
    page.on("console", lambda m: m.type == "error" and errors.append(m.text))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.add_init_script(FIRST)
    page.goto(address)
    page.locator(".uavdh-stage .map svg").first.wait_for()
    yield page
    page.goto("about:blank")  # ends the session; closing the page alone would not, here
    page.close()
    assert outside == [] and errors == []


@pytest.fixture(scope="module")
def shared(browser, server):
    with visiting(browser, server) as page:
        yield page


@pytest.fixture
def page(shared):
    """A page for several tests, with the village's first mission: a page takes seconds to come."""
    choose(shared, "city", "manhattan")
    choose(shared, "city", "village")
    open_tool(shared, "Compare")
    return shared


def choose(page, name, option):
    """Choose in a list, and wait until Python has answered."""
    page.locator(f"[data-set='{name}']").select_option(option)
    if name == "city":
        size = {"manhattan": 16, "village": 8, "empty 8 × 8": 8}[option]
        grid = re.compile(rf"^M-?\.?\d* ?-?\.5h{size}")
        expect(page.locator(".map .paper").first).to_have_attribute("d", grid)
        expect(page.locator(".undo")).to_be_enabled()


def open_tool(page, title):
    page.get_by_role("tab", name=title, exact=True).click()
    page.locator(f".main[data-shows='{title.lower()}']").wait_for()


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def place(page, row, col, flight=0):
    """Where the middle of a cell is on the page."""
    return page.locator(".map svg").nth(flight).evaluate(PLACE, [row, col])


def cell_of(page, device):
    """Row and column of a device on the map."""
    label = page.locator(f".map g[data-device='{device}']").first.get_attribute("aria-label")
    return [int(number) for number in re.findall(r"(?:row|column) (\d+)", label)]


def drag(page, start, end):
    page.mouse.move(*place(page, *start))
    page.mouse.down()
    page.mouse.move(*place(page, end[0], end[1] - 1), steps=6)
    page.wait_for_timeout(200)  # the map is drawn anew under the pointer
    page.mouse.move(*place(page, *end))
    page.mouse.up()


def free_cell(page):
    """A cell with nothing in it, found on the map."""
    count = page.locator(".map").first.locator("g.device").count()
    taken = [cell_of(page, k) for k in range(count)]
    return next([r, c] for r, c in ([7, 7], [7, 6], [6, 7], [7, 5]) if [r, c] not in taken)


def shown_step(page):
    return int(page.locator(".controls output").inner_text().split()[0])


def shoot(page, name):
    """Keep a small picture of the page."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.mouse.move(5, 5)
    page.screenshot(path=SCREENSHOTS / f"{name}.png")


def test_it_begins_with_a_story_that_ends_where_one_begins_oneself(browser, server):
    with visiting(browser, server) as page:
        caption = page.locator(".caption")
        expect(caption).to_contain_text("Two drones, one mission")
        assert len(caption.locator("p").first.inner_text().split()) <= 16
        begun = time.monotonic()
        expect(caption).to_contain_text("Here they part")
        assert time.monotonic() - begun > 6
        part = shown_step(page)
        expect(page.locator("h2").first).to_be_hidden()  # the verdict
        expect(caption).to_contain_text(re.compile("wins: .* your turn"))
        assert part < shown_step(page) and time.monotonic() - begun > 12
        press(page, "Your turn")
        expect(caption).to_be_hidden()
        expect(page.locator("h2").first).to_contain_text("wins")


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (820, 1180)])
def test_the_map_is_large_and_nothing_scrolls(browser, server, shared, size):
    width, height = size
    shared.set_viewport_size({"width": width, "height": height})
    for title in TOOLS:
        open_tool(shared, title)
        box = shared.locator(".map svg").first.bounding_box()
        wanted = 0.4 if title == "Compare" and width < 1000 else 0.6
        assert box["height"] >= wanted * height or box["height"] >= 0.47 * width, title
        assert shared.evaluate("document.documentElement.scrollWidth <= innerWidth"), title
        assert shared.evaluate("document.documentElement.scrollHeight <= innerHeight + 8"), title
        if title in ("Compare", "Paint"):
            press(shared, "100 missions")
            expect(shared.locator(".many")).to_contain_text("95 % interval")
            assert lowest(shared, ".many") <= height, title
    shared.set_viewport_size({"width": 1280, "height": 720})


def lowest(page, selector):
    box = page.locator(selector).bounding_box()
    return box["y"] + box["height"]


def test_a_device_is_dragged_and_undo_brings_it_back(page):
    open_tool(page, "Channel")
    before, goal = cell_of(page, 0), free_cell(page)
    drag(page, before, goal)
    there = f"Row {goal[0]}, column {goal[1]}"  # the cell under the pointer, which has not moved
    expect(page.locator(".sentence")).to_contain_text(there)
    device = page.locator(".map g[data-device='0']").first
    expect(device).to_have_attribute("aria-label", re.compile(rf"row {goal[0]}, column {goal[1]};"))
    for _ in range(8):  # each cell on the way is a step back, unless they came fast
        if cell_of(page, 0) == before:
            break
        press(page, "undo")
        page.wait_for_timeout(300)
    assert cell_of(page, 0) == before


def test_a_refusal_says_why_and_a_number_that_cannot_be_is_put_back(page):
    before = cell_of(page, 0)
    for seconds in (0, 9):
        drag(page, before, [0, 0])
        expect(page.locator(".refusal")).to_contain_text(re.compile("Not done: .* stands"))
        page.wait_for_timeout(1000 * seconds) if seconds else press(page, "New")
        expect(page.locator(".refusal")).to_be_empty(timeout=4000)
        before = cell_of(page, 0)
    press(page, "More")
    time_field = page.get_by_label("flying time")
    given = time_field.input_value()
    for number in ("-3", "2.5", ""):
        time_field.fill(number)
        time_field.press("Enter")
        time_field.blur()
        expect(page.locator(".refusal")).to_contain_text("flying time")
        expect(time_field).to_have_value(given)
    press(page, "More")
    expect(page.locator(".drawer")).to_be_hidden()


def test_keys_move_a_device_and_delete_removes_it(page):
    press(page, "More")
    if page.locator(".drawer tr").count() == 2:
        page.locator(".drawer button", has_text="remove").last.click()
    add = page.get_by_role("button", name="Add a device")
    add.click()
    expect(add).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".drawer")).to_contain_text("Press a free cell on the map.")
    page.mouse.click(*place(page, 7, 7))
    expect(page.locator(".drawer")).to_contain_text("at most 2 devices here")
    expect(add).to_be_disabled()
    press(page, "More")
    expect(page.locator(".map").first.locator("g.device")).to_have_count(2)
    device = page.locator(".map g[data-device='1']").first
    page.locator(".side .bar[data-device='0']").first.click()
    drag(page, [7, 7], [6, 7])
    expect(device).to_have_attribute("aria-label", re.compile("row 6, column 7;"))
    assert page.evaluate("document.activeElement.closest('svg')") is None  # no ring on the map
    key, goal = "ArrowLeft", [6, 6]
    device.focus()
    page.keyboard.press(key)
    expect(device).to_have_attribute("aria-label", re.compile(rf"row {goal[0]}, column {goal[1]};"))
    device.focus()
    assert device.evaluate("each => getComputedStyle(each).outlineStyle") == "none"
    page.keyboard.press("Delete")
    expect(page.locator(".map").first.locator("g.device")).to_have_count(1)


def test_a_duel_shows_where_the_flights_part(page):
    choose(page, "city", "manhattan")
    press(page, "greedy wins")
    expect(page.locator("#panel h2").first).to_contain_text("Greedy wins")
    expect(page.locator(".parting")).to_have_count(2)
    button = page.get_by_role("button", name=re.compile("stop before step")).first
    step = int(button.inner_text())
    button.click()
    assert shown_step(page) == step - 1  # what comes next is this step
    for uav, ring in zip(
        page.locator(".map .uav").all(), page.locator(".parting").all(), strict=True
    ):
        place = f"translate({ring.get_attribute('cx')} {ring.get_attribute('cy')})"
        assert uav.get_attribute("transform") == place
    press(page, "Play")
    expect(page.locator(".controls .play")).to_have_text("Pause")
    expect(page.locator(".controls output")).to_have_text(re.compile(r"^(\d+) of \1$"))
    shoot(page, "compare")


def test_think_says_why_and_its_bars_are_as_long_as_their_numbers(page):
    open_tool(page, "Think")
    press(page, "Closest call")
    told = page.locator("#panel small").first.inner_text()
    step, gap = map(float, re.search(r"step (\d+): a gap of ([\d.]+)", told).groups())
    assert shown_step(page) == step - 1  # as in Compare: what comes next is this step
    said = re.compile(f"^Next, step {step:.0f}: .* ahead of")
    expect(page.locator(".says-why")).to_contain_text(said)
    bars = [
        (float(bar.locator("b").inner_text()), bar.locator("u").bounding_box())
        for bar in page.locator(".q > div:not(.best)").all()
        if re.fullmatch(
            r"[\d.]+", bar.locator("b").inner_text()
        )  # else it is not allowed, or level
    ]
    assert min(value for value, _ in bars) == pytest.approx(gap, abs=0.006)
    long, longest = max((value, box["width"]) for value, box in bars)
    for value, box in bars:
        assert box["width"] == pytest.approx(value / long * longest, abs=0.02 * longest)
    for layer in ("buildings", "data left", "value"):
        choose(page, "layer", layer)
        expect(page.locator(".layer path").first).to_be_attached()
        assert page.locator(".layer path").count() >= 40, layer
    expect(page.locator(".layer-scale")).to_contain_text("value")
    page.get_by_label("centred").check()
    page.keyboard.press("End")
    expect(page.locator(".says-why")).to_contain_text("It has landed.")
    width = 2 * 8 - 1
    box = page.locator(".map svg").get_attribute("viewBox").split()
    assert [float(side) for side in box[2:]] == [width, width]
    uav = page.locator(".map .uav").get_attribute("transform")
    col, row = map(float, re.findall(r"-?[\d.]+", uav))
    assert [float(box[0]) + width / 2, float(box[1]) + width / 2] == [col, row]
    page.get_by_label("centred").uncheck()
    choose(page, "layer", "value")
    page.wait_for_timeout(500)
    shoot(page, "think")
    choose(page, "layer", "none")


def test_the_channel_says_what_a_building_costs_under_the_pointer(page):
    open_tool(page, "Channel")
    expect(page.locator(".sentence")).to_contain_text(re.compile(r"costs \d+\.\d dB|In sight"))
    device = cell_of(page, 0)
    page.mouse.move(*place(page, *device))
    expect(page.locator(".sentence")).to_contain_text("In sight")
    lines = page.locator(".ledger td").all_inner_texts()
    signal, loss, building, snr = (float(line.split()[0].replace("−", "-")) for line in lines[:4])
    assert signal + loss + building == pytest.approx(snr, abs=0.11) and building == 0
    assert loss == pytest.approx(-22.7, abs=0.01)  # 10 · 2.27 · log10(10 m), straight above
    expect(page.locator(".map svg .under path")).to_have_count(64)
    choose(page, "city", "manhattan")
    expect(page.locator(".map svg .under path")).to_have_count(256)
    page.mouse.move(5, 5)
    expect(page.locator(".sentence")).to_contain_text("Behind a building")
    shoot(page, "channel")


def test_a_city_is_painted_and_a_hundred_missions_flown_over_it(page):
    open_tool(page, "Paint")
    choose(page, "city", "empty 8 × 8")
    expect(page.locator("[data-set='city']")).to_have_value("my_city")
    page.get_by_role("button", name="tall building").click()
    page.mouse.move(*place(page, 4, 3))
    page.mouse.down()
    page.mouse.move(*place(page, 4, 6), steps=9)
    page.mouse.up()
    squares = page.locator(".map .kind-B").first
    expect(squares).to_have_attribute("d", re.compile("M2.5 3.5h1v1h-1zM3.5 3.5.*M5.5 3.5"))
    page.mouse.move(*place(page, 6, 4))
    shadow = page.locator(".map .shadow.live")
    expect(shadow).to_have_attribute("d", re.compile("M3.5 2.5"))  # behind the wall
    shoot(page, "paint")


def test_a_flight_by_keys_and_buttons_ends_with_a_card_and_a_rank(page):
    page.locator(".controls input").fill("3")
    page.wait_for_timeout(600)  # the step is told when it stays
    open_tool(page, "Fly")
    for key, count in (("ArrowRight", 1), ("ArrowDown", 2), (" ", 3)):
        page.keyboard.press(key)
        expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
    trail = page.locator(".ghost-path").get_attribute("d")
    assert len(set(trail[1:].split("L"))) <= 4  # the start and what it has flown
    shoot(page, "fly")
    open_tool(page, "Think")
    assert shown_step(page) == 3  # as before
    open_tool(page, "Fly")
    press(page, "Again")
    expect(page.locator(".controls output")).to_have_text("0 of 0")
    pad = page.locator(".pad").bounding_box()
    for key, count in ((" ", 1), ("ArrowLeft", 2)):  # steer, though Again was pressed
        page.keyboard.press(key)
        expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
    expect(page.locator(".no")).to_contain_text("Refused: west, the edge of the city")
    assert page.locator(".pad").bounding_box()["y"] == pad["y"]  # it does not jump
    press(page, "Again")
    page.keyboard.press("L")
    expect(page.locator(".card")).to_contain_text("You landed with 0.0 units")
    expect(page.locator(".ranking tr")).to_have_count(2)
    press(page, "hover")
    expect(page.locator(".refusal")).to_contain_text("this flight is over")
    beside = page.locator(".ranking").bounding_box()["x"]
    assert beside > page.locator(".pad").bounding_box()["x"] + 100  # the list does not push it away
    for _ in range(2):
        press(page, "More")
    press(page, "Again")
    page.keyboard.press(" ")
    expect(page.locator(".controls output")).to_have_text("1 of 1")


def test_a_race_has_points_that_show_their_agents(page):
    open_tool(page, "Train")
    press(page, "Start")
    expect(page.locator(".dot")).not_to_have_count(0)
    page.locator(".dot").nth(6).wait_for()
    press(page, "Pause")
    expect(page.get_by_role("button", name="Go on")).to_be_visible()
    expect(page.locator(".setting")).not_to_contain_text("For a new race")
    page.locator("[data-set='orange']").select_option("failsafe")
    expect(page.locator(".setting")).to_contain_text("For a new race")  # not these
    expect(page.locator("#panel")).to_contain_text(
        "The curves: blue: the usual recipe; orange: no fear"
    )
    lowest_dot = max(page.locator(".dot").all(), key=lambda each: each.bounding_box()["y"])
    for dot, below in (page.locator(".blue .dot").last, 0), (lowest_dot, 15):  # on it, and below it
        about, box = dot.get_attribute("aria-label"), dot.bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + below)
        flier = "blue's agent" if below == 0 else "agent"
        steps = re.search(r"after ([\d,]+) steps", about)[1]
        expect(page.locator(".flies")).to_contain_text(f"{flier} after {steps} steps")
    lines = page.locator(".curves > g").evaluate_all("all => all.map((e) => e.className.baseVal)")
    assert lines == ["orange", "blue"]  # blue lies above, and its dots are smaller
    radius = [page.locator(f".{colour} .dot").first.get_attribute("r") for colour in lines]
    assert radius == ["5.5", "3.5"]
    assert page.locator(".verdict").bounding_box()["y"] >= lowest(page, ".curves")
    shoot(page, "train")
    below = page.locator(".flies").bounding_box()["y"]
    page.locator(".verdict").evaluate("each => (each.textContent = 'Blue has learned.')")
    assert page.locator(".flies").bounding_box()["y"] == below  # its room is kept
    assert "48,000 steps" in page.locator(".curves").text_content()  # the axis, from the beginning
    page.set_viewport_size({"width": 820, "height": 1180})
    page.locator(".uavdh-stage.narrow").wait_for()
    assert lowest(page, ".curves") <= 1180
    page.set_viewport_size({"width": 1280, "height": 720})
    points = page.locator(".dot").count()
    page.reload()
    expect(page.locator(".dot")).to_have_count(points)  # the session is kept


def test_words_explain_themselves(page):
    word = page.locator(".term", has_text="return").first
    assert "sum of rewards" in word.get_attribute("aria-label")
    word.focus()
    content = word.evaluate("each => getComputedStyle(each, '::after').content")
    assert "sum of rewards" in content


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("title", TOOLS)
def test_no_serious_barriers(page, title, scheme):
    page.emulate_media(color_scheme=scheme)
    open_tool(page, title)
    found = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
    serious = [v for v in found if v["impact"] in ("serious", "critical")]
    told = [(v["id"], [n["target"] for n in v["nodes"]][:5], v["help"]) for v in serious]
    page.emulate_media(color_scheme="light")
    assert told == []


def test_a_file_and_a_link_open_the_same_elsewhere(browser, server, page, tmp_path):
    open_tool(page, "Channel")
    press(page, "More")
    with page.expect_download() as saved:
        press(page, "Save")
    saved.value.save_as(tmp_path / "stage.json")
    press(page, "More")
    kept = json.loads((tmp_path / "stage.json").read_text())
    assert kept["tool"] == "channel" and kept["mission"]["city"]["name"] == "village"
    page.get_by_label("Open").set_input_files(tmp_path / "stage.json")
    label = page.locator(".map g[data-device='0']").first.get_attribute("aria-label")
    with visiting(browser, page.evaluate("location.href")) as other:
        assert other.evaluate("window.first") == "Opening your mission …"
        other.locator(".main[data-shows='channel']").wait_for()
        expect(other.locator(".map g[data-device='0']")).to_have_attribute("aria-label", label)
        other.reload()
        other.locator(".main[data-shows='channel']").wait_for()
        expect(other.locator(".caption")).to_be_hidden()
        broken = {"name": "a.json", "mimeType": "application/json", "buffer": b"{"}
        other.get_by_label("Open").set_input_files(files=[broken])
        expect(other.locator(".refusal")).to_contain_text("Not done: this file is no JSON")


def test_a_connection_that_is_cut_comes_back_and_what_was_done_meanwhile_is_told(browser, server):
    sockets, reachable = [], True

    def through(socket):
        sockets.append(socket)
        socket.connect_to_server() if reachable else socket.close()

    with visiting(browser, server) as page:
        press(page, "Skip the story")
        press(page, "New")
        expect(page.locator(".undo")).to_be_enabled()
        page.route_web_socket(re.compile("/socket"), through)
        page.reload()
        expect(page.locator(".undo")).to_be_enabled()  # the same session
        reachable = False
        sockets[-1].close()
        expect(page.locator("#lost")).to_be_visible()
        page.get_by_role("tab", name="Think").click()
        reachable = True
        page.locator(".main[data-shows='think']").wait_for()
        expect(page.locator("#lost")).to_be_hidden()
        expect(page.locator(".undo")).to_be_enabled()


def test_a_server_that_was_started_again_goes_on_from_the_address(browser):
    page = browser.new_page()
    with serving() as (address, _):
        page.goto(address)
        press(page, "Skip the story")
        choose(page, "city", "village")
        open_tool(page, "Channel")
        expect(page).to_have_url(re.compile("#stage="))
        label = page.locator(".map g[data-device='0']").get_attribute("aria-label")
    expect(page.locator("#lost")).to_be_visible()
    port = urlsplit(address).port
    with serving("-c", f"from uavdh_lite.labs.server import serve; serve({port}, False)"):
        expect(page.locator("#lost")).to_be_hidden()
        page.locator(".main[data-shows='channel']").wait_for()
        expect(page.locator(".map g[data-device='0']")).to_have_attribute("aria-label", label)
    page.close()


def test_touch_flies_and_drags(browser, server):
    tablet = {"viewport": {"width": 820, "height": 1180}, "has_touch": True}
    with visiting(browser, server, **tablet) as page:
        page.get_by_role("button", name="Skip the story").tap()
        page.get_by_role("tab", name="Fly").tap()
        page.locator(".main[data-shows='fly']").wait_for()
        page.locator(".pad .hover").tap()
        expect(page.locator(".controls output")).to_have_text("1 of 1")
        word = page.locator(".term").first
        word.tap()
        expect(word).to_be_focused()
        for flights in (1, 2, 3):
            page.get_by_role("button", name="land").tap()
            expect(page.locator(".ranking tr")).to_have_count(1 + flights)
            page.get_by_role("button", name="Again").tap()
            expect(page.locator(".controls output")).to_have_text("0 of 0")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert page.evaluate("document.documentElement.scrollHeight <= innerHeight + 8")
        assert lowest(page, ".ranking") <= 1180
        bars, ranking = (page.locator(each).bounding_box() for each in (".side", ".ranking"))
        assert bars["y"] + bars["height"] <= ranking["y"]


def test_full_screen_is_the_same_page_with_larger_letters(page):
    before = page.locator("h2").first.evaluate("each => getComputedStyle(each).fontSize")
    press(page, "full screen")
    page.locator(".uavdh-stage:fullscreen").wait_for()
    after = page.locator("h2").first.evaluate("each => getComputedStyle(each).fontSize")
    assert float(after[:-2]) > float(before[:-2])
    narrow = """each => { each.style.width = "max-content"; const wide = each.offsetWidth;
        each.style.width = ""; return each.offsetWidth - wide; }"""
    assert page.locator("[data-set='city']").evaluate(narrow) >= 0  # no name is cut
    speed, city = (page.locator(each).bounding_box() for each in ("output + *", ".actions"))
    assert speed["x"] + speed["width"] <= city["x"]
    expect(page.locator(".more")).to_be_hidden()
    press(page, "full screen")
    expect(page.locator(".uavdh-stage:fullscreen")).to_have_count(0)
