"""The site: `python -m sphinx -W docs build/site`, without a network or a kernel."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from uavdh_lite.labs.page import write_page

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

project = html_title = "uavdh_lite"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_design",
    "generated",
    "rendering",
]
# The site is for students, unless it is built with `-t teachers`: then it has the teaching guide
# and the sources of the course, whose checks and examples are what the exercises ask for.
TEACHERS = tags.has("teachers")  # noqa: F821 (Sphinx defines it)
exclude_patterns = ["_extensions"] if TEACHERS else ["_extensions", "teach"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!uavdh_lite\b).*"),  # numpy, torch: their sites are elsewhere
    ("py:class", r".*\.Preset"),  # a type variable
    ("py:class", r"uavdh_lite\.cli\.options\.Annotated\[.*"),  # made from the fields of a dataclass
]

myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"

autodoc_default_options = {
    "members": True,
    "member-order": "bysource",
    "special-members": "__call__, __getitem__",
    "undoc-members": True,
}
autodoc_inherit_docstrings = False
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
viewcode_follow_imported_members = False

html_theme = "furo"
html_theme_options = {"light_css_variables": {"code-font-size": "75%"}}  # 100 columns fit
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = html_show_copyright = html_use_index = False
html_show_search_summary = False  # a browser may not fetch the pages when they are files

# MathJax is one file of a package, not a server's: the site is read without a network. Its formulae
# are drawn as SVG, because some browsers load no fonts for pages that are files.
mathjax_path = "tex-svg-full.js"
_mathjax = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
html_static_path.append(str(_mathjax / mathjax_path))


def copy_notebooks(app: Sphinx) -> None:
    """Bring the notebooks here: Sphinx reads one folder. What did not change is left alone."""
    source, target = HERE.parent / "notebooks", HERE / "tutorials"
    wanted = {
        path.relative_to(source)
        for pattern in ("[0-9][0-9]_*.ipynb", "exercises/*/*.ipynb", "project/*.ipynb")
        for path in source.glob(pattern)
    }
    for path in target.rglob("*.ipynb"):
        if path.relative_to(target) not in wanted:
            path.unlink()
    for path in wanted:
        copy = target / path
        # From `notebooks` a page is at ../docs/PAGE, from here at ../PAGE
        text = (source / path).read_text(encoding="utf-8")
        text = re.sub(r"\]\(((?:\.\./)+)docs/", r"](\1", text)
        if not copy.exists() or copy.read_text(encoding="utf-8") != text:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(text, encoding="utf-8")


def prepare(app: Sphinx, name: str, source: list[str]) -> None:
    """Drop what stands between `<!-- teachers -->` and `<!-- end -->` from the students' site.

    Links to notebooks, which work in a checkout, go to the copies of `copy_notebooks`.
    """
    kept = "" if not TEACHERS else r"\1"
    text = re.sub(r"(?ms)^<!-- teachers -->\n(.*?)^<!-- end -->\n", kept, source[0])
    source[0] = re.sub(r"\]\(\.\./((?:\.\./)*)notebooks/", r"](\1tutorials/", text)


def no_source(app: Sphinx, module: str) -> tuple[str, dict] | None:
    """Show no source of the course to students: with no object in it, nothing leads there."""
    return None if TEACHERS or not module.startswith("uavdh_lite.course") else ("", {})


def no_source_pages(app: Sphinx, env: BuildEnvironment) -> list[str]:
    """Forget those sources, so that they get no page."""
    for name in [name for name, entry in env._viewcode_modules.items() if entry and not entry[0]]:
        del env._viewcode_modules[name]
    return []


def write_labs(app: Sphinx, error: Exception | None) -> None:
    """Put the labs, one file, beside the pages."""
    if error is None and app.builder.format == "html":
        write_page(Path(app.outdir) / "labs.html")


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", copy_notebooks)
    app.connect("source-read", prepare)
    app.connect("viewcode-find-source", no_source)
    app.connect("env-updated", no_source_pages)
    app.connect("build-finished", write_labs)
