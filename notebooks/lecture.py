"""Slides and figures of the course, from its notebooks: python notebooks/lecture.py build/lecture

    python notebooks/lecture.py build/lecture 04 05    # of these notebooks alone

A slide is a section of a notebook: its heading, a figure with the sentence that says what it shows,
or the section's first sentences. Nothing is written twice: what is on a slide stands in a notebook.
"""

import argparse
import base64
import html
import re
from importlib.util import find_spec
from pathlib import Path

from uavdh_lite.errors import extra

with extra("docs"):
    import nbformat
    from execute import HERE, SECONDS, from_script, scripts
    from nbclient import NotebookClient
    from nbconvert.filters import markdown2html

COURSE = [f"{number:02d}" for number in range(10)]
# How a sentence begins that says little by itself: it names what was named before, or asks to do
LEANS = re.compile(
    r"(They|It|This|That|These|Both|Here|Look|Move|Change|Run|Try|The (code|next))\b"
)
BOTH_KINDS = "%config InlineBackend.figure_formats = ['png', 'svg']"
PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>
@page {{ size: 13.33in 7.5in; margin: 0 }}
html {{ scroll-snap-type: y mandatory; font: 1.6rem/1.45 system-ui, sans-serif; color: #16202b }}
body {{ margin: 0 }}
section {{ box-sizing: border-box; height: 100vh; padding: 2vh 5vw; scroll-snap-align: start;
  break-after: page; overflow: hidden; display: flex; flex-direction: column; gap: 1vh }}
h1, h2 {{ margin: 0; font-size: 2rem; line-height: 1.2; color: #17456e }}
p, ul, ol {{ margin: 0 }} li {{ margin: .4em 0 }} table {{ font-size: 1.3rem }}
img {{ flex: 1; min-height: 0; width: 100%; object-fit: contain; align-self: center }}
small {{ margin-top: auto; color: #5c6b7a; font-size: 1rem }}
</style>
<script>MathJax = {{ tex: {{ inlineMath: [["$", "$"]] }} }}</script>
<script>{mathjax}</script>
{slides}
<script>
addEventListener("keydown", (event) => {{
  const step = {{ ArrowRight: 1, ArrowDown: 1, " ": 1, ArrowLeft: -1, ArrowUp: -1 }}[event.key];
  if (!step) return;
  event.preventDefault();
  const slides = [...document.querySelectorAll("section")];
  const now = Math.round(scrollY / innerHeight) + step;
  slides[Math.max(0, Math.min(now, slides.length - 1))].scrollIntoView();
}});
</script>
</html>
"""


def executed(script: Path) -> nbformat.NotebookNode:
    """The notebook of a script, run from top to bottom; its figures as PNG and as SVG."""
    notebook = from_script(script)
    setting = nbformat.v4.new_code_cell(BOTH_KINDS)
    notebook.cells.insert(0, setting)
    place = {"metadata": {"path": str(HERE)}}
    NotebookClient(notebook, timeout=SECONDS, kernel_name="python3", resources=place).execute()
    cells, notebook.cells = notebook.cells[1:], []
    for cell in cells:  # one of prose may hold the end of a section and the next heading
        if cell.cell_type == "markdown":
            parts = re.split(r"(?m)^(?=##? )", cell.source)
            notebook.cells += [nbformat.v4.new_markdown_cell(part) for part in parts if part]
        else:
            notebook.cells.append(cell)
    return notebook


def sentences(text: str) -> list[str]:
    """The sentences of Markdown, without headings, tables, folded hints and pictures."""
    text = re.sub(r"(?s)<details>.*?</details>|\$\$.*?\$\$|```.*?```", "", text)
    parts = [p for p in re.split(r"\n\s*\n", text) if p.strip() and p.strip()[0] not in "#|<!-"]
    words = " ".join(" ".join(parts).split()).replace("**", "")
    words = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", words)  # a link leads nowhere from here
    return re.split(r"(?<=[.?!])\s+(?=[A-Z`$*])", words)


def _caption(text: str) -> str:
    """One of the first sentences of Markdown: the first that can stand by itself, if one can."""
    found = sentences(text)[:3]
    return next((sentence for sentence in found if not LEANS.match(sentence)), found[0])


def slides_of(notebook: nbformat.NotebookNode) -> list[tuple[str, str, dict | None]]:
    """Each slide: its heading, its Markdown, and its figure's data or None."""
    cells, slides, heading, empty = notebook.cells, [], "", False
    for k, cell in enumerate(cells):
        found = re.match(r"##? (.+)", cell.source) if cell.cell_type == "markdown" else None
        if found:
            heading, empty = found[1], True
            if heading == "Recap":
                slides.append((heading, cell.source.partition("\n")[2], None))
                empty = False
        drawn = (o.data for o in cell.get("outputs", ()) if "image/svg+xml" in o.get("data", {}))
        for data in drawn:
            after = next((c.source for c in cells[k + 1 :] if c.cell_type == "markdown"), "")
            before = next(c.source for c in cells[k::-1] if c.cell_type == "markdown")
            first = not slides
            said = " ".join(sentences(before)[:2]) if first else _caption(after) or _caption(before)
            slides.append((heading, said, data))
            empty = False
        ends = all(c.cell_type == "markdown" and c.source[:1] == "#" for c in cells[k + 1 : k + 2])
        if empty and ends and heading not in ("Exercises", "Further reading"):
            start = next(
                c for c in cells[k::-1] if c.source.startswith(("# " + heading, "## " + heading))
            )
            said = " ".join(sentences(start.source)[:3])
            if said and said[-1] != ":":  # what would follow is not on the slide
                slides.append((heading, said, None))
            empty = False
    return slides


def write(
    notebook: nbformat.NotebookNode, stem: str, out: Path, mathjax: str
) -> list[tuple[str, str]]:
    """Write a notebook's slides and figures; the figures' names and sentences.

    Arguments:
        mathjax: the script that draws the formulae.
    """
    shown, figures, slides = [], [], slides_of(notebook)
    for number, (heading, text, data) in enumerate(slides):
        picture = ""
        if data:
            name = f"{stem}-{len(figures) + 1}"
            (out / "figures" / f"{name}.svg").write_text(data["image/svg+xml"], encoding="utf-8")
            (out / "figures" / f"{name}.png").write_bytes(base64.b64decode(data["image/png"]))
            figures.append((name, text))
            source = f"data:image/png;base64,{data['image/png'].strip()}"
            picture = f'<img alt="{_alt(text)}" src="{source}">'
        level = "h2" if number else "h1"
        shown.append(
            f"<section{'' if number else ' class=first'}><{level}>{html.escape(heading)}</{level}>"
            f"{markdown2html(text)}{picture}<small>{stem} · {number + 1}</small></section>"
        )
    title = html.escape(slides[0][0])
    page = PAGE.format(title=title, mathjax=mathjax, slides="\n".join(shown))
    (out / "slides" / f"{stem}.html").write_text(page, encoding="utf-8")
    return figures


def _alt(text: str) -> str:
    """A sentence of Markdown as the alternative text of a figure."""
    return html.escape(re.sub(r"[*`$]", "", text))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of slides/ and figures/")
    parser.add_argument("numbers", nargs="*", default=COURSE, metavar="NN", help="of the notebooks")
    options = parser.parse_args()
    chosen = {script.name[:2]: script for script in scripts() if script.name[:2] in options.numbers}
    if unknown := set(options.numbers) - set(chosen):
        parser.error(f"no notebook {', '.join(sorted(unknown))}: NN is two digits, such as 04")
    if not (mathjax := find_spec("sphinx-mathjax-offline")):
        parser.error("sphinx-mathjax-offline is not installed: pip install -e '.[docs]'")
    for name in ("slides", "figures"):
        (options.out / name).mkdir(parents=True, exist_ok=True)
    path = Path(mathjax.origin).parent / "static" / "mathjax" / "tex-svg-full.js"
    script_of_formulae = path.read_text(encoding="utf-8")
    rows = []
    for script in chosen.values():
        figures = write(executed(script), script.stem, options.out, script_of_formulae)
        print(f"{script.stem}: {len(figures)} figures", flush=True)
        for name, text in figures:
            said = f"{name}: {html.escape(text)}"
            rows.append(f'<p><img alt="{_alt(text)}" src="{name}.svg"><br>{said}</p>')
    style = "<style>body{font-family:sans-serif}img{max-width:45rem;max-height:26rem}</style>"
    page = f'<!doctype html><meta charset="utf-8"><title>Figures</title>{style}{"".join(rows)}'
    (options.out / "figures" / "index.html").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
