"""`app`: the interactive labs as a web page."""

from cyclopts.types import PositiveInt

from uavdh_lite.errors import extra


def app(
    *,
    port: PositiveInt = 8866,
    sessions: PositiveInt = 8,
    idle_seconds: PositiveInt = 1200,
    browser: bool = True,
) -> None:
    """Serve the interactive labs as a web page on this machine.

    The page is for this machine only, on 127.0.0.1. Ctrl-C ends it.

    Arguments:
        port: port of the page; the next free one if it is taken.
        sessions: number of people at a time; each has a process of about 350 MB.
        idle_seconds: seconds after which a session that nobody uses is ended.
        browser: open the page in a browser.
    """
    with extra("app"):
        from uavdh_lite.labs.app.server import serve

    serve(port, sessions, idle_seconds, browser)
