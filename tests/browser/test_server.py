"""The labs' server ends when it is told to, and every process that it started ends with it."""

import signal
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

import psutil
import pytest
from jupyter_client import BlockingKernelClient
from serving import DEADLINE, serving

pytestmark = pytest.mark.long

BUSY = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
while True:
    pass
"""


def ignore_interrupts():
    """As a shell does for the jobs that it starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def until(condition):
    """What the condition gives as soon as that is true."""
    end = time.monotonic() + DEADLINE
    while not (found := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
    return found


def children(server):
    return psutil.Process(server.pid).children(recursive=True)


def connection_file(kernel):
    command = kernel.cmdline()
    return command[command.index("-f") + 1]


def keep_busy(kernel):
    """Let a kernel compute, for good, what neither an interrupt nor a request to end stops."""
    client = BlockingKernelClient(connection_file=connection_file(kernel))
    client.load_connection_file()
    client.start_channels()
    client.wait_for_ready(timeout=DEADLINE)
    asked = client.execute(BUSY)
    while True:
        message = client.get_iopub_msg(timeout=DEADLINE)
        ours = message["parent_header"].get("msg_id") == asked
        if ours and message["content"].get("execution_state") == "busy":
            break
    client.stop_channels()


def end(server, number, *others):
    """Send the signals; once the server has ended, its exit status and what it left behind."""
    started = children(server)
    server.send_signal(number)
    for other in others:
        server.send_signal(other)
    _, said = server.communicate(timeout=DEADLINE)
    assert "Traceback" not in said
    return server.returncode, psutil.wait_procs(started, timeout=DEADLINE)[1], started


@pytest.fixture
def short_path():
    """A folder whose name leaves room for the names of sockets."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        yield Path(folder)


@pytest.mark.parametrize("folder", ["tmp_path", "short_path"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_server_and_sessions(request, monkeypatch, number, folder):
    """Also if its parent ignored interrupts, a session is busy, and somebody is impatient."""
    folder = request.getfixturevalue(folder)
    monkeypatch.setenv("TMPDIR", str(folder))
    with serving(preexec_fn=ignore_interrupts) as (address, server):
        with urlopen(address, timeout=DEADLINE) as page:
            assert page.status == 200 and b"jupyter-config-data" in page.read()
        kernels = until(lambda: len(found := children(server)) >= 2 and found)  # one is spare
        keep_busy(kernels[0])
        status, left, started = end(server, number, number)
    assert (status, left) == (0, []) and len(started) >= 2
    assert not list(folder.glob("voila_*"))


def test_a_signal_ends_a_server_whose_first_session_is_only_starting():
    with serving(preexec_fn=ignore_interrupts) as (_, server):
        until(lambda: children(server))
        status, left, _ = end(server, signal.SIGINT)
    assert (status, left) == (0, [])
