"""Flights played in a real browser."""

import numpy as np
import pytest
from playwright.sync_api import expect

from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, Environment
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.missions import Mission
from uavdh_lite.planners import Greedy
from uavdh_lite.player import play
from uavdh_lite.plotting import trajectory_figure
from uavdh_lite.streams import Use, stream


@pytest.fixture(scope="module")
def flights():
    """An environment, a flight that lands, and one of the same mission that hovers and crashes."""
    environment = Environment(City.load("village"))
    devices = [(4, 5), (7, 0)]
    start = Mission(environment.city, (0, 0), devices, [9.0, 4.0], 25, max_devices=2).state
    hover = FunctionPolicy(lambda state: np.full(len(state), HOVER))
    both = (
        fly(environment, policy, start, stream(Use.TEST, 0)).trajectory(0)
        for policy in (Greedy(environment), hover)
    )
    return environment, *both


@pytest.fixture
def show(browser, tmp_path):
    """A function that opens a page with players; it loads nothing and has no errors."""
    file, trouble = tmp_path / "page.html", []

    def show(first, *others, **options):
        page = browser.new_page(**options)
        page.on("request", lambda r: r.url == file.as_uri() or trouble.append(r.url))
        page.on("console", lambda message: trouble.append(message.text))
        page.on("pageerror", lambda error: trouble.append(str(error)))
        first.save(file)
        text = file.read_text(encoding="utf-8")
        more = "".join(each._repr_html_() for each in others)
        file.write_text(text.replace("</body>", f"{more}</body>"), encoding="utf-8")
        page.goto(file.as_uri())
        return page

    yield show
    assert trouble == []


def step(root):
    return int(root.get_by_role("slider", name="step").input_value())


def test_every_step_shows_its_data_and_what_is_served(show, flights):
    environment, trajectory, _ = flights
    page = show(play(environment, trajectory))
    uploads = trajectory.data_left[:-1] - trajectory.data_left[1:]
    for time in range(1, len(trajectory.action)):
        page.get_by_role("slider", name="step").fill(str(time))
        left = [*trajectory.data_left[time], trajectory.time_left[time]]
        texts = page.locator(".bar > :last-child").all_inner_texts()
        assert [float(text.split()[0]) for text in texts] == pytest.approx(left, abs=0.051)
        row, col = divmod(int(trajectory.uav_cell[time]), environment.size)
        assert page.locator(".map .uav").get_attribute("transform") == f"translate({col} {row})"
        moves = np.diff(trajectory.uav_cell[: time + 1]) != 0
        assert page.locator(".map .arrow:visible").count() == moves.sum()
        hidden = page.locator(".link").evaluate_all("all => all.map((e) => e.matches('[hidden]'))")
        assert hidden == (uploads[time - 1] == 0).tolist()
        expect(page.locator(".says")).to_contain_text(f"Step {time}: ")
        violet = f"Violet: hidden from device {uploads[time - 1].argmax()}."
        assert page.locator(".here").inner_text() == (violet if uploads[time - 1].any() else "")


def test_the_legend_has_the_words_of_the_figures(show, flights):
    environment, trajectory, _ = flights
    (legend,) = trajectory_figure(environment, trajectory).legends
    words = {each.get_text() for each in legend.get_texts()}
    entries = show(play(environment, trajectory)).locator(".legend span")
    shown = entries.evaluate_all("all => all.map((each) => each.lastChild.textContent)")
    assert words - set(shown) == {"low building: may be flown over"}  # the village has none
    assert set(shown) < words


def test_it_plays_to_the_end_and_keys_step(show, flights):
    environment, trajectory, _ = flights
    page, last = show(play(environment, trajectory)), len(trajectory.action)
    page.clock.install(time=0)
    page.clock.pause_at(1000)  # from here on, time passes only as told
    page.get_by_role("button", name="Play").click()
    page.clock.run_for(1000)
    assert 2 <= step(page) <= 5  # four steps a second
    page.get_by_role("combobox", name="speed").select_option("4")
    page.clock.run_for(10_000)
    expect(page.locator(".says")).to_contain_text(f"Landed after {last} of 25 units of time")
    page.locator(".map").click(position={"x": 9, "y": 9})
    for key, expected in (("Home", 0), ("ArrowRight", 1), ("ArrowLeft", 0), ("End", last)):
        page.keyboard.press(key)
        assert step(page) == expected, key
    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()


def test_the_pointer_and_the_focus_show_values_and_shadows(show, flights):
    page = show(play(*flights[:2]))
    device = page.locator("svg [data-device='1']")
    device.hover()
    expect(page.locator(".here")).to_contain_text("Row 7, column 0; open ground; device 1, ")
    assert [each.is_visible() for each in page.locator(".map .shadow").all()] == [False, True]
    page.locator(".bar[data-device='0']").focus()
    assert [each.is_visible() for each in page.locator(".map .shadow").all()] == [True, False]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_several_players_on_a_narrow_page(show, flights, scheme):
    environment, lands, crashes = flights
    both = play(environment, {"greedy": lands, 'long "><img src=x> ' * 6: crashes})
    narrow = {"width": 400, "height": 800}
    page = show(play(environment, lands), both, color_scheme=scheme, viewport=narrow)
    first, second = page.locator(".uavdh-player").all()
    assert step(second) == len(crashes.action) > step(first) == len(lands.action)
    second.get_by_role("button", name="one step back").click()
    assert step(second) == len(crashes.action) - 1 and step(first) == len(lands.action)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    paper = page.locator(".paper").first.evaluate("each => getComputedStyle(each).fill")
    assert float(paper.split("(")[1].split()[0]) == (1 if scheme == "light" else 0.2), paper
