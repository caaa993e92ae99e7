"""The labs: one stage with one mission, and six tools to look at it.

`Lab` is imported when it is first asked for, so that a command's help does not wait for PyTorch.
"""

__all__ = ["Lab"]


def __getattr__(name: str):
    if name != "Lab":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from uavdh_lite.labs.widget import Lab

    return Lab
