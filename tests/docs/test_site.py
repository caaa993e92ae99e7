"""The site: complete, without warnings, with links that lead somewhere, and read without a network.

It is built once, for all tests of this file.
"""

import dataclasses
import html
import pkgutil
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat
import pytest

import uavdh_lite
from uavdh_lite.recipe import RECIPES, Recipe
from uavdh_lite.scenario import SCENARIOS

for package in ("furo", "myst_nb", "sphinx_design", "sphinx-mathjax-offline"):
    pytest.importorskip(package)
for package in ("anywidget", "gymnasium", "ipywidgets", "psutil", "voila"):
    pytest.importorskip(package)  # modules of the reference import them

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
DOCS, SOURCE = ROOT / "docs", ROOT / "notebooks"
NOTEBOOKS = sorted(SOURCE.glob("[0-9][0-9]_*.ipynb"))
EXERCISES = sorted(SOURCE.glob("exercises/*/*.ipynb"))
GUIDES = sorted((DOCS / "how_to").glob("[!i]*.md"))
PAGES = (
    ["index", "search", "teach/index"]
    + [f"project/{path.stem}" for path in (DOCS / "project").glob("*.md")]
    + ["tutorials/index", "tutorials/exercises", "how_to/index", "results/index"]
    + [f"reference/{name}" for name in ("index", "command_line", "files", "recipes", "api/index")]
    + [f"how_to/{path.stem}" for path in GUIDES]
)
REMOTE = r'<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)="(?:https?:)?//[^"]*"'


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("build") / "site"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", DOCS, folder]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return folder


class Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, path: Path):
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if values.get("id"):
            self.anchors.add(values["id"])
        for name in ("href", "src"):
            if values.get(name):
                self.links.append(values[name])


page_of = cache(Page)


def links_in_text(path: Path) -> list[str]:
    """The links of a page without those of its sidebars."""
    page = path.read_text(encoding="utf-8")
    return re.findall(r'href="([^"#]+)', page.partition("<article")[2].partition("</article>")[0])


def text_of(path: Path) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("page", PAGES)
def test_the_page_is_there(site, page):
    assert (site / f"{page}.html").exists()


def test_the_first_page_has_three_doors_and_the_picture(site):
    doors = {"tutorials/index.html", "teach/index.html", "results/index.html"}
    assert doors <= set(links_in_text(site / "index.html"))
    assert "_images/flight.gif" in page_of(site / "index.html").links


@pytest.mark.parametrize("path", NOTEBOOKS + EXERCISES, ids=lambda path: path.stem)
def test_every_notebook_has_its_page(site, path):
    file = site / "tutorials" / path.relative_to(SOURCE).with_suffix(".html")
    page = file.read_text(encoding="utf-8")
    cells = nbformat.read(path, as_version=4).cells
    title = cells[0].source.splitlines()[0].removeprefix("# ")
    assert f"<h1>{html.escape(title)}<" in page
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert page.count("<img ") >= sum("image/png" in each.get("data", {}) for each in outputs)
    formulae = any("$$" in cell.source for cell in cells if cell.cell_type == "markdown")
    assert ('<div class="math' in page) >= formulae
    assert "Box(children=" not in page  # a widget's text, where no kernel can show it


def test_the_tutorials_page_leads_to_every_notebook(site):
    page = (site / "tutorials" / "index.html").read_text(encoding="utf-8")
    table = re.search(r"<table.*?</table>", page, re.DOTALL).group()
    assert re.findall(r'href="(\w+)\.html"', table) == [path.stem for path in NOTEBOOKS]


def test_every_guide_is_listed(site):
    links = links_in_text(site / "how_to" / "index.html")
    assert {f"{path.stem}.html" for path in GUIDES} <= set(links)


def test_every_public_module_is_in_the_reference(site):
    anchors = set()
    for page in (site / "reference" / "api").glob("*.html"):
        anchors |= page_of(page).anchors
    modules = {
        module.name
        for module in pkgutil.walk_packages(uavdh_lite.__path__, "uavdh_lite.")
        if not any(part.startswith("_") for part in module.name.split("."))
    }
    # Packages that hold nothing themselves have no entry.
    modules -= {"uavdh_lite.course", "uavdh_lite.experiments"}
    assert [name for name in sorted(modules) if f"module-{name}" not in anchors] == []


def test_docstrings_are_rendered_as_markdown(site):
    page = (site / "reference" / "api" / "world.html").read_text(encoding="utf-8")
    state = page.partition('id="uavdh_lite.environment.State"')[2]
    state = state.partition('id="uavdh_lite.environment.Outcome"')[0]
    assert "<table" in state and "<td" in state
    text = text_of(site / "reference" / "api" / "world.html")
    assert "| ---" not in text and "`" not in text and "Arguments:" not in text
    assert 'href="#uavdh_lite.environment.Outcome"' in page  # names in code style are links


def rows(page: Path) -> dict[str, list[str]]:
    """The rows of all tables of a page by their first cell."""
    found = re.findall(r"<tr\b.*?</tr>", page.read_text(encoding="utf-8"), re.DOTALL)
    cells = [re.findall(r"<t[dh]\b[^>]*>(.*?)</t[dh]>", row, re.DOTALL) for row in found]
    plain = [[html.unescape(re.sub(r"<[^>]+>", "", c)).strip() for c in row] for row in cells]
    plain = [[text.replace("’", "'") for text in row] for row in plain]  # Sphinx's typography
    return {row[0]: row[1:] for row in plain}


def test_every_recipe_field_is_in_the_table(site):
    table = rows(site / "reference" / "recipes.html")
    assert table["field"][: len(RECIPES)] == list(RECIPES)
    fields = [field for field in dataclasses.fields(Recipe) if "help" in field.metadata]
    assert [field.name for field in fields if field.name not in table] == []
    for field in fields:
        assert table[field.name][len(RECIPES)] == field.metadata["help"]
    lite = list(RECIPES).index("lite")
    assert table["batch_size"][lite] == str(RECIPES["lite"].batch_size)
    assert set(SCENARIOS) <= set(table)


def test_every_command_is_there_with_its_own_help(site):
    page = text_of(site / "reference" / "command_line.html")
    done = subprocess.run(
        [sys.executable, "-m", "uavdh_lite", "--help"], capture_output=True, text=True, check=True
    )
    commands = re.findall(r"^│ ([a-z]+) ", done.stdout, re.M)
    assert len(commands) >= 10
    for command in commands:
        assert f"Usage: uavdh_lite {command}" in page
    assert "Usage: uavdh_lite challenge score" in page and "--crash-reward-growth" in page


def test_no_directive_is_left_as_text(site):
    for page in PAGES:
        text = text_of(site / f"{page}.html")
        assert ":::" not in text and "{generated}" not in text and "{toctree}" not in text, page


def test_search_knows_every_page(site):
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    for page in (*PAGES, *(f"tutorials/{path.stem}" for path in NOTEBOOKS)):
        assert page == "search" or f'"{page}"' in index


def test_links_lead_somewhere(site):
    broken = []
    for path in sorted(site.rglob("*.html")):
        for link in page_of(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                form = r"(https?://[\w.-]+\.\w+(:\d+)?(/\S*)?|mailto:\S+@\S+|data:\S+)$"
                if not re.match(form, link):
                    broken.append((path.name, link))
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                broken.append((path.name, link))
            elif parts.fragment and target.suffix == ".html":
                anchors = page_of(target).anchors
                broken += [(path.name, link)] * (unquote(parts.fragment) not in anchors)
    assert broken == []


def test_links_in_the_repository_lead_somewhere():
    """Those of Markdown files that are read where they lie, such as the README."""
    broken = []
    for path in (*ROOT.glob("*.md"), *(ROOT / "data").rglob("*.md")):
        for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
            parts = urlsplit(link)
            if parts.scheme or not parts.path:
                continue
            if not (path.parent / unquote(parts.path)).exists():
                broken.append((path.relative_to(ROOT).as_posix(), link))
    assert broken == []


def test_nothing_is_loaded_from_elsewhere(site):
    pages = [path.read_text(encoding="utf-8") for path in site.rglob("*.html")]
    assert [tag for page in pages for tag in re.findall(REMOTE, page)] == []
    styles = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", styles)
    assert (site / "_static" / "tex-svg-full.js").exists()
