"""What wheel and sdist contain, the pinned versions, types."""

import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist; the wheel is built from the sdist."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, sdist


@pytest.mark.long
def test_what_is_in_the_wheel(built):
    with zipfile.ZipFile(built[0]) as archive:
        names = set(archive.namelist())
    kept = {str(p.relative_to(ROOT)) for p in (ROOT / "uavdh_lite").rglob("*.*") if p.is_file()}
    assert {n for n in kept if "__pycache__" not in n} <= names
    assert not any(name.startswith(("tests", "notebooks", "data/")) for name in names)
    assert any(name.endswith("licenses/LICENSE") for name in names)
    with tarfile.open(built[1]) as archive:
        assert all("tests/" not in name for name in archive.getnames())


def pins(name):
    return dict(re.findall(r"^([\w.\-]+)==([^\s\\]+)", (ROOT / name).read_text(), re.M))


def test_every_dependency_is_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(one for extra in extras for one in extra)]
    names = {re.match(r"[\w.\-]+", one)[0] for one in wanted} - {"uavdh-lite"}
    assert names <= set(pins("environment.txt"))


def test_the_version_is_the_same_wherever_it_stands():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert json.loads((ROOT / "codemeta.json").read_text())["version"] == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()


@pytest.mark.long
def test_types():
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
