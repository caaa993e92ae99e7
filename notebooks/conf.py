"""The notebooks as a static book, made by Sphinx from the outputs that they keep."""

from importlib.util import find_spec
from pathlib import Path

project = html_title = "uavdh_lite"
extensions = ["myst_nb"]
include_patterns = ["index.md", "[0-9][0-9]_*.ipynb", "exercises/*/*.ipynb"]
myst_enable_extensions = ["amsmath", "dollarmath"]
nb_execution_mode = "off"

html_theme = "furo"
html_theme_options = {"light_css_variables": {"code-font-size": "75%"}}  # 100 columns fit
html_copy_source = html_show_copyright = html_use_index = False
html_show_search_summary = False  # a browser may not fetch the pages when they are files

# MathJax is one file of a package, not a server's: the book is read without a network. Its formulae
# are drawn as SVG, because some browsers load no fonts for pages that are files.
mathjax_path = "tex-svg-full.js"
_mathjax = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
html_static_path = [str(_mathjax / mathjax_path)]
