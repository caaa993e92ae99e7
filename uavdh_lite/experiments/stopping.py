"""Stop between two steps, not in the middle of one: Ctrl-C, and SIGTERM from a job system."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def deferred_stop(note: Callable[[], object] = lambda: None) -> Iterator[Callable[[], bool]]:
    """Only note a signal that asks to stop; yields a function that says whether one came.

    A second one interrupts at once. Only the main thread can catch signals; in another one,
    nothing is noted.

    Arguments:
        note: called when the first signal comes.
    """
    noted = threading.Event()

    def handle(signum, frame):
        if noted.is_set():
            raise KeyboardInterrupt
        noted.set()
        note()
        print("\nstopping after this step; once more stops at once", file=sys.stderr, flush=True)

    if threading.current_thread() is not threading.main_thread():
        yield noted.is_set
        return
    previous = [signal.signal(number, handle) for number in SIGNALS]
    try:
        yield noted.is_set
    finally:
        for number, handler in zip(SIGNALS, previous, strict=True):
            signal.signal(number, handler)
