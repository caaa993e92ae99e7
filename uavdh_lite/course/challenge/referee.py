"""Flies a submission that runs in a process of its own, with limits of time and memory.

The simulator stays on this side: the submission sees states and answers with actions, so that
nothing it does in its process can change a flight. This is no sandbox: it runs as the user who
started it and can read that user's files. Run code of strangers in a container.
"""

import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotYet
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from types import TracebackType

import numpy as np

from uavdh_lite.course.challenge.wire import receive, send
from uavdh_lite.environment import ACTIONS, State
from uavdh_lite.errors import extra

with extra("classroom"):
    import psutil

LOOK = 0.05  # seconds between looks at time and memory


class SubmissionFailed(Exception):
    """A submission crashed, hung, answered nonsense or used too much; the message says which."""


class Submission:
    """The policy of a file, in a process of its own: `with Submission(...) as policy`.

    Arguments:
        path: a checkpoint (.safetensors) or a Python file with `policy(environment, state)`.
        city: the city's name or PNG.
        seconds: that the process may live. memory_mb: resident memory that it may use.

    Raises `SubmissionFailed` from any call that the process does not answer properly.
    """

    def __init__(self, path: Path, city: str, seconds: float = 300, memory_mb: float = 2000):
        self.path, self.city = path.resolve(), city
        self.seconds, self.memory_mb = seconds, memory_mb

    def __enter__(self) -> "Submission":
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._stderr = open(Path(self._folder.name, "stderr"), "w+b")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "uavdh_lite.course.challenge.pilot", str(self.path), self.city],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            cwd=self._folder.name,
            env=_environment(),
        )
        assert self._process.stdin and self._process.stdout  # both are pipes
        self._to, self._from = self._process.stdin, self._process.stdout
        self._watched = psutil.Process(self._process.pid)
        self._deadline = time.monotonic() + self.seconds
        self._thread = ThreadPoolExecutor(1)
        try:
            self._wait(self._thread.submit(receive, self._from))
        except SubmissionFailed:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        _kill(self._watched)
        self._process.wait()
        self._thread.shutdown()  # its read has ended with the process
        self._from.close()
        with suppress(OSError):  # what was not sent any more
            self._to.close()
        self._stderr.close()
        self._folder.cleanup()

    def __call__(self, state: State) -> np.ndarray:
        """The actions that the submission answers for these states; (B,) ints."""
        answer = self._wait(self._thread.submit(self._ask, state))
        action = answer.get("action")
        if action is None or action.shape != (len(state),) or action.dtype.kind not in "iu":
            found = "nothing" if action is None else f"{action.dtype} of shape {action.shape}"
            raise SubmissionFailed(
                f"answered {found} for {len(state)} states: expected as many whole numbers"
            )
        if action.min() < 0 or action.max() >= len(ACTIONS):
            raise SubmissionFailed(
                f"answered an action of {action.min()} or {action.max()}: "
                f"they go from 0 to {len(ACTIONS) - 1}"
            )
        return action

    def _ask(self, state: State) -> dict[str, np.ndarray]:
        send(self._to, **{f.name: getattr(state, f.name) for f in fields(State)})
        return receive(self._from)

    def _wait(self, future: Future) -> dict[str, np.ndarray]:
        """The answer, unless the process exceeds a limit or ends before."""
        while True:
            try:
                return future.result(timeout=LOOK)
            except NotYet:
                pass
            except (EOFError, OSError):
                raise SubmissionFailed(f"stopped: {self._last_words()}") from None
            except ValueError as error:
                raise SubmissionFailed(f"wrote into the referee's messages: {error}") from None
            if time.monotonic() > self._deadline:
                _kill(self._watched)
                raise SubmissionFailed(f"took more than {self.seconds:g} s")
            if (used := _memory_mb(self._watched)) > self.memory_mb:
                _kill(self._watched)
                raise SubmissionFailed(f"used {used:.0f} MB, more than {self.memory_mb:g}")

    def _last_words(self) -> str:
        """The last line that the process wrote to stderr, or its exit status."""
        status = self._process.wait()
        self._stderr.seek(0)
        lines = self._stderr.read().decode(errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else f"exit status {status}"


def _environment() -> dict[str, str]:
    """The variables that the process gets: one thread, and this library wherever it lies."""
    library = str(Path(__file__).parents[3])
    path = os.pathsep.join(filter(None, [library, os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}


def _family(process: psutil.Process) -> list[psutil.Process]:
    try:
        return [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def _memory_mb(process: psutil.Process) -> float:
    total = 0
    for one in _family(process):
        try:
            total += one.memory_info().rss
        except psutil.NoSuchProcess:
            continue
    return total / 2**20


def _kill(process: psutil.Process) -> None:
    """End the process and all that it started."""
    for one in _family(process):
        try:
            one.kill()
        except psutil.NoSuchProcess:
            continue
