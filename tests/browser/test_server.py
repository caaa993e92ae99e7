"""The labs' server without a browser: its sessions, who may talk to them, and how it ends."""

import json
import re
import signal
import time
import uuid
from urllib.request import urlopen

import psutil
import pytest
from jupyter_client import BlockingKernelClient
from serving import DEADLINE, IMPATIENT, serving
from tornado import gen
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

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


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_server_and_sessions(number):
    """Also if its parent ignored interrupts, a session is busy, and somebody is impatient."""
    with serving(preexec_fn=ignore_interrupts) as (address, server):
        open_page(address)
        kernels = until(lambda: len(found := children(server)) >= 2 and found)  # one is spare
        keep_busy(kernels[0])
        status, left, started = end(server, number, number)
    assert (status, left) == (0, []) and len(started) >= 2


def test_a_signal_ends_a_server_whose_first_session_is_only_starting():
    with serving(preexec_fn=ignore_interrupts) as (_, server):
        until(lambda: children(server))
        status, left, _ = end(server, signal.SIGTERM)
    assert (status, left) == (0, [])


def open_page(address):
    """The address of the session that the page has, and that of its channels."""
    with urlopen(address, timeout=DEADLINE) as page:
        kernel = re.search(r'"kernelId": ?"([^"]+)"', page.read().decode())[1]
    session = f"{address}api/kernels/{kernel}"
    return session, f"{session.replace('http', 'ws', 1)}/channels"


async def status(address, **headers):
    """How the server answers."""
    request = HTTPRequest(address, headers=headers)
    return (await AsyncHTTPClient().fetch(request, raise_error=False)).code


def run(coroutine, *arguments):
    return IOLoop().run_sync(lambda: coroutine(*arguments), timeout=DEADLINE)


def test_an_idle_session_ends_when_due_and_no_ping_cuts_a_page_off_before():
    """Jupyter's pings cut off a page that answers late; one that comes back is never idle."""
    pings = []

    async def wait(session, channels):
        socket = await websocket_connect(channels, on_message_callback=lambda message: None)
        socket.on_ping = pings.append
        began = time.monotonic()
        while await status(session) == 200:
            assert time.monotonic() < began + DEADLINE, "the session does not end"
            await gen.sleep(0.2)
        socket.close()
        return time.monotonic() - began

    with serving("-c", IMPATIENT) as (address, _):
        assert run(wait, *open_page(address)) > 3
    assert pings == []


def test_a_session_runs_no_code_that_is_sent_to_it(tmp_path):
    """A message to execute code, as a notebook's front end sends it, is dropped."""
    trace = tmp_path / "executed"

    def message(kind, **content):
        header = {
            "msg_id": uuid.uuid4().hex,
            "msg_type": kind,
            "username": "",
            "session": uuid.uuid4().hex,
            "version": "5.3",
            "date": "2026-01-01T00:00:00Z",
        }
        parts = {"header": header, "parent_header": {}, "metadata": {}, "buffers": []}
        return json.dumps({"channel": "shell", "content": content, **parts})

    async def send(channels):
        socket = await websocket_connect(channels)
        code = f"open({str(trace)!r}, 'w').close()"
        await socket.write_message(message("execute_request", code=code, silent=False))
        await socket.write_message(message("kernel_info_request"))
        answers = []
        while "kernel_info_reply" not in answers:
            answers.append(json.loads(await socket.read_message())["msg_type"])
        socket.close()
        return answers

    with serving() as (address, _):
        answers = run(send, open_page(address)[1])
        assert "execute_reply" not in answers and not trace.exists()

        # Another site's page that gives this address its own name (DNS rebinding) is refused
        nobody = f"{address}api/kernels/{uuid.uuid4()}"
        assert address.startswith("http://127.0.0.1:")
        assert [run(status, nobody), run(lambda: status(nobody, Host="evil.example"))] == [404, 403]
