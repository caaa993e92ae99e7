"""Inside the walls: runs what students wrote, and calls it when the other side asks.

It is started by `walls`, in a process that knows neither solutions nor marks. Both sides talk
through a pipe, in JSON: numbers, texts, lists, arrays, generators; nothing that could run.
"""

import base64
import importlib
import io
import json
import os
import runpy
import signal
import sys
import traceback
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MEMORY, PROCESSES, FILE = 6 << 30, 128, 64 << 20  # bytes, processes and threads, bytes of a file
LONGEST = 64 << 20  # bytes of a message
PRINTED = 100_000  # characters of a cell that are kept
NOBODY = 65_534
CHECKS = "uavdh_lite.course.checks"


class CannotTravel(BaseException):
    """A value that is no data; no `Exception`, because no answer is to blame."""


class Untold:
    """Something that a student's function gave and that cannot travel: only its text is known."""

    def __init__(self, text: str):
        self.text = text

    def __repr__(self) -> str:
        return self.text


def packed(value: Any) -> Any:
    """A value as JSON has it; `CannotTravel` if it is no data."""
    if value is None or value is ...:
        return None
    if type(value) in (bool, int, float, str):
        return value
    if isinstance(value, str):
        return str(value)
    if type(value) is list:
        return [packed(part) for part in value]
    if isinstance(value, tuple):
        return {"tuple": [packed(part) for part in value]}
    if isinstance(value, dict):
        return {"dict": [[packed(part) for part in pair] for pair in value.items()]}
    if hasattr(value, "detach"):
        return packed(value.detach().cpu().numpy()) | {"tensor": bool(value.requires_grad)}
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufcU":
        content = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        one = {"array": content, "dtype": value.dtype.str, "shape": list(value.shape)}
        return one | {"fixed": not value.flags.writeable, "single": isinstance(value, np.generic)}
    if isinstance(value, np.random.Generator):
        return {"generator": packed(value.bit_generator.state)}
    if is_dataclass(value) and type(value).__module__.startswith("uavdh_lite."):
        own = {f.name: packed(getattr(value, f.name)) for f in fields(value) if f.init}
        return {"class": f"{type(value).__module__}:{type(value).__qualname__}", "fields": own}
    raise CannotTravel(f"a {type(value).__name__}")


def unpacked(value: Any, within: bool = False) -> Any:
    """What `packed` made JSON of.

    Only within the walls are the library's own classes made, too.
    """
    if isinstance(value, list):
        return [unpacked(part, within) for part in value]
    if not isinstance(value, dict):
        return value
    if "tuple" in value:
        return tuple(unpacked(value["tuple"], within))
    if "dict" in value:
        return {unpacked(key, within): unpacked(part, within) for key, part in value["dict"]}
    if "array" in value:
        dtype = np.dtype(str(value["dtype"]))
        if dtype.kind not in "biufcU":
            raise ValueError(f"an array of {dtype}")
        content = bytearray(base64.b64decode(value["array"]))
        array = np.frombuffer(content, dtype).reshape(value["shape"])
        array.flags.writeable = not value["fixed"]
        if "tensor" in value:
            torch = importlib.import_module("torch")
            return torch.from_numpy(array.copy()).requires_grad_(value["tensor"])
        return array[()] if value["single"] else array
    if "generator" in value:
        state = unpacked(value["generator"])
        generator = np.random.default_rng()
        generator.bit_generator.state = state
        return generator
    if "class" in value and within:
        module, name = value["class"].split(":")
        own = {key: unpacked(part) for key, part in value["fields"].items()}
        return getattr(importlib.import_module(module), name)(**own)
    return Untold(str(value.get("untold"))[:200])


def sent(stream: BinaryIO, message: dict) -> None:
    """Write a message into a pipe."""
    content = json.dumps(message).encode()
    stream.write(len(content).to_bytes(8, "big") + content)
    stream.flush()


def received(stream: BinaryIO) -> dict | None:
    """The next message of a pipe; None at its end, `ValueError` if it is too long or none."""
    size = int.from_bytes(stream.read(8), "big")
    if size > LONGEST:
        raise ValueError(f"it gives more than {LONGEST >> 20} MB at once")
    message = json.loads(stream.read(size) or "null")
    if not isinstance(message, dict | None):
        raise ValueError("it gives no message")
    return message


@contextmanager
def _timed(seconds: float) -> Iterator[None]:
    """Interrupts what runs for too long; who ignores that is ended by the other side."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, max(seconds, 0.001))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _asked(function: Callable, message: dict) -> dict:
    """Call a student's function: what it gives or raises, prints, and makes of its arguments."""
    said = io.StringIO()
    arguments = unpacked(message["arguments"], within=True)
    try:
        with redirect_stdout(said), _timed(message["seconds"]):
            given = function(*arguments)
        try:
            reply = {"value": packed(given)}
        except (Exception, CannotTravel):
            reply = {"value": _untold(given)}
    except BaseException as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if _is_own(f)]
        where = f", in line {own[-1].lineno}, `{own[-1].line}`" if own else ""
        reply = {"raised": type(error).__name__, "text": str(error)[:2000], "where": where}
    with suppress(Exception, CannotTravel):
        reply["arguments"] = packed(arguments)
    return reply | {"said": said.getvalue()[:PRINTED]}


def _is_own(frame: traceback.FrameSummary) -> bool:
    places = (str(Path(__file__).parents[1]), sys.prefix, sys.base_prefix, "<frozen")
    return bool(frame.line) and not frame.filename.startswith(places)


def _shell():
    """IPython without a terminal, which keeps errors instead of printing them."""
    from IPython.core.interactiveshell import InteractiveShell

    class Shell(InteractiveShell):
        def enable_gui(self, gui=None):
            """Figures are shown inline, for which nothing has to be done."""

        def _showtraceback(self, kind, value, lines):
            self.errors.append([kind.__name__, str(value)[:2000], [*map(str, lines)]])

    return Shell.instance(history_length=0, cache_size=0)


def _run(shell, source: str, seconds: float) -> dict:
    """Run a cell: what it printed, its figures as PNG, and its errors."""
    from IPython.utils.capture import capture_output

    shell.errors = []
    with capture_output() as captured, _timed(seconds):
        result = shell.run_cell(source)
    if not result.success and not shell.errors:
        shell.errors.append(["Error", str(result.error_in_exec)[:2000], []])
    shown = [output.data for output in captured.outputs]
    figures = [data["image/png"] for data in shown if "image/png" in data]
    figures = [f if isinstance(f, str) else base64.b64encode(f).decode() for f in figures]
    texts = [data.get("text/plain", "") for data in shown if "image/png" not in data]
    said = "\n".join([captured.stdout, captured.stderr, *map(str, texts)]).strip("\n")
    return {"said": said[:PRINTED], "figures": figures[:10], "errors": shell.errors}


def _handed_over(answer, name: str) -> dict:
    """An answer as data; of a function its name, under which it can be called."""
    try:
        return {"value": packed(answer)}
    except (Exception, CannotTravel):
        if not callable(answer) or isinstance(answer, type):
            return {"value": _untold(answer)}
    home = str(getattr(answer, "__module__", ""))
    return {"name": str(getattr(answer, "__name__", name)), "module": home}


def _untold(value) -> dict:
    return {"untold": " ".join(repr(value).split())[:200]}


def _policy(place: str, scenario: str) -> Callable:
    """`actions(state)` of a planner, an agent, a checkpoint, or a file or folder of a student's."""
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.city import load_city
    from uavdh_lite.environment import Environment, checked_actions
    from uavdh_lite.errors import InputError
    from uavdh_lite.policies import find_policy, known_policies
    from uavdh_lite.scenario import find_scenario

    flown = find_scenario(scenario)
    environment = Environment(load_city(flown.city), flown.channel)
    file = Path(place, "policy.py") if Path(place).is_dir() else Path(place)
    if file.suffix.lower() == ".py":
        sys.path.insert(0, str(file.parent))  # as `python FILE` has it
        function = runpy.run_path(str(file)).get("policy")
        if not callable(function):
            raise InputError(f"{file.name} has no function policy(environment, state)")
        return lambda state: checked_actions(function(environment, state), len(state))
    known = place in known_policies()
    policy = (
        find_policy(place, environment) if known else load_agent(place).over(environment.cities)
    )
    flying: list = []

    def act(state):
        flying[:] = flying or [policy.begin(state)]
        return flying[0].act(state)

    return act


def _unchecked(name: str) -> Callable:
    """Any check, where a notebook runs without them: it says nothing."""
    if name.startswith("_"):
        raise AttributeError(name)
    return lambda answer: None


def _limit() -> None:
    """Give up what a submission does not need, for ever."""
    with suppress(ImportError):
        import resource

        for name, most in {
            "AS": MEMORY, "NPROC": PROCESSES, "FSIZE": FILE, "CORE": 0, "NOFILE": 512
        }.items():  # fmt: skip
            kind = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(kind)[1]
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            with suppress(ValueError, OSError):  # macOS does not know all
                resource.setrlimit(kind, (most, most))
    with suppress(OSError):  # if memory runs out, this one goes first
        Path("/proc/self/oom_score_adj").write_text("1000")
    if getattr(os, "getuid", lambda: 1)() == 0 and os.environ.get("WALLED"):
        os.setgroups([])
        os.setresgid(*3 * [NOBODY])
        os.setresuid(*3 * [NOBODY])


def main() -> None:
    """Answer the other side until it closes the pipe."""
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # what is read and printed is its own affair
    os.dup2(2, 1)
    _limit()
    if os.environ.get("WALLED") != "checks":  # what the notebooks import; it checks nothing
        checks = types.ModuleType(CHECKS)
        checks.__getattr__ = _unchecked  # type: ignore[method-assign]
        sys.modules[CHECKS] = checks
    shell: Any = None
    held: list[Any] = [None]  # what is called

    def load(place: str, scenario: str) -> None:
        held[:] = [_policy(place, scenario)]

    while message := received(questions):
        if "run" in message:
            shell = shell or _shell()
            reply = _run(shell, message["run"], message["seconds"])
        elif "answer" in message:
            held = [shell.user_ns.get(message["answer"]) if shell else None]
            reply = _handed_over(held[0], message["answer"])
        elif "load" in message:
            reply = _asked(load, message)
        else:
            reply = _asked(held[0], message)
        sent(answers, reply)


if __name__ == "__main__":
    main()
