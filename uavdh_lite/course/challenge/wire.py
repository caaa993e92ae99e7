"""Messages between the referee and a submission's process: named arrays, never a pickle."""

import io
import struct
from typing import IO, Any

import numpy as np

_LENGTH = struct.Struct("<Q")
LARGEST = 64 * 2**20  # bytes; a batch of states takes far less


def send(pipe: IO[bytes], **arrays: np.ndarray) -> None:
    """Write one message; blocks until the other side reads it."""
    buffer = io.BytesIO()
    named: dict[str, Any] = arrays  # none is called as an option of savez
    np.savez(buffer, **named)
    pipe.write(_LENGTH.pack(buffer.tell()) + buffer.getvalue())
    pipe.flush()


def receive(pipe: IO[bytes]) -> dict[str, np.ndarray]:
    """Read one message; raises EOFError at the end, ValueError for anything that is not one."""
    (length,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))
    if length > LARGEST:
        raise ValueError(f"a message of {length} bytes")
    try:
        with np.load(io.BytesIO(_exactly(pipe, length)), allow_pickle=False) as arrays:
            return dict(arrays)
    except EOFError:
        raise
    except Exception as error:  # whatever zipfile and numpy make of foreign bytes
        raise ValueError(f"not a message: {error}") from error


def _exactly(pipe: IO[bytes], length: int) -> bytes:
    data = pipe.read(length)
    if len(data) < length:
        raise EOFError("the other side has gone")
    return data
