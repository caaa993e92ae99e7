"""Damaged and foreign files of every kind: always an error of our own, or what was saved."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from torch.nn.utils import parameters_to_vector

from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.missions import Mission, load_mission, save_mission
from uavdh_lite.storage import data_folder, read_table, write_table


@st.composite
def damaged(draw, content: bytes) -> bytes:
    """The content cut, with a part written over or put in, or other bytes altogether."""
    kind, other = draw(st.sampled_from(["cut", "over", "in", "foreign"])), draw(st.binary())
    place = draw(st.integers(0, len(content) - 1))
    match kind:
        case "foreign":
            return other
        case "cut":
            return content[:place]
    return content[:place] + other + content[place + (len(other) if kind == "over" else 0) :]


# Each returns a file, its reader, and whether what was read may have been in the file


def checkpoint(folder, trainer):
    def told(agent):
        return parameters_to_vector(agent.network.parameters()).tolist(), agent.recipe

    agent = trainer(kernels=2, hidden=(4,)).agent
    save_agent(folder / "a.safetensors", agent)
    return folder / "a.safetensors", load_agent, lambda read: told(read) == told(agent)


def picture(folder, trainer):
    path = data_folder() / "cities" / "manhattan.png"
    fingerprint = City.load(path).fingerprint
    return path, City.load, lambda read: read.fingerprint == fingerprint


def mission(folder, trainer):
    save_mission(folder / "m.json", Mission(City.load("village"), (0, 0), ((4, 1),), (15.0,), 24))
    return folder / "m.json", load_mission, lambda read: len(read.state) == 1 and read.fading


def table(folder, trainer):
    path = folder / "t.csv.gz"  # its checksum finds every change
    write_table(path, [{"steps": 5000 * k, "share": 0.1 * k, "name": "a"} for k in range(5)])
    return path, read_table, lambda read: read["steps"].tolist() == list(range(0, 25000, 5000))


KINDS = [checkpoint, picture, mission, table]


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_an_error_or_what_was_saved(kind, tmp_path, trainer):
    original, read, may_be = kind(tmp_path, trainer)
    path = tmp_path / f"damaged{''.join(original.suffixes)}"
    assert may_be(read(original))

    @settings(
        max_examples=100,
        derandomize=True,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(damaged(original.read_bytes()))
    def attempt(data):
        path.write_bytes(data)
        try:
            found = read(path)
        except InputError as error:
            assert str(path) in str(error)
        else:
            assert may_be(found)

    attempt()
