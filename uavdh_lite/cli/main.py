"""The entry of the command line: `python -m uavdh_lite`, or `uavdh-lite`."""

import io
import os
import shlex
import sys
import warnings
from importlib import import_module
from typing import get_args

from cyclopts import UNSET, App, CycloptsError, Parameter
from cyclopts.exceptions import CoercionError

from uavdh_lite import __version__
from uavdh_lite.errors import InputError, TrainingDiverged, one_line

# Module and help of each command. Only the module of the command that is called is imported, so
# that the list of commands does not wait for PyTorch.
COMMANDS = {
    "demo": ("flying", "Fly the shipped agents next to a simple rule and the paper's results."),
    "fly": ("flying", "Fly one mission and draw it."),
    "train": ("training", "Train an agent."),
    "evaluate": ("flying", "Fly an agent on many random missions."),
    "compare": ("flying", "Compare an agent with the planners on the same missions."),
    "study": ("training", "Train several variants of a recipe, over several seeds."),
    "export": ("flying", "Write an agent's network as an ONNX file."),
    "challenge": ("challenge", "Score a class's submissions on missions that nobody has seen."),
    "city": ("city", "Make a city from the footprints of buildings."),
    "classroom": ("classroom", "Collect, look through and give back a class's exercises."),
    "app": ("app", "Write the interactive labs as one file, and open it."),
}
# In messages of PyTorch's and matplotlib's errors, which have no class of their own
RUNTIME_ERRORS = ("memory", "latex")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit status, which the reference of the commands explains."""
    arguments = sys.argv[1:] if arguments is None else arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not every encoding has γ, nor a path's bytes
            stream.reconfigure(errors="backslashreplace")
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda text, *where: _say("warning", text)  # type: ignore
            _run(arguments)
            sys.stdout.flush()
    except CycloptsError as error:
        error.verbose = False  # without what helps only the developers of a command line
        called = " ".join(["python -m uavdh_lite", *arguments[:1], "--help"])
        return _fail(2, f"{error} See: {called}")
    except InputError as error:
        return _fail(2, error)
    except TrainingDiverged as error:
        return _fail(1, error)
    except BrokenPipeError:  # who reads has read enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        return _fail(1, f"{error.filename}: {error.strerror}" if error.filename else error)
    except MemoryError as error:
        return _fail(1, f"not enough memory: {error}")
    except RuntimeError as error:
        if not any(word in str(error) for word in RUNTIME_ERRORS):
            raise
        return _fail(1, str(error).partition("\n")[0])
    except KeyboardInterrupt:
        return 130
    return 0


def _run(arguments: list[str]) -> None:
    """Parse the arguments and call the command that they name."""
    app = _application(arguments)
    command, bound, not_parsed = app.parse_args(arguments)
    if command == app.help_print and not set(arguments) & set(app.help_flags):
        raise CycloptsError(msg="A command is missing.")
    if "command_line" in not_parsed:
        typed = shlex.join(["python", "-m", "uavdh_lite", *arguments])
        bound.arguments["command_line"] = typed
    command(*bound.args, **bound.kwargs)


def _application(arguments: list[str]) -> App:
    """All commands; the one that is called with its options."""
    application = App(
        "uavdh_lite",
        help="UAV data harvesting by deep reinforcement learning.",
        help_format="markdown",
        version=__version__,
        config=_require_values,
        default_parameter=Parameter(consume_multiple=1, negative_iterable=(), allow_repeating=True),
        print_error=False,
        exit_on_error=False,
    )
    for name, (module, help) in COMMANDS.items():
        command = App(name, help=help)
        if arguments[:1] == [name]:
            command = getattr(import_module(f"uavdh_lite.cli.{module}"), name)
            if module == "training":  # its options depend on what it is called with
                command = command(arguments)
        application.command(command)
    return application


def _require_values(app, commands, arguments) -> None:
    """Refuse an empty value, and 1.5 where an int is expected: Cyclopts would round it."""
    for argument in arguments:
        if any(not token.value and token.implicit_value is UNSET for token in argument.tokens):
            raise CycloptsError(msg=f"{argument.name} is empty: give it a value.")
        if int in (argument.hint, *get_args(argument.hint)):
            for token in argument.tokens:
                if "." in token.value:
                    raise CoercionError(argument=argument, token=token, target_type=int)


def _say(kind: str, message: object) -> None:
    text = one_line(" ".join(str(message).splitlines()))
    print(f"uavdh_lite: {kind}: {text}", file=sys.stderr)


def _fail(status: int, message: object) -> int:
    """Print an error as one line."""
    _say("error", message)
    return status
