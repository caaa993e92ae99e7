"""The labs as a web page, for this machine only."""

import asyncio
import json
import os
import signal
import socket
import sys
import uuid
import webbrowser
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import torch

from uavdh_lite.errors import InputError, extra
from uavdh_lite.labs.session import SCRIPT, STYLE, Session, read

with extra("app"):
    from tornado.httpserver import HTTPServer
    from tornado.ioloop import IOLoop
    from tornado.netutil import bind_sockets
    from tornado.web import Application, RequestHandler
    from tornado.websocket import WebSocketClosedError, WebSocketHandler

KEPT_SECONDS = 1200  # how long a session waits for a page that was closed or cut off
HOSTS = r"(127\.0\.0\.1|localhost)"  # another site's name for this address is not answered
TAKEN = 4000  # another page has the session now: the tab was doubled
PORTS = 50  # that are tried
POLICY = "default-src 'self'; img-src data:; style-src 'self' 'unsafe-inline'"  # nothing from afar


class File(RequestHandler):
    """A file of the page."""

    def initialize(self, kind: str, text: str) -> None:
        self.kind, self.text = kind, text

    def get(self) -> None:
        self.set_header("Content-Type", f"{self.kind}; charset=utf-8")
        self.set_header("Content-Security-Policy", POLICY)
        self.finish(self.text)


class Visitor:
    """A session, and the thread in which it answers one message after the other."""

    def __init__(self, visitors: dict[str, "Visitor"], kept_seconds: float):
        self.name, self.page = uuid.uuid4().hex, None
        self.session: Session | None = None
        self._visitors, self._kept_seconds = visitors, kept_seconds
        self._loop, self._ending = IOLoop.current(), None
        self._thread = ThreadPoolExecutor(1)
        visitors[self.name] = self

    def meet(self, page: "Page") -> None:
        """Send what there is to this page from now on, and to no other."""
        if self.page is not None:
            self.page.close(TAKEN)
        self.page = page
        if self._ending is not None:
            self._loop.remove_timeout(self._ending)
            self._ending = None
        self._do(self._begin)

    def hear(self, told: dict[str, Any]) -> None:
        self._do(lambda: self.session.hear(told))

    def leave(self, page: "Page") -> None:
        """This page is gone: end unless it comes again soon."""
        if page is not self.page:
            return
        self.page = None
        self._ending = self._loop.call_later(self._kept_seconds, self._end)

    def _begin(self) -> None:
        if self.session is None:
            self.session = Session(show=self._show, give=self._give)
        else:
            self._show(self.session.scene)

    def _end(self) -> None:
        del self._visitors[self.name]
        self._do(lambda: self.session.close())
        self._thread.shutdown(wait=False)

    def _do(self, what: Callable[[], None]) -> None:
        self._thread.submit(what).add_done_callback(Future.result)  # so that a failure is seen

    def _show(self, scene: dict[str, Any]) -> None:
        self._send(kind="scene", session=self.name, scene=scene)

    def _give(self, name: str, address: str) -> None:
        self._send(kind="file", name=name, address=address)

    def _send(self, **told: Any) -> None:
        message = json.dumps(told)  # here, in the session's thread

        async def send() -> None:
            with suppress(WebSocketClosedError):
                if self.page is not None:
                    await self.page.write_message(message)

        self._loop.add_callback(send)


class Page(WebSocketHandler):
    """The connection of a page. A page that comes again finds its session as it was."""

    def initialize(self, visitors: dict[str, Visitor], kept_seconds: float) -> None:
        self.visitors, self.kept_seconds = visitors, kept_seconds

    def open(self) -> None:
        known = self.visitors.get(self.get_argument("session", ""))
        self.visitor = known or Visitor(self.visitors, self.kept_seconds)
        self.visitor.meet(self)

    def on_message(self, message: str) -> None:
        self.visitor.hear(json.loads(message))

    def on_close(self) -> None:
        self.visitor.leave(self)


def serve(port: int, open_browser: bool, kept_seconds: float = KEPT_SECONDS) -> None:
    """Serve the labs on 127.0.0.1 until SIGINT (Ctrl-C) or SIGTERM.

    Arguments:
        port: the port; the next free one if it is taken.
        open_browser: open the page in this machine's browser.
        kept_seconds: how long a session waits for a page that was closed or cut off.

    Raises `InputError` if no port is free.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))  # at once: nobody has anything to save
    torch.set_num_threads(1)  # the sessions share the cores
    page = {
        "": ("text/html", read("labs/page.html")),
        "page.js": ("text/javascript", read("labs/page.js")),
        "stage.js": ("text/javascript", read(*SCRIPT)),
        "stage.css": ("text/css", read(*STYLE)),
    }
    files = [
        (f"/{name}", File, {"kind": kind, "text": text}) for name, (kind, text) in page.items()
    ]
    connection = ("/socket", Page, {"visitors": {}, "kept_seconds": kept_seconds})
    application = Application()
    application.add_handlers(HOSTS, [*files, connection])

    async def run() -> None:
        sockets = _first_free(port)
        HTTPServer(application).add_sockets(sockets)
        address = f"http://127.0.0.1:{sockets[0].getsockname()[1]}/"
        print(f"labs: {address} (Ctrl-C ends it)", file=sys.stderr, flush=True)
        if open_browser:
            webbrowser.open(address)
        await asyncio.Event().wait()

    asyncio.run(run())


def _first_free(port: int) -> list[socket.socket]:
    last = min(port + PORTS, 65536) - 1
    for each in range(port, last + 1):
        with suppress(OSError):
            return bind_sockets(each, "127.0.0.1")
    raise InputError(f"the ports {port} to {last} are taken: choose another one with --port")
