"""Where the shipped files lie, and how files are written: whole or not at all."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

_PACKAGE = Path(__file__).parent


def data_folder() -> Path:
    """The folder with `cities/` and `checkpoints/`: inside the installed package, else `data/`."""
    inside = _PACKAGE / "data"
    return inside if inside.is_dir() else _PACKAGE.parent / "data"


def write_atomically(path: str | Path, write: Callable[[Path], object]) -> None:
    """Call `write(temporary)` and rename the temporary file to `path` once it is complete.

    A reader of `path` sees the old file or the new one, never a part. If anything fails (a full
    disk, a folder that cannot be written), the old file stays as it was, the temporary file is
    removed, and the error goes on to the caller.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Same folder, so that the rename stays within one file system; same suffix, because Pillow
    # and matplotlib choose the format by it.
    prefix = f".{path.stem}-"
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=path.suffix)
    temporary = Path(name)
    try:
        os.close(descriptor)
        write(temporary)
        _to_disk(temporary)
        os.chmod(temporary, 0o666 & ~_umask())  # mkstemp makes files that only the owner can read
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _to_disk(path: Path) -> None:
    """Wait until the file's bytes are on the disk, so that a rename cannot outrun them."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
