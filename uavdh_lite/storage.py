"""Files: where the shipped ones are, CSV and JSON, and writing a file whole or not at all."""

import csv
import gzip
import io
import json
import os
import secrets
import shutil
import zlib
from collections.abc import Callable
from itertools import chain
from pathlib import Path

import numpy as np

from uavdh_lite.errors import InputError

_PACKAGE = Path(__file__).parent
NAMES = "variant", "policy", "city"


def data_folder() -> Path:
    """The folder with `cities/`, `runs/` and more: inside the installed package, else `data/`."""
    inside = _PACKAGE / "data"
    return inside if inside.is_dir() else _PACKAGE.parent / "data"


def write_atomically(path: str | Path, write: Callable[[Path], object]) -> None:
    """Call `write(temporary)` and rename the temporary file to `path` once it is complete.

    A reader of `path` sees the old file or the new one, never a part. If anything fails (a full
    disk, a folder that cannot be written), the old file stays as it was, the temporary file is
    removed, and the caller gets the error. A link stays one: the file that it leads to is written.
    Who may read a file stays as it was.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    named, path = path, Path(os.path.realpath(path))
    # The same folder, so that the rename stays within one file system; the same suffix, because
    # Pillow and matplotlib choose the format by it; not the name, which may leave no room for more.
    temporary = path.parent / f".{secrets.token_hex(8)}.unfinished{named.suffix}"
    try:
        temporary.open("xb").close()  # like any new file: the umask says who may read it
        write(temporary)
        with temporary.open("r+b") as file:  # Windows only syncs what may be written
            os.fsync(file.fileno())  # the rename must not come before the bytes
        if path.exists():
            shutil.copymode(path, temporary)
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):  # a full disk names no file, a closed folder the temporary
            error.filename = str(named)
        raise


def write_table(path: str | Path, rows: list[dict]) -> None:
    """Write rows as CSV, compressed if the name ends in `.gz`.

    None is empty, and so is a column that other rows have and this one lacks. Floats keep six
    digits. Equal rows give equal bytes.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, dict.fromkeys(chain.from_iterable(rows)), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    content = text.getvalue().encode()
    if Path(path).suffix.lower() == ".gz":
        content = gzip.compress(content, mtime=0)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def read_table(path: str | Path) -> dict[str, np.ndarray]:
    """The columns of a table by name: numbers if all values are, else text; NaN where empty.

    Those of `NAMES` are always text, so that 1e1 and 10 are two.

    Raises `InputError` if the file is not such a table.
    """
    content = Path(path).read_bytes()
    try:
        packed = content.startswith(b"\x1f\x8b")  # a browser may have unpacked what ends in .gz
        text = (gzip.decompress(content) if packed else content).decode("utf-8-sig")
        names, *rows = csv.reader(io.StringIO(text), strict=True)
        if len({*names}) < len(names):
            raise ValueError("two columns have one name")
        columns = zip(*rows, strict=True)
        pairs = zip(names, columns, strict=True)
        return {k: np.array(v) if k in NAMES else _column(v) for k, v in pairs}
    except (ValueError, OSError, EOFError, csv.Error, zlib.error) as error:
        right = "not a table, with names in its first row and rows of that length"
        raise InputError(f"{path}: {right} ({error})") from None


def _column(values: tuple[str, ...]) -> np.ndarray:
    try:
        return np.array([float(value) if value else np.nan for value in values])
    except ValueError:
        return np.array(values)


def write_json(path: str | Path, values: dict) -> None:
    """Write JSON for people to read."""
    text = json.dumps(values, indent=2, ensure_ascii=False) + "\n"
    content = text.encode(errors="backslashreplace")  # half a character, as in a file's odd name
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def read_json(path: str | Path) -> dict:
    """The object in a JSON file; `InputError` if it holds no such thing."""
    try:
        values = json.loads(Path(path).read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON, or damaged ({error})") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no JSON object")
    return values
