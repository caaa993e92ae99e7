"""Arguments that several commands share, and what is made of them."""

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from uavdh_lite.errors import InputError

if TYPE_CHECKING:
    from uavdh_lite.agent import Agent

Device = Literal["cpu", "cuda", "mps"]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]


def require_device(device: Device) -> Device:
    """The name of a device that torch can use here; `InputError` if it cannot."""
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("no CUDA device: leave out --device, or install a CUDA build of torch")
    if device == "mps" and not torch.backends.mps.is_available():
        raise InputError("no MPS device: leave out --device; it needs a Mac with Apple silicon")
    return device


def open_agent(checkpoint: str, city: str | None, device: Device = "cpu") -> "Agent":
    """The agent of a file or a shipped one, over its own city, another, or a folder of them."""
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.city import load_city

    agent = load_agent(checkpoint, require_device(device))
    return agent if city is None else agent.over(load_city(city))
