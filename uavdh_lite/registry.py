"""Recipes, scenarios, policies and sources of cities by name; an extension adds its own.

A module registers what it has when it is imported. Packages name such modules as entry points, for
each kind in a group such as `uavdh_lite.scenario`, ours in `pyproject.toml`; they are imported when
something of that kind is looked up, so that a scenario is found without loading PyTorch.
"""

import warnings
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal, get_args

from uavdh_lite.errors import InputError

Kind = Literal["recipe", "recipe kind", "scenario", "policy", "cities"]

_kinds: dict[str, tuple[str, Callable[[Any], bool]]] = {}
_known: dict[str, dict[str, Any]] = {}


def define(kind: Kind, wanted: str, fits: Callable[[Any], bool]) -> None:
    """Say what a thing of a kind is, in words, and by a function that tells whether one is it."""
    _kinds[kind] = wanted, fits


define("policy", "a function", callable)
define("cities", "a function", callable)


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
    if kind not in get_args(Kind):
        raise InputError(f"kind {kind!r} of {name!r}: choose one of {', '.join(get_args(Kind))}")
    wanted, fits = _kinds[kind]
    if not fits(thing):
        raise InputError(f"{kind} {name!r}: must be {wanted}, found {thing!r}")
    _known.setdefault(kind, {})[name] = thing
    return thing


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
            reason = f"{type(error).__name__}: {error}"
            warnings.warn(
                f"extension {module.name} ({module.value}) is left out, because it fails "
                f"with {reason}",
                stacklevel=2,
            )
