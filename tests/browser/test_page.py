"""The page of the labs, opened from a disk, without a network: what a person does and sees."""

import base64
import html
import json
import re
import zlib
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from uavdh_lite.beyond.measured import load_place
from uavdh_lite.city import load_city
from uavdh_lite.environment import ACTIONS
from uavdh_lite.labs.page import write_page
from uavdh_lite.missions import HandFlight, Mission, as_json
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder

TOOLS = ("Fly", "Compare", "Think", "Channel", "Paint", "Watch")
SIZES = {  # in CSS pixels: a phone, a page at 200 %, tablets, laptops, a projector
    "phone": (390, 844),
    "half": (640, 360),
    "doubled": (683, 425),
    "landscape": (844, 390),
    "zoomed": (960, 540),
    "tablet": (820, 1180),
    "small": (1024, 768),
    "laptop": (1280, 720),
    "projector": (1920, 1080),
}
SLOW = 60_000  # ms; only what never comes takes so long
expect.set_options(timeout=SLOW)


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "labs.html"
    write_page(file)
    assert file.stat().st_size < 12_000_000
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
    page.locator(".map svg").first.wait_for()
    yield page
    context.close()
    assert trouble == []


@pytest.fixture(scope="module")
def shared(browser, address):
    with visiting(browser, address, viewport={"width": 1280, "height": 720}) as page:
        press(page, "Skip the story")
        yield page


@pytest.fixture
def page(shared):
    """The page with the usual mission over manhattan in the tool Compare."""
    shared.set_viewport_size({"width": 1280, "height": 720})
    mission = Mission.draw(find_scenario("manhattan"), load_city("manhattan"), 0)
    content = json.dumps(as_json(mission)).encode()
    file = {"name": "usual.json", "mimeType": "", "buffer": content}
    shared.locator(".file input").set_input_files(file)
    expect(shared.locator(".refusal")).to_have_text("usual.json is open.")
    expect(shared.locator(".map svg")).to_have_count(2)
    return shared


def press(page, name):
    page.get_by_role("button", name=name, exact=True).first.click()


def choose(page, name, value):
    page.locator(f"[data-set='{name}']").select_option(value)


def open_tool(page, title):
    page.get_by_role("tab", name=title).click()
    page.locator(f".main[data-shows='{title.lower()}']").wait_for()
    page.wait_for_timeout(200)


def place(page, row, col):
    """Where the middle of a cell is on the page."""
    return page.locator(".map svg").first.evaluate(
        """(svg, [y, x]) => {
            const there = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
            return [there.x, there.y];
        }""",
        [row, col],
    )


def shown_step(page):
    return int(page.get_by_role("slider", name="step").input_value())


def visible(page, selector):
    """Whether a thing lies inside of the window, and of the panel that scrolls."""
    return page.locator(selector).first.evaluate(
        """each => {
            const box = each.getBoundingClientRect();
            const low = each.closest(".tool")?.getBoundingClientRect().bottom ?? innerHeight;
            const inside = box.left >= -1 && box.right <= innerWidth + 1 && box.top >= -1;
            return box.width > 0 && inside && box.bottom <= Math.min(innerHeight, low) + 1;
        }"""
    )


MAIN = {  # what the main task of a tool needs
    "Fly": (".pad .land", ".pad .east", ".pad .south", ".controls output"),
    "Compare": (".bar:nth-last-child(2)", "h2", "[data-ask*=duel]", ".play"),
    "Think": (".says-why", ".q > div:last-child"),
    "Channel": (".sentence", ".ledger"),
    "Paint": (".swatch", "[data-set=city]"),
    "Watch": (".curves",),
}


def test_every_tool_fits_its_window(page):
    for size, title in product(SIZES, TOOLS):
        width, height = SIZES[size]
        page.set_viewport_size({"width": width, "height": height})
        open_tool(page, title)
        at = size, title
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), at
        assert page.evaluate("document.documentElement.scrollHeight <= innerHeight"), at
        assert page.locator(".tool").evaluate("each => each.scrollWidth <= each.clientWidth"), at
        rooms = page.locator(".bar .room").evaluate_all(
            "all => all.filter((each) => each.checkVisibility()).map((each) => each.offsetWidth)"
        )
        assert min(rooms, default=15) >= 15, at
        sides = page.locator(".flight .side").evaluate_all(
            "all => all.every((each) => each.scrollWidth <= each.clientWidth)"
        )
        assert sides, at
        if title == "Compare":  # what is said of a cell is not cut off
            page.mouse.move(*place(page, 12, 4))
            expect(page.locator(".here").first).to_contain_text("Row 12, column 4")
            whole = "each => each.scrollWidth <= each.clientWidth"
            assert page.locator(".here").first.evaluate(whole), at
        if title in ("Compare", "Think"):  # all that a step brings is there, though it may scroll
            for each in page.locator(".flight .says, .flight .bar:nth-last-child(2)").all():
                each.scroll_into_view_if_needed()
                assert each.is_visible() and each.bounding_box()["height"] > 10, at
            page.evaluate("document.querySelector('.inside').scrollTop = 0")
        if title in ("Compare", "Think") and size in ("phone", "tablet", "half", "doubled"):
            assert page.get_by_role("button", name="one step forward").is_visible(), at
            assert page.get_by_role("slider", name="step").bounding_box()["width"] > 100, at
        needs = (".map svg", *MAIN[title])
        if title == "Compare" and height < 430:  # bars scroll, and what is chosen
            needs = (".map svg", ".flight .says", "h2", ".play")
        for needed in needs:
            assert visible(page, needed), (at, needed)
        if size in ("phone", "doubled") and title == "Compare":  # a sign says that a panel goes on
            if size == "doubled":
                press(page, "More")
            signs = page.locator(".tool" if size == "phone" else ".drawer").evaluate(
                """async each => {
                    const drawn = () => new Promise((done) => requestAnimationFrame(
                        () => requestAnimationFrame(done)));
                    const signs = [];
                    for (const place of [each.scrollHeight, 0]) {
                        each.scrollTop = place;
                        await drawn();
                        signs.push(getComputedStyle(each, "::after").opacity);
                    }
                    return signs;
                }"""
            )
            assert signs == ["0", "1"], at
            page.keyboard.press("Escape")
        expect(page.locator(".tool .legend")).to_have_count(1)
        violet = page.locator(".legend span", has_text="shadow").is_visible()
        assert violet == (title != "Channel"), at  # where shadows have a white edge


def test_no_type_is_small_on_a_projector_and_no_page_half_empty(page):
    page.set_viewport_size({"width": 1920, "height": 1080})
    for title in TOOLS:
        open_tool(page, title)
        small = page.evaluate(
            """() => [...document.querySelectorAll(".uavdh-stage *")]
                .filter((each) => each.checkVisibility())
                .filter((each) => [...each.childNodes].some((node) => node.data?.trim()))
                .map((each) => {
                    const scale = each.ownerSVGElement ? each.getScreenCTM().a : 1;
                    return [parseFloat(getComputedStyle(each).fontSize) * scale, each.textContent];
                })
                .filter(([size]) => size < 18)"""
        )
        assert small == [], title
        map_height = page.locator(".map svg").first.bounding_box()["height"]
        assert map_height > (640 if title == "Compare" else 900)
        if title == "Compare":
            says = page.locator(".says").first.bounding_box()
            assert says["y"] + says["height"] > 0.9 * 1080
    press(page, "full screen")  # where the last row reads it
    size = "parseFloat(getComputedStyle(document.querySelector('.tool')).fontSize)"
    page.wait_for_function(f"{size} > 24")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    tops = page.locator(".top :is(button, select, input, output)").evaluate_all(
        """all => all.filter((each) => each.checkVisibility())
            .map((each) => each.getBoundingClientRect())
            .map(({ left, right }) => [left, right]).sort((one, other) => one[0] - other[0])"""
    )
    assert all(one[1] <= other[0] + 1 for one, other in pairwise(tops))
    open_tool(page, "Compare")
    assert visible(page, "[data-ask*=many]")  # what comes of it
    assert page.get_by_role("slider", name="step").bounding_box()["width"] > 180
    open_tool(page, "Watch")
    choose(page, "run-1", "3")  # of which most is said
    expect(page.locator(".verdict")).to_contain_text("why, this record does not tell")
    assert visible(page, ".verdict")
    page.evaluate("document.exitFullscreen()")
    page.wait_for_function("!document.fullscreenElement")


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
    open_tool(page, "Compare")  # what Tab comes to: each thing on one map, and each word once
    assert page.locator(".flight ~ .flight [tabindex='0']").count() == 0
    words = page.locator(".tool .term").evaluate_all(
        "all => all.map((it) => [it.ariaLabel, it.tabIndex])"
    )
    stops = [word for word, stop in words if stop == 0]
    assert set(stops) == {word for word, _ in words} and len(stops) == len(set(stops)) < len(words)


def test_the_story_says_that_it_was_chosen_and_what_a_hundred_missions_say(browser, address):
    with visiting(browser, f"{address}#stage=") as page:
        expect(page.locator(".refusal")).to_contain_text(
            "this address is not a link to a page of the labs"
        )
        caption = page.locator(".caption")
        expect(caption).to_contain_text("Two drones, one mission")
        assert page.locator(".tool h2").evaluate(
            "each => !each.checkVisibility({visibilityProperty: true})"
        )
        go = page.get_by_role("button", name="Go on")
        expect(go).to_be_focused()
        for _ in range(2):  # it goes on in full screen
            page.locator(".full").press("Enter")
        go.focus()
        page.keyboard.press("Enter")
        expect(page.locator(".controls output")).not_to_have_text(re.compile("^0 of"))
        page.keyboard.press("Enter")  # while it plays, a second press does nothing
        expect(caption).to_contain_text("Here they part for good")
        expect(page.get_by_role("button", name="Play")).to_be_visible()  # until it is read
        expect(go).to_be_focused()
        for size in ("phone", "doubled"):  # its text ends above its buttons
            width, height = SIZES[size]
            page.set_viewport_size({"width": width, "height": height})
            text, row = (
                caption.locator(each).evaluate("each => each.getBoundingClientRect().toJSON()")
                for each in (".told", ".row")
            )
            assert text["bottom"] <= row["top"] + 1 and row["bottom"] <= height, size
        clock = page.locator(".controls input")
        clock.fill(clock.get_attribute("max"))
        expect(caption).to_contain_text("This mission was chosen because the difference shows.")
        expect(caption).to_contain_text("DDQN agent wins")  # else it would not be worth a story
        expect(caption).to_contain_text(
            re.compile(
                r"Over 100 random missions, .* brings 97 % and greedy brings 99 % of the data"
                " home, so on average greedy is ahead"
            ),
            timeout=SLOW,
        )
        press(page, "Your turn")
        expect(caption).to_be_hidden()
        assert page.evaluate("document.activeElement.id") == "panel"
        page.set_viewport_size({"width": 1280, "height": 720})
        choose(page, "city", "village")
        open_tool(page, "Fly")
        assert visible(page, ".tell")
        press(page, "A story first")  # from its beginning, over its own city
        expect(caption).to_contain_text("Two drones, one mission")
        expect(page.locator(".controls output")).to_have_text(re.compile("^0 of"))
        expect(page.locator("[data-set=city]")).to_have_value("manhattan")


def test_a_device_is_dragged_and_moved_by_keys_and_both_can_be_undone(page):
    label = page.locator(".map g[data-device='0']").first
    before = label.get_attribute("aria-label")
    row, col = map(int, re.findall(r"\d+", before)[1:3])
    said = page.locator(".map").first.locator("g[data-device]").all()
    taken = [re.findall(r"\d+", each.get_attribute("aria-label"))[1:3] for each in said]
    free = next(
        (0, c) for c in range(4, 12) if not {("0", str(c)), ("1", str(c))} & {*map(tuple, taken)}
    )
    page.mouse.move(*place(page, row, col))
    page.mouse.down()
    page.mouse.move(*place(page, *free))
    page.mouse.up()
    expect(label).to_have_attribute("aria-label", re.compile(f"row {free[0]}, column {free[1]}"))
    label.focus()
    page.keyboard.press("ArrowDown")
    expect(label).to_have_attribute(
        "aria-label", re.compile(f"row {free[0] + 1}, column {free[1]}")
    )
    expect(page.locator(".map g[data-device='0']:focus")).to_have_count(1)
    for _ in range(2):
        page.keyboard.press("Control+z")
    expect(label).to_have_attribute("aria-label", before)
    page.get_by_role("slider", name="step").focus()
    page.keyboard.press("Control+Shift+Z")
    expect(label).not_to_have_attribute("aria-label", before)
    page.keyboard.press("Control+z")
    expect(label).to_have_attribute("aria-label", before)
    start = page.locator(".map g[data-device='-1']").first
    row, col = map(int, re.findall(r"\d+", start.get_attribute("aria-label")))
    start.focus()
    page.keyboard.press("ArrowDown" if row < 8 else "ArrowUp")
    there = f"start, row {row + 1 if row < 8 else row - 1}, column {col}; arrows move it"
    expect(start).to_have_attribute("aria-label", there)
    expect(page.locator(".map g[data-device='-1']:focus")).to_have_count(1)
    page.get_by_role("button", name="undo").focus()
    while page.locator(".undo:focus").count():
        page.keyboard.press("Enter")
        page.wait_for_timeout(200)
    assert page.evaluate("document.activeElement.id") == "panel"  # nothing is left to undo


def test_a_device_that_is_dragged_quickly_over_many_cells_stays_where_it_is_let_go(page):
    choose(page, "city", "empty 8 × 8")
    open_tool(page, "Paint")
    label = page.locator(".map g[data-device='0']").first
    for there in ((2, 0), (7, 7), (2, 7), (7, 0)):
        row, col = map(int, re.findall(r"\d+", label.get_attribute("aria-label"))[1:3])
        page.mouse.move(*place(page, row, col))
        page.mouse.down()
        page.mouse.move(*place(page, *there), steps=12)
        page.mouse.up()
        said = re.compile(f"row {there[0]}, column {there[1]};")
        expect(label).to_have_attribute("aria-label", said, timeout=5000)


def test_a_flight_by_keys_ends_with_a_card_and_a_rank(page):
    open_tool(page, "Fly")
    for key, count in (("ArrowRight", 1), ("ArrowDown", 2), (" ", 3)):
        page.keyboard.press(key)
        expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
    for key, count in (("Control+z", 2), ("Control+Shift+Z", 3)):  # the last move
        page.keyboard.press(key)
        expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
    trail = page.locator(".ghost-path").get_attribute("d")
    assert len(set(trail[1:].split("L"))) <= 5  # as far as it has flown
    press(page, "Again")
    expect(page.locator(".controls output")).to_have_text("0 of 0")
    pad = page.locator(".pad").bounding_box()
    page.keyboard.press(" ")  # steers, though Again was pressed
    expect(page.locator(".controls output")).to_have_text("1 of 1")
    assert page.locator(".pad").bounding_box()["y"] == pad["y"]  # it does not jump
    page.keyboard.press(" ")
    expect(page.locator(".controls output")).to_have_text("2 of 2")
    press(page, "one step back")
    expect(page.locator(".no")).to_contain_text("after step 1 of 2; your next move goes on from")
    page.keyboard.press("L")
    expect(page.locator(".card")).to_contain_text("You landed with")
    expect(page.locator(".no")).to_have_text("")
    last = page.get_by_role("slider", name="step").get_attribute("max")
    assert int(last) > 3  # the ghost flies on
    expect(page.locator(".controls output")).to_have_text(f"{last} of {last}")
    expect(page.locator(".ranking tr")).to_have_count(2)
    press(page, "hover")
    expect(page.locator(".refusal")).to_contain_text("this flight is over")
    page.locator(".refusal").click()
    expect(page.locator(".refusal")).to_be_hidden()
    heading = page.locator(".card h2").inner_text()
    press(page, "Compare with greedy")
    expect(page.locator("#panel h2").first).to_contain_text(f"{heading}:")  # both say the same
    expect(page.locator(".flight .name")).to_have_text(["you", "greedy"])
    open_tool(page, "Fly")
    press(page, "New")
    expect(page.locator(".controls output")).to_have_text("0 of 0")
    press(page, "undo")
    page.locator(".card").wait_for()
    assert page.locator(".play").inner_text() == "Play"  # no move was made that would be shown
    for name in ("policy-1", "city"):  # a list keeps the keys that choose in it
        page.locator(f"[data-set='{name}']").focus()
        for key in ("ArrowUp", "ArrowDown", "ArrowUp"):
            page.keyboard.press(key)
            page.wait_for_timeout(300)
            expect(page.locator(f"[data-set='{name}']:focus")).to_have_count(1)
    press(page, "New")
    expect(output := page.locator(".controls output")).to_have_text("0 of 0")
    page.locator("#panel").focus()
    page.keyboard.press(" ")
    expect(output).to_have_text("1 of 1")
    open_tool(page, "Compare")
    choose(page, "policy-0", "you")
    expect(page.locator(".tool")).to_contain_text("Find a duel: choose two agents, because")
    expect(page.locator("[data-ask*=duel]")).to_have_count(0)
    expect(page.locator(".tool table")).to_contain_text("0, in the air")


def test_a_tool_that_was_chosen_by_keys_is_flown_by_keys(page):
    output = page.locator(".controls output")
    for key in ("Enter", "ArrowUp"):  # after Enter or the first key that steers, all arrows steer
        open_tool(page, "Compare")
        page.get_by_role("tab", name="Compare").focus()
        page.keyboard.press("ArrowLeft")
        page.locator(".main[data-shows='fly']").wait_for()
        count = int(output.inner_text().split()[0]) + (key != "Enter")
        page.keyboard.press(key)
        expect(output).to_have_text(f"{count} of {count}")
        page.keyboard.press("ArrowRight")
        expect(output).to_have_text(f"{count + 1} of {count + 1}")
    page.get_by_role("tab", name="Fly").focus()
    for key, title in (("End", "Watch"), ("Home", "Fly")):
        page.keyboard.press(key)
        expect(page.get_by_role("tab", selected=True)).to_have_text(title)
    for title, key in product(TOOLS, ("Enter", "ArrowDown")):  # to its panel, and no move is flown
        open_tool(page, title)
        page.get_by_role("tab", name=title).press(key)
        expect(page.locator("#panel:focus")).to_have_count(1)


def test_the_map_and_the_curves_are_one_tab_stop_each_and_obey_the_arrows(page):
    choose(page, "city", "empty 8 × 8")
    open_tool(page, "Paint")
    page.locator(".map svg").focus()
    keys = ["ArrowDown"] * 7 + ["ArrowRight"] * 7 + [" ", "ArrowLeft", "ArrowUp", " "]
    for key in keys:
        page.keyboard.press(key)
        page.wait_for_timeout(60)
    expect(page.locator(".map .kind-B").first).to_have_attribute(
        "d", re.compile(r"M5.5 5.5\S*M6.5 6.5")
    )
    painted = page.locator(".map svg").evaluate(
        """map => {
            map.dispatchEvent(new KeyboardEvent("keydown", { key: " ", bubbles: true }));
            return map.querySelector(".fresh").innerHTML;
        }"""
    )
    assert "M5.5 5.5" in painted  # at once, whatever the session has to do
    expect(page.locator(".map svg:focus")).to_have_count(1)  # though it was drawn anew
    expect(page.locator(".map .cursor")).to_be_visible()
    expect(page.locator(".map .cursor")).to_have_attribute("d", re.compile("M5.5 5.5"))
    page.keyboard.press("Tab")
    thing = page.locator(".map g:focus").get_attribute("aria-label")
    here = page.locator(".here")
    expect(here).to_contain_text(re.search(r"row \d+, column \d+", thing)[0].capitalize())
    page.locator(".swatch").first.focus()
    expect(here).not_to_contain_text("Row")  # nor a shadow of a cell that was left
    expect(page.locator(".map .shadow.live")).to_have_attribute("d", "")
    page.locator(".map svg").focus()
    open_tool(page, "Channel")
    page.locator(".map svg").focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator(".sentence")).to_contain_text("Row 5, column 6")
    page.locator(".ledger .term").first.focus()
    expect(page.locator(".sentence")).to_contain_text("Row 5, column 6")  # the last one stays
    shown = page.locator(".ledger td").all_inner_texts()
    begin, loss, walls, snr = (float(each.split()[0].replace("−", "-")) for each in shown[:4])
    assert round(begin + loss + walls, 1) == snr  # as they are shown
    expect(page.locator(".ledger .term:focus")).to_have_count(1)
    page.locator(".map svg").focus()
    for key, held, there in (("Enter", 1, 6), ("ArrowLeft", 1, 6), ("Escape", 0, 5)):
        page.keyboard.press(key)
        expect(page.locator(".map .held")).to_have_count(held)
        expect(page.locator(".sentence")).to_contain_text(f"Row 5, column {there}")
    page.locator(".map g[data-device='1']").focus()
    page.keyboard.press("Enter")
    expect(page.locator(".sentence")).to_contain_text("device 1")
    open_tool(page, "Watch")
    assert (
        page.locator(".tool").evaluate("each => each.querySelectorAll('.curves [tabindex]').length")
        == 0
    )
    page.locator(".curves").focus()
    keys = {"ArrowRight": "blue's agent after 0", "ArrowDown": "orange's agent after 0"}
    for key, said in keys.items():
        page.keyboard.press(key)
        expect(page.locator(".flies")).to_contain_text(said)
        expect(page.locator(".curves:focus")).to_have_count(1)
    page.keyboard.press("End")
    expect(page.locator(".orange .dot").last).to_have_class("dot on")
    expect(page.locator("[data-set='city']")).to_have_value("village")


def test_a_point_of_a_race_is_pressed_and_two_other_runs_race(page):
    open_tool(page, "Watch")
    expect(page.locator("div:has(> .curves) + p")).to_contain_text("Press near a point")
    expect(page.locator(".flies")).to_contain_text("in the village; until then the map shows your")
    page.set_viewport_size({"width": 390, "height": 844})
    box = page.locator(".blue .dot").last.bounding_box()
    page.locator(".controls select").evaluate("each => { each.value = 0.25; }")
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 15)  # below it
    expect(page.locator(".play")).to_have_text("Pause")  # its flight plays,
    assert abs(page.locator(".blue .dot").last.bounding_box()["y"] - box["y"]) < 2  # no curve moves
    page.locator(".controls select").evaluate("each => { each.value = 1; }")
    flies = re.compile(
        "This flight: blue's agent after.* Over 100 missions.*↶ brings your mission", re.S
    )
    expect(page.locator(".flies")).to_contain_text(flies)
    page.set_viewport_size({"width": 1366, "height": 850})
    assert visible(page, ".flies")
    for named in page.locator(".verdict button").all():  # a point that a sentence names
        steps = named.inner_text()
        named.click()
        expect(page.locator(".dot.on title")).to_contain_text(f"after {steps} steps")
    for one, other in (("run-0", "run-1"), ("run-1", "run-0")):  # none races itself
        chosen = page.locator(f"[data-set='{one}']").input_value()
        expect(page.locator(f"[data-set='{other}'] option[value='{chosen}']")).to_have_count(0)
    title = page.locator("[data-set='run-1'] option").last.inner_text()
    page.locator("[data-set='run-1']").select_option(label=title)
    expect(page.locator(".orange .dot title").first).to_contain_text(title)
    page.locator("[data-set='run-1']").select_option("")
    expect(page.locator(".orange .dot")).to_have_count(0)
    choose(page, "run-1", "1")


def paint_a_wall(page):
    """In an empty city, with one stroke."""
    choose(page, "city", "empty 8 × 8")
    open_tool(page, "Paint")
    page.get_by_role("button", name="tall building").click()
    page.mouse.move(*place(page, 4, 3))
    page.mouse.down()
    page.mouse.move(*place(page, 4, 6), steps=9)
    page.mouse.up()


def expect_the_wall(page):
    expect(page.locator(".map .kind-B").first).to_have_attribute(
        "d", re.compile("M2.5 3.5.*M5.5 3.5")
    )


def test_a_city_is_painted_and_its_shadow_follows_the_pointer(page):
    paint_a_wall(page)
    expect_the_wall(page)
    row, col = map(
        int,
        re.findall(r"\d+", page.locator(".map g[data-device='0']").get_attribute("aria-label"))[
            1:3
        ],
    )
    page.mouse.move(*place(page, row, col))
    expect(page.locator(".tool p").first).to_contain_text("Low buildings cast one, too")
    full = page.locator(".bar > :last-child").first.inner_text().split()[-1]
    expect(page.locator(".here")).to_contain_text(f"device 0, {full} units left")  # none is flown
    page.mouse.move(*place(page, 6, 4))
    expect(page.locator(".map .shadow.live")).to_have_attribute("d", re.compile("M3.5 2.5"))
    page.mouse.move(*(page.locator(".tool p").first.bounding_box()[each] + 5 for each in "xy"))
    expect(page.locator(".map .shadow.live")).to_have_attribute("d", "")  # no pointer is there
    page.mouse.click(*place(page, row, col))
    expect(page.locator(".refusal")).to_contain_text("Not painted: device 0 is there.")
    page.set_viewport_size({"width": 390, "height": 844})
    swatches = page.locator(".swatches").bounding_box()
    page.locator(".map g[data-device='-1']").focus()
    for _ in range(2):
        page.keyboard.press("ArrowDown")
        page.wait_for_timeout(200)
    expect(page.locator(".warning")).to_contain_text("outside the landing zone")
    assert visible(page, ".warning")  # though the palette is long,
    assert page.locator(".swatches").bounding_box() == swatches  # which does not jump
    page.set_viewport_size({"width": 683, "height": 425})
    assert visible(page, ".warning")


def test_a_real_place_is_chosen_and_flown_by_its_table(page):
    choose(page, "city", "munich")
    expect(page.locator(".place")).to_contain_text("© OpenStreetMap contributors, ODbL")
    shadow, model = (
        page.locator(".legend span", has_text="shadow"),
        "by the model, not by the traced",
    )
    expect(shadow).to_contain_text(model)
    open_tool(page, "Think")
    page.get_by_role("slider", name="step").fill("10")
    expect(
        page.get_by_text(re.compile(r"^Violet: hidden from device \d, by the model\.$"))
    ).to_be_visible()
    open_tool(page, "Channel")
    expect(page.locator(".ledger")).to_contain_text("in flights, from traced rays")
    both = re.compile(
        r"in the model [\d.]+ units a slot.*; in flights here, by traced rays, [\d.]+\."
    )
    expect(page.locator(".sentence")).to_contain_text(both)
    open_tool(page, "Fly")
    for key in ("ArrowLeft", "ArrowUp", "ArrowUp"):
        page.keyboard.press(key)
        page.wait_for_timeout(300)
    expect(page.locator(".tool h2")).to_contain_text("17 units of time left")
    content = (data_folder() / "places" / "munich.json").read_text(encoding="utf-8")
    place = json.loads(content)
    halves = np.frombuffer(base64.b64decode(place["gain"]), np.uint8).reshape(256, 256)
    table = np.where(halves == 255, -np.inf, place["level_db"] - halves / 2)
    world = replace(load_place("munich"), mean_snr_db=table)
    flight = HandFlight(world, Mission.draw(find_scenario("any_city"), world.city, 0))
    for action in ("west", "north", "north"):
        flight.step(ACTIONS.index(action))
    left = [f"{each:.1f}" for each in flight.state.data_left[0]]
    shown = re.findall(r"device \d\s+([\d.]+) of", page.locator(".flight").inner_text())
    assert shown == left[: len(shown)] and len(shown) == 5
    choose(page, "city", "village")
    expect(page.locator(".place")).to_have_count(0)
    expect(shadow).not_to_contain_text(model)


def test_what_is_thought_is_shown_step_by_step_and_as_layers(page):
    open_tool(page, "Think")
    press(page, "Closest decision")
    step = shown_step(page)
    expect(page.locator(".says-why")).to_contain_text(f"Next, step {step + 1}: ")
    bars = page.locator(".q u").evaluate_all(
        "all => all.map((each) => parseFloat(each.style.width))"
    )
    texts = page.locator(".q b").all_inner_texts()
    assert bars[texts.index("the best")] == max(bars) == 100  # bars grow with what is good
    page.get_by_role("slider", name="step").press("End")
    bars = page.locator(".q u").evaluate_all(
        "all => all.map((each) => parseFloat(each.style.width))"
    )
    texts = page.locator(".q b").all_inner_texts()
    less = [
        float(re.search(r"[\d.]+|the best", each)[0].replace("the best", "0")) for each in texts
    ]
    both = sorted(zip(less, bars, strict=True))
    assert [bar for _, bar in both] == sorted(bars, reverse=True)
    assert bars.count(0) == 1  # only the worst has no bar
    choose(page, "layer", "value")
    expect(page.locator(".layer path")).not_to_have_count(0)
    page.get_by_label("centred").check()
    expect(page.locator(".meaning")).to_contain_text("Pink: outside of the city.")
    page.keyboard.press("End")
    expect(page.locator(".map svg")).to_have_attribute("viewBox", re.compile(" 31 31$"))
    box = list(map(float, page.locator(".map svg").get_attribute("viewBox").split()))
    col, row = map(
        float, re.findall(r"-?[\d.]+", page.locator(".map .uav").get_attribute("transform"))
    )
    assert [box[0] + 31 / 2, box[1] + 31 / 2] == [col, row] and box[2] == 31
    page.get_by_label("centred").uncheck()
    choose(page, "layer", "none")


def test_a_reload_loses_nothing_that_was_done_shortly_before(browser, address):
    with visiting(browser, address) as page:
        slider, output = page.get_by_role("slider", name="step"), page.locator(".controls output")
        caption = page.locator(".caption")

        def reloaded(shown):
            page.reload()
            expect(output).to_have_text(re.compile(rf"^{shown} of "))
            page.wait_for_timeout(200)
            assert shown_step(page) == shown  # and stays there

        caption.wait_for()
        for _ in range(3):
            press(page, "one step forward")
        expect(output).to_have_text(re.compile("^3 of"))
        reloaded(3)
        expect(caption).to_be_visible()
        press(page, "Skip the story")
        last = shown_step(page)
        reloaded(last)
        expect(caption).to_be_hidden()
        expect(page.locator(".undo")).to_be_disabled()  # there is nothing before
        for _ in range(3):
            slider.press("ArrowLeft")
        reloaded(last - 3)
        slider.fill("0")
        press(page, "Play")
        expect(output).to_have_text(re.compile("^([89]|1.) of"))
        played = shown_step(page) - 1  # a step under way is shown as done
        page.reload()
        expect(output).not_to_have_text(re.compile(f"^(0|{last}) of"))
        page.wait_for_timeout(300)
        assert played <= shown_step(page) < last
        open_tool(page, "Fly")
        for _ in range(3):
            page.keyboard.press("ArrowDown")
        reloaded(3)
        paint_a_wall(page)
        page.locator("[data-sign='N']").click()
        page.reload()
        city, undo = page.locator("[data-set='city']"), page.locator(".undo")
        expect(city).to_have_value("my_city")
        expect(page.locator("[data-sign='N']")).to_have_attribute("aria-pressed", "true")
        expect_the_wall(page)
        undo.click()
        expect(city).to_have_value("empty 8 × 8")
        page.locator(".redo").click()
        choose(page, "city", "village")
        expect(city).to_have_value("village")
        page.reload()
        expect(city).to_have_value("village")
        choose(page, "city", "my_city")  # is still in the list
        expect_the_wall(page)
        for there in ("village", "my_city", "empty 8 × 8"):
            undo.click()
            expect(city).to_have_value(there)
        page.reload()
        expect(city).to_have_value("empty 8 × 8")
        field = Mission.draw(find_scenario("open_field"), load_city("open_field"), 0)
        packed = zlib.compress(json.dumps(as_json(field)).encode())
        link = f"#stage={base64.urlsafe_b64encode(packed).decode().rstrip('=')}"
        page.evaluate("link => { location.hash = link; location.reload(); }", link)
        expect(city).to_have_value("open_field")  # not what was there when the page was left


def test_a_link_a_file_and_a_reload_bring_back_a_fresh_page_as_it_is(browser, address, tmp_path):
    permissions = ["clipboard-read", "clipboard-write"]
    with visiting(browser, address, permissions=permissions) as page:
        label = page.locator(".map g[data-device='0']").first
        slider = page.get_by_role("slider", name="step")

        def points():
            return page.locator(".dot.on title").all_text_contents()

        def opened_by_link(step):
            press(page, "Link")
            expect(page.locator(".copy").first).to_have_text("Copied")
            expect(page.locator(".refusal")).to_contain_text("needs this file, too")
            expect(page.locator(".copy").first).to_have_text("Link")
            link = page.evaluate("navigator.clipboard.readText()")
            assert re.search("#stage=.{100}", link), link
            with visiting(browser, link) as other:
                expect(other.locator(".caption")).to_be_hidden()
                expect(other.get_by_role("slider", name="step")).to_have_value(str(step))
                there = other.locator(".map g[data-device='0']").first
                expect(there).to_have_attribute("aria-label", label.get_attribute("aria-label"))
                expect(other.locator(".undo")).to_be_disabled()  # there is nothing before
                expect(other.locator(".dot.on title")).to_have_text(points())
                return other.locator("[aria-selected=true]").inner_text()

        press(page, "Skip the story")
        last = shown_step(page)
        slider.press("ArrowLeft")
        assert opened_by_link(last - 1) == "Compare"  # while the story's 100 missions are flown
        open_tool(page, "Think")
        press(page, "Closest decision")
        step = shown_step(page)
        assert step < last and opened_by_link(step) == "Think"
        choose(page, "layer", "buildings")
        page.get_by_label("centred").check()
        page.reload()
        expect(slider).to_have_value(str(step))
        expect(page.locator("[data-set='layer']")).to_have_value("buildings")
        expect(page.get_by_label("centred")).to_be_checked()
        slider.press("ArrowLeft")
        press(page, "More")
        with page.expect_download() as saved:
            press(page, "Save")
        saved.value.save_as(tmp_path / "stage.json")
        open_tool(page, "Paint")
        page.get_by_label("Open").set_input_files(tmp_path / "stage.json")
        page.locator(".main[data-shows='think']").wait_for()
        expect(slider).to_have_value(str(step - 1))
        open_tool(page, "Watch")
        choose(page, "metric", "landed")
        choose(page, "run-1", "3")
        page.locator(".orange .dot").nth(4).dispatch_event("click")
        page.locator(".orange .dot.on").wait_for()
        slider.press("End")  # its flight plays
        (shown,) = points()
        assert opened_by_link(shown_step(page)) == "Watch"
        page.reload()
        expect(page.locator(".orange .dot.on title")).to_have_text(shown)
        there = page.url
        press(page, "New")
        expect(page.locator(".dot.on")).to_have_count(0)
        page.wait_for_function("url => location.href !== url", arg=there)  # the address follows
        page.go_back()
        expect(page.locator(".orange .dot.on title")).to_have_text(shown)
        expect(page.locator("[data-set='metric']")).to_have_value("landed")
        page.evaluate("() => { navigator.clipboard.write = () => Promise.reject(); }")
        press(page, "Link")
        expect(page.locator(".refusal")).to_contain_text("Not copied")
        expect(page.locator("[data-set='link']")).to_have_value(re.compile("#stage=.{100}"))
    with visiting(browser, address) as page:
        press(page, "Skip the story")
        open_tool(page, "Channel")  # ends the 100 missions
        page.reload()
        page.locator(".main[data-shows='channel']").wait_for()


def test_an_address_opens_the_same_in_another_browser(browser, address, page):
    open_tool(page, "Channel")
    device = page.locator(".map g[data-device='0']")
    old = device.get_attribute("aria-label")
    press(page, "New")
    expect(device).not_to_have_attribute("aria-label", old)
    for count in (1, 0, 1):  # a press holds the cell, another lets it go
        page.mouse.click(*place(page, 15, 15))
        expect(page.locator(".map .held")).to_have_count(count)
    page.mouse.move(*place(page, 3, 3))
    held = re.compile("Row 15, column 15.* Held: press the cell again, or Escape, to let it go")
    expect(page.locator(".sentence")).to_contain_text(held)
    page.wait_for_timeout(600)
    label = page.locator(".map g[data-device='0']").get_attribute("aria-label")
    with visiting(browser, page.url) as other:
        other.locator(".main[data-shows='channel']").wait_for()
        expect(other.locator(".sentence")).to_contain_text("Row 15, column 15")
        expect(other.locator(".map g[data-device='0']")).to_have_attribute("aria-label", label)
        press(other, "More")
        other.locator("[data-set='link']").fill("nothing")
        other.locator("[data-set='link']").press("Enter")
        expect(other.locator(".refusal")).to_contain_text("not a link")
        time = other.locator("[data-field='time']")
        before = time.input_value()
        for wrong in ("", "501", "3.7"):
            time.fill(wrong)
            time.press("Enter")
            said = "the flying time must be a whole number from 1 to 500"
            expect(other.locator(".refusal")).to_contain_text(said)
            expect(time).to_have_value(before)
        time.fill("501")
        time.press("Tab")
        expect(other.locator("[data-field='time']:focus")).to_have_value(before)
        field, notice = (each.bounding_box() for each in (time, other.locator(".refusal")))
        assert 0 <= notice["y"] - field["y"] - field["height"] < 20  # beside it
        for remove in reversed(other.locator(".devices button").all()[1:]):
            remove.press("Enter")
            expect(remove).to_have_count(0)
            expect(other.locator("[data-set='place']:focus")).to_have_count(1)
        there = other.locator("[data-set='link']")
        there.fill(f"“{page.url[:90]} {page.url[90:]}.”")  # as a mail has it
        there.press("Enter")
        expect(other.locator(".map g[data-device='0']")).to_have_attribute("aria-label", label)
        expect(other.locator(".devices button")).not_to_have_count(1)
        expect(other.locator(".drawer")).to_be_hidden()


def test_back_returns_to_the_mission_and_the_tool_before(page):
    label, tab = page.locator(".map g[data-device='0']").first, page.locator("[aria-selected=true]")
    seen = []
    for name in ("New", "New", "Think"):
        open_tool(page, name) if name in TOOLS else press(page, name)
        page.wait_for_timeout(600)  # the address follows
        seen.append((label.get_attribute("aria-label"), tab.inner_text()))
    for way, there in (("back", 1), ("back", 0), ("forward", 1), ("forward", 2)):
        page.evaluate(f"history.{way}()")
        expect(label).to_have_attribute("aria-label", seen[there][0])
        expect(tab).to_have_text(seen[there][1])
    open_tool(page, "Fly")
    for count in (1, 2):
        page.keyboard.press(" ")
        expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
    page.wait_for_timeout(600)
    page.go_back()
    expect(tab).to_have_text("Think")
    open_tool(page, "Fly")  # which has kept the flight
    expect(page.locator(".controls output")).to_have_text("2 of 2")


def test_files_are_saved_opened_and_dropped(page, tmp_path):
    press(page, "More")
    for name in ("Save", "close"):  # the focus is never behind it
        expect(page.locator(".drawer[open]")).to_have_count(1)
        page.locator(".drawer").get_by_role("button", name=name, exact=True).focus()
        page.keyboard.press("Shift+Tab")
    expect(page.locator(".drawer[open]")).to_have_count(0)
    press(page, "More")
    with page.expect_download() as saved:
        press(page, "Save")
    saved.value.save_as(tmp_path / "stage.json")
    assert (
        json.loads((tmp_path / "stage.json").read_text())["mission"]["city"]["name"] == "manhattan"
    )
    with page.expect_file_chooser() as chooser:
        page.get_by_label("Open").click()
    choose(page, "city", "village")  # what is drawn meanwhile leaves the open chooser alone
    expect(page.locator(".map .kind-N").first).to_be_attached()
    page.locator(".map g[data-device='0']").first.wait_for()
    chooser.value.set_files(tmp_path / "stage.json")
    expect(page.locator("[data-set='city']")).to_have_value("manhattan")
    choose(page, "city", "village")
    press(page, "More")
    page.get_by_label("Open").set_input_files(tmp_path / "stage.json")  # at once
    expect(page.locator("[data-set='city']")).to_have_value("manhattan")
    expect(page.locator(".refusal")).to_have_text("stage.json is open.")
    expect(page.locator(".drawer")).to_be_hidden()
    agent = (data_folder() / "checkpoints" / "open_field_ddqn.safetensors").read_bytes()
    page.locator(".main").evaluate(
        """(main, bytes) => { const data = new DataTransfer();
        data.items.add(new File([Uint8Array.from(bytes)], "mine.safetensors"));
        main.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true })); }""",
        list(agent),
    )
    expect(page.locator("[data-set='city']")).to_have_value("open_field")
    expect(page.locator(".flight .name").first).to_have_text("mine")


@pytest.mark.parametrize("size", ["tablet", "phone"])
def test_touch_flies_lands_and_drags(browser, address, size):
    width, height = SIZES[size]
    options = {"viewport": {"width": width, "height": height}, "has_touch": True, "is_mobile": True}
    options["permissions"] = ["clipboard-read", "clipboard-write"]
    with visiting(browser, address, **options) as page:
        page.get_by_role("button", name="Skip the story").tap()
        down = "each => { each.scrollTop = each.scrollHeight; return each.scrollTop; }"
        panel = page.locator("#panel")
        panel.evaluate(down)
        page.get_by_role("tab", name="Channel").tap()
        page.locator(".main[data-shows='channel']").wait_for()
        panel.evaluate(down)
        page.touchscreen.tap(*place(page, 8, 8))
        said = re.compile(r"(from|of) device 0\b.*Row 8, column 8")
        expect(page.locator(".sentence")).to_contain_text(said)
        assert panel.evaluate("each => each.scrollTop") == 0 and visible(page, ".sentence")
        assert size != "phone" or panel.evaluate(down) > 0  # else it would not be seen anyway
        touch, label = page.context.new_cdp_session(page), page.locator(".map g[data-device='0']")
        row, col = map(int, re.findall(r"\d+", label.get_attribute("aria-label"))[1:3])
        page.get_by_role("tab", name="Compare").tap()
        page.locator(".main[data-shows='compare']").wait_for()
        x, y = place(page, row, col)
        for kind, there in (
            ("Start", (x + 13, y - 13)),
            ("Move", place(page, 6, 4)),
            ("End", None),
        ):
            points = [dict(zip("xy", there, strict=True))] if there else []
            touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})
            page.wait_for_timeout(60)  # a faster finger flings
        expect(label.first).to_have_attribute("aria-label", re.compile("row 6, column 4;"))
        page.get_by_role("tab", name="Fly").tap()
        page.locator(".main[data-shows='fly']").wait_for()
        page.wait_for_timeout(200)
        assert panel.evaluate("each => each.scrollTop") == 0
        pad = page.locator(".pad").bounding_box()
        for action, count in (("hover", 1), ("north", 2), ("south", 3)):
            page.locator(f".pad .{action}").tap()
            expect(page.locator(".controls output")).to_have_text(f"{count} of {count}")
            expect(page.locator(".no")).to_have_text(
                re.compile("Refused" if action == "north" else "^$")
            )
            assert page.locator(".pad").bounding_box() == pad  # it does not jump
        word = page.locator(".term").first
        word.tap()
        expect(word).to_be_focused()
        page.locator(".pad .land").tap()
        expect(page.locator(".card")).to_contain_text("You landed")
        assert page.locator(".pad").bounding_box() == pad
        page.get_by_role("button", name="Again").tap()
        expect(page.locator(".controls output")).to_have_text("0 of 0")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        page.get_by_role("button", name="More").tap()
        page.get_by_role("button", name="Copy the link").tap()
        expect(page.locator(".refusal")).to_contain_text("needs this file, too")
        assert visible(page, ".refusal")


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
        frame.get_by_role("button", name="Skip the story").click(timeout=SLOW)
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
    press(page, "Skip the story")
    open_tool(page, "Think")
    expect(page.locator(".q u")).not_to_have_count(0)
    page.close()
