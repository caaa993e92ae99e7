"""Make the notebooks from their scripts: scripts/NN_topic.py → NN_topic.ipynb with outputs.

    python notebooks/execute.py          # those whose source changed since they were executed
    python notebooks/execute.py 01 03    # these, whether they changed or not

The scripts are the source (jupytext's percent format). A notebook keeps hashes of the source that
it was executed from, and of the files of `data` that it read; the tests compare them, so that no
outputs of another source are kept. The exercises, scripts/exercises/NN_topic.py, become
solutions/NN_topic/NN_topic.ipynb, and from these exercises/NN_topic/NN_topic.ipynb for students.
scripts/project/ has the project's template and two examples, which become project/NAME.ipynb.
"""

import argparse
import hashlib
import sys
from ast import literal_eval
from collections.abc import Iterable
from pathlib import Path

import jupytext
import nbformat
from assignments import mark_cells, release
from nbclient import NotebookClient

from uavdh_lite.storage import write_atomically

HERE = Path(__file__).parent
SECONDS = 300  # for one cell, at most
NOTE_FILES = """
import sys
import safetensors

sys.opened, _open = set(), safetensors.safe_open

def _note(event, given):
    if event == "open" and isinstance(given[0], str):
        sys.opened.add(given[0])

def _note_safetensors(path, *options, **named):  # its files are opened outside of Python
    sys.opened.add(str(path))
    return _open(path, *options, **named)

sys.addaudithook(_note)
safetensors.safe_open = _note_safetensors
"""


def scripts() -> list[Path]:
    """Of the tutorials."""
    return sorted((HERE / "scripts").glob("[0-9][0-9]_*.py"))


def exercise_scripts() -> list[Path]:
    return sorted((HERE / "scripts" / "exercises").glob("[0-9][0-9]_*.py"))


def project_scripts() -> list[Path]:
    """Of the project's template and its two worked examples."""
    return sorted((HERE / "scripts" / "project").glob("*.py"))


def is_exercise(script: Path) -> bool:
    return script.parent.name == "exercises"


def notebook_of(script: Path) -> Path:
    folder = {
        "exercises": HERE / "solutions" / script.stem,
        "project": HERE / "project",
    }.get(script.parent.name, HERE)
    return folder / f"{script.stem}.ipynb"


def source_hash(notebook: nbformat.NotebookNode) -> str:
    """SHA-256 of the cells' types and sources."""
    text = "\0".join(f"{cell.cell_type}\0{cell.source}" for cell in notebook.cells)
    return hashlib.sha256(text.encode()).hexdigest()


def file_hashes(paths: Iterable[str]) -> dict[str, str]:
    """SHA-256 of files in `data`, by their paths in it; "missing" of one that is not there."""
    files = {path: HERE.parent / "data" / path for path in paths}
    return {
        path: hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else "missing"
        for path, file in files.items()
    }


def from_script(script: Path) -> nbformat.NotebookNode:
    """The notebook of a script, without outputs; its cells are numbered, so that ids are stable."""
    notebook = jupytext.read(script, fmt="py:percent")
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number:02d}"
    notebook.metadata = nbformat.NotebookNode(
        kernelspec={"display_name": "Python 3", "language": "python", "name": "python3"},
        language_info={"name": "python"},
        uavdh_lite={"source_sha256": source_hash(notebook)},
    )
    # Not paired by jupytext: it would refuse to open a notebook that is newer than its script
    if is_exercise(script):
        mark_cells(notebook)
    return notebook


def is_fresh(script: Path) -> bool:
    """Whether the notebook was executed from the script as it is."""
    path = notebook_of(script)
    if not path.exists():
        return False
    kept = nbformat.read(path, as_version=4).metadata.get("uavdh_lite", {})
    read = kept.get("read", {})
    source = from_script(script).metadata["uavdh_lite"]["source_sha256"]
    return kept.get("source_sha256") == source and read == file_hashes(read)


def _keep_pages(notebook: nbformat.NotebookNode) -> None:
    """Of a widget that is also a page, such as a quiz, keep the page: it reads without a kernel."""
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if "text/html" in output.get("data", {}):
                output.data.pop("application/vnd.jupyter.widget-view+json", None)


def _run(client: NotebookClient, code: str, value: str = "None"):
    """Run code that is no cell in the notebook's kernel; the value of an expression after it."""
    asked = client.kc.execute(code, store_history=False, user_expressions={"value": value})
    answer = client.wait_for_reply(asked)["content"]["user_expressions"]["value"]
    return literal_eval(answer["data"]["text/plain"])


def execute(script: Path) -> None:
    """Execute the notebook from top to bottom on a fresh kernel, and write it with outputs."""
    notebook = from_script(script)
    client = NotebookClient(
        notebook,
        timeout=SECONDS,
        kernel_name="python3",
        record_timing=False,
        store_widget_state=False,
        coalesce_streams=True,  # what one cell prints is one output
        resources={"metadata": {"path": str(HERE)}},
    )
    with client.setup_kernel():
        _run(client, NOTE_FILES)
        for number, cell in enumerate(notebook.cells):
            client.execute_cell(cell, number)
        opened = _run(client, "", "chr(10).join(sys.opened)").splitlines()
    data = (HERE.parent / "data").resolve()
    paths = {(HERE / path).resolve() for path in opened}
    read = {path.relative_to(data).as_posix() for path in paths if path.is_relative_to(data)}
    notebook.metadata["uavdh_lite"]["read"] = file_hashes(sorted(read))
    notebook.metadata.pop("widgets", None)
    _keep_pages(notebook)
    notebook.metadata.language_info = {"name": "python"}
    nbformat.validate(notebook)
    path = notebook_of(script)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda temporary: nbformat.write(notebook, temporary))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("numbers", nargs="*", metavar="NN", help="notebooks, by their number")
    options = parser.parse_args()
    known: dict[str, list[Path]] = {}
    for script in scripts() + exercise_scripts() + project_scripts():
        known.setdefault(script.name[:2], []).append(script)
    unknown = [number for number in options.numbers if number not in known]
    if unknown:
        parser.error(f"no notebook {', '.join(unknown)}: choose from {', '.join(known)}")
    every = [script for pair in known.values() for script in pair]
    chosen = [script for number in options.numbers for script in known[number]]
    chosen = chosen or [script for script in every if not is_fresh(script)]
    for script in chosen:
        print(notebook_of(script).relative_to(HERE), file=sys.stderr)
        execute(script)
    if assignments := [script.stem for script in chosen if is_exercise(script)]:
        release(assignments, HERE / "exercises")
    return 0


if __name__ == "__main__":
    sys.exit(main())
