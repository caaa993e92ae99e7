"""Files are written whole or not at all, and tables come back."""

import errno
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.errors import InputError
from uavdh_lite.storage import read_table, write_json, write_table

ROWS = [
    {"policy": "a", "steps": 5, "ratio": 0.123456789},
    {"policy": "b, c", "steps": 10, "ratio": None, "late": 1},
]


@pytest.mark.parametrize("name", ["table.csv", "table.csv.gz", "TABLE.CSV.GZ", f"{'n' * 251}.csv"])
def test_a_table_comes_back_and_equal_rows_give_equal_bytes(name, tmp_path):
    write_table(tmp_path / name, ROWS)
    table = read_table(tmp_path / name)
    assert list(table) == ["policy", "steps", "ratio", "late"]
    assert table["policy"].tolist() == ["a", "b, c"]
    assert table["steps"].tolist() == [5, 10]
    np.testing.assert_array_equal(table["ratio"], [0.123457, np.nan])
    np.testing.assert_array_equal(table["late"], [np.nan, 1])
    write_table(tmp_path / "again" / name, ROWS)
    content = (tmp_path / name).read_bytes()
    assert content == (tmp_path / "again" / name).read_bytes()
    assert (content[:2] + content[4:8] == b"\x1f\x8b\0\0\0\0") == name.lower().endswith(".gz")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cut.csv", b"a,b\n1\n"),
        ("more.csv", b"a,b\n1,2\n3,4,5\n"),
        ("empty.csv", b""),
        ("twice.csv", b"a,a\n1,2\n"),
        ("binary.csv", b"\xff\xfe\x00"),
        ("long.csv", b"a" * 200_000),  # the csv module has a limit of its own
    ],
)
def test_what_is_no_table_is_named(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: not a table"):
        read_table(tmp_path / name)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_column_is_of_numbers_or_text_and_empty_where_nothing_stands(encoding, tmp_path):
    """Also with the mark with which a spreadsheet begins a file, or unpacked by a browser."""
    (tmp_path / "t.csv").write_text("a,b,c\n1,,\n2,x,0.5\n", encoding=encoding)
    read = read_table(tmp_path / "t.csv")
    (tmp_path / "n.csv.gz").write_text("variant\n1e1\n10\n")
    assert read_table(tmp_path / "n.csv.gz")["variant"].tolist() == ["1e1", "10"]  # are names
    assert list(read) == ["a", "b", "c"]
    assert read["a"].tolist() == [1, 2] and read["b"].tolist() == ["", "x"]
    np.testing.assert_array_equal(read["c"], [np.nan, 0.5])


def test_the_file_that_a_link_leads_to_is_written_and_who_may_read_it_stays(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "b").touch(0o600)
    (tmp_path / "a.json").symlink_to(tmp_path / "real" / "b")
    mode = (tmp_path / "a.json").stat().st_mode
    for values in ({"first": 1}, {"in no code": "\udce9"}):
        write_json(tmp_path / "a.json", values)
        assert json.loads((tmp_path / "real" / "b").read_text()) == values
    assert (tmp_path / "a.json").is_symlink() and (tmp_path / "a.json").stat().st_mode == mode


def test_a_folder_that_cannot_be_written_names_the_file_that_was_meant(tmp_path, monkeypatch):
    def closed(path, mode):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", closed)
    with pytest.raises(PermissionError) as caught:
        write_json(tmp_path / "a.json", {})
    assert caught.value.filename == str(tmp_path / "a.json")


@pytest.mark.skipif(sys.platform == "win32", reason="needs Unix resource limits")
def test_a_save_that_outgrows_the_disk_space_leaves_the_old_file(tmp_path):
    """A real failure of the operating system: files may not grow past 4096 bytes."""
    path = tmp_path / "file.bin"
    path.write_bytes(b"old")
    program = f"""
import resource, signal
from uavdh_lite.storage import write_atomically
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
write_atomically({str(path)!r}, lambda temporary: temporary.write_bytes(bytes(100_000)))
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 1 and "File too large" in result.stderr
    assert result.stderr.rstrip().endswith(f"'{path}'")  # the system itself names no file
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
