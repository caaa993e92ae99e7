"""The page of the labs, opened from a disk, without a network: what a person does and sees."""

import html
import json
import re
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from uavdh_lite.city import load_city
from uavdh_lite.labs.page import write_page
from uavdh_lite.missions import Mission, as_json
from uavdh_lite.scenario import find_scenario

TOOLS = ("Fly", "Compare", "Think", "Channel", "Paint", "Train")
SIZES = {  # in CSS pixels; zoomed is a projector at 200 %
    "phone": (390, 844),
    "zoomed": (960, 540),
    "laptop": (1280, 720),
}
COUNT = count()
SLOW = 30_000  # ms; only what never comes takes so long
expect.set_options(timeout=SLOW)


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "labs.html"
    write_page(file)
    assert file.stat().st_size < 10_000_000
    return file.as_uri()


@contextmanager
def visiting(browser, address, **options):
    """A page with the labs; it loads nothing from elsewhere and has no errors."""
    context, trouble = browser.new_context(**options), []
    context.set_default_timeout(SLOW)
    page = context.new_page()
    inside = ("data:", "blob:", address.split("#")[0])
    page.on("request", lambda r: r.url.startswith(inside) or trouble.append(r.url))
    page.on("console", lambda message: trouble.append(message.text))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.goto(address)
    page.locator(".map svg").wait_for()
    yield page
    context.close()
    assert trouble == []


@pytest.fixture(scope="module")
def shared(browser, address):
    with visiting(browser, address, viewport={"width": 1280, "height": 720}) as page:
        yield page


@pytest.fixture
def page(shared):
    """The page with the usual mission over manhattan in the tool Fly."""
    shared.set_viewport_size({"width": 1280, "height": 720})
    mission = Mission.draw(find_scenario("manhattan"), load_city("manhattan"), 0)
    content = json.dumps(as_json(mission)).encode()
    name = f"usual{next(COUNT)}.json"
    file = {"name": name, "mimeType": "", "buffer": content}
    shared.locator(".file input").set_input_files(file)
    expect(shared.locator(".refusal")).to_have_text(f"{name} is open.")
    shared.locator(".main[data-shows='fly']").wait_for()
    return shared


def settle(page):
    """Waits until all that was asked is answered."""
    page.locator(".main:not([aria-busy=true])").wait_for()


def press(page, name):
    page.get_by_role("button", name=name, exact=True).first.click()
    settle(page)


def choose(page, name, value):
    page.locator(f"[data-set='{name}']").select_option(value)
    settle(page)


def open_tool(page, title):
    page.get_by_role("tab", name=title).click()
    page.locator(f".main[data-shows='{title.lower()}']:not([aria-busy=true])").wait_for()


def place(page, row, col):
    """Where the middle of a cell is on the page."""
    return page.locator(".map svg").evaluate(
        """(svg, [y, x]) => {
            const there = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
            return [there.x, there.y];
        }""",
        [row, col],
    )


def device_of(page, device):
    """What stands for a device, or with −1 for the start, on the map where it can be moved."""
    return page.locator(f".flight:first-child .map g[data-device='{device}']")


def cell_of(page, device):
    """Row and column of a device, or with −1 of the start."""
    label = device_of(page, device).get_attribute("aria-label")
    return tuple(map(int, re.search(r"row (\d+), column (\d+)", label).groups()))


def expect_cell(page, device, row, col):
    said = re.compile(f"row {row}, column {col};")
    expect(device_of(page, device)).to_have_attribute("aria-label", said)


def drag(page, one, other):
    page.mouse.move(*place(page, *one))
    page.mouse.down()
    page.mouse.move(*place(page, *other), steps=12)
    page.mouse.up()


def steps(page):
    return page.locator(".controls output")


MAIN = {  # what is in sight before anybody scrolls
    "Fly": (".pad .land", ".hands"),
    "Compare": ("#panel h2", ".chart"),
    "Think": (".chosen", ".tool .rose"),
    "Channel": (".sentence", ".ledger"),
    "Paint": (".swatch:last-child",),
    "Train": ("[data-act=learn]",),
}
WORDS = """each => {
    const shown = (node) => !node.closest?.("details:not([open]) > :not(summary), svg, select");
    const walk = document.createTreeWalker(each, NodeFilter.SHOW_TEXT);
    let words = 0;
    for (let node = walk.nextNode(); node; node = walk.nextNode())
        if (shown(node.parentElement)) words += node.data.match(/\\p{L}+/gu)?.length ?? 0;
    return words;
}"""


@pytest.mark.parametrize("size", SIZES)
def test_the_map_is_large_each_tool_fits_and_no_panel_is_wordy(page, size):
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})
    for title in TOOLS:
        open_tool(page, title)
        at = size, title
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), at
        assert page.locator(".main").evaluate("each => each.scrollWidth <= each.clientWidth"), at
        assert page.locator(".tool").evaluate("each => each.scrollWidth <= each.clientWidth"), at
        expect(page.locator("header")).to_be_in_viewport(ratio=1)
        box = page.locator(".map svg:visible").bounding_box()
        if width < height:
            assert box["width"] >= 0.85 * width, at
        elif size == "zoomed":
            assert box["width"] * box["height"] >= 0.5 * width * height, at
        for needed in MAIN[title]:
            ratio = 1 if size == "laptop" else 0.4
            expect(page.locator(needed)).to_be_in_viewport(ratio=ratio)
        assert page.locator(".tool").evaluate(WORDS) <= 60, at
    open_tool(page, "Fly")


def test_no_barriers(page):
    """In the dark, the colours alone are others."""
    told = []
    for scheme, rules in (("dark", {"runOnly": ["color-contrast"]}), ("light", {})):
        page.emulate_media(color_scheme=scheme)
        for title in TOOLS:
            open_tool(page, title)
            found = Axe().run(page, options={"resultTypes": ["violations"], **rules})
            for v in found.response["violations"]:
                told.append((scheme, title, v["id"], [n["target"] for n in v["nodes"]][:5]))
    assert told == []


def test_the_story_leads_through_the_tools_in_four_captions(browser, address):
    with visiting(browser, address) as page:
        caption = page.locator(".caption")
        expect(caption).to_be_hidden()
        expect(page.get_by_role("tab", selected=True)).to_have_text("Fly")
        press(page, "Show me around")
        seen = []
        for name in ("fly", "compare", "think", "fly"):
            page.locator(f".main[data-shows='{name}']").wait_for()
            expect(caption.locator(".go")).to_be_focused()
            seen.append(caption.locator(".told").inner_text())
            assert len(seen[-1].split()) <= 25
            page.keyboard.press("Enter")
        assert len(set(seen)) == 4
        expect(caption).to_be_hidden()
        expect(page.locator("#panel")).to_be_focused()


def test_a_device_is_dragged_and_moved_by_keys_and_both_can_be_undone_and_redone(page):
    choose(page, "city", "empty 8 × 8")
    before = cell_of(page, 0)
    for there in ((7, 0), (2, 7), (6, 1)):  # however quickly, it stays where it is let go
        drag(page, cell_of(page, 0), there)
        expect_cell(page, 0, *there)
    label = page.locator(".map g[data-device='0']")
    label.focus()
    page.keyboard.press("ArrowDown")
    expect_cell(page, 0, 7, 1)
    expect(label).to_be_focused()
    for _ in range(4):
        page.keyboard.press("Control+z")
    expect_cell(page, 0, *before)
    press(page, "redo")
    expect_cell(page, 0, 7, 0)
    for key, there in (("Control+y", (2, 7)), ("Control+Shift+z", (6, 1)), ("Control+y", (7, 1))):
        page.keyboard.press(key)
        expect_cell(page, 0, *there)
    expect(page.get_by_role("button", name="redo")).to_be_hidden()
    page.locator(".map g[data-device='-1']").focus()
    row, col = cell_of(page, -1)
    page.keyboard.press("ArrowDown")
    expect_cell(page, -1, row + 1, col)


def test_a_flight_by_keys_ends_with_the_difference(page):
    open_tool(page, "Fly")
    for key, number in (("ArrowRight", 1), ("ArrowDown", 2), (" ", 3), ("Control+z", 2)):
        page.keyboard.press(key)
        expect(steps(page)).to_have_text(f"{number} of {number}")
    trail = page.locator(".ghost-path").get_attribute("d")
    assert len(set(trail[1:].split("L"))) <= 5  # as far as it has flown
    press(page, "Again")
    expect(steps(page)).to_have_text("0 of 0")
    pad = page.locator(".pad").bounding_box()
    page.keyboard.press(" ")  # steers, though Again was pressed
    expect(steps(page)).to_have_text("1 of 1")
    assert page.locator(".pad").bounding_box() == pad  # it does not jump
    row, _ = cell_of(page, -1)
    page.keyboard.press("ArrowUp" if row == 0 else "ArrowDown" if row == 15 else "ArrowLeft")
    expect(page.locator(".no")).to_have_text("Refused: the edge.")
    page.keyboard.press("L")
    heading = page.locator("#panel h2")
    expect(heading).to_contain_text("Greedy brings")
    press(page, "hover")
    expect(page.locator(".refusal")).to_contain_text("this flight is over")
    page.locator(".refusal").click()
    expect(page.locator(".refusal")).to_be_hidden()
    said = heading.inner_text()
    press(page, "See both flights")
    page.locator(".main[data-shows='compare']").wait_for()
    expect(heading).to_have_text(said)  # both say the same
    expect(page.locator("[data-ask*=duel]")).to_have_count(0)  # it is of this mission alone


def test_arrows_choose_a_tab_enter_opens_it_and_then_they_steer(page):
    page.get_by_role("tab", name="Fly").focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("tab", name="Compare")).to_be_focused()
    expect(page.get_by_role("tab", selected=True)).to_have_text("Fly")
    page.keyboard.press("Home")
    for key in ("Enter", " "):
        page.get_by_role("tab", name="Fly").press(key)
        expect(page.locator("#panel")).to_be_focused()
        expect(steps(page)).to_have_text("0 of 0")
    page.keyboard.press("ArrowRight")
    expect(steps(page)).to_have_text("1 of 1")


def test_two_flights_are_compared_over_one_map_and_one_chart(page):
    open_tool(page, "Compare")
    expect(page.locator(".map svg:visible")).to_have_count(1)
    expect(page.locator(".way:visible")).to_have_count(2)
    slider = page.get_by_role("slider", name="step")
    page.get_by_role("button", name="Where they part").click()
    step = int(re.search(r"step (\d+)", page.locator("#panel .row button").first.inner_text())[1])
    expect(slider).to_have_value(str(step))
    box = page.locator(".chart svg").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)  # one cursor for all
    last = int(slider.get_attribute("max"))
    assert abs(float(slider.input_value()) - last / 2) <= 1
    press(page, "Fly 100 new missions")
    found = page.locator(".many p")
    expect(found).to_contain_text("Over 100 missions drawn just now")
    press(page, "greedy ahead")
    expect(page.locator("#panel h2")).to_contain_text(re.compile("^Greedy|agent crashes"))
    page.set_viewport_size({"width": 1920, "height": 1080})  # room for two
    maps = page.locator(".map:visible")
    for k in (0, 1):
        way = maps.nth(k).locator(".way:visible")
        expect(way).to_have_count(1)
        expect(way).to_have_class(f"way of-{k}")
    side = maps.first.locator("svg").bounding_box()["height"]
    assert page.locator(".chart svg").bounding_box()["y"] > side >= 0.6 * 1080


def test_what_if_a_device_were_away_or_elsewhere_or_the_time_another(page):
    open_tool(page, "Think")
    page.get_by_role("slider", name="step", exact=True).fill("5")
    expect(page.locator(".chosen")).to_contain_text("Step 6: ")
    worth = page.locator("[data-amount='1']")
    expect(worth).to_have_text(re.compile(r"\d"))
    expect(page.locator(".cause")).to_contain_text("It expects")
    press(page, "without device 1")
    expect(page.locator(".chosen")).to_contain_text("What if: ")
    expect(page.locator(".tool .rose .before")).not_to_have_count(0)
    expect(page.get_by_role("button", name="with device 1")).to_be_focused()
    there = cell_of(page, 0)
    drag(page, there, (7, 7))
    expect_cell(page, 0, 7, 7)
    press(page, "As it was")
    expect_cell(page, 0, *there)
    page.locator("[data-set='whatif-time']").fill("-10")
    expect(page.locator("output.time")).to_have_text("-10")
    expect(page.locator(".chosen")).to_contain_text("What if: ")
    press(page, "As it was")
    page.get_by_label("value of each cell").check()
    expect(page.locator(".layer-scale .ramp")).to_be_visible()
    page.get_by_label("centred").check()
    expect(page.locator(".map .outside")).to_be_visible()
    for label in ("centred", "value of each cell"):
        page.get_by_label(label).uncheck()


def test_a_city_is_painted_by_pointer_and_keys_and_its_shadow_follows(page):
    choose(page, "city", "empty 8 × 8")
    open_tool(page, "Paint")
    page.get_by_role("button", name="tall building").click()
    drag(page, (4, 3), (4, 6))
    wall = page.locator(".map .kind-B").first
    expect(wall).to_have_attribute("d", re.compile("M2.5 3.5.*M5.5 3.5"))
    expect(page.locator("[data-set='city']")).to_have_value("my_city")
    page.mouse.move(*place(page, 6, 4))
    expect(page.locator(".map .shadow.live")).to_have_attribute("d", re.compile("M3.5 2.5"))
    page.locator(".map svg").focus()
    for key in ["ArrowDown"] * 8 + ["ArrowRight"] * 8 + [" "]:
        page.keyboard.press(key)
    expect(wall).to_have_attribute("d", re.compile("M6.5 6.5"))
    expect(page.locator(".map svg:focus")).to_have_count(1)  # though it was drawn anew
    open_tool(page, "Channel")
    page.locator(".map svg").focus()
    page.keyboard.press("ArrowUp")
    sentence = page.locator(".sentence")
    expect(sentence).to_contain_text("row 6, column 7")
    shown = page.locator(".ledger td").all_inner_texts()
    begin, loss, walls, snr = (float(each.split()[0].replace("−", "-")) for each in shown[:4])
    assert round(begin + loss + walls, 1) == snr  # as they are shown
    page.locator("#panel").focus()
    expect(sentence).to_contain_text("row 6, column 7")  # the last one stays


def test_an_address_a_file_and_a_reload_show_the_same_again(browser, address, page, tmp_path):
    addresses, seen = [], []
    for title in ("Compare", "Think"):
        open_tool(page, title)
        press(page, "New")
        page.get_by_role("slider", name="step", exact=True).fill("4")
        page.wait_for_timeout(600)  # the address follows
        addresses.append(page.url)
        seen.append(cell_of(page, 0))

    def expect_stage(page, k):
        page.locator(f".main[data-shows='{('compare', 'think')[k]}']").wait_for()
        expect(page.get_by_role("slider", name="step", exact=True)).to_have_value("4")
        expect_cell(page, 0, *seen[k])

    with visiting(browser, addresses[1]) as other:
        other.reload()
        expect_stage(other, 1)
        press(other, "More")
        time = other.locator("[data-field='time']")
        for wrong in ("", "501", "3.7"):  # the browser says why
            time.fill(wrong)
            time.press("Enter")
            assert not time.evaluate("each => each.checkValidity()")
        expect_stage(other, 1)
        with other.expect_download() as saved:
            press(other, "Save")
        saved.value.save_as(tmp_path / "stage.json")
        other.goto(addresses[0])
        expect_stage(other, 0)
        other.locator(".file input").set_input_files(tmp_path / "stage.json")
        expect_stage(other, 1)
        expect(other.locator(".drawer")).to_be_hidden()
        other.evaluate("() => { location.hash = '#stage=abcd'; }")
        expect(other.locator(".refusal")).to_contain_text("this link is damaged")


def test_touch_flies_lands_and_drags(browser, address):
    width, height = SIZES["phone"]
    options = {"viewport": {"width": width, "height": height}, "has_touch": True, "is_mobile": True}
    with visiting(browser, address, **options) as page:
        pad = page.locator(".pad").bounding_box()
        for action, number in (("hover", 1), ("north", 2), ("south", 3)):
            page.locator(f".pad .{action}").tap()
            expect(steps(page)).to_have_text(f"{number} of {number}")
            said = re.compile("Refused" if action == "north" else "^$")
            expect(page.locator(".no")).to_have_text(said)
            assert page.locator(".pad").bounding_box() == pad  # it does not jump
        page.locator(".pad .land").tap()
        expect(page.locator("#panel h2")).to_contain_text("Greedy brings")
        page.get_by_role("button", name="Again").tap()
        expect(steps(page)).to_have_text("0 of 0")
        x, y = place(page, *cell_of(page, 0))
        touch = page.context.new_cdp_session(page)
        for kind, there in (
            ("Start", (x + 13, y - 13)),
            ("Move", place(page, 6, 4)),
            ("End", None),
        ):
            points = [dict(zip("xy", there, strict=True))] if there else []
            touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})
            page.wait_for_timeout(60)  # a faster finger flings
        expect_cell(page, 0, 6, 4)
        page.get_by_role("tab", name="Channel").tap()
        page.locator(".main[data-shows='channel']").wait_for()
        page.touchscreen.tap(*place(page, 8, 8))
        expect(page.locator(".sentence")).to_contain_text("row 8, column 8")


# What VS Code allows the outputs of notebooks
WEBVIEW = """<meta http-equiv="Content-Security-Policy" content="default-src 'none';
    script-src 'unsafe-inline'; style-src 'unsafe-inline'; child-src https: data:">"""


def test_it_works_in_a_frame_in_a_webview_and_where_no_worker_may_begin(browser, address, tmp_path):
    whole = html.escape(Path(address.removeprefix("file://")).read_text(encoding="utf-8"))
    for content in (f'<iframe src="{address}"', f'{WEBVIEW}<iframe srcdoc="{whole}"'):
        around = tmp_path / "around.html"
        around.write_text(f'{content} width="1000" height="600"></iframe>', encoding="utf-8")
        page = browser.new_page()
        page.goto(around.as_uri())
        frame = page.frame_locator("iframe")
        frame.get_by_role("button", name="hover").click(timeout=SLOW)
        expect(frame.locator(".controls output")).to_have_text("1 of 1")
        assert len(page.workers) == 1
        page.close()
    page = browser.new_page()
    page.add_init_script(
        """window.Worker = class {
            constructor() { setTimeout(() => this.onerror(new Event("error"))); }
            postMessage() {}
            terminate() {}
        };"""
    )
    page.goto(address)
    open_tool(page, "Think")
    expect(page.locator(".tool .rose path")).not_to_have_count(0)
    page.close()
