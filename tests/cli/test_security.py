"""Nothing unpickles or evaluates what it reads, and servers listen on this machine only."""

import ast
import pickle
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import psutil
import pytest

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.city import City
from uavdh_lite.course.challenge.board import Challenge
from uavdh_lite.errors import InputError
from uavdh_lite.missions import load_mission
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
SOURCES = [
    *sorted((ROOT / "uavdh_lite").rglob("*.py")),
    *sorted((ROOT / "notebooks").glob("*.py")),
    *sorted((ROOT / "benchmarks").glob("*.py")),
]
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal"}
CALLS = {"eval", "exec", "compile"}
# A check's mistakes are the solution's own code with a change that the check itself spells out.
# Nothing that anybody hands in or loads gets there.
OWN_CODE = {ROOT / "uavdh_lite/course/checks/table.py": {"exec": 1}}
LOADERS = {("torch", "load"), ("joblib", "load"), ("pickle", "load"), ("yaml", "load")}


def names_of(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.split(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.lineno, node.module.split(".")[0]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_pickle_and_no_evaluation(path):
    tree, evaluated = ast.parse(path.read_text()), Counter()
    found = [f"line {line}: {name}" for line, name in names_of(tree) if name in MODULES]
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        if isinstance(function, ast.Name) and function.id in CALLS:
            evaluated[function.id] += 1
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
            if (function.value.id, function.attr) in LOADERS:
                found.append(f"line {node.lineno}: {function.value.id}.{function.attr}")
            if (function.value.id, function.attr) == ("np", "load"):
                given = {k.arg: getattr(k.value, "value", None) for k in node.keywords}
                if given.get("allow_pickle") is not False:
                    found.append(f"line {node.lineno}: np.load without allow_pickle=False")
    assert not found and evaluated == OWN_CODE.get(path, {})


class Malicious:
    """Unpickling it makes a file."""

    def __init__(self, trace: Path):
        self.trace = trace

    def __reduce__(self):
        return (Path.touch, (self.trace,))


@pytest.mark.parametrize(
    ("suffix", "read"),
    [
        (".safetensors", load_agent),
        (".safetensors", lambda path: load(path, "training")),
        (".png", City.load),
        (".csv", read_table),
        (".csv.gz", read_table),
        (".json", load_mission),
        (".json", Challenge.load),
    ],
)
def test_a_malicious_pickle_is_refused_by_every_reader(suffix, read, tmp_path):
    path, trace = tmp_path / f"malicious{suffix}", tmp_path / "trace"
    path.write_bytes(pickle.dumps(Malicious(trace)))
    with pytest.raises(InputError):
        read(path)
    assert not trace.exists()
    pickle.loads(path.read_bytes())  # it would have
    assert trace.exists()


def listening(process):
    """The addresses on which a process and its children wait for connections."""
    return {
        connection.laddr.ip
        for one in (process, *process.children(recursive=True))
        for connection in one.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    }


def test_the_labs_listen_on_loopback_only(tmp_path):
    command = [sys.executable, "-m", "uavdh_lite", "app", "--no-browser", "--port", "8950"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as served:
        process, started = psutil.Process(served.pid), time.monotonic()
        try:
            while not listening(process):
                assert served.poll() is None and time.monotonic() - started < 60
                time.sleep(0.1)
            assert listening(process) == {"127.0.0.1"}
        finally:
            served.terminate()
