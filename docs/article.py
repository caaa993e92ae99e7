"""The article of the replication, the page of claims: HTML, and where pandoc is, PDF.

    python docs/article.py [FOLDER]

Writes `article.html`, with its pictures beside it, and `article.pdf` into the folder, by default
build/article.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from bs4 import BeautifulSoup

ENGINES = ("typst", "tectonic", "xelatex")  # the last two with rsvg-convert
PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ max-width: 50rem; margin: 2rem auto; padding: 0 1rem; font: 1rem/1.5 serif; }}
table {{ border-collapse: collapse; font-size: 0.9rem; }}
td, th {{ padding: 0.3rem 0.5rem; border-top: 1px solid; text-align: left; vertical-align: top; }}
img {{ max-width: 100%; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""


def main(out: Path) -> None:
    only = ("root_doc=results/claims", "include_patterns=results/claims.md", "html_theme=basic")
    options = [part for option in only for part in ("-D", option)]
    docs = Path(__file__).parent
    build = [sys.executable, "-m", "sphinx", "-Q", "-b", "singlehtml", *options, docs, out / "all"]
    subprocess.run(build, check=True)
    made = out / "all" / "results" / "claims.html"
    body = BeautifulSoup(made.read_text(encoding="utf-8"), "html.parser").select_one("[role=main]")
    for link in body.select("a.headerlink"):
        link.decompose()
    for picture in body.select("img"):
        picture["src"] = Path(picture["src"]).name
        shutil.copy(out / "all" / "_images" / picture["src"], out)
    for table in body.select("table"):  # without widths, LaTeX wraps no cell
        columns = len(table.select_one("tr").select("th, td"))
        column = f'<col style="width: {100 // columns}%">'
        table.insert(0, BeautifulSoup(f"<colgroup>{columns * column}</colgroup>", "html.parser"))
    page = out / "article.html"
    text = PAGE.format(title=body.h1.get_text(), body=body.decode_contents())
    page.write_text(text, encoding="utf-8")
    shutil.rmtree(out / "all")
    print(page)
    engine = next(filter(shutil.which, ENGINES), None)
    if engine is None or not shutil.which("pandoc"):
        print(f"no PDF: it needs pandoc, and one of {', '.join(ENGINES)}, on the path")
        return
    make = ["pandoc", page.name, "--pdf-engine", engine, "-o", "article.pdf", "-M", "title="]
    if engine == "typst":
        make += ["-V", "header-includes=#show figure: set block(breakable: true)"]  # the table
    subprocess.run(make, check=True, cwd=out)
    print(out / "article.pdf")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2] or ["build/article"]).resolve())
