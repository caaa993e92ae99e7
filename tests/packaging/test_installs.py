"""The core alone, the notebooks' first cell alone and each extra alone do what they promise.

Every run tries all of them in new environments of links (`installs`). `python -m pytest -m longest
tests/packaging` lets pip install them, by the commands that people type, and compares.
"""

import re
import subprocess
import sys
import tomllib
import venv
import zipfile
from importlib.metadata import distributions
from pathlib import Path

import nbformat
import pytest
from installs import Installation, install, resolve
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROMISES = Path(__file__).with_name("promises.py")
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
INSTALLATIONS = {
    "core": ["uavdh-lite"],
    "bootstrap": ["uavdh-lite", "ipywidgets"],
    **{extra: [f"uavdh-lite[{extra}]"] for extra in EXTRAS if extra != "test"},
}
VENV = {"pip", "setuptools"}  # that venv itself installs


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The project's wheel."""
    out = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, ROOT]
    done = subprocess.run(build, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    zipfile.ZipFile(wheel).extractall(folder)
    return folder


@pytest.mark.long
@pytest.mark.parametrize("name", INSTALLATIONS)
def test_an_installation_does_what_it_promises(name, unpacked, tmp_path):
    installation = install(tmp_path / "environment", unpacked, *INSTALLATIONS[name])
    installation.run(PROMISES, name, cwd=tmp_path)


def test_the_notebooks_first_cell_installs_what_is_tried_here():
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        first = next(c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code")
        (asked,) = re.findall(r"%pip install -q (.+)", first.source)
        assert asked == ".. ipywidgets", path


def test_a_package_that_is_not_promised_is_not_there(unpacked, tmp_path):
    """So these environments can fail: this package is installed here, but not there."""
    core = install(tmp_path / "environment", unpacked, "uavdh-lite")
    assert "No module named 'ipywidgets'" in core.run("-c", "import ipywidgets", expect=1)
    core.run("-c", "import numpy.linalg, torch.nn, uavdh_lite.training")


@pytest.fixture(scope="module")
def constraints(tmp_path_factory):
    path = tmp_path_factory.mktemp("constraints") / "constraints.txt"
    lines = (ROOT / "environment.txt").read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("-")))
    return path


@pytest.fixture(scope="module")
def core(wheel, constraints, tmp_path_factory):
    """An environment that pip installed the wheel in, and nothing else."""
    folder = tmp_path_factory.mktemp("core")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    core = Installation(folder)
    core.run("-m", "pip", "install", "--quiet", "-c", constraints, wheel)
    return core


@pytest.mark.long
@pytest.mark.longest
@pytest.mark.parametrize("name", INSTALLATIONS)
def test_pip_installs_the_same(name, core, constraints, unpacked, tmp_path):
    """An extra is installed on top of the core, by the command that its absence names."""
    installed = core
    if name != "core":
        venv.create(tmp_path / "environment", symlinks=True, with_pip=False)
        installed = Installation(tmp_path / "environment")
        (installed.site / "core.pth").write_text(str(core.site))
        into = ["--python", installed.python, "install", "--quiet", "--no-compile"]
        core.run("-m", "pip", *into, "-c", constraints, INSTALLATIONS[name][-1])
    sites = [str(installed.site), str(core.site)]
    names = {canonicalize_name(each.name) for each in distributions(path=sites)}
    assert names - VENV == resolve(unpacked, INSTALLATIONS[name]).keys() - VENV
    installed.run(PROMISES, name, cwd=tmp_path)
