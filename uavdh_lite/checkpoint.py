"""Save and load: one safetensors file with arrays, and JSON in its header; never a pickle."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as from_bytes
from safetensors.torch import save as to_bytes
from torch import Tensor

from uavdh_lite.agent import Agent
from uavdh_lite.city import City
from uavdh_lite.config import from_json
from uavdh_lite.errors import CheckpointError, InputError
from uavdh_lite.recipe import recipe_from_json
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import data_folder, write_atomically

FORMAT = 1


def save(path: str | Path, holds: str, tensors: dict[str, Tensor], about: dict) -> None:
    """Write tensors and JSON values to one file, atomically: on failure the old file survives.

    Arguments:
        holds: what the file is of, `agent` or `training`.
        about: JSON values.
    """
    header = json.dumps({"format": FORMAT, "kind": holds, **about})
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {"uavdh_lite": header, "sha256": _digest(header, tensors)}
    content = to_bytes(tensors, metadata)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def load(path: str | Path, holds: str) -> tuple[dict[str, Tensor], dict]:
    """Read what `save` wrote: tensors and JSON values.

    Raises `CheckpointError` if the file is missing, damaged, of another program or something else.
    """
    try:
        # Not memory-mapped: what is written to the file later must not reach the tensors
        content = Path(path).read_bytes()
        tensors = from_bytes(content)
        length = int.from_bytes(content[:8], "little")  # of the header, which begins with this
        metadata = json.loads(content[8 : 8 + length]).get("__metadata__", {})
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file") from None
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(
            f"{path}: not a checkpoint, or a damaged one ({error}); copy or train it again"
        ) from None
    if "uavdh_lite" not in metadata:
        raise CheckpointError(f"{path}: a safetensors file, but not one of uavdh_lite")
    if metadata.get("sha256") != _digest(metadata["uavdh_lite"], tensors):
        raise CheckpointError(f"{path}: damaged, its checksum is wrong; copy or train it again")
    about = json.loads(metadata["uavdh_lite"])
    found_format, found = about.pop("format"), about.pop("kind")
    if found_format != FORMAT:
        raise CheckpointError(
            f"{path}: of format {found_format}, this version of uavdh_lite reads {FORMAT}"
        )
    if found != holds:
        raise CheckpointError(f"{path}: holds a checkpoint of kind {found!r}, expected {holds!r}")
    return tensors, about


def _digest(header: str, tensors: dict[str, Tensor]) -> str:
    """SHA-256 of the JSON and of every tensor's name, type, shape and bytes."""
    digest = hashlib.sha256(header.encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def save_agent(path: str | Path, agent: Agent) -> None:
    """Write an agent: weights, the cities it was trained in, recipe, scenario, how it was trained.

    Over which other cities it flies is not part of the file: `agent.over` says that again.
    """
    tensors = {f"network.{name}": value for name, value in agent.network.state_dict().items()}
    side = max(city.size for city in agent.trained_in)
    kinds = [np.pad(city.kinds, (0, side - city.size)) for city in agent.trained_in]
    tensors["cities"] = torch.from_numpy(np.stack(kinds))
    about = {
        "recipe": agent.recipe.as_json(),
        "scenario": asdict(agent.scenario),
        "cities": [{"name": city.name, "size": city.size} for city in agent.trained_in],
        "size": agent.observation.size,  # of the largest city that the network can see
        "training": agent.training,
    }
    save(path, "agent", tensors, about)


def load_agent(path: str | Path) -> Agent:
    """Read an agent; a bare name such as `manhattan` means a shipped one.

    Raises `CheckpointError` that names the file if it holds no agent of this version.
    """
    path = _file(path)
    tensors, about = load(path, "agent")
    try:
        recipe = recipe_from_json(about["recipe"])
        scenario = from_json(Scenario, about["scenario"], "scenario")
        cities = tuple(
            City.from_kinds(one["name"], kinds[: one["size"], : one["size"]])
            for one, kinds in zip(about["cities"], tensors.pop("cities").numpy(), strict=True)
        )
        environment = recipe.environment_for(cities, scenario.channel)
        observation = recipe.observation_for(environment, about["size"])
        with torch.device("meta"):  # without weights: they are in the file
            network = recipe.network_for(observation)
        # Some files hold half-precision weights, to be small
        weights = {k.removeprefix("network."): v.float() for k, v in tensors.items()}
        network.load_state_dict(weights, assign=True)
        if not all(weight.isfinite().all() for weight in weights.values()):
            raise InputError("a weight is not a finite number")
        return Agent(network.eval(), observation, recipe, scenario, about["training"])
    except (ValueError, LookupError, RuntimeError, TypeError) as error:
        raise CheckpointError(
            f"{path}: does not fit this version of uavdh_lite ({error})"
        ) from None


def _file(path: str | Path) -> Path:
    """The file of an agent: of a run's folder its best, of a shipped name the shipped one."""
    if str(path) in shipped_agents():
        return data_folder() / "checkpoints" / f"{path}.safetensors"
    if Path(path).suffix == "" and not Path(path).exists():
        raise CheckpointError(
            f"no agent named {str(path)!r}: give the path of a checkpoint, or one of "
            f"{', '.join(shipped_agents())}"
        )
    return Path(path) / "best.safetensors" if Path(path).is_dir() else Path(path)


def shipped_agents() -> list[str]:
    """The names of the agents that come with the package."""
    return sorted(path.stem for path in (data_folder() / "checkpoints").glob("*.safetensors"))
