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
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MEMORY, PROCESSES, FILE = 6 << 30, 128, 64 << 20  # bytes, processes and threads, bytes of a file
LONGEST = 64 << 20  # bytes of a message
PRINTED = 100_000  # characters of a cell that are kept
NOBODY = 65_534
CHECKS = "uavdh_lite.course.checks"


def packed(value: Any) -> Any:
    """A value as JSON has it; `TypeError` if it is no data."""
    if isinstance(value, np.generic):
        value = np.asarray(value)
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, list):
        return [packed(part) for part in value]
    if isinstance(value, tuple):
        return {"tuple": [packed(part) for part in value]}
    if isinstance(value, dict):
        return {"dict": [packed(list(pair)) for pair in value.items()]}
    if hasattr(value, "detach"):
        return packed(value.detach().cpu().numpy()) | {"tensor": bool(value.requires_grad)}
    if isinstance(value, np.ndarray):
        np.save(content := io.BytesIO(), value, allow_pickle=False)
        array = base64.b64encode(content.getvalue()).decode()
        return {"array": array, "writeable": value.flags.writeable}
    if isinstance(value, np.random.Generator):
        return {"generator": packed(value.bit_generator.state)}
    if is_dataclass(value) and type(value).__module__.startswith("uavdh_lite."):
        own = {f.name: packed(getattr(value, f.name)) for f in fields(value) if f.init}
        return {"class": f"{type(value).__module__}:{type(value).__qualname__}", "fields": own}
    raise TypeError(f"a {type(value).__name__} is no data")


def unpacked(value: Any, within: bool = False) -> Any:
    """What `packed` made JSON of; only within the walls the library's own classes are made, too."""
    if isinstance(value, list):
        return [unpacked(part, within) for part in value]
    if not isinstance(value, dict):
        return value
    if "tuple" in value:
        return tuple(unpacked(value["tuple"], within))
    if "dict" in value:
        return dict(unpacked(value["dict"], within))
    if "array" in value:
        array = np.load(io.BytesIO(base64.b64decode(value["array"])), allow_pickle=False)
        if "tensor" in value:
            return (
                importlib.import_module("torch").from_numpy(array).requires_grad_(value["tensor"])
            )
        array.flags.writeable = value["writeable"]
        return array[()]  # a number without axes is a number
    if "generator" in value:
        generator = np.random.default_rng()
        generator.bit_generator.state = unpacked(value["generator"])
        return generator
    if "class" in value:
        if not within:
            return f"a {value['class']}"
        module, name = value["class"].split(":")
        own = {key: unpacked(part) for key, part in value["fields"].items()}
        return getattr(importlib.import_module(module), name)(**own)
    raise ValueError("this is no data")


def _told(value: Any) -> Any:
    """A value as JSON has it; of what is no data its text."""
    try:
        return packed(value)
    except Exception:  # whatever a student's own value does when it is looked at
        return f"<{' '.join(repr(value).split())[:200]}>"


def sent(stream: BinaryIO, message: dict) -> None:
    """Write a message into a pipe, a line of JSON."""
    stream.write(json.dumps(message).encode() + b"\n")
    stream.flush()


def received(stream: BinaryIO) -> dict | None:
    """The next message of a pipe; None at its end, `ValueError` if it is too long or none."""
    message = json.loads(stream.readline(LONGEST) or "null")
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
            reply = {"value": _told(function(*arguments))}
    except BaseException as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if _is_own(f)]
        where = f", in line {own[-1].lineno}, `{own[-1].line}`" if own else ""
        reply = {"raised": type(error).__name__, "text": str(error)[:2000], "where": where}
    with suppress(Exception):
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
    return {"said": said[:PRINTED], "figures": figures[:10], "errors": shell.errors[:1]}


def _handed_over(answer, name: str) -> dict:
    """An answer as data; of what can be called its name and home."""
    if not callable(answer):
        return {"value": _told(answer)}
    called, home = (str(getattr(answer, f"__{it}__", name)) for it in ("name", "module"))
    return {"name": called, "module": home, "class": isinstance(answer, type)}


def _policy(place: str, scenario: str) -> Callable:
    """`actions(state)` of a planner, an agent, a checkpoint, or a file or folder of a student's."""
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.city import load_city
    from uavdh_lite.environment import Environment
    from uavdh_lite.errors import InputError
    from uavdh_lite.evaluation import FunctionPolicy
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
        return FunctionPolicy(partial(function, environment)).act
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

        most = {"AS": MEMORY, "NPROC": PROCESSES, "FSIZE": FILE, "CORE": 0, "NOFILE": 512}
        for name, limit in most.items():
            with suppress(ValueError, OSError):  # macOS does not know all, or has lower ones
                resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (limit, limit))
    if not os.environ.get("WALLED"):
        return
    with suppress(OSError):  # if memory runs out, this one goes first
        Path("/proc/self/oom_score_adj").write_text("1000")
    if os.getuid() == 0:
        os.setgroups([])
        os.setresgid(*3 * [NOBODY])
        os.setresuid(*3 * [NOBODY])


def main() -> None:
    """Answer the other side until it closes the pipe."""
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # what is read and printed is its own affair
    os.dup2(2, 1)
    _limit()
    checks = types.ModuleType(CHECKS)  # what the notebooks import; it checks nothing
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
        elif message["ask"]:
            given = importlib.import_module("uavdh_lite.course.given")
            reply = _asked(partial(getattr(given, message["ask"]), held[0]), message)
        else:
            reply = _asked(held[0], message)
        sent(answers, reply)


if __name__ == "__main__":
    main()
