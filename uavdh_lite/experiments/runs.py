"""A training run in a folder: progress, CSV files, checkpoints, Ctrl-C and resume."""

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

from filelock import FileLock, Timeout
from tqdm.auto import tqdm

from uavdh_lite.checkpoint import save_agent
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.experiments.tensorboard import Board, writer_type
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.training import BIN, Trainer

SAVED = "training.safetensors"


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
    | `about.json` | command, seed, recipe, seconds, machine, versions, the last validation |
    | `tensorboard/` | with `tensorboard`, the rows of both tables as event files |
    | `lock` | held during the run, so that no other process writes here |

    A run that was killed continues with `resume=True`, and ends with the same weights as one that
    was not. Ctrl-C saves the run, then raises `KeyboardInterrupt`. With `stop_after` the run is
    saved and stopped after that many environment steps.

    Raises `InputError` if the folder holds a run and `resume` is False, or none and it is True, or
    if another process is training there; `MissingExtra` if TensorBoard is asked for and not
    installed; `TrainingDiverged` if the loss or a weight is no longer finite, with the files as
    they were at the last validation.
    """
    out = Path(out)
    if tensorboard:
        writer_type()  # a refused run leaves no folder behind
    if resume and not (out / SAVED).exists():
        raise InputError(f"{out}: no run to resume there; leave out --resume to start one")
    out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(out / "lock", timeout=0):
            return _train(trainer, out, resume, command, show_progress, stop_after, tensorboard)
    except Timeout:
        raise InputError(
            f"{out}: another process is training there; choose another folder"
        ) from None


def _train(
    trainer: Trainer,
    out: Path,
    resume: bool,
    command: str,
    show_progress: bool,
    stop_after: int | None,
    tensorboard: bool,
) -> Path:
    saved = out / SAVED
    if not resume and saved.exists():
        raise InputError(f"{out}: holds a run already; add --resume, or choose another folder")
    if resume:
        trainer.restore(saved)
    keep_freed_memory()
    total = trainer.recipe.steps
    end = total if stop_after is None else min(total, stop_after)
    board = Board(out / "tensorboard", trainer) if tensorboard else None
    progress = tqdm(
        total=total,
        initial=trainer.steps,
        unit="step",
        unit_scale=True,
        disable=not show_progress,
    )
    board_closed = closing(board) if board else nullcontext()
    with closing(trainer), progress, board_closed, _deferred_interrupt() as interrupted:
        while trainer.steps < end:
            started, before = time.perf_counter(), trainer.steps
            trainer.step()
            trainer.seconds += time.perf_counter() - started
            progress.update(min(trainer.steps, total) - min(before, total))
            interval = trainer.recipe.validation_interval
            validates = trainer.steps // interval > before // interval or trainer.finished
            reports = trainer.steps // BIN > before // BIN or trainer.finished
            stops = interrupted()  # asked once a step: nothing is saved that was not checked
            if validates or reports or stops:
                _require_finite(trainer, out)
            if validates:
                _validate(trainer, out, command)
            if reports:
                progress.set_postfix_str(_status(trainer))
            if board and (validates or reports):
                board.write()
            if stops:
                trainer.save(saved)
                _say_stopped(trainer)
                raise KeyboardInterrupt
        if not trainer.finished:
            trainer.save(saved)
            _say_stopped(trainer)
    return out / "best.safetensors"


def _say_stopped(trainer: Trainer) -> None:
    print(f"\nstopped after {trainer.steps} steps; add --resume to continue", flush=True)


def _require_finite(trainer: Trainer, out: Path) -> None:
    if not trainer.is_finite():
        kept = out / SAVED
        state = f"the last good state is {kept}" if kept.exists() else "nothing was saved yet"
        raise TrainingDiverged(
            f"the loss or a weight is not finite after {trainer.steps} steps: {state}. "
            "Start again with a lower learning rate or smaller rewards"
        )


def keep_freed_memory() -> None:
    """Ask the C library to keep memory that is freed, for the whole process (Linux with glibc).

    Otherwise it gives the memory of each minibatch's maps back to the system and asks for it again,
    page by page, which takes a fifth of the training time. Elsewhere this does nothing.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        trim_threshold, mmap_threshold, limit = -1, -3, 1 << 30
        mallopt(mmap_threshold, limit)
        mallopt(trim_threshold, limit)


def _validate(trainer: Trainer, out: Path, command: str) -> None:
    started = time.perf_counter()
    is_best = trainer.validate()
    trainer.seconds += time.perf_counter() - started
    agent = trainer.agent
    agent.training["command"] = command
    if is_best:
        save_agent(out / "best.safetensors", agent)
    if trainer.training_rows:
        write_table(out / "training.csv", trainer.training_rows)
    write_table(out / "validation.csv", trainer.validation_rows)
    write_json(out / "about.json", agent.training | trainer.identity())
    trainer.save(out / SAVED)


def _status(trainer: Trainer) -> str:
    """The newest metrics: of training episodes, and of the last greedy validation."""
    rows = {"training": trainer.training_rows, "validation": trainer.validation_rows}
    return "; ".join(
        f"{name}: landed {row[-1]['has_landed']:.1%}, "
        f"collected and landed {row[-1]['collection_ratio_and_landed']:.1%}"
        for name, row in rows.items()
        if row and row[-1]["has_landed"] is not None
    )


@contextmanager
def _deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Only note a Ctrl-C, so that no step is cut in two; yields a function that says if one came.

    A second Ctrl-C interrupts at once. Threads other than the main one cannot catch signals, and
    get no Ctrl-C either.
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
