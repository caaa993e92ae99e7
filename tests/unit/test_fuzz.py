"""Damaged and foreign files of every kind: always an error of our own, or what was saved.

A hundred examples of each in the ordinary tests, thousands with `python -m pytest -m long`.
"""

from functools import partial
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.missions import Mission, load_mission, save_mission
from uavdh_lite.storage import data_folder, read_table, write_table

DATA = Path(__file__).parent / "data"
FEW, MANY = 100, 3000


@st.composite
def damaged(draw, content: bytes) -> bytes:
    """The content cut, with bits flipped, with a part written over, or other bytes altogether."""
    kind = draw(st.sampled_from(["cut", "flip", "overwrite", "insert", "foreign"]))
    if kind == "foreign":
        return draw(st.binary(max_size=300))
    place = draw(st.integers(0, len(content) - 1))
    if kind == "cut":
        return content[:place]
    if kind == "flip":
        bytes_ = bytearray(content)
        for position in draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
            bytes_[position] ^= 1 << draw(st.integers(0, 7))
        return bytes(bytes_)
    other = draw(st.binary(min_size=1, max_size=40))
    rest = place if kind == "insert" else place + len(other)
    return content[:place] + other + content[rest:]


def checkpoint(folder):
    path = DATA / "format1.safetensors"
    expected = [p.clone() for p in load_agent(path).network.parameters()]

    def check(read):
        assert all(map(torch.equal, read.network.parameters(), expected))

    return path.read_bytes(), ".safetensors", load_agent, check


def picture(folder):
    path = data_folder() / "cities" / "manhattan.png"
    fingerprint = City.load(path).fingerprint

    def check(read):
        assert read.fingerprint == fingerprint

    return path.read_bytes(), ".png", City.load, check


def mission(folder):
    path = folder / "m.json"
    save_mission(path, Mission(City.load("village"), (0, 0), ((4, 1),), (15.0,), 24))
    expected = load_mission(path)

    def check(read):
        assert read.city.fingerprint == expected.city.fingerprint
        for name in ("start", "devices", "data", "flying_time", "seed", "max_devices"):
            assert getattr(read, name) == getattr(expected, name)

    return path.read_bytes(), ".json", load_mission, check


def table(folder, suffix):
    path = folder / f"t{suffix}"
    write_table(path, [{"steps": 5000 * k, "share": 0.1 * k, "name": "a"} for k in range(5)])

    def check(read):
        assert len({len(column) for column in read.values()}) <= 1
        if suffix == ".csv.gz":  # its checksum finds every change
            assert read["steps"].tolist() == [0, 5000, 10_000, 15_000, 20_000]

    return path.read_bytes(), suffix, read_table, check


KINDS = [
    checkpoint,
    picture,
    mission,
    partial(table, suffix=".csv"),
    partial(table, suffix=".csv.gz"),
]
NAMES = ["checkpoint", "picture", "mission", "csv", "csv.gz"]


def fuzz(kind, folder, examples):
    content, suffix, read, check = kind(folder)
    path = folder / f"damaged{suffix}"

    @settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(damaged(content))
    def attempt(data):
        path.write_bytes(data)
        try:
            found = read(path)
        except InputError as error:
            assert str(path) in str(error)
        else:
            check(found)

    attempt()


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_some(kind, tmp_path):
    fuzz(kind, tmp_path, FEW)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_thousands(kind, tmp_path):
    fuzz(kind, tmp_path, MANY)
