"""A server of the labs in a process of its own."""

import re
import signal
import subprocess
import sys
from contextlib import contextmanager

DEADLINE = 180  # seconds; only a server that never answers or never ends takes so long
COMMAND = ("-m", "uavdh_lite", "app", "--no-browser", "--port", "8900")


@contextmanager
def serving(*command, **process):
    """The address of a server on a free port, and its process, which ends with the block.

    Arguments:
        command: what Python runs; by default the labs' command.
        process: keyword arguments of `subprocess.Popen`.
    """
    server = subprocess.Popen(
        [sys.executable, *(command or COMMAND)], stderr=subprocess.PIPE, text=True, **process
    )
    try:
        for line in server.stderr:
            if found := re.match(r"labs: (\S+)", line):
                break
        else:
            raise AssertionError("the server ended before it served")
        yield found[1], server
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=DEADLINE)
    finally:
        server.kill()  # what a test that failed leaves behind
        server.communicate()
