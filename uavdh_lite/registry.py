"""Recipes, scenarios, policies and sources of cities by name; an extension adds its own.

A module registers what it has when it is imported. Packages name such modules as entry points, for
each kind in a group such as `uavdh_lite.scenario`, ours in `pyproject.toml`; they are imported when
something of that kind is looked up, so that a scenario is found without loading PyTorch.
"""

import warnings
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal

from uavdh_lite.errors import InputError

Kind = Literal["recipe", "recipe kind", "scenario", "policy", "cities"]

_known: dict[str, dict[str, Any]] = {}


def register(kind: Kind, name: str, thing: Any) -> None:
    """Make a thing known by its name. The last one of a name counts. Raises `InputError` if the
    thing itself has another name, under which files would keep it.

    | kind | thing |
    | --- | --- |
    | `recipe` | a `Recipe` |
    | `recipe kind` | a class of recipes, under the name of the class, for checkpoints |
    | `scenario` | a `Scenario` |
    | `policy` | a function of an environment and a seed that gives a `Policy` |
    | `cities` | a function of what follows `NAME:` that gives a tuple of cities |
    """
    if kind in ("recipe", "scenario") and thing.name != name:
        raise InputError(f"{kind} {name}: its own name is {thing.name!r}; give it this one, too")
    _known.setdefault(kind, {})[name] = thing


def find(kind: Kind, name: str) -> Any:
    """The thing of this name; raises `InputError` with the known names."""
    if name not in names(kind):
        raise InputError(f"unknown {kind} {name!r}: choose one of {', '.join(names(kind))}")
    return _known[kind][name]


def names(kind: Kind) -> list[str]:
    """The known names of a kind, in the order in which they were registered."""
    _load(f"uavdh_lite.{kind.removesuffix(' kind')}")
    return list(_known.get(kind, {}))


@cache
def _load(group: str) -> None:
    """Import the modules of a group, once: to look for them takes a while. Of other packages, one
    that fails is left out."""
    for module in entry_points(group=group):
        try:
            module.load()
        except Exception as error:  # whatever the code of others raises
            warnings.warn(f"extension {module.value} is left out: {error!r}", stacklevel=2)
