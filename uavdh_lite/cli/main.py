"""The entry of the command line: `python -m uavdh_lite`, or `uavdh-lite`."""

import re
import shlex
import sys

from cyclopts import CycloptsError, UnusedCliTokensError

from uavdh_lite.cli.ablation import ablation
from uavdh_lite.cli.app import app
from uavdh_lite.cli.challenge import challenge
from uavdh_lite.cli.cities import cities
from uavdh_lite.cli.city import city
from uavdh_lite.cli.compare import compare
from uavdh_lite.cli.demo import demo
from uavdh_lite.cli.evaluate import evaluate
from uavdh_lite.cli.export import export
from uavdh_lite.cli.fly import fly
from uavdh_lite.cli.parsing import application, run
from uavdh_lite.cli.train import train
from uavdh_lite.errors import InputError, TrainingDiverged

_OUT_OF_MEMORY = re.compile("allocate|Storage size")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit status.

    0; 1 for files or a training that diverged; 2 for bad input; 130 for Ctrl-C.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    commands = application(demo, evaluate, compare, fly, export, challenge, app, city, cities)
    for command in (train, ablation):  # they answer --help themselves
        commands.command(command, help_flags=(), version_flags=())
    try:
        run(commands, arguments, shlex.join(["python", "-m", "uavdh_lite", *arguments]))
    except CycloptsError as error:
        chain, *_ = commands.parse_commands(arguments)
        help_for = " ".join(["python -m uavdh_lite", *chain, "--help"])
        return _fail(2, f"{_in_words(error)} See: {help_for}")
    except InputError as error:
        return _fail(2, error)
    except TrainingDiverged as error:
        return _fail(1, error)
    except OSError as error:
        path = error.filename2 or error.filename
        return _fail(1, f"{path}: {error.strerror}" if path else error)
    except (MemoryError, RuntimeError) as error:  # numpy raises the first, torch the second
        if isinstance(error, RuntimeError) and not _OUT_OF_MEMORY.search(str(error)):
            raise
        return _fail(1, f"not enough memory: {error}")
    except KeyboardInterrupt:
        return 130
    return 0


def _in_words(error: CycloptsError) -> str:
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"Unexpected: {shlex.join(error.unused_tokens)}."
    error.verbose = False  # without what helps only the developers of a command line
    return str(error)


def _fail(status: int, message: object) -> int:
    """Print an error as one line."""
    print("uavdh_lite: error:", *str(message).splitlines(), file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
