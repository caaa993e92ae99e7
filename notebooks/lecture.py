"""Slides and figures of the course, from its notebooks: python notebooks/lecture.py build/lecture

    python notebooks/lecture.py build/lecture 04 05    # of these notebooks alone

A section becomes a slide with its formulas, tables, lists and the sentences that introduce a term
in bold; each figure, short output, player and definition one of its own, if there is no room. All
that the notebook says there is in the speaker's notes (key S). Two tags of a cell change that:
`slide-code` shows its code, too, and `no-slide` leaves it out. A page needs no network: reveal.js
and MathJax stand in it.
"""

import argparse
import base64
import html
import re
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from uavdh_lite.errors import extra

with extra("docs"):
    import nbformat
    from execute import HERE, notebook_of, scripts
    from nbconvert import SlidesExporter

COURSE = [f"{number:02d}" for number in range(10)]
LEFT_OUT = ("Exercises", "Further reading")
SHORT = 14  # lines of an output that fits on a slide
MOST, FULL = 6, 13  # points of a slide, and its lines, a figure counted as nine
# How a sentence begins that says little by itself: it names what was named before, or asks to do
LEANS = re.compile(
    r"(They|It|This|That|These|Both|Here|Look|Move|Change|Run|Try|So|But|The (code|next))\b"
)
OFFLINE = {  # from which package each part of the page is
    "reveal": ("sphinx_revealjs", "_static/revealjs/dist/reveal.js"),
    "notes": ("sphinx_revealjs", "_static/revealjs/plugin/notes/notes.js"),
    "css": ("sphinx_revealjs", "_static/revealjs/dist/reveal.css"),
    "mathjax": ("sphinx-mathjax-offline", "static/mathjax/tex-svg-full.js"),
}


def sentences(block: str) -> list[str]:
    """The sentences of a paragraph of Markdown, without links, which lead nowhere from a slide."""
    words = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", " ".join(block.split()))
    return re.split(r"(?<=[.?!])\s+(?=[A-Z`$*])", words)


def points(text: str, whole: bool = False) -> list[str]:
    """Of Markdown what goes on a slide, a line or block each; of lists the `whole` items."""
    text = re.sub(r"(?s)<details>.*?</details>", "", text)
    shown: list[str] = []
    for block in filter(None, map(str.strip, re.split(r"\n\s*\n", text))):
        if block[:2] == "- ":
            items = re.split(r"\n(?=- )", block)
            shown += [" ".join(sentences(item)[: None if whole else 1]) for item in items]
        elif re.match(r"\$\$|[|!<]|```|\d+\. ", block):
            shown.append(block)
        elif re.fullmatch(r"(?s)\*\*[^*]+\*\*", block):
            shown.append(" ".join(block.split()))
        elif block[0] != "#":
            said = sentences(block)
            terms = [one for one in said if "**" in one and one.count("**") % 2 == 0]
            first = [one for one in said if one[:1].isupper() and not LEANS.match(one)]
            if first and first[0][-1] == "?":  # with its answer
                first = [" ".join(said[said.index(first[0]) :][:2])]
            shown += [f"- {one}" for one in terms[:2] or first[:1] if one[-1] not in ":?"]
    return shown


def _markdown(source: str, kind: str) -> nbformat.NotebookNode:
    return nbformat.v4.new_markdown_cell(source, metadata={"slideshow": {"slide_type": kind}})


def _outputs(cell: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    """The outputs of a cell that a slide shows: figures, players, quizzes, a few lines."""
    return [
        output
        for output in cell.outputs
        if "image/png" in output.get("data", {})
        or re.search("uavdh-player|<details", output.get("data", {}).get("text/html", ""))
        or 0 < len(output.get("text", "").splitlines()) <= SHORT
    ]


def _shows(cell: nbformat.NotebookNode) -> bool:
    """Whether a slide shows the code of a cell: if its tag says so, or if it defines something."""
    defines = re.match(r"(def|class) ", cell.source) and cell.source.count("\n") < SHORT
    return "slide-code" in cell.metadata.get("tags", []) or bool(defines)


def slides_of(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook of the slides, as nbconvert expects it."""
    cells, slides, title, heading, used = [], nbformat.v4.new_notebook(), "", "", 0
    for cell in notebook.cells:  # one of prose may hold the end of a section and the next heading
        if cell.cell_type == "markdown":
            parts = filter(str.strip, re.split(r"(?m)^(?=##? )", cell.source))
            cells += [nbformat.v4.new_markdown_cell(p, metadata=cell.metadata) for p in parts]
        else:
            cells.append(cell)
    for cell, after in pairwise([*cells, nbformat.v4.new_raw_cell()]):
        tags = cell.metadata.get("tags", [])
        prose = cell.cell_type == "markdown"
        if found := re.match(r"##? (.+)\n?", cell.source) if prose else None:
            heading = found[1]
            title = title or heading
        if heading in LEFT_OUT or "no-slide" in tags:
            continue
        if prose:
            said = points(cell.source[found.end() if found else 0 :], heading == "Recap")
            if not found and cell.source[0] != "|":  # it goes on after an output
                caption, said = said[:1], said[1:]
                if used + 2 <= FULL:
                    slides.cells.append(_markdown("\n".join(caption), "-"))
            text = "".join(said)
            if found or len(said) > 3 or "$$" in text or "|" in text:
                lines = re.sub(r"\n\n(?=- )", "\n", "\n\n".join(["", *said[:MOST]]))
                slides.cells.append(_markdown(f"## {heading}\n{lines}", "slide"))
                used = 2 * len(said[:MOST])
            slides.cells.append(_markdown(cell.source, "notes"))
        elif (shows := _shows(cell)) or _outputs(cell):
            outputs = _outputs(cell)
            high = [4 if "text" in one or "<details" in str(one.data) else 9 for one in outputs]
            high += [cell.source.count("\n")] * shows
            if used + sum(high) > FULL:
                slides.cells.append(_markdown(f"## {heading}", "slide"))
                used = 0
            used += sum(high)
            if shows:
                slides.cells.append(_markdown(f"```python\n{cell.source}\n```", "-"))
            words = sentences(after.source)[0] if after.source[:1].isalpha() else heading
            for output in outputs:
                if picture := output.get("data", {}).get("image/png"):
                    alt = html.escape(re.sub(r"[*`$]", "", words))
                    source = f"data:image/png;base64,{picture.strip()}"
                    output.data = {"text/html": f'<img alt="{alt}" src="{source}">'}
            slides.cells.append(nbformat.v4.new_code_cell(outputs=outputs))
    slides.metadata.title = title
    return slides


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of slides/ and figures/")
    parser.add_argument("numbers", nargs="*", default=COURSE, metavar="NN", help="of the notebooks")
    options = parser.parse_args()
    chosen = {script.name[:2]: script for script in scripts() if script.name[:2] in options.numbers}
    if unknown := set(options.numbers) - set(chosen):
        parser.error(f"no notebook {', '.join(sorted(unknown))}: NN is two digits, such as 04")
    if not all(find_spec(package) for package, _ in OFFLINE.values()):
        parser.error("reveal.js or MathJax is not installed: pip install -e '.[docs]'")
    offline = {
        name: (Path(find_spec(package).origin).parent / path).read_text(encoding="utf-8")
        for name, (package, path) in OFFLINE.items()
    }
    exporter = SlidesExporter(template_name="slides", extra_template_basedirs=[str(HERE)])
    exporter.exclude_input = True
    for name in ("slides", "figures"):
        (options.out / name).mkdir(parents=True, exist_ok=True)
    for script in chosen.values():
        notebook = nbformat.read(notebook_of(script), as_version=4)
        slides = slides_of(notebook)
        page, _ = exporter.from_notebook_node(slides, {"offline": offline})
        (options.out / "slides" / f"{script.stem}.html").write_text(page, encoding="utf-8")
        pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
        for number, picture in enumerate(pictures, 1):
            path = options.out / "figures" / f"{script.stem}-{number}.png"
            path.write_bytes(base64.b64decode(picture))
        kinds = [cell.metadata.get("slideshow", {}).get("slide_type") for cell in slides.cells]
        print(f"{script.stem}: {kinds.count('slide')} slides, {len(pictures)} figures", flush=True)


if __name__ == "__main__":
    main()
