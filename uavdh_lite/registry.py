"""Recipes, scenarios, policies and sources of cities by name; an extension adds its own.

A module registers what it has when it is imported. Our own are imported when something of their
kind is looked up, so that a scenario is found without loading PyTorch. An extension is another
package with an entry point in the group `uavdh_lite.extensions`; it is imported at the
first look-up.
"""

import warnings
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Literal

from uavdh_lite.errors import InputError

Kind = Literal["recipe", "recipe kind", "scenario", "policy", "cities"]
GROUP = "uavdh_lite.extensions"

# What a thing of each kind is, and our modules that register some. All of them stand above this
# one, so they are named and not imported here.
_KINDS = {
    "recipe": ("a Recipe", ("recipe", "beyond.recipes")),
    "recipe kind": ("a subclass of Recipe", ("recipe", "beyond.recipes")),
    "scenario": ("a Scenario", ("scenario", "beyond.cities")),
    "policy": ("a function", ("planners", "beyond.genie")),
    "cities": ("a function", ("beyond.cities",)),
}

_known: dict[str, dict[str, Any]] = {}


def register(kind: Kind, name: str, thing: Any) -> Any:
    """Make a thing known by its name; returns it. The last one of a name counts.

    | kind | thing |
    | --- | --- |
    | `recipe` | a `Recipe` |
    | `recipe kind` | a class of recipes, under the name of the class, for checkpoints |
    | `scenario` | a `Scenario` |
    | `policy` | a function of an environment and a seed that gives a `Policy` |
    | `cities` | a function of what follows `NAME:` that gives a tuple of cities |

    Raises `InputError` for another kind, or a thing that is not of it.
    """
    if kind not in _KINDS:
        raise InputError(f"kind {kind!r} of {name!r}: choose one of {', '.join(_KINDS)}")
    wanted, _ = _KINDS[kind]
    if not _fits(thing, wanted):
        raise InputError(f"{kind} {name!r}: must be {wanted}, found {thing!r}")
    _known.setdefault(kind, {})[name] = thing
    return thing


def _fits(thing: Any, wanted: str) -> bool:
    """Whether it is what the table says; classes are known by their names."""
    *_, name = wanted.split()
    is_class = isinstance(thing, type)
    if name == "function":
        return callable(thing)
    classes = thing.__mro__ if is_class else type(thing).__mro__
    return is_class == ("subclass" in wanted) and name in {each.__name__ for each in classes}


def find(kind: Kind, name: str) -> Any:
    """The thing of this name; raises `InputError` with the known names."""
    if name not in names(kind):
        raise InputError(f"unknown {kind} {name!r}: choose one of {', '.join(names(kind))}")
    return _known[kind][name]


def names(kind: Kind) -> list[str]:
    """The known names of a kind, in the order in which they were registered."""
    for module in _KINDS[kind][1]:
        import_module(f"uavdh_lite.{module}")
    _load_extensions()
    return list(_known.get(kind, {}))


@cache
def _load_extensions() -> None:
    """Import every extension, once: to look for them takes a while. One that fails is left out."""
    for extension in entry_points(group=GROUP):
        try:
            extension.load()
        except Exception as error:  # whatever the code of others raises
            reason = f"{type(error).__name__}: {error}"
            warnings.warn(
                f"extension {extension.name} ({extension.value}) is left out, because it fails "
                f"with {reason}",
                stacklevel=2,
            )
