"""What is made while the site is built: tables from recorded files, and the reference of modules.

    ```{generated} comparison manhattan
    ```

stands for what `tables.comparison("manhattan")` returns, as Markdown, and

    ```{modules} city labs.*
    ```

for the documentation of these modules of `uavdh_lite`, each under its name; `labs.*` means the
package `labs` and all that is in it. The checks of the notebooks, whose sources hold the solutions,
are left out of the site for students.
"""

import pkgutil
from importlib import import_module

import tables
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Generated(SphinxDirective):
    """A function of `tables`, and its arguments."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        name, *arguments = self.arguments[0].split()
        if name.startswith("_") or not hasattr(tables, name):
            raise self.error(f"no table {name!r}: choose a function of tables.py")
        self.env.note_dependency(tables.__file__)
        self.env.note_reread()  # made from files and modules that Sphinx does not watch
        text = getattr(tables, name)(*arguments)
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def modules(pattern: str) -> list[str]:
    """The module of this name or, with `.*` at its end, a package and all that is in it."""
    name = pattern.removesuffix(".*")
    if name == pattern:
        return [name]
    package = import_module(f"uavdh_lite.{name}")
    inside = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    names = [name, *(module.name.removeprefix("uavdh_lite.") for module in inside)]
    # A package comes after its modules: what it takes from them is documented where it is made.
    return sorted(names, key=lambda name: name.count("."), reverse=True)


class Modules(SphinxDirective):
    """The documentation of some modules, from their docstrings."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        section = "## `{0}`\n\n```{{eval-rst}}\n.. automodule:: uavdh_lite.{0}\n```\n\n"
        self.env.note_reread()
        names = [name for pattern in self.arguments[0].split() for name in modules(pattern)]
        if not self.env.app.tags.has("teachers"):
            names = [name for name in names if not name.startswith("course.checks.notebook_")]
        text = "".join(map(section.format, names))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict:
    app.add_directive("generated", Generated)
    app.add_directive("modules", Modules)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
