"""Arguments that several commands share, and what is made of them."""

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from uavdh_lite.errors import InputError

if TYPE_CHECKING:
    from uavdh_lite.agent import Agent
    from uavdh_lite.city import City

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


def open_agent(
    checkpoint: str | None, city: "str | City | None", device: Device = "cpu"
) -> "Agent":
    """The agent of a file or a shipped one, over its own city, another, or several.

    Without a checkpoint it is the shipped agent that knows the city best; without a city, that of
    manhattan. Raises `InputError` if there is none.
    """
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.city_generator import load_city
    from uavdh_lite.policies import agents_for

    if city is None:
        return load_agent(checkpoint or "manhattan", require_device(device))
    wanted = load_city(city) if isinstance(city, str) else city
    if checkpoint is None:
        knowing = agents_for(wanted)
        if not knowing:
            raise InputError(
                f"no shipped agent flies over {wanted.size} × {wanted.size} cells: train an "
                "agent for it (train --city), and give its file as --checkpoint"
            )
        checkpoint = knowing[0]
    return load_agent(checkpoint, require_device(device)).over(wanted)
