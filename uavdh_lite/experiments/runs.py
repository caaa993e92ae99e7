"""A training run in a folder: validations, progress, CSV files, checkpoints, Ctrl-C and resume."""

import ctypes
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path

import torch
from filelock import FileLock, Timeout
from tqdm.auto import tqdm

from uavdh_lite.bridges.tensorboard import Board
from uavdh_lite.checkpoint import load, save, save_agent
from uavdh_lite.city import fingerprint_of
from uavdh_lite.errors import CheckpointError, InputError, TrainingDiverged
from uavdh_lite.experiments.stopping import deferred_stop
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.training import Trainer

SAVED = "training.safetensors"
RESULTS = ("best.safetensors", "training.csv", "validation.csv")
STUDY = ("training.csv.gz", "validation.csv.gz")  # what a study leaves in its own folder
SAVE_SECONDS = 600  # a run that is killed loses no more than this
LOCK_SECONDS = 10  # what a process that was told to stop may take for it


def train(
    trainer: Trainer,
    out: str | Path,
    resume: bool = False,
    command: str = "",
    show_progress: bool = True,
    stop_after: int | None = None,
    tensorboard: bool = False,
    stop: Callable[[], bool] = lambda: False,
) -> Path:
    """Run a training to its end, with progress; returns the path of the best agent.

    The folder `out` gets the best agent so far, tables of the training and of the validations,
    `about.json` and what is needed to resume; the reference lists them under file formats. They are
    written at each validation, and when there is a better agent; what is needed to resume, every
    ten minutes as well.

    A run that was killed continues with `resume=True`, and ends with the same weights as one that
    was not; if nothing was saved yet, it begins. Ctrl-C and SIGTERM save the run, then raise
    `KeyboardInterrupt`. With `stop_after` the run is saved and stopped after that many environment
    steps.

    Arguments:
        stop: asked before each step; a run for which it is true stops as by Ctrl-C.

    Raises `InputError` if the folder holds a study, if it holds a run and `resume` is False, or
    another one, its agent, or only a part of one, and it is True, or if another process is training
    there; `MissingExtra` if TensorBoard is asked for and not installed; `TrainingDiverged` if the
    loss or a weight is no longer finite, with the files as they were when they were last written.
    """
    out, saved, recipe = Path(out), Path(out) / SAVED, trainer.recipe
    require_whole(out, resume)
    keep_freed_memory()
    end = min(recipe.steps, stop_after or recipe.steps)
    with locked(out):
        for path in out.glob(".*.unfinished*"):  # of writes that were killed
            path.unlink()
        if saved.exists():
            resume_run(out, trainer)
        board = Board(out / "tensorboard", trainer) if tensorboard else None
        if not saved.exists():
            save_run(saved, trainer)
            _write_results(trainer, out, command)
        progress = tqdm(total=recipe.steps, unit="step", unit_scale=True, disable=not show_progress)
        progress.update(min(trainer.steps, recipe.steps))
        kept = time.monotonic()
        with progress, closing(board) if board else nullcontext(), deferred_stop() as asked:
            while trainer.steps < end and not asked() and not stop():
                to_keep = trainer.advance()
                if to_keep or time.monotonic() - kept > SAVE_SECONDS:
                    _require_finite(trainer, saved)
                    if to_keep:
                        progress.set_postfix_str(_write_results(trainer, out, command))
                    if board:
                        board.write()
                    save_run(saved, trainer)  # last: from an earlier state, all is written again
                    kept = time.monotonic()
                progress.update(min(trainer.steps, recipe.steps) - progress.n)
            if not trainer.finished:
                _require_finite(trainer, saved)
                save_run(saved, trainer)
        if not trainer.finished and show_progress:
            print(f"\nstopped after {trainer.steps} steps; add --resume to continue", flush=True)
        if not trainer.finished and (asked() or stop()):
            raise KeyboardInterrupt
    return out / "best.safetensors"


def require_whole(out: Path, resume: bool) -> None:
    """Refuse a folder that holds a run which is not to be continued, or only a part of one."""
    if (out / STUDY[0]).exists():
        raise InputError(f"{out}: holds a study; choose another folder")
    there = [name for name in (SAVED, *RESULTS) if (out / name).exists()]
    if there and not resume:
        raise InputError(f"{out}: holds a run already; add --resume, or choose another folder")
    if there and SAVED not in there:
        raise InputError(
            f"{out}: holds a run without its {SAVED}, so it cannot go on; put the file back, or "
            "choose another folder"
        )


@contextmanager
def locked(out: Path, seconds: float | None = None) -> Iterator[None]:
    """Keep other processes out of the folder, which is made if need be.

    Arguments:
        seconds: how long to wait for one that is there, by default `LOCK_SECONDS`.
    """
    out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(out / "lock", timeout=LOCK_SECONDS if seconds is None else seconds):
            yield
    except Timeout:
        raise InputError(f"{out}: another process is training there; choose another") from None


def _write_results(trainer: Trainer, out: Path, command: str) -> str:
    """Write the tables and, if it is the best so far, the agent; the newest result in words."""
    agent = trainer.agent
    training = agent.training | {"command": command}
    if trainer.is_best:
        save_agent(out / "best.safetensors", replace(agent, training=training))
    tables = {"training": trainer.training_rows, "validation": trainer.validation_rows}
    for name, rows in tables.items():
        if rows:
            write_table(out / f"{name}.csv", rows)
    write_json(out / "about.json", training | identity(trainer))
    if not trainer.validation_rows:
        return ""
    newest = trainer.validation_rows[-1]
    return f"landed {newest['landed']:.1%}, return {newest['return']:.1f}"


def save_run(path: Path, trainer: Trainer) -> None:
    """Write everything a training needs to go on as if it had never stopped."""
    tensors, values = trainer.state_dict()
    save(path, "training", tensors, identity(trainer) | values)


def restore_run(path: Path, trainer: Trainer) -> None:
    """Let a training go on from what `save_run` wrote.

    Raises `InputError` if that is another training, and `CheckpointError` if it does not fit.
    """
    tensors, values = load(path, "training")
    cities = fingerprint_of(trainer.environment.cities)
    if values.get("cities") == cities and "scenario" in values:  # whatever file they are in
        trainer.scenario = replace(trainer.scenario, city=values["scenario"]["city"])
    for name, asked in identity(trainer).items():
        saved = values.get(name)
        if saved == asked:
            continue
        if name == "cities":  # fingerprints, which tell a reader nothing
            raise InputError(f"{path}: its cities have other cells")
        if isinstance(saved, dict):
            name = next(key for key in {**saved, **asked} if saved.get(key) != asked.get(key))
            saved, asked = saved.get(name), asked.get(name)
        raise InputError(f"{path}: another {name} than asked for: {saved} there, {asked} here")
    try:
        trainer.load_state_dict(tensors, values)
    except (ValueError, LookupError, RuntimeError, TypeError) as error:
        raise CheckpointError(
            f"{path}: altered, or saved by another version of the program ({error!r}); "
            "continue it with the version that saved it, or start again in another folder"
        ) from None


def resume_run(out: Path, trainer: Trainer) -> None:
    """Let a training go on from its folder: `restore_run` and `require_own`."""
    restore_run(out / SAVED, trainer)
    run = identity(trainer) | {"steps": trainer.steps}
    require_own(out / "best.safetensors", run, {trainer.best_steps})


def require_own(best: Path, run: dict, after: set[int | None]) -> None:
    """Raise `InputError` unless a run's best agent is there, if it has one, and not another's.

    One of more steps than the run is its own: killed before it was saved, it makes that one again.

    Arguments:
        run: its `identity`, and its `steps`.
        after: the steps after which its agent was the best; None for a run that has none yet.
    """
    if after == {None} and not best.exists():
        return
    kept = load(best, "agent")[1] if best.exists() else {}
    kept |= kept.get("training", {})
    same = all(kept.get(name) == run[name] for name in ("recipe", "scenario", "seed"))
    if not same or (kept["steps"] <= run["steps"] and kept["steps"] not in after):
        raise InputError(
            f"{best}: not the best agent of this run: put that back, or choose another folder"
        )


def identity(trainer: Trainer) -> dict:
    """What defines a run: recipe, scenario, cities, seed, device and threads, as JSON values.

    A saved run can only go on as this one if all of it is equal. On another device, or with another
    number of threads, rounding is different, and soon the weights are.
    """
    values = {
        "recipe": trainer.recipe.as_json(),
        "scenario": asdict(trainer.scenario),
        "cities": fingerprint_of(trainer.environment.cities),
        "seed": trainer.seed,
        "device": trainer.device,
        "threads": torch.get_num_threads(),
    }
    return json.loads(json.dumps(values))  # tuples become lists, as in a file


def _require_finite(trainer: Trainer, saved: Path) -> None:
    if not trainer.is_finite():
        raise TrainingDiverged(
            f"the loss or a weight is not finite after {trainer.steps} steps: the last good state "
            f"is {saved}. Start again elsewhere with a lower learning rate or smaller rewards"
        )


def keep_freed_memory() -> None:
    """Ask the C library to keep memory that is freed, for the whole process (Linux with glibc).

    Otherwise it gives the memory of each minibatch's maps back to the system and asks for it again,
    page by page, which takes a tenth of the training time. Elsewhere this does nothing.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        trim_threshold, mmap_threshold, limit = -1, -3, 1 << 30
        mallopt(mmap_threshold, limit)
        mallopt(trim_threshold, limit)
