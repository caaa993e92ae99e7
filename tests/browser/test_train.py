"""Train in a browser: a run begins, dials turn while it learns, its agent flies and is saved."""

import re

import pytest
from playwright.sync_api import expect

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_city
from uavdh_lite.evaluation import evaluate
from uavdh_lite.labs.page import write_page

SLOW = 120_000  # ms


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    """The page, in Train; it has no errors."""
    file, trouble = tmp_path_factory.mktemp("page") / "labs.html", []
    write_page(file)
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(SLOW)
    expect.set_options(timeout=SLOW)
    page.on("console", lambda message: trouble.append(message.text))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.goto(file.as_uri())
    page.get_by_role("tab", name="Train").click()
    yield page
    page.close()
    assert trouble == []


def press(page, name):
    page.locator(".bench").get_by_role("button", name=name, exact=True).click()


def turn(page, dial, stop):
    """Turns a dial to its stop of a number."""
    dial = page.get_by_role("slider", name=re.compile(f"^{re.escape(dial)}"))
    dial.evaluate(
        """(dial, stop) => {
            dial.value = stop;
            dial.dispatchEvent(new InputEvent("input", { bubbles: true }));
        }""",
        stop,
    )


def steps(page, run=0):
    """How far a run has come."""
    return int(page.locator(".run b").nth(run).inner_text().replace(",", ""))


def points(page):
    """Of the first curve."""
    return len(page.locator(".graph .blue.curve").first.get_attribute("d").split("L"))


def until(page, holds):
    """Waits; a page with a content security policy waits for no condition by itself."""
    for _ in range(SLOW // 200):
        if holds():
            return
        page.wait_for_timeout(200)
    raise AssertionError("it never came")


def test_it_learns_while_one_looks_and_python_loads_what_it_learned(page, tmp_path):
    turn(page, "steps", 0)  # over manhattan, which is too large: the village
    expect(page.locator("[data-set=city]")).to_have_value("village")
    expect(page.locator(".word")).to_contain_text("too large")
    until(page, lambda: steps(page) == 0)
    press(page, "Learn")
    until(page, lambda: points(page) > 3)
    expect(page.locator(".map .values path")).to_have_count(52)  # where the UAV may fly
    before = page.locator(".map .values").inner_html()
    until(page, lambda: steps(page) > 4000)
    assert page.locator(".map .values").inner_html() != before
    page.get_by_role("slider", name="learning rate").press("Home")
    expect(page.locator("label", has_text="learning rate").locator("output")).to_have_text("0.0001")
    until(page, lambda: steps(page) == 6000)
    expect(page.get_by_role("button", name="Learn", exact=True)).to_be_visible()
    with page.expect_download() as saved:
        press(page, "Save")
    file = tmp_path / saved.value.suggested_filename
    saved.value.save_as(file)
    agent = load_agent(file)
    assert agent.trained_in[0].text == load_city("village").text
    assert agent.recipe.learning_rate == 0.0001 and agent.training["steps"] == 6000
    assert agent.training["turned"][-1][1] == {"learning_rate": 0.0001}
    flights = evaluate(agent.environment, agent, agent.scenario, 100, seed=0)
    page.get_by_role("tab", name="Compare").click()
    page.locator("[data-set='policy-0']").select_option("your agent")
    expect(page.locator("[data-set='policy-0']")).to_have_value(re.compile("^your agent "))
    expect(page.locator(".refusal")).to_be_empty()
    page.get_by_role("tab", name="Train").click()
    shown = int(re.search(r"landed\s+(\d+) %", page.locator(".graphs").inner_text())[1])
    assert flights.metrics()["landed"].mean == pytest.approx(shown / 100, abs=0.3)


def test_another_network_begins_anew_and_a_second_run_says_how_it_differs(page):
    turn(page, "layer norm", 1)
    expect(page.locator(".word")).to_contain_text("New run")
    until(page, lambda: steps(page) == 0)
    assert page.locator(".graph .past").count() == 4
    press(page, "Step")
    until(page, lambda: steps(page) == 16)

    press(page, "Two runs")
    turn(page, "map", 0)  # begins anew, and goes on
    expect(page.locator(".run.orange small")).to_have_text("map in place")
    until(page, lambda: steps(page, 1) > 0)
    press(page, "Stop")
    expect(page.locator(".bench").get_by_role("button", name="Learn")).to_be_visible()
    press(page, "frozen target")
    expect(page.locator(".run.orange small")).to_have_text("target rate τ frozen")
    until(page, lambda: steps(page) > 0)
    assert len(re.findall(r"[^\W\d_]+", page.locator(".tool").inner_text())) <= 60
    press(page, "Stop")
    page.get_by_role("tab", name="Compare").click()
    both = page.locator("[data-set='policy-0'] option", has_text="your")
    expect(both).to_have_text(["your agent", "your second agent"])
    page.get_by_role("tab", name="Train").click()
    press(page, "One run")
    expect(page.locator(".run")).to_have_count(1)
    page.locator("[data-set=city]").select_option("empty 8 × 8")
    press(page, "Two runs")  # over one city, which is not shown
    turn(page, "layer norm", 1)
    expect(page.locator(".run.blue small")).to_have_text("over village")
    expect(page.locator(".run.orange small")).to_have_text("over village, layer norm on")
    press(page, "Restart")  # over the one that is
    expect(page.locator(".run.blue small")).to_be_empty()
    expect(page.locator(".graph .past")).to_have_count(0)
