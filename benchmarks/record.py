"""The recorded studies: which there are, which are of today's program, how they are made.

    python benchmarks/record.py                        # what is missing, or not of today's program
    python benchmarks/record.py --make STUDY --jobs 2  # make it, or go on with it, and record it
    python benchmarks/record.py --gather STUDY FOLDER --commit 08f434d  # record that program's runs

`data/runs/list.toml` names the studies. A study's runs lie in `FOLDER/NAME-SEED`, as the commands
`train` and `study` and `benchmarks/fleet.py` write them; the list has the name for each variant.
Which program makes them `--make` notes in `FOLDER/golden`; of others it must be told.
Recorded are the two tables of all runs, `STUDY.csv.gz` of the validations and
`STUDY-training.csv.gz` of the learning curves, `STUDY.json`, which says how they were made, and the
agents of all seeds, `data/agents/STUDY-VARIANT-SEED.safetensors`, with weights in float16. That of
seed 0 is shipped, too, where the list says so.

A study is of today's program if the golden arrays of the test suite, which every change of what is
computed changes, have the digest that they had when the study was recorded.
"""

import argparse
import io
import shlex
import shutil
import subprocess
import sys
import tomllib
from glob import escape
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch

from uavdh_lite.checkpoint import load, load_agent, save
from uavdh_lite.errors import InputError
from uavdh_lite.storage import read_json, read_table, write_json, write_table

ROOT = Path(__file__).parents[1]
RUNS, AGENTS = ROOT / "data" / "runs", ROOT / "data" / "agents"
SHIPPED = ROOT / "data" / "checkpoints"
GOLDEN = ROOT / "tests" / "unit" / "data" / "reference.npz"
PARTS = ("tables", "transitions", "starts", "observations", "learning")
# Of a run's `about.json`: what is told once for a study, and what each run has of its own
OF_STUDY = ("program", "version", "python", "torch", "numpy", "machine", "device", "threads")
OF_RUN = ("seed", "steps", "updates", "seconds")


def digest(commit: str = "") -> str:
    """Of the golden arrays that say what world and learning compute: 16 hexadecimal digits.

    Those of a commit, or of this working tree. Only their values count, in order: neither their
    types and axes, nor which of several cities a state is in where there is one alone.
    """
    found, content = sha256(), GOLDEN.read_bytes()
    if commit:
        call = ["git", "show", f"{commit}:{GOLDEN.relative_to(ROOT).as_posix()}"]
        content = subprocess.run(call, cwd=ROOT, capture_output=True, check=True).stdout
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        for name in sorted(arrays.files):
            values = arrays[name].ravel()
            alone = name.endswith("city") and not values.any()
            if name.partition("|")[0] in PARTS and not alone:
                wide = np.float32 if values.dtype.kind == "f" else np.int64
                content = values.tobytes() if values.dtype.kind == "U" else values.astype(wide)
                found.update(name.encode() + bytes(content))
    return found.hexdigest()[:16]


def studies() -> dict[str, dict]:
    """The list's entry of each study."""
    return _list()["studies"]


def _list() -> dict:
    return tomllib.loads((RUNS / "list.toml").read_text(encoding="utf-8"))


def state(study: str) -> str:
    """What keeps a study from being of today's program; empty if nothing does."""
    about = RUNS / f"{study}.json"
    if not about.exists():
        return "not recorded"
    made_by = read_json(about).get("golden", "")
    if made_by in (digest(), *_list().get("same", ())):
        return ""
    return f"made by another program, whose golden arrays are {made_by or 'not known'}"


def make(study: str, jobs: int = 1) -> None:
    """Run a study's command, which goes on where it was stopped, and record what it made.

    Raises `InputError` for a study that another program has begun.
    """
    entry, begun = studies()[study], ROOT / "runs" / study / "golden"
    if "runs" in entry:
        begun.parent.mkdir(parents=True, exist_ok=True)
        if not begun.exists():
            begun.write_text(digest())
        if begun.read_text() != digest():
            raise InputError(f"{begun.parent}: begun by another program: move it away")
    for line in entry["command"].split(" && "):
        command = shlex.split(line)
        if "runs" in entry and "--out" not in command:
            command += ["--out", f"runs/{study}"]
        if command[1:4] == ["-m", "uavdh_lite", "study"]:
            command += ["--jobs", str(jobs)]
        subprocess.run([sys.executable, *command[1:]], cwd=ROOT, check=True)
    if "runs" in entry:
        gather(study, ROOT / "runs" / study)
    else:
        about = RUNS / f"{study}.json"
        write_json(about, read_json(about) | {"golden": digest()})


def finished(run: Path, name: str, steps: int | None) -> dict:
    """What a run says of itself; `InputError` unless it is `NAME-SEED` with all of its steps."""
    how = read_json(run / "about.json")
    if run.name != f"{name}-{how['seed']}":
        raise InputError(f"{run}: is seed {how['seed']}: its folder must be {name}-{how['seed']}")
    if how["steps"] < (steps := steps or how["recipe"]["steps"]):
        raise InputError(f"{run}: has {how['steps']} of {steps} steps: let it go on to the end")
    return how


def gather(study: str, folder: Path, commit: str = "") -> None:
    """Record a study from its runs: every `NAME-SEED` in the folder, for each of its variants.

    Raises `InputError` that names a folder which is none of these or not finished, and if it is not
    known which program made them: neither is there a commit nor the folder's file `golden`.
    """
    entry, made_by = studies()[study], folder / "golden"
    if not commit and not made_by.exists():
        raise InputError(f"{folder}: which program made these runs? name it with --commit")
    golden = digest(commit) if commit else made_by.read_text()
    tables: dict[str, list[dict]] = {"validation": [], "training": []}
    about, recipes = {}, {}
    runs = [
        (variant, run, finished(run, name, entry.get("steps")))
        for variant, name in entry["runs"].items()
        for run in sorted(folder.glob(f"{escape(name)}-[0-9]*"))
    ]
    for variant, run, how in runs:  # all of them are finished
        about[f"{variant}-{how['seed']}"] = how
        recipes[variant] = how["recipe"]
        for table, rows in tables.items():
            columns = read_table(run / f"{table}.csv")
            for i in range(len(columns["steps"])):
                row = {"variant": variant, "seed": how["seed"]}
                rows.append(row | {key: _number(v[i]) for key, v in columns.items()})
        kept = []
        if entry.get("agents", True):
            kept.append(AGENTS / f"{study}-{variant}-{how['seed']}.safetensors")
        if "ships" in entry and how["seed"] == 0:
            kept.append(SHIPPED / f"{entry['ships']}.safetensors")
        if kept:
            rounded(run / "best.safetensors", kept[0])
        for other in kept[1:]:  # the same bytes
            shutil.copyfile(kept[0], other)
    if not about:
        raise InputError(f"{folder}: no runs {' or '.join(entry['runs'].values())}-SEED in it")
    first, usual = next(iter(about.values())), next(iter(recipes.values()))
    changed = {
        variant: recipe
        if recipe is usual
        else dict(x for x in recipe.items() if x not in usual.items())
        for variant, recipe in recipes.items()
    }
    # One session of `benchmarks/fleet.py` may make the runs of several studies
    command = first["command"].partition(" --out")[0] if "program" in first else entry["command"]
    write_table(RUNS / f"{study}.csv.gz", tables["validation"])
    write_table(RUNS / f"{study}-training.csv.gz", tables["training"])
    write_json(
        RUNS / f"{study}.json",
        {name: entry[name] for name in ("what", "begun") if name in entry}
        | {"command": command, "golden": golden}
        | {name: first[name] for name in OF_STUDY if name in first}
        | {"scenario": first["scenario"], "cities": first["cities"]}
        | {"runs": {name: {k: how[k] for k in OF_RUN} for name, how in about.items()}}
        | {"recipes": changed},
    )


def _number(value: float) -> float | int | None:
    """As it stands in the run's own table: None where that is empty, whole numbers as such."""
    value = float(value)
    return None if np.isnan(value) else int(value) if value.is_integer() else value


def rounded(source: Path, target: Path) -> None:
    """Copy an agent with its weights rounded to float16."""
    tensors, about = load(source, "agent")
    halved = {k: v.half() if v.is_floating_point() else v for k, v in tensors.items()}
    save(target, "agent", halved, about)
    load_agent(target)


def report() -> str:
    """A line for each study, and what is outstanding in all."""
    lines, hours = [], 0.0
    for study, entry in studies().items():
        because = "; ".join(filter(None, (entry.get("outstanding"), state(study))))
        hours += entry["core_hours"] if because else 0
        lines.append(f"{study}: {because or 'of today'} ({entry['core_hours']:g} core-hours)")
    return "\n".join([*lines, f"outstanding: {hours:g} core-hours"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--make", metavar="STUDY", choices=studies())
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--gather", nargs=2, metavar=("STUDY", "FOLDER"))
    parser.add_argument("--commit", default="", help="of the program that made the runs")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.make:
        make(options.make, options.jobs)
    if options.gather:
        gather(options.gather[0], Path(options.gather[1]), options.commit)
    print(report())
