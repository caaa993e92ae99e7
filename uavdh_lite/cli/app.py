"""`app`: the interactive labs as a web page."""

from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number

from uavdh_lite.labs.app import IDLE_SECONDS, PORT, SESSIONS

Port = Annotated[int, Parameter(validator=Number(gte=1, lte=65535))]


def app(
    *,
    port: Port = PORT,
    sessions: PositiveInt = SESSIONS,
    idle_seconds: PositiveInt = IDLE_SECONDS,
    browser: bool = True,
) -> None:
    """Serve the interactive labs, in which a UAV collects data over a city, as a web page.

    The page is for this machine only, on 127.0.0.1. Ctrl-C ends it.

    Arguments:
        port: port of the page; the next free one if it is taken.
        sessions: number of people at a time; each has a process of about 350 MB.
        idle_seconds: seconds after which a session that nobody uses is ended.
        browser: open the page in a browser.
    """
    from uavdh_lite.labs.app.server import serve

    serve(port, sessions, idle_seconds, browser)
