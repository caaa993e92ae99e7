"""Options that replace single values of a named scenario or recipe.

They come from the `option(...)` fields of the dataclasses, and their defaults are the values of the
scenario and the recipe that the command names: `train --recipe small --help` shows those of small.
So these commands are parsed twice: first for the two names, then with all options.
"""

from collections.abc import Sequence
from dataclasses import field, fields, make_dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

from cyclopts import Group, Parameter

from uavdh_lite.cli.parsing import application

if TYPE_CHECKING:
    from uavdh_lite.recipe import Recipe
    from uavdh_lite.scenario import Scenario

Preset = TypeVar("Preset", "Scenario", "Recipe")
Arguments = Annotated[str, Parameter(allow_leading_hyphen=True, show=False)]
"""The parameter of a command that parses its arguments itself."""
BeginWith = Annotated[str | None, Parameter(name="--from")]
"""The parameter for the agent that a training begins with."""


def named_presets(arguments: Sequence[str]) -> tuple["Scenario", "Recipe"]:
    """The scenario and the recipe that the arguments name, or the default ones.

    Whoever begins with an agent (`--from`) fine-tunes it; others train from nothing.
    """
    from uavdh_lite.recipe import find_recipe
    from uavdh_lite.scenario import find_scenario

    def names(
        *, scenario: str | None = None, recipe: str | None = None, begin_with: BeginWith = None
    ):
        defaults = ("manhattan", "lite") if begin_with is None else ("any_city", "fine_tune")
        return find_scenario(scenario or defaults[0]), find_recipe(recipe or defaults[1])

    app = application()
    app.help_flags, app.version_flags = (), ()
    app.default(names)
    command, bound, *_ = app.parse_known_args(arguments)
    return command(*bound.args, **bound.kwargs)


def options_of(preset: "Scenario | Recipe", title: str) -> Any:
    """The type of a parameter with an option for each `option(...)` field of a preset.

    `with_values` takes what the parameter is given: None if no such option was typed.
    """
    types = get_type_hints(type(preset))
    options = make_dataclass(
        title,
        [
            (f.name, types[f.name], field(default=getattr(preset, f.name), metadata=f.metadata))
            for f in fields(preset)
            if "help" in f.metadata
        ],
        namespace={"__module__": __name__},  # Cyclopts takes no classes of the standard library
        frozen=True,
    )
    return Annotated[
        options, Parameter("*", group=Group.create_ordered(title), show_default=_as_typed)
    ]


def with_values(preset: Preset, values: Any) -> Preset:
    """The preset with the values of its options."""
    return preset if values is None else replace(preset, **vars(values))


def _as_typed(value: Any) -> str:
    """A value as one types it on the command line."""
    if value is None:
        return "none"
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
