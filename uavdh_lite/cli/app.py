"""`app`: the interactive labs as a web page."""

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number


def app(
    *,
    port: Annotated[int, Parameter(validator=Number(gte=1, lte=65535))] = 8866,
    browser: bool = True,
) -> None:
    """Serve the interactive labs, in which a UAV collects data over a city, as a web page.

    The page is for this machine only, on 127.0.0.1. Ctrl-C ends it.

    Arguments:
        port: port of the page; the next free one if it is taken.
        browser: open the page in a browser.
    """
    from uavdh_lite.labs.server import serve

    serve(port, browser)
