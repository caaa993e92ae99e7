"""Options that several commands share, and those that come from scenarios and recipes.

Every `option(...)` field of a dataclass becomes an option. Its default is the value of the scenario
or recipe that the command names: `train --recipe small --help` shows those of `small`.
"""

import re
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import field, fields, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from cyclopts import Group, Parameter
from cyclopts.validators import Number

from uavdh_lite.recipe import Recipe, find_recipe
from uavdh_lite.scenario import Scenario, find_scenario

Preset = TypeVar("Preset")
UNIT = re.compile("_(db2?|m)$")  # at the end of a field's name; the option's help has it, too
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))]
"""How many of something are flown or run: more would take days, or more memory than there is."""
CommandLine = Annotated[str, Parameter(parse=False)]
"""A command's parameter for what was typed, which results record; it is not an option."""
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]
Checkpoint = Annotated[
    str | None,
    Parameter(
        help="A checkpoint file, or the name of a shipped agent; by default the one that knows the "
        "city best."
    ),
]
Cities = Annotated[
    str | None,
    Parameter(
        help="Another city, of the same size or smaller: a PNG, a folder of PNGs, the name of a "
        "shipped one, or random:COUNT:SEED."
    ),
]


def named(*suffixes: str) -> Parameter:
    """Of the file that a command writes: its name must end in one of these."""

    def require(_, path: Path | None) -> None:
        if path is not None and not path.name.lower().endswith(suffixes):
            raise ValueError(f"{path}: must end in {' or '.join(suffixes)}.")

    return Parameter(validator=require)


@contextmanager
def output(typed: Path | None, name: str, *endings: str) -> Iterator[Path]:
    """The file that a command writes: the typed one, which it replaces, or a new one.

    That has this name and the first ending, or name-2, name-3 and so on: the first with which no
    file exists that has any of the endings, since the others are written beside it. It is there at
    once, empty, so that no other command takes it; if writing fails, it goes.
    """
    path, stem, number = typed, name, 1
    while path is None:
        if not any(Path(stem + ending).exists() for ending in endings):
            with suppress(FileExistsError):  # another command may be quicker
                Path(stem + endings[0]).open("x").close()
                path = Path(stem + endings[0])
        number += 1
        stem = f"{name}-{number}"
    try:
        yield path
    except BaseException:
        if typed is None:
            path.unlink(missing_ok=True)
        raise


PICTURES = (".png", ".pdf", ".svg", ".jpg", ".webp")


def presets(arguments: Sequence[str]) -> tuple[Scenario, Recipe]:
    """The scenario and the recipe that the arguments name, or the default ones."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--scenario", nargs="?", default="manhattan", const="manhattan")
    parser.add_argument("--recipe", nargs="?", default="lite", const="lite")
    named, _ = parser.parse_known_args(list(arguments))
    return find_scenario(named.scenario), find_recipe(named.recipe)


def options_of(preset: Any, title: str) -> Any:
    """The type of a parameter with an option for each `option(...)` field of a preset.

    `with_values` takes what the parameter is given: None if no such option was typed.
    """
    types = get_type_hints(type(preset))
    names = {f.name: UNIT.sub("", f.name).replace("_", "-") for f in fields(preset)}
    options = make_dataclass(
        title,
        [
            (
                f.name,
                Annotated[types[f.name], Parameter(name=f"--{names[f.name]}")],
                field(default=getattr(preset, f.name), metadata=f.metadata),
            )
            for f in fields(preset)
            if "help" in f.metadata
        ],
        namespace={"__module__": __name__},  # Cyclopts takes no classes of the standard library
        frozen=True,
    )
    group = Group.create_ordered(title)
    return Annotated[options, Parameter("*", group=group, show_default=_as_typed)]


def with_values(preset: Preset, values: Any) -> Preset:
    """The preset with the values of its options."""
    return preset if values is None else replace(preset, **vars(values))  # type: ignore


def _as_typed(value: Any) -> str:
    """A value as one types it on the command line."""
    if value is None:
        return "none"
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
