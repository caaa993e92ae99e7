"""The walls around what students wrote: it runs apart, is called from here, and is judged here.

A notebook or a policy runs in a process of its own, in an empty folder. Readable are Python, this
package without the checks, and the policy's own file or folder; there is no network and nothing of
the course. That is done by bubblewrap, or by docker or podman with an image of the course.
"""

import builtins
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from uavdh_lite.course import given
from uavdh_lite.course.given import Unfit
from uavdh_lite.course.inside import MEMORY, NOBODY, PROCESSES, packed, received, sent, unpacked
from uavdh_lite.errors import InputError
from uavdh_lite.storage import data_folder

IMAGE = "uavdh_lite-students"
IN_IMAGE = "/usr/local/lib/python3.11/site-packages"  # where the image has this package
SCRATCH = 1 << 28  # bytes that a process may write, all in all
GRACE = 10  # seconds until what ignores an interrupt is ended
KEPT = 4096  # bytes of what a process says itself: the end, which says why it failed
PACKAGE = Path(__file__).parents[1]
NO_WALLS = (
    "nothing here keeps what students wrote apart: install bubblewrap (apt-get install bubblewrap),"
    f" or docker or podman and the image {IMAGE}. Without them a submission can read and change all"
    " your files, other students' work and the grade book included, and use the network; to run it"
    " all the same, say --unprotected"
)


class Lost(BaseException):
    """A process has ended, or had to be ended; the message says why."""


@cache
def program() -> str:
    """What keeps a process apart here; `InputError` if nothing does."""
    here = Path.cwd().resolve()
    if any(here.is_relative_to(place.resolve()) for place in _readable()):
        raise InputError(f"{here}: belongs to what submissions can read; work in another folder")
    for program in ("bwrap", "docker", "podman"):
        command = [*_command(program, "probe"), "-c", ""]
        with suppress(OSError, subprocess.TimeoutExpired):
            if subprocess.run(command, capture_output=True, timeout=60).returncode == 0:
                return program
    raise InputError(NO_WALLS)


def _readable() -> list[Path]:
    places = {Path("/usr"), Path(sys.prefix), Path(sys.base_prefix), PACKAGE, data_folder()}
    return sorted(places, key=lambda place: len(place.parts))


def _environment() -> dict[str, str]:
    values = {"HOME": "/tmp", "PATH": "/usr/bin:/bin", "PYTHONPATH": str(PACKAGE.parent)}
    values |= {"LANG": "C.UTF-8", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    return values | {"MPLCONFIGDIR": "/tmp/fonts", "WALLED": "yes"}


def _command(program: str, name: str, sheet: Path | None = None) -> list[str]:
    """The words before Python's own arguments."""
    if program == "bwrap":
        return _bubblewrap(sheet)
    command = [program, "run", "--rm", "--interactive", "--name", name, "--memory", str(MEMORY)]
    words = f"--network none --read-only --cap-drop ALL --pids-limit {PROCESSES} --tmpfs /tmp"
    words += f" --security-opt no-new-privileges --user {NOBODY}:{NOBODY} --workdir /tmp"
    command += [*words.split(), "--tmpfs", f"{IN_IMAGE}/uavdh_lite/course/checks"]
    if sheet:
        command += ["--volume", f"{sheet}:/sheet/{sheet.name}:ro"]
    for key, value in (_environment() | {"PYTHONPATH": IN_IMAGE}).items():
        command += ["--env", f"{key}={value}"]
    return [*command, IMAGE, "python"]


def _bubblewrap(sheet: Path | None) -> list[str]:
    words = ["bwrap --die-with-parent --new-session --clearenv --unshare-ipc --unshare-pid"]
    words += ["--unshare-net --unshare-uts --unshare-cgroup-try"]
    as_root = "--cap-add CAP_SETUID --cap-add CAP_SETGID"  # with which it becomes nobody
    words += [as_root if os.getuid() == 0 else "--unshare-user"]
    for path in ("/lib", "/lib64", "/bin", "/etc/ld.so.cache", "/etc/alternatives", "/etc/fonts"):
        words += [f"--ro-bind-try {path} {path}"]
    words += [f"--proc /proc --dev /dev --remount-ro /dev --size {SCRATCH} --perms 1777 --tmpfs"]
    words += ["/tmp --perms 0777 --dir /tmp/own --perms 0777 --dir /tmp/fonts --chdir /tmp/own"]
    command = " ".join(words).split()  # /tmp first: what is readable may be in it
    above = {parent for place in _readable() for parent in place.parents}  # /root may be closed
    for parent in sorted(above - {Path("/")}, key=lambda place: len(place.parts)):
        command += ["--perms", "0755", "--dir", str(parent)]
    for place in map(str, _readable()):
        command += ["--ro-bind", place, place]
    command += ["--tmpfs", str(PACKAGE / "course" / "checks")]
    if sheet:
        command += ["--perms", "0755", "--dir", "/sheet"]
        command += ["--ro-bind", str(sheet), f"/sheet/{sheet.name}"]
    for fonts in Path(matplotlib.get_cachedir()).glob("fontlist-*.json"):
        command += ["--ro-bind", str(fonts), f"/tmp/fonts/{fonts.name}"]  # it takes long to make
    for key, value in _environment().items():
        command += ["--setenv", key, value]
    return [*command, "--remount-ro", "/", sys.executable]


class Walled:
    """A process within the walls; use it in a `with` statement.

    Arguments:
        sheet: a file or folder of the student's that it may read.
        unprotected: whether it runs without walls, as whoever started it.

    Raises `InputError` if there are no walls here. What it is asked raises `Lost` once the process
    has ended, or had to be ended.
    """

    def __init__(self, sheet: Path | None = None, unprotected: bool = False):
        self.program = "" if unprotected else program()
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.name, self.sheet = f"walled-{secrets.token_hex(8)}", sheet
        self.said, self.late = bytearray(), False
        self.watch = threading.Timer(0, lambda: None)
        kept = ("PATH", "SYSTEMROOT", "PATHEXT")  # without which nothing starts on Windows
        environment = {key: os.environ[key] for key in kept if key in os.environ}
        if self.program:
            sheet = sheet and self._readable(sheet)
            command = _command(self.program, self.name, sheet)
            if self.program != "bwrap":  # which stays within as the first process, to be looked at
                environment = dict(os.environ)
            self.sheet = sheet and Path("/sheet", sheet.name)
        else:
            own = {"HOME": self.folder.name, "MPLCONFIGDIR": matplotlib.get_cachedir()}
            environment = _environment() | environment | own | {"WALLED": ""}
            command = [sys.executable]
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self.process = subprocess.Popen(
            [*command, "-m", "uavdh_lite.course.inside"],
            cwd=self.folder.name,
            env=environment,
            start_new_session=True,
            **pipes,  # type: ignore[call-overload]
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _readable(self, sheet: Path) -> Path:
        """A copy that anybody may read: within, whoever looks is nobody. Links stay links."""
        copy = Path(self.folder.name, sheet.name)
        if sheet.is_dir():
            shutil.copytree(sheet, copy, symlinks=True)
        else:
            shutil.copyfile(sheet, copy)
        for path in [copy, *copy.rglob("*")]:
            if not path.is_symlink():
                path.chmod(0o755 if path.is_dir() else 0o644)
        return copy

    def __enter__(self) -> "Walled":
        return self

    def __exit__(self, *error) -> None:
        self.watch.cancel()
        self._end()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                stream.close()  # type: ignore[union-attr]
        self.folder.cleanup()

    def _listen(self) -> None:
        with self.process.stderr as stream:  # type: ignore[union-attr]
            while part := stream.read1(KEPT):  # type: ignore[union-attr]
                self.said.extend(part)
                del self.said[:-KEPT]

    def begin(self, seconds: float) -> None:
        """What is asked from now on may take so long, all in all; then it is interrupted."""
        self.watch.cancel()
        self.ends = time.monotonic() + seconds
        self.watch = threading.Timer(seconds + GRACE, self._end)
        self.watch.daemon = True
        self.watch.start()

    def _end(self) -> None:
        self.late = True
        if self.program not in ("", "bwrap"):  # its own process is only a messenger
            subprocess.run([self.program, "kill", self.name], capture_output=True)
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, 9) if hasattr(os, "killpg") else self.process.kill()

    def ask(self, message: dict) -> dict:
        """Send a message and wait for the reply."""
        try:
            sent(self.process.stdin, message | {"seconds": self.ends - time.monotonic()})
            if isinstance(reply := received(self.process.stdout), dict) and reply:
                return reply
        except OSError:
            pass
        except Exception as error:  # whatever a hostile reply makes a parser say
            raise Lost(f"what it gives cannot be read ({type(error).__name__})") from None
        self.late = self.late or time.monotonic() > self.ends
        late = "it never ends, and cannot be interrupted"
        raise Lost(late if self.late else "it ended its own process")

    def answer(self, name: str) -> Any:
        """What has this name in the notebook: data, or a function that can be called from here."""
        reply = self.ask({"answer": name})
        if "value" in reply:
            return self._read(reply["value"])
        own = {f"__{what}__": str(reply.get(what)) for what in ("module", "name")}
        called = type("Called", (), {**own, "__call__": lambda _, *given: self.call(*given)})
        return called if reply.get("class") else called()

    def load(self, place: str, scenario: str) -> None:
        """Make a policy what `call` calls; see `challenge.score`."""
        self._called({"load": True}, (place, scenario))

    def call(self, *given, ask: str | None = None) -> Any:
        """Call the answer that was asked for last, or the policy, with data.

        Arguments:
            ask: the function of `given` that asks the answer, if it is not called itself.
        """
        return self._called({"ask": ask}, given)

    def _called(self, message: dict, given: tuple) -> Any:
        reply = self.ask(message | {"arguments": packed([*given])})
        said = str(reply.get("said", ""))[:KEPT]  # what steers a terminal is not for ours
        print("".join(c if c.isprintable() or c in "\n\t" else "�" for c in said), end="")
        for own, now in zip(given, self._read(reply.get("arguments", [])), strict=False):
            _follow(own, now)
        if "raised" in reply:
            raise _error(str(reply["raised"]), str(reply.get("text")), str(reply.get("where")))
        return self._read(reply.get("value"))

    def _read(self, value: Any) -> Any:
        try:
            return unpacked(value)
        except Exception as error:  # whatever a hostile reply makes of it
            raise Lost(f"what it gives cannot be read ({type(error).__name__})") from None


def _error(kind: str, text: str, where: str) -> BaseException:
    """An error like the one within; `where` is the line of the student's that it went through."""
    known = Unfit if kind == Unfit.__name__ else getattr(builtins, kind, None)
    fits = isinstance(known, type) and issubclass(known, Exception | KeyboardInterrupt)
    base: Any = known if fits else Exception
    own = {"__init__": lambda _: None, "__str__": lambda _: text, "where": where}
    return type(kind, (base,), own)()


def _follow(own: Any, now: Any) -> None:
    """Let an argument become what the function within has made of it."""
    with suppress(Exception):  # a hostile function may have sent anything
        if isinstance(own, list):
            own[:] = now
        elif isinstance(own, np.ndarray):
            own[...] = now
        elif isinstance(own, np.random.Generator):
            own.bit_generator.state = now.bit_generator.state
        elif hasattr(own, "copy_"):
            own.detach().copy_(now)


def judged(walled: Walled, exercise: Any, name: str, seconds: float) -> tuple[str, str]:
    """What an exercise prints about the answer of this name, and what is wrong with it, or ""."""
    from uavdh_lite.course.checks import CheckFailed

    said, wrong, stopped = StringIO(), "", []

    def stop(*_) -> None:  # Ctrl-C is not the answer's fault, as an exercise would believe
        stopped.append(True)
        raise KeyboardInterrupt

    walled.begin(seconds)
    before = signal.signal(signal.SIGINT, stop)
    try:
        answer = walled.answer(name)
        if exercise.ask.__module__ == given.__name__:  # it asks within the walls
            exercise = replace(exercise, ask=_ask_within(walled, answer, exercise.ask))
        with redirect_stdout(said):
            exercise(answer)
    except CheckFailed as failed:
        wrong = f"Not yet. {failed}"
    finally:
        signal.signal(signal.SIGINT, before)
    if stopped:
        raise KeyboardInterrupt
    return said.getvalue(), wrong


def _ask_within(walled: Walled, answer: Any, ask: Callable) -> Callable:
    """Asks the answer within the walls, and solution and mistakes here."""

    def asked(one, *case):
        return walled.call(*case, ask=ask.__name__) if one is answer else ask(one, *case)

    return asked
