"""A server of the labs in a process of its own."""

import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import psutil

DEADLINE = 180  # seconds; only a server that never answers or never ends takes so long
COMMAND = ("-m", "uavdh_lite", "app", "--no-browser", "--port", "8900")
IMPATIENT = """
import jupyter_server.base.websocket
jupyter_server.base.websocket.WS_PING_INTERVAL = 100  # milliseconds; its own is half a minute
from uavdh_lite.labs.app.server import serve
serve(8900, 4, False)
"""  # a session ends after four idle seconds, and Jupyter's pings, if there are any, come soon


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
    family = [psutil.Process(server.pid)]
    try:
        for line in server.stderr:
            if found := re.match(r"labs: (\S+)", line):
                break
        else:
            raise AssertionError("the server ended before it served")
        yield found[1], server
        family += family[0].children(recursive=True) if server.poll() is None else []
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=DEADLINE)
    finally:
        for process in family:  # what a test that failed leaves behind
            if process.is_running():
                process.kill()
        server.communicate()
