"""Make a small wheel, for a class to install from: python notebooks/wheel.py build/wheel

Agents that no notebook uses are left out.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
UNUSED = ["harbour", "metropolis"]  # agents that no notebook of the course flies
LARGEST = 12_000_000  # bytes: what a class can fetch at once
FILES = ("uavdh_lite", "pyproject.toml", "README.md", "LICENSE")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of the wheel")
    parser.add_argument("--without", nargs="*", default=UNUSED, help="agents left out")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
        included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
        for name in (*FILES, *included):
            source, target = ROOT / name, Path(folder, name)
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, target)
        for name in options.without:
            Path(folder, f"data/checkpoints/{name}.safetensors").unlink()
        wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
        subprocess.run([*wheel, options.out, folder], check=True)
    (made,) = options.out.glob("uavdh_lite-*.whl")
    print(f"{made}: {made.stat().st_size / 1e6:.1f} MB")
    if made.stat().st_size > LARGEST:
        print(f"more than {LARGEST / 1e6:g} MB: leave out an agent with --without", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
