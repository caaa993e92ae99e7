"""Results as CSV tables, plain or compressed, and with what they were computed."""

import csv
import gzip
import io
import json
import os
import platform
import zlib
from pathlib import Path

import numpy as np
import torch

from uavdh_lite import __version__
from uavdh_lite.errors import InputError
from uavdh_lite.files import write_atomically

LARGEST = 200_000_000  # bytes of a table, unpacked


def write_table(path: str | Path, rows: list[dict]) -> None:
    """Write rows with equal keys as CSV, compressed if the name ends in `.gz`; None is empty.

    Floats keep six digits. Equal rows give equal bytes.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    content = text.getvalue().encode()
    if Path(path).suffix == ".gz":
        content = gzip.compress(content, mtime=0)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def read_table(path: str | Path) -> dict[str, np.ndarray]:
    """The columns of a table by name: numbers where all are, else text; empty numbers are NaN.

    Raises `InputError` if the file is not such a table.
    """
    content = Path(path).read_bytes()
    try:
        if Path(path).suffix == ".gz":
            with gzip.open(io.BytesIO(content)) as file:
                content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise InputError(f"{path}: larger than {LARGEST} bytes: no table of ours is")
        rows = list(csv.reader(io.StringIO(content.decode()), strict=True))
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table ({error})") from None
    if not rows or any(len(row) != len(rows[0]) for row in rows):
        raise InputError(f"{path}: not a table: its rows are of unequal length")
    names, *values = rows
    columns = zip(*values, strict=True) if values else [()] * len(names)
    return {name: _column(column) for name, column in zip(names, columns, strict=True)}


def _column(values: tuple[str, ...]) -> np.ndarray:
    try:
        return np.array([float(value) if value else np.nan for value in values])
    except ValueError:
        return np.array(values)


def provenance() -> dict:
    """With what a result was computed: versions, threads and kind of machine, as JSON values."""
    return {
        "version": __version__,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "threads": torch.get_num_threads(),
        "machine": f"{os.cpu_count()}-core {platform.machine()}, {platform.system()}",
    }


def write_json(path: str | Path, values: dict) -> None:
    """Write JSON for people to read."""
    text = json.dumps(values, indent=2, ensure_ascii=False) + "\n"
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
