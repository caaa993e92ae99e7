"""`app`: the interactive labs as one file."""

from pathlib import Path


def app(*, out: Path | None = None, browser: bool = True) -> None:
    """Write the interactive labs, in which a UAV collects data over a city, into one file.

    Any browser opens it, without a network and without Python: from a disk, a web server, or in a
    frame of another page.

    Arguments:
        out: the file, by default labs.html.
        browser: open it in a browser.
    """
    import sys
    import webbrowser

    from uavdh_lite.errors import InputError
    from uavdh_lite.labs.page import write_page

    if out is None:
        out = Path("labs.html")
        if out.exists() and b"<title>uavdh_lite labs" not in out.read_bytes():
            raise InputError(f"{out} exists, and has no labs in it: name another file with --out")
    elif out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: must end in .html")
    write_page(out)
    print(f"labs: {out}", file=sys.stderr)
    if browser:
        webbrowser.open(out.resolve().as_uri())
