"""Tables made from the library and from recorded files while the site is built.

    ```{generated} comparison manhattan
    ```

stands for what `tables.comparison("manhattan")` returns, as Markdown.
"""

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


def setup(app: Sphinx) -> dict:
    app.add_directive("generated", Generated)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
