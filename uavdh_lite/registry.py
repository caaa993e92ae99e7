"""Recipes, scenarios, policies and sources of cities by name; an extension adds its own.

An extension is a package with an entry point in the group `uavdh_lite.extensions`. It is imported
when a name is looked up, and registers what it has. So nothing here has to know of it.
"""

from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal

from uavdh_lite.errors import InputError

Kind = Literal["recipe", "recipe kind", "trainer", "scenario", "policy", "cities"]
GROUP = "uavdh_lite.extensions"

_known: dict[str, dict[str, Any]] = {}


def register(kind: Kind, name: str, thing: Any) -> Any:
    """Make a thing known by its name; returns it.

    | kind | thing |
    | --- | --- |
    | `recipe` | a `Recipe` |
    | `recipe kind` | a class of recipes, under the name of the class, for checkpoints |
    | `trainer` | a class of trainings, under the name of the class of recipes that it runs |
    | `scenario` | a `Scenario` |
    | `policy` | a function of an environment and a seed that gives a `Policy` |
    | `cities` | a function of what follows `NAME:` that gives a tuple of cities |
    """
    _known.setdefault(kind, {})[name] = thing
    return thing


def find(kind: Kind, name: str) -> Any:
    """The thing of this name; raises `InputError` with the known names."""
    if name not in names(kind):
        raise InputError(f"unknown {kind} {name!r}: choose one of {', '.join(names(kind))}")
    return _known[kind][name]


def names(kind: Kind) -> list[str]:
    """The known names of a kind, in the order in which they were registered."""
    _load_extensions()
    return list(_known.get(kind, {}))


@cache
def _load_extensions() -> None:
    """Import every extension, once: to look for them takes a while."""
    for extension in entry_points(group=GROUP):
        extension.load()
