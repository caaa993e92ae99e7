"""A training run in a folder: validations, progress, CSV files, checkpoints, Ctrl-C and resume."""

import ctypes
import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

import numpy as np
import torch
from filelock import FileLock, Timeout
from tqdm.auto import tqdm

from uavdh_lite.checkpoint import save_agent
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.evaluation import evaluate
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use
from uavdh_lite.training import Trainer

SAVED = "training.safetensors"
VALIDATION_SEED = 0


def train(
    trainer: Trainer,
    out: str | Path,
    resume: bool = False,
    command: str = "",
    show_progress: bool = True,
    stop_after: int | None = None,
    tensorboard: bool = False,
) -> Path:
    """Run a training to its end, with progress; returns the path of the best agent.

    In the folder `out`:

    | file | content |
    | --- | --- |
    | `best.safetensors` | the agent with the highest return in validation so far: the result |
    | `training.safetensors` | everything needed to resume, written at each validation |
    | `training.csv` | a row for every 5000 environment steps: ordinary training episodes |
    | `validation.csv` | a row for each greedy validation |
    | `about.json` | command, seed, recipe, seconds, threads, machine, the last validation |
    | `tensorboard/` | with `tensorboard`, the rows of both tables as event files |
    | `lock` | held during the run, so that no other process writes here |

    A run that was killed continues with `resume=True`, and ends with the same weights as one that
    was not. Ctrl-C saves the run, then raises `KeyboardInterrupt`. With `stop_after` the run is
    saved and stopped after that many environment steps.

    Raises `InputError` if the folder holds a run and `resume` is False, or none or another one and
    it is True, or if another process is training there; `MissingExtra` if TensorBoard is asked for
    and not installed; `TrainingDiverged` if the loss or a weight is no longer finite, with the
    files as they were at the last validation.
    """
    out, saved, recipe = Path(out), Path(out) / SAVED, trainer.recipe
    if resume and not saved.exists():
        raise InputError(f"{out}: no run to resume there; leave out --resume to start one")
    if not resume and saved.exists():
        raise InputError(f"{out}: holds a run already; add --resume, or choose another folder")
    keep_freed_memory()
    end, interval = min(recipe.steps, stop_after or recipe.steps), recipe.validation_interval
    with _locked(out):
        if resume:
            _restore(trainer, out)
        else:
            _write_about(trainer, out, command)
        progress = tqdm(total=recipe.steps, unit="step", unit_scale=True, disable=not show_progress)
        events = closing(_board(trainer, out)) if tensorboard else nullcontext()
        with progress, events as board, _deferred_interrupt() as interrupted:
            while trainer.steps < end and not interrupted():
                started, before = time.perf_counter(), trainer.steps
                trainer.step()
                trainer.seconds += time.perf_counter() - started
                if trainer.finished or trainer.steps // interval > before // interval:
                    _require_finite(trainer, saved)
                    progress.set_postfix_str(_validate(trainer, out, command))
                    if board:
                        board.write()
                progress.update(min(trainer.steps, recipe.steps) - progress.n)
        if not trainer.finished:
            _require_finite(trainer, saved)
            trainer.save(saved)
            print(f"\nstopped after {trainer.steps} steps; add --resume to continue", flush=True)
        if interrupted():
            raise KeyboardInterrupt
    return out / "best.safetensors"


@contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Keep other processes out of the folder, which is made if need be."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(out / "lock", timeout=0):
            yield
    except Timeout:
        raise InputError(f"{out}: another process is training there; choose another") from None


def _restore(trainer: Trainer, out: Path) -> None:
    """Go on where the run was saved; if it is another run, the error says how that was begun."""
    try:
        trainer.restore(out / SAVED)
    except InputError as error:
        command = json.loads((out / "about.json").read_text())["command"]
        raise InputError(f"{error}. That run was begun by: {command}") from None


def _board(trainer: Trainer, out: Path):
    from uavdh_lite.bridges.tensorboard import Board  # an extra

    return Board(out / "tensorboard", trainer)


def validate(trainer: Trainer) -> bool:
    """Fly the validation scenarios greedily; whether the agent has its highest return so far.

    The means become a row of `trainer.validation_rows`. The return has the constants of
    `Rewards()`, whatever the agent learns from.
    """
    flights = evaluate(
        trainer.environment,
        trainer.agent,
        trainer.scenario,
        trainer.recipe.validation_episodes,
        VALIDATION_SEED,
        Use.VALIDATION,
    )
    means = {name: float(values.mean()) for name, values in flights.records().items()}
    best = max((row["return"] for row in trainer.validation_rows), default=-np.inf)
    trainer.validation_rows.append(trainer.done | means)
    return means["return"] > best


def _validate(trainer: Trainer, out: Path, command: str) -> str:
    """Validate, and write all files; returns the newest result in words."""
    started = time.perf_counter()
    is_best = validate(trainer)
    trainer.seconds += time.perf_counter() - started
    agent = trainer.agent
    agent.training.update(_write_about(trainer, out, command))
    if is_best:
        save_agent(out / "best.safetensors", agent)
    if trainer.training_rows:
        write_table(out / "training.csv", trainer.training_rows)
    write_table(out / "validation.csv", trainer.validation_rows)
    trainer.save(out / SAVED)
    newest = trainer.validation_rows[-1]
    return f"landed {newest['landed']:.1%}, return {newest['return']:.1f}"


def _write_about(trainer: Trainer, out: Path, command: str) -> dict:
    """Write how the run is made; returns it without what defines the run."""
    how = {"command": command, "threads": torch.get_num_threads()}
    training = trainer.agent.training | how
    write_json(out / "about.json", training | trainer.identity())
    return training


def _require_finite(trainer: Trainer, saved: Path) -> None:
    if not trainer.is_finite():
        state = f"the last good state is {saved}" if saved.exists() else "nothing was saved yet"
        raise TrainingDiverged(
            f"the loss or a weight is not finite after {trainer.steps} steps: {state}. "
            "Start again with a lower learning rate or smaller rewards"
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


@contextmanager
def _deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Only note a Ctrl-C, so that no step is cut in two; yields a function that says if one came.

    A second Ctrl-C interrupts at once. Only the main thread can catch signals, or gets a Ctrl-C.
    """
    noted = threading.Event()

    def note(signum, frame):
        if noted.is_set():
            raise KeyboardInterrupt
        noted.set()
        print("\nstopping after this step; Ctrl-C again stops at once", file=sys.stderr, flush=True)

    if threading.current_thread() is not threading.main_thread():
        yield noted.is_set
        return
    previous = signal.signal(signal.SIGINT, note)
    try:
        yield noted.is_set
    finally:
        signal.signal(signal.SIGINT, previous)
