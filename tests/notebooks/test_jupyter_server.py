"""JupyterLab opens and saves the notebooks, with jupytext installed: through a real server."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import execute
import pytest

SCRIPT = execute.scripts()[0]


@pytest.fixture
def ask(tmp_path):
    """Asks a server over a copy of one notebook and its script for a file, or saves one."""
    (tmp_path / "scripts").mkdir()
    notebook = shutil.copy(execute.notebook_of(SCRIPT), tmp_path)
    script = shutil.copy(SCRIPT, tmp_path / "scripts")
    now = time.time()
    os.utime(script, (now - 60, now - 60))  # as after a pull, or a save in another editor
    os.utime(notebook, (now, now))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = [
        f"--port={port}",
        f"--ServerApp.root_dir={tmp_path}",
        "--IdentityProvider.token=open",
    ]
    command = [sys.executable, "-m", "jupyter_server", "--no-browser", "--allow-root", *options]
    environment = {**os.environ, "HOME": str(tmp_path), "JUPYTER_RUNTIME_DIR": str(tmp_path)}
    server = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)

    def contents(path, model=None):
        data = None if model is None else json.dumps(model).encode()
        url = f"http://127.0.0.1:{port}/api/contents/{path}"
        headers = {"Authorization": "token open"}
        request = urllib.request.Request(url, data, headers, method="PUT" if data else "GET")
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.load(answer)

    for _ in range(240):
        try:
            contents("")
            break
        except OSError:
            assert server.poll() is None
            time.sleep(0.5)
    yield contents
    server.terminate()
    server.wait()


@pytest.mark.long
def test_a_notebook_that_is_newer_than_its_script_is_opened_and_saved(ask, tmp_path):
    """Finding: paired by jupytext, it was refused with 400, and a save wrote into the script."""
    before = (tmp_path / "scripts" / SCRIPT.name).read_text()
    model = ask(f"{SCRIPT.stem}.ipynb")
    assert model["content"]["cells"][0]["source"].startswith("# 0")
    ask(f"{SCRIPT.stem}.ipynb", {"type": "notebook", "content": model["content"]})
    assert (tmp_path / "scripts" / SCRIPT.name).read_text() == before
