"""How text becomes pages: docstrings in Markdown, links in code style, and two touches.

Autodoc takes reStructuredText, so each docstring becomes the content of a directive that MyST
parses. A block `Arguments:` becomes a list, and a configuration shows the default, the bounds and
the help of its `option(...)` fields in a table. Code that names a class or function of the library
becomes a link.
"""

import dataclasses
import re
from collections import Counter
from functools import cached_property
from inspect import cleandoc

from docutils import nodes
from docutils.utils import new_document
from myst_parser.parsers.sphinx_ import MystParser
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import make_refnode
from tables import bounds

PACKAGE = "uavdh_lite"
LONGEST_VALUE = 70  # characters
ARGUMENT = re.compile(r"^([a-z_]\w*(?:, [a-z_]\w*)*): ")


class Markdown(SphinxDirective):
    """Content that MyST parses, wherever the directive stands."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        source, _ = self.get_source_info()
        document = new_document(source, self.state.document.settings)
        # MyST expects the first heading to be of level 1.
        text = re.sub(r"(?m)^#{2,} ", "# ", "\n".join(self.content))
        MystParser().parse(text, document)
        for section in list(document.findall(nodes.section)):  # a docstring has no pages below it
            title, *rest = section.children
            section.replace_self([nodes.rubric("", "", *title.children), *rest])
        return document.children


def arguments_as_list(text: str) -> str:
    """The text with its block `Arguments:` as a list, an item for each line `name: meaning`."""
    before, found, block = text.partition("\nArguments:\n")
    if not found:
        return text
    block, _, after = re.sub(r"\n(?=\S)", "\f", f"\n{block}", count=1).partition("\f")
    items = [
        re.sub(ARGUMENT, lambda match: f"- `{'`, `'.join(match[1].split(', '))}`: ", line)
        for line in cleandoc(block).splitlines()
    ]
    return "\n\n".join([before.rstrip(), "**Arguments**", "\n".join(items), after])


def option_table(owner: type) -> list[str]:
    """The `option(...)` fields of a configuration: default, bounds and help."""
    options = [f for f in dataclasses.fields(owner) if "help" in f.metadata]
    if not options:
        return []
    rows = ["", "| field | default | bounds | meaning |", "| --- | --- | --- | --- |"]
    for field in options:
        limits = bounds(field.metadata["bounds"])
        rows.append(f"| `{field.name}` | {field.default} | {limits} | {field.metadata['help']} |")
    return rows


def process_docstring(app: Sphinx, what: str, name: str, obj, options, lines: list[str]) -> None:
    text = arguments_as_list("\n".join(lines))
    if what == "class" and dataclasses.is_dataclass(obj):
        text += "\n".join(option_table(obj))
    if text.strip():
        lines[:] = [".. markdown::", "", *(f"   {line}" for line in text.splitlines()), ""]


def skip_member(app: Sphinx, what: str, name: str, obj, skip: bool, options) -> bool | None:
    """Leave out a class's fields: its docstring says what they are, often in a table."""
    described = callable(obj) or isinstance(obj, property | cached_property | classmethod)
    return True if what == "class" and not described else None


class LinkCode(SphinxPostTransform):
    """Links from `City` or `evaluation.fly` in code style to the reference."""

    default_priority = 5

    def run(self, **kwargs) -> None:
        if self.env.current_document.docname.startswith("tutorials/"):
            return  # notebooks stay as they are
        targets = _targets(self.env)
        for literal in list(self.document.findall(nodes.literal)):
            entry = targets.get(literal.astext().removesuffix("()"))
            if entry and not _inside_link(literal):
                name, docname, anchor = entry
                link = make_refnode(
                    self.app.builder, self.env.current_document.docname, docname, anchor, [], name
                )
                literal.replace_self(link)
                link += literal


class CutLongValues(SphinxPostTransform):
    """A constant's value is shown where it fits in a line, as that of `ACTIONS`."""

    default_priority = 5

    def run(self, **kwargs) -> None:
        for annotation in list(self.document.findall(addnodes.desc_annotation)):
            if len(annotation.astext()) > LONGEST_VALUE and "=" in annotation.astext():
                annotation.parent.remove(annotation)


class KeepPercentTogether(SphinxPostTransform):
    """No line ends between a number and its per cent sign."""

    default_priority = 5

    def run(self, **kwargs) -> None:
        for text in list(self.document.findall(nodes.Text)):
            if not isinstance(text.parent, nodes.literal | nodes.literal_block | nodes.raw):
                kept = re.sub(r"(?<=\d) (?=%)", "\u00a0", text)
                if kept != text:
                    text.parent.replace(text, nodes.Text(kept))


def give_level(app: Sphinx, page: str, template: str, context: dict, tree) -> None:
    """Say of the navigation's captions which headings they are: screen readers ask for it."""
    if "furo_navigation_tree" in context:
        whole = context["furo_navigation_tree"]
        named = whole.replace('role="heading"', 'role="heading" aria-level="2"')
        context["furo_navigation_tree"] = named


def _inside_link(node: nodes.Node) -> bool:
    parents = (nodes.reference, nodes.title, nodes.rubric, addnodes.desc_signature)
    while node.parent is not None:
        node = node.parent
        if isinstance(node, parents):
            return True
    return False


def _targets(env) -> dict[str, tuple[str, str, str]]:
    """Documented objects by the shorter names that mean only one of them.

    Plain words such as `rate` are left out: a table's column or a parameter has such a name, too.
    """
    found: dict[str, tuple[str, str, str]] = {}
    count: Counter[str] = Counter()
    for name, entry in env.domains.python_domain.objects.items():
        parts = name.split(".")
        for first in range(len(parts)):
            short = ".".join(parts[first:])
            if re.fullmatch(r"[a-z]+|_.*", short) or (first == 0 and short == PACKAGE):
                continue
            if entry.objtype in ("attribute", "property", "method") and "." not in short:
                continue
            count[short] += 1
            found[short] = (name, entry.docname, entry.node_id)
    return {short: entry for short, entry in found.items() if count[short] == 1}


def setup(app: Sphinx) -> dict:
    app.add_directive("markdown", Markdown)
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-skip-member", skip_member)
    app.connect("html-page-context", give_level, priority=900)  # after the theme
    app.add_post_transform(LinkCode)
    app.add_post_transform(CutLongValues)
    app.add_post_transform(KeepPercentTogether)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
