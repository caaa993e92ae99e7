import json
import os
from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import train
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import Recipe
from uavdh_lite.storage import read_table, write_atomically, write_table
from uavdh_lite.training import Trainer

ROWS = [
    {"policy": "a", "steps": 5, "ratio": 0.123456789},
    {"policy": "b, c", "steps": 10, "ratio": None},
]


@pytest.mark.parametrize("name", ["table.csv", "table.csv.gz"])
def test_a_table_comes_back(name, tmp_path):
    write_table(tmp_path / name, ROWS)
    table = read_table(tmp_path / name)
    assert list(table) == ["policy", "steps", "ratio"]
    assert table["policy"].tolist() == ["a", "b, c"]
    assert table["steps"].tolist() == [5, 10]
    np.testing.assert_array_equal(table["ratio"], [0.123457, np.nan])


def test_equal_rows_give_equal_bytes(tmp_path):
    for name in ("a.csv.gz", "b.csv.gz"):
        write_table(tmp_path / name, ROWS)
    assert (tmp_path / "a.csv.gz").read_bytes() == (tmp_path / "b.csv.gz").read_bytes()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("plain.csv.gz", b"a,b\n1,2\n"),
        ("cut.csv", b"a,b\n1\n"),
        ("empty.csv", b""),
        ("binary.csv", b"\xff\xfe\x00"),
    ],
)
def test_what_is_no_table_is_named(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: not a table"):
        read_table(tmp_path / name)


def test_a_run_tells_how_it_was_made(corridor, corridor_scenario, quick, tmp_path):
    recipe = replace(quick, steps=640, validation_episodes=5)
    train(Trainer(corridor_scenario, recipe, 3, corridor), tmp_path / "run", command="a command")
    about = json.loads((tmp_path / "run" / "about.json").read_text())
    assert about["command"] == "a command" and about["seed"] == 3
    assert about["steps"] == 640 and about["seconds"] > 0
    assert about.items() >= provenance().items()
    assert about["validation"]["steps"] == 640
    assert Recipe.from_json(about["recipe"]) == recipe
    assert about["scenario"]["name"] == corridor_scenario.name


def test_a_new_file_has_the_umasks_rights_and_the_umask_is_left_alone(tmp_path, monkeypatch):
    """It belongs to the whole process: to change it for a moment is a race with other threads."""
    before = os.umask(0o027)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(os, "umask", lambda mask: pytest.fail("the umask was changed"))
            write_atomically(tmp_path / "a.txt", lambda temporary: temporary.write_text("a"))
        assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640
    finally:
        os.umask(before)
