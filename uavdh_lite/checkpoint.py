"""Save and load: one safetensors file with arrays, and JSON in its header; never a pickle."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from uavdh_lite.agent import Agent, build
from uavdh_lite.city import Cities, City, as_cities
from uavdh_lite.errors import CheckpointError, InputError
from uavdh_lite.recipe import Recipe
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import data_folder, write_atomically

FORMAT = 6


def save(path: str | Path, kind: str, tensors: dict[str, Tensor], about: dict) -> None:
    """Write tensors and JSON values to one file, atomically: on failure the old file survives.

    Arguments:
        kind: what the file holds, `agent` or `training`.
        about: JSON values.
    """
    header = json.dumps({"format": FORMAT, "kind": kind, **about})
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {"uavdh_lite": header, "sha256": _digest(header, tensors)}
    content = to_bytes(tensors, metadata)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def load(path: str | Path, kind: str) -> tuple[dict[str, Tensor], dict]:
    """Read what `save` wrote: tensors and JSON values.

    Raises `CheckpointError` if the file is missing, damaged, of another program or another kind.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
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
    if about["format"] > FORMAT:
        raise CheckpointError(f"{path}: made by a newer uavdh_lite; update it")
    _upgrade(about)
    del about["format"]
    found = about.pop("kind")
    if found != kind:
        raise CheckpointError(f"{path}: holds a checkpoint of kind {found!r}, expected {kind!r}")
    return tensors, about


def _upgrade(about: dict) -> None:
    """Turn the values of an older format into those of this one, in place.

    Older recipes had more fields, which only training used; format 1 had one crash reward for the
    whole run; formats below 4 do not say that they were made with version 1 of the streams; those
    below 5 know of nothing beyond the paper.
    """
    if about["format"] < 4 and "training" in about:
        about["training"].setdefault("streams", 1)
    if about["format"] < 3 and "recipe" in about:
        recipe = about["recipe"]
        recipe.setdefault("crash_reward_end", recipe["crash_reward"])
        for name in ("exploring_least_time", "exploring_actions"):
            recipe.pop(name, None)
    if about["format"] < 5 and "recipe" in about:
        about["recipe"] |= {"failsafe": False, "quantiles": 0, "advantage_learning": 0.0}


def _digest(header: str, tensors: dict[str, Tensor]) -> str:
    """SHA-256 of the JSON and of every tensor's name, type, shape and bytes."""
    digest = hashlib.sha256(header.encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def save_agent(path: str | Path, agent: Agent) -> None:
    """Write an agent: weights, city or cities, recipe, scenario and how it was trained."""
    tensors = {f"network.{name}": value for name, value in agent.network.state_dict().items()}
    cities = as_cities(agent.city).cities
    tensors["cities"] = torch.from_numpy(np.concatenate([city.kinds.ravel() for city in cities]))
    about = {
        "recipe": agent.recipe.as_json(),
        "scenario": asdict(agent.scenario),
        "cities": [{"name": city.name, "size": city.size} for city in cities],
        "size": agent.observation.size,
        "training": agent.training,
    }
    save(path, "agent", tensors, about)


def load_agent(path: str | Path, device: str = "cpu") -> Agent:
    """Read an agent; a bare name such as `manhattan` means a shipped one.

    An agent that was trained over many cities, or that went on from such a one, acts on the mean
    over the eight symmetries: `Agent.symmetric`.
    """
    path = Path(path)
    if path.suffix == "" and not path.exists():
        path = data_folder() / "checkpoints" / f"{path.name}.safetensors"
        if not path.exists():
            shipped = ", ".join(shipped_agents())
            raise CheckpointError(
                f"no agent named {path.stem!r}: give the path of a checkpoint, or one of {shipped}"
            )
    tensors, about = load(path, "agent")
    if "city" in about:  # of format 5 or older: one city
        kinds = tensors.pop("city")
        tensors["cities"], size = kinds.flatten(), len(kinds)
        about |= {"cities": [{"name": about["city"]["name"], "size": size}], "size": size}
    try:
        recipe = Recipe.from_json(about["recipe"])
        scenario = scenario_from_json(about["scenario"])
        city = _cities(about["cities"], tensors.pop("cities").numpy())
        observation, network = build(recipe, city, about["size"])
        network.load_state_dict({k.removeprefix("network."): v for k, v in tensors.items()})
    except (InputError, RuntimeError, KeyError, TypeError) as error:
        raise CheckpointError(
            f"{path}: does not fit this version of uavdh_lite ({error})"
        ) from None
    network.to(device).eval()
    training = about["training"]
    symmetric = training.get("symmetric", False)
    return Agent(network, observation.to(device), recipe, scenario, city, training, symmetric)


def _cities(about: list[dict], kinds: np.ndarray) -> City | Cities:
    """The city or cities with these names and sizes, and these kinds of cells in a row."""
    cells = np.split(kinds, np.cumsum([one["size"] ** 2 for one in about])[:-1])
    cities = [
        City.from_kinds(one["name"], own.reshape(one["size"], -1))
        for one, own in zip(about, cells, strict=True)
    ]
    return cities[0] if len(cities) == 1 else Cities(tuple(cities))


def scenario_from_json(values: dict) -> Scenario:
    """The scenario with these fields; lists become tuples."""
    fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return Scenario(**fields)


def shipped_agents() -> list[str]:
    """The names of the agents that come with the package."""
    return sorted(path.stem for path in (data_folder() / "checkpoints").glob("*.safetensors"))
