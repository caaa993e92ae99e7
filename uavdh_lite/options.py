"""Fields of configurations that explain themselves."""

import dataclasses
from typing import Any


def option(default: Any, help: str) -> Any:
    """A dataclass field with a default and one line of help, which the command line shows."""
    return dataclasses.field(default=default, metadata={"help": help})
