"""The book of the notebooks: complete, without warnings, and readable without a network."""

import html
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

for package in ("furo", "myst_nb", "sphinx-mathjax-offline"):
    pytest.importorskip(package)

SOURCE = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(SOURCE.glob("[0-9][0-9]_*.ipynb"))
REMOTE = r'<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)="(?:https?:)?//[^"]*"'


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    folder = tmp_path_factory.mktemp("build") / "book"
    subprocess.run([sys.executable, "-m", "sphinx", "-q", "-W", SOURCE, folder], check=True)
    return folder


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_notebook_has_its_page(book, path):
    page = (book / f"{path.stem}.html").read_text()
    cells = nbformat.read(path, as_version=4).cells
    title = cells[0].source.splitlines()[0].removeprefix("# ")
    assert f"<h1>{html.escape(title)}<" in page
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert page.count("<img ") >= sum("image/png" in each.get("data", {}) for each in outputs)
    formulae = any("$$" in cell.source for cell in cells if cell.cell_type == "markdown")
    assert ('<div class="math' in page) >= formulae
    assert "Box(children=" not in page  # a widget's text, where no kernel can show it


def test_the_landing_page_leads_to_every_notebook(book):
    table = re.search(r"<table.*?</table>", (book / "index.html").read_text(), re.DOTALL).group()
    links = re.findall(r'href="(\w+)\.html"', table)
    assert links == [path.stem for path in NOTEBOOKS]


def test_search_knows_every_notebook(book):
    index = (book / "searchindex.js").read_text()
    assert (book / "search.html").exists()
    assert all(f'"{path.stem}"' in index for path in NOTEBOOKS)


def test_nothing_is_loaded_from_elsewhere(book):
    pages = [path.read_text() for path in book.glob("*.html")]
    assert [tag for page in pages for tag in re.findall(REMOTE, page)] == []
    styles = "".join(path.read_text() for path in book.rglob("*.css"))
    assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", styles)
    scripts = set(re.findall(r'<script[^>]* src="([^"?]*)', "".join(pages)))
    assert "_static/tex-svg-full.js" in scripts
    assert all((book / script).exists() for script in scripts)
