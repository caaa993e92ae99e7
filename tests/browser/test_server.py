"""The labs' server without a browser: its sessions, who may talk to it, and how it ends."""

import asyncio
import json
import signal
import time
from http.client import HTTPConnection
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest
from serving import DEADLINE, serving
from tornado.websocket import websocket_connect

BRIEF = "from uavdh_lite.labs.server import serve; serve(8900, False, kept_seconds=1)"
OPEN = []  # connections
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    "Sec-WebSocket-Version": "13",
}


@pytest.fixture(scope="module")
def address():
    with serving("-c", BRIEF) as (address, _):
        yield address


def run(coroutine):
    """Wait for what a test does with the server, and close its connections."""

    async def done():
        try:
            await asyncio.wait_for(coroutine, DEADLINE)
        finally:
            while OPEN:
                await close(OPEN[0])

    asyncio.run(done())


async def connect(address, session=""):
    """A page's connection, and the first thing that it is told."""
    page = await websocket_connect(f"{address.replace('http', 'ws')}socket?session={session}")
    OPEN.append(page)
    return page, json.loads(await page.read_message())


async def close(page):
    page.close()
    while await page.read_message() is not None:
        pass
    OPEN.remove(page)


async def tell(page, told):
    await page.write_message(json.dumps(told))
    return json.loads(await page.read_message())


def test_each_page_has_a_session_of_its_own_and_finds_it_again(address):
    async def visit():
        (page, first), (other, second) = [await connect(address) for _ in range(2)]
        assert first["session"] != second["session"] and first["scene"]["fresh"]
        assert (await tell(page, {"kind": "tool", "tool": "think"}))["scene"]["answered"] == 1
        assert (await tell(other, {"kind": "x"}))["scene"]["state"]["tool"] == "compare"
        for leaves in (False, True):  # a tab that is doubled, and one that is loaded again
            if leaves:
                await close(page)
            again, told = await connect(address, first["session"])
            assert told["session"] == first["session"]
            assert told["scene"]["state"]["tool"] == "think"
            if not leaves:
                assert await page.read_message() is None and page.close_code == 4000
                OPEN.remove(page)
                page.close()
            page = again

    run(visit())


def test_messages_are_answered_in_their_order_and_a_file_is_an_address(address):
    async def visit():
        page, _ = await connect(address)
        for step in (1, 2, 3):
            await page.write_message(json.dumps({"kind": "show", "step": step}))
        told = [json.loads(await page.read_message())["scene"] for _ in range(3)]
        assert [scene["state"]["step"] for scene in told] == [1, 2, 3]
        file = await tell(page, {"kind": "save", "what": "stage"})
        assert file["kind"] == "file" and file["name"] == "manhattan_stage.json"
        with urlopen(file["address"]) as content:
            assert json.load(content)["step"] == 3

    run(visit())


def test_a_session_ends_when_its_page_has_been_gone_for_long(address):
    async def visit():
        page, told = await connect(address)
        await asyncio.sleep(1.5)  # longer than it is kept without a page
        assert (await tell(page, {"kind": "show", "step": 1}))["session"] == told["session"]
        await close(page)
        end = time.monotonic() + DEADLINE
        while True:
            await asyncio.sleep(1.2)
            other, again = await connect(address, told["session"])
            if again["session"] != told["session"]:
                break
            await close(other)
            assert time.monotonic() < end, "the session does not end"

    run(visit())


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {}, 200),
        ("/", {"Host": "evil.example"}, 404),  # another's name for this address (DNS rebinding)
        ("/socket", UPGRADE, 101),
        ("/socket", {**UPGRADE, "Host": "evil.example"}, 404),
        ("/socket", {**UPGRADE, "Origin": "http://evil.example"}, 403),
    ],
)
def test_only_the_page_itself_may_talk_to_the_server(address, path, headers, status):
    assert address.startswith("http://127.0.0.1:")
    connection = HTTPConnection("127.0.0.1", urlsplit(address).port)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    assert answer.status == status
    if status == 200:
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    connection.close()


def test_a_message_that_cannot_be_read_ends_the_connection_and_no_other(address):
    async def visit():
        (page, _), (other, _) = [await connect(address) for _ in range(2)]
        await page.write_message("{")
        assert await page.read_message() is None
        OPEN.remove(page)
        page.close()
        assert (await tell(other, {"kind": "show", "step": 1}))["scene"]["refused"] == ""

    run(visit())


def ignore_interrupts():
    """As a shell does for the jobs that it starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_server_while_a_session_computes(number):
    """Also if its parent ignored interrupts."""

    async def visit(address, server):
        page, _ = await connect(address)
        await page.write_message(json.dumps({"kind": "duel", "wanted": 1}))
        await page.write_message(json.dumps({"kind": "many"}))
        server.send_signal(number)

    with serving(preexec_fn=ignore_interrupts) as (address, server):
        run(visit(address, server))
        _, said = server.communicate(timeout=DEADLINE)
        assert server.returncode == 0 and said == ""


def test_a_port_that_is_taken_leads_to_the_next_one(address):
    taken = urlsplit(address).port
    with serving("-c", BRIEF.replace("8900", str(taken))) as (other, _):
        assert urlsplit(other).port > taken
