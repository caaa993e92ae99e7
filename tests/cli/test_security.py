"""Nothing unpickles or evaluates what it reads, and servers listen on this machine only."""

import ast
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).parents[2]
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal"}
CALLS = {"eval", "exec", "compile"}
LOADERS = {"torch.load", "joblib.load", "yaml.load", "np.load"}


def forbidden_in(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from {alias.name.split(".")[0] for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from {node.module.split(".")[0]} & MODULES
        elif isinstance(node, ast.Call):
            yield from {ast.unparse(node.func)} & (CALLS | LOADERS)


@pytest.mark.parametrize("folder", ["uavdh_lite", "notebooks", "benchmarks"])
def test_no_pickle_and_no_evaluation(folder):
    pattern = "**/*.py" if folder == "uavdh_lite" else "*.py"
    found = {
        str(path.relative_to(ROOT)): list(forbidden_in(ast.parse(path.read_text())))
        for path in (ROOT / folder).glob(pattern)
    }
    assert found and not any(found.values())


def listening(process):
    """The addresses on which a process and its children wait for connections."""
    return {
        connection.laddr.ip
        for one in (process, *process.children(recursive=True))
        for connection in one.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    }


def test_the_labs_listen_on_loopback_only():
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
