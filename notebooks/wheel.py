"""Make a small wheel, for a class to install from: python notebooks/wheel.py build/wheel

It has the shipped agents in half precision where the agent still chooses the same action in every
state of its flights, and as they are where it does not. Agents that no notebook uses are left out.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from uavdh_lite.checkpoint import load, load_agent, save
from uavdh_lite.evaluation import evaluate

ROOT = Path(__file__).parents[1]
UNUSED = ["harbour", "metropolis"]  # agents that no notebook of the course flies
LARGEST = 12_000_000  # bytes: what a class can fetch at once
FILES = ("uavdh_lite", "pyproject.toml", "README.md", "LICENSE")


def halve(path: Path, missions: int) -> tuple[int, int]:
    """Write an agent in half precision if it acts as before; states and changed actions."""
    tensors, about = load(path, "agent")
    half = {k: v.half() if v.is_floating_point() else v for k, v in tensors.items()}
    other = path.with_name(f"half-{path.name}")
    save(other, "agent", half, about)
    agent, coarse = load_agent(path), load_agent(other)
    flights = evaluate(agent.environment, agent, agent.scenario, missions, seed=0)
    states = [step.state[~step.state.ended] for step in flights.history]
    changed = sum(int((agent.act(one) != coarse.act(one)).sum()) for one in states)
    if changed:
        other.unlink()
    else:
        other.replace(path)
    return sum(map(len, states)), changed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of the wheel")
    parser.add_argument("--missions", type=int, default=1000, help="flown to compare the actions")
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
        for path in sorted(Path(folder, "data/checkpoints").glob("*.safetensors")):
            if path.stem in options.without:
                path.unlink()
                continue
            before = path.stat().st_size
            states, changed = halve(path, options.missions)
            said = (
                f"{changed} of {states:,} actions would change" if changed else f"{states:,} states"
            )
            after = path.stat().st_size
            print(
                f"{path.stem:<24}{before / 1e6:6.1f} MB {after / 1e6:6.1f} MB  {said}", flush=True
            )
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
