"""`app`: the interactive labs as one file."""

from pathlib import Path
from typing import Annotated

from uavdh_lite.cli.options import named, output


def app(
    *, out: Annotated[Path | None, named(".html", ".htm")] = None, browser: bool = True
) -> None:
    """Write the interactive labs, in which a UAV collects data over a city, into one file.

    Any browser opens it, without a network and without Python: from a disk, a web server, or in a
    frame of another page.

    Arguments:
        out: the file, by default labs.html.
        browser: open it in a browser.
    """
    import sys
    import webbrowser

    from uavdh_lite.labs.page import write_page

    with output(out, "labs", ".html") as out:
        write_page(out)
    print(f"labs: {out}", file=sys.stderr)
    if browser:
        webbrowser.open(out.resolve().as_uri())
