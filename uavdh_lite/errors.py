"""The errors that bad input causes. Each message says what is wrong and how to put it right."""

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Input that cannot be used: a value, a file, or two things that do not go together."""


class CityError(InputError):
    """A city that is not valid, or a file that does not hold one."""


class CheckpointError(InputError):
    """A checkpoint file that is damaged, from another program, or of the wrong kind."""


class MissingExtra(InputError, ImportError):
    """An optional package that is not installed; the message has the command that installs it."""


class TrainingDiverged(ArithmeticError):
    """The loss or a weight of a training run is no longer finite."""


def one_line(text: object) -> str:
    """A text in one line, with nothing that a terminal would obey: `\\x1b` in place of ESC."""
    escaped = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))
    return "".join(escaped)


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Wraps imports that need the optional packages `uavdh-lite[name]` of `pyproject.toml`.

    Raises `MissingExtra` if one of them is not installed.

    ```python
    with extra("onnx"):
        import onnxruntime
    ```
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        message = f"{package} is not installed: pip install 'uavdh-lite[{name}]'"
        raise MissingExtra(message) from None
