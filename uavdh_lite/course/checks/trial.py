"""Running an answer whatever it does: errors, exits and endless loops end in a sentence."""

import contextvars
import ctypes
import functools
import io
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np

from uavdh_lite.course.checks.values import called, shorten

PRINTED = 2_000
"""So many characters that an answer prints are shown, and no more."""


class CheckFailed(AssertionError):
    """An answer is not right yet; the message says what is probably wrong with it."""

    def _render_traceback_(self) -> list[str]:
        """What a notebook shows of it: the message alone, not the check's own code."""
        return [f"Not yet. {self}"]


def expect(holds, message: str) -> None:
    """Raise `CheckFailed` with the message unless it holds."""
    if not holds:
        raise CheckFailed(message)


def first_true(sentences: dict[str, Callable[[Any], Any]], **facts) -> str:
    """The first sentence whose question is true of the facts, with them filled in; else ""."""
    of = SimpleNamespace(**facts)
    true = (text for text, question in sentences.items() if question(of))
    return next(true, "").format(**facts)


def expect_none(sentences: dict[str, Callable[[Any], Any]], **facts) -> None:
    """Raise `CheckFailed` with the first sentence that is true of the facts, if any is."""
    said = first_true(sentences, **facts)
    expect(not said, said)


class Stopped(SystemExit):
    """Raised inside an answer that takes too long; if it is caught there, once more."""

    def __init__(self):
        frame = sys._getframe(1)
        if not frame.f_globals.get("__name__", "").startswith(__package__):
            sys.settrace(lambda *_: None)
            frame.f_trace = self._in_the_next_line

    def _in_the_next_line(self, *_):
        raise self


# What an answer is asked at the moment, by thread, and the rule; in words only if they are needed
_calls: dict[int, list[tuple[Callable[[], str], str]]] = {}


def guarded(answer: Callable, call: str = "", rule: str = "", none: bool = False) -> Callable:
    """The student's function, with its errors and a forgotten `return` turned into messages.

    Arguments:
        call: what is asked, if not the function with its arguments.
        rule: what is said if it never ends.
        none: whether to give back nothing is right.
    """
    name = name_of(answer)

    @functools.wraps(answer, updated=())
    def guarding(*arguments, **keywords):
        asked = _calls.setdefault(threading.get_ident(), [])
        asked.append((lambda: call or called(name, arguments), rule))
        try:
            result = answer(*arguments, **keywords)
        except (CheckFailed, Stopped):
            raise
        except NotImplementedError:
            raise CheckFailed(f"{call.split('(')[0] or name} is not written yet.") from None
        except BaseException as error:  # SystemExit too
            raise CheckFailed(f"{asked[-1][0]()} {stops_with(error)}") from error
        finally:
            asked.pop()
        missing = result is None and not none
        expect(not missing, f"{call or name} gives back None: is there a `return` at its end?")
        return result

    return guarding


def name_of(answer) -> str:
    """The name of a student's function, for messages."""
    name = getattr(answer, "__name__", "")
    return name if isinstance(name, str) and name.isidentifier() else "your function"


def stops_with(error: BaseException) -> str:
    """What went wrong, such as "stops with ValueError: no such cell."."""
    try:
        text = str(error)
    except Exception:
        text = ""
    said = f"stops with {type(error).__name__}" + (f": {shorten(text, 300)}" if text else "")
    return said if said.endswith((".", "!", "?")) else f"{said}."


def within(seconds: float, work: Callable[[], None]) -> None:
    """Do the work in a thread, and stop it when its time is up.

    Unlike an alarm signal, a thread needs neither Unix nor the main thread, so that this works on
    every system, in a kernel and in any thread of it, and the kernel lives on. Without threads, as
    in a browser's Python, there is no limit. (A single operation of C code that never ends cannot
    be stopped.)

    Raises:
        CheckFailed: if the time is up; else whatever the work raises.
    """
    errors: list[BaseException] = []

    def target():
        try:
            work()
        except BaseException as error:
            errors.append(error)
        finally:
            _calls.pop(threading.get_ident(), None)

    context = contextvars.copy_context()  # numpy's error state, and where a notebook prints to
    thread = threading.Thread(target=context.run, args=(target,), daemon=True)
    try:
        thread.start()
    except RuntimeError:  # no threads here
        target()
    late, deadline = "", time.monotonic() + seconds
    try:
        while thread.is_alive() and time.monotonic() < deadline:
            thread.join(0.1)  # short, so that a notebook can be interrupted on every system
    finally:
        if thread.is_alive():
            call, rule = [(lambda: "The check", ""), *_calls.get(thread.ident or 0, [])][-1]
            late = f"{call()} had not ended after {seconds:g} seconds. Is there a loop that never "
            late += f"ends, or one that does far too much? {rule}"
            _stop(thread)
    expect(not late, late.strip())
    if errors:
        raise errors[0]


def _stop(thread: threading.Thread) -> None:
    """Raise `Stopped` in the thread, for a second again and again.

    Only CPython can: elsewhere the thread is left alone, and ends with the process.
    """
    if not hasattr(ctypes, "pythonapi"):
        return
    deadline = time.monotonic() + 1
    while thread.is_alive() and time.monotonic() < deadline:
        number, kind = ctypes.c_ulong(thread.ident or 0), ctypes.py_object(Stopped)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(number, kind)
        thread.join(0.05)


class _Brief(io.TextIOBase):
    """Passes on what is printed, up to `PRINTED` characters.

    From then on it leaves the stream alone: a thread that is stopped inside it may keep its lock,
    and then nobody prints any more.
    """

    def __init__(self, stream):
        self.stream, self.left = stream, PRINTED

    def write(self, text: str) -> int:
        if self.left > 0:
            self.stream.write(text[: self.left])
            if self.left < len(text):
                self.stream.write(" … (your function prints more)\n")
        self.left -= len(text)
        return len(text)

    def flush(self) -> None:
        if self.left > 0:
            self.stream.flush()


def _leave(*_):
    raise SystemExit


def _unraisable(ignored, hook: Callable) -> None:
    """Say nothing of a `Stopped` that comes where Python ignores errors, as while it tidies up."""
    if not isinstance(ignored.exc_value, Stopped):
        hook(ignored)


@contextmanager
def contained() -> Iterator[None]:
    """While an answer runs: little is printed, nothing warns, and `exit()` leaves no kernel."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    names = shell.user_ns if shell else {}
    kept = {name: names[name] for name in ("exit", "quit") if name in names}
    hook, sys.unraisablehook = sys.unraisablehook, lambda one: _unraisable(one, hook)
    output, sys.stdout = sys.stdout, _Brief(sys.stdout)
    names.update(dict.fromkeys(kept, _leave))
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        sys.stdout, sys.unraisablehook = output, hook
        names.update(kept)


@contextmanager
def refused(methods: dict[tuple[type, str], str]) -> Iterator[None]:
    """Let methods and properties of classes, by (class, name), fail with a message for a while."""
    kept = {(owner, name): vars(owner)[name] for owner, name in methods}

    def refusing(message):
        def refuse(self, *_):
            raise CheckFailed(message)

        return refuse

    for (owner, name), message in methods.items():
        method = refusing(message)
        setattr(owner, name, method if callable(kept[owner, name]) else property(method))
    try:
        yield
    finally:
        for (owner, name), value in kept.items():
            setattr(owner, name, value)
