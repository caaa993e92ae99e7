"""Make the folder that students get: python notebooks/handout.py build/handout

It holds the notebooks, their exercises, the project, the install sheet and a small wheel, in which
agents that no notebook uses are left out. It holds no solutions.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
UNUSED = ["harbour", "metropolis"]  # agents that no notebook of the course flies
LARGEST = 12_000_000  # bytes: what a class can fetch at once
FILES = ("uavdh_lite", "pyproject.toml", "README.md", "LICENSE")  # of the wheel
ANSWER = re.compile("### BEGIN SOLUTION.*?### END SOLUTION", re.DOTALL)
SHEETS = (
    "notebooks/[0-9][0-9]_*.ipynb",
    "notebooks/exercises/*/*.ipynb",
    "notebooks/project/*.ipynb",
)


def copy_sheets(out: Path) -> None:
    """Copy what students read and fill in; `SystemExit` if somebody has written in an exercise."""
    for source in (path for pattern in SHEETS for path in ROOT.glob(pattern)):
        if source.parts[-3] == "exercises" and _cells(source) != _without_answers(source):
            said = "this is not its solution without the answers. Has somebody filled it in?"
            sys.exit(f"{source}: {said} Put back the one of the project, or run execute.py")
        target = out / source.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)
    shutil.copy(ROOT / "docs" / "how_to" / "install.md", out)


def _cells(notebook: Path) -> list[tuple[str, str]]:
    """Each cell's text and nbgrader's name for it; none if there is no such file."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"] if notebook.is_file() else []
    marks = [cell["metadata"].get("nbgrader", {}).get("grade_id", "") for cell in cells]
    return [("".join(cell["source"]), mark) for cell, mark in zip(cells, marks, strict=True)]


def _without_answers(exercise: Path) -> list[tuple[str, str]]:
    """The cells of its solution, as nbgrader makes them for students."""
    cells = _cells(ROOT / "notebooks" / "solutions" / exercise.parent.name / exercise.name)
    stubs = [f'raise NotImplementedError("exercise {m.replace("-", ".")}")' for _, m in cells]
    return [(ANSWER.sub(stub, text), m) for stub, (text, m) in zip(stubs, cells, strict=True)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="the folder")
    parser.add_argument("--without", nargs="*", default=UNUSED, help="agents left out of the wheel")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
        included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
        for name in (*FILES, *included):
            source, target = ROOT / name, Path(folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, target)
        for name in options.without:
            Path(folder, f"data/checkpoints/{name}.safetensors").unlink()
        for older in options.out.glob("uavdh_lite-*.whl"):
            older.unlink()
        wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
        subprocess.run([*wheel, options.out, folder], check=True)
    copy_sheets(options.out)
    (made,) = options.out.glob("uavdh_lite-*.whl")
    print(f"{made}: {made.stat().st_size / 1e6:.1f} MB")
    if made.stat().st_size > LARGEST:
        print(f"more than {LARGEST / 1e6:g} MB: leave out an agent with --without", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
