"""Flights played in a real browser; pictures in build/screenshots."""

import io
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops
from playwright.sync_api import expect, sync_playwright

from uavdh_lite.environment import HOVER
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.scenario import SCENARIOS

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SCREENSHOTS = Path(__file__).parents[2] / "build" / "screenshots"
WAIT = 60_000  # milliseconds; only a page that never answers takes so long

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium: install it, or name one in CHROMIUM"
)


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def flights():
    """An environment, a flight that lands, and one of the same mission that hovers and crashes."""
    environment = environment_of("village")
    mission = Mission.draw(SCENARIOS["village"], environment.city, 0)
    mission = mission.add((7, 0), 4.0)
    hover = [lambda state: np.full(len(state), HOVER)]
    return environment, *(
        mission.fly(environment, policy).trajectory(0) for policy in (Greedy(environment), *hover)
    )


@pytest.fixture
def player(flights):
    return play(*flights[:2])


@pytest.fixture
def show(browser, tmp_path):
    """A function that opens a page with players, as a file; it loads nothing and has no errors."""
    contexts, trouble = [], []

    def note(condition, text):
        if condition:
            trouble.append(text)

    def show(*players, **options):
        context = browser.new_context(**{"viewport": {"width": 1200, "height": 800}} | options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(WAIT)
        expect.set_options(timeout=WAIT)
        file = tmp_path / f"{len(contexts)}.html"
        page.on("request", lambda r: note(r.url != file.as_uri() and r.url[:5] != "data:", r.url))
        page.on("console", lambda m: note(m.type in ("error", "warning"), m.text))
        page.on("pageerror", lambda error: note(True, str(error)))
        players[0].save(file)
        if len(players) > 1:
            more = "".join(each.html for each in players[1:])
            text = file.read_text(encoding="utf-8").replace("</body>", f"{more}</body>")
            file.write_text(text, encoding="utf-8")
        page.goto(file.as_uri())
        return page

    yield show
    for context in contexts:
        context.close()
    assert trouble == []


def shoot(page, name):
    """Keep a picture for people to look at."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENSHOTS / f"player_{name}.png", full_page=True)


def picture(locator):
    return Image.open(io.BytesIO(locator.screenshot())).convert("RGB")


def slider(root):
    return root.get_by_role("slider", name="step")


def step(root):
    return float(slider(root).input_value())


def numbers(root):
    """What the bars say is left, and how long they are compared with what there was."""
    texts = root.locator(".left").all_inner_texts()
    bars = root.locator(".track").all()
    length = "e => e.firstChild.getBoundingClientRect().width / e.getBoundingClientRect().width"
    return [float(text) for text in texts], [bar.evaluate(length) for bar in bars]


def place(root):
    """Column and row of the UAV."""
    moved = root.locator("[data-uav]").first.get_attribute("transform")
    return [float(number) for number in re.findall(r"-?[\d.]+", moved)]


def left(trajectory, time):
    used = trajectory.data_left[0] > 0
    return np.append(trajectory.data_left[time, used], trajectory.time_left[time])


def test_it_plays_smoothly_to_the_end_and_starts_again(show, player, flights):
    page, trajectory = show(player), flights[1]
    last = len(trajectory.action)
    assert step(page) == last and numbers(page)[0] == [
        pytest.approx(value, abs=0.051) for value in left(trajectory, last)
    ]
    page.clock.install(time=0)
    page.clock.pause_at(1000)  # from here on, time passes only as told
    page.get_by_role("button", name="Play").click()
    page.clock.run_for(50)
    assert step(page) < last
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    places = []
    while page.locator(".play").inner_text() == "Pause" and len(places) < 100 * last:
        page.clock.run_for(50)  # 20 frames a second
        places.append(place(page))
    between = [each for each in places if not all(value.is_integer() for value in each)]
    assert len(between) > last  # seen between cells, more often than in them
    assert step(page) == last
    expect(page.locator(".says")).to_have_text(player.endings[0])
    page.get_by_role("button", name="Play").click()
    page.clock.run_for(50)
    assert step(page) < last


def test_speed_changes_how_far_it_gets(show, player):
    page = show(player)
    reached = """(speed) => new Promise((done) => {
      const find = (selector) => document.querySelector(selector);
      const [select, play, input] = ["select", ".play", "input"].map(find);
      select.value = speed;
      input.value = 0;
      input.dispatchEvent(new Event("input"));
      play.click();
      let frames = 0, start;
      const look = (now) => {
        start ??= now;
        if (++frames < 6) return requestAnimationFrame(look);
        play.click();
        done(input.value / (now - start));
      };
      requestAnimationFrame(look);
    })"""
    slow, fast = (page.evaluate(reached, speed) for speed in ("0.25", "4"))
    assert 0 < 4 * slow < fast  # sixteen times, but for the first frame


def test_every_step_shows_its_data(show, player, flights):
    page, (environment, trajectory, _) = show(player), flights
    uploads = trajectory.data_left[:-1] - trajectory.data_left[1:]
    devices = np.flatnonzero(trajectory.data_left[0] > 0)
    widths = {}
    for time in range(len(trajectory.action) + 1):
        slider(page).fill(str(time))
        texts, lengths = numbers(page)
        expected = left(trajectory, time)
        assert texts == [pytest.approx(value, abs=0.051) for value in expected]
        assert lengths == [
            pytest.approx(value, abs=0.02) for value in expected / left(trajectory, 0)
        ]
        row, col = divmod(int(trajectory.uav_cell[time]), environment.city.size)
        assert place(page) == [col, row]
        moves = np.diff(trajectory.uav_cell[: time + 1]) != 0
        assert page.locator("path[data-from][visibility=visible]").count() == moves.sum()
        uploaded = uploads[time - 1] if time else np.zeros_like(uploads[0])
        for k in devices:
            link, shadow = (page.locator(f"[data-{what}='{k}']") for what in ("link", "shadow"))
            served = uploaded[k] > 0
            assert link.get_attribute("visibility") == ("visible" if served else "hidden")
            main = served and uploaded[k] == uploaded.max()
            assert shadow.get_attribute("visibility") == ("visible" if main else "hidden")
            if served:
                ends = [float(link.get_attribute(name)) for name in ("x1", "y1", "x2", "y2")]
                cell = divmod(int(trajectory.start.device_cells[0, k]), environment.city.size)
                assert ends == [cell[1], cell[0], col, row]
                widths[uploaded[k]] = float(link.get_attribute("stroke-width"))
    largest = max(widths)
    assert len(widths) > 3
    for amount, width in widths.items():
        expected = max(amount / largest, 0.05)
        assert width / widths[largest] == pytest.approx(expected, rel=0.01)


def test_keys_step_and_play(show, player, flights):
    page, last = show(player), len(flights[1].action)
    page.locator(".map").click(position={"x": 3, "y": 3})
    for key, expected in (
        ("Home", 0),
        ("ArrowLeft", 0),
        ("ArrowRight", 1),
        ("ArrowRight", 2),
        ("ArrowLeft", 1),
        ("End", last),
        ("ArrowRight", last),
    ):
        page.keyboard.press(key)
        assert step(page) == expected, key
    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Play")).to_be_visible()
    slider(page).focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert step(page) == 1
    text = slider(page).get_attribute("aria-valuetext")
    assert text.startswith(f"step 1 of {last}. Step 1: ")
    page.get_by_role("button", name="one step forward").focus()
    page.keyboard.press(" ")  # presses the button, and does not play
    assert step(page) == 2
    page.get_by_role("button", name="one step back").click()
    assert step(page) == 1
    expect(page.get_by_role("button", name="Play")).to_be_visible()


def test_the_slider_ends_on_a_step(show, player, flights):
    page = show(player)
    box = slider(page).bounding_box()
    page.mouse.move(box["x"] + 0.31 * box["width"], box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.52 * box["width"], box["y"] + box["height"] / 2, steps=7)
    page.mouse.up()
    assert step(page) == int(step(page))
    assert abs(step(page) - 0.52 * len(flights[1].action)) < 1


def shadows(page):
    return page.locator("[data-shadow][visibility=visible]").evaluate_all(
        "all => all.map((each) => each.dataset.shadow)"
    )


def test_pointing_at_a_device_shows_its_shadow(show, player):
    page = show(player)
    assert shadows(page) == []
    page.locator(".bar[data-device='1']").hover()
    assert shadows(page) == ["1"]
    page.locator("svg [data-device='0'] circle").hover(force=True)
    assert shadows(page) == ["0"]
    shoot(page, "shadow")
    page.locator(".legend").hover()
    assert shadows(page) == []
    page.locator(".bar[data-device='0']").focus()
    assert shadows(page) == ["0"]
    page.keyboard.press("Tab")
    assert shadows(page) == ["1"]


def test_touch_plays_and_shows_shadows(show, player):
    page = show(player, has_touch=True, viewport={"width": 390, "height": 900})
    page.locator("svg [data-device='1'] circle").tap(force=True)
    assert shadows(page) == ["1"]
    page.get_by_role("button", name="Play").tap()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    for control in page.locator(".controls :is(button, select, input)").all():
        assert control.bounding_box()["height"] >= 40


def test_two_players_on_a_page_are_independent(show, player):
    page = show(player, player)
    first, second = page.locator(".uavdh-player").all()
    end = numbers(second), place(second), step(second)
    first.get_by_role("button", name="Play").click()
    page.wait_for_timeout(500)
    assert step(first) < end[2] and (numbers(second), place(second), step(second)) == end
    first.get_by_role("button", name="Pause").click()
    now = numbers(first), step(first)
    slider(second).fill("1")
    assert (numbers(first), step(first)) == now and step(second) == 1
    assert page.locator(".controls").count() == 2


def test_flights_side_by_side_share_the_time(show, flights):
    environment, lands, crashes = flights
    page = show(play(environment, {"greedy": lands, "hover": crashes}))
    shoot(page, "end")
    one, other = page.locator(".flight").all()
    assert one.bounding_box()["y"] == other.bounding_box()["y"]
    last = len(crashes.action)
    assert step(page) == last > len(lands.action)
    expect(one.locator(".says")).to_have_text(re.compile("^Landed"))
    expect(other.locator(".says")).to_have_text(re.compile("^Crashed"))
    slider(page).fill("5")
    for flight, trajectory in ((one, lands), (other, crashes)):
        assert numbers(flight)[0][-1] == trajectory.time_left[5]
    counts = other.locator("g[data-from][visibility=visible] text")
    expect(counts).to_have_text(["5×"])
    shoot(page, "five_steps")


def test_without_scripts_the_picture_is_that_of_the_end(show, player):
    still, played = show(player, java_script_enabled=False), show(player)
    assert still.get_by_role("button").count() == still.get_by_role("slider").count() == 0
    image = still.locator(".map img")
    assert image.get_attribute("alt").endswith(player.endings[0])
    expect(still.locator(".says")).to_have_text(player.endings[0])
    shoot(still, "without_scripts")
    one, other = picture(image), picture(played.locator(".map svg"))
    assert one.size == other.size
    assert np.asarray(ImageChops.difference(one, other)).mean() < 0.5
    slider(played).fill("3")
    other = picture(played.locator(".map svg"))
    assert np.asarray(ImageChops.difference(one, other)).mean() > 0.5  # it would be noticed
    for kept, lost in zip(
        *(page.locator(".left").all() for page in (still, show(player))), strict=True
    ):
        assert kept.inner_text() == lost.inner_text()


def test_less_motion_goes_from_cell_to_cell(show, player):
    page = show(player, reduced_motion="reduce")
    page.get_by_role("button", name="Play").click()
    places = page.evaluate("""() => new Promise((done) => {
      const places = [];
      const look = () => {
        places.push(document.querySelector("[data-uav]").getAttribute("transform"));
        places.length < 40 ? requestAnimationFrame(look) : done(places);
      };
      look();
    })""")
    assert len(set(places)) > 1 and not any("." in each for each in places)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_is_readable_on_light_and_dark(show, player, scheme):
    page = show(player, color_scheme=scheme)
    slider(page).fill("4")
    shoot(page, scheme)
    for part in (".says", ".bar .what >> nth=0", ".legend span >> nth=0"):
        grey = np.asarray(picture(page.locator(part)).convert("L"), int)
        paper = np.bincount(grey.ravel()).argmax()
        assert np.abs(grey - paper).max() > 120, part
        assert (paper > 128) == (scheme == "light"), part


@pytest.mark.parametrize("width", [360, 700])
def test_it_fits_narrow_pages(show, flights, width):
    environment, lands, crashes = flights
    page = show(
        play(environment, {"a name that is rather long " * 5: lands, "b": crashes}),
        viewport={"width": width, "height": 800},
    )
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.locator("output").evaluate("each => each.scrollWidth <= each.clientWidth")
    shoot(page, f"{width}")


def test_it_starts_as_notebooks_insert_it(show, player, flights):
    """They set a part of the page, then bring its scripts to life; perhaps more than once."""
    page = show(player)
    page.evaluate(
        """(html) => {
          const root = document.createElement("div");
          root.innerHTML = html;
          document.body.replaceChildren(root);
          for (let time = 0; time < 2; time++) {
            for (const old of root.querySelectorAll("script")) {
              const script = document.createElement("script");
              for (const { name, value } of old.attributes) script.setAttribute(name, value);
              script.textContent = old.textContent;
              old.replaceWith(script);
            }
          }
        }""",
        player.html,
    )
    assert page.locator(".controls").count() == 1
    page.keyboard.press("Tab")
    slider(page).fill("2")
    assert numbers(page)[0][-1] == flights[1].time_left[2]


def test_every_control_has_a_name(show, player):
    nameless = """() => [...document.querySelectorAll("button, input, select")]
      .filter((e) => !e.getAttribute("aria-label") && !e.textContent.trim())
      .map((e) => e.outerHTML)"""
    assert show(player).evaluate(nameless) == []
