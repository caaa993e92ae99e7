import re
from dataclasses import replace

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from uavdh_lite import checkpoint
from uavdh_lite.checkpoint import load, load_agent, save, save_agent
from uavdh_lite.city import City
from uavdh_lite.errors import CheckpointError

TINY = City.from_text("tiny", "L . \n . B")


@pytest.fixture
def agent(trainer):
    """Over two cities of different sizes."""
    agent = trainer(kernels=1, hidden=(2,)).agent
    both = agent.over((agent.city, TINY))
    return replace(both, trained_in=both.cities)


@pytest.fixture
def path(agent, tmp_path):
    save_agent(tmp_path / "a.safetensors", agent)
    return tmp_path / "a.safetensors"


def test_an_agent_comes_back_whole(agent, path, generator):
    alone = agent.over(TINY)
    for one in (agent, replace(alone, trained_in=alone.cities)):
        save_agent(path, one)
        loaded = load_agent(path)
        state = one.scenario.sample(one.environment, 30, generator)
        assert torch.equal(loaded.q_values(state), one.q_values(state))
        assert (loaded.recipe, loaded.scenario) == (one.recipe, one.scenario)
        assert loaded.training == one.training and loaded.knows(one.cities)
        for ours, theirs in zip(loaded.cities, one.cities, strict=True):
            assert (ours.name, ours.fingerprint) == (theirs.name, theirs.fingerprint)


def test_foreign_files_are_refused(tmp_path):
    save_file({"x": torch.zeros(1)}, tmp_path / "other.safetensors")
    for name in ("other.safetensors", "none.safetensors", ""):
        with pytest.raises(CheckpointError, match=re.escape(str(tmp_path / name))):
            load_agent(tmp_path / name)


def test_another_kind_and_another_format_are_named(path, monkeypatch):
    with pytest.raises(CheckpointError, match="'agent', expected 'training'"):
        load(path, "training")
    monkeypatch.setattr(checkpoint, "FORMAT", checkpoint.FORMAT + 1)
    with pytest.raises(CheckpointError, match=f"format {checkpoint.FORMAT - 1}"):
        load_agent(path)


def test_half_precision_comes_back_as_float32_and_another_shape_is_damage(path):
    tensors, about = load(path, "agent")
    halves = {k: v.half() if k.startswith("network.") else v for k, v in tensors.items()}
    save(path, "agent", halves, about)
    assert {p.dtype for p in load_agent(path).network.parameters()} == {torch.float32}
    with safe_open(path, "pt") as file:
        metadata = file.metadata()
    save_file({k: v.reshape(-1) for k, v in halves.items()}, path, metadata)
    with pytest.raises(CheckpointError, match="its checksum is wrong"):
        load_agent(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda about: about["recipe"].update(wings=2),
        lambda about: about["recipe"].update(kind="Strange"),
        lambda about: about["recipe"].update(discount=7),
        lambda about: about["recipe"].update(name="a/b"),
        lambda about: about.update(scenario={}),
        lambda about: about["scenario"].update(name="a\x1b[2J"),
        lambda about: about.update(size=9),
        lambda about: about.pop("size"),
        lambda about: about["cities"].pop(),
        lambda about: about.pop("training"),
    ],
)
def test_an_agent_that_does_not_fit_is_refused(path, change):
    """Another version might write a field more, another size, a city less."""
    tensors, about = load(path, "agent")
    change(about)
    save(path, "agent", tensors, about)
    with pytest.raises(CheckpointError, match=r"a\.safetensors.*does not fit"):
        load_agent(path)


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_an_agent_with_a_weight_that_is_not_finite_is_refused(path, value):
    tensors, about = load(path, "agent")
    tensors["network.head.0.weight"][0, 0] = value
    save(path, "agent", tensors, about)
    with pytest.raises(CheckpointError, match=r"a\.safetensors.*not a finite number"):
        load_agent(path)


def test_a_loaded_agent_has_nothing_more_to_do_with_its_file(agent, path, generator):
    """Whatever is written there later, in place or shorter."""
    loaded, state = load_agent(path), agent.scenario.sample(agent.environment, 30, generator)
    before = agent.q_values(state)
    with open(path, "r+b") as file:
        file.write(bytes(path.stat().st_size))
    assert torch.equal(loaded.q_values(state), before)
    path.write_bytes(b"")
    assert torch.equal(loaded.q_values(state), before)


def test_a_shipped_name_means_the_shipped_agent(tmp_path, monkeypatch):
    (tmp_path / "manhattan").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_agent("manhattan").city.name == "manhattan"
    with pytest.raises(CheckpointError, match=r"'atlantis'.*manhattan"):
        load_agent("atlantis")
