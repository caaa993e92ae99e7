"""Without the optional packages everything else works, and what needs one names its extra.

A Python process in which these packages cannot be imported stands for an installation without them.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
BLOCK = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {packages}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
"""
COMMANDS = {
    "export --checkpoint manhattan": "onnx",
    "city town.geojson --centre 50 8": "footprints",
}
CALL_ALL = """
import importlib, pkgutil, uavdh_lite
from uavdh_lite.cli.main import main
from uavdh_lite.errors import MissingExtra
for module in pkgutil.walk_packages(uavdh_lite.__path__, "uavdh_lite.", onerror=lambda name: None):
    if not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except MissingExtra as error:
            print(module.name, error)
for command in {commands}:
    assert main(command.split()) == 2
"""


def packages(extras=EXTRAS):
    """The packages that only the extras bring, as they are imported."""
    named = {"stable-baselines3": "stable_baselines3", "myst-nb": "myst_nb", "sionna-rt": "sionna"}
    listed = [one for extra in extras for one in EXTRAS[extra]]
    brought, always = (
        {re.match(r"[\w.\-]+", one)[0] for one in some}
        for some in (listed, PROJECT["dependencies"])
    )
    only = brought - always - {"uavdh-lite", "hypothesis", "pytest"}
    return {named.get(name, name) for name in only}


@pytest.mark.long
def test_a_module_imports_or_names_the_extra_that_it_needs_and_so_does_a_command(tmp_path):
    code = BLOCK.format(packages=packages(set(EXTRAS) - {"test"}))
    command = [sys.executable, "-c", code + CALL_ALL.replace("{commands}", str([*COMMANDS]))]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for said, extra in zip(done.stderr.splitlines(), COMMANDS.values(), strict=True):
        assert f"uavdh-lite[{extra}]" in said
    missing = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert all(re.search(r"uavdh-lite\[(\w+)\]'$", said)[1] in EXTRAS for said in missing.values())
    rooms = {"labs", "course", "bridges"}
    assert missing and {name.split(".")[1] for name in missing} <= rooms, missing
