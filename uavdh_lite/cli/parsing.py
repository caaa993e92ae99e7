"""From the arguments to the call of a command."""

from collections.abc import Callable, Sequence
from typing import Annotated, get_args

from cyclopts import App, CycloptsError, Parameter
from cyclopts.argument import ArgumentCollection
from cyclopts.exceptions import CoercionError

from uavdh_lite import __version__

CommandLine = Annotated[str, Parameter(parse=False)]
"""A command's parameter for what was typed, which results record; it is not an option."""


def application(*commands: Callable[..., None] | App) -> App:
    """An application with these commands, and the settings that all of ours share."""
    app = App(
        "uavdh_lite",
        help="UAV data harvesting by deep reinforcement learning.",
        help_format="markdown",
        version=__version__,
        config=_require_whole_numbers,
        default_parameter=Parameter(consume_multiple=1, negative_iterable=(), allow_repeating=True),
        print_error=False,
        exit_on_error=False,
    )
    for command in commands:
        app.command(command)
    return app


def run(app: App, arguments: Sequence[str], command_line: str) -> None:
    """Parse the arguments and call the command that they name.

    Raises `CycloptsError` for arguments that do not fit, and whatever the command raises.
    """
    command, bound, not_parsed = app.parse_args(arguments)
    if command == app.help_print and not set(arguments) & set(app.help_flags):
        raise CycloptsError(msg="A command is missing.")
    if "command_line" in not_parsed:
        bound.arguments["command_line"] = command_line
    command(*bound.args, **bound.kwargs)


def _require_whole_numbers(
    app: App, commands: tuple[str, ...], arguments: ArgumentCollection
) -> None:
    """Refuse 1.5 where an int is expected: Cyclopts would round it."""
    for argument in arguments:
        if int in (argument.hint, *get_args(argument.hint)):
            for token in argument.tokens:
                if "." in token.value:
                    raise CoercionError(argument=argument, token=token, target_type=int)
