"""Interactive labs for notebooks and the web page: thin views over the library.

Each lab is imported when it is first asked for, so `uavdh_lite.labs.widgets` needs only ipywidgets.
"""

from importlib import import_module

_MODULES = {
    "ChannelLab": "channel",
    "CityLab": "city",
    "FlyLab": "fly",
    "Labs": "gallery",
    "MissionLab": "mission",
    "ThinkLab": "think",
    "TrainingLab": "training",
}
__all__ = ["ChannelLab", "CityLab", "FlyLab", "Labs", "MissionLab", "ThinkLab", "TrainingLab"]


def __getattr__(name: str):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
