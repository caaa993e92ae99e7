"""What a public host reads: workflows, issue forms, the container; as far as they run here."""

import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
BIN = "Scripts" if os.name == "nt" else "bin"


def run(*command, **options):
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    options.setdefault("env", {**os.environ, "PATH": path})
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)


@pytest.mark.long
def test_the_workflows_are_valid_and_safe():
    done = run("check-jsonschema", "--builtin-schema", "vendor.github-workflows", *WORKFLOWS)
    assert done.returncode == 0, done.stdout + done.stderr
    done = run("zizmor", "--offline", "--no-progress", ROOT / ".github")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.skipif(os.name == "nt", reason="a Dockerfile runs a shell of Unix")
def test_the_container_s_commands_run_in_a_clean_environment(tmp_path):
    """The `pip` lines of its images, then what the guide has them do: open a notebook, grade."""
    text = (ROOT / "Dockerfile").read_text()
    home = tmp_path / "uavdh_lite"
    ignored = [
        line for line in (ROOT / ".dockerignore").read_text().splitlines() if "/" not in line
    ]
    shutil.copytree(ROOT, home, ignore=shutil.ignore_patterns(*ignored, "__pycache__"))
    venv.create(tmp_path / "venv", with_pip=True)
    path = os.pathsep.join([str(tmp_path / "venv" / BIN), os.environ["PATH"]])
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"PATH": path}
    assert (
        run(sys.executable, "notebooks/handout.py", tmp_path / "handout", cwd=home).returncode == 0
    )
    for command in re.findall(r"(?m)^RUN (pip install .+)$", text):
        command = command.replace("/home/jovyan/course", str(tmp_path / "handout"))
        offline = command.replace(" --index-url https://download.pytorch.org/whl/cpu", "")
        done = run("bash", "-c", offline, cwd=home, env=clean)
        assert done.returncode == 0, done.stderr
    assert re.search(r'CMD \["jupyter", "lab"', text)
    for command in ("jupyter lab --version", "nbgrader --version", "python -m uavdh_lite fly"):
        done = run("bash", "-c", command, cwd=tmp_path, env=clean)
        assert done.returncode == 0, done.stderr
    assert "landed" in done.stdout
