"""The world, the learning and the shipped agents behave as they did when this was recorded.

`data/reference.npz` holds, for each case, what goes in and what came out. After a change of
behaviour that is meant, `python tests/unit/test_reference.py PART…` records what comes out of these
parts now.
"""

import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import torch

from uavdh_lite import planners, registry  # noqa: F401 (the planners make themselves known)
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.beyond.global_local import GlobalLocalNetwork
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import load_cities
from uavdh_lite.course.bresenham import bresenham_fans
from uavdh_lite.environment import Environment, State
from uavdh_lite.evaluation import evaluate
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import find_recipe
from uavdh_lite.replay import Replay
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream, torch_seed

FILE = Path(__file__).parent / "data" / "reference.npz"


def environment_of(names: str, kind: str = "exact") -> Environment:
    cities = sum((load_cities(name) for name in names.split("+")), ())
    environment = SafeEnvironment(cities) if kind == "failsafe" else Environment(cities)
    if kind == "bresenham":
        size, cells = environment.size, environment.size**2
        maps = environment.buildings.reshape(-1, size, size)
        sight = np.stack([bresenham_fans(each) for each in maps]).reshape(-1, cells, cells)
        vars(environment)["sight"] = sight  # in the place of the cached one
    return environment


def state_of(recorded: dict, prefix: str, row=...) -> State:
    names = (name for name in recorded if name.startswith(prefix))
    return State(**{name.removeprefix(prefix): recorded[name][row] for name in names})


def fields_of(state: State, prefix: str) -> dict[str, np.ndarray]:
    return {prefix + name: array for name, array in vars(state).items()}


def tables(names: str, recorded: dict) -> dict:
    environment = environment_of(names)
    arrays = {"bresenham": environment_of(names, "bresenham").sight}
    for name in ("sight", "next_cell", "forbidden", "way_home", "time_to_land"):
        arrays[name] = getattr(environment, name)
    digests = {name: sha256(a.astype(np.int16).tobytes()).hexdigest() for name, a in arrays.items()}
    cities = [[city.name, city.fingerprint] for city in environment.cities]
    return digests | {"cities": cities, "transmit_snr_db": environment.transmit_snr_db}


def transitions(case: str, recorded: dict) -> dict:
    environment = environment_of(*case.split("/"))
    before, rows = state_of(recorded, "before."), recorded["rows"]
    shape = rows.max() + 1, environment.channel.slots, before.device_cells.shape[1]
    fading = np.random.default_rng(recorded["seed"]).standard_normal(shape, np.float32)[rows]
    after, outcome = environment.transition(before, recorded["action"], fading)
    allowed = environment.allowed_actions(before)
    return {"allowed": allowed, **vars(outcome), **fields_of(after, "after.")}


def starts(case: str, recorded: dict) -> dict:
    names, scenario, kind = case.split("/")
    generator = stream(Use.TEST if kind == "sample" else Use.TRAINING, 4242)
    spare_time = () if kind == "sample" else (5,)
    draw = getattr(find_scenario(scenario), kind)
    state = draw(environment_of(names), int(recorded["count"]), generator, *spare_time)
    next_draw = generator.integers(0, 2**62, 2)
    return fields_of(state[:40], "start.") | {"next_draw": next_draw}


def observations(case: str, recorded: dict) -> dict:
    names, kind = case.split("/")
    size = 16 if names == "village" else 0
    observation = Observation(environment_of(names), kind, 20.0, 10.0, size)
    map, time = observation(state_of(recorded, "state."))
    seen: list[torch.Tensor] = []
    if kind == "centred":  # what the network with two maps makes of it
        network = GlobalLocalNetwork(observation.map_shape, 3, 17, 2, 3, (2,), (4,))
        for branch in network.convolutions:
            branch.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
        network(map, time)
    return {"map": map, "time": time, **dict(zip(("global", "local"), seen, strict=False))}


def learning(name: str, recorded: dict) -> dict:
    recipe = find_recipe(name)
    environment = recipe.environment_for(load_cities("manhattan"))
    replay = Replay(200, 4, 5, recipe.discount, recipe.return_steps)
    for step, action in enumerate(recorded["action"]):  # more than fit
        before, after = (state_of(recorded, which, step) for which in ("before.", "after."))
        replay.add(before, action, recorded["reward"][step], after)
    observation = recipe.observation_for(environment)
    torch.manual_seed(torch_seed(Use.WEIGHTS, 0))
    learner = recipe.learner_for(observation, recipe.network_for(observation))
    generator, rows = np.random.default_rng(9), []
    for _ in recorded["batch.loss"]:
        batch = replay.sample(32, generator)
        row = {name: getattr(batch, name) for name in ("action", "reward", "discount")}
        row |= fields_of(batch.state, "state.") | fields_of(batch.next_state, "next_state.")
        rows.append(row | {"y": learner.targets(batch), "loss": learner.update(batch)})
    return {f"batch.{name}": np.stack([row[name] for row in rows]) for name in rows[0]}


def q_values(case: str, recorded: dict) -> dict:
    name, names = case.split("/")
    agent = load_agent(name).over(environment_of(names).cities)
    state = state_of(recorded, "state.")
    return {"q": agent.q_values(state), "action": agent.act(state)}


def flights(case: str, recorded: dict) -> dict:
    name, names, scenario, kind = case.split("/")
    environment = environment_of(names, kind)
    if name in registry.names("policy"):
        policy = registry.find("policy", name)(environment, 0)
    else:
        policy = load_agent(name).over(environment.cities)
    episodes = len(recorded["landed"])
    return evaluate(environment, policy, find_scenario(scenario), episodes, 7).records()


PARTS = (tables, transitions, starts, observations, learning, q_values, flights)
COMES_OUT = {part.__name__: part for part in PARTS}
RECORDED: dict[tuple[str, str], dict[str, np.ndarray]] = {}
with np.load(FILE, allow_pickle=False) as arrays:
    for key in arrays.files:
        part, case, name = key.split("|")
        RECORDED.setdefault((part, case), {})[name] = arrays[key]


@pytest.mark.parametrize(("part", "case"), RECORDED)
def test_nothing_has_changed(part: str, case: str):
    recorded = RECORDED[part, case]
    for name, found in COMES_OUT[part](case, recorded).items():
        if recorded[name].dtype.kind == "f":
            np.testing.assert_allclose(found, recorded[name], 1e-5, 1e-5, err_msg=name)
        else:
            np.testing.assert_array_equal(found, recorded[name], err_msg=name)


if __name__ == "__main__":
    every = {}
    for (part, case), recorded in RECORDED.items():
        if part in sys.argv[1:]:
            recorded |= COMES_OUT[part](case, recorded)
        every |= {f"{part}|{case}|{name}": array for name, array in recorded.items()}
    np.savez_compressed(FILE, **every)
