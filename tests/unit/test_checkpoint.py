import errno
import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save_file

from uavdh_lite import checkpoint
from uavdh_lite.agent import Agent, build
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import City
from uavdh_lite.errors import CheckpointError, InputError


@pytest.fixture
def agent(corridor, corridor_scenario, quick):
    torch.manual_seed(0)
    observation, network = build(quick, corridor)
    return Agent(network, observation, quick, corridor_scenario, corridor, {"seed": 3})


def test_round_trip_keeps_everything(agent, tmp_path, generator):
    save_agent(tmp_path / "a.safetensors", agent)
    loaded = load_agent(tmp_path / "a.safetensors")
    state = agent.scenario.sample(agent.city, 30, generator)
    assert torch.equal(loaded.q_values(state), agent.q_values(state))
    assert (loaded.recipe, loaded.scenario) == (agent.recipe, agent.scenario)
    assert loaded.city.fingerprint == agent.city.fingerprint and loaded.city.name == "corridor"
    assert loaded.training == {"seed": 3}


def test_an_agent_with_quantiles_and_failsafe_comes_back(
    corridor, corridor_scenario, quick, tmp_path, generator
):
    recipe = replace(quick, quantiles=5, failsafe=True)
    observation, network = build(recipe, corridor)
    agent = Agent(network, observation, recipe, corridor_scenario, corridor)
    save_agent(tmp_path / "a.safetensors", agent)
    loaded = load_agent(tmp_path / "a.safetensors")
    state = corridor_scenario.sample(corridor, 30, generator)
    assert torch.equal(loaded.q_values(state), agent.q_values(state))
    assert loaded.recipe == recipe and loaded.environment.failsafe


def test_every_flipped_bit_and_every_cut_is_noticed(agent, tmp_path):
    path = tmp_path / "a.safetensors"
    save_agent(path, agent)
    content = path.read_bytes()

    @settings(derandomize=True, deadline=None, max_examples=150)
    @given(st.integers(0, len(content) - 1), st.integers(0, 7))
    def flipped(position, bit):
        damaged = bytearray(content)
        damaged[position] ^= 1 << bit
        path.write_bytes(damaged)
        with pytest.raises(CheckpointError, match=r"a\.safetensors"):
            load_agent(path)

    @settings(derandomize=True, deadline=None, max_examples=50)
    @given(st.integers(0, len(content) - 1))
    def cut(length):
        path.write_bytes(content[:length])
        with pytest.raises(CheckpointError, match=r"a\.safetensors"):
            load_agent(path)

    flipped()
    cut()


def test_foreign_files_are_refused_and_pickles_never_loaded(tmp_path):
    ran = tmp_path / "ran"

    class Malicious:
        def __reduce__(self):
            return os.mkdir, (str(ran),)

    (tmp_path / "p.safetensors").write_bytes(pickle.dumps(Malicious()))
    with pytest.raises(CheckpointError, match="not a checkpoint, or a damaged one"):
        load_agent(tmp_path / "p.safetensors")
    assert not ran.exists()
    save_file({"x": torch.zeros(1)}, tmp_path / "other.safetensors")
    with pytest.raises(CheckpointError, match="not one of uavdh_lite"):
        load_agent(tmp_path / "other.safetensors")
    with pytest.raises(CheckpointError, match="no such file"):
        load_agent(tmp_path / "none.safetensors")
    with pytest.raises(CheckpointError, match="not a checkpoint"):
        load_agent(tmp_path)
    with pytest.raises(CheckpointError, match="no agent named 'atlantis'"):
        load_agent("atlantis")


def test_wrong_kind_and_newer_format_are_named(agent, tmp_path, monkeypatch):
    path = tmp_path / "t.safetensors"
    checkpoint.save(path, "training", {}, {})
    with pytest.raises(CheckpointError, match="kind 'training', expected 'agent'"):
        load_agent(path)
    monkeypatch.setattr(checkpoint, "FORMAT", 2)
    save_agent(path, agent)
    monkeypatch.setattr(checkpoint, "FORMAT", 1)
    with pytest.raises(CheckpointError, match="made by a newer uavdh_lite"):
        load_agent(path)


def test_weights_that_do_not_fit_the_recipe_are_refused(agent, tmp_path):
    tensors = {"city": torch.from_numpy(np.array(agent.city.kinds))}
    about = {
        "recipe": agent.recipe.as_json(),
        "scenario": {"name": "x"},
        "city": {"name": "x"},
        "training": {},
    }
    checkpoint.save(tmp_path / "a.safetensors", "agent", tensors, about)
    with pytest.raises(CheckpointError, match="does not fit this version"):
        load_agent(tmp_path / "a.safetensors")


def test_another_city_of_the_same_size_is_flown_and_a_larger_one_refused(agent, generator):
    turned = City(
        "turned",
        *(
            layer[:, ::-1]
            for layer in (agent.city.landing, agent.city.no_fly, agent.city.buildings)
        ),
    )
    moved = agent.over(turned)
    assert moved.city is turned and moved.network is agent.network
    assert moved(agent.scenario.sample(turned, 4, generator)).shape == (4,)
    with pytest.raises(
        InputError, match=r"cities of up to 5 cells on a side \(corridor\), manhattan has 16"
    ):
        agent.over(City.load("manhattan"))


def test_a_failed_save_leaves_the_old_checkpoint_and_nothing_else(agent, tmp_path, monkeypatch):
    path = tmp_path / "a.safetensors"
    save_agent(path, agent)
    old = path.read_bytes()

    def full_disk(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space left"):
        save_agent(path, agent)
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


def test_an_unwritable_place_is_an_os_error(agent, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        save_agent(tmp_path / "file" / "a.safetensors", agent)


OLDER = {  # by format: Q-values of two states, crash rewards at the start and at the end
    1: ([[-0.0950597, 0.2940438, 0.1925371], [-0.1017702, 0.3038139, 0.1961779]], (-40, -40)),
    2: ([[0.6350755, 0.3239658, 0.2056790], [0.6246894, 0.3164198, 0.1991273]], (-5, -20)),
    3: ([[-0.0355664, 0.2586487, 0.1302439], [-0.0443347, 0.2665804, 0.1387281]], (-10, -150)),
    4: ([[0.6350755, 0.3239658, 0.2056790], [0.6246894, 0.3164198, 0.1991273]], (-5, -20)),
    5: ([[-0.0319342, -0.0832703, -0.044084], [-0.0167241, -0.0766186, -0.0439011]], (-150, -150)),
}


@pytest.mark.parametrize("number", OLDER)
def test_a_checkpoint_of_an_older_format_still_decides_as_it_did(number):
    """`data/formatN.safetensors` was written when N was the current format."""
    agent = load_agent(Path(__file__).parent / "data" / f"format{number}.safetensors")
    state = agent.scenario.sample(agent.city, 3, np.random.default_rng(0))
    expected, crash_rewards = OLDER[number]
    assert agent.q_values(state)[:2, :3].numpy() == pytest.approx(np.array(expected), abs=1e-6)
    assert (agent.recipe.crash_reward, agent.recipe.crash_reward_end) == crash_rewards
    assert agent.training["streams"] == (1 if number < 5 else 2)


def test_an_older_agent_is_saved_in_the_new_format(tmp_path):
    agent = load_agent(Path(__file__).parent / "data" / "format1.safetensors")
    save_agent(tmp_path / "a.safetensors", agent)
    again = load_agent(tmp_path / "a.safetensors")
    assert again.recipe == agent.recipe and again.training == agent.training
