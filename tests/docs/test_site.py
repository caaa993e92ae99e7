"""The site: complete, without warnings, with links that lead somewhere, and read without a network.

It is built once, for all tests of this file.
"""

import pkgutil
import re
import subprocess
import sys
from dataclasses import fields
from functools import cache, partial
from html import escape, unescape
from pathlib import Path
from urllib.parse import unquote, urlsplit

import handout
import nbformat
import pytest
from axe_playwright_python.sync_playwright import Axe

import uavdh_lite
from uavdh_lite import registry
from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.cli.main import COMMANDS

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "notebooks"
NOTEBOOKS = sorted(SOURCE.glob("[0-9][0-9]_*.ipynb"))
EXERCISES = sorted(SOURCE.glob("exercises/*/*.ipynb"))
REMOTE = r'<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)="(?:https?:)?//'
REMOTE_IN_STYLES = r"(?:url\(|@import)\s*[\"']?(?:https?:)?//"


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    themes = "furo", "myst_nb", "sphinx_design", "sphinx-mathjax-offline"
    for package in (*themes, "gymnasium", "ipywidgets", "psutil"):  # modules import the latter
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("build") / "site"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", folder]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return folder


def text_of(path: Path) -> str:
    return unescape(re.sub(r"<[^>]+>", "", path.read_text(encoding="utf-8")))


@cache
def anchors_of(path: Path) -> set[str]:
    return set(re.findall(r'\sid="([^"]+)"', path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", NOTEBOOKS + EXERCISES, ids=lambda path: path.stem)
def test_every_notebook_has_its_page(site, path):
    file = site / "tutorials" / path.relative_to(SOURCE).with_suffix(".html")
    page = file.read_text(encoding="utf-8")
    cells = nbformat.read(path, as_version=4).cells
    assert f"<h1>{escape(cells[0].source.splitlines()[0].removeprefix('# '))}<" in page
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert page.count("<img ") >= sum("image/png" in each.get("data", {}) for each in outputs)
    assert "Box(children=" not in page  # a widget's text, where no kernel can show it


def test_the_tutorials_page_leads_to_every_notebook(site):
    page = (site / "tutorials" / "index.html").read_text(encoding="utf-8")
    tables = "".join(re.findall(r"<table.*?</table>", page, re.DOTALL))  # one for each track
    assert re.findall(r'href="(\d\w+)\.html"', tables) == [path.stem for path in NOTEBOOKS]


def test_every_public_module_is_in_the_reference(site):
    anchors = set().union(*map(anchors_of, (site / "reference" / "api").glob("*.html")))
    modules = pkgutil.walk_packages(uavdh_lite.__path__, "uavdh_lite.")
    names = {f"module-{each.name}" for each in modules if "._" not in each.name}
    names = {name for name in names if ".checks.notebook_" not in name}  # they hold the solutions
    assert names - anchors == set()


def test_the_tables_of_recipes_and_commands_are_complete(site):
    recipes = text_of(site / "reference" / "recipes.html")
    named = {*registry.names("recipe"), *registry.names("scenario")}
    named |= {each.name for each in fields(BeyondRecipe) if "help" in each.metadata}
    assert named <= set(re.findall(r"\w+", recipes))
    commands = text_of(site / "reference" / "command_line.html")
    assert all(f"Usage: uavdh_lite {name}" in commands for name in COMMANDS)
    assert "Usage: uavdh_lite challenge score" in commands and "--crash-reward-growth" in commands


def test_links_lead_somewhere(site):
    broken = []
    for path in sorted(site.rglob("*.html")):
        for link in re.findall(r'\s(?:href|src)="([^"]+)"', path.read_text(encoding="utf-8")):
            parts = urlsplit(unescape(link))
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if parts.scheme or parts.netloc:
                found = re.match(r"https?://[\w.-]+\.\w+(:\d+)?(/|$)|mailto:\S+@|data:", link)
            elif parts.fragment and target.suffix == ".html":
                found = target.exists() and unquote(parts.fragment) in anchors_of(target)
            else:
                found = target.exists()
            broken += [] if found else [(path.name, link)]
    assert broken == []


def test_links_in_the_repository_lead_somewhere():
    """Those of Markdown files that are read where they lie, such as the README."""
    for path in (*ROOT.glob("*.md"), *(ROOT / "data").rglob("*.md")):
        for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
            parts = urlsplit(link)
            assert parts.scheme or (path.parent / unquote(parts.path)).exists(), (path.name, link)


def test_nothing_is_loaded_from_elsewhere(site):
    for pattern, remote in (("*.html", REMOTE), ("*.css", REMOTE_IN_STYLES)):
        for path in site.rglob(pattern):
            assert not re.search(remote, path.read_text(encoding="utf-8")), path
    assert (site / "_static" / "tex-svg-full.js").exists()


def test_what_students_get_holds_no_solutions(site, tmp_path):
    """Neither the sources of the course, nor the teaching guide, nor an answer in a how-to.

    What is handed out beside the site has no answers either.
    """
    assert not (site / "teach").exists()
    sources = site / "_modules"
    assert (sources / "uavdh_lite" / "environment.html").exists()
    assert not list((sources / "uavdh_lite").glob("course*"))
    assert "uavdh_lite.course" not in (sources / "index.html").read_text(encoding="utf-8")
    search = (site / "searchindex.js").read_text(encoding="utf-8")
    for word in ("teach/", "marking scheme", "checks/notebook_", "course.checks.notebook_"):
        assert word not in search.lower(), word
    scripts = "".join(path.read_text() for path in (SOURCE / "scripts" / "exercises").glob("*.py"))
    mark = re.compile(r"### BEGIN SOLUTION(.*?)### END", re.DOTALL)
    squeezed = partial(re.sub, r"\s+", "")
    # An exercise of a chain shows the answer of the last one, folded in a cell of text
    given = squeezed(re.sub(r"(?m)^# ?", "", mark.sub("", scripts)))
    answers = [answer for answer in map(squeezed, mark.findall(scripts)) if answer not in given]
    taught = (site / "tutorials", *(site / "_modules").rglob("*"), site / "_modules")
    pages = [p for p in site.rglob("*.html") if p.parent not in taught]  # notebooks and the library
    handout.copy_sheets(tmp_path)
    sheets = [path for path in tmp_path.rglob("*.ipynb") if path.parent.name != "notebooks"]
    assert len(sheets) == len(EXERCISES) + 3
    for path in (*pages, *sheets):
        cells = nbformat.read(path, as_version=4).cells if path in sheets else ()
        text = squeezed("".join(cell.source for cell in cells) or text_of(path))
        assert "notebooks/solutions" not in text
        shown = [answer for answer in answers if len(answer) > 30 and answer in text]
        assert not shown, (path, shown)
    assert len(answers) > 25 and len(pages) > 20


def test_no_barriers_in_light_and_dark(site, browser):
    """Nothing serious; in the dark, the colours alone are others."""
    told = []
    for scheme, rules in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
        page = browser.new_page(color_scheme=scheme, viewport={"width": 1500, "height": 900})
        for name in ("index", "results/ladder", "results/gallery", "tutorials/00_first_flight"):
            page.goto((site / f"{name}.html").as_uri())
            found = Axe().run(page, options={"resultTypes": ["violations"], **rules})
            for v in found.response["violations"]:
                if v["impact"] in ("serious", "critical"):
                    told.append((scheme, name, v["id"], [n["target"] for n in v["nodes"]][:5]))
        page.close()
    assert told == []


def test_no_table_of_the_results_is_wider_than_1100_pixels(site, browser):
    page, wide = browser.new_page(viewport={"width": 1500, "height": 900}), []
    for path in sorted((site / "results").glob("*.html")):
        page.goto(path.as_uri())
        page.evaluate("document.querySelectorAll('details').forEach((each) => (each.open = true))")
        widths = page.locator("table").evaluate_all("all => all.map((each) => each.scrollWidth)")
        wide += [(path.stem, width) for width in widths if width > 1100]
    page.close()
    assert wide == []


@pytest.mark.longest
def test_the_article_is_made(tmp_path):
    command = [sys.executable, "docs/article.py", tmp_path]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    page = (tmp_path / "article.html").read_text(encoding="utf-8")
    assert "<h1>Which of the paper" in page and "verdict" in page
    assert all((tmp_path / name).exists() for name in re.findall('<img[^>]* src="([^"]+)"', page))


@pytest.mark.longest
def test_the_site_for_teachers_has_the_guide(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-t", "teachers", "docs", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    for name in ("index", "class", "kit", "add_an_exercise"):
        assert (tmp_path / "teach" / f"{name}.html").exists()
    assert "three of flight B" in text_of(
        tmp_path / "_modules" / "uavdh_lite" / "course" / "checks" / "notebook_03.html"
    )
