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
from functools import partial
from glob import escape
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from uavdh_lite.checkpoint import load, load_agent, save
from uavdh_lite.cli.options import presets
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import require_own
from uavdh_lite.experiments.study import changes_of
from uavdh_lite.recipe import recipe_from_json
from uavdh_lite.storage import read_json, read_table, write_atomically, write_json, write_table
from uavdh_lite.training import judged

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
    entry, recorded = studies()[study], read_json(about)
    made_by, runs = recorded.get("golden", ""), recorded.get("runs", {})
    files = [RUNS / f"{study}{end}.csv.gz" for end in (["", "-training"] if runs else [""])]
    for name, how in runs.items():
        files += _agents(study, entry, name.rpartition("-")[0], how["seed"])
    if lost := [path.name for path in files if not path.exists()]:
        return f"recorded without {', '.join(lost)}"
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
        if not begun.exists() and not [*begun.parent.rglob("*.safetensors")]:
            begun.write_text(digest())
        if not begun.exists() or begun.read_text() != digest():
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


def finished(run: Path, variant: str, entry: dict) -> dict:
    """What a run says of itself; `InputError` unless it is `NAME-SEED` with all of its steps."""
    how, name, stop = read_json(run / "about.json"), entry["runs"][variant], entry.get("steps")
    if run.name != f"{Path(name).name}-{how['seed']}":
        raise InputError(f"{run}: is seed {how['seed']}: its folder must be {name}-{how['seed']}")
    steps = stop or how["recipe"]["steps"]
    if how["steps"] < steps or (stop and how["steps"] != stop):
        raise InputError(f"{run}: has {how['steps']} of {steps} steps: take one with all, no more")
    return how


def require_one_study(entry: dict, runs: list[tuple[str, Path, dict]]) -> None:
    """Raise `InputError` for a run that is not of the listed command, of the others, of its name.

    What `FIELD=VALUE` in its name says is in its recipe, and nothing else differs from the others
    that the same command made. With another name, it has the recipe of the others of its variant.
    """
    asked = [presets(shlex.split(line)) for line in entry["command"].split(" && ")]
    known = [(scenario.name, recipe.name) for scenario, recipe in asked]
    alike: dict[str, tuple[dict, dict]] = {}
    for variant, run, how in runs:
        name, recipe = entry["runs"][variant], how["recipe"]
        part, _, text = name.rpartition("/")
        changes = changes_of(text) if "=" in text else {}
        of_command = "=" in text or text == "as_it_is"
        usual, others = alike.setdefault(part if of_command else name, (recipe, changes))
        free = {*changes, *others}
        for what, right in (
            ("scenario and recipe", (how["scenario"]["name"], recipe["name"]) in known),
            ("number of threads", how["threads"] == 1),
            *((key, how[key] == runs[0][2][key]) for key in ("scenario", "cities")),
            *((key, recipe.get(key) == value) for key, value in changes.items()),
            *((key, recipe.get(key) == usual.get(key)) for key in {*recipe, *usual} - free),
        ):
            if not right:
                raise InputError(f"{run}: another {what} than its study has")


def gather(study: str, folder: Path, commit: str = "") -> None:
    """Record a study from its runs: every `NAME-SEED` in the folder, for each of its variants.

    Nothing is written before all is found right. Agents of seeds that are not among them go.

    Raises `InputError` that names a folder which is none of these, not finished or of another study
    or with another run's agent, and if it is not known which program made them: neither is there a
    commit nor the folder's file `golden`.
    """
    entry, made_by = studies()[study], folder / "golden"
    if not commit and not made_by.exists():
        raise InputError(f"{folder}: which program made these runs? name it with --commit")
    golden = digest(commit) if commit else made_by.read_text()
    runs = [
        (variant, run, finished(run, variant, entry))
        for variant, name in entry["runs"].items()
        for run in sorted(folder.glob(f"{escape(name)}-[0-9]*"))
    ]
    if not runs:
        raise InputError(f"{folder}: no runs {' or '.join(entry['runs'].values())}-SEED in it")
    require_one_study(entry, runs)
    tables: dict[str, list[dict]] = {"validation": [], "training": []}
    about, recipes, agents = {}, {}, {}
    with TemporaryDirectory() as made:
        for variant, run, how in runs:
            own = {table: _rows(run / f"{table}.csv") for table in tables}
            for table, rows in tables.items():
                rows += [{"variant": variant, "seed": how["seed"]} | row for row in own[table]]
            about[f"{variant}-{how['seed']}"], recipes[variant] = how, how["recipe"]
            if kept := _agents(study, entry, variant, how["seed"]):
                best, copy = run / "best.safetensors", Path(made, f"{len(agents)}.safetensors")
                scores = judged(recipe_from_json(how["recipe"]), own["training"], own["validation"])
                top = [steps for steps, score in scores.items() if score == max(scores.values())]
                require_own(best, how | {"steps": np.inf}, set(top or [how["steps"]]))
                rounded(best, copy)
                agents |= dict.fromkeys(kept, copy)
        for path, copy in agents.items():
            write_atomically(path, partial(shutil.copyfile, copy))
    for variant in entry["runs"]:
        for path in AGENTS.glob(f"{escape(f'{study}-{variant}')}-[0-9]*.safetensors"):
            if path not in agents:
                path.unlink()
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


def _agents(study: str, entry: dict, variant: str, seed: int) -> list[Path]:
    """The files that the agent of a run is kept in."""
    kept = [AGENTS / f"{study}-{variant}-{seed}.safetensors"] if entry.get("agents", True) else []
    if "ships" in entry and seed == 0:
        kept.append(SHIPPED / f"{entry['ships']}.safetensors")
    return kept


def _rows(path: Path) -> list[dict]:
    columns = read_table(path)
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, map(_number, row), strict=True)) for row in rows]


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
