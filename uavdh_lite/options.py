"""Fields of configurations that explain themselves, and what the command line makes of text."""

import argparse
import dataclasses
from typing import Any


def option(default: Any, help: str) -> Any:
    """A dataclass field with a default and one line of help, which the command line shows."""
    return dataclasses.field(default=default, metadata={"help": help})


def positive(text: str) -> int:
    """The type of an option that is a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)
